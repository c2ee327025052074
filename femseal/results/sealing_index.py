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
from math import atanh, exp, expm1, inf, isfinite, pi

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Indices, InputError, Pair, reals, to_si, validate
from ..base.leak_rates import leak_classes
from ..seal.layouts import AnnularLayout, MeshLayout
from .class_fluid import class_fluid
from .leakage_classes import class_limits
from .results import Results
from .verdict import LeakageCurve, falling_steps

#: Largest relative deviation of the permeability from a power law within the range of pressures of the law.
FIT_TOLERANCE = 0.1
#: Quantiles of the realisations that bound their 95 % interval.
_QUANTILES = (0.025, 0.975)


@dataclass(frozen=True)
class PowerLaw:
    """Describe the permeability of a surface finish in a range of contact pressures by k = k₀ (p/p₀)⁻ⁿ.

    Attributes
    ----------
    exponent : float
        Exponent n = −d ln k/d ln p.
    pressure : float
        Reference pressure p₀ [Pa], the geometric mean of the lowest and the highest contact pressure.
    permeability : float
        Permeability k₀ at the reference pressure [m³].
    lowest_pressure, highest_pressure : float
        Lowest and highest contact pressure for which the law was fitted [Pa].
    count : int
        Number of load steps to which the law was fitted. With two load steps, the deviation is 0.
    deviation : float
        Largest relative deviation of the permeability at a load step from the law.
    """

    exponent: float
    pressure: float
    permeability: float
    lowest_pressure: float
    highest_pressure: float
    count: int
    deviation: float

    def at(self, pressure: ArrayLike) -> Array:
        """Return the permeability at a contact pressure [m³]."""
        return self.permeability * (reals(pressure) / self.pressure) ** -self.exponent

    def needed_index(self, drive: float, leakage: float) -> float:
        """Return the sealing index p₀ⁿ k₀ D/q that is required for a leakage of at most q [Paⁿ m].

        Parameters
        ----------
        drive : float
            Drop D of the pressure potential from inlet to outlet, divided by the density [1/s]; for a liquid, the
            pressure drop divided by the viscosity.
        leakage : float
            Leakage q per unit length of the seal [m²/s].
        """
        # p₀ⁿ can be too large for a number where the exponent is large; the index is then infinite
        logarithm = self.exponent * np.log(self.pressure) + np.log(
            self.permeability * drive / leakage
        )
        with np.errstate(over="ignore"):
            return float(np.exp(logarithm))


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


# --- plain functions --------------------------------------------------------------------------------------------


def fit_power_law(pressures: ArrayLike, permeabilities: ArrayLike) -> PowerLaw:
    """Fit the power law that minimises the largest relative deviation from the permeabilities (minimax fit).

    Parameters
    ----------
    pressures : array_like
        Contact pressures in any order [Pa].
    permeabilities : array_like
        Permeability at each pressure [m³].

    Returns
    -------
    PowerLaw

    Raises
    ------
    InputError
        There are fewer than two different pressures, or a value is not above 0.

    Examples
    --------
    >>> law = fit_power_law([1e8, 2e8, 4e8], [8e-18, 1e-18, 0.125e-18])
    >>> round(law.exponent, 9), round(law.deviation, 9)
    (3.0, 0.0)
    """
    p = _positive("pressures", pressures)
    k = _positive("permeabilities", permeabilities)
    if p.shape != k.shape:
        raise InputError(
            "permeabilities", f"{k.size} values", f"one for each of {p.size} pressures"
        )
    if np.unique(p).size < max(p.size, 2):
        raise InputError(
            "pressures", f"{np.unique(p).size} different ones", "two or more, all different"
        )
    # in logarithms the law is a straight line, y = intercept + slope x; the line whose largest deviation from the
    # points is smallest (Chebyshev) is parallel to a line through two of the points, so that all pairs are tried
    x, y = np.log(p), np.log(k)
    first, second = np.triu_indices(p.size, 1)
    slopes = (y[second] - y[first]) / (x[second] - x[first])
    residuals = y - slopes[:, None] * x  # axes: slope, pressure
    highest = residuals.max(axis=1)
    lowest = residuals.min(axis=1)
    best = int(np.argmin(highest - lowest))
    # the line lies midway between the highest and the lowest point
    intercept = (highest[best] + lowest[best]) / 2
    middle = (x.min() + x.max()) / 2
    return PowerLaw(
        exponent=-float(slopes[best]),
        pressure=exp(middle),
        permeability=exp(intercept + slopes[best] * middle),
        lowest_pressure=float(p.min()),
        highest_pressure=float(p.max()),
        count=p.size,
        deviation=expm1((highest[best] - lowest[best]) / 2),
    )


