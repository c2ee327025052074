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
from typing import NamedTuple

import numpy as np

from ..base import Array, NotConverged
from .active_sets import solve_active_sets
from .contact_fields import Contact
from .curve_tangents import Curve, CurveTangents
from .law import ContactLaw
from .nested_grids import (
    COARSE_ITERATIONS,
    COARSE_RTOL,
    COARSEST,
    Level,
    check_solution,
    solve_straight_law,
)
from .tangent_sequence import solve_by_tangents
from .workspace import workspace
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
    curve = Curve.of(law)
    stiffness = level.half_space.stiffness
    if curve is None or curve.pieces.steepest_fall > _STEEPEST_FALL * stiffness:
        return solve_by_tangents(law, level, rtol)
    try:
        return _solve_on_nested_grids(curve, level, rtol)
    except NotConverged:
        return solve_by_tangents(law, level, rtol)


def _solve_on_nested_grids(curve: Curve, level: Level, rtol: float) -> Contact:
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


def _start_with_line_or_curve(curve: Curve, level: Level, offset: float) -> _Start:
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


def _error_of_line(curve: Curve, line: YieldLine, pressure: Array, overlap: Array) -> float:
    """Compute the relative error of a linear law, ‖line − curve‖/‖pressure‖ over the points that yield.

    Parameters
    ----------
    curve : Curve
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
