"""Define contact laws: the pressure that a point of the surface can carry, and the plastic deformation that remains.

Symbols: p contact pressure, u plastic deformation, H(u) pressure at which a point with the plastic deformation u
yields, h = dH/du hardening modulus, g raw gap (negative where the bodies would overlap), c a stiffness [Pa/m].

The contact of a point is elastic while 0 < p < H(u). When the point yields, p = H(u), and u increases. A contact law is
a class that defines the curve H(u). The compiled loops of the contact solver use only straight lines; a curve H(u) is
replaced by its tangents. If H increases with u, the contact law adds a convex term to the energy that the solver
minimises. For a straight line H + h u, the convex term is ½⟨(p − H)₊, (p − H)₊⟩/h. For perfect plasticity see Sahlin et
al., Proc. IMechE J 224, 2010, 335.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import inf
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Flags, InputError, Shape, reals, to_text
from ..store.digests import NoDigest, digest
from .curve_pieces import CurvePieces
from .curve_projection import project_on_curve

#: Depths at which the laws of two bodies are compared [m].
_COMPARED_DEPTHS = np.r_[0.0, np.geomspace(1e-10, 1e-3, 281)]


class ContactLaw:
    """Base class of all contact laws. A law has to define `yield_pressure` and `hardening_modulus`.

    A law should be a frozen dataclass (with `eq=False`). The fields of the dataclass are the parameters of the law. The
    method `key` identifies the law by its parameters.
    """

    @property
    def linear(self) -> bool:
        """Whether H(u) is a straight line at each point. For a curved law, the contact solver takes longer."""
        return False

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute H(u) [Pa] at a plastic deformation u [m], as a number or an array (n1, n2)."""
        raise NotImplementedError

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute dH/du [Pa/m] at a plastic deformation u [m], as a number or an array (n1, n2)."""
        raise NotImplementedError

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry; infinite if at least one point hardens."""
        return inf if np.any(self.hardening_modulus() > 0) else self.mean_hardness

    @property
    def mean_hardness(self) -> float:
        """Mean pressure at which points yield for the first time [Pa]; infinite for elastic points."""
        return float(np.mean(self.yield_pressure()))

    @property
    def is_perfect(self) -> bool:
        """Whether H(u) is constant at each point (perfect plasticity)."""
        return self.linear and not np.any(self.hardening_modulus() > 0)

    @property
    def is_elastic(self) -> bool:
        """Whether no point ever yields."""
        return bool(np.all(np.isinf(self.yield_pressure())))

    @property
    def is_uniform(self) -> bool:
        """Whether the curve H(u) is the same for all points."""
        return np.size(self.yield_pressure()) == 1 and np.size(self.hardening_modulus()) == 1

    @property
    def constant_depth(self) -> float:
        """Plastic deformation [m] up to which H(u) is the same constant for all points; 0 if H(u) varies from u = 0 on.

        The solver first computes the contact with the constant hardness H(0). If no point is deformed beyond
        `constant_depth`, this result is already the solution, at no more cost than perfect plasticity.
        """
        return inf if self.is_perfect and self.is_uniform else 0.0

    @property
    def bends(self) -> Array:
        """Plastic deformations [m] at which H(u) or one of its derivatives may be discontinuous."""
        return np.array([self.constant_depth])

    @cached_property
    def pieces(self) -> CurvePieces | None:
        """Curve H(u) of a uniform law as cubic pieces, which compiled loops can evaluate.

        The value is None if too many pieces would be needed to represent the curve.
        """
        return CurvePieces.of(self.yield_pressure, self.bends)

    def shifted(self) -> ShiftedLaw:
        """Write the law as factor · H(u + u₀) − p_f with another law H(u); return that law and the three parameters."""
        return ShiftedLaw(self)

    def of_points(self, is_chosen: Flags) -> ContactLaw | None:
        """Return the law of the chosen points alone, or None if the law cannot be split into points.

        is_chosen : flags (n1, n2). The methods of the returned law take and return arrays (number of chosen points,).
        """
        return self if self.is_uniform else None

    def after(self, deformation: ArrayLike) -> ContactLaw:
        """Return the law H(u + u₀) of points that already have a plastic deformation u₀, given as `deformation` [m]."""
        if self.is_perfect:
            return self
        return _ChangedLaw(self, earlier_deformation=reals(deformation))

    def less(self, fluid_pressure: ArrayLike) -> ContactLaw:
        """Return the law H(u) − p_f, which limits the contact pressure where the fluid pressure is p_f [Pa]."""
        return _ChangedLaw(self, fluid_pressure=reals(fluid_pressure))

    def times(self, factor: float) -> ContactLaw:
        """Return the law factor · H(u), in which all hardnesses are multiplied by a factor."""
        return _ChangedLaw(self, factor=factor)

    def admissible(self, pressure: Array, gap: Array, stiffness: float) -> tuple[Array, Array]:
        """Project a contact pressure on the law; return the projected pressure and the plastic deformation.

        The projection y of the trial pressure z = p − c g satisfies z = y + c u, with y = H(u) at points that yield.
        The projection minimises ½(y − z)² + c ψ(y), where ψ is the energy of the contact law.

        If the law softens steeply, the equation z = H(u) + c u may have several solutions u. If the overlap −g of a
        point lies beyond the steep part of the curve, the point has already softened and shed load onto its neighbours.
        In this case, the solution u close to the overlap is chosen.

        Parameters
        ----------
        pressure : array (n1, n2)
            Contact pressure p [Pa].
        gap : array (n1, n2)
            Raw gap g [m].
        stiffness : float
            Stiffness c [Pa/m].

        Returns
        -------
        pressure : array (n1, n2)
            Admissible pressure y >= 0 [Pa].
        deformation : array (n1, n2)
            Plastic deformation u [m].
        """
        trial = pressure - stiffness * gap
        first_hardness = self.yield_pressure()
        depth = self.constant_depth
        # whether a point may be deformed beyond the part of the curve with constant hardness
        is_curved = (trial > first_hardness + stiffness * depth) | (gap < -depth)
        law = self.of_points(is_curved)
        if law is None:
            return project_on_curve(self, pressure, gap, stiffness)
        # most points are elastic or within the constant part of the curve, and are projected on the constant
        y = np.clip(trial, 0.0, first_hardness)
        u = np.maximum(trial - first_hardness, 0.0) / stiffness
        if np.any(is_curved):
            y[is_curved], u[is_curved] = project_on_curve(
                law, pressure[is_curved], gap[is_curved], stiffness
            )
        return y, u

    def tangent(self, shape: Shape, deformation: ArrayLike = 0.0) -> YieldLine:
        """Compute the tangent of the curve H(u) at a plastic deformation.

        Where the law softens, a horizontal line through the point of the curve replaces the tangent.

        Parameters
        ----------
        shape : pair of int
            Numbers of points of the grid.
        deformation : float or array (n1, n2)
            Plastic deformation u [m].

        Raises
        ------
        InputError
            A parameter of the law is an array of another shape than the grid, or a yield pressure is not positive.
        """
        slope = np.maximum(self.hardening_modulus(deformation), 0.0)
        hardness = self.yield_pressure(deformation) - slope * reals(deformation)
        hardness = np.atleast_1d(reals(hardness))
        slope = np.atleast_1d(reals(slope))
        for values in (hardness, slope):
            if values.size != 1 and values.shape != shape:
                expected = f"a number or an array {shape} [Pa]"
                raise InputError("hardness", f"shape {values.shape}", expected)
        if not np.all(hardness > 0):
            raise InputError("hardness", f"{hardness.min():g} Pa", "numbers > 0 [Pa]")
        return YieldLine(hardness, slope)

    def key(self) -> str:
        """Return a text that identifies the law by its class and its parameters."""
        try:
            return digest(self)
        except NoDigest:
            # the class is not part of femseal or of an installed package; the law is then only equal to itself
            return self._unique_key

    @cached_property
    def _unique_key(self) -> str:
        """Text that no other law has, not even a law that takes the place of this one in memory."""
        return f"{type(self).__qualname__} {uuid4()}"

    def __str__(self) -> str:
        return f"{type(self).__name__} with hardness {to_text(self.mean_hardness, 'Pa')}"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ContactLaw) and self.key() == other.key()

    def __hash__(self) -> int:
        return hash(self.key())


