"""How functions are compiled: once on a machine, and so that they run without the lock of the interpreter.

Numba would also make an entry for calls from C, and one from Python for functions that only compiled ones call: these
are a twelfth of the time of compiling.
"""

from collections.abc import Callable
from typing import Any

from numba import njit

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
