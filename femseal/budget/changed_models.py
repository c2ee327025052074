"""Estimate the errors due to an uncertain hardness, fluid pressure or form deviation, by changing the input.

An uncertain quantity, such as the hardness, may be too large or too small. A solution with an increased quantity does
not show how the leakage changes if the quantity is reduced. If the error matters for the 95 % interval, the input is
therefore solved twice, with an increased and with a reduced value.
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
from .error_parts import ErrorBudget, ErrorPart
from .leakage_changes import LEAST_LOAD_SLOPE, CoarserSolution, part_of_changes, scale_of_changes
from .wide_intervals import counting_steps

#: The change in the opposite direction is solved if the half-width of the error source is above this fraction of the
#: half-width of all other error sources together. Below this fraction, one end of the interval would be at most 9 %
#: farther from ln(leakage) if the opposite change of ln(leakage) were twice as large as assumed.
_MATTERS = 0.25


@dataclass(frozen=True, eq=False)
class ModelChange:
    """Describe a change of the model or its input. Its effect on the leakage shows how much an error matters.

    Parameters
    ----------
    name : str
        Name of the error source.
    scene : Scene
        Input of the studies, with the change.
    note : str
        Sentence that says what was changed.
    forms : tuple of forms
        Changed form deviations of the seal, see `Sampling`; empty for a nominally flat seal.
    opposite : ModelChange, optional
        Change of the quantity by the same amount in the opposite direction; None if the quantity can only be wrong in
        one direction.
    """

    name: str
    scene: Scene
    note: str
    forms: tuple[SealForm, ...] = ()
    opposite: ModelChange | None = None


@dataclass(frozen=True)
class FormTolerance:
    """Form deviations of a seal and the shape of its seat, with the relative errors of their heights.

    Parameters
    ----------
    forms : tuple of SealForm
        Form deviations of the seal, see `Sampling`.
    tolerances : tuple of float
        Relative error of the height of each form deviation.
    seat : Seat, optional
        Nominal shape of the seat. The shape was added to the heights of the surface, which is as wide as the seal.
    tolerance : float
        Relative error of the height of the seat.
    """

    forms: tuple[SealForm, ...] = ()
    tolerances: tuple[float, ...] = ()
    seat: Seat | None = None
    tolerance: float = 0.0

    def on_seat(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """Return the change in which the seat is deeper (sign 1) or shallower (sign −1) by its tolerance."""
        assert self.seat is not None
        below = self.seat.row_depths(scene.surface.shape[0], scene.surface.spacing[0])
        changed = scene.surface.with_form(-sign * self.tolerance * below)
        note = f"change of ln(leakage) with a form of the seat {self.tolerance:.0%} deeper and shallower"
        return ModelChange("form", replace(scene, surface=changed), note, opposite=opposite)

    def of_seal(self, scene: Scene, sign: int, opposite: ModelChange | None) -> ModelChange:
        """Return the change in which the form deviations are higher (sign 1) or lower (sign −1) by their tolerances."""
        forms = tuple(
            ScaledForm(form, 1 + sign * tolerance)
            for form, tolerance in zip(self.forms, self.tolerances, strict=True)
        )
        note = f"change of ln(leakage) with a form of the seal up to {max(self.tolerances):.0%} higher and lower"
        return ModelChange("form", scene, note, forms, opposite)


def model_changes(
    scene: Scene,
    names: Sequence[str] | None = None,
    hardness: float = 0.1,
    form: FormTolerance | None = None,
) -> list[ModelChange]:
    """List changes of the input that represent possible errors of the model and of the input itself.

    Parameters
    ----------
    scene : Scene
        Input of the study.
    names : sequence of str, optional
        Names of the error sources that the budget is to contain; by default all of them.
    hardness : float
        Relative error of the hardness.
    form : FormTolerance, optional
        Errors of the form deviations of the seal and of the shape of the seat.
    """

    def is_wanted(name: str) -> bool:
        return names is None or name in names

    changes = []
    if is_wanted("hardness") and hardness > 0 and not scene.law.is_elastic:
        note = f"change of ln(leakage) with {hardness:.0%} more and less hardness"
        softer = replace(scene, hardness=scene.law.times(1 - hardness))
        harder = replace(scene, hardness=scene.law.times(1 + hardness))
        opposite = ModelChange("hardness", softer, note)
        changes.append(ModelChange("hardness", harder, note, opposite=opposite))
    acting = replace(scene, fluid_pressure="acts")
    if is_wanted("fluid pressure") and scene.is_dry and acting.acting_fluid is not None:
        note = (
            "change of ln(leakage) if the fluid pressure, which is ignored, presses the faces apart"
        )
        changes.append(ModelChange("fluid pressure", acting, note))
    if form is None or not is_wanted("form"):
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
    """Estimate the error caused by an uncertain quantity from the leakage with a changed value of this quantity.

    Let e and e' be the changes of ln(leakage) that are caused by the change of the quantity and by the opposite change.
    The interval of ln(leakage) reaches from ln(leakage) + min(e, e') to ln(leakage) + max(e, e'). If e and e' have the
    same sign, the interval is extended to the other side by the smaller of |e| and |e'|. If an opposite change is
    impossible, only e is used, and one end of the interval is ln(leakage).

    Parameters
    ----------
    change : change of the model or its input.
    steps : the load programme.
    leakage : array (steps,), m²/s.
    solution : leakage with the change; its `reference` is the leakage without the change, solved on an equal grid.
    opposite : leakage with the opposite change. If `opposite` is None, the opposite change of the quantity is assumed
        to change ln(leakage) by the opposite amount.
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
        # if both effects have the same sign, one of the two distances would be 0 without `smaller`
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
    """Return whether the leakage with the opposite change should be solved, see `_MATTERS`.

    The leakage with the opposite change is not solved if the error source is small compared with all other errors.

    part : error source that was estimated from the change in one direction only.
    others : error budget of all other error sources.
    """
    steps = counting_steps(others)
    alone = ErrorBudget(others.method, others.leakage, (part,))
    width = np.asarray(alone.half_width())[steps]
    width_of_others = np.asarray(others.half_width())[steps]
    return bool(np.any(width > _MATTERS * width_of_others))


def _fill_unknown(steps: LoadProgramme, leakage: Array, change: Array) -> Array:
    """Replace unknown and infinite changes of ln(leakage) (steps,) by estimates from the nearest known changes.

    A change of −inf means that the seal is sealed with the changed input, and is not replaced.
    """
    slope = np.maximum(load_sensitivity(steps, leakage), LEAST_LOAD_SLOPE)
    finite = np.isfinite(change)
    size_nearby = scale_of_changes(steps, change, slope)
    # all estimates get the sign of the sum of the known changes
    sign = 1.0 if float(change[finite].sum()) >= 0 else -1.0
    return np.where(finite | np.isneginf(change), change, sign * size_nearby)
