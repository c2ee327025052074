"""Outcomes of an ensemble of solutions: failures with their reason, and numbers of solutions by solver."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from ..base.errors import FemsealError

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


class Solved(Protocol):
    """The fields of a `Permeability` or a `Leakage` about its linear system."""

    @property
    def solver(self) -> str:
        """Name of the solver; "none" if there was no system to solve."""

    @property
    def imbalance(self) -> float:
        """Relative difference of inlet and outlet flow."""


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
    def of(cls, flow: Solved) -> SolverCounts:
        """The count of one flow; empty if there was no system to solve."""
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
    """Numbers of window flows that were solved, or known without solving.

    solved : flows with an open path, which a linear solver solved.
    closed : flows without an open path, which are 0.
    open : flows between nearly parallel plates, which the closed form gives.
    equal : flows through a gap that the window had at an earlier step.
    solvers : number of systems by solver.

    >>> SolveCounts(solved=2) + SolveCounts(solved=1, closed=3) == SolveCounts(solved=3, closed=3)
    True
    """

    solved: int = 0
    closed: int = 0
    open: int = 0
    equal: int = 0
    solvers: SolverCounts = field(default_factory=SolverCounts)

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return self.total((self, other))

    @property
    def flows(self) -> int:
        """Number of all flows: solved, closed, open and equal."""
        return self.solved + self.closed + self.open + self.equal

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """Add them all up."""
        counts = list(counts)
        solved, closed, opened, equal = (
            sum(getattr(c, kind) for c in counts) for kind in ("solved", "closed", "open", "equal")
        )
        return cls(solved, closed, opened, equal, SolverCounts.total(c.solvers for c in counts))

    def by_kind(self) -> dict[str, int]:
        """The numbers of solved, closed and open flows, and of equal ones if there are any, by these names."""
        numbers = {"solved": self.solved, "closed": self.closed, "open": self.open}
        return numbers | ({"equal": self.equal} if self.equal else {})
