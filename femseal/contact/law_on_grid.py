"""Define what the active-set iteration needs to know of the contact law of a grid.

`StraightLaw` is a linear law, which remains the same. `curve_tangents.CurveTangents` replaces a curved law by tangents,
which change from iteration to iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple, Protocol

from .workspace import Loops


class ActiveSets(NamedTuple):
    """The present active sets: result of the first part of an iteration of `active_sets.solve_active_sets`.

    n_near : number of points near contact. A point is near contact if it is in contact or if v is below `reach`.
    n_free : number of free points. The pressure of a free point is unknown.
    reach : value of v [m] below which a point is listed as near contact.
    margin : `reach` minus the approach δ at the time the lists were made [m].
    energy : energy when the sets were chosen; infinite for the sets of the initial pressure.
    residual : residual when the sets were chosen; infinite for the sets of the initial pressure.
    damping : factor of the length of the next projection step. It is reduced if the energy has increased.
    in_single : whether v was computed in single precision.
    """

    n_near: int
    n_free: int
    reach: float
    margin: float
    energy: float = inf
    residual: float = inf
    damping: float = 1.0
    in_single: bool = False


class LawOnGrid(Protocol):
    """What the iteration needs to know of the contact law: a straight line at each point, or tangents of a curve."""

    @property
    def evaluate(self) -> Callable[[int, float, float], tuple[Any, ...]]:
        """Compiled loop `projection.evaluate`, or a method with its last three arguments and its return values."""

    @property
    def can_descend(self) -> bool:
        """Whether the method in `descent` can solve the contact with this law."""

    @property
    def keeps_directions(self) -> bool:
        """Whether the search directions remain conjugate until the sets change."""

    @property
    def allows_single(self) -> bool:
        """Whether products with the pressure may be computed in single precision."""

    def has_risen(
        self, previous: ActiveSets, energy: float, residual: float, rounding: float
    ) -> bool:
        """Return whether the last change of the sets has to be damped, because it did not lead nearer to the solution.

        previous : sets before the change.
        energy : energy after the change.
        residual : residual before the change.
        rounding : largest relative rounding error of the difference of two energies.
        """


class StraightLaw:
    """Linear contact law, which is the same in all iterations."""

    can_descend = True
    keeps_directions = True
    allows_single = True

    def __init__(self, loops: Loops) -> None:
        self.evaluate = loops.evaluate

    def has_risen(
        self, previous: ActiveSets, energy: float, residual: float, rounding: float
    ) -> bool:
        """Return whether the energy has increased by more than a rounding error."""
        return energy > previous.energy + rounding * abs(previous.energy)
