"""Compile loops over large arrays with Numba, and divide their work between the threads of this process.

Results are identical to the last bit for any number of threads: the division of an array into parts only depends on its
size, and the parts are summed in a fixed order.

Compiled loops are cached on disk. They release the global interpreter lock (GIL), so that several threads can run them
at the same time. By default, Numba also compiles two entry points for each function: one for calls from C, and one for
calls from Python. This module always omits the entry point for C. It also omits the one for Python if the function is
only called from compiled code. This saves a twelfth of the compile time.
"""

import gc
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, wraps
from inspect import signature
from typing import Any

import numpy as np
from numba import njit, typeof
from numba.core import event
from numba.extending import overload, register_jitable

#: Number of threads that share the work on one array: 1 while other processes use all cores. Each thread that calls
#: functions of the package has its own number.
_threads = ContextVar("threads", default=1)
#: Approximate number of points in each part of a two-dimensional array.
_POINTS = 2**17
#: Approximate number of items in each part of a list. A loop over so many items takes a few tenths of a millisecond.
_ITEMS = 2**16
#: Typed constants for calls of compiled functions. In Numba, a literal False or True has a separate type, so that a
#: call with a literal would compile the function once more.
NO, YES = np.bool_(False), np.bool_(True)


def thread_count() -> int:
    """Return the number of threads that may share the work on an array."""
    return _threads.get()


@contextmanager
def using_threads(threads: int) -> Iterator[None]:
    """Set the number of threads that may share the work of the calling thread on an array inside a `with` block."""
    previous = _threads.get()
    _threads.set(threads)
    try:
        yield
    finally:
        _threads.set(previous)


