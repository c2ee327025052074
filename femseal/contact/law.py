"""Contact laws: what a point of the faces can carry, and what it keeps of a load.

Symbols: p contact pressure, u plastic deformation, H(u) pressure at which a point with u yields, h = dH/du hardening
modulus, g raw gap (negative where faces overlap), c a stiffness [Pa/m].

Where 0 < p < H(u), contact is elastic. Where a point yields, p = H(u) and u grows. A law is the curve H(u), and a new
one is a class with this curve; the solver sees straight lines, its tangents. A law whose curve rises is a convex term
of the energy, ½⟨(p − H)₊, (p − H)₊⟩/h for a straight line.
Source: Sahlin et al., Proc. IMechE J 224, 2010, 335 (perfectly plastic).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Shape, reals, to_text
from ..store.code import NoDigest
from ..store.digests import digest

#: Newton steps, or halvings, of a projection onto a curved law, one for a straight line; steepest fall over c for them.
_NEWTON_STEPS, _STEEPEST = 60, 0.8
#: Depths [m] at which curves of two faces are compared.
_COMPARED = np.r_[0.0, np.geomspace(1e-10, 1e-3, 281)]


class ContactLaw:
    """A law of contact: base of all; a new one defines `yield_pressure` and `hardening_modulus`.

    A law is best a frozen dataclass (with `eq=False`) whose fields are its parameters: they make its key.
    """

    @property
    def linear(self) -> bool:
        """Whether H(u) is a straight line at every point: then one solution is enough, else there are several."""
        return False

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """H(u) [Pa] of a plastic deformation u [m]: one number, or one for each point (n1, n2)."""
        raise NotImplementedError

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """dH/du [Pa/m] at a plastic deformation u [m]: one number, or one for each point (n1, n2)."""
        raise NotImplementedError

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points carry; inf where any of them hardens."""
        return inf if np.any(self.hardening_modulus() > 0) else self.mean_hardness

    @property
    def mean_hardness(self) -> float:
        """Mean pressure at which points yield for the first time [Pa]; inf is elastic."""
        return float(np.mean(self.yield_pressure()))

    @property
    def is_perfect(self) -> bool:
        """Whether points neither harden nor soften: the law has pressures alone, and no length."""
        return self.linear and not np.any(self.hardening_modulus() > 0)

    @property
    def is_elastic(self) -> bool:
        """Whether no point ever yields."""
        return bool(np.all(np.isinf(self.yield_pressure())))

    @property
    def is_uniform(self) -> bool:
        """Whether all points follow one curve."""
        return np.size(self.yield_pressure()) == 1 and np.size(self.hardening_modulus()) == 1

    def after(self, deformation: ArrayLike) -> ContactLaw:
        """The law of points that an earlier load left with a plastic deformation (n1, n2) [m]: H(u + deformation)."""
        return self if self.is_perfect else _Changed(self, kept=reals(deformation))

    def less(self, fluid_pressure: ArrayLike) -> ContactLaw:
        """The law of the contact pressure where a fluid pressure [Pa] presses on the faces too: H(u) − p_f."""
        return _Changed(self, fluid_pressure=reals(fluid_pressure))

    def times(self, factor: float) -> ContactLaw:
        """The law of a metal `factor` times as hard: factor · H(u)."""
        return _Changed(self, factor=factor)

    def admissible(self, pressure: Array, gap: Array, stiffness: float) -> tuple[Array, Array]:
        """The admissible pressure y >= 0 [Pa] near a pressure p with the raw gap g, and its deformation u [m].

        It is the projection of z = p − c g: z = y + c u, and y = H(u) where y yields. It minimises ½(y − z)² + c ψ(y),
        ψ the energy of the law. Where the law falls steeply there are several: a point that has gone through
        the steep part stays at its overlap, as its neighbours have taken what it no longer carries.
        """
        trial = pressure - stiffness * gap
        u = self._deformation(trial, stiffness)
        y = np.clip(trial, 0.0, self.yield_pressure(u))
        overlap = np.maximum(-gap, 0.0)
        slope = self.hardening_modulus(overlap)
        if not np.any(slope < 0):
            return y, u
        yields = self.yield_pressure(overlap)
        deep = (
            (slope < 0)
            & (overlap > 0)
            & ((overlap > u) | (np.abs(pressure - yields) < np.abs(pressure - y)))
        )
        slack = (
            np.maximum(slope, -_STEEPEST * stiffness) + stiffness
        )  # near 0 Newton's method goes anywhere
        return np.where(deep, yields, y), np.where(
            deep, np.maximum(overlap + (pressure - yields) / slack, 0.0), u
        )

    def _deformation(self, trial: Array, stiffness: float) -> Array:
        """u >= 0 with H(u) + c u = z, 0 where z < H(0), by Newton's method between bounds, which it halves."""
        u = np.zeros(np.shape(trial))
        low = u
        high = np.full(u.shape, inf) if self.linear else np.maximum(trial, 0.0) / stiffness
        change = high
        for _ in range(1 if self.linear else _NEWTON_STEPS):
            excess = self.yield_pressure(u) + stiffness * u - trial
            low, high = np.where(excess < 0, u, low), np.where(excess < 0, high, u)
            with np.errstate(divide="ignore"):
                step = -excess / (self.hardening_modulus(u) + stiffness)
            slow = (np.abs(step) > 0.5 * np.abs(change)) & (np.abs(step) > 1e-12 * high)
            inside = (u + step >= low) & (u + step <= high) & ~slow
            change = np.where(inside, step, 0.5 * (low + high) - u)
            former, u = u, u + change
            if np.array_equal(u, former):
                break
        return u

    def tangent(self, shape: Shape, deformation: ArrayLike = 0.0) -> YieldLine:
        """The straight line that touches the law at a plastic deformation [m]; where the law softens, a flat one.

        Raises
        ------
        InputError : the law has arrays of another shape, or a yield pressure that is not > 0.
        """
        hardness, slope = self.yield_pressure(deformation), self.hardening_modulus(deformation)
        slope = np.maximum(slope, 0.0)
        hardness = hardness - slope * reals(deformation)
        hardness, slope = (np.atleast_1d(reals(values)) for values in (hardness, slope))
        for values in (hardness, slope):
            if values.size != 1 and values.shape != shape:
                raise InputError(
                    "hardness", f"shape {values.shape}", f"a number or an array {shape} [Pa]"
                )
        if not np.all(hardness > 0):
            raise InputError("hardness", f"{hardness.min():g} Pa", "numbers > 0 [Pa]")
        return YieldLine(hardness, slope)

    def key(self) -> str:
        """Return a text that is the same for laws of the same parameters and code, and for no others."""
        try:
            return digest(self)
        except NoDigest:  # as of an object of C code: the law is equal to itself alone
            return f"{type(self).__qualname__} {id(self)}"

    def __str__(self) -> str:
        return f"{type(self).__name__} with hardness {to_text(self.mean_hardness, 'Pa')}"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ContactLaw) and self.key() == other.key()

    def __hash__(self) -> int:
        return hash(self.key())


