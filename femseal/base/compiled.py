"""How functions are compiled: once on a machine, and so that they run without the lock of the interpreter.

Numba would also make an entry for calls from C, and one from Python for functions that only compiled ones call: these
are a twelfth of the time of compiling.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

from numba import njit
from numba.extending import overload, register_jitable

from .threads import ONE, ZERO, items, over, rows

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
            parts = [(first + 1, end + 1) for first, end in rows(n1 - 2, n2)]
            over(parts, loop, field, *arguments)

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
            return merged(over(items(n), loop, *arguments))

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
