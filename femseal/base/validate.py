"""Types of arguments and their checks: each returns the clean value or raises an InputError that names the argument.

Parameters of classes that a case can choose, such as fluids, are declared once with unit and range; the case file gets
a key for each of them from the same metadata.
"""

import dataclasses
import os
from collections.abc import Callable
from functools import partial, wraps
from math import inf, isfinite, nan
from numbers import Real
from operator import index
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, shown
from .quantities import counted, unit_text

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
#: Real numbers in single precision, and in any.
Singles = NDArray[np.float32]
Floats = NDArray[np.floating]
#: Of a file or a folder.
AnyPath = str | os.PathLike[str]
#: Along x1 and x2: points, lengths, whether a map repeats itself.
Shape = tuple[int, int]
Pair = tuple[float, float]
Periodic = tuple[bool, bool]
#: Along x1 and x2, or the same along both.
Lengths = float | Pair

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def removed_arguments(
    **advice: str,
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """Answer arguments that a function had in a former version with what to do instead.

    Parameters
    ----------
    advice : for the name of each removed argument, what to do without it.

    Examples
    --------
    >>> @removed_arguments(wide="give a larger size")
    ... def area(size):
    ...     return size**2
    >>> area(2.0, wide=True)
    Traceback (most recent call last):
    femseal.base.errors.InputError: wide: given True, expected none: removed; give a larger size
    """

    def decorate(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        @wraps(function)
        def checked(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
            for name, instead in advice.items():
                if name in kwargs:
                    raise InputError(name, shown(kwargs[name]), f"none: removed; {instead}")
            return function(*args, **kwargs)

        return checked

    return decorate


def reals(values: ArrayLike) -> Array:
    """Values as an array of real numbers."""
    return np.asarray(values, dtype=np.float64)


def number(
    name: str, value: Any, *, unit: str = "", above: float = 0.0, inclusive: bool = False
) -> float:
    """A finite number > `above`, or >= `above` when `inclusive`; above −inf, any."""
    try:
        if isinstance(value, (str, bytes, bool)):
            raise TypeError
        given = float(value)
    except (TypeError, ValueError):
        given, value = nan, repr(value)
    if isfinite(given) and (given >= above if inclusive else given > above):
        return given
    least = f" {'>=' if inclusive else '>'} {above:g}" if isfinite(above) else ""
    raise InputError(name, value, "a finite number" + least + (f" [{unit}]" if unit else ""))


def tolerance(name: str, value: Any) -> float:
    """A number between 0 and 1."""
    given = number(name, value)
    if given >= 1:
        raise InputError(name, value, "a number between 0 and 1")
    return given


def field(
    name: str,
    value: Any,
    *,
    unit: str,
    shape: Shape | None = None,
    copy: bool = True,
    undefined: bool = False,
) -> Array:
    """An array (n1, n2) of finite real numbers, of the given shape if any; a new one unless `copy` is false.

    undefined : whether points may be NaN.
    """
    try:
        if np.ma.is_masked(value) or np.iscomplexobj(value):
            raise TypeError
        array = np.array(value, dtype=float, copy=True if copy else None)
        # the last digits of results depend on the alignment in memory, which differs for arrays sent by a cluster
        array = np.require(array, requirements=("C", "ALIGNED"))
    except (TypeError, ValueError):
        expected = f"an array (n1, n2) of real numbers [{unit}]"
        raise InputError(name, f"a {type(value).__name__}", expected) from None
    if array.ndim != 2 or array.size == 0 or (shape is not None and array.shape != shape):
        raise InputError(name, f"shape {array.shape}", f"shape {shape or '(n1, n2)'}")
    bad = np.isinf(array) if undefined else ~np.isfinite(array)
    if bad.any():
        expected = f"finite numbers [{unit}]" + (", NaN = undefined" if undefined else "")
        raise InputError(name, f"{counted(bad.sum(), 'point')} not finite", expected)
    return array


def count(name: str, value: Any, least: int = 1) -> int:
    """A whole number >= a least one."""
    try:
        given = index(value)
    except TypeError:
        given = least - 1
    if given < least or isinstance(value, bool):
        raise InputError(name, repr(value), f"a whole number >= {least}")
    return given


def _two(name: str, value: Any, check: Callable[[Any], Any], allowed: str) -> tuple[Any, Any]:
    """Two clean values, along x1 and x2."""
    try:
        first, second = map(check, value)
    except (TypeError, ValueError, KeyError):
        raise InputError(name, repr(value), f"{allowed}, along x1 and x2") from None
    return first, second


def lengths(name: str, value: Any) -> Pair:
    """Two finite lengths > 0 [m], along x1 and x2; a single number is both."""
    pair = (value, value) if isinstance(value, Real) else value
    return _two(name, pair, partial(number, name), "two finite numbers > 0 [m]")


def grid(name: str, value: Any, *, minimum: int = 1) -> Shape:
    """Two whole numbers >= `minimum`, along x1 and x2."""
    check = partial(count, name, least=minimum)
    return _two(name, value, check, f"two whole numbers >= {minimum}")


def flags(name: str, value: Any) -> Periodic:
    """Two truth values, along x1 and x2; a single one is both."""
    pair = (value, value) if isinstance(value, bool) else value
    return _two(name, pair, {True: True, False: False}.__getitem__, "two of True and False")


def axis_number(axis: Any) -> int:
    """0 (x1) or 1 (x2)."""
    if axis not in (0, 1):
        raise InputError("axis", repr(axis), "0 (x1) or 1 (x2)")
    return int(axis)


def described(
    meaning: str,
    *,
    example: Any = None,
    since: str = "0.1",
    default: Any = dataclasses.MISSING,
    **more: Any,
) -> Any:
    """A field of a dataclass that a case may give too.

    meaning : in a phrase, for the key of the case. example : value in a case, as TOML has it; the default unless given.
    since : first version that has it. default : without it the field is required. more : of the metadata.
    """
    metadata = {"meaning": meaning, "example": example, "since": since, **more}
    return dataclasses.field(default=default, metadata=metadata)


def parameter(
    unit: str,
    allowed: str,
    meaning: str = "",
    *,
    usual: Pair = (-inf, inf),
    above: float = 0.0,
    inclusive: bool = False,
    **more: Any,
) -> Any:
    """A field of a dataclass: a finite number > `above`, or >= `above` where `inclusive`.

    unit : in SI, as text that case files may use too, such as "Pa*s".
    allowed : what a case file may give, with an example, such as "a viscosity > 0, such as '1 mPa*s'".
    usual : range out of which a case is asked whether the unit is meant.
    meaning, more : as `described` takes them; the default may be None.
    """
    limits: dict[str, Any] = {"usual": usual, "above": above, "inclusive": inclusive}
    return described(meaning, unit=unit, allowed=allowed, **limits, **more)


def check_parameters(model: Any) -> None:
    """Check the parameters of a dataclass.

    Raises InputError: one of them is not a finite number, or is out of its range.
    """
    for f in dataclasses.fields(model):
        if "allowed" in f.metadata:
            if getattr(model, f.name) is None and f.default is None:
                continue
            unit = unit_text(f.metadata["unit"])
            above, inclusive = f.metadata["above"], f.metadata["inclusive"]
            number(f.name, getattr(model, f.name), unit=unit, above=above, inclusive=inclusive)
