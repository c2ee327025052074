"""Flow through one piece of a face: its permeability along an axis.

Of an ensemble of solutions: failures with their reason, and numbers of solutions by solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from ..base import Array, FemsealError, Pair
from ..flow import Spiral
from ..flow.cell import cell_flow
from ..flow.pressure_drop import VISCOUS, PressureDrop
from ..flow.solution import check_solver

Result = TypeVar("Result")


@dataclass(frozen=True)
class Failed:
    """The outcome of a solution that failed, in the place of its result; the other solutions of the ensemble go on.

    reason : message of the error.
    """

    reason: str


def attempt(solve: Callable[..., Result], *arguments: Any, **options: Any) -> Result | Failed:
    """Call `solve` with the arguments; return its result, or `Failed` if it raises a `FemsealError`."""
    try:
        return solve(*arguments, **options)
    except FemsealError as error:
        return Failed(str(error))


@dataclass(frozen=True)
class SolverCounts:
    """How many linear systems each solver solved.

    systems : name of each solver that solved any, and their number.
    worst_imbalance : largest relative difference of inlet and outlet flow of all systems.

    >>> SolverCounts((("elimination", 2),), 1e-15) + SolverCounts((("amg", 1), ("elimination", 1)), 1e-9)
    SolverCounts(systems=(('amg', 1), ('elimination', 3)), worst_imbalance=1e-09)
    """

    systems: tuple[tuple[str, int], ...] = ()
    worst_imbalance: float = 0.0

    @classmethod
    def of(cls, flow: Any) -> SolverCounts:
        """The count of one flow, by its `solver` and `imbalance`; empty if there was no system to solve."""
        return cls() if flow.solver == "none" else cls(((flow.solver, 1),), flow.imbalance)

    def __add__(self, other: SolverCounts) -> SolverCounts:
        return self.total((self, other))

    @classmethod
    def total(cls, counts: Iterable[SolverCounts]) -> SolverCounts:
        """Add them all up."""
        systems: dict[str, int] = {}
        worst = 0.0
        for one in counts:
            for solver, number in one.systems:
                systems[solver] = systems.get(solver, 0) + number
            worst = max(worst, one.worst_imbalance)
        return cls(tuple(sorted(systems.items())), worst)


@dataclass(frozen=True)
class SolveCounts:
    """Numbers of flows through pieces.

    solved : flows with an open path, which a linear solver solved. closed : flows without one, which are 0.
    solvers : number of systems by solver.

    >>> one, two = SolveCounts(solved=2), SolveCounts(solved=1, closed=3)
    >>> SolveCounts.total((one, two)) == SolveCounts(solved=3, closed=3)
    True
    """

    solved: int = 0
    closed: int = 0
    solvers: SolverCounts = field(default_factory=SolverCounts)

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """Add them all up."""
        counts = list(counts)
        solved, closed = sum(c.solved for c in counts), sum(c.closed for c in counts)
        return cls(solved, closed, SolverCounts.total(c.solvers for c in counts))


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


@dataclass(frozen=True, eq=False)
class PiecePermeability:
    """Permeability k of a piece at every pressure of the drop [m³]; the one flow, counted as solved or closed."""

    k: Array
    counts: SolveCounts


def piece_permeability(
    gap: Array, spacing: Pair, axis: int, settings: FlowSettings | None = None
) -> PiecePermeability:
    """Permeability along `axis` of a piece (n1, n2) [m] with closed sides.

    Raises NotConverged: the linear solver failed.
    """
    settings = settings or FlowSettings()
    drop, k, solvers = settings.drop, np.zeros(settings.drop.pressures.size), []
    for n, p in enumerate(drop.pressures):
        equivalent = drop.law.equivalent_gap(gap, p)
        cell = cell_flow(equivalent, spacing, axis=axis, sides="mirror", solver=settings.solver)
        k[n] = cell.permeability
        solvers.append(SolverCounts.of(cell.flow))
        if k[0] == 0:  # closed at every pressure
            break
    # one flow, however many systems were solved for it
    is_open = cell.flow.percolates
    return PiecePermeability(
        k, SolveCounts(int(is_open), int(not is_open), SolverCounts.total(solvers))
    )
