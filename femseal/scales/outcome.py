"""What comes out of many solutions: which of them failed and why, and how many were solved or known without."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from ..base.errors import FemsealError

Result = TypeVar("Result")


@dataclass(frozen=True)
class Failed:
    """One solution of many that failed; the others are not touched by it.

    reason : the message of the error.
    """

    reason: str


def attempt(solve: Callable[..., Result], *arguments: Any, **options: Any) -> Result | Failed:
    """What `solve` returns for these arguments, or `Failed` where it raises a `FemsealError`."""
    try:
        return solve(*arguments, **options)
    except FemsealError as error:
        return Failed(str(error))


class Solved(Protocol):
    """Part of a `Permeability` or a `Leakage`: what is known of its linear system."""

    @property
    def solver(self) -> str:
        """Name of the solver, "none" where there was no system to solve."""

    @property
    def imbalance(self) -> float:
        """Relative difference of inlet and outlet flow."""


@dataclass(frozen=True)
class SolverCounts:
    """Linear systems by the solver that solved them.

    systems : each solver that solved any, and how many.
    worst_imbalance : largest relative difference of inlet and outlet flow.

    >>> SolverCounts((("elimination", 2),), 1e-15) + SolverCounts((("amg", 1), ("elimination", 1)), 1e-9)
    SolverCounts(systems=(('amg', 1), ('elimination', 3)), worst_imbalance=1e-09)
    """

    systems: tuple[tuple[str, int], ...] = ()
    worst_imbalance: float = 0.0

    @classmethod
    def of(cls, flow: Solved) -> SolverCounts:
        """That of one flow; none where there was no system to solve."""
        return cls() if flow.solver == "none" else cls(((flow.solver, 1),), flow.imbalance)

    def __add__(self, other: SolverCounts) -> SolverCounts:
        systems = Counter(dict(self.systems)) + Counter(dict(other.systems))
        return SolverCounts(tuple(sorted(systems.items())), max(self.worst_imbalance, other.worst_imbalance))

    @classmethod
    def total(cls, counts: Iterable[SolverCounts]) -> SolverCounts:
        """The sum of all."""
        return sum(counts, start=cls())

    def by_solver(self) -> dict[str, int]:
        """Number of systems by the name of their solver."""
        return dict(self.systems)


@dataclass(frozen=True)
class SolveCounts:
    """How many flows of windows were solved, and how many were known without a solution.

    solved : by a linear solver. closed : without an open path, where nothing flows. open : between nearly parallel
    plates, from the closed form. solvers : which solver solved how many.

    >>> SolveCounts(solved=2) + SolveCounts(solved=1, closed=3) == SolveCounts(solved=3, closed=3)
    True
    """

    solved: int = 0
    closed: int = 0
    open: int = 0
    solvers: SolverCounts = field(default_factory=SolverCounts)

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return SolveCounts(
            self.solved + other.solved,
            self.closed + other.closed,
            self.open + other.open,
            self.solvers + other.solvers,
        )

    @property
    def flows(self) -> int:
        """All of them."""
        return self.solved + self.closed + self.open

    @classmethod
    def total(cls, counts: Iterable[SolveCounts]) -> SolveCounts:
        """The sum of all."""
        return sum(counts, start=cls())

    def by_kind(self) -> dict[str, int]:
        """The numbers by their names."""
        return {"solved": self.solved, "closed": self.closed, "open": self.open}
