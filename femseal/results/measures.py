"""Estimate what would narrow the interval of a leakage most, and what would lower the leakage.

The effect of a smaller source of error follows from the error budget: the other sources stay, and the distances of this
one to both ends are multiplied by a factor. The effect of a higher load follows from the loading curve, and that of a
smoother finish from the scaling law of contact and flow (see `designs.sensitivities`) with the slope that the row
"hardness" of the budget has. Nothing is solved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array
from ..budget import ErrorBudget
from ..budget.error_parts import ORDER
from ..studies.drawn_error import DIFFICULTY
from ..studies.patch_state import PatchState
from .best_leakage import class_interval_of
from .results import Results

#: What reduces each source of error, by its name in the error budget.
NARROWED_BY = {
    "blocks": "larger blocks",
    "continuation": "an instrument that sees shorter waves",
    "effective pressure": "a smaller pressure of the fluid",
    "fluid pressure": 'fluid_pressure = "acts" in [contact]',
    "filter": "a shorter surface.shortest_wave, as far as the waves were measured",
    "form": "a form that is known more exactly, and a smaller tolerance with it",
    "form of the patch": "surface.detrend, which says whether the curvature belongs to the seal",
    "hardness": "a measured hardness, and a smaller hardness_tolerance with it",
    "longer waves": "a larger measured area, or the flatness of the seal in [seal]",
    "patch": "a larger measured area, or a second measured patch",
    "pixels": "more surface.points",
    "patches": "more measured patches",
    "realisations": "more realisations in [stochastic]",
    "solver": "a smaller contact.rtol",
    "thin gap": "a smoother face: its gap is not thin against its waves",
}
#: The same for a generated surface, which can be made in any size.
NARROWED_IF_GENERATED = {
    "patch": "a larger generated surface",
    "longer waves": "a larger generated surface",
}
#: A definite step that makes each source smaller, and the factor on its distances of ln(leakage).
_STEPS = {
    "pixels": ("twice the points along each side", 2.0**-ORDER),
    "realisations": ("four times as many realisations in [stochastic]", 0.5),
    "solver": ("a tenth of contact.rtol", 0.1),
    "hardness": ("half the tolerance of the hardness, by measuring it", 0.5),
    "form": ("half the tolerance of the form, by measuring it", 0.5),
    "patches": ("four times as many measured patches", 0.5),
}
#: The same for the patch, with the area over that of the case; the factor follows from the contact state.
_LARGER_PATCH = ("a measured area four times as large", 4.0)
_LARGER_GENERATED = ("a generated surface with twice the length along each side", 4.0)
#: The same where the surface is as broad as the seal, so that more breadth is of no use.
_LONGER_GENERATED = ("a generated surface four times as long along x2", 4.0)
#: Relative increase of the load, and heights over those of the case, whose effects are stated.
LOAD_INCREASE, HEIGHTS = 0.1, 0.8
#: Relative error of the hardness unless the case says another one.
_HARDNESS_TOLERANCE = 0.1
#: Keys of a material whose hardness depends on the depth of the deformation.
_HARDENING_KEYS = ("hardening", "nix_gao_depth", "hardness_table")


@dataclass(frozen=True)
class Narrowing:
    """A step that makes the interval of a leakage narrower.

    Attributes
    ----------
    source : str
        Source of error that it makes smaller.
    action : str
        What to do.
    lower, upper : float
        Ends of the interval afterwards [m²/s].
    is_best_case : bool
        Whether the source would have to vanish for these ends, because its decrease is not known.
    """

    source: str
    action: str
    lower: float
    upper: float
    is_best_case: bool


@dataclass(frozen=True)
class Lowering:
    """What lowers a leakage: the factor on it by a higher load, and by a smoother finish; NaN if unknown.

    Attributes
    ----------
    by_load : float
        With a load that is higher by `LOAD_INCREASE`.
    by_finish : float
        With heights of the roughness of `HEIGHTS` times those of the case.
    """

    by_load: float
    by_finish: float


def narrowed_by(results: Results, source: str) -> str:
    """Return what reduces a source of error, "" if nothing is known."""
    if is_generated(results) and source in NARROWED_IF_GENERATED:
        return NARROWED_IF_GENERATED[source]
    return NARROWED_BY.get(source, "")


def is_generated(results: Results) -> bool:
    """Return whether all faces of a run are generated."""
    faces = results.case.get("face") or {}
    tables = faces if isinstance(faces, list) else [faces]
    return bool(faces) and all(table.get("kind", "file") != "file" for table in tables)


def best_narrowing(results: Results, step: int) -> Narrowing | None:
    """Find what narrows the interval at a load most: the widest source of error there, made smaller.

    Parameters
    ----------
    results : Results
        The run.
    step : int
        Number of the load step.

    Returns
    -------
    Narrowing or None
        None without an error budget, or if the seal is sealed at this load: then only its upper end is known.
    """
    budget = results.budget
    if budget is None or not budget.parts or not np.abs(budget.leakage[step]) > 0:
        return None
    return _narrowing(results, budget, budget.limiting(step), step)


def _narrowing(results: Results, budget: ErrorBudget, source: str, step: int) -> Narrowing:
    """Estimate the interval at a load if one source is made smaller."""
    action, factor = _STEPS.get(source, ("", 0.0))
    if source == "patch":
        action, area = _larger_patch(results)
        factor = _patch_factor(results, step, area)
    is_best_case = not action
    if is_best_case:
        action = narrowed_by(results, source) or f"a smaller error of the source '{source}'"
    factors = np.full(np.shape(budget.leakage), factor)
    parts = tuple(
        part.widened(budget.leakage, factors) if part.name == source else part
        for part in budget.parts
    )
    ends = class_interval_of(results.dataset, replace(budget, parts=parts))
    assert ends is not None
    lower, upper = (float(np.abs(end[step])) for end in ends)
    return Narrowing(source, action, lower, upper, is_best_case)


def _larger_patch(results: Results) -> tuple[str, float]:
    """Return how to make the patch larger, and its area over that of the run."""
    if not is_generated(results):
        return _LARGER_PATCH
    is_as_broad = bool(results.dataset.attrs.get("tiles_in_place"))
    return _LONGER_GENERATED if is_as_broad else _LARGER_GENERATED


def _patch_factor(results: Results, step: int, area: float) -> float:
    """Return the distances of the source "patch" with a larger area over those of the run, by its contact state.

    A larger area has more blocks that carry the flow; contact fraction and detours stay what they are. Without a known
    contact state the factor is what many carriers would have, the root of the larger area.
    """
    data = results.dataset
    independent = area**-0.5
    if "state_flow_carriers" not in data:
        return independent
    pressures = data["state_nominal_pressure"].values
    nearest = int(np.argmin(np.abs(pressures - data["nominal_pressure"].values[step])))
    carriers = float(data["state_flow_carriers"].values[nearest])
    if not carriers > 0:
        return independent
    with_both = PatchState(
        carriers=np.array([carriers, area * carriers]),
        contact_fraction=np.zeros(2),
        detours=np.zeros(2),
        open_leakage=np.ones(2),
    )
    # both kinds of order depend on the number of carriers in the same way
    below, _above = DIFFICULTY["in order"].distances(with_both)
    return float(below[1] / below[0])


def lowering(results: Results, leakage: Array, step: int) -> Lowering:
    """Estimate what a higher load and a smoother finish do to the leakage at a load of the loading.

    Parameters
    ----------
    results : Results
        The run.
    leakage : array
        Leakage that decides on classes (step,) [m²/s].
    step : int
        Number of the load step.
    """
    slope = _slope_over_load(results, leakage, step)
    by_load = (1 + LOAD_INCREASE) ** slope
    by_finish = HEIGHTS ** _slope_over_heights(results, slope, step)
    return Lowering(float(by_load), float(by_finish))


def _slope_over_load(results: Results, leakage: Array, step: int) -> float:
    """Return d ln L/d ln p below a load on loading; NaN if either leakage is 0 or unknown."""
    steps = results.steps
    loading = np.flatnonzero(steps.on_loading)
    before = loading[steps.pressures[loading] < steps.pressures[step]]
    if not before.size:
        return np.nan
    pair = [int(before[-1]), step]
    pressures, leakages = steps.pressures[pair], np.abs(np.asarray(leakage)[pair])
    if not ((pressures > 0) & (leakages > 0) & np.isfinite(leakages)).all():
        return np.nan
    return float(np.diff(np.log(leakages))[0] / np.diff(np.log(pressures))[0])


def _slope_over_heights(results: Results, slope_over_load: float, step: int) -> float:
    """Return d ln L/d ln a of the heights a of the roughness, by the scaling law for a fluid without slip.

    It is NaN for a seal whose form does not scale with the roughness, for a hardness that depends on the depth, and
    without the row "hardness" of the error budget.
    """
    case = results.case
    material: dict[str, Any] = case.get("material") or {}
    has_form = bool(results.dataset.attrs.get("seat")) or bool((case.get("seal") or {}).get("form"))
    if has_form or any(material.get(key) for key in _HARDENING_KEYS):
        return np.nan
    slope_over_hardness = np.nan
    if not np.isfinite(results.dataset.attrs.get("hardness_Pa", np.nan)):
        slope_over_hardness = 0.0
    elif results.budget is not None:
        tolerance = material.get("hardness_tolerance") or _HARDNESS_TOLERANCE
        leakage = abs(results.budget.leakage[step])
        for part in results.budget.parts:
            if part.name == "hardness" and leakage > 0:
                slope_over_hardness = np.log(abs(part.upper[step]) / leakage) / np.log1p(tolerance)
    return 3.0 - slope_over_hardness - slope_over_load
