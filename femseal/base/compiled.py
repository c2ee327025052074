"""Compiled loops over large arrays, and the threads of this process that share them: of any number, the same bits.

Parts depend on the size of an array only, and what they return is summed in their order. Loops are compiled once on a
machine, and so that they run without the lock of the interpreter, as transforms do. Numba would also make an entry for
calls from C, and one from Python for functions that only compiled ones call: these are a twelfth of the time of
compiling.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, wraps
from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload, register_jitable

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
    return parts(n1, max(1.0, _POINTS / n2))


def on_threads(threads: int, work: Callable[..., Any], items: Iterable[Any]) -> list[Any]:
    """The values of `work` of items, in their order, found by this thread and others, each taking the next item."""
    items = list(items)
    if min(threads, len(items)) == 1:
        return [work(item) for item in items]
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
    return on_threads(_number, lambda part: work(*part, *arguments), pieces)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads - 1, "femseal")


#: Options of functions that may take sums in another order, and divide by zero.
REORDERED: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "no_cfunc_wrapper": True}


def compiled(**options: Any) -> Callable[[Any], Any]:
    """Decorator of a function that is compiled, with further options of numba."""
    decorator: Callable[[Any], Any] = njit(**_OPTIONS, **options)
    return decorator


def inner(**options: Any) -> Callable[[Any], Any]:
    """Decorator of a function that only compiled ones call: a call from Python would end the process."""
    return compiled(no_cpython_wrapper=True, **options)


def leader(**options: Any) -> Callable[[Any], Any]:
    """Decorator of a function that calls compiled ones: from Python with threads, or as a part of a compiled one."""
    decorator: Callable[[Any], Any] = register_jitable(**options)
    return decorator


def by_rows(**options: Any) -> Callable[[Any], Any]:
    """Decorator of a compiled loop over the rows `first` to `end` of a field, its first three arguments.

    It is called without the first two, for all rows within the field's border of one point: from Python in parts,
    shared by the threads, else at once.
    """

    def decorated(function: Any) -> Any:
        loop = compiled(**options)(function)

        @wraps(function)
        def shared(field: Any, *arguments: Any) -> None:
            n1, n2 = field.shape[:2]
            pieces = [(first + 1, end + 1) for first, end in rows(n1 - 2, n2)]
            over(pieces, loop, field, *arguments)

        @overload(shared)
        def _at_once(field: Any, *arguments: Any) -> Callable[..., None]:
            def at_once(field: Any, *arguments: Any) -> None:
                loop(ONE, field.shape[0] - 1, field, *arguments)

            return at_once

        return shared

    return decorated


def by_items(merged: Callable[[list[Any]], Any], **options: Any) -> Callable[[Any], Any]:
    """Decorator of a compiled loop over the items `first` to `end` of lists, its first two arguments.

    It is called with the number of items in place of these: from Python in parts, shared by the threads, whose values
    are `merged`, else at once.
    """

    def decorated(function: Any) -> Any:
        loop = compiled(**options)(function)

        @wraps(function)
        def shared(n: int, *arguments: Any) -> Any:
            return merged(over(parts(n, _ITEMS), loop, *arguments))

        @overload(shared, jit_options=options)  # type: ignore[arg-type]
        def _at_once(n: int, *arguments: Any) -> Callable[..., Any]:
            def at_once(n: int, *arguments: Any) -> Any:
                return loop(ZERO, n, *arguments)

            return at_once

        return shared

    return decorated


def summed(values: list[Any]) -> Any:
    """The sum of numbers, those of each column of tuples, or None of nothing."""
    if isinstance(values[0], tuple):
        return tuple(map(sum, zip(*values, strict=True)))
    return None if values[0] is None else sum(values)
