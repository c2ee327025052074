"""Estimate contact and leakage from the spectrum of a surface by Persson's theory, without a numerical solution.

The estimate serves as a forecast before a case is solved, and as a plausibility check of a computed leakage. The
leakage is computed as the flow between two parallel plates. The distance between the plates is the gap of the critical
junction, see `persson.critical_junction`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np

from ..base import Array
from ..contact import Bodies, modulus_of_waves
from ..persson import CLOSING_AREA, critical_junction
from ..scene import Scene
from ..topography import Surface, Topography

#: Number of bands into which a spectrum is divided.
_BANDS = 64
#: Bands with less than this fraction of the mean square slope contain rounding errors only.
_ROUNDING = 1e-12
#: Contact fraction up to which the error of the estimate is known. Above it, single constrictions dominate the leakage.
LIGHT_CONTACT = 0.3
#: Factors within which half and 95 % of the estimates are right, from 100 scenes of
#: `tests/benchmarks/quick_estimate.py`.
ERROR_FACTORS = (2.2, 10.0)
#: A leakage is not plausible if it differs from the estimate by more than this many times the factor for 95 %.
_IMPLAUSIBLE = 10.0
#: Largest fraction of the variance of the heights that may be due to a smooth profile along one axis. For a larger
#: fraction, the profile determines where the surfaces touch. In 120 self-affine surfaces without roll-off the fraction
#: was at most 0.64. With a crown of fraction 0.6, the estimate is wrong by factors of 3 to 12; with 0.76, by 7 to more
#: than 300.
_FORM_DECIDES = 0.7
#: Degree of the polynomial that is fitted to a profile.
_FORM_DEGREE = 4


@dataclass(frozen=True, eq=False)
class QuickEstimate:
    """Estimated contact and leakage of a surface at several loads; values are NaN where unknown.

    Attributes
    ----------
    area : array, (loads,)
        Contact fraction.
    gap : array, (loads,)
        Gap of the critical junction [m], 0 if the surface is sealed.
    mean_gap : array, (loads,)
        Mean gap [m].
    leakage : array, (loads,)
        Leakage per length of seal [m²/s].
    """

    area: Array
    gap: Array
    mean_gap: Array
    leakage: Array

    @property
    def permeability(self) -> Array:
        """Permeability of the surface (loads,) [m³]."""
        return self.gap**3 / 12

    def leakage_warnings(self, leakage: Array, names: Sequence[str]) -> list[str]:
        """Warn if a computed leakage differs too much from the estimate, at the load where the difference is largest.

        Loads with a contact fraction above 0.3 are not compared, because a few constrictions then determine the
        leakage.

        Parameters
        ----------
        leakage : array, (loads,)
            Computed leakage per length of seal [m²/s].
        names : sequence of str
            Names of the load steps.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.abs(leakage / self.leakage)
            is_comparable = (ratio > 0) & (ratio < inf) & (self.area < LIGHT_CONTACT)
            difference = np.where(is_comparable, np.abs(np.log(ratio)), 0.0)
        worst = int(difference.argmax())
        if difference[worst] <= np.log(_IMPLAUSIBLE * ERROR_FACTORS[1]):
            return []
        return [
            "The units of heights, pixel, loads or modulus may be wrong: at "
            f"{names[worst]} the leakage is {ratio[worst]:.2g} times the quick estimate by the spectrum of the "
            f"surface, which is right within a factor of {ERROR_FACTORS[1]:g} in 95 % of the cases"
        ]

    def __str__(self) -> str:
        """Describe the estimate and its error in one sentence."""
        text = (
            f"contact {first_to_last(100 * self.area)} %, "
            f"narrowest passage {first_to_last(1e6 * self.gap)} µm"
        )
        if np.isfinite(self.leakage).any():
            text += f", leakage {first_to_last(self.leakage)} m²/s per length (0: sealed)"
        factor_of_half, factor_of_95 = ERROR_FACTORS
        return (
            f"{text}; by the spectrum alone, within a factor of {factor_of_half:g} in half of the cases and "
            f"{factor_of_95:g} in 95 % up to {100 * LIGHT_CONTACT:g} % of contact, and unknown beyond"
        )


