"""Estimate errors of the model and its input by solving the scene with another hardness, fluid pressure or form.

An uncertain quantity, such as the hardness, may be too large or too small. If it is increased and reduced by the same
amount, the leakage does not change by the same factor. Therefore, the opposite change is solved as well if it matters
for the 95 % interval.
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

#: The opposite change is solved if the half-width of this error source is above this fraction of the half-width of all
#: others together. Below this fraction, the interval would only be 9 % longer if the opposite change were twice as
#: large as assumed.
_MATTERS = 0.25


@dataclass(frozen=True, eq=False)
class ModelChange:
    """Describe a change of the model or its input. The changed leakage shows how much an error of this kind matters.

    Parameters
    ----------
    name : str
        Name of the error source, one of `MODEL_PARTS`.
    scene : Scene
        Scene with the change.
    note : str
        Sentence that says what was changed.
    forms : tuple of forms
        Changed forms of the seal, see `Sampling`; empty for a seal without form.
    opposite : ModelChange, optional
        Change by the same amount in the opposite direction. None if the model can only be wrong in one direction.
    """

    name: str
    scene: Scene
    note: str
    forms: tuple[SealForm, ...] = ()
    opposite: ModelChange | None = None


@dataclass(frozen=True)
class FormTolerance:
    """Hold the relative errors of the heights of all forms.

    Parameters
    ----------
    forms : tuple of forms
        Forms of the seal, see `Sampling`.
    tolerances : tuple of float
        Relative error of the height of each form.
    seat : optional
        Nominal form that was added to the heights of the surface, which is then as broad as the seal.
    tolerance : float
        Relative error of the height of the seat.
    """

    forms: tuple[SealForm, ...] = ()
    tolerances: tuple[float, ...] = ()
    seat: Seat | None = None
    tolerance: float = 0.0

    def on_seat(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """Make the seat of a scene deeper by its tolerance (sign 1), or shallower (sign −1)."""
        assert self.seat is not None
        below = self.seat.row_depths(scene.surface.shape[0], scene.surface.spacing[0])
        changed = scene.surface.with_form(-sign * self.tolerance * below)
        note = f"change of ln(leakage) with a form of the seat {self.tolerance:.0%} deeper and shallower"
        return ModelChange("form", replace(scene, surface=changed), note, opposite=opposite)

    def of_seal(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """Make the forms of the seal higher by their tolerances (sign 1), or lower (sign −1)."""
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
    """List the changes of a scene that correspond to possible errors of its model and input.

    Parameters
    ----------
    scene : Scene
        Input of the study.
    names : sequence of str
        Names of the error sources that the budget is to contain.
    hardness : float
        Relative error of the hardness.
    form : FormTolerance, optional
        Errors of the forms of the seal and of the seat.
    """
    changes = []
    if "hardness" in names and hardness > 0 and not scene.law.is_elastic:
        note = f"change of ln(leakage) with {hardness:.0%} more and less hardness"
        softer = replace(scene, hardness=scene.law.times(1 - hardness))
        harder = replace(scene, hardness=scene.law.times(1 + hardness))
        opposite = ModelChange("hardness", softer, note)
        changes.append(ModelChange("hardness", harder, note, opposite=opposite))
    acting = replace(scene, fluid_pressure="acts")
    if "fluid pressure" in names and scene.is_dry and acting.acting_fluid is not None:
        note = (
            "change of ln(leakage) if the fluid pressure, which is ignored, presses the faces apart"
        )
        changes.append(ModelChange("fluid pressure", acting, note))
    if form is None or "form" not in names:
        return changes
    if form.seat is not None and form.tolerance > 0:
        changes.append(form.on_seat(scene, 1, form.on_seat(scene, -1, None)))
    elif any(form.tolerances):
        changes.append(form.of_seal(scene, 1, form.of_seal(scene, -1, None)))
    return changes


def model_part(
    change: ModelChange,
    steps: LoadProgramme,
    leakage: Array,
    solution: CoarserSolution,
    opposite: CoarserSolution | None = None,
) -> ErrorPart:
    """Estimate the error of an assumption of the model, from the leakage with a changed assumption.

    The interval reaches from ln(leakage) to its changed value, and also to its value with the opposite change.

    Parameters
    ----------
    change : change of the model.
    steps : the load programme.
    leakage : array (steps,), m²/s.
    solution : leakage of the changed scene, to be compared with the unchanged scene on the same grid.
    opposite : leakage with the opposite change. Without it, ln(leakage) is assumed to change by the same amount in the
        opposite direction.
    """
    note = change.note
    effect = _fill_unknown(steps, leakage, solution.change(leakage))  # change of ln(leakage)
    solutions = [solution]
    if change.opposite is None:
        above = np.maximum(effect, 0.0)
        below = np.maximum(-effect, 0.0)
    else:
        if opposite is None:
            opposite_effect = -effect
            note = f"{note}, the latter as the mirror image of the former"
        else:
            opposite_effect = _fill_unknown(steps, leakage, opposite.change(leakage))
            solutions.append(opposite)
        effects = np.array([effect, opposite_effect])  # (direction, step)
        # If both effects have the same sign, one end of the interval would be at the leakage itself. The distance to
        # this end is then the smaller effect.
        smaller = np.abs(effects).min(axis=0)
        above = np.maximum(effects.max(axis=0), smaller)
        below = np.maximum(-effects.min(axis=0), smaller)
    # If a change opens the seal at a sealed step, the upper end is the leakage with this change.
    opens = np.array([np.isposinf(changed.change(leakage)) for changed in solutions])
    leakages = np.array([np.abs(changed.leakage) for changed in solutions])  # (direction, step)
    leakage_if_open = np.where(opens, leakages, 0.0).max(axis=0)
    return part_of_changes(
        change.name,
        steps,
        leakage,
        below,
        above,
        note,
        change=np.where(opens.any(axis=0), np.inf, 0.0),
        coarse=CoarserSolution(solution.points, leakage_if_open),
    )


def opposite_matters(part: ErrorPart, others: ErrorBudget) -> bool:
    """Return whether the opposite change should be solved, see `_MATTERS`.

    It is not solved if the error of this change is small compared with all other errors.

    part : error source, in which the opposite change is assumed but not solved.
    others : error budget without this error source.
    """
    steps = counting_steps(others)
    alone = ErrorBudget(others.method, others.leakage, (part,))
    width = np.asarray(alone.half_width())[steps]
    width_of_others = np.asarray(others.half_width())[steps]
    return bool(np.any(width > _MATTERS * width_of_others))


def _fill_unknown(steps: LoadProgramme, leakage: Array, change: Array) -> Array:
    """Replace unknown and infinite changes of ln(leakage) (steps,) by estimates from the nearest known changes.

    A change of −inf is not replaced, because it means that the changed scene is sealed.
    """
    slope = np.maximum(load_sensitivity(steps, leakage), LEAST_SLOPE)
    finite = np.isfinite(change)
    size_nearby = scale_of_changes(steps, change, slope)
    # all estimates get the sign of the sum of the known changes
    sign = 1.0 if float(change[finite].sum()) >= 0 else -1.0
    return np.where(finite | np.isneginf(change), change, sign * size_nearby)
