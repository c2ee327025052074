"""Parts of the budget for what a method leaves out of a face, by the calibration set, and for what the model does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..loads import LoadProgramme
from ..studies import Scene, StochasticResult, TwoScaleResult
from ..studies.scene import Array
from ..topography.seat import ScaledSeat, Seat
from .changes import LEAST_SLOPE, CoarserSolution, load_sensitivity, on_all_steps, part_of_changes, scale_of_changes
from .conformal import calibration, decades, model_error
from .error_parts import MODEL_PARTS, ErrorPart


def two_scales_parts(study: TwoScaleResult, compared: CoarserSolution | None = None) -> list[ErrorPart]:
    """Flow through links, and contact solved in windows; none of contact and flow of the whole face.

    Parameters
    ----------
    compared : leakage of the whole face on fewer points against that of the study's own method there.
    """
    q, parts = study.leakage, []
    if study.flow == "links" and compared is not None:
        difference = np.abs(on_all_steps(study.steps, compared, q))
        text = f"flow through links against that of the whole face on {' × '.join(map(str, compared.points))} points"
        features = {"difference": difference, "slope": load_sensitivity(study.steps, q)}
        parts.append(_part("two scales", study, q, text, "compared links", **features))
    elif study.flow == "links":
        features = {"contact": study.contact_fraction.mean(axis=(1, 2)), "decades": decades(q)}
        parts.append(
            _part("two scales", study, q, "flow through links against that of the whole face", "links", **features)
        )
    if study.contact == "windows":
        with np.errstate(divide="ignore"):
            features = {"gap_error": study.gap_error, "effect": np.abs(np.log(study.gap_effect))}
        parts.append(
            _part("windows", study, q, "contact in windows against that of the whole face", "windows", **features)
        )
    return parts


@dataclass(frozen=True, eq=False)
class ModelChange:
    """A scene with another model or input, whose leakage shows how much that matters.

    name : of the part, one of `MODEL_PARTS`. scene : the changed one. both : whether the truth may lie on the other
    side as well. note : a sentence. seat : the changed form of a seat that is broader than the face, else None.
    """

    name: str
    scene: Scene
    both: bool
    note: str
    seat: Seat | None = None


@dataclass(frozen=True)
class FormTolerance:
    """Relative error of the depth of a form, which is on the heights of the face unless that is narrower."""

    seat: Seat
    tolerance: float
    on_heights: bool


def model_changes(
    scene: Scene, names: Sequence[str] = MODEL_PARTS, hardness: float = 0.1, form: FormTolerance | None = None
) -> list[ModelChange]:
    """Changes of a scene that its model and its input may be wrong by.

    names : of the parts that are wanted. hardness : relative error of the hardness. form : of the seat, if it has one.
    """
    found = []
    if "hardness" in names and hardness > 0 and not scene.law.is_elastic:
        harder = replace(scene, hardness=scene.law.times(1 + hardness))
        note = f"change of ln(leakage) with {hardness:.0%} more hardness, on either side"
        found.append(ModelChange("hardness", harder, True, note))
    acting = replace(scene, fluid_pressure="acts")
    if "fluid pressure" in names and scene.fluid_pressure == "ignored" and acting.acting_fluid is not None:
        note = "change of ln(leakage) if the fluid pressure, which is ignored, presses the faces apart"
        found.append(ModelChange("fluid pressure", acting, False, note))
    if "form" in names and form is not None and form.tolerance > 0:
        note = f"change of ln(leakage) with a form of the seat {form.tolerance:.0%} deeper, on either side"
        surface, seat = scene.surface, ScaledSeat(form.seat, 1 + form.tolerance)
        if form.on_heights:
            deeper = ScaledSeat(form.seat, form.tolerance).on(surface)
            found.append(ModelChange("form", replace(scene, surface=deeper), True, note))
        else:
            found.append(ModelChange("form", scene, True, note, seat))
    return found


def model_part(change: ModelChange, steps: LoadProgramme, leakage: Array, solution: CoarserSolution) -> ErrorPart:
    """Part of a change of the model.

    solution : leakage of the changed scene against that of the scene itself, both on the same points.
    """
    moved = on_all_steps(steps, solution, leakage)
    slope = np.maximum(load_sensitivity(steps, leakage), LEAST_SLOPE)
    # beside a sealed step the nearest ones tell
    near = scale_of_changes(steps, moved, slope, [steps.index(step) for step in solution.steps])
    size = np.where(np.isfinite(moved), np.abs(moved), near)
    rises = float(np.nansum(np.where(np.isfinite(moved), moved, 0.0))) >= 0
    below, above = size * (change.both or not rises), size * (change.both or rises)
    if change.both:
        moved = np.abs(moved)
    return part_of_changes(
        change.name, steps, leakage, below, above, change.note, change=np.nan_to_num(moved, nan=0.0, posinf=np.inf)
    )


def effective_pressure_part(scene: Scene, study: Any) -> ErrorPart | None:
    """What windows under their effective pressure, or an even potential, differ by from the coupled face.

    Measured on seven faces four long waves broad, p_in/p̄ .1 to 1: drawn windows leak at most by half of what the fluid
    does to ln(leakage) too much, and by a fifth too little, less on broader seals. So do windows under a potential that
    falls evenly, at 93 of 100 loads of 36 faces of six kinds. None of other studies.
    """
    fluid = scene.acting_fluid
    drawn = isinstance(study, StochasticResult)
    if drawn:
        chosen = study.pressure != "place"
        note = "windows under their effective pressure against a coupled face, measured on faces four waves broad"
    else:
        chosen = isinstance(study, TwoScaleResult) and study.contact == "windows"
        note = "contact of windows under a fluid whose potential falls evenly, measured against that of the flow"
    if fluid is None or not chosen:
        return None
    q = study.quantile(0.5) if drawn else study.leakage
    loads = np.maximum(study.steps.pressures, abs(fluid.carried))
    effect = load_sensitivity(study.steps, q) * np.abs(fluid.carried) / np.where(loads > 0, loads, 1.0)
    return part_of_changes("effective pressure", study.steps, q, 0.5 * effect, 0.2 * effect, note)


def sampler_part(scene: Scene, study: StochasticResult) -> ErrorPart:
    """Seals drawn from a face, against a face of their length: what library and realisations leave over."""
    kind = study.pressure if study.pressure != "place" else "runs" if study.sampler == "runs" else "block"
    q = study.quantile(0.5)
    return _part(
        "sampler",
        study,
        q,
        f"seals drawn by '{kind}' against long faces",
        kind,
        decades=decades(q),
        scatter=scatter_of(study),
    )


def scatter_of(study: StochasticResult) -> Array:
    """Standard deviation of ln(leakage) of drawn seals (steps,), by library and realisations; 0 where none leaks."""
    return np.hypot(np.nan_to_num(study.library_error), np.nan_to_num(study.realisation_spread))


def _part(
    name: str, study: TwoScaleResult | StochasticResult, q: Array, what: str, kind: str, **features: Any
) -> ErrorPart:
    """A part with the same distance on both sides, by the scenes of a kind in the calibration set."""
    distance = model_error(kind, **features)
    note = f"{what}: by split conformal prediction from {calibration()[kind].scenes} scenes"
    return part_of_changes(name, study.steps, q, distance, distance, note)
