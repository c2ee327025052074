"""Contact under a load: nested start, then projected active sets on the given grid.

Symbols: p pressure, H hardness, h₁ undeformed gap, v = Kp + h₁, δ approach, g = v − δ raw gap, E* contact modulus,
u plastic deformation. The problem is the convex programme  min ½⟨p,Kp⟩ + ⟨p,h₁⟩,  0 ≤ p ≤ H,  mean p = p̄;  a law that
hardens, p ≤ H + h u, adds ½⟨(p − H)₊,(p − H)₊⟩/h in place of the upper bound. Curved laws are solved by their tangents.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Flags, InputError, NotConverged, Shown, validate
from ..base.compiled import number, over, rows, using
from .active_sets import solve_active_sets
from .descent import Solution
from .half_space import HalfSpace
from .law import ContactLaw, YieldLine, contact_law
from .projection import gap_and_deformation
from .workspace import Problem, Workspace, coarsened, workspace

#: Residual to reach on coarse grids, and most iterations there and on the given grid.
_COARSE_RTOL = 1e-2
_COARSE_ITERATIONS = 40
_MAX_ITERATIONS = 400
#: Largest number of points along the longer side of the coarsest grid: on finer ones nothing carries a pressure from
#: one end of a long strip to the other within a few steps.
_COARSEST = 48
#: Solutions with tangents of a curved law after which it does not settle.
_MOST_TANGENTS = 100
#: Part of its pressure that a tangent has left at the depth from which on it holds.
_FROM_DEPTH = 0.5


@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """Solution of a contact problem; fields carry their unit in the dataclass metadata.

    Out of contact p = 0 and g > 0; elastic contact has 0 < p < H and g = 0; at p ≥ H the point is plastic and g ≤ 0.
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
        """Fraction of points in contact, p > 0."""
        return float(np.count_nonzero(self.pressure) / self.pressure.size)

    @property
    def area_fraction_corrected(self) -> float:
        """Fraction in contact, corrected for the error of the pixels at the edge of contact.

        A pixel in contact counts whole, which adds (π − 1 + ln 2)/24 of a pixel for each pixel side between contact
        and gap. Source: Yastrebov, Anciaux & Molinari, Tribol. Int. 114, 2017, 161.
        """
        touching = self.pressure > 0
        sides = 0
        for axis, kind in enumerate(self.half_space.boundary):
            beyond: dict[str, dict[str, Any]] = {
                "periodic": {"append": touching.take([0], axis)},
                "mirror": {},
                "free": {"prepend": False, "append": False},
            }
            sides += int(np.count_nonzero(np.diff(touching, axis=axis, **beyond[kind])))
        return max(0.0, self.area_fraction - (np.pi - 1 + np.log(2)) / 24 * sides / touching.size)

    @property
    def plastic_fraction(self) -> float:
        """Fraction of points at the hardness."""
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
        """Gap with the elastic but without the plastic displacement [m]; negative where plastic deformation is."""
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
    """Find the pressure and the gap of an elastic-plastic half-space that a load presses on a rough gap.

    Parameters
    ----------
    gap0 : undeformed gap h₁ (n1, n2) [m], up to a constant.
    half_space : elastic body, boundary kinds, grid.
    pressure : nominal pressure p̄ [Pa], 0 ≤ p̄ ≤ mean H; 0 is first touch, mean H all plastic. A law that hardens carries
        any. A fluid carries its mean pressure of it, and the contact the rest.
    hardness : H [Pa] of perfect plasticity, a number or one per point, inf is elastic; or a law, such as
        `LinearHardening`.
    deformation : plastic deformation (n1, n2) >= 0 [m] that an earlier load has left; that of the result is this and
        what the load adds.
    fluid_pressure : p_f of a fluid between the faces [Pa], a number or (n1, n2), above that of the surroundings. The
        traction t = p + p_f is not below p_f, and at most H: h₁ + K p_f stands for h₁, p̄ − mean p_f for p̄, H − p_f
        for H. A uniform p_f on a periodic face is the dry face with these.
    rtol : complementarity residual ‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ to reach, c = πE*/(4Δ) with the geometric mean Δ
        of the spacings along which there are points; in place of clip stands the projection on the law.
    threads : that share the work on a grid of 512² points or more; those that the run leaves free, 1 without a run.
        Any number gives the same bits.

    Raises
    ------
    InputError : wrong shape, undefined points, a pressure that the law cannot carry, or one below the mean of the
        fluid's, under which the faces part.
    NotConverged : the residual was not reached; the message says which was. Or tangents of a curved law did not settle.

    Notes
    -----
    Inexact semismooth Newton on the contact and plastic sets, as in gradient-projection conjugate gradients
    (Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206), and where the sets do not
    settle, steps that never raise the energy. The residual is that of the returned pressure.

    Examples
    --------
    >>> import femseal as fs
    >>> gap0 = 1e-6 * np.cos(2 * np.pi * np.arange(64) / 64) + np.zeros((64, 1))  # waves along x2
    >>> body = fs.HalfSpace((64, 64), (1e-6, 1e-6), modulus=1e11)
    >>> contact = solve_contact(gap0, body, pressure=1e9)
    >>> round(contact.area_fraction, 2), bool(contact.gap.min() == 0)
    (0.3, True)
    """
    gap = validate.field("gap0", gap0, unit="m", shape=half_space.shape, copy=False)
    law = contact_law(hardness)
    if deformation is not None:
        deformation = validate.field(
            "deformation", deformation, unit="m", shape=half_space.shape, copy=False
        )
        gap, law = gap + deformation, law.after(deformation)
    with using(number() if threads is None else validate.count("threads", threads)):
        if np.ndim(fluid_pressure) or fluid_pressure != 0:
            gap, law, pressure = _with_fluid(gap, half_space, law, pressure, fluid_pressure)
        line = law.tangent(half_space.shape)
        load = _checked_load(pressure, law)
        validate.tolerance("rtol", rtol)
        level = _Level(gap, half_space, line, load)
        contact = _solve(level, rtol) if law.linear else _solve_by_tangents(law, level, rtol)
    if deformation is not None:
        np.add(contact.plastic_deformation, deformation, out=contact.plastic_deformation)
    return contact