def fit_power_laws(
    pressures: ArrayLike, permeabilities: ArrayLike, tolerance: float = FIT_TOLERANCE
) -> tuple[PowerLaw, ...]:
    """Divide the contact pressures into as few ranges as possible, and fit a power law in each range.

    In each range, the permeability deviates from the power law by at most `tolerance`. Two neighbouring ranges have one
    pressure in common.

    Parameters
    ----------
    pressures, permeabilities : array_like
        See `fit_power_law`.
    tolerance : float
        Largest relative deviation of the permeability from the law in each range, above 0 and below 1.

    Returns
    -------
    tuple of PowerLaw
        Power laws, beginning with the range of the highest pressures.
    """
    tolerance = validate.tolerance("tolerance", tolerance)
    p = _positive("pressures", pressures)
    k = _positive("permeabilities", permeabilities)
    # this fit serves only to check the values
    fit_power_law(p, k)
    falling = np.argsort(p)[::-1]
    p, k = p[falling], k[falling]
    laws = []
    start = 0
    # each range begins with two pressures, and is extended as long as a power law fits
    while start < p.size - 1:
        law = fit_power_law(p[start : start + 2], k[start : start + 2])
        for end in range(start + 3, p.size + 1):
            longer = fit_power_law(p[start:end], k[start:end])
            if longer.deviation > tolerance:
                break
            law = longer
        laws.append(law)
        # the last pressure of a range is the first one of the next
        start += law.count - 1
    return tuple(laws)


def integrate_power(positions: ArrayLike, pressures: ArrayLike, exponent: float) -> float:
    """Integrate pⁿ over a profile of the contact pressure p, which is linear between the given positions.

    If p varies linearly from `a` to `b` between two positions, the mean of pⁿ is (bⁿ⁺¹ − aⁿ⁺¹)/((n + 1)(b − a)).

    Parameters
    ----------
    positions : array_like
        Positions along the direction of the leakage, in ascending order [m].
    pressures : array_like
        Contact pressure at each position, >= 0 [Pa].
    exponent : float
        Exponent n > 0.

    Returns
    -------
    float
        Sealing index [Paⁿ m].

    Examples
    --------
    >>> integrate_power([0.0, 0.5], [2.0, 4.0], 1.0)  # a mean of 3 Pa over 0.5 m
    1.5
    """
    n = validate.number("exponent", exponent)
    l, p = reals(positions), reals(pressures)
    if l.ndim != 1 or l.size < 2 or not (np.isfinite(l).all() and (np.diff(l) > 0).all()):
        raise InputError("positions", positions, "two or more positions in rising order [m]")
    if p.shape != l.shape or not (np.isfinite(p).all() and (p >= 0).all()):
        raise InputError("pressures", pressures, "a pressure >= 0 for each position [Pa]")
    smaller, larger = np.minimum(p[:-1], p[1:]), np.maximum(p[:-1], p[1:])
    rise = larger - smaller
    # for nearly equal pressures `a` and `b`, ((a + b)/2)ⁿ is more accurate than the formula, which divides by b − a
    is_level = rise <= 1e-6 * larger
    safe_rise = np.where(is_level, 1.0, rise)
    highest = float(p.max())
    if highest == 0:
        return 0.0
    # compute in units of the highest pressure, because the power of a pressure in pascal can be too large for a number
    larger, smaller, safe_rise = larger / highest, smaller / highest, safe_rise / highest
    exact = (larger ** (n + 1) - smaller ** (n + 1)) / ((n + 1) * safe_rise)
    mean = np.where(is_level, ((larger + smaller) / 2) ** n, exact)
    with np.errstate(over="ignore"):
        return float(np.sum(mean * np.diff(l)) * np.power(highest, n))


def _positive(name: str, values: ArrayLike) -> Array:
    """Return the values as an array; raise InputError unless all values are finite and above 0."""
    array = reals(values)
    if array.ndim != 1 or not (np.isfinite(array).all() and (array > 0).all()):
        raise InputError(name, values, "finite numbers > 0")
    return array


# --- results of a run -------------------------------------------------------------------------------------------


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
    limits = class_limits(results.dataset, leak_classes(names) if names else (), nominal_diameter)
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

    The leakage per unit length of a straight seal is q = k D/w, see the module. For a strip, w is the width of the
    strip. For a ring with the inner radius r_i, the outer radius r_o and the mean radius r, the width of the equivalent
    straight seal is w = r ln(r_o/r_i).

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
    """Write a sealing index with two digits, such as 3400 or 1.2e7, or "unknown" if it is not finite."""
    if not isfinite(value):
        return "unknown"
    if value == 0:
        return "0"
    if 0.01 <= value < 1e5:
        rounded = float(f"{value:.2g}")
        return f"{rounded:g}"
    mantissa, _, power = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(power)}"
