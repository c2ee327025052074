"""Estimate errors of the model and its input by solving the scene with another hardness, fluid pressure or form.

Many quantities may be too large or too small; the hardness is an example. The leakage does not change by the same
factor in both directions. The opposite change is therefore solved as well if it matters for the 95 % interval.
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

#: The opposite change is solved where the half-width of the part exceeds this fraction of that of all other parts
#: together. Below it, an end that is twice as far away as its mirror image makes the interval only 9 % longer.
_MATTERS = 0.25


@dataclass(frozen=True, eq=False)
class ModelChange:
    """Describe a change of the model or its input, whose leakage shows how much this change matters.

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
        Change by the same amount in the opposite direction. None if the true value cannot lie on that side.
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
        """Change the seat of a scene: make it deeper by its tolerance, or shallower if the sign is -1."""
        assert self.seat is not None
        below = self.seat.row_depths(scene.surface.shape[0], scene.surface.spacing[0])
        changed = scene.surface.with_form(-sign * self.tolerance * below)
        note = f"change of ln(leakage) with a form of the seat {self.tolerance:.0%} deeper and shallower"
        return ModelChange("form", replace(scene, surface=changed), note, opposite=opposite)

    def of_seal(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """Change the forms of the seal: make them higher by their tolerances, or lower if the sign is -1."""
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
    """List the changes of a scene that represent possible errors of its model and input.

    Parameters
    ----------
    scene : Scene
        Input of the study.
    names : sequence of str
        Names of the error sources that the budget shall contain.
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
    """Estimate the error that a change of the model represents, from the leakage with the change and its opposite.

    Parameters
    ----------
    change : what was changed.
    steps : the load programme.
    leakage : array (steps,), m²/s.
    solution : leakage of the changed scene, compared with that of the scene itself on the same points.
    opposite : the same for the opposite change. Without it that end is the mirror image of the other one.
    """
    note = change.note
    effect = _signed(steps, leakage, solution.change(leakage))
    solutions = [solution]
    if change.opposite is not None:
        if opposite is None:
            opposite_effect = -effect
            note = f"{note}, the latter as the mirror image of the former"
        else:
            opposite_effect = _signed(steps, leakage, opposite.change(leakage))
            solutions.append(opposite)
        both = np.array([effect, opposite_effect])
        # where both changes have the same sign, the smaller one is the distance to the other end
        least = np.abs(both).min(axis=0)
        above = np.maximum(both.max(axis=0), least)
        below = np.maximum(-both.min(axis=0), least)
    else:
        above = np.maximum(effect, 0.0)
        below = np.maximum(-effect, 0.0)
    # a sealed step that the change opens may leak as much as the changed scene does
    opens = np.array([np.isposinf(changed.change(leakage)) for changed in solutions])
    leaks = np.where(opens, [np.abs(changed.leakage) for changed in solutions], 0.0).max(axis=0)
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
    """Return whether the opposite change should be solved, because this error is large compared with all others.

    others : the error budget without this error source.
    """
    steps = counting_steps(others)
    alone = ErrorBudget(others.method, others.leakage, (part,))
    width = np.asarray(alone.half_width())[steps]
    rest = np.asarray(others.half_width())[steps]
    return bool(np.any(width > _MATTERS * rest))


def _signed(steps: LoadProgramme, leakage: Array, moved: Array) -> Array:
    """Replace unknown changes of ln(leakage) (steps,) by changes as large as those of the nearest steps.

    It is −inf where the changed scene is sealed.
    """
    slope = np.maximum(load_sensitivity(steps, leakage), LEAST_SLOPE)
    finite = np.isfinite(moved)
    near = scale_of_changes(steps, moved, slope)
    sign = 1.0 if float(moved[finite].sum()) >= 0 else -1.0
    return np.where(finite | np.isneginf(moved), moved, sign * near)