def _with_fluid(
    gap: Array,
    half_space: HalfSpace,
    law: ContactLaw,
    pressure: float,
    fluid_pressure: ArrayLike,
) -> tuple[Array, ContactLaw, float]:
    """Undeformed gap [m], law and nominal pressure [Pa] of a contact whose faces a fluid presses apart."""
    if np.ndim(fluid_pressure) == 0:
        value = validate.number("fluid_pressure", fluid_pressure, unit="Pa", above=-inf)
        fluid_pressure = np.full(half_space.shape, value)
    p_f = validate.field(
        "fluid_pressure", fluid_pressure, unit="Pa", shape=half_space.shape, copy=False
    )
    if np.any(p_f >= law.yield_pressure()):
        given = f"up to {p_f.max():g} Pa"
        raise InputError(
            "fluid_pressure", given, f"less than the hardness, {law.mean_hardness:g} Pa"
        )
    pressure = validate.number("pressure", pressure, unit="Pa", inclusive=True)
    mean = float(p_f.mean())
    if pressure < mean:
        given = f"{pressure:g} Pa, of which the fluid carries {mean:g} Pa"
        raise InputError(
            "pressure", given, "more than the fluid carries: below that the faces part"
        )
    # the same number at every point stays one, and the law with it
    reduced = law.less(p_f.flat[0] if np.all(p_f == p_f.flat[0]) else p_f)
    grid = workspace(half_space)
    grid.pressure[:] = p_f
    return gap + grid.displacement(), reduced, pressure - mean


def _checked_load(pressure: float, law: ContactLaw) -> float:
    """The nominal pressure as a number that the law can carry; raises InputError."""
    pressure = validate.number("pressure", pressure, unit="Pa", inclusive=True)
    check_capacity("pressure", pressure, law)
    return pressure


def check_capacity(name: str, pressure: float, law: ContactLaw) -> None:
    """Raise InputError if the points cannot carry a mean pressure [Pa]."""
    if pressure > law.capacity * (1 + 1e-12):
        raise InputError(
            name, f"{pressure:g} Pa", f"at most the mean hardness, {law.capacity:g} Pa"
        )


class _Level(NamedTuple):
    """A contact problem on one of the nested grids, checked: gap (n1, n2) [m], body, law and nominal pressure [Pa]."""

    gap0: Array
    half_space: HalfSpace
    line: YieldLine
    load: float

    def coarser(self) -> _Level:
        """The problem with about half of the points along each axis that has more than one."""
        values = self.line.hardness, self.line.slope
        line = YieldLine(*(coarsened(a) if a.size > 1 else a for a in values))
        load = self.load
        if np.isfinite(line.capacity):
            # coarse means count an odd border twice: every grid carries the same fraction of its capacity
            load *= line.capacity / self.line.capacity
        return _Level(coarsened(self.gap0), self.half_space.coarser, line, load)

    def on_grid(self, offset: float) -> Problem:
        """The problem as the solver of one grid takes it, its heights counting from an offset [m]."""
        law = self.line.hardness.ravel(), self.line.slope.ravel()
        return Problem(self.gap0.ravel(), offset, *law, self.load * self.gap0.size)

    def first_guess(self) -> Array:
        """Initial pressure: the load spread over as many of the highest points as carry it at H, or at 0.1 E*."""
        soft = min(self.line.mean_hardness, 0.1 * self.half_space.modulus)
        gap0 = self.gap0
        n = max(min(4, gap0.size), min(gap0.size, int(self.load / soft * gap0.size)))
        touching = gap0 <= np.partition(gap0, n - 1, axis=None)[n - 1]
        return touching * (self.load * gap0.size / np.count_nonzero(touching))


