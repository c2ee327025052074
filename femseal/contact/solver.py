"""Solve the contact under a load on nested grids, from a coarse one to the given one, by projected active sets.

Symbols: p pressure, H hardness, h₁ undeformed gap, K compliance of the half-space, v = Kp + h₁, δ approach,
g = v − δ raw gap, E* contact modulus, u plastic deformation. The problem is the convex programme

    min ½⟨p, Kp⟩ + ⟨p, h₁⟩,  0 ≤ p ≤ H,  mean p = p̄.

For a law that hardens, p ≤ H + h u, the term ½⟨(p − H)₊, (p − H)₊⟩/h replaces the upper bound. A contact with a curved
law is solved as a sequence of contacts with tangents of the law.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Flags, InputError, NotConverged, Shown, validate
from ..base.compiled import over, rows, thread_count, using_threads
from .active_sets import solve_active_sets
from .descent import Solution
from .half_space import HalfSpace
from .law import ContactLaw, YieldLine, contact_law
from .projection import gap_and_deformation
from .workspace import Problem, Workspace, coarsened, workspace

#: Target residual on coarse grids.
_COARSE_RTOL = 1e-2
#: Largest number of iterations on each coarse grid, and on the given grid.
_COARSE_ITERATIONS = 40
_MAX_ITERATIONS = 400
#: Largest number of points along the longer side of the coarsest grid. On a finer grid, a few steps could not
#: redistribute the pressure from one end of a long strip to the other.
_COARSEST = 48
#: Largest accepted relative error of the load.
_LOAD_TOLERANCE = 1e-9
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


@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """Solution of a contact problem; the metadata of the fields contain their units.

    Out of contact p = 0 and g > 0. In elastic contact 0 < p < H and g = 0. A point with p ≥ H is plastic and has g ≤ 0.
    """

    pressure: Array = field(metadata={"unit": "Pa", "long_name": "contact pressure"})
    gap: Array = field(metadata={"unit": "m", "long_name": "deformed gap"})
    plastic_deformation: Array = field(metadata={"unit": "m", "long_name": "permanent deformation"})
    approach: float = field(metadata={"unit": "m", "long_name": "rigid-body approach"})
    residual: float = field(metadata={"unit": "1", "long_name": "complementarity residual"})
    iterations: int = field(
        metadata={"unit": "1", "long_name": "outer iterations on the given grid"}
    )
    fft_pairs: int = field(metadata={"unit": "1", "long_name": "transform pairs on the given grid"})
    plastic: Flags = field(metadata={"unit": "1", "long_name": "points at the hardness"})
    half_space: HalfSpace = field(repr=False)

    _derived: ClassVar = {
        "area_fraction": "1",
        "plastic_fraction": "1",
        "mean_pressure": "Pa",
        "mean_gap": "m",
    }

    @property
    def area_fraction(self) -> float:
        """Fraction of the points that are in contact, p > 0."""
        return float(np.count_nonzero(self.pressure) / self.pressure.size)

    @property
    def area_fraction_corrected(self) -> float:
        """Contact fraction, corrected for the discretisation error at the edges of contact patches.

        A pixel that is only partly in contact counts as a pixel in contact. The contact area is therefore too large, by
        (π − 1 + ln 2)/24 of a pixel for each side at which a pixel in contact meets a pixel with a gap (Yastrebov,
        Anciaux & Molinari, Tribol. Int. 114, 2017, 161).
        """
        in_contact = self.pressure > 0
        n_sides = 0
        for axis, kind in enumerate(self.half_space.boundary):
            neighbours: dict[str, dict[str, Any]] = {
                "periodic": {"append": in_contact.take([0], axis)},
                "mirror": {},
                "free": {"prepend": False, "append": False},
            }
            is_edge = np.diff(in_contact, axis=axis, **neighbours[kind])
            n_sides += int(np.count_nonzero(is_edge))
        per_side = (np.pi - 1 + np.log(2)) / 24
        return max(0.0, self.area_fraction - per_side * n_sides / in_contact.size)

    @property
    def plastic_fraction(self) -> float:
        """Fraction of the points whose contact pressure has reached the hardness."""
        return float(np.count_nonzero(self.plastic) / self.pressure.size)

    @property
    def mean_pressure(self) -> float:
        """Mean pressure p̄ over the nominal area [Pa]."""
        return float(self.pressure.mean())

    @property
    def mean_gap(self) -> float:
        """Mean deformed gap [m]."""
        return float(self.gap.mean())

    @property
    def raw_gap(self) -> Array:
        """Gap due to elastic displacements only [m], without plastic deformation; negative at plastic points."""
        return self.gap - self.plastic_deformation


def solve_contact(
    gap0: ArrayLike,
    half_space: HalfSpace,
    *,
    pressure: float,
    hardness: float | ArrayLike | ContactLaw = inf,
    deformation: ArrayLike | None = None,
    fluid_pressure: ArrayLike = 0.0,
    rtol: float = 1e-6,
    threads: int | None = None,
) -> Contact:
    """Compute pressure and gap of an elastic-plastic half-space that is pressed on a rough surface by a load.

    Parameters
    ----------
    gap0 : array (n1, n2)
        Undeformed gap h₁ [m], up to a constant.
    half_space : HalfSpace
        Elastic body, kinds of boundaries, and grid.
    pressure : float
        Nominal pressure p̄ [Pa] with 0 ≤ p̄ ≤ mean H. At 0 the bodies just touch; at mean H all points are plastic. A
        law that hardens carries any pressure. A fluid between the surfaces carries its mean pressure, and the
        contact carries the rest.
    hardness : float, array (n1, n2) or ContactLaw
        Hardness H [Pa] of perfect plasticity, infinite for an elastic body; or a law such as `LinearHardening`.
    deformation : array (n1, n2), optional
        Plastic deformation >= 0 [m] due to an earlier load. The plastic deformation of the result includes it.
    fluid_pressure : float or array (n1, n2)
        Pressure p_f of a fluid between the surfaces [Pa], relative to the surroundings. The problem is then that of a
        dry contact with three changes: the fluid opens the gap from h₁ to h₁ + K p_f, the contact carries p̄ − mean
        p_f, and points yield at the contact pressure H − p_f.
    rtol : float
        Complementarity residual ‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ to reach, with c = πE*/(4Δ). Δ is the geometric mean
        of both spacings; an axis with only one point is left out. For other laws, the projection on the law takes the
        place of clip.
    threads : int, optional
        Number of threads that share the work on grids of 512² points or more. Default: the threads that the current run
        leaves free, or one thread if there is no run. The number of threads does not change the results.

    Returns
    -------
    Contact

    Raises
    ------
    InputError
        A shape is wrong, points are undefined, the law cannot carry the pressure, or the pressure is less than the mean
        pressure of the fluid, so that the surfaces separate.
    NotConverged
        The residual did not fall below its tolerance, or the tangents of a nonlinear law still changed after 100
        iterations.

    Notes
    -----
    The method is an inexact semismooth Newton method on the sets of points in contact and at the hardness, as in
    gradient-projection conjugate gradients (Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231,
    1999, 206). If the sets still change after many iterations, steps are used that never raise the energy. The
    attribute `residual` is that of the returned pressure.

    Examples
    --------
    >>> import femseal as fs
    >>> gap0 = 1e-6 * np.cos(2 * np.pi * np.arange(64) / 64) + np.zeros((64, 1))  # waves along x2
    >>> body = fs.HalfSpace((64, 64), (1e-6, 1e-6), modulus=1e11)
    >>> contact = solve_contact(gap0, body, pressure=1e9)
    >>> round(contact.area_fraction, 2), bool(contact.gap.min() == 0)
    (0.3, True)
    """
    shape = half_space.shape
    gap = validate.field("gap0", gap0, unit="m", shape=shape, copy=False)
    law = contact_law(hardness)
    if deformation is not None:
        deformation = validate.field("deformation", deformation, unit="m", shape=shape, copy=False)
        gap = gap + deformation
        law = law.after(deformation)
    n_threads = thread_count() if threads is None else validate.count("threads", threads)
    with using_threads(n_threads):
        if np.ndim(fluid_pressure) or fluid_pressure != 0:
            gap, law, pressure = _as_dry_contact(gap, half_space, law, pressure, fluid_pressure)
        line = law.tangent(shape)
        load = _checked_load(pressure, law)
        validate.tolerance("rtol", rtol)
        level = _Level(gap, half_space, line, load)
        if law.linear:
            contact = _solve_straight_law(level, rtol)
        else:
            contact = _solve_curved_law(law, level, rtol)
    if deformation is not None:
        np.add(contact.plastic_deformation, deformation, out=contact.plastic_deformation)
    return contact


def _as_dry_contact(
    gap: Array,
    half_space: HalfSpace,
    law: ContactLaw,
    pressure: float,
    fluid_pressure: ArrayLike,
) -> tuple[Array, ContactLaw, float]:
    """Convert a contact with a fluid between the surfaces to an equivalent contact without a fluid.

    Returns
    -------
    gap : array (n1, n2)
        Undeformed gap [m], opened by the fluid.
    law : ContactLaw
        Law of the contact pressure alone.
    pressure : float
        Nominal pressure that the contact has to carry [Pa].
    """
    if np.ndim(fluid_pressure) == 0:
        value = validate.number("fluid_pressure", fluid_pressure, unit="Pa", above=-inf)
        fluid_pressure = np.full(half_space.shape, value)
    p_f = validate.field(
        "fluid_pressure", fluid_pressure, unit="Pa", shape=half_space.shape, copy=False
    )
    if np.any(p_f >= law.yield_pressure()):
        given = f"up to {p_f.max():g} Pa"
        expected = f"less than the hardness, {law.mean_hardness:g} Pa"
        raise InputError("fluid_pressure", given, expected)
    pressure = validate.number("pressure", pressure, unit="Pa", inclusive=True)
    mean = float(p_f.mean())
    if pressure < mean:
        given = f"{pressure:g} Pa, of which the fluid carries {mean:g} Pa"
        expected = "a load that is more than the fluid carries: below that the surfaces separate"
        raise InputError("pressure", given, expected)
    # a uniform fluid pressure is passed to the law as a number, so that the law remains the same for all points
    first_value = p_f.flat[0]
    is_uniform = np.all(p_f == first_value)
    reduced_law = law.less(first_value if is_uniform else p_f)
    grid = workspace(half_space)
    grid.pressure[:] = p_f
    return gap + grid.displacement(), reduced_law, pressure - mean


def _checked_load(pressure: float, law: ContactLaw) -> float:
    """Return the nominal pressure as a number; raise InputError if the law cannot carry it."""
    pressure = validate.number("pressure", pressure, unit="Pa", inclusive=True)
    check_capacity("pressure", pressure, law)
    return pressure


def check_capacity(name: str, pressure: float, law: ContactLaw) -> None:
    """Raise InputError if a law cannot carry a mean pressure [Pa]."""
    if pressure > law.capacity * (1 + 1e-12):
        expected = f"at most the mean hardness, {law.capacity:g} Pa"
        raise InputError(name, f"{pressure:g} Pa", expected)


# --- nested grids -----------------------------------------------------------------------------------------


class _Level(NamedTuple):
    """A contact problem on one of the nested grids, with checked input.

    gap0 : array (n1, n2), undeformed gap [m].
    half_space : half-space on this grid.
    line : linear contact law.
    load : nominal pressure [Pa].
    """

    gap0: Array
    half_space: HalfSpace
    line: YieldLine
    load: float

    def coarser(self) -> _Level:
        """Make the problem on the next coarser grid, with about half as many points along each axis."""
        hardness, slope = (
            coarsened(values) if values.size > 1 else values
            for values in (self.line.hardness, self.line.slope)
        )
        line = YieldLine(hardness, slope)
        load = self.load
        if np.isfinite(line.capacity):
            # The mean hardness of the coarse grid may differ, because an odd last row is counted twice. The load is
            # scaled, so that all grids carry the same fraction of their capacity.
            load *= line.capacity / self.line.capacity
        return _Level(coarsened(self.gap0), self.half_space.coarser, line, load)

    def on_grid(self, offset: float) -> Problem:
        """Make the problem for the solver on a single grid; heights are measured from `offset` [m]."""
        return Problem(
            gap0=self.gap0.ravel(),
            offset=offset,
            hardness=self.line.hardness.ravel(),
            slope=self.line.slope.ravel(),
            load=self.load * self.gap0.size,
        )

    def first_guess(self) -> Array:
        """Guess the pressure: distribute the load uniformly on the highest points.

        The number of points is chosen so that their mean pressure is the smaller of the hardness and 0.1 E*.
        """
        wanted_pressure = min(self.line.mean_hardness, 0.1 * self.half_space.pixel_modulus)
        gap0 = self.gap0
        n_carrying = min(gap0.size, int(self.load / wanted_pressure * gap0.size))
        n_touching = max(min(4, gap0.size), n_carrying)
        # the largest gap of the n_touching highest points
        largest_gap = np.partition(gap0, n_touching - 1, axis=None)[n_touching - 1]
        is_touching = gap0 <= largest_gap
        return is_touching * (self.load * gap0.size / np.count_nonzero(is_touching))


def _solve_straight_law(level: _Level, rtol: float, start: Array | None = None) -> Contact:
    """Solve a contact with a linear law, from the coarsest grid to the given one.

    start : first guess of the pressure (n1, n2) [Pa] on the given grid. With a guess, no coarser grids are used.
    """
    # heights are measured from the highest point, so that rounding errors are small for points in contact
    offset = float(level.gap0.min())
    if level.load == 0:
        return _uniform_contact(level, offset, 0.0)
    if level.load >= level.line.capacity * (1 - 1e-12):
        return _uniform_contact(level, offset, level.line.hardness)
    if start is None:
        start = _start_from_coarser_grids(level, offset)
    grid = workspace(level.half_space)
    grid.start(start, level.line.limit)
    solution = solve_active_sets(grid, level.on_grid(offset), rtol, _MAX_ITERATIONS)
    _check_solution(level, float(grid.pressure.mean()), solution, rtol)
    return _make_contact(level, grid, offset, solution)


def _start_from_coarser_grids(level: _Level, offset: float) -> Array:
    """Solve a contact on coarser grids, and return the pressure on the last of them, or a guess if there is none."""
    levels = [level]
    while max(levels[-1].half_space.shape) > _COARSEST:
        levels.append(levels[-1].coarser())
    start = levels[-1].first_guess()
    while len(levels) > 1:
        coarse = levels.pop()
        grid = workspace(coarse.half_space, level.half_space)
        grid.start(start, coarse.line.limit)
        solve_active_sets(grid, coarse.on_grid(offset), _COARSE_RTOL, _COARSE_ITERATIONS)
        start = grid.pressure
        del grid, coarse  # release their memory before the next grid is created
    return start


def _uniform_contact(level: _Level, offset: float, pressure: float | Array) -> Contact:
    """Make the result for a contact without load, or with all points in contact at a known pressure [Pa]."""
    grid = workspace(level.half_space)
    grid.pressure[:] = pressure
    v = grid.displacement()
    v += level.gap0 - offset
    delta = float(v.max()) if grid.pressure.any() else 0.0
    return _make_contact(level, grid, offset, Solution(delta, 0.0, 0, 1))


def _check_solution(level: _Level, carried: float, solution: Solution, rtol: float) -> None:
    """Raise NotConverged if the residual is above `rtol`, or if the mean pressure [Pa] differs from the load."""
    if not abs(carried - level.load) <= _LOAD_TOLERANCE * level.load:
        raise NotConverged(
            f"contact: the solution carries {carried / level.load:.6g} times the given load; try another grid",
            solution.residual,
        )
    if not solution.residual <= rtol:
        raise NotConverged(
            f"contact: residual {solution.residual:.1e} after {solution.iterations} iterations, wanted {rtol:.1e}; "
            "try a larger rtol, a filtered surface or a finer grid",
            solution.residual,
        )


def _make_contact(level: _Level, grid: Workspace, offset: float, solution: Solution) -> Contact:
    """Make the result from the solution that is stored in the workspace of a grid."""
    v = grid.arrays.v
    pressure = grid.pressure.copy() if grid.is_kept else grid.pressure
    grid.release()
    gap = np.empty(pressure.shape)
    deformation = np.empty(pressure.shape)
    is_plastic = np.empty(pressure.shape, bool)
    over(
        rows(*pressure.shape),
        gap_and_deformation,
        pressure.ravel(),
        v,
        solution.delta,
        grid.stiffness,
        level.line.hardness.ravel(),
        level.line.slope.ravel(),
        gap.ravel(),
        deformation.ravel(),
        is_plastic.ravel(),
    )
    return Contact(
        pressure=pressure,
        gap=gap,
        plastic_deformation=deformation,
        approach=solution.delta + offset,
        residual=solution.residual,
        iterations=solution.iterations,
        fft_pairs=solution.products,
        plastic=is_plastic,
        half_space=level.half_space,
    )


# --- curved laws ------------------------------------------------------------------------------------------


def _solve_curved_law(law: ContactLaw, level: _Level, rtol: float) -> Contact:
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
        contact = _solve_straight_law(tangent_level, tolerance, pressure)
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
