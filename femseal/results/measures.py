"""Estimate which action would narrow the 95 % interval of a leakage most, and which would lower the leakage.

- An action that narrows the interval reduces an error source. The contribution of this error source to the interval of
  ln(leakage) is multiplied by a factor, and all other contributions remain the same.
- To lower the leakage, the load is increased. The leakage is extrapolated along the loading curve to the higher load.
- To lower the leakage, the roughness heights are reduced. The leakage of the smoother surface follows from a scaling
  law, see `_slope_over_heights`.

The estimates are computed from stored results, without solving any contact or flow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array
from ..budget import ErrorBudget
from ..budget.error_parts import ORDER
from ..budget.sources import OTHER_ROWS, SOURCES
from ..studies.patch_interval import error_of_few_carriers
from .best_leakage import class_interval_of
from .results import Results

#: Action that reduces each source of error, by the name of its row in the error budget.
_REMEDIES = {source.name: source.remedy for source in SOURCES} | OTHER_ROWS
#: Action against the error "plastic law" if the case gives the yield stress and not the hardness.
_RATIO_TO_YIELD_STRESS = (
    "the hardness_over_yield that agrees with plastic flow at this roughness, in [material]"
)
#: Actions for a generated surface, which can be made in any size.
NARROWED_IF_GENERATED = {
    "patch": "a larger generated surface",
    "longer waves": "a larger generated surface",
}
#: Actions of a known extent, and the factor by which each action multiplies the error of ln(leakage) from its error
#: source.
_QUANTIFIED_MEASURES = {
    "pixels": ("twice the points along each side", 2.0**-ORDER),
    "realisations": ("four times as many realisations in [stochastic]", 0.5),
    "solver": ("a tenth of contact.rtol", 0.1),
    "hardness": ("measuring the hardness to half its tolerance", 0.5),
    "form": ("measuring the form to half its tolerance", 0.5),
    "patches": ("four times as many measured patches", 0.5),
}
#: Actions for the source "patch", with the ratio of the larger area to the present area. The factor by which an action
#: multiplies the error depends on the contact state, see `_patch_factor`.
_LARGER_PATCH = ("a measured area four times as large", 4.0)
_LARGER_GENERATED = ("a generated surface with twice the length along each side", 4.0)
#: Action for a generated surface that already is as wide as the seal, so that only more length helps.
_LONGER_GENERATED = ("a generated surface four times as long along x2", 4.0)
#: Relative increase of the load whose effect is reported.
LOAD_INCREASE = 0.1
#: Factor by which the roughness heights are multiplied in the smoother finish whose effect is reported.
HEIGHTS = 0.8
#: Relative error of the hardness if the case states no hardness_tolerance.
_HARDNESS_TOLERANCE = 0.1
#: Keys of a material whose hardness depends on the depth of the deformation.
_HARDENING_KEYS = ("hardening", "nix_gao_depth", "hardness_table", "coating")


@dataclass(frozen=True)
class Narrowing:
    """Describe an action that makes the 95 % interval of a leakage narrower.

    Attributes
    ----------
    source : str
        Source of error that the action reduces.
    action : str
        Description of the action.
    lower, upper : float
        Estimated lower and upper ends of the 95 % interval after the action [m²/s].
    is_best_case : bool
        True if it is unknown how much the action reduces the error source. If True, `lower` and `upper` are computed as
        if the action removed the error source completely.
    """

    source: str
    action: str
    lower: float
    upper: float
    is_best_case: bool


@dataclass(frozen=True)
class Lowering:
    """Factors by which a higher load and a smoother finish would multiply the leakage; NaN if unknown.

    Attributes
    ----------
    by_load : float
        Factor by which the leakage changes if the load is increased by the fraction `LOAD_INCREASE`.
    by_finish : float
        Factor by which the leakage changes if the roughness heights are multiplied by `HEIGHTS`.
    """

    by_load: float
    by_finish: float


def narrowed_by(results: Results, source: str) -> str:
    """Describe an action that reduces an error source; "" if no action is known."""
    if is_generated(results) and source in NARROWED_IF_GENERATED:
        return NARROWED_IF_GENERATED[source]
    material = results.case.get("material") or {}
    if source == "plastic law" and material.get("yield_stress") is not None:
        return _RATIO_TO_YIELD_STRESS
    return _REMEDIES.get(source, "")


def is_generated(results: Results) -> bool:
    """Return whether all faces of a run were generated instead of measured."""
    faces = results.case.get("face") or {}
    tables = faces if isinstance(faces, list) else [faces]
    return bool(faces) and all(table.get("kind", "file") != "file" for table in tables)


def best_narrowing(results: Results, step: int) -> Narrowing | None:
    """Find the action that narrows the 95 % interval at a load step most.

    The returned action reduces the error source with the widest interval at the load step.

    Parameters
    ----------
    results : Results
        Results of a run.
    step : int
        Index of the load step.

    Returns
    -------
    Narrowing or None
        None if the run has no error budget, or if the computed leakage at the load step is zero.
    """
    budget = results.budget
    if budget is None or not budget.parts or not np.abs(budget.leakage[step]) > 0:
        return None
    return _narrowing(results, budget, budget.limiting(step), step)


def _narrowing(results: Results, budget: ErrorBudget, source: str, step: int) -> Narrowing:
    """Estimate the 95 % interval at a load step after an action that reduces the error source `source`."""
    # if the effect of an action is unknown, the factor is 0, as if the source of error were removed
    action, factor = _QUANTIFIED_MEASURES.get(source, ("", 0.0))
    if source == "patch":
        action, area_ratio = _larger_patch(results)
        factor = _patch_factor(results, step, area_ratio)
    is_best_case = not action  # no factor is known
    if is_best_case:
        action = narrowed_by(results, source) or f"a smaller error of the source '{source}'"
    factors = np.full(np.shape(budget.leakage), factor)
    parts = tuple(
        part.widened(budget.leakage, factors) if part.name == source else part
        for part in budget.parts
    )
    interval = class_interval_of(results.dataset, replace(budget, parts=parts))
    assert interval is not None
    lower, upper = (float(np.abs(end[step])) for end in interval)
    return Narrowing(source, action, lower, upper, is_best_case)


def _larger_patch(results: Results) -> tuple[str, float]:
    """Say how to enlarge the patch, and return the ratio of the enlarged to the present area."""
    if not is_generated(results):
        return _LARGER_PATCH
    attributes = results.dataset.attrs
    # earlier versions stored this attribute under the name tiles_in_place
    is_as_wide_as_seal = bool(attributes.get("tiles_in_order", attributes.get("tiles_in_place")))
    return _LONGER_GENERATED if is_as_wide_as_seal else _LARGER_GENERATED


def _patch_factor(results: Results, step: int, area_ratio: float) -> float:
    """Estimate the factor by which the error from the source "patch" changes if a larger area is measured.

    Let N be the number of blocks that carry the flow through the present surface, and r the ratio of the larger to the
    present area. For the larger area, the number of these blocks is r N. The factor is e(r N)/e(N), where e is the
    function `error_of_few_carriers`. If N is unknown, the factor is 1/√r, as for the mean of independent samples.

    Parameters
    ----------
    results : results of a run.
    step : index of the load step.
    area_ratio : ratio r of the larger area to the present area.
    """
    data = results.dataset
    factor_of_independent_samples = area_ratio**-0.5
    if "state_flow_carriers" not in data:
        return factor_of_independent_samples
    # number N of blocks that carry the flow, in the contact state whose load is nearest to the load of the step
    state_pressures = data["state_nominal_pressure"].values
    distance = np.abs(state_pressures - data["nominal_pressure"].values[step])
    nearest_state = int(np.argmin(distance))
    carriers = float(data["state_flow_carriers"].values[nearest_state])
    if not carriers > 0:
        return factor_of_independent_samples
    present, larger = error_of_few_carriers(np.array([carriers, area_ratio * carriers]))
    return float(larger / present)


def lowering(results: Results, leakage: Array, step: int) -> Lowering:
    """Estimate how a higher load and a smoother surface finish change the leakage at a step on loading.

    Parameters
    ----------
    results : Results
        Results of a run.
    leakage : array
        Class leakage, (step,) [m²/s].
    step : int
        Index of the load step.
    """
    load_slope = _slope_over_load(results, leakage, step)
    height_slope = _slope_over_heights(results, load_slope, step)
    by_load = (1 + LOAD_INCREASE) ** load_slope
    by_finish = HEIGHTS**height_slope
    return Lowering(float(by_load), float(by_finish))


def _slope_over_load(results: Results, leakage: Array, step: int) -> float:
    """Return d ln(leakage)/d ln(load) between a step on loading and the step with the next lower load.

    The slope is NaN if the leakage at one of the two steps is zero or unknown, or if the run has no lower load.
    """
    steps = results.steps
    loading = np.flatnonzero(steps.on_loading)
    before = loading[steps.pressures[loading] < steps.pressures[step]]
    if not before.size:
        return np.nan
    pair = [int(before[-1]), step]  # on loading, the steps are in rising order of load
    pressures = steps.pressures[pair]
    leakages = np.abs(np.asarray(leakage)[pair])
    if not ((pressures > 0) & (leakages > 0) & np.isfinite(leakages)).all():
        return np.nan
    return float(np.diff(np.log(leakages))[0] / np.diff(np.log(pressures))[0])


def _slope_over_heights(results: Results, slope_over_load: float, step: int) -> float:
    """Return d ln(leakage)/d ln(roughness height), for a fluid without slip.

    The slope follows from a scaling law. If all roughness heights are multiplied by a factor `c`, the gap under the
    load F with the hardness H is `c` times the original gap under the load F/c with the hardness H/c. The leakage is
    proportional to the cube of the gap. The slope d ln(leakage)/d ln(roughness height) is therefore 3 − s_load −
    s_hardness, where s_load and s_hardness are the derivatives of ln(leakage) with respect to ln(load) and
    ln(hardness).

    The slope is NaN if the seal has a form deviation or a seat, because their heights do not scale with the roughness.
    The slope is also NaN if the hardness depends on the depth. It is NaN as well if s_hardness is unknown because the
    error budget has no error source "hardness".
    """
    case = results.case
    material: dict[str, Any] = case.get("material") or {}
    has_form = bool(results.dataset.attrs.get("seat")) or bool((case.get("seal") or {}).get("form"))
    if has_form or any(material.get(key) for key in _HARDENING_KEYS):
        return np.nan
    slope_over_hardness = np.nan
    if not np.isfinite(results.dataset.attrs.get("hardness_Pa", np.nan)):
        slope_over_hardness = 0.0  # elastic
    elif results.budget is not None:
        tolerance = material.get("hardness_tolerance") or _HARDNESS_TOLERANCE
        leakage = abs(results.budget.leakage[step])
        for part in results.budget.parts:
            if part.name == "hardness" and leakage > 0:
                # the upper end is the leakage with a hardness that is higher by its tolerance
                change = np.log(abs(part.upper[step]) / leakage)
                slope_over_hardness = change / np.log1p(tolerance)
    return 3.0 - slope_over_hardness - slope_over_load