def _solve(level: _Level, rtol: float) -> Contact:
    """Solve at once where no point or every point is at its bound, else from coarse grids to the given one."""
    # what the highest points are above others is known to all its digits, however small it is beside the heights
    offset = float(level.gap0.min())
    if level.load == 0:
        return _uniform(level, offset, 0.0)
    if level.load >= level.line.capacity * (1 - 1e-12):
        return _uniform(level, offset, level.line.hardness)
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
        del grid, coarse  # before the next ones take memory
    grid = workspace(level.half_space)
    grid.start(start, level.line.limit)
    solution = solve_active_sets(grid, level.on_grid(offset), rtol, _MAX_ITERATIONS)
    _check(level, float(grid.pressure.mean()), solution, rtol)
    return _contact(level, grid, offset, solution)


def _uniform(level: _Level, offset: float, pressure: float | Array) -> Contact:
    """Solution of no load, or of a pressure at which every point is in contact."""
    grid = workspace(level.half_space)
    grid.pressure[:] = pressure
    v = grid.displacement()
    v += level.gap0 - offset
    delta = float(v.max()) if grid.pressure.any() else 0.0
    return _contact(level, grid, offset, Solution(delta, 0.0, 0, 1))


def _check(level: _Level, carried: float, solution: Solution, rtol: float) -> None:
    """Raise NotConverged if the load or the residual is not what was asked for."""
    if not abs(carried - level.load) <= 1e-9 * level.load:
        raise NotConverged(
            f"contact: the load is {carried / level.load:.6g} of the given one; try another grid",
            solution.residual,
        )
    if not solution.residual <= rtol:
        raise NotConverged(
            f"contact: residual {solution.residual:.1e} after {solution.iterations} iterations, wanted {rtol:.1e}; "
            "try a larger rtol, a filtered surface or a finer grid",
            solution.residual,
        )


def _contact(level: _Level, grid: Workspace, offset: float, solution: Solution) -> Contact:
    """The solution that a grid holds, in the fields of a `Contact`."""
    v, pressure = grid.arrays.v, grid.pressure
    p = pressure.copy() if grid.is_kept else pressure
    grid.release()
    gap, deformation, plastic = np.empty(p.shape), np.empty(p.shape), np.empty(p.shape, bool)
    over(
        rows(*p.shape),
        gap_and_deformation,
        p.ravel(),
        v,
        solution.delta,
        grid.stiffness,
        level.line.hardness.ravel(),
        level.line.slope.ravel(),
        gap.ravel(),
        deformation.ravel(),
        plastic.ravel(),
    )
    return Contact(
        pressure=p,
        gap=gap,
        plastic_deformation=deformation,
        approach=solution.delta + offset,
        residual=solution.residual,
        iterations=solution.iterations,
        fft_pairs=solution.products,
        plastic=plastic,
        half_space=level.half_space,
    )


def _solve_by_tangents(law: ContactLaw, level: _Level, rtol: float) -> Contact:
    """Solve a curved law by contacts with its tangents, each at the deformation that the former contact gives the law.

    A tangent so steep that it leaves no pressure at u = 0 holds from a depth on, which is in the gap of its contact.
    Where the law softens and u turns back, it goes half way, as it would turn for ever between two tangents.

    Raises
    ------
    NotConverged : pressures and deformations do not come to the law within `_MOST_TANGENTS` solutions.
    """
    iterations = pairs = 0
    shape, stiffness = level.half_space.shape, level.half_space.stiffness
    u, change = np.zeros(shape), np.zeros(shape)
    for _ in range(_MOST_TANGENTS):
        modulus = law.hardening_modulus(u)
        slope = np.maximum(modulus, 1.0)
        depth = np.maximum(u - _FROM_DEPTH * law.yield_pressure(u) / slope, 0.0)
        line = law.after(depth).tangent(shape, u - depth)
        if level.load >= line.capacity * (1 - 1e-9):
            line = replace(
                line, slope=np.maximum(line.slope, 0.1 * stiffness)
            )  # the curve carries it further on
        contact = _solve(level._replace(gap0=level.gap0 + depth, line=line), rtol)
        iterations, pairs = iterations + contact.iterations, pairs + contact.fft_pairs
        raw = contact.raw_gap - depth
        y, wanted = law.admissible(contact.pressure, raw, stiffness)
        mismatch = float(np.linalg.norm(contact.pressure - y)) / (
            float(np.linalg.norm(contact.pressure)) or 1.0
        )
        if mismatch <= rtol:
            if depth.any():
                left = np.where(wanted > 0, np.maximum(-raw, 0.0), 0.0)
                contact = replace(
                    contact, gap=np.maximum(raw, 0.0), plastic_deformation=left, plastic=wanted > 0
                )
            return replace(contact, iterations=iterations, fft_pairs=pairs)
        softens = np.minimum(modulus, law.hardening_modulus(wanted)) < 0
        change = np.where(softens & ((wanted - u) * change < 0), 0.5, 1.0) * (wanted - u)
        u = u + change
    raise NotConverged(
        f"contact: pressures are off the law by {mismatch:.1e} after {_MOST_TANGENTS} tangents, wanted "
        f"{rtol:.1e}; try a law that softens less, such as a smoother table or a larger smallest depth, or a "
        "finer grid",
        mismatch,
    )
