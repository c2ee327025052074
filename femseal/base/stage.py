"""Stages of a study: a function that is computed for each of many items, with a readable name."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

#: Computes a stage for all items, as the builtin `map` does: mapper(stage, *iterables) gives the results in the order
#: of the items, wherever they are computed.
Mapper = Callable[..., Iterable[Any]]


@dataclass(frozen=True)
class Stage:
    """A part of a study that is computed for many items independently.

    name : what the stage computes; progress, log, timings and report show it.
    function : called for each item; processes get it as a pickle.
    memory : of one call [byte], 0 if it is small; a machine runs no more calls at once than fit in its memory.
    key : by which a store finds its results, with the items; the function unless given.

    >>> stage = Stage("quotients", divmod)
    >>> stage.name, list(map(stage, [7, 9], [2, 2]))
    ('quotients', [(3, 1), (4, 1)])
    """

    name: str
    function: Callable[..., Any]
    memory: float = 0.0
    key: Any = None

    def __call__(self, *item: Any) -> Any:
        """Compute the result of one item."""
        return self.function(*item)
