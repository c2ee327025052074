"""Solve the flow through a whole surface at full resolution, and through one of its cells along one axis.

The module also contains `attempt`, which records the failure of a solver instead of stopping a run, and `SolveCounts`,
which counts the linear systems solved by each solver.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..base import Array, FemsealError, Floats, Pair
from ..flow import Permeability, Spiral, cell_permeability
from ..flow.cell import cell_flow
from ..flow.dissipation import pixel_dissipation
from ..flow.pressure_drop import VISCOUS, PressureDrop, pressure_between, solve_face
from ..flow.problem import check_solver
from ..flow.spiral import spiral_flow
from ..topography.patches import split_patches

Result = TypeVar("Result")
#: Relative tolerance of the iteration for a permeability that depends on the fluid pressure. For comparison, the slip
#: factor of a gas is only known to 0.9 %.
PRESSURE_RTOL = 1e-4
#: Largest number of points of a surface whose flow is solved as a whole. Solving contact and flow of a surface of this
#: size takes 9 GB of memory.
LARGEST_FLOW = 2**26


@dataclass(frozen=True)
class Failed:
    """Stand in for the result of a solver that failed, so that a run can continue with the results of other solvers.

    Attributes
    ----------
    reason : str
        Message of the error.
    permeability, per_length : float
        NaN, because the permeability and the leakage per length are unknown after a failure.
    """

    reason: str
    permeability: ClassVar[float] = np.nan
    per_length: ClassVar[float] = np.nan


def attempt(solve: Callable[..., Result], *arguments: Any, **options: Any) -> Result | Failed:
    """Call `solve` with the arguments; return the result, or `Failed` if `solve` raises a `FemsealError`."""
    try:
        return solve(*arguments, **options)
    except FemsealError as error:
        return Failed(str(error))


@dataclass(frozen=True)
class SolveCounts:
    """Number of linear systems that each solver has solved, and the numbers of open and closed cells.

    Parameters
    ----------
    systems : tuple of (str, int)
        Name of each solver, and the number of systems that it solved.
    worst_imbalance : float
        Largest relative difference between inlet and outlet flow in all systems.
    solved : int
        Number of cells with an open path, whose flow was computed by a linear solver.
    closed : int
        Number of cells without an open path, whose flow is 0.

    >>> SolveCounts((("elimination", 2),), 1e-15) + SolveCounts((("amg", 1), ("elimination", 1)), 1e-9, solved=2)
    SolveCounts(systems=(('amg', 1), ('elimination', 3)), worst_imbalance=1e-09, solved=2, closed=0)
    """

    systems: tuple[tuple[str, int], ...] = ()
    worst_imbalance: float = 0.0
    solved: int = 0
    closed: int = 0

    @classmethod
    def of(cls, flow: Any) -> SolveCounts:
        """Count the linear system that was solved for a single flow.

        flow : result with the attributes `solver` and `imbalance`. If `solver` is "none", no system was solved, and all
            counts are 0.
        """
        return cls() if flow.solver == "none" else cls(((flow.solver, 1),), flow.imbalance)

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return self.total((self, other))

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """Add up several counts."""
        counts = list(counts)
        systems = Counter[str]()
        for count in counts:
            systems.update(dict(count.systems))
        worst = max((count.worst_imbalance for count in counts), default=0.0)
        solved = sum(count.solved for count in counts)
        closed = sum(count.closed for count in counts)
        return cls(tuple(sorted(systems.items())), worst, solved, closed)


@dataclass(frozen=True)
class FlowSettings:
    """Settings for the flow through a surface and its cells.

    Parameters
    ----------
    solver : str
        Linear solver, see `cell_permeability`.
    drop : PressureDrop
        Pressure drop of the fluid from inlet to outlet.
    spiral : Spiral or None
        Spiral grooves of the whole surface, see `femseal.flow.spiral`; None if the grooves are closed rings.

    Raises
    ------
    InputError
        The solver is unknown.
    """

    solver: str = "auto"
    drop: PressureDrop = VISCOUS
    spiral: Spiral | None = None

    def __post_init__(self) -> None:
        check_solver(self.solver)


_DEFAULT_SETTINGS = FlowSettings()


@dataclass(frozen=True, eq=False)
class CellPermeabilities:
    """Permeability of a cell along one axis.

    Attributes
    ----------
    k : array, (pressures,)
        Permeability at each fluid pressure [m³].
    solve_counts : SolveCounts
        Number of linear systems that were solved for all fluid pressures. The cell itself is counted only once as open
        or closed.
    """

    k: Array
    solve_counts: SolveCounts


def cell_permeabilities(
    gap: Array,
    spacing: Pair,
    axis: int,
    settings: FlowSettings = _DEFAULT_SETTINGS,
    core: tuple[int, int] | None = None,
) -> CellPermeabilities:
    """Compute the permeability of a cell along one axis at each fluid pressure, without flow through the sides.

    Parameters
    ----------
    gap : array, (n1, n2)
        Gap [m].
    spacing : tuple of two float
        Point spacing [m].
    axis : int
        Direction of the flow, 0 or 1.
    settings : FlowSettings
        Fluid and solver.
    core : tuple of two int, optional
        Range of the points of the cell itself, without overlaps, on the axis perpendicular to the flow, see
        `cell_flow`. Default: a cell without overlaps.

    Raises
    ------
    NotConverged
        The linear solver failed.
    """
    drop = settings.drop
    k = np.zeros(drop.pressures.size)
    systems = []
    for n, p in enumerate(drop.pressures):
        equivalent = drop.law.equivalent_gap(gap, p)
        cell = cell_flow(
            equivalent, spacing, axis=axis, sides="mirror", solver=settings.solver, core=core
        )
        k[n] = cell.permeability
        systems.append(SolveCounts.of(cell.flow))
        if k[0] == 0:  # a closed cell is closed at every fluid pressure
            break
    # the cell counts once, however many linear systems were solved for the cell
    is_open = cell.flow.percolates
    counts = SolveCounts.total(systems)
    return CellPermeabilities(k, replace(counts, solved=int(is_open), closed=int(not is_open)))


@dataclass(frozen=True, eq=False)
class FaceFlow:
    """Flow along x1 through a whole surface.

    Attributes
    ----------
    permeability : float
        Permeability k [m³]: the mass flow rate per width is k Δφ/L1, with the drop Δφ of the viscous pressure potential
        over the length L1 of the surface.
    solve_counts : SolveCounts
        Number of linear systems that each solver solved.
    potential : array, (n1, n2)
        Potential, scaled to 1 at the inlet and 0 at the outlet; NaN in contact and in pockets.
    """

    permeability: float
    solve_counts: SolveCounts
    potential: Floats


def solve_surface_flow(
    gap: Floats,
    spacing: Pair,
    settings: FlowSettings = _DEFAULT_SETTINGS,
    sides: str = "periodic",
) -> FaceFlow:
    """Solve the flow along x1 through the gap of a whole surface.

    A surface of more than `LARGEST_FLOW` points is divided along x2 into parts, each of which is solved like a whole
    surface. If the settings contain a spiral, fluid can also flow along the spiral grooves and thus bypass closed
    lands.

    Parameters
    ----------
    gap : array, (n1, n2)
        Gap [m].
    spacing : tuple of two float
        Point spacing [m].
    settings : FlowSettings
        Fluid, solver and spiral.
    sides : "periodic" or "mirror"
        "periodic" if the surface is periodic along x2, "mirror" if no fluid flows across the sides of the surface.

    Raises
    ------
    NotConverged
        See `cell_permeability` and `flow.pressure_drop.solve_face`.
    """
    if gap.size > LARGEST_FLOW:
        parts = np.array_split(gap, ceil(gap.size / LARGEST_FLOW), axis=1)
        flows = [solve_surface_flow(part, spacing, settings, sides) for part in parts]
        widths = [part.shape[1] for part in parts]
        value = float(np.average([flow.permeability for flow in flows], weights=widths))
        potential = np.concatenate([flow.potential for flow in flows], axis=1)
        return FaceFlow(value, SolveCounts.total(flow.solve_counts for flow in flows), potential)
    counts = SolveCounts()

    def solve(gap: Array) -> tuple[float, Array, Permeability]:
        """Solve the flow for a fixed gap.

        Returns the permeability [m³], the fluid pressure (1 at the inlet, 0 at the outlet), and the whole solution.
        """
        nonlocal counts
        flow = cell_permeability(gap, spacing, sides=sides, solver=settings.solver)
        counts += SolveCounts.of(flow)
        if settings.spiral:
            along_grooves = spiral_flow(gap, spacing, settings.spiral, flow.fluid_pressure)
            if along_grooves:
                value, pressure = along_grooves
                flow = replace(flow, value=value, fluid_pressure=pressure, percolates=value > 0)
        return flow.value, flow.fluid_pressure, flow

    flow, drop = solve_face(settings.drop, np.asarray(gap, float), spacing, solve, PRESSURE_RTOL)
    value = flow.value * drop.reference_factor
    potential = drop.φ_fraction(flow.fluid_pressure)
    # The exact potential lies between 0 and 1. Because of the error of the solver, about
    # 1e-3 in the energy norm, the computed potential may lie slightly outside this range.
    return FaceFlow(value, counts, np.clip(potential, 0.0, 1.0))


def flow_sides(boundary: str) -> str:
    """Choose the boundary condition at the sides of the flow for a given boundary condition of the contact.

    If the contact is periodic, the flow is periodic, too. For all other boundary conditions of the contact, there is no
    flow through the sides ("mirror").
    """
    return "periodic" if boundary == "periodic" else "mirror"


def permeability_along_x2(
    gap: Floats, widths: tuple[int, ...], spacing: Pair, settings: FlowSettings, sides: str
) -> float:
    """Compute the permeability of a whole surface along x2, separately for each measured patch.

    Parameters
    ----------
    gap : array, (n1, n2)
        Gap [m].
    widths : tuple of int
        Number of points of each measured patch along x2.
    spacing : tuple of two float
        Point spacing [m].
    settings : FlowSettings
        Fluid and solver.
    sides : "periodic" or "mirror"
        Condition at the sides of the flow, see `solve_surface_flow`. The sides of a flow along x2 are the ends of the
        surface along x1.

    Returns
    -------
    float
        Mean permeability of the patches, weighted by their widths [m³].

    Raises
    ------
    NotConverged
        See `solve_surface_flow`.
    """
    patches = split_patches(gap, widths)
    values = [
        solve_surface_flow(
            np.ascontiguousarray(patch.T), spacing[::-1], settings, sides
        ).permeability
        for patch in patches
    ]
    return float(np.average(values, weights=[patch.shape[1] for patch in patches]))


def drop_fractions(
    gap: Array,
    spacing: Pair,
    potential: Floats,
    settings: FlowSettings,
) -> Array:
    """Compute the fraction of the total dissipation that occurs in each pixel (n1, n2); NaN if there is no flow.

    Parameters
    ----------
    gap : array, (n1, n2)
        Gap [m].
    spacing : tuple of two float
        Point spacing [m].
    potential : array, (n1, n2)
        Potential of the flow, see `FaceFlow`.
    settings : FlowSettings
        Settings with which the flow was computed.
    """
    drop = settings.drop
    pressure: Array | float = 0.0
    if drop.law.depends_on_pressure:
        # where nothing flows the potential is NaN; any pressure can be used there
        known = np.nan_to_num(potential, nan=0.5)
        pressure = pressure_between(drop.fluid, drop.inlet, drop.outlet, known)
        pressure = np.maximum(pressure, drop.least_pressure)
    equivalent = drop.law.equivalent_gap(gap, pressure)
    # with a spiral, the grooves of the last column continue in other rows of the first one, so there is no seam
    dissipation = pixel_dissipation(equivalent, spacing, potential, seam=settings.spiral is None)
    total = dissipation.sum()
    return dissipation / total if total > 0 else np.full(dissipation.shape, np.nan)
