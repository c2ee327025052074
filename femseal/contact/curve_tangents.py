"""Replace the curve H(u) of a contact law by tangents, for the active-set method.

`CurveTangents` takes the place of a linear law in `active_sets.solve_active_sets`. In each evaluation of the contact,
it projects the pressures onto the curves, finds the approach δ, and replaces the curve of each point by its tangent at
the new plastic deformation. `curved_law` explains the method.
"""

from __future__ import annotations

from math import inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from ..base import Array
from .active_sets import solve_active_sets
from .contact_fields import Contact
from .curve_loops import FIRST, TANGENT, CurveLines, ShiftedCurve, follow_curve
from .curve_pieces import CurvePieces
from .descent import Solution
from .law import ContactLaw
from .law_on_grid import ActiveSets
from .nested_grids import Level, make_contact
from .point_arrays import LinearLaw
from .workspace import Problem, Workspace, coarsened
from .yield_line import YieldLine

#: The damping is reduced if the residual has become larger than this fraction of its value at the previous change of
#: the sets.
_SLOW = 0.9
#: Largest number of steps of Newton's method for the approach.
_APPROACH_STEPS = 80
#: The approach is accurate enough if the relative error of the load is at most the first value times the residual, and
#: at most the second value. A relative error below the third value is a rounding error.
_LOAD_ERROR, _LARGEST_LOAD_ERROR, _SMALLEST_LOAD_ERROR = 0.3, 1e-2, 1e-14
#: Largest last correction of the approach, multiplied by c and divided by the mean pressure of the listed points.
_LARGEST_CORRECTION = 0.1
#: First step of the approach [m] if no point resists the approach; and length of a step [m] beyond which the listed
#: points are assumed to be unable to carry the load.
_FIRST_STEP, _LARGEST_STEP = 1e-9, 1e-2


class Curve(NamedTuple):
    """Contact law H(u + u₀) − p_f of all points on one of the nested grids.

    pieces : curve H(u), the same for all points.
    constant_depth : depth [m] up to which H(u) is constant.
    earlier : earlier plastic deformation u₀ [m], one value for all points (1, 1) or one for each point (n1, n2).
    fluid : fluid pressure p_f [Pa], one value for all points (1, 1) or one for each point (n1, n2).
    """

    pieces: CurvePieces
    constant_depth: float
    earlier: Array
    fluid: Array

    @classmethod
    def of(cls, law: ContactLaw) -> Curve | None:
        """Represent a contact law as a curve H(u) of cubic pieces, with u₀ and p_f of each point.

        Returns None in two cases: if the laws of different points differ in more than u₀ and p_f, or if the curve needs
        too many cubic pieces.
        """
        shifted = law.shifted()
        if not shifted.law.is_uniform:
            return None
        pieces = shifted.law.pieces
        if pieces is None:
            return None
        return cls(
            pieces.times(shifted.factor),
            shifted.law.constant_depth,
            np.atleast_2d(shifted.earlier_deformation),
            np.atleast_2d(shifted.fluid_pressure),
        )

    def coarser(self) -> Curve:
        """Return the contact law on the next coarser grid, with averages of u₀ and p_f over 2 × 2 points."""
        earlier, fluid = (
            coarsened(values) if values.size > 1 else values
            for values in (self.earlier, self.fluid)
        )
        return self._replace(earlier=earlier, fluid=fluid)


class _Projection(NamedTuple):
    """Projections y of the trial pressures on the curves for a value of the approach, see `curve_loops.follow_curve`.

    total : sum Σ y of the projected pressures [Pa].
    slopes : derivative of Σ y with respect to cδ.
    n_tangents : number of points whose tangent has a positive slope.
    squared_difference, squared_projection : ‖p − y‖² and ‖y‖².
    n_changed : number of points whose state would change if p were set to y. Perfectly plastic points whose pressure
        differs from y are counted as well.
    squared_change : sum of (p − y)² over these points; infinite if a hardening point would stop hardening.
    """

    total: float
    slopes: float
    n_tangents: int
    squared_difference: float
    squared_projection: float
    n_changed: int
    squared_change: float