@dataclass(frozen=True, eq=False)
class LinearHardening(ContactLaw):
    """A point hardens evenly as it yields: H(u) = H + h u.

    After unloading, a point keeps H + h u as its hardness: reloading up to the peak is elastic where nothing yields
    again, and beyond the peak the first loading goes on.

    Parameters
    ----------
    hardness : H [Pa] > 0 where yield begins, a number or one for each point (n1, n2).
    slope : h [Pa/m] >= 0, a number or one for each point; 0 is perfectly plastic.

    Raises
    ------
    InputError : a hardness that is not > 0, or a slope that is not a finite number >= 0.

    Examples
    --------
    >>> law = LinearHardening(4e9, 2e15)
    >>> float(law.yield_pressure(1e-6))
    6000000000.0
    >>> law.capacity
    inf
    """

    hardness: float | Array
    slope: float | Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "hardness", _numbers("hardness", self.hardness, "Pa"))
        object.__setattr__(self, "slope", _numbers("slope", self.slope, "Pa/m", zero=True))

    @property
    def linear(self) -> bool:
        """True."""
        return True

    @property
    def is_uniform(self) -> bool:
        """Whether hardness and slope are numbers."""
        return isinstance(self.hardness, float) and isinstance(self.slope, float)

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points carry; inf where any of them hardens."""
        return self._uniform_line.capacity if self.is_uniform else super().capacity

    def tangent(self, shape: Shape, deformation: ArrayLike = 0.0) -> YieldLine:
        """The law itself, whatever the deformation."""
        return self._uniform_line if self.is_uniform else super().tangent(shape, 0.0)

    @cached_property
    def _uniform_line(self) -> YieldLine:
        return super().tangent((1, 1))

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """H + h u."""
        return self.hardness + self.slope * reals(deformation)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """h, whatever the deformation."""
        return self.slope

    def __str__(self) -> str:
        hardening = f"{float(np.mean(self.slope)) / 1e15:.4g} GPa/µm"
        return f"elastic-plastic with hardness {to_text(self.mean_hardness, 'Pa')} and hardening {hardening}"


@dataclass(frozen=True, eq=False)
class PerfectlyPlastic(LinearHardening):
    """A point carries its hardness H at most: H(u) = H.

    Parameters
    ----------
    hardness : H [Pa] > 0, a number or one for each point (n1, n2); inf is elastic.

    Raises
    ------
    InputError : values that are not > 0.

    Examples
    --------
    >>> float(PerfectlyPlastic(4e9).yield_pressure(1e-6))
    4000000000.0
    """

    hardness: float | Array = inf
    slope: float | Array = field(default=0.0, init=False, repr=False)

    def __str__(self) -> str:
        if self.is_elastic:
            return "elastic"
        return f"elastic-perfectly plastic with hardness {to_text(self.mean_hardness, 'Pa')}"


@dataclass(frozen=True, eq=False)
class _Changed(ContactLaw):
    """factor · H(u + kept) − p_f: points that have yielded before, a harder metal, a fluid that presses too."""

    law: ContactLaw
    kept: float | Array = 0.0
    fluid_pressure: float | Array = 0.0
    factor: float = 1.0

    @property
    def linear(self) -> bool:
        """As the law that is changed."""
        return self.law.linear

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """factor · H(u + kept) − p_f."""
        pressure = self.law.yield_pressure(self.kept + reals(deformation))
        return self.factor * pressure - self.fluid_pressure

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """factor · h(u + kept)."""
        return self.factor * self.law.hardening_modulus(self.kept + reals(deformation))

    @property
    def capacity(self) -> float:
        """That of the law that is changed, less the mean fluid pressure."""
        return self.factor * self.law.capacity - float(np.mean(self.fluid_pressure))

    def __str__(self) -> str:
        return str(self.law)


@dataclass(frozen=True, eq=False)
class SofterOf(ContactLaw):
    """Of two faces, the one that is softer at each depth yields: H(u) = min(H₁(u), H₂(u)).

    one, two : their laws, each of one curve; `softer_of` makes it where the curves cross.
    """

    one: ContactLaw
    two: ContactLaw

    @property
    def capacity(self) -> float:
        """The lower of both."""
        return min(self.one.capacity, self.two.capacity)

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """The lower H(u)."""
        return np.minimum(
            self.one.yield_pressure(deformation), self.two.yield_pressure(deformation)
        )

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """That of the lower H(u)."""
        first = self.one.yield_pressure(deformation) <= self.two.yield_pressure(deformation)
        return np.where(
            first, self.one.hardening_modulus(deformation), self.two.hardening_modulus(deformation)
        )

    def __str__(self) -> str:
        return f"the softer at each depth of {self.one}, and {self.two}"


def softer_of(one: ContactLaw, two: ContactLaw | None = None) -> ContactLaw:
    """The law of the softer of two faces, each of one curve; None is rigid. `SofterOf` where the curves cross."""
    if two is None:
        return one
    first, second = (
        np.broadcast_to(law.yield_pressure(_COMPARED), _COMPARED.shape) for law in (one, two)
    )
    if np.all(first <= second):
        return one
    return two if np.all(second <= first) else SofterOf(one, two)


@dataclass(frozen=True, eq=False)
class YieldLine:
    """What the solver knows of a law: H(u) = hardness + slope u at every point.

    hardness, slope : [Pa] and [Pa/m], each of one value (1,) or of one for each point (n1, n2).
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
        return self.hardness.item() if self.hardness.size == 1 else float(self.hardness.mean())

    @cached_property
    def capacity(self) -> float:
        """Largest mean pressure that the points carry [Pa]."""
        return inf if self.hardens else self.mean_hardness

    @cached_property
    def limit(self) -> Array:
        """Largest pressure of each point [Pa], inf where it hardens: (1,) or (n1, n2)."""
        return np.where(self.slope > 0, inf, self.hardness) if self.hardens else self.hardness


