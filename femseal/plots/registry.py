"""Registry of the functions that draw results, one for each class; `plot()` of a result finds its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from inspect import signature
from typing import TYPE_CHECKING, Any

from ..base.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@singledispatch
def _draw(result: Any) -> Figure:
    raise InputError("plot", f"a {type(result).__name__}", "a result that has a picture")


def shows(kind: type) -> Callable[[Callable[..., Figure]], Callable[..., Figure]]:
    """Decorator that registers the function as the picture of a class; its other arguments are options of `plot()`."""
    return _draw.register(kind)


def picture(result: Any, **options: Any) -> Figure:
    """Draw the picture of a result.

    Raises
    ------
    InputError : a result without a picture, or an option that its picture does not have, such as `ax` where it has
        several panels.
    """
    draw = _draw.dispatch(type(result))
    allowed = list(signature(draw).parameters)[1:]
    for name in options:
        if name not in allowed:
            given = f"option '{name}' for the picture of a {type(result).__name__}"
            raise InputError("plot", given, f"one of {', '.join(allowed)}" if allowed else "none: it has no options")
    return draw(result, **options)
