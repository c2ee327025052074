"""What comes out of many solutions: which of them failed and why, and how many were solved or known without."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

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


@dataclass(frozen=True)
class SolveCounts:
    """How many flows of windows were solved, and how many were known without a solution.

    solved : by a linear solver. closed : without an open path, where nothing flows. open : between nearly parallel
    plates, from the closed form.

    >>> SolveCounts(solved=2) + SolveCounts(solved=1, closed=3)
    SolveCounts(solved=3, closed=3, open=0)
    """

    solved: int = 0
    closed: int = 0
    open: int = 0

    def __add__(self, other: SolveCounts) -> SolveCounts:
        return SolveCounts(self.solved + other.solved, self.closed + other.closed, self.open + other.open)

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
