"""Define the contact law of two bodies, of which the softer one yields at each depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array
from .law import ContactLaw

#: Depths at which the laws of two bodies are compared [m].
_COMPARED_DEPTHS = np.r_[0.0, np.geomspace(1e-10, 1e-3, 281)]


@dataclass(frozen=True, eq=False)
class SofterOf(ContactLaw):
    """Contact law of two bodies. At each depth u the softer body yields: H(u) = min(H₁(u), H₂(u)).

    Call `softer_of` instead of creating a `SofterOf` directly: unless the curves H₁(u) and H₂(u) cross, it returns the
    law of the softer body.

    Parameters
    ----------
    first, second : ContactLaw
        Laws of the two bodies, each the same for all points.
    """

    first: ContactLaw
    second: ContactLaw

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry, which is limited by the weaker body."""
        return min(self.first.capacity, self.second.capacity)

    @property
    def constant_depth(self) -> float:
        """Plastic deformation [m] up to which the hardness of each of the two bodies is constant."""
        return min(self.first.constant_depth, self.second.constant_depth)

    @property
    def bends(self) -> Array:
        """Plastic deformations [m] at which H₁(u), H₂(u) or one of their derivatives may be discontinuous.

        The depths at which the two curves cross are unknown and not included.
        """
        return np.r_[self.first.bends, self.second.bends]

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute min(H₁(u), H₂(u)) [Pa], the yield pressure of the softer body."""
        first = self.first.yield_pressure(deformation)
        second = self.second.yield_pressure(deformation)
        return np.minimum(first, second)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute the hardening modulus dH/du [Pa/m] of the softer body at each point."""
        first_pressure = self.first.yield_pressure(deformation)
        second_pressure = self.second.yield_pressure(deformation)
        first = self.first.hardening_modulus(deformation)
        second = self.second.hardening_modulus(deformation)
        return np.where(first_pressure <= second_pressure, first, second)

    def __str__(self) -> str:
        return f"the softer at each depth of {self.first}, and {self.second}"


def softer_of(first: ContactLaw, second: ContactLaw | None = None) -> ContactLaw:
    """Return the law of the softer body, or a `SofterOf` if the curves H(u) of the two bodies cross.

    first : law of the first body, the same for all points.
    second : law of the second body, the same for all points; None if the second body is rigid.
    """
    if second is None:
        return first
    shape = _COMPARED_DEPTHS.shape
    first_pressure = np.broadcast_to(first.yield_pressure(_COMPARED_DEPTHS), shape)
    second_pressure = np.broadcast_to(second.yield_pressure(_COMPARED_DEPTHS), shape)
    if np.all(first_pressure <= second_pressure):
        return first
    if np.all(second_pressure <= first_pressure):
        return second
    return SofterOf(first, second)
