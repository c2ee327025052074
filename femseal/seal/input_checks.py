"""Check input that several shapes of seals have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..base import InputError, to_text

#: Smallest and largest plausible size of a seal [m].
_SIZES = (1e-4, 100.0)


def check_size(name: str, size: float, unit: str = "") -> None:
    """Raise InputError if a seal is so small or so large that its unit is probably wrong.

    name : name of the size parameter, for the message.
    size : size of the seal [m].
    unit : unit of the size in the user's input, for the message.
    """
    low, high = _SIZES
    if not low <= size <= high:
        given = f"a seal {to_text(size, 'm', 3)} across{f' with the unit {unit!r}' if unit else ''}"
        expected = f"from {to_text(low, 'm')} to {to_text(high, 'm')}: is its unit right?"
        raise InputError(name, given, expected)


def check_inlet(inlet: Any) -> None:
    """Raise InputError if a pressure is given for each inlet of a mesh, which only earlier versions accepted."""
    if isinstance(inlet, Mapping):
        expected = (
            "names of boundaries, which all have the inlet pressure of the fluid: the highest of several "
            "pressures gives an upper bound of the leakage"
        )
        raise InputError("inlet", f"pressures of {', '.join(map(str, inlet))}", expected)
