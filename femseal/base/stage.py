"""Describe a stage of a study: a function that is evaluated for many independent items, with a readable name."""

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
        Readable description of the computation, for the progress display, the log, the timings and the report.
    function : callable
        Function that computes the result of one item. It must be picklable, because it is sent to other processes.
    memory : float
        Memory that one call of `function` needs [byte], or 0 if this memory is negligible. The memory limits the number
        of simultaneous calls.
    key : object
        Object that identifies the results of this stage in the store, together with the items. Default: the function.

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
