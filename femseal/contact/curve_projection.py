"""Project contact pressures on the curve H(u) of a contact law, by Newton's method within a bracket.

Symbols: p contact pressure, u plastic deformation, H(u) pressure at which a point with the plastic deformation u
yields, g raw gap (negative where the bodies would overlap), c a stiffness [Pa/m].
"""

from __future__ import annotations

from math import inf
from typing import Any, Protocol

import numpy as np

from ..base import Array

#: Largest number of steps of Newton's method, or of bisection, for the projection on a curved law.
_NEWTON_STEPS = 60
#: Steepest negative slope, relative to the stiffness, with which Newton's method is used for a softening law.
_STEEPEST = 0.8
#: Relative change of a deformation that may be caused by rounding errors.
_ROUNDING = 4 * np.finfo(float).eps


class HardnessCurve(Protocol):
    """Define what the projection needs of a `ContactLaw`."""

    @property
    def linear(self) -> bool:
        """Whether H(u) is a straight line at each point."""
        ...

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute H(u) [Pa] at a plastic deformation u [m]."""
        ...

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute dH/du [Pa/m] at a plastic deformation u [m]."""
        ...


def project_on_curve(
    law: HardnessCurve, pressure: Array, gap: Array, stiffness: float
) -> tuple[Array, Array]:
    """Project the contact pressures of some points on a contact law; return the pressures and the deformations.

    `ContactLaw.admissible` describes the projection.

    law : curve H(u) of the points.
    pressure : contact pressure p [Pa], (any shape).
    gap : raw gap g [m], of the shape of `pressure`.
    stiffness : stiffness c [Pa/m].
    """
    trial = pressure - stiffness * gap
    u = _deformation(law, trial, stiffness)
    y = np.clip(trial, 0.0, law.yield_pressure(u))
    overlap = np.maximum(-gap, 0.0)
    slope = law.hardening_modulus(overlap)
    if not np.any(slope < 0):
        return y, u
    # Where the law softens, there may be another solution near the overlap. It is taken if the overlap exceeds the
    # deformation u, or if the present pressure is nearer to the curve at the overlap.
    pressure_at_overlap = law.yield_pressure(overlap)
    is_nearer = np.abs(pressure - pressure_at_overlap) < np.abs(pressure - y)
    is_softened = (slope < 0) & (overlap > 0) & ((overlap > u) | is_nearer)
    # One step of Newton's method, from the overlap, for H(u) + c u = z. The sum of both slopes must not be close to
    # 0, because the step divides by it.
    total_slope = np.maximum(slope, -_STEEPEST * stiffness) + stiffness
    u_at_overlap = np.maximum(overlap + (pressure - pressure_at_overlap) / total_slope, 0.0)
    projected = np.where(is_softened, pressure_at_overlap, y)
    return projected, np.where(is_softened, u_at_overlap, u)


def _deformation(law: HardnessCurve, trial: Array, stiffness: float) -> Array:
    """Solve H(u) + c u = z for the plastic deformation u >= 0 of each point; u = 0 where z < H(0).

    Newton's method is kept within a bracket of the solution. Bisection replaces a step that leaves the bracket or
    that converges slowly.

    law : curve H(u) of the points.
    trial : array (n1, n2), trial pressure z [Pa].
    stiffness : stiffness c [Pa/m].
    """
    u = np.zeros(np.shape(trial))
    # For a straight line, the first step of Newton's method gives the solution, and no bracket is necessary.
    steps = 1 if law.linear else _NEWTON_STEPS
    # bracket of the solution, and the last change of u
    low = u
    high = np.full(u.shape, inf) if law.linear else np.maximum(trial, 0.0) / stiffness
    change = high
    for _ in range(steps):
        excess = law.yield_pressure(u) + stiffness * u - trial
        low = np.where(excess < 0, u, low)
        high = np.where(excess < 0, high, u)
        with np.errstate(divide="ignore"):
            step = -excess / (law.hardening_modulus(u) + stiffness)
        # a step that is not much shorter than the last change, and longer than rounding errors
        is_slow = (np.abs(step) > 0.5 * np.abs(change)) & (np.abs(step) > 1e-12 * high)
        is_inside = (u + step >= low) & (u + step <= high)
        to_middle = 0.5 * (low + high) - u  # step of the bisection
        change = np.where(is_inside & ~is_slow, step, to_middle)
        previous_u = u
        u = u + change
        # at the solution, rounding may move u back and forth by a few of its last digits
        if np.all(np.abs(u - previous_u) <= _ROUNDING * u):
            break
    return u
