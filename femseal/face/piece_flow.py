"""Flow through a whole face at full resolution, and through one piece of it: its permeability along an axis.

Of an ensemble of solutions: failures with their reason, and numbers of solutions by solver.
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
#: Relative error at which flows end that depend on the pressure; the factor of a gas itself is within 0.9 %.
PRESSURE_RTOL = 1e-4
#: Points of the largest face whose flow is solved as a whole: with contact it takes 9 GB.
LARGEST_FLOW = 2**26


@dataclass(frozen=True)
class Failed:
    """The outcome of a solution that failed, in the place of its result; the other solutions of the ensemble go on.

    reason : message of the error. permeability, per_length : NaN, where others have theirs.
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
    """How many linear systems each solver solved, and numbers of flows through pieces.

    systems : name of each solver that solved any, and their number.
    worst_imbalance : largest relative difference of inlet and outlet flow of all systems.
    solved : flows through pieces with an open path, which a linear solver solved. closed : flows without one, 0.

    >>> SolveCounts((("elimination", 2),), 1e-15) + SolveCounts((("amg", 1), ("elimination", 1)), 1e-9, solved=2)
    SolveCounts(systems=(('amg', 1), ('elimination', 3)), worst_imbalance=1e-09, solved=2, closed=0)
    """

    systems: tuple[tuple[str, int], ...] = ()
    worst_imbalance: float = 0.0
    solved: int = 0
    closed: int = 0

    @classmethod
    def of(cls, flow: Any) -> SolveCounts:
        """The count of one flow, by its `solver` and `imbalance`; empty if there was no system to solve."""
        return cls() if flow.solver == "none" else cls(((flow.solver, 1),), flow.imbalance)

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return self.total((self, other))

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """Add them all up."""
        counts, systems = list(counts), Counter[str]()
        for one in counts:
            systems.update(dict(one.systems))
        worst = max((one.worst_imbalance for one in counts), default=0.0)
        solved = sum(one.solved for one in counts)
        closed = sum(one.closed for one in counts)
        return cls(tuple(sorted(systems.items())), worst, solved, closed)


@dataclass(frozen=True)
class FlowSettings:
    """How the flow through a face and its pieces is solved, see `cell_permeability`, and of what fluid.

    spiral : how the grooves of a whole face wind, see `femseal.flow.spiral`; None for rings.

    Raises InputError: an unknown solver.
    """

    solver: str = "auto"
    drop: PressureDrop = VISCOUS
    spiral: Spiral | None = None

    def __post_init__(self) -> None:
        check_solver(self.solver)


#: Settings unless given.
_PLAIN = FlowSettings()


@dataclass(frozen=True, eq=False)
class PiecePermeability:
    """Permeability k of a piece at every pressure of the drop [m³]; the one flow, counted as solved or closed."""

    k: Array
    counts: SolveCounts


def piece_permeability(
    gap: Array,
    spacing: Pair,
    axis: int,
    settings: FlowSettings = _PLAIN,
    core: tuple[int, int] | None = None,
) -> PiecePermeability:
    """Permeability along `axis` of a piece (n1, n2) [m] with closed sides.

    core : the part of the piece across the flow whose permeability is wanted, see `cell_flow`; None for all of it.

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
    return PiecePermeability(k, replace(counts, solved=int(is_open), closed=int(not is_open)))


def strip_permeability(gap: Array, spacing: Pair, settings: FlowSettings = _PLAIN) -> float:
    """Permeability [m³] along x1 of a strip (n1, n2) [m] with closed sides, at the mean pressure of its ends.

    Raises NotConverged: the linear solver failed.
    """
    drop = settings.drop
    pressure = (drop.inlet + drop.outlet) / 2 if drop.law.depends_on_pressure else drop.inlet
    equivalent = drop.law.equivalent_gap(gap, pressure)
    cell = cell_flow(equivalent, spacing, axis=0, sides="mirror", solver=settings.solver)
    return cell.permeability


@dataclass(frozen=True, eq=False)
class FaceFlow:
    """Flow along x1 through a whole face.

    permeability : that which the drop of the viscous potential sees [m³]. solvers : of its systems.
    potential : between 1 at the inlet and 0 at the outlet (n1, n2), NaN in contact and in pockets.
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
    """Solve the flow along x1 through the gap (n1, n2) [m] of a whole face.

    A face of more than `LARGEST_FLOW` points is solved in parts along x2, each continued periodically by itself.
    Grooves that wind carry fluid past closed lands where the settings have a spiral.

    sides : "periodic" where the face continues along x2, "mirror" where nothing flows across its sides.

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
        if settings.spiral and (
            wound := spiral_flow(gap, spacing, settings.spiral, flow.fluid_pressure)
        ):
            flow = replace(flow, value=wound[0], fluid_pressure=wound[1], percolates=wound[0] > 0)
        return flow.value, flow.fluid_pressure, flow

    flow, drop = settings.drop.solve_face(np.asarray(gap, float), spacing, solve, PRESSURE_RTOL)
    value, potential = flow.value * drop.mean_factor, drop.viscous_fraction(flow.fluid_pressure)
    # the potential has no extremes inside; the solver's error, about 1e-3 in the norm of the energy, may give it some
    return FaceFlow(value, counts, np.clip(potential, 0.0, 1.0))


def flow_sides(boundary: str) -> str:
    """Return the sides of a flow along which the surface has a boundary: closed ("mirror") unless it is periodic."""
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
    """Fraction of the pressure drop at each pixel (n1, n2): of the dissipation of the flow; NaN where nothing flows.

    gap : (n1, n2) [m]. potential : see `FaceFlow`.
    """
    drop = settings.drop
    pressure: Array | float = 0.0
    if drop.law.depends_on_pressure:
        known = np.nan_to_num(potential, nan=0.5)
        pressure = pressure_between(drop.fluid, drop.inlet, drop.outlet, known)
        pressure = np.maximum(pressure, drop.least_pressure)
    equivalent = drop.law.equivalent_gap(gap, pressure)
    # grooves that wind leave the last column for another row of the first one
    found = pixel_dissipation(equivalent, spacing, potential, seam=settings.spiral is None)
    whole = found.sum()
    return found / whole if whole > 0 else np.full(found.shape, np.nan)