class CurveTangents:
    """Tangents of the curved contact law at the present plastic deformation of each point, for `solve_active_sets`.

    This is an implementation of `law_on_grid.LawOnGrid`. Each evaluation of the contact gives new plastic deformations,
    and therefore new tangents.

    Parameters
    ----------
    curve : Curve
        Curved contact law on the grid.
    grid : Workspace
        Work arrays for the grid.
    level : Level
        Contact problem on the grid.
    offset : float
        Height that is subtracted from the gap and from the approach [m].
    start : array (n1, n2)
        First guess of the pressure [Pa], on the grid or on the next coarser grid.
    first_delta : float, optional
        First guess of the approach minus the offset [m].

    Attributes
    ----------
    n_tangents : int
        Number of points near contact whose tangent has a positive slope.
    """

    #: `descent` needs a law that remains the same.
    can_descend = False
    #: `follow_curve` reads v of the grid in double precision.
    allows_single = False

    def __init__(
        self,
        curve: Curve,
        grid: Workspace,
        level: Level,
        offset: float,
        start: Array,
        first_delta: float | None,
    ) -> None:
        grid.start(start, np.array([inf]))
        n = grid.pressure.size
        self.grid = grid
        self.level = level
        self.offset = offset
        self.first_delta = first_delta
        self.n_tangents = 0
        self._load = level.mean_pressure * n  # sum of the pressures of all points [Pa]
        first_hardness = (curve.pieces.hardness(curve.earlier) - curve.fluid).ravel()
        self._pieces = curve.pieces
        # `levels` depend on the step length c; they are computed when c is known
        self._stiffness = 0.0
        self._curve = ShiftedCurve(
            depth=curve.pieces.depth,
            levels=np.empty(0),
            coefficients=curve.pieces.coefficients,
            has_end=curve.pieces.has_constant_end,
            constant_depth=curve.constant_depth,
            earlier=curve.earlier.ravel(),
            fluid=curve.fluid.ravel(),
            first_hardness=first_hardness,
        )
        self._lines = CurveLines(
            kind=np.full(n, FIRST, np.int8),
            hardness=np.empty(n),
            slope=np.zeros(n),
            begins=np.empty(n),
            gap0=level.gap0.ravel().copy(),
        )
        self._lines.hardness[:] = first_hardness
        deepest_start = curve.constant_depth if isfinite(curve.constant_depth) else 0.0
        self._first_step = max(deepest_start, _FIRST_STEP)

    def solve(self, rtol: float, limit: int) -> Solution:
        """Solve the contact on the grid with `solve_active_sets`, which calls `evaluate` to update the tangents."""
        law = LinearLaw(self._lines.hardness, self._lines.slope)
        problem = Problem(self._lines.gap0, self.offset, law, self._load, self.first_delta)
        solution = solve_active_sets(self.grid, problem, rtol, limit, self)
        # The gap of a point with a tangent is increased by the depth at which the tangent begins. If such a point is no
        # longer near contact, its gap remains wrong, and the solution is not valid.
        if np.count_nonzero(self._lines.kind == TANGENT) != self.n_tangents:
            return solution._replace(residual=inf)
        return solution

    @property
    def keeps_directions(self) -> bool:
        """Whether no tangent has a positive slope, so that the compliances of the points have not changed."""
        return self.n_tangents == 0

    def has_risen(
        self, previous: ActiveSets, energy: float, residual: float, rounding: float
    ) -> bool:
        """Return whether the residual has hardly fallen since the previous change of the sets.

        Energies with different tangents cannot be compared.
        """
        return residual > _SLOW * previous.residual

    def evaluate(
        self, n_near: int, c: float, delta: float
    ) -> tuple[float, bool, float, float, int, float]:
        """Find the approach δ, and compare the pressures p with their projections y onto the curves.

        Newton's method solves Σ y(δ) = load within a bracket. The load need not be more accurate than the pressures are
        at present. The arguments and the returned values have the same meaning as in `projection.evaluate`.
        """
        # bracket of the solution
        low = -inf
        high = inf
        # limit of the step as long as the bracket has no bound in the direction of the step
        largest_step = self._first_step
        can_carry = True
        for _ in range(_APPROACH_STEPS):
            found = self._project(n_near, c, delta)
            excess = found.total - self._load
            step = -excess / (c * found.slopes) if found.slopes > 0 else -excess * inf
            if self._is_accurate(found):
                if c * abs(step) * n_near <= _LARGEST_CORRECTION * self._load:
                    delta += step
                    break
                if excess == 0:
                    break
            if excess > 0:
                high = min(high, delta)
            else:
                low = max(low, delta)
            # without a bound in the direction of the step, the step is limited, because the curve may rise soon
            bound = high if step > 0 else -low
            if bound == inf and not abs(step) < largest_step:
                if largest_step > _LARGEST_STEP:
                    can_carry = False
                    break
                step = largest_step if step > 0 else -largest_step
                largest_step *= 2
            new = delta + step
            if not low < new < high:  # outside the bracket: bisect
                new = 0.5 * (low + high)
            if new == delta:  # the bracket cannot be divided further
                break
            delta = new
        else:
            can_carry = False  # Newton's method has not converged
        return (
            delta,
            can_carry,
            found.squared_difference,
            found.squared_projection,
            found.n_changed,
            found.squared_change,
        )

    def _is_accurate(self, found: _Projection) -> bool:
        """Return whether the error of the load is a rounding error, or much smaller than the residual."""
        residual = 0.0
        if found.squared_projection > 0:
            residual = sqrt(found.squared_difference / found.squared_projection)
        largest_error = min(_LOAD_ERROR * residual, _LARGEST_LOAD_ERROR)
        largest_error = max(largest_error, _SMALLEST_LOAD_ERROR)
        return abs(found.total - self._load) <= largest_error * self._load

    def _project(self, n_near: int, c: float, delta: float) -> _Projection:
        """Project the pressures onto the curves for an approach `delta` [m] and a step length c [Pa/m]."""
        if c != self._stiffness:
            self._stiffness = c
            levels = self._pieces.coefficients[:, 0] + c * self._pieces.depth
            # on coarse grids, the curve may fall more steeply than the half-space is stiff
            self._curve = self._curve._replace(levels=np.maximum.accumulate(levels))
        grid = self.grid
        sums = follow_curve(n_near, c, delta, grid.points, grid.near, self._curve, self._lines)
        found = _Projection(*sums)
        self.n_tangents = found.n_tangents
        return found

    def contact(self, solution: Solution) -> Contact:
        """Make a `Contact` from the pressure and the tangents of the solution."""
        shape = self.grid.pressure.shape
        lines = self._lines
        has_tangent = lines.kind == TANGENT
        # all points on the curved part yield, even if a rounding error makes their pressure less than their hardness
        is_horizontal = ~has_tangent & (lines.kind != FIRST)
        pressure = self.grid.pressure.ravel()
        np.minimum(lines.hardness, pressure, out=lines.hardness, where=is_horizontal)
        line = YieldLine(lines.hardness.reshape(shape), lines.slope.reshape(shape))
        contact = make_contact(self.level._replace(line=line), self.grid, self.offset, solution)
        begins = np.where(has_tangent, lines.begins, 0.0).reshape(shape)
        np.add(contact.plastic_deformation, begins, out=contact.plastic_deformation)
        return contact