class ShiftedLaw(NamedTuple):
    """Parameters of the law factor · H(u + u₀) − p_f, which is derived from another law H(u).

    law : law H(u).
    factor : factor by which the hardness H is multiplied.
    earlier_deformation : plastic deformation u₀ [m] from an earlier load, a number or an array (n1, n2).
    fluid_pressure : pressure p_f [Pa] of a fluid between the surfaces, a number or an array (n1, n2).
    """

    law: ContactLaw
    factor: float = 1.0
    earlier_deformation: float | Array = 0.0
    fluid_pressure: float | Array = 0.0


@dataclass(frozen=True, eq=False)
class LinearHardening(ContactLaw):
    """Contact law of points that harden linearly with their plastic deformation: H(u) = H + h u.

    During unloading, a point keeps the yield pressure H + h u that it has reached. Reloading is elastic up to the
    earlier peak load, unless points have yielded again during unloading. At loads above the earlier peak load, the
    contact follows the curve of first loading.

    Parameters
    ----------
    hardness : float or array (n1, n2)
        Hardness H > 0 at which yield begins [Pa].
    slope : float or array (n1, n2)
        Hardening modulus h >= 0 [Pa/m]; 0 for perfect plasticity.

    Raises
    ------
    InputError
        A hardness is not positive, or a slope is negative or infinite.

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
        object.__setattr__(self, "hardness", _checked_numbers("hardness", self.hardness, "Pa"))
        slope = _checked_numbers("slope", self.slope, "Pa/m", allow_zero=True)
        object.__setattr__(self, "slope", slope)

    @property
    def linear(self) -> bool:
        """Whether H(u) is a straight line, which is always the case for this law."""
        return True

    @property
    def is_uniform(self) -> bool:
        """Whether hardness and slope are single numbers, which apply to all points."""
        return isinstance(self.hardness, float) and isinstance(self.slope, float)

    def of_points(self, is_chosen: Flags) -> ContactLaw:
        """Return the law of the chosen points, see `ContactLaw.of_points`."""
        if self.is_uniform:
            return self
        hardness, slope = (
            _values_of_points(values, is_chosen) for values in (self.hardness, self.slope)
        )
        return LinearHardening(hardness, slope)

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry; infinite if at least one point hardens."""
        # a uniform law need not create arrays
        return self._uniform_line.capacity if self.is_uniform else super().capacity

    def tangent(self, shape: Shape, deformation: ArrayLike = 0.0) -> YieldLine:
        """Return the line H + h u, which is its own tangent at any deformation."""
        return self._uniform_line if self.is_uniform else super().tangent(shape, 0.0)

    @cached_property
    def _uniform_line(self) -> YieldLine:
        """Line H + h u of a uniform law. The line is stored, so that hardness and slope are checked only once."""
        return super().tangent((1, 1))

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute H + h u [Pa]."""
        return self.hardness + self.slope * reals(deformation)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Return h [Pa/m], which does not depend on the deformation."""
        return self.slope

    def __str__(self) -> str:
        hardening = f"{float(np.mean(self.slope)) / 1e15:.4g} GPa/µm"
        return f"elastic-plastic with hardness {to_text(self.mean_hardness, 'Pa')} and hardening {hardening}"


