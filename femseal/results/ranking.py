"""Rank several runs by their leakage, and say which of them their 95 % intervals cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base import Array


class RankRange(NamedTuple):
    """Best and worst rank that the interval of a run allows, from 1 for the least leakage."""

    best: int
    worst: int

    def __str__(self) -> str:
        return str(self.best) if self.best == self.worst else f"{self.best}–{self.worst}"


@dataclass(frozen=True, eq=False)
class Ranking:
    """Runs ranked at one load.

    Attributes
    ----------
    load : str
        The load as text.
    names : sequence of str
        Names of the runs for people.
    leakage : array
        Size of the leakage (run,), in one unit; NaN if it is not known.
    lower, upper : array
        Ends of the 95 % interval (run,); the leakage itself of a run without an interval.
    has_intervals : bool
        Whether all runs have an interval.
    """

    load: str
    names: Sequence[str]
    leakage: Array
    lower: Array
    upper: Array
    has_intervals: bool

    def ranks(self) -> list[RankRange | None]:
        """Return the ranks that the interval of each run allows; None for a run whose leakage is not known."""
        known = np.isfinite(self.leakage)
        ranks: list[RankRange | None] = []
        for run in range(len(self.leakage)):
            if not known[run]:
                ranks.append(None)
                continue
            surely_less = int((self.upper[known] < self.lower[run]).sum())
            surely_more = int((self.lower[known] > self.upper[run]).sum())
            ranks.append(RankRange(1 + surely_less, int(known.sum()) - surely_more))
        return ranks

    @property
    def best(self) -> int | None:
        """The run that leaks least as computed; None if no leakage is known."""
        if not np.isfinite(self.leakage).any():
            return None
        return int(np.nanargmin(self.leakage))

    def sentence(self) -> str:
        """Say which run leaks least, and which runs cannot be told apart from it."""
        best = self.best
        if best is None or np.isfinite(self.leakage).sum() < 2:
            return ""
        subject = f"At {self.load}, {self.names[best]} leaks least as computed"
        if not self.has_intervals:
            return f"{subject}; without error budgets it is not known whether the runs differ."
        reaches = self.lower <= self.upper[best]
        alike = [
            name
            for run, name in enumerate(self.names)
            if run != best and np.isfinite(self.leakage[run]) and reaches[run]
        ]
        if not alike:
            return f"{subject}, and also with the whole 95 % intervals."
        return (
            f"{subject}. Its 95 % interval overlaps with that of {_listed(alike)}: they cannot be told apart by it. "
            "Errors that the runs share, such as those of one surface, make the order more certain than that."
        )


def _listed(names: list[str], most: int = 5) -> str:
    """List names; of many, the first ones and how many more there are."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
