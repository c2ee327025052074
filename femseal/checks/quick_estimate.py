"""Quick estimate of contact and leakage from the spectrum of a surface alone, by Persson's theory: nothing is solved.

It forecasts a case, and a computed leakage that is far from it is not plausible. The leakage is that of two parallel
plates as far apart as the critical junction, see `analytic.critical_junction`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np

from ..analytic import CLOSING_AREA, critical_junction
from ..base import Array
from ..scene import Scene
from ..topography import Surface, Topography

#: Groups of waves into which a spectrum is put together, and the part of the mean square slope that is rounding.
_GROUPS, _ROUNDING = 64, 1e-12
#: Contact fraction up to which the estimate has a known error, and factors within which half and 95 % of the estimates
#: are there, measured on 100 scenes of `tests/benchmarks/quick_estimate.py`. Above it single constrictions decide.
LIGHT_CONTACT, ERROR_FACTORS = 0.3, (2.2, 10.0)
#: Times the factor at 95 % by which a leakage may differ from the estimate before it is not plausible.
_IMPLAUSIBLE = 10.0
#: Part of the variance of the heights in a smooth profile along one axis from which on that profile decides where the
#: surface touches. Self-affine surfaces without roll-off have up to 0.64, of 120 that were made. With a crown that has
#: 0.6 of the variance, the estimate is wrong by factors of 3 to 12; with 0.76, of 7 to more than 300.
_FORM_DECIDES = 0.7
#: Degree of the polynomial that is the profile.
_FORM_DEGREE = 4


@dataclass(frozen=True, eq=False)
class QuickEstimate:
    """Contact and leakage at the loads of a surface, from its spectrum; arrays (loads,), NaN where unknown.

    Attributes
    ----------
    area : contact fraction.
    gap : narrowest gap along the widest path of the flow [m], 0 of a sealed surface.
    mean_gap : [m].
    leakage : of the seal per length [m²/s].
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
        """Compare a computed leakage with the estimate, and warn of the load at which they differ most.

        Near closing, where few constrictions decide, nothing is compared.

        leakage : array (loads,) per length of seal [m²/s]. names : of the loads.
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
        text = (
            f"contact {first_to_last(100 * self.area)} %, "
            f"narrowest passage {first_to_last(1e6 * self.gap)} µm"
        )
        if np.isfinite(self.leakage).any():
            text += f", leakage {first_to_last(self.leakage)} m²/s per length (0: sealed)"
        half, most = ERROR_FACTORS
        return (
            f"{text}; by the spectrum alone, within a factor of {half:g} in half of the cases and {most:g} in 95 % up "
            f"to {100 * LIGHT_CONTACT:g} % of contact, and unknown beyond"
        )


def first_to_last(values: Array) -> str:
    """Write the first and the last known value as text, "" without any.

    >>> first_to_last(np.array([nan, 0.123, 4.0]))
    '0.12 to 4'
    """
    known = values[np.isfinite(values)]
    ends = [*known[:1], *known[-1:]]
    return " to ".join(dict.fromkeys(f"{float(f'{value:.2g}'):g}" for value in ends))


def estimate_surface(
    surface: Surface, modulus: float, hardness: float, pressures: Sequence[float] | Array
) -> QuickEstimate:
    """Estimate contact fraction and gaps of a surface without undefined points; its leakage is NaN.

    Grooves along the seal close at less contact than isotropic roughness, and those along the leakage at more: by the
    rms slopes s along x1 and x2 at 2s₂/(s₁ + s₂) times as much. Of several patches it is the mean.

    Parameters
    ----------
    surface : heights of the combined surfaces.
    modulus : contact modulus E* [Pa].
    hardness : H [Pa], inf for an elastic surface.
    pressures : nominal pressures that the contact carries [Pa].
    """
    patches = surface.patches
    junctions = np.full((len(patches), len(pressures), 3), nan)  # (patch, load, quantity)
    for n, patch in enumerate(patches):
        waves, powers = _spectrum(patch)
        if not waves.size:
            continue
        slopes = patch.rms_slopes
        closing = CLOSING_AREA * 2 * slopes[1] / sum(slopes)
        for load, pressure in enumerate(pressures):
            if pressure > 0:
                junctions[n, load] = critical_junction(
                    pressure, modulus, waves, powers, hardness=hardness, closing=closing
                )
    widths = [patch.shape[1] for patch in patches]
    area, _, mean_gap = np.average(junctions, axis=0, weights=widths).T
    gap = np.cbrt(np.average(junctions[..., 1] ** 3, axis=0, weights=widths))
    return QuickEstimate(area, gap, mean_gap, np.full(len(pressures), nan))


def estimate_scene(scene: Scene, unit_leakage: float | None = None) -> QuickEstimate | None:
    """Estimate contact and leakage at the load steps of a scene, all of whose surface is pressed evenly.

    Parameters
    ----------
    scene : surface, loads and fluid. Steps of an unloading are unknown.
    unit_leakage : leakage per length of the seal if its permeability were 1 m³ everywhere [1/(m s)]; that of the
        surface itself unless given.

    Returns None where the spectrum does not tell: of spirals, of surfaces whose form decides where they touch, and
    where contact is unknown at all loads.
    """
    if scene.flow.spiral is not None or any(map(_has_form, scene.surface.patches)):
        return None
    fluid, steps = scene.acting_fluid, scene.steps
    carried = fluid.carried if fluid is not None and fluid.nominal == "total" else 0.0
    pressures = np.where(steps.on_loading, steps.pressures - carried, nan)
    estimate = estimate_surface(scene.surface, scene.modulus, scene.law.mean_hardness, pressures)
    if np.isnan(estimate.area).all():
        return None
    if unit_leakage is None:
        unit_leakage = scene.unit_leakage
    factors = [scene.flow.drop.mean_factor_of(gap) for gap in estimate.gap]
    return replace(estimate, leakage=unit_leakage * estimate.permeability * factors)


def _has_form(patch: Topography) -> bool:
    """Tell whether a smooth profile along one axis has most of the variance of the heights, as of a crowned seat."""
    heights = patch.heights - patch.heights.mean()
    variance = heights.var()
    for axis in (0, 1):
        profile = heights.mean(axis=1 - axis)
        if profile.size <= _FORM_DEGREE:
            continue
        x = np.linspace(-1.0, 1.0, profile.size)
        form = np.polyval(np.polyfit(x, profile, _FORM_DEGREE), x)
        if form.var() > _FORM_DECIDES * variance:
            return True
    return False


def _spectrum(patch: Topography) -> tuple[Array, Array]:
    """Group the waves of a patch: wavenumbers [rad/m] and mean square heights [m²], with the rms slope of the patch."""
    q, density = patch.radial_psd()
    first = np.unique(np.geomspace(1, q.size, _GROUPS).astype(int)) - 1
    power, slope2 = (np.add.reduceat(density * q**n, first) for n in (1, 3))
    counts = slope2 > _ROUNDING * slope2.sum()
    power, slope2 = power[counts], slope2[counts]
    return np.sqrt(slope2 / power), power * patch.rms_slope**2 / slope2.sum()