def parts(n: int, length: float) -> list[tuple[int, int]]:
    """Divide `n` items into consecutive parts of nearly equal size, each with about `length` items.

    Returns a pair of indices (first, end) for each part, which contains the items `first` to `end` − 1.
    """
    count = max(1, round(n / length))
    return [(n * i // count, n * (i + 1) // count) for i in range(count)]


def rows(n1: int, n2: int) -> list[tuple[int, int]]:
    """Divide the rows of an array (n1, n2) into consecutive parts; a small array is a single part.

    Returns a pair (first, end) for each part: the index of its first row, and the index of its last row plus 1.
    """
    return parts(n1, max(1.0, _POINTS / n2))


def on_threads(threads: int, work: Callable[..., Any], items: Iterable[Any]) -> list[Any]:
    """Call `work` for each item on several threads, and return the values in the order of the items.

    Parameters
    ----------
    threads : int
        Number of threads, including the calling thread. Each thread takes the next item as soon as it is free.
    work : callable
        Function that takes an item and returns a value.
    items : iterable
        The items.
    """
    items = list(items)
    if min(threads, len(items)) == 1:
        return [work(item) for item in items]
    values: list[Any] = [None] * len(items)
    # all threads draw from this iterator; next() on it is atomic
    indices = iter(range(len(items)))

    def work_on_remaining_items() -> None:
        for i in indices:
            values[i] = work(items[i])

    helpers = min(threads, len(items)) - 1
    futures = [_thread_pool(threads).submit(work_on_remaining_items) for _ in range(helpers)]
    work_on_remaining_items()
    for future in futures:
        future.result()
    return values


def over(ranges: list[tuple[Any, ...]], work: Callable[..., Any], *arguments: Any) -> list[Any]:
    """Call `work(*part, *arguments)` for each part of an array on the threads of this process.

    ranges : arguments of `work` for each part of the array, for example the ranges that `rows` returns.

    Returns the values in the order of the parts.
    """
    return on_threads(thread_count(), lambda part: work(*part, *arguments), ranges)


@cache
def _thread_pool(threads: int) -> ThreadPoolExecutor:
    """Make the pool of threads that work together with the calling thread."""
    return ThreadPoolExecutor(threads - 1, "femseal")


#: Options of Numba for functions in which sums may be reordered.
REORDERED: dict[str, Any] = {
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}
#: Options of all functions. If two functions have the same options, they share the functions of NumPy that they call,
#: which would otherwise be compiled for each of them. A division by zero gives inf or NaN: with the checks that Python
#: makes for each division, compiling the functions of a run takes 7 % longer.
_COMMON: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
_OPTIONS: dict[str, Any] = {"cache": True, **_COMMON}


class _FewerCollections(event.Listener):  # type: ignore[misc]
    """Let Python look for unreachable objects less often while Numba compiles.

    Numba creates millions of small objects. With the usual limits, looking for unreachable ones takes a tenth of the
    compile time. While Numba compiles a function, it also compiles the functions that this function calls, so that
    compilations can be nested.
    """

    #: Numbers of new objects, and of collections of younger objects, after which Python looks for unreachable objects.
    limits = 200_000, 50, 100

    def __init__(self) -> None:
        self.depth = 0
        self.usual_limits = gc.get_threshold()

    def on_start(self, _: Any) -> None:
        """Raise the limits when Numba begins to compile."""
        if self.depth == 0:
            self.usual_limits = gc.get_threshold()
            if self.usual_limits[0] > 0:  # 0 means that the user has switched this off
                gc.set_threshold(*self.limits)
        self.depth += 1

    def on_end(self, _: Any) -> None:
        """Restore the usual limits when the outermost function is compiled."""
        self.depth -= 1
        if self.depth == 0:
            gc.set_threshold(*self.usual_limits)


event.register("numba:compile", _FewerCollections())


def compiled(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator that compiles a function, with further options of Numba."""
    decorator: Callable[[Any], Any] = njit(**_OPTIONS, **options)
    return decorator


def inner(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator that compiles a function for calls from compiled functions only.

    Never call the decorated function from Python: the call would crash the interpreter.
    """
    return compiled(no_cpython_wrapper=True, **options)


def inlined(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator for a function that becomes a part of the compiled functions that call it.

    It is not compiled on its own, which takes less time if it has only one or two callers. Python must not call it.
    """
    return inner(inline="always", **options)


#: Entry points of compiled functions, see `entry_point`.
_entry_points: dict[Any, Callable[..., Any]] = {}


def entry_point(name: str, function: Any, *arguments: Any) -> Callable[..., Any]:
    """Return the compiled code of a function that is always called with arguments of the same types.

    Before each call, Numba compares the types of all arguments with those for which the function is compiled. With
    named tuples of 17 arrays, a call then takes 3.2 µs, as long as a whole loop on a small grid. A call of the entry
    point takes 0.8 µs. It does not check the types of its arguments.

    name : name of the entry point. A function that is called with arguments of several types has an entry point for
        each of them.
    arguments : arguments of a typical call, which determine the types. They only matter in the first call, because it
        would take longer to find their types than to solve a small problem. All later calls must have arguments of the
        same types, including the type of each number and the memory layout of each array.
    """
    key = name, function
    if key not in _entry_points:
        types = tuple(typeof(argument) for argument in arguments)
        function.compile(types)
        _entry_points[key] = function.get_overload(types)
    return _entry_points[key]


def leader(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator for a function that performs the steps of an algorithm by calling compiled functions in turn.

    If Python calls the decorated function, it runs in the interpreter, and the compiled functions divide their work
    between threads. If compiled code calls the decorated function, Numba compiles it as a part of this code.
    """
    decorator: Callable[[Any], Any] = register_jitable(**_COMMON, **options)
    return decorator


def inlined_leader(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator as `leader` does, but compiled callers contain the code of the decorated function.

    The optimiser of Numba works on a function together with all functions that it calls, once for the function itself
    and once for each of its direct and indirect callers. If a leader calls a leader, inlining the inner one saves one
    of these times. It takes over the options of its caller. Compiled code should call it in only one place; calls from
    Python do not matter.
    """

    def decorate(function: Any) -> Any:
        # Numba inlines each callee that has these two attributes of a compiled function
        function.targetoptions = {"inline": "always"}
        function.py_func = function
        return leader(**options)(function)

    return decorate


def by_rows(**options: Any) -> Callable[[Any], Any]:
    """Return a decorator that compiles a loop over rows and divides the rows between the threads.

    The loop has the signature `loop(first, end, field, *arguments)` and processes the rows `first` to `end - 1`. The
    decorated function has the signature `function(field, *arguments)`. The first and the last row of `field` are its
    border and are not processed. If Python calls the decorated function, the rows are divided between the threads. If
    compiled code calls the decorated function, the loop runs once for all rows.
    """

    def decorate(function: Any) -> Any:
        loop = compiled(**options)(function)

        @wraps(function)
        def run_on_threads(field: Any, *arguments: Any) -> None:
            n1, n2 = field.shape[:2]
            # without the first and the last row; the numbers are shifted by 1, because the first row is a border
            inner_rows = [(first + 1, end + 1) for first, end in rows(n1 - 2, n2)]
            over(inner_rows, loop, field, *arguments)

        field, *others = _loop_arguments(function)
        call = f"run_once({', '.join([field, *others])})"
        _compile_calls(run_on_threads, function, call, f"1, {field}.shape[0] - 1", options)
        return run_on_threads

    return decorate


def by_items(merged: Callable[[list[Any]], Any], **options: Any) -> Callable[[Any], Any]:
    """Return a decorator that compiles a loop over the items of lists and divides the items between the threads.

    The loop has the signature `loop(first, end, *arguments)` and processes the items `first` to `end - 1`. The
    decorated function has the signature `function(n, *arguments)`, where n is the number of items. If Python calls the
    decorated function, the items are divided between the threads. If compiled code calls the decorated function, the
    loop runs once for all items.

    Parameters
    ----------
    merged : callable
        Function that reduces the list of the parts' return values to one value, for example `summed`.
    **options
        Further options of Numba.
    """

    def decorate(function: Any) -> Any:
        loop = compiled(**options)(function)

        @wraps(function)
        def run_on_threads(n: int, *arguments: Any) -> Any:
            return merged(over(parts(n, _ITEMS), loop, *arguments))

        call = f"run_once({', '.join(['n', *_loop_arguments(function)])})"
        _compile_calls(run_on_threads, function, call, "0, n", options)
        return run_on_threads

    return decorate


def _loop_arguments(loop: Any) -> list[str]:
    """Return the names of the arguments of a loop, without the range of its items."""
    return list(signature(loop).parameters)[2:]


def _compile_calls(
    function: Any, loop: Any, call: str, items: str, options: dict[str, Any]
) -> None:
    """When Numba compiles a call of `function`, let it compile the loop for all items instead.

    The source of the substitute is generated here, as in `collections.namedtuple`, because it must list each argument
    by name: Numba inlines a function only if its arguments are not passed as `*arguments`. If the loop were not
    inlined, it would be compiled and optimised twice: on its own, and as a part of the substitute.

    Parameters
    ----------
    function : callable
        Function that divides the items between the threads.
    loop : callable
        The loop, with the signature `loop(first, end, *arguments)`.
    call : str
        Call of the substitute `run_once`, as a function of the arguments of `function`.
    items : str
        Range of all items, as a function of the same arguments.
    options : dict
        Further options of Numba.
    """
    source = f"def {call}:\n    return loop({items}, {', '.join(_loop_arguments(loop))})"
    names = {"__name__": loop.__module__, "loop": njit(inline="always")(loop)}
    exec(source, names)
    overload(function, strict=False, jit_options={**_COMMON, **options})(
        lambda *_: names["run_once"]
    )


def summed(values: list[Any]) -> Any:
    """Add the return values of all parts.

    A value is a number or a tuple of numbers; tuples are added element by element. The sum of values that are None is
    None.
    """
    if isinstance(values[0], tuple):
        return tuple(map(sum, zip(*values, strict=True)))
    if values[0] is None:
        return None
    return sum(values)
