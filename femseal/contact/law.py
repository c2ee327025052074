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

from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Flags, InputError, Shape, reals, to_text
from .curve_pieces import CurvePieces
from .curve_projection import project_on_curve
from .yield_line import YieldLine


class ContactLaw:
    """Base class of all contact laws. A law has to define `yield_pressure` and `hardening_modulus`.

    A law should be a frozen dataclass (with `eq=False`). The fields of the dataclass are the parameters of the law. Two
    laws are equal if they are of the same class and have the same parameters.
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
        """Write the law as factor · H(u + u₀) − p_f, where the law H(u) is not written in this way itself."""
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
        return ShiftedLaw(self, earlier_deformation=reals(deformation))

    def less(self, fluid_pressure: ArrayLike) -> ContactLaw:
        """Return the law H(u) − p_f, which limits the contact pressure where the fluid pressure is p_f [Pa]."""
        return ShiftedLaw(self, fluid_pressure=reals(fluid_pressure))

    def times(self, factor: float) -> ContactLaw:
        """Return the law factor · H(u), in which all hardnesses are multiplied by a factor."""
        return ShiftedLaw(self, factor=factor)

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

    def __str__(self) -> str:
        return f"{type(self).__name__} with hardness {to_text(self.mean_hardness, 'Pa')}"

    def __eq__(self, other: object) -> bool:
        """Return whether another law is of the same class and has the same parameters."""
        if self is other:
            return True
        # the parameters of a law are unknown if its class itself is not a dataclass; it is then only equal to itself
        is_undescribed = "__dataclass_fields__" not in vars(type(self))
        if type(self) is not type(other) or not is_dataclass(self) or is_undescribed:
            return False
        names = [parameter.name for parameter in fields(self)]
        return all(_is_equal(getattr(self, name), getattr(other, name)) for name in names)

    def __hash__(self) -> int:
        # equal laws are of the same class; their arrays are too large to be hashed
        return hash(type(self))


@dataclass(frozen=True, eq=False)
class ShiftedLaw(ContactLaw):
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
            earlier_deformation=values_of_points(self.earlier_deformation, is_chosen),
            fluid_pressure=values_of_points(self.fluid_pressure, is_chosen),
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


def _is_equal(first: Any, second: Any) -> bool:
    """Return whether two parameters of laws are equal: numbers, arrays, laws, or other objects."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    return bool(first == second)


def values_of_points(values: float | Array, is_chosen: Flags) -> float | Array:
    """Return the values at the chosen points. A single number applies to all points, and is returned unchanged."""
    return values[is_chosen] if isinstance(values, np.ndarray) and values.ndim > 0 else values
