"""Estimate the error of limiting the contact pressure by the hardness, in place of plastic flow of the material below.

The contact law cuts the pressure of each point off at H. A real metal yields below the surface. Both were compared on
small surfaces, with von Mises plasticity below the surface, see `docs/evidence/plastic_law.md`. The ratio H/σ_y with
which both leak as much depends on how plastic the contacts are, that is on H/(E* h′) with the rms slope h′.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base import Array
from ..materials import HARDNESS_FACTOR
from ..studies import Scene
from ..studies.study_registry import contact_fraction_of
from .error_parts import ErrorPart, part_of_changes, sensitivity

#: Values of 2.8 σ_y/(E* h′) at which both bodies were compared.
_SEVERITY = (0.1, 0.3, 0.6, 1.5)
#: Equivalent H/σ_y at these values: the ends of an interval that contains 95 % of the loads, surfaces and directions.
#: Measured on 4, 8, 5 and 1 surfaces.
_LOWEST_RATIO = (2.6, 2.15, 1.9, 1.65)
_HIGHEST_RATIO = (3.3, 2.8, 2.4, 2.0)
#: Change of ln(load) that has the effect of a unit change of ln(H) at these values. It is 1 for rigid, perfectly
#: plastic bodies and 0 for elastic ones.
_LOAD_PER_HARDNESS = (0.85, 0.65, 0.45, 0.25)
#: Slope of ln(leakage) towards higher loads over that between the tabulated loads, because leakage falls ever faster.
_STEEPER = 1.5
#: Distance of ln(leakage) to the lower end from which on the seal may be sealed.
_MAY_CLOSE = 1.5


def equivalent_ratios(severity: float) -> tuple[float, float]:
    """Return the interval of H/σ_y with which a limited pressure leaks as much as von Mises plasticity.

    severity : 2.8 σ_y/(E* h′), for values outside the measured range those at its ends are returned.
    """
    place = np.log(severity)
    lowest, highest = (
        float(np.interp(place, np.log(_SEVERITY), ratios))
        for ratios in (_LOWEST_RATIO, _HIGHEST_RATIO)
    )
    return lowest, highest


def plastic_law_part(
    scene: Scene, study: Any, leakage: Array, hardness_over_yield: float = HARDNESS_FACTOR
) -> ErrorPart | None:
    """Estimate the error of the contact law as a shift of the load, by the slope of ln(leakage) over ln(load).

    After unloading, the error is at least as large as at the peak, whose plastic deformation remains.

    Parameters
    ----------
    scene : input of the study.
    study : result of the study.
    leakage : array (steps,), m²/s.
    hardness_over_yield : ratio H/σ_y of the scene.

    Returns None for an elastic surface.
    """
    law = scene.law
    if law.is_elastic:
        return None
    yield_stress = law.mean_hardness / hardness_over_yield
    elastic_pressure = scene.surface_modulus * scene.surface.rms_slope
    severity = HARDNESS_FACTOR * yield_stress / elastic_pressure
    lowest, highest = equivalent_ratios(severity)
    per_hardness = float(np.interp(np.log(severity), np.log(_SEVERITY), _LOAD_PER_HARDNESS))
    steps = scene.steps
    slope = sensitivity(steps, leakage, contact_fraction_of(study, steps)) * per_hardness
    slope = np.maximum(slope, slope[steps.peak_indices])
    below = _STEEPER * slope * max(np.log(hardness_over_yield / lowest), 0.0)
    below = np.where(below > _MAY_CLOSE, np.inf, below)
    above = slope * max(np.log(highest / hardness_over_yield), 0.0)
    note = (
        f"plastic flow below the surface, as a hardness of {lowest:.2g} to {highest:.2g} times the yield stress "
        f"instead of {hardness_over_yield:.2g} times, at 2.8 σ_y/(E* h′) = {severity:.2g}"
    )
    return part_of_changes("plastic law", steps, leakage, below, above, note)
