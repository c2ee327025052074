"""Flow through one piece of a face: its permeability along an axis.

Of an ensemble of solutions: failures with their reason, and numbers of solutions by solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from ..base import Array, FemsealError, Pair
from ..flow import Spiral
from ..flow.cell import cell_flow
from ..flow.law import cubic_law
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

    def by_solver(self) -> dict[str, int]:
        """Number of systems, by the name of their solver."""
        return dict(self.systems)


@dataclass(frozen=True)
class SolveCounts:
    """Numbers of flows through pieces that were solved, or known without solving.

    solved : flows with an open path, which a linear solver solved.
    closed : flows without an open path, which are 0.
    open : flows between nearly parallel plates, which the closed form gives.
    solvers : number of systems by solver.

    >>> SolveCounts(solved=2) + SolveCounts(solved=1, closed=3) == SolveCounts(solved=3, closed=3)
    True
    """

    solved: int = 0
    closed: int = 0
    open: int = 0
    solvers: SolverCounts = field(default_factory=SolverCounts)

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return self.total((self, other))

    @property
    def flows(self) -> int:
        """Number of all flows: solved, closed and open."""
        return self.solved + self.closed + self.open

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """Add them all up."""
        counts = list(counts)
        numbers = {
            kind: sum(getattr(c, kind) for c in counts) for kind in ("solved", "closed", "open")
        }
        return cls(**numbers, solvers=SolverCounts.total(c.solvers for c in counts))

    def by_kind(self) -> dict[str, int]:
        """The numbers of solved, closed and open flows, by these names."""
        return {"solved": self.solved, "closed": self.closed, "open": self.open}


#: Below this ratio of rms gap variation to mean gap parallel plates are exact to 2e-4 whatever the lay.
OPEN_RATIO = 0.005


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
    """Permeability k of a piece at every pressure of the drop [m³]; the one flow, counted as solved, closed or open."""

    k: Array
    counts: SolveCounts


def piece_permeability(
    gap: Array, spacing: Pair, axis: int, settings: FlowSettings | None = None
) -> PiecePermeability:
    """Permeability along `axis` of a piece (n1, n2) [m] with closed sides: of about parallel plates that of their mean.

    Raises NotConverged: the linear solver failed.
    """
    settings = settings or FlowSettings()
    drop, found = settings.drop, []
    for p in drop.pressures:
        found.append(_of_gap(drop.law.equivalent_gap(gap, p), spacing, axis, settings))
        if found[0][0] == 0:  # closed at every pressure
            found *= drop.pressures.size
            break
    counts = found[0][1]
    if len(found) > 1:  # one flow, however many systems were solved for it
        counts = replace(counts, solvers=SolverCounts.total(one.solvers for _, one in found))
    return PiecePermeability(np.array([k for k, _ in found]), counts)


def _of_gap(
    gap: Array, spacing: Pair, axis: int, settings: FlowSettings
) -> tuple[float, SolveCounts]:
    """Permeability of a gap by the cubic law; that of nearly parallel plates in closed form."""
    mean = float(gap.mean())
    if gap.min() > 0 and gap.std() < OPEN_RATIO * mean:  # nearly parallel plates
        return cubic_law(mean), SolveCounts(open=1)
    cell = cell_flow(gap, spacing, axis=axis, sides="mirror", solver=settings.solver)
    solvers = SolverCounts.of(cell.flow)
    counts = (
        SolveCounts(solved=1, solvers=solvers)
        if cell.flow.percolates
        else SolveCounts(closed=1, solvers=solvers)
    )
    return cell.permeability, counts
