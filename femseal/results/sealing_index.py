"""Compute the sealing index ∫ pⁿ dl of a surface finish, and the smallest index that meets each leakage class.

Designers of metal seals integrate a power of the contact pressure p over the width of the seal, and require a minimum
value of this integral (Murtagian et al., J. Tribol. 126, 2004, 591). The exponent n and the required value usually come
from leak tests. This module computes the exponent and the required value from the leakage of a run.

Let k be the permeability of the seal, which varies only along the flow direction l. The leakage per unit length of the
seal is

    q = D / ∫ dl/k,        D = (φ(p_in) − φ(p_out)) / ρ,

where φ is the pressure potential of the fluid, p_in and p_out are the inlet and outlet pressures, and ρ is the density
at which the volume of the leakage is given. For a liquid, D is the pressure drop divided by the viscosity. For an ideal
gas, φ is proportional to the square of the pressure. If the permeability is a power of the contact pressure, k = k₀
(p/p₀)⁻ⁿ, the leakage q is at most the limit q_class of a leakage class if and only if

    ∫ pⁿ dl ≥ p₀ⁿ k₀ D / q_class.

The permeability of the seal of a run is k = q w/D, with the width w of the seal. The permeability of a stochastic seal
includes the effect of flow that makes a detour around tiles with a low permeability.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import atanh, inf, isfinite, pi

import numpy as np
from numpy.typing import ArrayLike

from ..base import Indices, InputError, Pair, to_si, validate
from ..base.leak_classes import find_leak_classes
from ..seal.layouts import AnnularLayout, MeshLayout
from .class_fluid import class_fluid
from .met_classes import class_limits
from .needed_pressure import LeakageCurve, falling_steps
from .power_law import FIT_TOLERANCE, PowerLaw, fit_power_law, fit_power_laws, integrate_power
from .results import Results

#: Quantiles of the realisations that bound their 95 % interval.
_QUANTILES = (0.025, 0.975)


@dataclass(frozen=True)
class IndexLimit:
    """Smallest sealing index that meets a leakage class.

    Attributes
    ----------
    name : str
        Name of the class.
    leakage : float
        Largest leakage per unit length of the seal that the class allows [m²/s].
    value : float
        Smallest sealing index that meets the class according to the computed leakage [Paⁿ m].
    lower, upper : float
        Lower and upper ends of the 95 % interval of `value` [Paⁿ m]; they include the deviation from the power law.
        The ends are NaN if the leakage has no 95 % interval. `upper` is inf if the error of the leakage has no upper
        bound.
    exponent : float
        Exponent n of the sealing index, which is part of its unit Paⁿ m.
    """

    name: str
    leakage: float
    value: float
    lower: float
    upper: float
    exponent: float

    def in_megapascals(self, index: float) -> float:
        """Convert a sealing index from Paⁿ m to MPaⁿ mm."""
        return index * 10 ** (3 - 6 * self.exponent)


@dataclass(frozen=True)
class SealingIndex:
    """Exponent and required values of the sealing index in a range of contact pressures.

    Attributes
    ----------
    law : PowerLaw
        Permeability as a power of the contact pressure.
    unloaded_from : float or None
        Highest nominal pressure before unloading [Pa]; None if the index is for loading.
    exponent_interval : pair of float
        Smallest and largest exponent of the power laws that are fitted to both ends of the 95 % interval of the leakage
        and to each realisation. The 2.5 % smallest and the 2.5 % largest exponents of the realisations are left out.
    limits : tuple of IndexLimit
        Smallest sealing index that meets each leakage class.
    """

    law: PowerLaw
    unloaded_from: float | None
    exponent_interval: Pair
    limits: tuple[IndexLimit, ...]

    @property
    def exponent(self) -> float:
        """Exponent n of the sealing index."""
        return self.law.exponent

    def of_profile(self, positions: ArrayLike, pressures: ArrayLike) -> float:
        """Integrate pⁿ over a profile of the contact pressure [Paⁿ m], see `integrate_power`."""
        return integrate_power(positions, pressures, self.exponent)


def sealing_indices(
    results: Results,
    classes: Iterable[str] = (),
    *,
    tolerance: float = FIT_TOLERANCE,
    nominal_diameter: float | str | None = None,
) -> tuple[SealingIndex, ...]:
    """Compute the sealing index for the surface of a run, on loading and on unloading from the highest load.

    Parameters
    ----------
    results : Results
        Results of a run whose nominal pressure is uniform over the seal.
    classes : iterable of str
        Leakage classes, or leakages with their unit. Default: the classes of the case, or else L0.01, L0.1 and L1.
    tolerance : float
        Largest relative deviation of the permeability from a power law in each range.
    nominal_diameter : float or str, optional
        Nominal diameter for the rates of ISO 5208, in metres or as text such as "50 mm".

    Returns
    -------
    tuple of SealingIndex
        A sealing index for each range of pressures: first the ranges on loading, then the ranges on unloading, each in
        descending order of pressure.

    Raises
    ------
    InputError
        The pressure differs over the seal, the seal is a mesh, the fluid is unknown, or neither loading nor unloading
        has two loads where the seal leaks.
    """
    if isinstance(nominal_diameter, str):
        nominal_diameter = to_si(nominal_diameter, "m", "nominal_diameter")
    names = tuple(classes)
    limits = class_limits(
        results.dataset, find_leak_classes(names) if names else (), nominal_diameter
    )
    return indices_of_limits(results, limits, tolerance)


def indices_of_limits(
    results: Results, limits: Mapping[str, float], tolerance: float = FIT_TOLERANCE
) -> tuple[SealingIndex, ...]:
    """Compute the sealing index for the surface of a run, with limits of the leakage in place of leakage classes.

    Parameters
    ----------
    results : Results
        Results of a run whose nominal pressure is uniform over the seal.
    limits : mapping
        Largest leakage per length of the seal [m²/s], by the name of the limit. A limit of 0 is ignored, because no
        finite sealing index prevents all leakage.
    tolerance : float
        Largest relative deviation of the permeability from a power law in each range.
    """
    tolerance = validate.tolerance("tolerance", tolerance)
    seal = _Seal(results)
    indices = []
    # None stands for loading; the last unloading is that from the highest load
    for unloaded_from in (None, *seal.curve.steps.unload_from[-1:]):
        steps = seal.leaking_steps(unloaded_from)
        if steps.size < 2:
            continue
        laws = fit_power_laws(seal.pressures[steps], seal.permeability[steps], tolerance)
        start = 0
        for law in laws:
            steps_of_law = steps[start : start + law.count]
            indices.append(seal.index(law, unloaded_from, steps_of_law, limits))
            # the last step of a law is the first one of the next
            start += law.count - 1
    if not indices:
        raise InputError("results", "a seal that leaks at fewer than two loads", "two or more")
    return tuple(indices)


class _Seal:
    """Leakage and permeability of the seal of a run at each load step, with their 95 % intervals.

    Attributes
    ----------
    drive : float
        Drop D of the pressure potential, divided by the density [1/s].
    curve : LeakageCurve
        Leakage at each load step of the fluid for which the leakage classes are evaluated.
    pressures : array
        Nominal contact pressure at each load step [Pa].
    permeability_per_leakage : float
        Ratio w/D of the permeability to the leakage per length of the seal [m s].
    permeability : array
        Permeability at each load step [m³].
    realisations : array
        Leakage of each realisation at each load step, axes: realisation, load step [m²/s].
    lower, upper : array
        95 % interval of the leakage at each load step [m²/s]. Without an error budget, the interval contains 95 % of
        the realisations.
    has_interval : bool
        Whether `lower` and `upper` are known.
    """

    def __init__(self, results: Results) -> None:
        """Read leakage and fluid from the results; raise InputError if the sealing index is not defined for the run."""
        fluid = class_fluid(results)
        if fluid is None:
            raise InputError(
                "results",
                "an unknown fluid",
                "results with the fluid for which the leakage classes are stated",
            )
        self.drive = abs(fluid.drop)
        if self.drive == 0:
            raise InputError("results", "equal pressures at inlet and outlet", "a pressure drop")
        self.curve = LeakageCurve.of_results(results)
        self.pressures = self.curve.steps.pressures
        self.permeability_per_leakage = equivalent_width(results) / self.drive
        self.permeability = self.curve.leakage * self.permeability_per_leakage
        _, realisations = results.class_leakage
        self.realisations = np.abs(realisations)
        self.lower, self.upper = self.curve.lower, self.curve.upper
        self.has_interval = self.curve.has_interval
        if not self.has_interval and len(self.realisations) > 1:
            self.lower, self.upper = np.quantile(self.realisations, _QUANTILES, axis=0)
            self.has_interval = True

    def leaking_steps(self, unloaded_from: float | None) -> Indices:
        """List the load steps where the leakage is known and above 0, from the highest load to the lowest.

        Parameters
        ----------
        unloaded_from : float or None
            Highest nominal pressure before unloading [Pa], to list the steps on unloading; None to list the steps on
            loading.
        """
        steps = falling_steps(self.curve.steps, unloaded_from)
        leakage = self.curve.leakage[steps]
        is_leaking = np.isfinite(leakage) & (leakage > 0) & (self.pressures[steps] > 0)
        return steps[is_leaking]

    def index(
        self,
        law: PowerLaw,
        unloaded_from: float | None,
        steps: Indices,
        limits: Mapping[str, float],
    ) -> SealingIndex:
        """Make the sealing index for a range of contact pressures with a common power law.

        Parameters
        ----------
        law : PowerLaw
            Power law of the permeability in the range.
        unloaded_from : float or None
            Highest nominal pressure before unloading [Pa]; None on loading.
        steps : array of int
            Load steps in the range.
        limits : mapping
            Largest leakage per length of the seal [m²/s], by the name of the limit.
        """
        # The required index p₀ⁿ k₀ D/q is proportional to the permeability. Its relative interval is therefore the
        # relative interval of the permeability around the fitted law, the widest one over the steps.
        fitted = law.at(self.pressures[steps])
        lower_ratio = upper_ratio = np.nan
        if self.has_interval:
            lower = self.lower[steps] * self.permeability_per_leakage
            upper = self.upper[steps] * self.permeability_per_leakage
            lower_ratio = float((lower / fitted).min())
            upper_ratio = float((upper / fitted).max())
        index_limits = []
        for name, leakage in limits.items():
            if leakage <= 0:
                continue
            value = law.needed_index(self.drive, leakage)
            index_limits.append(
                IndexLimit(
                    name=name,
                    leakage=leakage,
                    value=value,
                    lower=value * lower_ratio,
                    upper=value * upper_ratio,
                    exponent=law.exponent,
                )
            )
        interval = self._exponent_interval(law, steps)
        return SealingIndex(law, unloaded_from, interval, tuple(index_limits))

    def _exponent_interval(self, law: PowerLaw, steps: Indices) -> Pair:
        """Return the smallest and the largest exponent, see `SealingIndex.exponent_interval`."""
        if not self.has_interval:
            return np.nan, np.nan
        pressures = self.pressures[steps]
        lowest = highest = law.exponent
        # A lower end of zero at high pressures allows any larger exponent, and an unknown upper end any smaller one.
        for end, limit_if_unusable in ((self.lower[steps], inf), (self.upper[steps], -inf)):
            is_usable = np.isfinite(end).all() and (end > 0).all()
            exponent = limit_if_unusable
            if is_usable:
                exponent = fit_power_law(pressures, end).exponent
            lowest, highest = min(lowest, exponent), max(highest, exponent)
        # realisations that are sealed at one of the loads have no power law
        leakages = self.realisations[:, steps]
        leakages = leakages[(np.isfinite(leakages) & (leakages > 0)).all(axis=1)]
        if len(leakages) > 1:
            exponents = [fit_power_law(pressures, leakage).exponent for leakage in leakages]
            low, high = np.quantile(exponents, _QUANTILES)
            lowest, highest = min(lowest, float(low)), max(highest, float(high))
        return lowest, highest


def equivalent_width(results: Results) -> float:
    """Return the width w [m] of the straight seal that leaks as much per unit length as the seal of a run.

    The leakage per unit length of a straight seal is q = k D/w, see the top of this module. For a strip, w is the width
    of the strip. For a ring with the inner radius r_i, the outer radius r_o and the mean radius r, the width of the
    equivalent straight seal is w = r ln(r_o/r_i).

    Raises
    ------
    InputError
        The seal is a mesh, or the pressure differs over the seal.
    """
    _check_uniform_pressure(results)
    # from inlet to outlet, and along the seal; for a ring, the length is its mean circumference
    width, length = results.dataset.attrs["seal_size_m"]
    kind = results.dataset.attrs["seal_kind"]
    if kind == MeshLayout.kind:
        raise InputError("results", "a seal whose shape is a mesh", "a strip or a ring")
    if kind == AnnularLayout.kind:
        # r ln(r_o/r_i) = d artanh(w/d), with the mean diameter d = 2 r and the width w = r_o − r_i of the ring
        diameter = length / pi
        return float(diameter * atanh(width / diameter))
    return float(width)


def _check_uniform_pressure(results: Results) -> None:
    """Raise InputError if the nominal pressure differs over the seal of a run."""
    case = results.case or {}
    reasons = {
        "a map of the pressure": case.get("load", {}).get("map"),
        "a form of the seal": case.get("seal", {}).get("form") or "drawn_form" in results.dataset,
        "a seat": (case.get("seat") or {}).get("kind", "flat") != "flat",
    }
    for reason, is_given in reasons.items():
        if is_given:
            expected = "a uniform pressure; run the same finish on a flat strip"
            given = f"{reason}, so that the pressure differs over the seal"
            raise InputError("results", given, expected)


def index_text(value: float) -> str:
    """Format a sealing index with two digits, such as 3400 or 1.2e7; an index that is not finite is "unknown"."""
    if not isfinite(value):
        return "unknown"
    if value == 0:
        return "0"
    if 0.01 <= value < 1e5:
        rounded = float(f"{value:.2g}")
        return f"{rounded:g}"
    mantissa, _, power = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(power)}"