@dataclass(frozen=True, eq=False)
class PerfectlyPlastic(LinearHardening):
    """Contact law of points whose pressure is limited by a constant hardness: H(u) = H.

    Parameters
    ----------
    hardness : float or array (n1, n2)
        Hardness H > 0 [Pa]; infinite for elastic points.

    Raises
    ------
    InputError
        A hardness is not positive.

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
class _ChangedLaw(ContactLaw):
    """Contact law factor · H(u + u₀) − p_f, which is derived from an original law H(u).

    law : original law H(u).
    earlier_deformation : plastic deformation u₀ [m] from an earlier load.
    fluid_pressure : pressure p_f [Pa] of a fluid between the surfaces.
    factor : factor by which the hardness H is multiplied.
    """

    law: ContactLaw
    earlier_deformation: float | Array = 0.0
    fluid_pressure: float | Array = 0.0
    factor: float = 1.0

    @property
    def linear(self) -> bool:
        """Whether the original law is a straight line."""
        return self.law.linear

    @cached_property
    def constant_depth(self) -> float:  # type: ignore[override]
        """Plastic deformation u [m] up to which the hardness is constant: the original law's depth minus u₀."""
        if np.ndim(self.fluid_pressure) > 0:
            return 0.0
        return max(0.0, self.law.constant_depth - float(np.max(self.earlier_deformation)))

    def shifted(self) -> ShiftedLaw:
        """Merge factor, u₀ and p_f of this law with those of the law from which it is derived."""
        inner = self.law.shifted()
        return ShiftedLaw(
            inner.law,
            factor=self.factor * inner.factor,
            earlier_deformation=inner.earlier_deformation + self.earlier_deformation,
            fluid_pressure=self.factor * inner.fluid_pressure + self.fluid_pressure,
        )

    def of_points(self, is_chosen: Flags) -> ContactLaw | None:
        """Return the law of the chosen points, see `ContactLaw.of_points`."""
        law = self.law.of_points(is_chosen)
        if law is None:
            return None
        return replace(
            self,
            law=law,
            earlier_deformation=_values_of_points(self.earlier_deformation, is_chosen),
            fluid_pressure=_values_of_points(self.fluid_pressure, is_chosen),
        )

    def tangent(self, shape: Shape, deformation: ArrayLike = 0.0) -> YieldLine:
        """Compute the tangent of the curve H(u), see `ContactLaw.tangent`."""
        if np.ndim(deformation) == 0 and float(deformation) < self.constant_depth:  # type: ignore[arg-type]
            # the hardness is constant, whatever the earlier deformation of a point is
            law = replace(self, earlier_deformation=0.0)
            return ContactLaw.tangent(law, shape)
        return super().tangent(shape, deformation)

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute factor · H(u + u₀) − p_f [Pa]."""
        pressure = self.law.yield_pressure(self.earlier_deformation + reals(deformation))
        return self.factor * pressure - self.fluid_pressure

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute factor · h(u + u₀) [Pa/m], where h is the hardening modulus of the original law."""
        modulus = self.law.hardening_modulus(self.earlier_deformation + reals(deformation))
        return self.factor * modulus

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry: factor · capacity of the original law − mean of p_f."""
        return self.factor * self.law.capacity - float(np.mean(self.fluid_pressure))

    def __str__(self) -> str:
        return str(self.law)


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


def contact_law(hardness: float | ArrayLike | ContactLaw) -> ContactLaw:
    """Return a contact law unchanged, or make the perfectly plastic law for a hardness [Pa].

    hardness : a law, a number, or an array (n1, n2).
    """
    if isinstance(hardness, ContactLaw):
        return hardness
    if isinstance(hardness, float):
        return _law_of_number(hardness)
    return PerfectlyPlastic(hardness)  # type: ignore[arg-type]


@lru_cache(maxsize=64)
def _law_of_number(hardness: float) -> PerfectlyPlastic:
    """Make the perfectly plastic law for a single hardness [Pa]; repeated calls return the same law."""
    return PerfectlyPlastic(hardness)


def _values_of_points(values: float | Array, is_chosen: Flags) -> float | Array:
    """Return the values at the chosen points. A single number applies to all points, and is returned unchanged."""
    return values[is_chosen] if isinstance(values, np.ndarray) and values.ndim > 0 else values


def _checked_numbers(
    name: str, value: Any, unit: str, *, allow_zero: bool = False
) -> float | Array:
    """Return a value as a float or an array, and raise InputError if it contains numbers that are not allowed.

    By default, all numbers must be positive; infinity is allowed. With `allow_zero`, all numbers must be finite and not
    negative.
    """
    expected = f"a number or an array (n1, n2) [{unit}]"
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        array = reals(value)
    except (TypeError, ValueError):
        raise InputError(name, repr(value), expected) from None
    if allow_zero:
        is_allowed = (array >= 0) & np.isfinite(array)
        expected = f"finite numbers >= 0 [{unit}]"
    else:
        is_allowed = array > 0
        expected = f"numbers > 0 [{unit}]"
    if not np.all(is_allowed):
        given = f"{array.min():g} {unit}" if array.size else "no numbers"
        raise InputError(name, given, expected)
    return float(array.item()) if array.size == 1 else array
