"""Solve the flow through a whole surface at full resolution, and through a cell of it along one axis.

The module also counts the solutions of an ensemble by solver, and keeps the reasons of those that failed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..base import Array, FemsealError, Floats, Pair
from ..flow import Permeability, Spiral, cell_permeability
from ..flow.cell import cell_flow, pixel_dissipation
from ..flow.pressure_drop import VISCOUS, PressureDrop, pressure_between
from ..flow.problem import check_solver
from ..flow.spiral import spiral_flow
from ..topography.patches import divided

Result = TypeVar("Result")
#: Relative error at which the iteration ends of flows that depend on the pressure. The slip factor of a gas is known to
#: 0.9 %.
PRESSURE_RTOL = 1e-4
#: Points of the largest surface whose flow is solved as a whole. With its contact it takes 9 GB.
LARGEST_FLOW = 2**26


@dataclass(frozen=True)
class Failed:
    """The outcome of a solution that failed, in the place of its result. The other solutions of the ensemble go on.

    Parameters
    ----------
    reason : message of the error.
    permeability, per_length : NaN, where other results have theirs.
    """

    reason: str
    permeability: ClassVar[float] = np.nan
    per_length: ClassVar[float] = np.nan


def attempt(solve: Callable[..., Result], *arguments: Any, **options: Any) -> Result | Failed:
    """Call `solve` with the arguments; return its result, or `Failed` if it raises a `FemsealError`."""
    try:
        return solve(*arguments, **options)
    except FemsealError as error:
        return Failed(str(error))


@dataclass(frozen=True)
class SolveCounts:
    """Numbers of linear systems by solver, and numbers of flows through cells.

    Parameters
    ----------
    systems : name of each solver, and how many systems it solved.
    worst_imbalance : largest relative difference of inlet and outlet flow of all systems.
    solved : number of cells with an open path, whose flow a linear solver solved.
    closed : number of cells without an open path, whose flow is 0.

    >>> SolveCounts((("elimination", 2),), 1e-15) + SolveCounts((("amg", 1), ("elimination", 1)), 1e-9, solved=2)
    SolveCounts(systems=(('amg', 1), ('elimination', 3)), worst_imbalance=1e-09, solved=2, closed=0)
    """

    systems: tuple[tuple[str, int], ...] = ()
    worst_imbalance: float = 0.0
    solved: int = 0
    closed: int = 0

    @classmethod
    def of(cls, flow: Any) -> SolveCounts:
        """Count one flow by its `solver` and `imbalance`; the count is empty if there was no system to solve."""
        return cls() if flow.solver == "none" else cls(((flow.solver, 1),), flow.imbalance)

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return self.total((self, other))

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """Add up several counts."""
        counts, systems = list(counts), Counter[str]()
        for count in counts:
            systems.update(dict(count.systems))
        worst = max((count.worst_imbalance for count in counts), default=0.0)
        solved = sum(count.solved for count in counts)
        closed = sum(count.closed for count in counts)
        return cls(tuple(sorted(systems.items())), worst, solved, closed)


@dataclass(frozen=True)
class FlowSettings:
    """How the flow through a surface and its cells is solved, see `cell_permeability`, and of which fluid.

    Parameters
    ----------
    solver : of the linear systems.
    drop : fluid, and its pressures at both ends.
    spiral : how the grooves of a whole surface wind, see `femseal.flow.spiral`; None of rings.

    Raises InputError: an unknown solver.
    """

    solver: str = "auto"
    drop: PressureDrop = VISCOUS
    spiral: Spiral | None = None

    def __post_init__(self) -> None:
        check_solver(self.solver)


#: Default settings.
_PLAIN = FlowSettings()


@dataclass(frozen=True, eq=False)
class CellPermeabilities:
    """Permeability of a cell.

    Parameters
    ----------
    k : at every pressure of the fluid, array (pressures,), m³.
    counts : the one flow, counted as solved or closed.
    """

    k: Array
    counts: SolveCounts


def cell_permeabilities(
    gap: Array,
    spacing: Pair,
    axis: int,
    settings: FlowSettings = _PLAIN,
    core: tuple[int, int] | None = None,
) -> CellPermeabilities:
    """Solve the permeability along an axis of a cell with closed sides, at every pressure of the fluid.

    Parameters
    ----------
    gap : array (n1, n2), m.
    spacing : of the points, m.
    axis : direction of the flow, 0 or 1.
    settings : how the flow is solved.
    core : part of the cell across the flow whose permeability is wanted, see `cell_flow`; None for all of it.

    Raises NotConverged: the linear solver failed.
    """
    drop, k, solvers = settings.drop, np.zeros(settings.drop.pressures.size), []
    for n, p in enumerate(drop.pressures):
        equivalent = drop.law.equivalent_gap(gap, p)
        cell = cell_flow(
            equivalent, spacing, axis=axis, sides="mirror", solver=settings.solver, core=core
        )
        k[n] = cell.permeability
        solvers.append(SolveCounts.of(cell.flow))
        if k[0] == 0:  # closed at every pressure
            break
    # one flow, however many systems were solved for it
    is_open = cell.flow.percolates
    counts = SolveCounts.total(solvers)
    return CellPermeabilities(k, replace(counts, solved=int(is_open), closed=int(not is_open)))


@dataclass(frozen=True, eq=False)
class FaceFlow:
    """Flow along x1 through a whole surface.

    Parameters
    ----------
    permeability : for the drop of the viscous potential, m³.
    solvers : numbers of systems by solver.
    potential : between 1 at the inlet and 0 at the outlet, array (n1, n2); NaN in contact and in pockets.
    """

    permeability: float
    solvers: SolveCounts
    potential: Floats


def resolved_flow(
    gap: Floats,
    spacing: Pair,
    settings: FlowSettings = _PLAIN,
    sides: str = "periodic",
) -> FaceFlow:
    """Solve the flow along x1 through the gap of a whole surface.

    A surface of more than `LARGEST_FLOW` points is solved in parts along x2, each continued periodically by itself.
    Where the settings have a spiral, its grooves carry fluid past closed lands.

    Parameters
    ----------
    gap : array (n1, n2), m.
    spacing : of the points, m.
    settings : how the flow is solved.
    sides : "periodic" where the surface continues along x2, "mirror" where nothing flows across its sides.

    Raises NotConverged: see `cell_permeability` and `PressureDrop.solve_face`.
    """
    if gap.size > LARGEST_FLOW:
        parts = np.array_split(gap, -(-gap.size // LARGEST_FLOW), axis=1)
        flows = [resolved_flow(part, spacing, settings, sides) for part in parts]
        widths = [part.shape[1] for part in parts]
        value = float(np.average([flow.permeability for flow in flows], weights=widths))
        potential = np.concatenate([flow.potential for flow in flows], axis=1)
        return FaceFlow(value, SolveCounts.total(flow.solvers for flow in flows), potential)
    counts = SolveCounts()

    def solve(gap: Array) -> tuple[float, Array, Permeability]:
        nonlocal counts
        flow = cell_permeability(gap, spacing, sides=sides, solver=settings.solver)
        counts += SolveCounts.of(flow)
        if settings.spiral:
            along_grooves = spiral_flow(gap, spacing, settings.spiral, flow.fluid_pressure)
            if along_grooves:
                value, pressure = along_grooves
                flow = replace(flow, value=value, fluid_pressure=pressure, percolates=value > 0)
        return flow.value, flow.fluid_pressure, flow

    flow, drop = settings.drop.solve_face(np.asarray(gap, float), spacing, solve, PRESSURE_RTOL)
    value, potential = flow.value * drop.mean_factor, drop.viscous_fraction(flow.fluid_pressure)
    # the potential has no extremes inside; the solver's error, about 1e-3 in the norm of the energy, may give it some
    return FaceFlow(value, counts, np.clip(potential, 0.0, 1.0))


def flow_sides(boundary: str) -> str:
    """Return the kind of sides of a flow along which the surface has a boundary: "mirror" (closed) unless periodic."""
    return "periodic" if boundary == "periodic" else "mirror"


def permeability_along_x2(
    gap: Floats, widths: tuple[int, ...], spacing: Pair, settings: FlowSettings, sides: str
) -> float:
    """Solve the flow along x2 through a whole surface; of several measured patches through each by itself.

    Parameters
    ----------
    gap : (n1, n2) [m].
    widths : points of each measured patch along x2.
    spacing : of the points [m].
    settings : how the flow is solved.
    sides : of the surface along x1, see `resolved_flow`.

    Returns the permeability [m³], the mean over the patches weighted with their widths.

    Raises NotConverged: see `resolved_flow`.
    """
    patches = divided(gap, widths)
    values = [
        resolved_flow(np.ascontiguousarray(patch.T), spacing[::-1], settings, sides).permeability
        for patch in patches
    ]
    return float(np.average(values, weights=[patch.shape[1] for patch in patches]))


def drop_fractions(
    gap: Array,
    spacing: Pair,
    potential: Floats,
    settings: FlowSettings,
) -> Array:
    """Return the fraction of the dissipation at each pixel (n1, n2); NaN where nothing flows.

    Parameters
    ----------
    gap : array (n1, n2), m.
    spacing : of the points, m.
    potential : see `FaceFlow`.
    settings : how the flow was solved.
    """
    drop = settings.drop
    pressure: Array | float = 0.0
    if drop.law.depends_on_pressure:
        known = np.nan_to_num(potential, nan=0.5)
        pressure = pressure_between(drop.fluid, drop.inlet, drop.outlet, known)
        pressure = np.maximum(pressure, drop.least_pressure)
    equivalent = drop.law.equivalent_gap(gap, pressure)
    # grooves that wind leave the last column for another row of the first one
    dissipation = pixel_dissipation(equivalent, spacing, potential, seam=settings.spiral is None)
    total = dissipation.sum()
    return dissipation / total if total > 0 else np.full(dissipation.shape, np.nan)
