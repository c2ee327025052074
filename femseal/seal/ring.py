"""Define the geometry of a ring: its rows of elements, and its coordinates, in which it is a strip."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from ..base import Array, InputError, Pair


@dataclass(frozen=True)
class Ring:
    """A ring between two radii.

    In the coordinates (|ln r/r₀|, θ), where r₀ is the radius of the inlet, Darcy's law has the same form as on a plane
    strip. The first coordinate increases from the inlet to the outlet.

    Attributes
    ----------
    inner, outer : radii [m].
    inlet : radius at which the fluid enters, "inner" or "outer".

    Raises
    ------
    InputError : the outer radius is not larger than the inner radius, or `inlet` is invalid.
    """

    inner: float
    outer: float
    inlet: str = "inner"

    def __post_init__(self) -> None:
        if not self.outer > self.inner:
            expected = f"a number > the inner radius, {self.inner:g} m"
            raise InputError("outer_radius", f"{self.outer:g} m", expected)
        if self.inlet not in ("inner", "outer"):
            raise InputError("inlet", repr(self.inlet), "'inner' or 'outer'")

    @property
    def breadth(self) -> float:
        """Width of the ring from inlet to outlet [m]."""
        return self.outer - self.inner

    @property
    def circumference(self) -> float:
        """Mean circumference π(r_i + r_o) [m]."""
        return pi * (self.inner + self.outer)

    @property
    def ends(self) -> Pair:
        """Radius of the inlet, and radius of the outlet [m]."""
        radii = self.inner, self.outer
        return radii if self.inlet == "inner" else radii[::-1]

    def row_radii(self, rows: int) -> Array:
        """Return the radii (rows + 1,) [m] of the boundaries between rows of equal width, from inlet to outlet."""
        rising = np.linspace(self.inner, self.outer, rows + 1)
        return rising if self.inlet == "inner" else rising[::-1]

    def strip_lines(self, rows: int) -> Array:
        """Return the first coordinate |ln r/r₀| (rows + 1,) of the boundaries between rows of equal width."""
        radii = self.row_radii(rows)
        return np.abs(np.log(radii / radii[0]))

    def radius_and_direction(self, points: Array) -> tuple[Array, Array]:
        """Return the radius (n,) [m] and the radial unit vector (2, n) at points (2, n).

        points : coordinates (|ln r/r₀|, θ) of the points.
        """
        outward = np.array([np.cos(points[1]), np.sin(points[1])])
        inlet_radius, _ = self.ends
        return inlet_radius * np.exp(self.outflow * points[0]), outward

    @property
    def outflow(self) -> float:
        """The number 1 if the fluid flows outwards, and −1 if it flows inwards."""
        return 1.0 if self.inlet == "inner" else -1.0
