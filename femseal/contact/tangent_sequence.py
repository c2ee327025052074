"""Solve a contact with a curved law H(u) as a sequence of contacts with tangents of the curve.

Each tangent touches the curve at the plastic deformation of the previous contact. The sequence takes 5 to 20 times as
long as a single contact with a linear law. The sequence is used for the two kinds of contact law that `curved_law`
cannot handle. In one kind, the law softens so steeply that single pixels yield while their neighbours do not. In the
other, the curves of different points are not just shifted copies of each other.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from ..base import Array, Flags, NotConverged, Shape
from .contact_fields import Contact
from .law import ContactLaw
from .nested_grids import Level, solve_straight_law
from .yield_line import YieldLine

#: Largest number of contacts with tangents of a curved law.
_MOST_TANGENTS = 100
#: Largest target residual of a contact with tangents; and target residual divided by the relative difference between
#: pressure and contact law after the previous contact.
_LARGEST_TANGENT_RTOL = 1e-2
_TANGENT_RTOL = 0.1
#: A steep tangent begins at the depth at which its pressure has fallen by this fraction of the yield pressure at the
#: point of tangency.
_FROM_DEPTH = 0.5
#: Smallest deformation [m] that is tried to carry a load, and numbers of doublings and bisections of this deformation.
_LEAST_DEFORMATION, _DOUBLINGS, _BISECTIONS = 1e-9, 25, 12
#: The plastic deformation is changed by a fraction of its computed change. The first value is the smallest fraction.
#: The fraction is halved if the difference between pressure and law exceeds the second value times the difference
#: before.
_SHORTEST_STEP, _SLOW = 0.125, 0.9
#: Smallest slope of tangents, as a fraction of the stiffness of the half-space, if the tangents could otherwise not
#: carry the load.
_SMALL_STIFFNESS = 0.1


class _Deformation:
    """Plastic deformation at which the tangents touch the curve, and the steps by which the sequence changes it.

    u : plastic deformation of each point [m], (n1, n2).
    change : last change of u [m].
    step : fraction of the computed change that is applied.
    mismatch : relative difference between pressure and law before the last change.
    """

    def __init__(self, law: ContactLaw, shape: Shape) -> None:
        self.law = law
        self.u = np.zeros(shape)
        self.change = np.zeros(shape)
        self.step = 1.0
        self.mismatch = inf

    def increase(self, mean_pressure: float) -> None:
        """Increase the deformation of all points by the same length, so that the curve can carry the load."""
        self.u = self.u + _increase_to_carry(self.law, self.u, mean_pressure)

    def move_towards(self, next_u: Array, mismatch: float) -> None:
        """Move the deformation towards that of the last contact, by a step that prevents oscillations.

        next_u : plastic deformation of the last contact [m], (n1, n2).
        mismatch : relative difference between pressure and law in the last contact.
        """
        # Tangents of a curve that hardens abruptly may alternate between two states, which shorter steps end. A law
        # that softens converges slowly with full steps, too, and shorter ones would stop it.
        is_slow = mismatch > _SLOW * self.mismatch
        if is_slow and not _softens(self.law, next_u):
            self.step = max(0.5 * self.step, _SHORTEST_STEP)
        else:
            self.step = min(1.0, 2 * self.step)
        self.mismatch = mismatch
        fraction = np.where(self._oscillates(next_u), 0.5, 1.0)
        self.change = self.step * fraction * (next_u - self.u)
        self.u = self.u + self.change

    def _oscillates(self, next_u: Array) -> Flags:
        """Return whether the law of a point softens and its deformation would turn back, for each point (n1, n2).

        The deformation turns back if the change to `next_u` and the previous change have opposite signs.
        """
        turns_back = (next_u - self.u) * self.change < 0
        if turns_back.any():
            part, turning = _law_of_points(self.law, turns_back)
            modulus_now = part.hardening_modulus(self.u[turning])
            next_modulus = part.hardening_modulus(next_u[turning])
            turns_back[turning] &= np.minimum(modulus_now, next_modulus) < 0
        return turns_back


def solve_by_tangents(law: ContactLaw, level: Level, rtol: float) -> Contact:
    """Solve a contact with a curved law by a sequence of contacts in which tangents replace the law.

    Each tangent touches the curve at the plastic deformation u of the previous contact. Its pressure is the first guess
    for the next contact. The mismatch is the relative difference between a pressure and its projection on the contact
    law. Each contact is solved until its residual is a fraction of the mismatch left by the previous contact.

    If the law of a point softens and its change of u has changed sign, only half of the change is applied. This keeps u
    from oscillating between two tangents. If the hardness is constant up to a certain depth and no point is deformed
    any deeper, the first contact is already the solution.

    Raises
    ------
    NotConverged
        After `_MOST_TANGENTS` contacts, the pressures and plastic deformations still do not agree with the law.
    """
    stiffness = level.half_space.stiffness
    deformation = _Deformation(law, level.half_space.shape)
    iterations = 0
    fft_pairs = 0
    pressure = None
    tolerance = rtol
    for _ in range(_MOST_TANGENTS):
        line, depth = _tangents_that_carry(law, level, deformation)
        tangent_level = level._replace(gap0=level.gap0 + depth, line=line)
        contact = solve_straight_law(tangent_level, tolerance, pressure)
        iterations += contact.iterations
        fft_pairs += contact.fft_pairs
        uses_first_line = line is level.line
        if uses_first_line and contact.plastic_deformation.max() <= law.constant_depth:
            return replace(contact, iterations=iterations, fft_pairs=fft_pairs)
        pressure = contact.pressure
        raw_gap = contact.raw_gap - depth
        admissible_pressure, next_u = law.admissible(pressure, raw_gap, stiffness)
        difference = float(np.linalg.norm(pressure - admissible_pressure))
        mismatch = difference / (float(np.linalg.norm(pressure)) or 1.0)
        if mismatch <= rtol and contact.residual <= rtol:
            if np.any(depth):
                contact = _with_gap(contact, raw_gap, is_plastic=next_u > 0)
            return replace(contact, iterations=iterations, fft_pairs=fft_pairs)
        tolerance = max(rtol, min(_LARGEST_TANGENT_RTOL, _TANGENT_RTOL * mismatch))
        deformation.move_towards(next_u, mismatch)
    raise NotConverged(
        f"contact: after {_MOST_TANGENTS} linearisations of the contact law, the relative difference between the "
        f"pressure and the law is still {mismatch:.1e}, wanted {rtol:.1e}; try a law that softens less, such as a "
        "smoother table or a larger smallest depth, or a finer grid",
        mismatch,
    )


def _tangents_that_carry(
    law: ContactLaw, level: Level, deformation: _Deformation
) -> tuple[YieldLine, float | Array]:
    """Compute the tangents of a law, and the depths from which they apply, such that the tangents can carry the load.

    If the tangents at the present deformation cannot carry the load, the deformation of all points is increased. If
    this does not suffice, the tangents are replaced by lines with a small positive slope.
    """
    line, depth = _tangent_from_depth(law, level.line, deformation.u)
    if not _can_carry(line, level):
        # the curve can carry the load at a larger deformation, of all points together or on a tangent that rises
        deformation.increase(level.mean_pressure)
        line, depth = _tangent_from_depth(law, level.line, deformation.u)
    if not _can_carry(line, level):
        least_slope = _SMALL_STIFFNESS * level.half_space.stiffness
        line = replace(line, slope=np.maximum(line.slope, least_slope))
    return line, depth


def _can_carry(line: YieldLine, level: Level) -> bool:
    """Return whether linear laws can carry the load of a contact, with some margin for rounding errors."""
    return level.mean_pressure < line.capacity * (1 - 1e-9)


def _tangent_from_depth(
    law: ContactLaw, first: YieldLine, u: Array
) -> tuple[YieldLine, float | Array]:
    """Compute the tangents of a law at the deformations u (n1, n2) [m], and the depth from which each tangent applies.

    If a steep tangent were extended back to u = 0, it would give a negative pressure there. A steep tangent is
    therefore only used from a depth b > 0 on. The caller adds b to the undeformed gap and solves the contact problem
    for the plastic deformation u − b.

    first : tangent of the law at u = 0.
    """
    is_curved = u > law.constant_depth
    if not is_curved.any():
        return first, 0.0
    # tangents of the points whose deformation is beyond the constant part of the law
    part, chosen = _law_of_points(law, is_curved)
    deformation = u[chosen]
    slope = np.maximum(part.hardening_modulus(deformation), 0.0)
    yield_pressure = part.yield_pressure(deformation)
    # the tangent begins where its pressure has fallen by the fraction `_FROM_DEPTH` of the yield pressure
    largest_distance = _FROM_DEPTH * yield_pressure / np.maximum(slope, 1.0)
    beginning = np.maximum(deformation - largest_distance, 0.0)
    # arrays of all points (n1, n2); points within the constant part keep the tangent at u = 0
    slopes = np.full(u.shape, first.slope)
    hardness = np.full(u.shape, first.hardness)
    depth = np.zeros(u.shape)
    slopes[chosen] = slope
    hardness[chosen] = yield_pressure - slope * (deformation - beginning)
    depth[chosen] = beginning
    return YieldLine(hardness, slopes), depth


def _increase_to_carry(law: ContactLaw, u: Array, mean_pressure: float) -> float:
    """Find the common increase of the deformation at which the hardness of the points can carry the load.

    Returns 0 if no increase suffices. Increasing the deformation of all points by the same length changes only the
    approach, not the pressure.

    The increase is necessary, for example, if a soft coating has to yield through its whole thickness before the harder
    substrate carries the load. If the deformations were not increased, all tangents would be horizontal lines at the
    constant hardness of the coating, which cannot carry the load.

    u : array (n1, n2), plastic deformation [m].
    mean_pressure : nominal pressure [Pa], which the points have to carry.
    """

    def carries(increase: float) -> bool:
        return float(np.mean(law.yield_pressure(u + increase))) > mean_pressure * (1 + 1e-6)

    # double the increase until the points can carry the load, then find the smallest sufficient increase by bisection
    low = 0.0
    high = max(float(u.max()), law.constant_depth, _LEAST_DEFORMATION)
    for _ in range(_DOUBLINGS):
        if carries(high):
            break
        low, high = high, 2 * high
    else:
        return 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if carries(middle):
            high = middle
        else:
            low = middle
    return high


def _softens(law: ContactLaw, u: Array) -> bool:
    """Return whether dH/du < 0 for at least one point, at the plastic deformations u (n1, n2) [m]."""
    is_curved = u > law.constant_depth
    if not is_curved.any():
        return False
    part, chosen = _law_of_points(law, is_curved)
    return bool(np.min(part.hardening_modulus(u[chosen])) < 0)


def _law_of_points(law: ContactLaw, is_chosen: Flags) -> tuple[ContactLaw, Any]:
    """Return the contact law of the chosen points, and an index that picks these points from an array.

    If the law cannot be split into points, the original law and an index of all points are returned.
    """
    part = law.of_points(is_chosen)
    if part is None:
        return law, ...
    return part, is_chosen


def _with_gap(contact: Contact, raw_gap: Array, is_plastic: Flags) -> Contact:
    """Return a copy of a contact whose gap and plastic deformation follow from the given raw gap (n1, n2) [m]."""
    return replace(
        contact,
        gap=np.maximum(raw_gap, 0.0),
        plastic_deformation=np.where(is_plastic, np.maximum(-raw_gap, 0.0), 0.0),
        plastic=is_plastic,
    )
