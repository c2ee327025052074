"""Direction of the lay over a seal: where x2 of the face, along which marks of machining run, points on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base import Array, InputError, Pair, counted, to_text

#: Sizes between which a seal may lie [m].
_SIZES = (1e-4, 100.0)
#: Places of a seal may be so many spacings of its points away from a field.
_REACH = 2.0


@dataclass(frozen=True)
class Lay:
    """Where x2 of the cells points: a name, an angle from x1 to x2 [rad], a spiral, or the vectors of a field.

    Exactly one of them is given. A direction and its opposite are the same lay. lead : of a spiral, the distance from
    groove to groove [m], times the number of grooves that start beside each other: once around the seal the groove
    comes back so far across it. circumference : of a strip with a spiral [m]; its length unless given.
    """

    name: str = ""
    angle: float | None = None
    lead: float = 0.0
    circumference: float | None = None
    file: Path | None = None
    array: str = ""

    def directions(self, patches: Array, centre: Pair = (0.0, 0.0), unit: float = 1.0) -> Array:
        """Unit vectors (n, 2) along the lay at places (n, 2) [m].

        centre : from which "radial" is seen [m].
        unit : of the lengths in the file of a field [m].

        Raises InputError: a place at the centre; a field that cannot be read, has no such vectors, or does not cover a
        place.
        """
        if self.file is not None:
            return _of_field(self.file, self.array, patches, unit)
        if self.name in ("radial", "circumferential", "spiral"):
            away = patches - np.asarray(centre)
            distance = np.hypot(away[:, 0], away[:, 1])
            if not distance.min(initial=1.0) > 0:
                raise InputError("lay", f"'{self.name}' at its centre", "one outside of elements")
            radial = away / distance[:, None]
            around = np.stack([-radial[:, 1], radial[:, 0]], axis=1)
            tangent = (self.lead / (2 * np.pi * distance))[:, None]  # tan α of a spiral, else 0
            wound = (around + tangent * radial) / np.sqrt(1 + tangent**2)
            return radial if self.name == "radial" else wound
        angle = {"x1": 0.0, "x2": np.pi / 2}.get(self.name, self.angle or 0.0)
        return np.tile([np.cos(angle), np.sin(angle)], (len(patches), 1))

    def check_lead(self, breadth: float) -> None:
        """Raise InputError if a groove of the spiral crosses a seal of a breadth [m] within a turn."""
        if self.lead > breadth:
            given = f"{to_text(self.lead, 'm')} on a seal {to_text(breadth, 'm', 3)} broad"
            expected = "at most the breadth: the groove would cross it within a turn"
            raise InputError("lay.lead", given, expected)

    def __str__(self) -> str:
        if self.file is not None:
            return f"along the field {self.array} of {self.file.name}"
        if self.name == "spiral":
            return f"in a spiral of lead {to_text(self.lead, 'm')}"
        return f"at {np.degrees(self.angle):.3g}° from x1" if self.angle is not None else self.name


def check_size(name: str, size: float, unit: str = "") -> None:
    """Raise InputError if a seal has a size [m] that comes from a wrong unit of length."""
    low, high = _SIZES
    if not low <= size <= high:
        given = f"a seal {to_text(size, 'm', 3)} across{f' with the unit {unit!r}' if unit else ''}"
        expected = f"from {to_text(low, 'm')} to {to_text(high, 'm')}: is its unit right?"
        raise InputError(name, given, expected)


def check_inlet(inlet: Any) -> None:
    """Raise InputError if pressures are given to the inlets of a mesh, as a former version took them."""
    if isinstance(inlet, Mapping):
        expected = (
            "names of boundaries, which all have the inlet pressure of the fluid: the highest of several "
            "pressures gives an upper bound of the leakage"
        )
        raise InputError("inlet", f"pressures of {', '.join(map(str, inlet))}", expected)


def check_ring(inner: float, outer: float, inlet: str) -> None:
    """Raise InputError if radii [m] do not increase, or another than the inner or the outer one is the inlet."""
    if not outer > inner:
        expected = f"a number > the inner radius, {inner:g} m"
        raise InputError("outer_radius", f"{outer:g} m", expected)
    if inlet not in ("inner", "outer"):
        raise InputError("inlet", repr(inlet), "'inner' or 'outer'")


def _of_field(file: Path, array: str, patches: Array, unit: float) -> Array:
    """Unit vectors (n, 2) of the field at its points nearest to the places; InputError where it does not cover them."""
    from scipy.spatial import cKDTree

    from .seal_files import read_field

    points, values = read_field(file, array)
    points = points * unit
    of_vectors = values.ndim == 2 and values.shape[1] in (2, 3)
    size = np.linalg.norm(values[:, :2], axis=1) if of_vectors else np.zeros(1)
    if not (np.isfinite(values).all() and size.min() > 0):
        expected = "vectors along the lay, finite and not 0"
        raise InputError("lay.field", f"'{array}' of '{file}'", expected)
    tree = cKDTree(points)
    spacing = tree.query(points, k=2)[0][:, 1].max() if len(points) > 1 else np.inf
    distance, nearest = tree.query(patches)
    if (far := int(np.count_nonzero(distance > _REACH * spacing))) > 0:
        raise InputError(
            "lay.field",
            f"'{file}', which leaves out {counted(far, 'element')}",
            "a field that covers the seal",
        )
    return values[nearest, :2] / size[nearest, None]
