"""Rank several runs by their leakage, and find runs whose order is uncertain because their intervals overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base import Array

#: Number of runs that a sentence names.
_MOST_LISTED = 5


class RankRange(NamedTuple):
    """Best and worst rank that a run can have within its 95 % interval; a run with rank 1 leaks least."""

    best: int
    worst: int

    def __str__(self) -> str:
        return str(self.best) if self.best == self.worst else f"{self.best}–{self.worst}"


@dataclass(frozen=True, eq=False)
class Ranking:
    """Ranking of several runs by their leakage at a load.

    Attributes
    ----------
    load : str
        Load at which the runs are ranked, as text.
    names : sequence of str
        Labels of the runs.
    leakage : array
        Absolute value of the leakage of each run, (run,), all in the same unit; NaN if it is unknown.
    lower, upper : array
        Lower and upper ends of the 95 % interval of the leakage of each run, (run,). For a run without an interval,
        `lower` and `upper` are equal to the leakage.
    has_intervals : bool
        True if all runs have an interval.
    """

    load: str
    names: Sequence[str]
    leakage: Array
    lower: Array
    upper: Array
    has_intervals: bool

    def ranks(self) -> list[RankRange | None]:
        """Return the ranks that each run can have within its 95 % interval, or None if its leakage is unknown."""
        known = np.isfinite(self.leakage)
        ranks: list[RankRange | None] = []
        for run in range(len(self.leakage)):
            if not known[run]:
                ranks.append(None)
                continue
            # numbers of runs whose whole interval lies below or above the interval of this run
            surely_less = int((self.upper[known] < self.lower[run]).sum())
            surely_more = int((self.lower[known] > self.upper[run]).sum())
            ranks.append(RankRange(1 + surely_less, int(known.sum()) - surely_more))
        return ranks

    @property
    def best(self) -> int | None:
        """Index of the run with the smallest computed leakage, None if no leakage is known."""
        if not np.isfinite(self.leakage).any():
            return None
        return int(np.nanargmin(self.leakage))

    def sentence(self) -> str:
        """Say which run leaks least, and which runs have intervals that overlap its interval."""
        best = self.best
        if best is None or np.isfinite(self.leakage).sum() < 2:
            return ""
        subject = f"At {self.load}, {self.names[best]} leaks least as computed"
        if not self.has_intervals:
            return f"{subject}; without error budgets it is not known whether the runs differ."
        is_known = np.isfinite(self.leakage)
        overlaps = self.lower <= self.upper[best]
        overlapping = [
            name
            for run, name in enumerate(self.names)
            if run != best and is_known[run] and overlaps[run]
        ]
        if not overlapping:
            return f"{subject}, and also with the whole 95 % intervals."
        others = _listed(overlapping)
        return (
            f"{subject}. Its 95 % interval overlaps with that of {others}: the intervals do not tell them apart. "
            "If the runs share errors, for example those of one surface, the order is more certain than that."
        )


def _listed(names: list[str]) -> str:
    """Join names into one string; of a long list, give only the first names and the number of the others."""
    if len(names) > _MOST_LISTED:
        first_names = ", ".join(names[:_MOST_LISTED])
        return f"{first_names} and {len(names) - _MOST_LISTED} more"
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"