def first_to_last(values: Array) -> str:
    """Return the first and the last known value of an array as text, or "" if no value is known.

    >>> first_to_last(np.array([nan, 0.123, 4.0]))
    '0.12 to 4'
    """
    known = values[np.isfinite(values)]
    ends = [*known[:1], *known[-1:]]  # empty if no value is known
    texts = [f"{float(f'{value:.2g}'):g}" for value in ends]
    return " to ".join(dict.fromkeys(texts))  # one text if both ends are equal


def estimate_surface(
    surface: Surface,
    modulus: float | Bodies,
    hardness: float,
    pressures: Sequence[float] | Array,
) -> QuickEstimate:
    """Estimate contact fraction and gaps of a surface. The leakage is not estimated: `leakage` is NaN.

    All flow paths are closed above a certain contact fraction. For grooves along the seal, this contact fraction is
    smaller than for isotropic roughness; for grooves in the direction of the leakage, it is larger. The value for
    isotropic roughness is therefore multiplied by 2s₂/(s₁ + s₂), where s₁ and s₂ are the rms slopes along x1 and x2.
    The results for several patches are averaged.

    Parameters
    ----------
    surface : Topography or Patches
        Heights of the combined surfaces, without undefined points.
    modulus : float or pair of bodies
        Contact modulus E* [Pa], or the two bodies. The modulus of coated bodies depends on the wavelength. For coated
        bodies, the root mean square of the modulus over all waves is used, weighted by their mean square slope. The
        reason is that Persson's theory contains the sum of (slope × modulus)² over all waves (Persson, Surf. Sci. Rep.
        61, 2006, 201, section 5).
    hardness : float
        Hardness H [Pa], infinite for an elastic surface.
    pressures : sequence of float or array, (loads,)
        Nominal pressures supported by the contact [Pa].
    """
    patches = surface.patches
    junctions = np.full((len(patches), len(pressures), 3), nan)  # (patch, load, quantity)
    for n, patch in enumerate(patches):
        wave_numbers, mean_squares = _spectrum_in_bands(patch)
        if not wave_numbers.size:
            continue
        patch_modulus = _mean_modulus(modulus, wave_numbers, mean_squares)
        slopes = patch.rms_slopes
        closing = CLOSING_AREA * 2 * slopes[1] / sum(slopes)
        for load, pressure in enumerate(pressures):
            if pressure > 0:
                # contact fraction, gap of the critical junction, and mean gap
                junctions[n, load] = critical_junction(
                    pressure,
                    patch_modulus,
                    wave_numbers,
                    mean_squares,
                    hardness=hardness,
                    closing=closing,
                )
    widths = [patch.shape[1] for patch in patches]
    area, _, mean_gap = np.average(junctions, axis=0, weights=widths).T
    # The permeabilities of the patches are averaged. A permeability is proportional to the third power of the critical
    # gap.
    critical_gap = junctions[..., 1]
    gap = np.cbrt(np.average(critical_gap**3, axis=0, weights=widths))
    return QuickEstimate(area, gap, mean_gap, np.full(len(pressures), nan))


