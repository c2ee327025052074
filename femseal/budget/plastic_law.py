"""Estimate the error of limiting the contact pressure by the hardness instead of modelling plastic flow.

The contact law limits the pressure of each point to the hardness H. In a real metal, the material yields below the
surface. On small surfaces, the contact law was compared with solutions that use von Mises plasticity and the yield
stress σ_y, see `docs/evidence/plastic_law.md`. The two leakages are equal if the contact law uses a suitable ratio
H/σ_y. The suitable ratio H/σ_y depends on how plastic the contacts are, measured by σ_y/(E* h′), where E* is the
contact modulus and h′ the rms slope.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base import Array
from ..materials import HARDNESS_FACTOR
from ..studies import Scene
from .error_parts import ErrorPart
from .leakage_changes import part_of_changes, sensitivity

#: Values of 2.8 σ_y/(E* h′) at which the two solutions were compared.
_SEVERITY = (0.05, 0.1, 0.3, 0.6, 1.5)
#: Ratio H/σ_y with which the two solutions leak equally, at the values of `_SEVERITY`: lower and upper end of an
#: interval that contains the ratio for 95 % of the loads, surfaces and directions of the flow. Measured on 3, 4, 8,
#: 5 and 1 surfaces.
_LOWEST_RATIO = (2.85, 2.6, 2.15, 1.9, 1.65)
_HIGHEST_RATIO = (3.55, 3.3, 2.8, 2.4, 2.0)
#: Change of ln(load) that has the same effect as a unit change of ln(H), at the values of `_SEVERITY`. The change would
#: be 1 for rigid, perfectly plastic bodies and 0 for elastic bodies.
_LOAD_PER_HARDNESS = (0.95, 0.85, 0.65, 0.45, 0.25)
#: Factor by which the slope of ln(leakage) is larger towards higher loads than between the solved loads, because the
#: leakage falls ever faster.
_STEEPER = 1.5
#: If the distance from ln(leakage) to the lower end is larger than this, the seal may be sealed.
_MAY_CLOSE = 1.5


def equivalent_ratios(severity: float) -> tuple[float, float]:
    """Return the range of ratios H/σ_y for which the contact law gives the same leakage as von Mises plasticity.

    severity : ratio 2.8 σ_y/(E* h′) of the hardness to the elastic contact pressure. Outside the range of `_SEVERITY`,
        the ratios at the nearest end of `_SEVERITY` are returned.
    """
    log_severity = np.log(severity)
    lowest = float(np.interp(log_severity, np.log(_SEVERITY), _LOWEST_RATIO))
    highest = float(np.interp(log_severity, np.log(_SEVERITY), _HIGHEST_RATIO))
    return lowest, highest


def plastic_law_part(
    scene: Scene, study: Any, leakage: Array, hardness_over_yield: float = HARDNESS_FACTOR
) -> ErrorPart | None:
    """Estimate the error of limiting the contact pressure by the hardness.

    Between the lowest and the highest equivalent hardness, see `equivalent_ratios`, lies the hardness for which the
    contact law gives the leakage of a solution with von Mises plasticity. The difference between ln(H) of the study and
    ln(H) of an equivalent hardness is converted to a shift of ln(load), see `_LOAD_PER_HARDNESS`. The error of
    ln(leakage) is this shift of ln(load) times the slope |d ln(leakage)/d ln(load)|. On unloading, the error is at
    least as large as at the highest load, because the plastic deformation from the highest load remains.

    Parameters
    ----------
    scene : input of the study.
    study : result of the study.
    leakage : array (steps,), m²/s.
    hardness_over_yield : ratio H/σ_y of the hardness in the study to the yield stress.

    Returns None if the contact is elastic.
    """
    law = scene.law
    if law.is_elastic:
        return None
    yield_stress = law.mean_hardness / hardness_over_yield
    elastic_pressure = scene.surface_modulus * scene.surface.rms_slope
    severity = HARDNESS_FACTOR * yield_stress / elastic_pressure
    lowest, highest = equivalent_ratios(severity)
    load_per_hardness = float(np.interp(np.log(severity), np.log(_SEVERITY), _LOAD_PER_HARDNESS))
    steps = scene.steps
    # slope of ln(leakage) over ln(load), then over ln(H)
    load_slope = sensitivity(steps, leakage, study.contact_fraction_at(steps))
    slope = load_slope * load_per_hardness
    slope = np.maximum(slope, slope[steps.peak_indices])
    # a lower hardness has the effect of a higher load, and reduces the leakage
    below = _STEEPER * slope * max(np.log(hardness_over_yield / lowest), 0.0)
    below = np.where(below > _MAY_CLOSE, np.inf, below)
    above = slope * max(np.log(highest / hardness_over_yield), 0.0)
    note = (
        f"plastic flow below the surface, as a hardness of {lowest:.2g} to {highest:.2g} times the yield stress "
        f"instead of {hardness_over_yield:.2g} times, at 2.8 σ_y/(E* h′) = {severity:.2g}"
    )
    return part_of_changes("plastic law", steps, leakage, below, above, note)
