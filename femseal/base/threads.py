"""Work on the parts of large arrays by the threads of this process, with the same bits for any number of them.

Parts depend on the size of an array only, and what they return is summed in their order. Compiled loops and transforms
leave the interpreter to the other threads while they work.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

#: Threads of this process for work on one array, 1 while as many other processes as there are cores are at work.
_number = 1
#: Points in a part of an array of two axes.
_POINTS = 2**17
#: Items of a list in a part: loops over it take a few tenths of a millisecond.
_ITEMS = 2**16
#: Arguments of compiled functions that work on parts, where another one calls them for the whole: numba would compile
#: them once more for a constant 0, 1, False or True.
ZERO, ONE, NO, YES = np.int64(0), np.int64(1), np.bool_(False), np.bool_(True)


def number() -> int:
    """Threads that may share the work on an array."""
    return _number


@contextmanager
def using(threads: int) -> Iterator[None]:
    """Context in which so many threads share the work on an array."""
    global _number
    before, _number = _number, threads
    try:
        yield
    finally:
        _number = before


def parts(n: int, length: float) -> list[tuple[int, int]]:
    """First and last + 1 of equal parts of n items, each of about `length` of them."""
    number = max(1, round(n / length))
    return [(n * i // number, n * (i + 1) // number) for i in range(number)]


def rows(n1: int, n2: int) -> list[tuple[int, int]]:
    """First and last + 1 of the parts of the rows of an array (n1, n2), one where it is small."""
    return [(0, n1)] if n1 * n2 <= _POINTS else parts(n1, max(1.0, _POINTS / max(1, n2)))


def items(n: int) -> list[tuple[int, int]]:
    """First and last + 1 of the parts of a list of n items."""
    return parts(n, _ITEMS)


def on_threads(threads: int, work: Callable[..., Any], items: Iterable[Any]) -> list[Any]:
    """The values of `work` of items, in their order, found by this thread and others, each taking the next item."""
    if threads == 1:
        return list(map(work, items))
    items = list(items)
    values: list[Any] = [None] * len(items)
    numbers = iter(range(len(items)))

    def take() -> None:
        for i in numbers:
            values[i] = work(items[i])

    others = [_pool(threads).submit(take) for _ in range(min(threads, len(items)) - 1)]
    take()
    for other in others:
        other.result()
    return values


def over(pieces: list[tuple[Any, ...]], work: Callable[..., Any], *arguments: Any) -> list[Any]:
    """The values of `work` of parts, and of arguments that are the same for all, found by `number` threads."""
    if len(pieces) == 1:
        return [work(*pieces[0], *arguments)]
    return on_threads(_number, lambda part: work(*part, *arguments), pieces)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads - 1, "femseal")