def contact_law(hardness: float | ArrayLike | ContactLaw) -> ContactLaw:
    """A law as given, or the perfectly plastic one of a hardness [Pa], a number or an array (n1, n2)."""
    if isinstance(hardness, ContactLaw):
        return hardness
    if isinstance(hardness, float):
        return _plastic(hardness)
    return PerfectlyPlastic(hardness)  # type: ignore[arg-type]


@lru_cache(maxsize=64)
def _plastic(hardness: float) -> PerfectlyPlastic:
    """The law of a number, which is checked once."""
    return PerfectlyPlastic(hardness)


def _numbers(name: str, value: Any, unit: str, *, zero: bool = False) -> float | Array:
    """A number, or an array of numbers, > 0 or with `zero` finite and >= 0."""
    expected = f"a number or an array (n1, n2) [{unit}]"
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        array = reals(value)
    except (TypeError, ValueError):
        raise InputError(name, repr(value), expected) from None
    good = (array >= 0) & np.isfinite(array) if zero else array > 0
    if not np.all(good):
        wanted = f"finite numbers >= 0 [{unit}]" if zero else f"numbers > 0 [{unit}]"
        raise InputError(name, f"{array.min():g} {unit}" if array.size else "no numbers", wanted)
    return float(array.item()) if array.size == 1 else array
