"""Errors of the model and its input that a changed scene shows: hardness, an ignored fluid pressure, the form.

A change that may go either way has an opposite, such as less hardness beside more. Leakage does not change alike on
both sides, so the opposite is solved as well wherever it matters for the whole interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base import Array
from ..loads import LoadProgramme, load_sensitivity
from ..seal.form import ScaledForm, SealForm
from ..studies import Scene
from ..topography.seat import Seat
from .error_parts import (
    LEAST_SLOPE,
    MODEL_PARTS,
    CoarserSolution,
    ErrorBudget,
    ErrorPart,
    counting_steps,
    part_of_changes,
    scale_of_changes,
)

#: Half-width of a part by one of two opposite changes, over that of all other parts together, from which on the other
#: change is solved as well. Below, a side that is twice as long as its mirror image makes the interval 9 % longer.
_MATTERS = 0.25


@dataclass(frozen=True, eq=False)
class ModelChange:
    """A scene with another model or input, whose leakage shows how much that matters.

    name : of the part, one of `MODEL_PARTS`. scene : the changed one. note : a sentence.
    forms : the changed forms of a seal that has any, see `Sampling`.
    opposite : the change by as much to the other side; None where the truth cannot lie there.
    """

    name: str
    scene: Scene
    note: str
    forms: tuple[SealForm, ...] = ()
    opposite: ModelChange | None = None


@dataclass(frozen=True)
class FormTolerance:
    """Relative errors of the heights of forms.

    forms : of the seal, see `Sampling`. tolerances : of each. seat : a form that is on the heights of the face instead,
    which is as broad as the seal; None where there is none. tolerance : of that.
    """

    forms: tuple[SealForm, ...] = ()
    tolerances: tuple[float, ...] = ()
    seat: Seat | None = None
    tolerance: float = 0.0

    def on_seat(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """The scene with a seat that is deeper by its tolerance, or shallower where the sign is -1."""
        assert self.seat is not None
        below = self.seat.rows_below(scene.surface.shape[0], scene.surface.spacing[0])
        changed = scene.surface.with_form(-sign * self.tolerance * below)
        note = f"change of ln(leakage) with a form of the seat {self.tolerance:.0%} deeper and shallower"
        return ModelChange("form", replace(scene, surface=changed), note, opposite=opposite)

    def of_seal(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """The scene under forms that are higher by their tolerances, or lower where the sign is -1."""
        forms = tuple(
            ScaledForm(form, 1 + sign * tolerance)
            for form, tolerance in zip(self.forms, self.tolerances, strict=True)
        )
        note = f"change of ln(leakage) with a form of the seal up to {max(self.tolerances):.0%} higher and lower"
        return ModelChange("form", scene, note, forms, opposite)


def model_changes(
    scene: Scene,
    names: Sequence[str] = MODEL_PARTS,
    hardness: float = 0.1,
    form: FormTolerance | None = None,
) -> list[ModelChange]:
    """List the changes of a scene that its model and its input may be wrong by.

    names : of the parts that are wanted. hardness : relative error of the hardness. form : errors of
    the forms of seal and seat.
    """
    found = []
    if "hardness" in names and hardness > 0 and not scene.law.is_elastic:
        note = f"change of ln(leakage) with {hardness:.0%} more and less hardness"
        softer = replace(scene, hardness=scene.law.times(1 - hardness))
        harder = replace(scene, hardness=scene.law.times(1 + hardness))
        opposite = ModelChange("hardness", softer, note)
        found.append(ModelChange("hardness", harder, note, opposite=opposite))
    acting = replace(scene, fluid_pressure="acts")
    if "fluid pressure" in names and scene.is_dry and acting.acting_fluid is not None:
        note = (
            "change of ln(leakage) if the fluid pressure, which is ignored, presses the faces apart"
        )
        found.append(ModelChange("fluid pressure", acting, note))
    if form is None or "form" not in names:
        return found
    if form.seat is not None and form.tolerance > 0:
        found.append(form.on_seat(scene, 1, form.on_seat(scene, -1, None)))
    elif any(form.tolerances):
        found.append(form.of_seal(scene, 1, form.of_seal(scene, -1, None)))
    return found


def model_part(
    change: ModelChange,
    steps: LoadProgramme,
    leakage: Array,
    solution: CoarserSolution,
    opposite: CoarserSolution | None = None,
) -> ErrorPart:
    """Estimate the part of a change of the model, on both sides where it has an opposite.

    solution : leakage of the changed scene against that of the scene itself, both on the same points.
    opposite : the same of the opposite change; without it that side is the mirror image of the other one.
    """
    note = change.note
    sides = _signed(steps, leakage, solution.change(leakage))
    solutions = [solution]
    if change.opposite is not None:
        if opposite is None:
            other = -sides
            note = f"{note}, the latter as the mirror image of the former"
        else:
            other = _signed(steps, leakage, opposite.change(leakage))
            solutions.append(opposite)
        both = np.array([sides, other])
        # where both changes go one way, the lesser one tells how far the other way may be
        least = np.abs(both).min(axis=0)
        above = np.maximum(both.max(axis=0), least)
        below = np.maximum(-both.min(axis=0), least)
    else:
        above = np.maximum(sides, 0.0)
        below = np.maximum(-sides, 0.0)
    # what is sealed and opens by a change leaks as much as the changed scene does
    opens = np.array([np.isposinf(one.change(leakage)) for one in solutions])
    leaks = np.where(opens, [np.abs(one.leakage) for one in solutions], 0.0).max(axis=0)
    return part_of_changes(
        change.name,
        steps,
        leakage,
        below,
        above,
        note,
        change=np.where(opens.any(axis=0), np.inf, 0.0),
        coarse=CoarserSolution(solution.points, leaks),
    )


def opposite_matters(part: ErrorPart, others: ErrorBudget) -> bool:
    """Whether the mirror image of one side is too much of an estimate for a part, at any load that counts.

    others : the budget without the part.
    """
    steps = counting_steps(others)
    alone = ErrorBudget(others.method, others.leakage, (part,))
    width = np.asarray(alone.half_width())[steps]
    rest = np.asarray(others.half_width())[steps]
    return bool(np.any(width > _MATTERS * rest))


def _signed(steps: LoadProgramme, leakage: Array, moved: Array) -> Array:
    """Changes of ln(leakage) (steps,), those that are unknown as large as those of the nearest steps.

    -inf where the changed scene is sealed.
    """
    slope = np.maximum(load_sensitivity(steps, leakage), LEAST_SLOPE)
    finite = np.isfinite(moved)
    near = scale_of_changes(steps, moved, slope)
    sign = 1.0 if float(moved[finite].sum()) >= 0 else -1.0
    return np.where(finite | np.isneginf(moved), moved, sign * near)
