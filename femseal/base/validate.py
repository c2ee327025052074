"""Check arguments, and define names for their types.

Each check returns the value in a uniform type, or raises an InputError that names the argument.

Classes that can be chosen in a case file, such as fluids, declare each of their parameters once, with unit and range.
The keys of the case file are derived from these declarations.
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
#: Real numbers in single precision.
Singles = NDArray[np.float32]
#: Real numbers in any precision.
Floats = NDArray[np.floating]
#: Path of a file or a folder.
AnyPath = str | os.PathLike[str]
#: Number of points along x1 and x2.
Shape = tuple[int, int]
#: Lengths or other numbers along x1 and x2.
Pair = tuple[float, float]
#: Whether a map is periodic along x1 and x2.
Periodic = tuple[bool, bool]
#: Numbers along x1 and x2, or one number for both.
Lengths = float | Pair

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def removed_arguments(
    **advice: str,
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """Return a decorator that raises an InputError with advice if a removed argument is given.

    Parameters
    ----------
    **advice
        For each removed argument, what to do instead.

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
    """Convert values to an array of real numbers."""
    return np.asarray(values, dtype=np.float64)


def number(
    name: str, value: Any, *, unit: str = "", above: float = 0.0, inclusive: bool = False
) -> float:
    """Check that a value is a finite number above a limit.

    Parameters
    ----------
    name : str
        Name of the argument, for the error message.
    value : object
        The value.
    unit : str
        Unit, for the error message.
    above : float
        The value must be greater than this number; −inf for no limit.
    inclusive : bool
        Whether the value may be equal to `above`.
    """
    try:
        if isinstance(value, (str, bytes, bool)):
            raise TypeError
        checked = float(value)
    except (TypeError, ValueError, OverflowError):
        # an integer may be too large for a floating-point number
        checked = nan
        value = shown(value)
    is_in_range = checked >= above if inclusive else checked > above
    if isfinite(checked) and is_in_range:
        return checked
    expected = "a finite number"
    if isfinite(above):
        expected += f" {'>=' if inclusive else '>'} {above:g}"
    if unit:
        expected += f" [{unit}]"
    raise InputError(name, value, expected)


def tolerance(name: str, value: Any) -> float:
    """Check that a value is a number between 0 and 1, both excluded."""
    checked = number(name, value)
    if checked >= 1:
        raise InputError(name, value, "a number between 0 and 1")
    return checked


def field(
    name: str,
    value: Any,
    *,
    unit: str,
    shape: Shape | None = None,
    copy: bool = True,
    undefined: bool = False,
) -> Array:
    """Check that a value is an array (n1, n2) of finite real numbers.

    Parameters
    ----------
    name : str
        Name of the argument, for the error message.
    value : array_like
        The value.
    unit : str
        Unit, for the error message.
    shape : tuple of two int, optional
        Shape that the array must have.
    copy : bool
        Whether to copy the values even if they already form an array of the right type.
    undefined : bool
        Whether points may be undefined (NaN).
    """
    try:
        # the checks below would take as long as a part of the solution of a small contact problem
        is_plain = type(value) is np.ndarray and value.dtype == np.float64
        if not is_plain and (np.ma.is_masked(value) or np.iscomplexobj(value)):
            raise TypeError
        array = np.array(value, dtype=float, copy=True if copy else None)
        if not array.flags.carray:
            # A transposed array has a different order in memory, and an array from a cluster may begin at any byte.
            # Loops over such arrays add their numbers in a different order, which changes the last digits of results.
            array = np.require(array, requirements=("C", "ALIGNED"))
    except (TypeError, ValueError, OverflowError):
        expected = f"an array (n1, n2) of real numbers [{unit}]"
        raise InputError(name, f"a {type(value).__name__}", expected) from None
    has_other_shape = shape is not None and array.shape != shape
    if array.ndim != 2 or array.size == 0 or has_other_shape:
        raise InputError(name, f"shape {array.shape}", f"shape {shape or '(n1, n2)'}")
    is_allowed = ~np.isinf(array) if undefined else np.isfinite(array)
    if not is_allowed.all():
        expected = f"finite numbers [{unit}]"
        if undefined:
            expected += ", NaN = undefined"
        raise InputError(name, f"{counted((~is_allowed).sum(), 'point')} not finite", expected)
    return array


