"""Define the coordinates of a seal, in which pressure maps and form deviations are given."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from ..base import Array, Pair


@dataclass(frozen=True)
class Frame:
    """Define the coordinates of a seal: x1 and x2 of a strip, or radius and angle of a ring or mesh.

    Attributes
    ----------
    size : tuple of two float or None
        Width along x1 and length along x2 of a strip [m]; None for other seals.
    centre : tuple of two float
        Centre of polar coordinates [m].
    ends : tuple of two float or None
        Value of x1 or of the radius at the inlet and at the outlet [m]; None for a mesh, on which the radius varies
        along the inlet or the outlet.
    """

    size: Pair | None = None
    centre: Pair = (0.0, 0.0)
    ends: Pair | None = None

    @classmethod
    def for_strip(cls, size: Pair) -> Frame:
        """Return the coordinates of a strip of the given size [m], with the inlet at x1 = 0."""
        return cls(size=size, ends=(0.0, size[0]))

    def across(self, points: Array) -> Array:
        """Return x1 on a strip, or the radius on other seals, at points (n, 2) [m]."""
        return points[:, 0] if self.size else np.hypot(*(points - self.centre).T)

    def angle(self, points: Array) -> Array:
        """Return the polar angle (n,) [rad] of points (n, 2) [m].

        For a strip of the length L2, the returned angle is 2π x2/L2, as if the strip were bent into a ring.
        """
        if self.size:
            return 2 * pi * points[:, 1] / self.size[1]
        x, y = (points - self.centre).T
        return np.arctan2(y, x)
