"""Define the straight line H + h u of each point, with which the contact solver works."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf

import numpy as np

from ..base import Array
from .point_arrays import LinearLaw


@dataclass(frozen=True, eq=False)
class YieldLine:
    """Linear law H(u) = hardness + slope · u at each point, the kind of law that the compiled loops of the solver use.

    Parameters
    ----------
    hardness : array (1,) or (n1, n2)
        Hardness at u = 0 [Pa], one value for all points (1,) or one value for each point (n1, n2).
    slope : array (1,) or (n1, n2)
        Hardening modulus [Pa/m].
    """

    hardness: Array
    slope: Array

    @cached_property
    def hardens(self) -> bool:
        """Whether any point hardens."""
        return bool(np.any(self.slope > 0))

    @cached_property
    def mean_hardness(self) -> float:
        """Mean of the hardness [Pa]."""
        if self.hardness.size == 1:
            return self.hardness.item()
        return float(self.hardness.mean())

    @cached_property
    def capacity(self) -> float:
        """Largest mean pressure that the points can carry [Pa]."""
        return inf if self.hardens else self.mean_hardness

    @cached_property
    def limit(self) -> Array:
        """Largest contact pressure of each point [Pa], infinite at points that harden, (1,) or (n1, n2)."""
        if not self.hardens:
            return self.hardness
        return np.where(self.slope > 0, inf, self.hardness)

    @property
    def of_list(self) -> LinearLaw:
        """The line of each point in the order of the grid, for compiled loops."""
        return LinearLaw(self.hardness.ravel(), self.slope.ravel())