def count(name: str, value: Any, least: int = 1) -> int:
    """Check that a value is a whole number >= `least`."""
    try:
        checked = index(value)
    except TypeError:
        checked = least - 1
    if checked < least or isinstance(value, bool):
        raise InputError(name, shown(value), f"a whole number >= {least}")
    return checked


def _pair(name: str, value: Any, check: Callable[[Any], Any], expected: str) -> tuple[Any, Any]:
    """Check that a value has two members, one for x1 and one for x2, and apply `check` to each of them."""
    try:
        first, second = map(check, value)
    except (TypeError, ValueError, KeyError):
        raise InputError(name, shown(value), f"{expected}, along x1 and x2") from None
    return first, second


def lengths(name: str, value: Any) -> Pair:
    """Check that a value is a pair of finite lengths > 0 [m] along x1 and x2, or a single length for both axes."""
    pair = (value, value) if isinstance(value, Real) else value
    return _pair(name, pair, partial(number, name), "two finite numbers > 0 [m]")


def grid(name: str, value: Any, *, minimum: int = 1) -> Shape:
    """Check that a value is a pair of whole numbers >= `minimum`, for x1 and x2."""
    check = partial(count, name, least=minimum)
    return _pair(name, value, check, f"two whole numbers >= {minimum}")


def flags(name: str, value: Any) -> Periodic:
    """Check that a value is a pair of booleans for x1 and x2, or a single boolean for both axes."""
    pair = (value, value) if isinstance(value, bool) else value
    return _pair(name, pair, {True: True, False: False}.__getitem__, "two of True and False")


def axis_number(axis: Any) -> int:
    """Check that an axis is 0 (x1) or 1 (x2)."""
    if axis not in (0, 1):
        raise InputError("axis", shown(axis), "0 (x1) or 1 (x2)")
    return int(axis)


def described(
    meaning: str,
    *,
    example: Any = None,
    since: str = "0.1",
    default: Any = dataclasses.MISSING,
    **more: Any,
) -> Any:
    """Declare a dataclass field that is also a key of case files.

    Parameters
    ----------
    meaning : str
        Short description of the key.
    example : object
        Example of a value, as written in TOML; by default, the field's own default value.
    since : str
        First version of femseal that has the key.
    default : object
        Default value. A key without a default value is required.
    **more
        Further metadata of the field.
    """
    metadata = {"meaning": meaning, "example": example, "since": since, **more}
    return dataclasses.field(default=default, metadata=metadata)


def parameter(
    unit: str,
    allowed: str,
    example: str,
    meaning: str = "",
    *,
    usual: Pair = (-inf, inf),
    above: float = 0.0,
    inclusive: bool = False,
    **more: Any,
) -> Any:
    """Declare a dataclass field that is also a key of case files, and whose value is a finite number above a limit.

    Parameters
    ----------
    unit : str
        SI unit, in the form that is used in case files, such as "Pa*s".
    allowed : str
        Description of the values that a case file may contain, such as "a viscosity > 0".
    example : str
        Example of a value in a case file, such as "1 mPa*s".
    meaning : str
        Meaning of the key, see `described`.
    usual : tuple of two float
        Usual range in SI. If a value is outside the usual range, a warning asks whether its unit is right.
    above : float
        Lower limit; the number must be greater than this.
    inclusive : bool
        Whether the number may be equal to `above`.
    **more
        Further arguments of `described`. The default may be None.
    """
    texts = {"allowed": allowed, "allowed_example": example}
    limits: dict[str, Any] = {"usual": usual, "above": above, "inclusive": inclusive}
    return described(meaning, unit=unit, **texts, **limits, **more)


def check_parameters(model: Any) -> None:
    """Check all fields of a dataclass that were declared by `parameter`.

    Raises
    ------
    InputError
        A value is not a finite number, or is outside its range.
    """
    for f in dataclasses.fields(model):
        if "allowed" not in f.metadata:
            continue
        value = getattr(model, f.name)
        if value is None and f.default is None:
            continue
        number(
            f.name,
            value,
            unit=unit_text(f.metadata["unit"]),
            above=f.metadata["above"],
            inclusive=f.metadata["inclusive"],
        )
