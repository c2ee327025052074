"""Solve a contact whose hardness is a curve H(u) of the plastic deformation: tables, Nix-Gao, coatings.

The method is the active-set method for linear contact laws (`active_sets`). In each iteration, the curve of each point
is replaced by its tangent at the present plastic deformation.

1. Each evaluation of the contact projects the trial pressures z = p − c (v − δ) of all points near contact onto their
   curves. The projection follows from the scalar equation H(u) + c u = z for the plastic deformation u. The equation
   has one solution u if the law does not soften too steeply.
2. The tangent of the curve at u becomes the linear law of the point. Where the curve falls, a horizontal line replaces
   the tangent.
3. Newton's method finds the approach δ for which the sum of the projected pressures y on the curves is the load.
4. The active sets are changed, and conjugate gradients are performed, as for linear hardening. The iteration ends when
   the pressures agree with the curves H(u).

The tangents and the active sets converge in the same Newton iteration. A contact with a curved law therefore takes
about as many iterations as with a constant hardness. For a linear law, the damping is reduced when the energy
increases. For a curved law, it depends on the residual, because energies with different tangents cannot be compared. If
the iteration does not converge, or the law softens steeply, `tangent_sequence` solves the contact.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..base import Array, NotConverged
from .active_sets import ActiveSets, solve_active_sets
from .contact_fields import Contact
from .curve_loops import FIRST, TANGENT, CurveLines, ShiftedCurve, follow_curve
from .curve_pieces import CurvePieces
from .descent import Solution
from .law import ContactLaw
from .nested_grids import (
    COARSE_ITERATIONS,
    COARSE_RTOL,
    COARSEST,
    Level,
    check_solution,
    make_contact,
    solve_straight_law,
)
from .point_arrays import LinearLaw
from .tangent_sequence import solve_by_tangents
from .workspace import Problem, Workspace, coarsened, workspace
from .yield_line import YieldLine

#: Largest number of iterations on the given grid.
_ITERATIONS = 80
#: Largest value of −dH/du, relative to the stiffness of the half-space, for which the method is used. If H(u) falls
#: more steeply, single pixels may yield while their neighbours do not.
_STEEPEST_FALL = 0.4
#: On a coarse grid, the curve H(u) is replaced by a straight line. If the relative error of the line exceeds the first
#: value, the curve is used on the next finer grid. The error is computed for the plastic deformation on the coarse grid
#: divided by the second value, because asperities yield deeper on a finer grid.
_COARSE_ERROR, _COARSE_DEPTH = 1e-3, 0.6
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


class _Curve(NamedTuple):
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
    def of(cls, law: ContactLaw) -> _Curve | None:
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

    def coarser(self) -> _Curve:
        """Return the contact law on the next coarser grid, with averages of u₀ and p_f over 2 × 2 points."""
        earlier, fluid = (
            coarsened(values) if values.size > 1 else values
            for values in (self.earlier, self.fluid)
        )
        return self._replace(earlier=earlier, fluid=fluid)


def solve_curved_law(law: ContactLaw, level: Level, rtol: float) -> Contact:
    """Solve a contact with a curved law.

    Parameters
    ----------
    law : ContactLaw
        Curved contact law.
    level : Level
        Contact problem on the given grid. The line of `level` must be the tangent of `law` at u = 0.
    rtol : float
        Target residual.

    Raises
    ------
    NotConverged
        After the largest number of iterations, the pressures and plastic deformations still do not agree with the law.
    """
    if level.mean_pressure == 0:
        return solve_straight_law(level, rtol)
    curve = _Curve.of(law)
    stiffness = level.half_space.stiffness
    if curve is None or curve.pieces.steepest_fall > _STEEPEST_FALL * stiffness:
        return solve_by_tangents(law, level, rtol)
    try:
        return _solve_on_nested_grids(curve, level, rtol)
    except NotConverged:
        return solve_by_tangents(law, level, rtol)


def _solve_on_nested_grids(curve: _Curve, level: Level, rtol: float) -> Contact:
    """Solve a contact with a curved law on nested grids, beginning with the coarsest grid.

    The straight line of `level` is the tangent of the curve at u = 0. On a coarse grid, the contact is first solved
    with the straight line, which is faster. If the resulting plastic deformations lie where the line deviates from the
    curve, the curve is used on all finer grids. The straight line often suffices: on first loading, if the plastic
    deformations stay within a constant part of the curve; on unloading, if no point yields again.
    """
    offset = float(level.gap0.min())
    start, delta, needs_curve = _start_with_line_or_curve(curve, level, offset)
    # try the line on the given grid if the line was accurate on all coarser grids
    if not needs_curve:
        contact = solve_straight_law(level, rtol, start)
        error = _error_of_line(curve, level.line, contact.pressure, contact.plastic_deformation)
        if error <= rtol:
            return replace(contact, residual=max(contact.residual, error))
        start = contact.pressure
        delta = contact.approach - offset
    grid = workspace(level.half_space)
    tangents = CurveTangents(curve, grid, level, offset, start, delta)
    solution = tangents.solve(rtol, _ITERATIONS)
    check_solution(level, float(grid.pressure.mean()), solution, rtol)
    return tangents.contact(solution)


class _Start(NamedTuple):
    """First guess of a solution.

    pressure : first guess of the pressure [Pa], on the grid or on the next coarser grid.
    delta : first guess of the approach, measured from the offset of the heights [m]; None without a first guess.
    needs_curve : whether the straight line cannot carry the load, or differs too much from the curve.
    """

    pressure: Array
    delta: float | None
    needs_curve: bool


def _start_with_line_or_curve(curve: _Curve, level: Level, offset: float) -> _Start:
    """Solve a contact on all coarser grids, using the straight line of `level` while it is accurate enough.

    offset : reference height [m] from which heights are measured.
    """
    # contact problem and curve on each grid, from the given grid to the coarsest grid
    levels = [(level, curve)]
    while max(levels[-1][0].half_space.shape) > COARSEST:
        finer, finer_curve = levels[-1]
        coarser = finer.coarser()._replace(mean_pressure=level.mean_pressure)
        levels.append((coarser, finer_curve.coarser()))
    # the solution on each grid gives first guesses of pressure and approach on the next finer grid
    pressure = levels[-1][0].first_guess()
    delta = None
    least_capacity = min(problem.line.capacity for problem, _ in levels)
    needs_curve = level.mean_pressure >= least_capacity * (1 - 1e-9)
    while len(levels) > 1:
        coarse, coarse_curve = levels.pop()
        grid = workspace(coarse.half_space, level.half_space)
        if needs_curve:
            tangents = CurveTangents(coarse_curve, grid, coarse, offset, pressure, delta)
            delta = tangents.solve(COARSE_RTOL, COARSE_ITERATIONS).delta
            del tangents
        else:
            grid.start(pressure, coarse.line.limit)
            problem = coarse.on_grid(offset, delta)
            delta = solve_active_sets(grid, problem, COARSE_RTOL, COARSE_ITERATIONS).delta
            overlap = (delta - grid.arrays.respond.displacement) / _COARSE_DEPTH
            error = _error_of_line(coarse_curve, coarse.line, grid.pressure, overlap)
            needs_curve = error > _COARSE_ERROR
        pressure = grid.pressure
        del grid, coarse  # release their memory before the next grid is created
    return _Start(pressure, delta, needs_curve)


def _error_of_line(curve: _Curve, line: YieldLine, pressure: Array, overlap: Array) -> float:
    """Compute the relative error of a linear law, ‖line − curve‖/‖pressure‖ over the points that yield.

    Parameters
    ----------
    curve : _Curve
        Curved contact law of the points.
    line : YieldLine
        Linear contact law with which the contact was solved.
    pressure : array (n1, n2)
        Pressure [Pa].
    overlap : array (n1, n2)
        Overlap of the bodies [m]; where points yield, this is their plastic deformation.
    """
    # deformation up to which the hardness of each point is constant, so that the line agrees with the curve
    constant_depth = np.maximum(curve.constant_depth - curve.earlier, 0.0)
    if overlap.max() <= constant_depth.min():
        return 0.0
    yields = (overlap > constant_depth) & (pressure > 0)
    yields &= pressure >= line.hardness
    if not yields.any():
        return 0.0
    hardness, slope, earlier, fluid = (
        np.broadcast_to(values, yields.shape)[yields]
        for values in (line.hardness, line.slope, curve.earlier, curve.fluid)
    )
    deformation = overlap[yields]
    on_line = hardness + slope * deformation
    on_curve = curve.pieces.hardness(earlier + deformation) - fluid
    difference = on_line - on_curve
    return float(np.linalg.norm(difference) / np.linalg.norm(pressure))


class CurveTangents:
    """Tangents of the curved contact law at the present plastic deformation of each point, for `solve_active_sets`.

    This is an implementation of `active_sets.LawOnGrid`. Each evaluation of the contact gives new plastic deformations,
    and therefore new tangents.

    Parameters
    ----------
    curve : _Curve
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
        curve: _Curve,
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
    ) -> tuple[float, bool, Any, Any, Any, Any]:
        """Find the approach δ, and compare the pressures p with their projections y onto the curves.

        The arguments and the returned values have the same meaning as in `projection.evaluate`.
        """
        # Newton's method for Σ y(δ) = load within the bracket from `low` to `high`
        low = -inf
        high = inf
        # limit of the step as long as the bracket has no bound in the direction of the step
        largest_step = self._first_step
        for _ in range(_APPROACH_STEPS):
            total, slopes, self.n_tangents, r2, y2, *changes = self._follow(n_near, c, delta)
            excess = total - self._load
            step = -excess / (c * slopes) if slopes > 0 else -excess * inf
            residual = sqrt(r2 / y2) if y2 > 0 else 0.0
            # the load need not be more accurate than the pressures are at present
            accepted = min(_LOAD_ERROR * residual, _LARGEST_LOAD_ERROR)
            if abs(excess) <= max(accepted, _SMALLEST_LOAD_ERROR) * self._load:
                if c * abs(step) * n_near <= _LARGEST_CORRECTION * self._load:
                    return delta + step, True, r2, y2, *changes
                if excess == 0:
                    return delta, True, r2, y2, *changes
            if excess > 0:
                high = min(high, delta)
            else:
                low = max(low, delta)
            # without a bound in the direction of the step, the step is limited, because the curve may rise soon
            if (high if step > 0 else -low) == inf and not abs(step) < largest_step:
                if largest_step > _LARGEST_STEP:
                    break
                step = largest_step if step > 0 else -largest_step
                largest_step *= 2
            new = delta + step
            if not low < new < high:  # outside the bracket: bisect
                new = 0.5 * (low + high)
            if new == delta:  # the bracket cannot be divided further
                return delta, True, r2, y2, *changes
            delta = new
        # the listed points cannot carry the load, or Newton's method has not converged
        return delta, False, r2, y2, *changes

    def _follow(self, n_near: int, c: float, delta: float) -> tuple[Any, ...]:
        """Call `follow_curve` for an approach `delta` [m] and a step length c [Pa/m]."""
        if c != self._stiffness:
            self._stiffness = c
            levels = self._pieces.coefficients[:, 0] + c * self._pieces.depth
            # on coarse grids, the curve may fall more steeply than the half-space is stiff
            self._curve = self._curve._replace(levels=np.maximum.accumulate(levels))
        grid = self.grid
        return follow_curve(n_near, c, delta, grid.points, grid.near, self._curve, self._lines)

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