def estimate_scene(scene: Scene, unit_leakage: float | None = None) -> QuickEstimate | None:
    """Estimate contact and leakage at the load steps of a scene, for a uniform nominal pressure.

    Parameters
    ----------
    scene : Scene
        Surface, loads and fluid. The estimate is NaN at unloading steps.
    unit_leakage : float, optional
        Leakage per seal length for a uniform permeability of 1 m³ [1/(m s)]. Default: the value for a seal that is as
        wide as the surface.

    Returns
    -------
    QuickEstimate or None
        None if no estimate is possible, for one of three reasons: the seal has a spiral groove; a smooth profile of the
        surface, such as a crown, determines where the surfaces touch; or the contact is unknown at all loads.
    """
    if scene.flow.spiral is not None or any(map(_has_form, scene.surface.patches)):
        return None
    fluid, steps = scene.acting_fluid, scene.steps
    carried = fluid.mean_if_separated if fluid is not None and fluid.carrier == "total" else 0.0
    pressures = np.where(steps.on_loading, steps.pressures - carried, nan)
    estimate = estimate_surface(scene.surface, scene.modulus, scene.law.mean_hardness, pressures)
    if np.isnan(estimate.area).all():
        return None
    if unit_leakage is None:
        unit_leakage = scene.unit_leakage
    factors = [scene.flow.drop.mean_factor_of(gap) for gap in estimate.gap]
    return replace(estimate, leakage=unit_leakage * estimate.permeability * factors)


def _has_form(patch: Topography) -> bool:
    """Return whether most of the variance of the heights is due to a smooth profile along one axis, such as a crown."""
    heights = patch.heights - patch.heights.mean()
    variance = heights.var()
    for axis in (0, 1):
        profile = heights.mean(axis=1 - axis)  # mean over the other axis
        if profile.size <= _FORM_DEGREE:
            continue  # too few points to fit a polynomial
        x = np.linspace(-1.0, 1.0, profile.size)
        smooth_profile = np.polyval(np.polyfit(x, profile, _FORM_DEGREE), x)
        if smooth_profile.var() > _FORM_DECIDES * variance:
            return True
    return False


def mean_modulus(scene: Scene) -> float:
    """Compute the contact modulus of a scene [Pa].

    The modulus of coated bodies depends on the wavelength. For coated bodies, return the root mean square of the
    modulus over the waves of the surface, weighted by their mean square slope.
    """
    if isinstance(scene.modulus, float):
        return scene.modulus
    wave_numbers, mean_squares = _spectrum_in_bands(scene.surface.patches[0])
    if not wave_numbers.size:
        return scene.surface_modulus
    return _mean_modulus(scene.modulus, wave_numbers, mean_squares)


def _mean_modulus(modulus: float | Bodies, wave_numbers: Array, mean_squares: Array) -> float:
    """Compute the root mean square of the contact modulus [Pa] over waves, weighted by their mean square slope.

    wave_numbers : wave number of each wave [rad/m].
    mean_squares : mean square height of each wave [m²].
    """
    if isinstance(modulus, float):
        return modulus
    square_slopes = mean_squares * wave_numbers**2
    square_modulus = modulus_of_waves(modulus, wave_numbers) ** 2
    return float(np.sqrt(square_modulus @ square_slopes / square_slopes.sum()))


def _spectrum_in_bands(patch: Topography) -> tuple[Array, Array]:
    """Divide the radial spectrum of a patch into logarithmic bands.

    Returns a representative wave number [rad/m] and the mean square height [m²] of each band. The mean square heights
    are scaled so that the bands together have the rms slope of the patch.
    """
    q, density = patch.radial_psd()
    starts = np.unique(np.geomspace(1, q.size, _BANDS).astype(int)) - 1  # first index of each band
    # Moments of the isotropic spectrum in each band, up to a constant factor: ∫ C q dq is the mean square height, and
    # ∫ C q³ dq the mean square slope.
    height_moment = np.add.reduceat(density * q**1, starts)
    slope_moment = np.add.reduceat(density * q**3, starts)
    is_significant = slope_moment > _ROUNDING * slope_moment.sum()
    height_moment, slope_moment = height_moment[is_significant], slope_moment[is_significant]
    wave_number = np.sqrt(slope_moment / height_moment)
    mean_square_height = height_moment * patch.rms_slope**2 / slope_moment.sum()
    return wave_number, mean_square_height
