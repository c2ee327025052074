"""Stages of a study: what is computed for each of many items, under a name that people read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

#: Computes a stage for all items, as the builtin `map` does: mapper(stage, *iterables) gives the results in the order
#: of the items, whoever computes them.
Mapper = Callable[..., Iterable[Any]]


@dataclass(frozen=True)
class Stage:
    """A part of a study that is computed for many items, each by itself.

    Parameters
    ----------
    name : what the stage computes, as progress, log, timings and report say it.
    function : what is called for each item; processes get it as a pickle.
    memory : of one call [byte], 0 where it is small: processes of one machine make no more calls at once than fit.

    >>> stage = Stage("quotients", divmod)
    >>> stage.name, list(map(stage, [7, 9], [2, 2]))
    ('quotients', [(3, 1), (4, 1)])
    """

    name: str
    function: Callable[..., Any]
    memory: float = 0.0

    def __call__(self, *item: Any) -> Any:
        """The result of one item."""
        return self.function(*item)
