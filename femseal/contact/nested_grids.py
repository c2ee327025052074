"""Solve a contact with a linear contact law on nested grids.

The contact is first solved on the coarsest grid. The solution on each grid is the first guess on the next finer grid,
until the given grid is reached. The module `active_sets` describes the method on a single grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base import Array, NotConverged
from ..base.compiled import over, rows
from .active_sets import solve_active_sets
from .contact_fields import Contact
from .descent import Solution
from .half_space import HalfSpace
from .result_loops import gap_and_deformation
from .workspace import Problem, Workspace, coarsened, workspace
from .yield_line import YieldLine

#: Target residual on coarse grids.
COARSE_RTOL = 1e-2
#: Largest number of iterations on each coarse grid, and on the given grid.
COARSE_ITERATIONS = 40
MAX_ITERATIONS = 400
#: Largest number of points along the longer side of the coarsest grid. On a finer grid, a few steps could not
#: redistribute the pressure from one end of a long strip to the other. Compared with a limit of 48 points, contacts on
#: 64² points take 0.7 to 0.9 of the time, those on 128² points 0.85 to 1.0, and those on 256² points 0.95 to 1.0.
COARSEST = 96
#: Largest accepted relative error of the load.
_LOAD_TOLERANCE = 1e-9


class Level(NamedTuple):
    """A contact problem on one of the nested grids, with checked input.

    gap0 : array (n1, n2), undeformed gap [m].
    half_space : half-space on the grid of the problem.
    line : linear contact law.
    mean_pressure : nominal pressure [Pa].
    """

    gap0: Array
    half_space: HalfSpace
    line: YieldLine
    mean_pressure: float

    def coarser(self) -> Level:
        """Make the contact problem on the next coarser grid, with about half as many points along each axis."""
        hardness, slope = (
            coarsened(values) if values.size > 1 else values
            for values in (self.line.hardness, self.line.slope)
        )
        line = YieldLine(hardness, slope)
        mean_pressure = self.mean_pressure
        if np.isfinite(line.capacity):
            # The mean hardness of the coarse grid may differ, because an odd last row is counted twice. The mean
            # pressure is scaled, so that all grids carry the same fraction of their capacity.
            mean_pressure *= line.capacity / self.line.capacity
        return Level(coarsened(self.gap0), self.half_space.coarser, line, mean_pressure)

    def on_grid(self, offset: float, first_delta: float | None = None) -> Problem:
        """Return the data of the problem for `solve_active_sets`.

        offset : height [m] from which heights and the approach are measured.
        first_delta : first guess of the approach [m]; None without a guess.
        """
        return Problem(
            gap0=self.gap0.ravel(),
            offset=offset,
            law=self.line.of_list,
            load=self.mean_pressure * self.gap0.size,
            first_delta=first_delta,
        )

    def first_guess(self) -> Array:
        """Guess the pressure: distribute the load uniformly on the highest points.

        The number of points is chosen such that each carries the hardness or 0.1 E*, whichever is smaller.
        """
        wanted_pressure = min(self.line.mean_hardness, 0.1 * self.half_space.pixel_modulus)
        gap0 = self.gap0
        n_carrying = min(gap0.size, int(self.mean_pressure / wanted_pressure * gap0.size))
        # at least four points, as far as the grid has so many
        n_touching = max(min(4, gap0.size), n_carrying)
        # the largest gap of the n_touching highest points
        largest_gap = np.partition(gap0, n_touching - 1, axis=None)[n_touching - 1]
        is_touching = gap0 <= largest_gap
        return is_touching * (self.mean_pressure * gap0.size / np.count_nonzero(is_touching))


def solve_straight_law(level: Level, rtol: float, start: Array | None = None) -> Contact:
    """Solve a contact with a linear contact law.

    start : first guess of the pressure [Pa] on the given grid or on the next coarser grid. By default, the first guess
        is computed on coarser grids.
    """
    # heights are measured from the highest point, so that rounding errors are small for points in contact
    offset = float(level.gap0.min())
    if level.mean_pressure == 0:
        return uniform_contact(level, offset, 0.0)
    if level.mean_pressure >= level.line.capacity * (1 - 1e-12):
        return uniform_contact(level, offset, level.line.hardness)
    delta = None
    if start is None:
        start, delta = _start_from_coarser_grids(level, offset)
    grid = workspace(level.half_space)
    grid.start(start, level.line.limit)
    solution = solve_active_sets(grid, level.on_grid(offset, delta), rtol, MAX_ITERATIONS)
    check_solution(level, float(grid.points.p.sum()) / grid.pressure.size, solution, rtol)
    return make_contact(level, grid, offset, solution)


def _start_from_coarser_grids(level: Level, offset: float) -> tuple[Array, float | None]:
    """Solve a contact on all coarser grids, beginning with the coarsest grid.

    Returns the pressure [Pa] on the finest of the coarser grids, and the approach [m] measured from `offset`. If there
    is no coarser grid, the pressure is the guess of `Level.first_guess` on the given grid, and the approach is None.
    """
    levels = [level]
    while max(levels[-1].half_space.shape) > COARSEST:
        levels.append(levels[-1].coarser())
    start = levels[-1].first_guess()
    delta = None
    while len(levels) > 1:
        coarse = levels.pop()
        grid = workspace(coarse.half_space, level.half_space)
        grid.start(start, coarse.line.limit)
        problem = coarse.on_grid(offset, delta)
        solution = solve_active_sets(grid, problem, COARSE_RTOL, COARSE_ITERATIONS, is_coarse=True)
        delta = solution.delta
        start = grid.pressure
        del grid, coarse  # release their memory before the next grid is created
    return start, delta


def uniform_contact(level: Level, offset: float, pressure: float | Array) -> Contact:
    """Make a `Contact` directly if the pressure of all points is known, without solving a problem.

    pressure : 0 for a contact without load, or the pressure of each point [Pa] if all points are in contact.
    """
    grid = workspace(level.half_space)
    grid.pressure[:] = pressure
    v = grid.displacement()
    v += level.gap0 - offset
    delta = float(v.max()) if grid.pressure.any() else 0.0
    return make_contact(level, grid, offset, Solution(delta, 0.0, 0, 1))


def check_solution(level: Level, carried: float, solution: Solution, rtol: float) -> None:
    """Raise NotConverged if the residual is above `rtol`, or if the mean pressure `carried` [Pa] is wrong."""
    if not abs(carried - level.mean_pressure) <= _LOAD_TOLERANCE * level.mean_pressure:
        raise NotConverged(
            f"contact: the solution carries {carried / level.mean_pressure:.6g} times the given load; try another grid",
            solution.residual,
        )
    if not solution.residual <= rtol:
        raise NotConverged(
            f"contact: residual {solution.residual:.1e} after {solution.iterations} iterations, wanted {rtol:.1e}; "
            "try a larger rtol, a filtered surface or a finer grid",
            solution.residual,
        )


def make_contact(level: Level, grid: Workspace, offset: float, solution: Solution) -> Contact:
    """Make a `Contact` from the solution that is stored in the workspace of a grid.

    Parameters
    ----------
    level : Level
        Contact problem on the grid, with the line H + h u of the contact law at each point.
    grid : Workspace
        Arrays of the solver with the pressure and v, the displacement plus the undeformed gap.
    offset : float
        Height [m] that was subtracted from the undeformed gap, and that is added back to the approach.
    solution : Solution
        Approach, residual, number of iterations and number of products with the compliance.
    """
    v = grid.points.v
    # a workspace that is kept for the next contact continues to use its array of pressures
    pressure = grid.pressure.copy() if grid.is_kept else grid.pressure
    grid.release()
    gap = np.empty(pressure.shape)
    deformation = np.zeros(pressure.shape)
    is_plastic = np.zeros(pressure.shape, bool)
    parts_of_grid = rows(*pressure.shape)
    law = level.line.of_list
    flat_results = gap.ravel(), deformation.ravel(), is_plastic.ravel()
    # the flat views share the memory of gap, deformation and is_plastic, which are filled here
    over(
        parts_of_grid,
        gap_and_deformation,
        pressure.ravel(),
        v,
        solution.delta,
        grid.stiffness,
        law,
        *flat_results,
    )
    return Contact(
        pressure=pressure,
        gap=gap,
        plastic_deformation=deformation,
        approach=solution.delta + offset,
        residual=solution.residual,
        iterations=solution.iterations,
        fft_pairs=solution.products,
        plastic=is_plastic,
        half_space=level.half_space,
    )
