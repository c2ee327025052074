"""Describe a stage of a study: a function that is computed for many independent items, with a readable name."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

#: Computes a stage for all items, like the builtin `map`: mapper(stage, *iterables) returns the results in the order
#: of the items, wherever they are computed.
Mapper = Callable[..., Iterable[Any]]


@dataclass(frozen=True)
class Stage:
    """Describe a computation that is repeated for many independent items.

    Parameters
    ----------
    name : str
        What the stage computes. The progress, the log, the timings and the report show it.
    function : callable
        Computes one item. It must be picklable, because it is sent to other processes.
    memory : float
        Memory that one call needs [byte], 0 if it is small. No more calls run at once than fit in the memory.
    key : object
        Identifies the results of this stage in the store, together with the items. Default: the function.

    Examples
    --------
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
