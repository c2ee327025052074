"""Solve a contact with a curved law as a sequence of contacts with tangents of the law.

Each tangent touches the curve at the plastic deformation of the previous contact. The sequence costs 5 to 20 times as
much as a contact with a linear law. It is used for the laws that `curved_law` cannot solve: laws that soften so steeply
that single pixels yield while their neighbours do not, and laws whose curve differs from point to point in an unknown
way.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from ..base import Array, Flags, NotConverged
from .contact_fields import Contact
from .law import ContactLaw, YieldLine
from .nested_grids import Level, solve_straight_law

#: Largest number of contacts with tangents of a curved law.
_MOST_TANGENTS = 100
#: Target residual of a contact with a tangent, relative to the mismatch that the previous tangent has left, and its
#: largest value.
_LARGEST_TANGENT_RTOL = 1e-2
_TANGENT_RTOL = 0.1
#: A steep tangent is used from the depth on at which its pressure is this fraction of the yield pressure below the
#: pressure at the point of contact with the curve.
_FROM_DEPTH = 0.5
#: Smallest deformation [m] that is tried to carry a load, and numbers of doublings and bisections of this deformation.
_LEAST_DEFORMATION, _DOUBLINGS, _BISECTIONS = 1e-9, 25, 12
#: Shortest step of a curved law, over the change of the deformation. Steps are halved if the mismatch is more than this
#: fraction of the previous one.
_SHORTEST_STEP, _SLOW = 0.125, 0.9
#: Smallest slope of tangents, as a fraction of the stiffness of the half-space. It is used if the tangents could not
#: carry the load otherwise.
_SMALL_STIFFNESS = 0.1


def solve_by_tangents(law: ContactLaw, level: Level, rtol: float) -> Contact:
    """Solve a contact with a curved law as a sequence of contacts with tangents of the law.

    Each tangent touches the curve at the plastic deformation u of the previous contact. The pressure of that contact is
    the first guess of the next one. If the law softens and the change of u has reversed its sign, only half of the
    change is made, because u could otherwise oscillate between two tangents. The tolerance of each contact is a
    fraction of the mismatch between pressure and law after the previous contact. Where the law begins with a constant
    hardness that no point exceeds, the first contact is the solution.

    Raises
    ------
    NotConverged
        Pressures and deformations do not agree with the law after `_MOST_TANGENTS` contacts.
    """
    shape = level.half_space.shape
    stiffness = level.half_space.stiffness
    constant_depth = law.constant_depth
    iterations = 0
    fft_pairs = 0
    u = np.zeros(shape)
    change = np.zeros(shape)
    pressure = None
    tolerance = rtol
    step = 1.0
    former_mismatch = inf
    for _ in range(_MOST_TANGENTS):
        line, depth = _tangent_from_depth(law, level.line, u)
        if level.load >= line.capacity * (1 - 1e-9):
            # the curve can carry the load at a larger deformation, of all points together or on a tangent that rises
            u = u + _increase_to_carry(law, u, level.load)
            line, depth = _tangent_from_depth(law, level.line, u)
        if level.load >= line.capacity * (1 - 1e-9):
            slope = np.maximum(line.slope, _SMALL_STIFFNESS * stiffness)
            line = replace(line, slope=slope)
        tangent_level = level._replace(gap0=level.gap0 + depth, line=line)
        contact = solve_straight_law(tangent_level, tolerance, pressure)
        iterations += contact.iterations
        fft_pairs += contact.fft_pairs
        if line is level.line and contact.plastic_deformation.max() <= constant_depth:
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
        turns_back = (next_u - u) * change < 0
        if turns_back.any():
            part, turning = _law_at(law, turns_back)
            modulus = (part.hardening_modulus(values[turning]) for values in (u, next_u))
            turns_back[turning] &= np.minimum(*modulus) < 0
        # Tangents of a curve that hardens abruptly may alternate between two states, which shorter steps end. A law
        # that softens converges slowly with full steps, too, and shorter ones would stop it.
        is_slow = mismatch > _SLOW * former_mismatch
        if is_slow and not _softens(law, next_u):
            step = max(0.5 * step, _SHORTEST_STEP)
        else:
            step = min(1.0, 2 * step)
        former_mismatch = mismatch
        change = step * np.where(turns_back, 0.5, 1.0) * (next_u - u)
        u = u + change
    raise NotConverged(
        f"contact: after {_MOST_TANGENTS} tangents the pressures differ from the law by {mismatch:.1e}, wanted "
        f"{rtol:.1e}; try a law that softens less, such as a smoother table or a larger smallest depth, or a finer "
        "grid",
        mismatch,
    )


def _tangent_from_depth(
    law: ContactLaw, first: YieldLine, u: Array
) -> tuple[YieldLine, float | Array]:
    """Compute the tangents of a law at the deformations u (n1, n2) [m], and the depth at which each tangent begins.

    If a steep tangent were extended to u = 0, its pressure there would be negative. Such a tangent therefore begins at
    a larger depth. The caller adds this depth to the gap, so that deformations in the contact problem count from there.

    first : tangent of the law at u = 0.
    """
    is_curved = u > law.constant_depth
    if not is_curved.any():
        return first, 0.0
    # tangents of the points whose deformation is beyond the constant part of the law
    part, chosen = _law_at(law, is_curved)
    deformation = u[chosen]
    slope = np.maximum(part.hardening_modulus(deformation), 0.0)
    yield_pressure = part.yield_pressure(deformation)
    # the tangent begins where its pressure has fallen by the fraction `_FROM_DEPTH` of the yield pressure
    largest_distance = _FROM_DEPTH * yield_pressure / np.maximum(slope, 1.0)
    beginning = np.maximum(deformation - largest_distance, 0.0)
    # all points (n1, n2): the other ones keep their tangent at u = 0
    slopes = np.full(u.shape, first.slope)
    hardness = np.full(u.shape, first.hardness)
    depth = np.zeros(u.shape)
    slopes[chosen] = slope
    hardness[chosen] = yield_pressure - slope * (deformation - beginning)
    depth[chosen] = beginning
    return YieldLine(hardness, slopes), depth


def _increase_to_carry(law: ContactLaw, u: Array, load: float) -> float:
    """Find by how much the deformation of all points has to increase for their hardness to carry the load.

    Returns 0 if no such increase is found. A uniform increase of the deformation changes the approach, but not the
    pressure. It is necessary if, for example, a coating has to yield through its thickness: otherwise all tangents
    would remain those of its constant hardness.

    u : array (n1, n2), plastic deformation [m].
    load : nominal pressure [Pa].
    """

    def carries(increase: float) -> bool:
        return float(np.mean(law.yield_pressure(u + increase))) > load * (1 + 1e-6)

    # double the increase until the load is carried, then find the smallest such increase by bisection
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
        low, high = (low, middle) if carries(middle) else (middle, high)
    return high


def _softens(law: ContactLaw, u: Array) -> bool:
    """Return whether a law softens at any of the deformations u (n1, n2) [m]."""
    is_curved = u > law.constant_depth
    if not is_curved.any():
        return False
    part, chosen = _law_at(law, is_curved)
    return bool(np.min(part.hardening_modulus(u[chosen])) < 0)


def _law_at(law: ContactLaw, is_chosen: Flags) -> tuple[ContactLaw, Any]:
    """Return the law of the chosen points, and the index that selects these points from an array.

    If the law is only defined for all points together, the law itself and an index of all points are returned.
    """
    part = law.at(is_chosen)
    if part is None:
        return law, ...
    return part, is_chosen


def _with_gap(contact: Contact, raw_gap: Array, is_plastic: Flags) -> Contact:
    """Return a contact with gap and plastic deformation computed from another raw gap (n1, n2) [m]."""
    return replace(
        contact,
        gap=np.maximum(raw_gap, 0.0),
        plastic_deformation=np.where(is_plastic, np.maximum(-raw_gap, 0.0), 0.0),
        plastic=is_plastic,
    )
