"""Describe the pressure drop of a fluid, and solve flows −K(h, p) (ρ/η) ∇p whose permeability depends on the pressure.

With K = (h³/12) F and the potential dψ = F(h₀, p) (ρ/η) dp for a reference gap h₀, the flow is linear in ∇ψ with the
permeability (h³/12) F(h, p)/F(h₀, p). It is solved by a fixed-point iteration: the pressures of one solution give the
ratio F(h, p)/F(h₀, p) for the next one. The reference gap h₀ is the gap at the critical constriction, which controls
the flow. There the ratio is close to 1 at all pressures, so that each iteration gains about two digits for a gas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, reals
from ..base.fixed_point import fixed_point
from .law import CUBIC_LAW, FlowLaw, law_of, widened
from .percolation import critical_constriction
from .permeability_table import Mobility, table_pressures

FaceSolution = TypeVar("FaceSolution")
#: Number of intervals of the table of potentials and pressures.
_INTERVALS = 2000
#: Gauss points and their weights in the interval from −1 to 1.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)
#: Lowest pressure at which the factor F is computed, as a fraction of the higher of inlet and outlet pressure.
_LEAST_PRESSURE = 1e-9
#: Gap [m], far smaller than an atom, that replaces a closed gap in the computation of F.
_LEAST_GAP = 1e-12


class FlowingFluid(Protocol):
    """Properties of a fluid that determine its flow through gaps.

    These are the pressure potential of the fluid, and its flow law. A fluid without the attribute `law` follows the
    cubic law.
    """

    def potential(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Compute the pressure potential of the viscous flow [kg/(m³ s)]."""
        ...

    def pressure(self, potential: ArrayLike) -> NDArray[np.float64]:
        """Compute the pressure [Pa] from the pressure potential."""
        ...


@dataclass(frozen=True)
class _UnitFluid:
    """A fluid with a given flow law, whose potential is equal to its pressure."""

    law: FlowLaw = CUBIC_LAW

    def potential(self, pressure: ArrayLike) -> Array:
        """Return the pressure, which is also the potential, as an array."""
        return np.asarray(pressure, dtype=float)

    pressure = potential


class _PotentialTable(NamedTuple):
    """Potentials and pressure along the pressure drop, from the outlet to the inlet, arrays (points,).

    ψ : potential of the reference gap [kg/(m³ s)], 0 at the outlet.
    φ : viscous potential [kg/(m³ s)], 0 at the outlet.
    p : pressure [Pa].
    """

    ψ: Array
    φ: Array
    p: Array


def pressure_between(
    fluid: FlowingFluid, inlet: float, outlet: float, fraction: ArrayLike
) -> Array:
    """Compute the pressure [Pa] at a fraction of the viscous potential drop: 1 at the inlet, 0 at the outlet."""
    high, low = fluid.potential([inlet, outlet])
    return fluid.pressure(low + (high - low) * reals(fraction))


@dataclass(frozen=True)
class PressureDrop:
    """Pressure drop of a fluid between inlet and outlet, described by the potential ψ of a reference gap.

    Positions within the drop are given as fractions of the potential difference, from 0 at the outlet to 1 at the
    inlet. If the flow law does not depend on the pressure, ψ is the viscous potential φ.

    Attributes
    ----------
    fluid : fluid with a potential and, optionally, a flow law.
    inlet, outlet : pressures at inlet and outlet [Pa].
    gap : reference gap h₀ > 0 [m], see `at_constriction`.
    """

    fluid: FlowingFluid = _UnitFluid()
    inlet: float = 1.0
    outlet: float = 0.0
    gap: float = 1e-6

    @classmethod
    def of_fluid(cls, fluid: FlowingFluid, inlet: float, outlet: float) -> PressureDrop:
        """Make the pressure drop of a fluid between an inlet and an outlet pressure [Pa].

        If the flow law does not depend on the pressure, the permeability is the same at all pressures. A unit drop is
        then returned instead of the given one.
        """
        law = law_of(fluid)
        if not law.depends_on_pressure:
            return cls(_UnitFluid(law))
        return cls(fluid, float(inlet), float(outlet))

    @cached_property
    def law(self) -> FlowLaw:
        """Flow law of the fluid."""
        return law_of(self.fluid)

    @cached_property
    def pressures(self) -> Array:
        """Pressures [Pa] at which permeabilities are needed, beginning with the highest.

        If the flow law does not depend on the pressure, only the inlet pressure is returned.
        """
        if not self.law.depends_on_pressure:
            return np.array([self.inlet])
        return table_pressures(self.inlet, self.outlet)

    def solve_face(
        self,
        gap: Array,
        spacing: tuple[float, float],
        solve: Callable[[Array], tuple[float, Array, FaceSolution]],
        rtol: float,
    ) -> tuple[FaceSolution, PressureDrop]:
        """Solve the flow through a face that is periodic along x2; the permeability depends on the local pressure.

        Parameters
        ----------
        gap : array (n1, n2), gap [m].
        spacing : lengths of a pixel [m].
        solve : callable that solves the flow through a gap [m] by the cubic law. It returns the permeability, the
            potential at the pixels, and a solution with any further results.
        rtol : relative error at which the fixed-point iteration stops, if the law depends on the pressure.

        Returns
        -------
        Solution of the last call of `solve`, and the pressure drop of the face. The potential in the solution is a
        fraction of this pressure drop. The permeability has to be multiplied by the `mean_factor` of the pressure drop.

        Raises
        ------
        NotConverged : the linear solver failed, or the fixed-point iteration did not converge.
        """
        drop = self.at_constriction(gap, spacing)
        if not drop.law.depends_on_pressure:
            _, _, solution = solve(drop.law.equivalent_gap(gap))
            return solution, drop
        solved = fixed_point(
            lambda fraction: drop.equivalent_gap(gap, fraction),
            solve,
            0.5,
            rtol=rtol,
            name="flow through a face",
        )
        return solved.solution, drop

    def at_constriction(self, gap: Array, spacing: tuple[float, float]) -> PressureDrop:
        """Return this pressure drop with another reference gap: the gap at the critical constriction of a face.

        The face, with the gap (n1, n2) [m], is periodic along x2. If the face is closed, a unit potential drop of a
        viscous fluid is returned.
        """
        if not self.law.depends_on_pressure:
            return self
        constriction = critical_constriction(gap, spacing, sides="periodic")
        if constriction is None:
            return PressureDrop()
        return replace(self, gap=constriction.gap)

    @cached_property
    def _table(self) -> _PotentialTable:
        """Both potentials and the pressure at points from the outlet to the inlet."""
        # the points are dense at the outlet, where the pressure of a gas changes most
        p = self.outlet + (self.inlet - self.outlet) * np.linspace(0, 1, _INTERVALS + 1) ** 2
        φ = self.fluid.potential(p)
        half_step = 0.5 * np.diff(φ)
        middle = φ[:-1] + half_step
        # pressures at the Gauss points of each interval (interval, point)
        between = self.fluid.pressure(middle[:, None] + half_step[:, None] * _POINTS)
        increments = self._factor(between) @ _WEIGHTS * half_step  # ∫F dφ over each interval
        ψ = np.concatenate([[0.0], np.cumsum(increments)])
        return _PotentialTable(ψ, φ - φ[0], p)

    def _factor(self, pressure: ArrayLike) -> Array:
        """Compute F(h₀, p) of the reference gap."""
        if not self.law.depends_on_pressure:
            return np.ones(np.shape(pressure))
        return self.law.factor(self.gap, np.maximum(pressure, self.least_pressure))

    @cached_property
    def mobility(self) -> Mobility:
        """Derivatives dφ/dp and dψ/dp [s/m²] at pressures between outlet and inlet.

        At a pressure of 0 they are computed at the `least_pressure`.
        """
        tabulated = self._table.p
        p = np.maximum(tabulated, self.least_pressure)
        step = 1e-3 * p
        slope = (self.fluid.potential(p + step) - self.fluid.potential(p - step)) / (2 * step)
        rising = np.argsort(tabulated)
        return Mobility(tabulated[rising], slope[rising], (slope * self._factor(p))[rising])

    @property
    def least_pressure(self) -> float:
        """Smallest pressure [Pa] at which F is computed, because F may be infinite at a pressure of 0.

        The exact value does not matter, because the ratio of F at two gaps tends to a limit as the pressure tends to 0.
        """
        return _LEAST_PRESSURE * max(self.inlet, self.outlet)

    @cached_property
    def mean_factor(self) -> float:
        """Mean of F(h₀, p) over the viscous potential between inlet and outlet, Δψ/Δφ."""
        if not self.law.depends_on_pressure:
            return 1.0
        ψ, φ, _ = self._table
        if φ[-1] == 0:  # no pressure drop
            return float(self._factor(self.inlet))
        return float(ψ[-1] / φ[-1])

    def mean_factor_of(self, gap: float) -> float:
        """Compute the ratio of the flow between parallel plates to the viscous flow, for a gap >= 0 [m].

        It is the mean of F(h, p) over the viscous potential, ∫F dφ/Δφ; for an undefined gap it is NaN. It is finite
        even if the outlet is a vacuum, where F itself is infinite, so that a mean of F at inlet and outlet would be
        useless.
        """
        return replace(self, gap=max(gap, _LEAST_GAP)).mean_factor

    def pressure(self, fraction: ArrayLike) -> Array:
        """Compute the pressure [Pa] at a fraction of the drop of ψ."""
        ψ, _, p = self._table
        if ψ[-1] == 0:
            return np.full(np.shape(fraction), self.inlet)
        return np.interp(reals(fraction), ψ / ψ[-1], p)

    def viscous_fraction(self, fraction: ArrayLike) -> Array:
        """Convert a fraction of the drop of ψ to the fraction of the drop of the viscous potential φ."""
        if not self.law.depends_on_pressure:
            return np.asarray(fraction)
        ψ, φ, _ = self._table
        if ψ[-1] == 0:
            return reals(fraction)
        return np.interp(reals(fraction), ψ / ψ[-1], φ / φ[-1])

    def steepness(self, first: Array, second: Array) -> Array:
        """Compute Δψ/Δφ between two fractions of the drop of ψ; where these are equal, the derivative dψ/dφ."""
        drop = first - second
        viscous_drop = self.viscous_fraction(first) - self.viscous_fraction(second)
        is_apart = np.abs(viscous_drop) > 1e-9
        derivative = self._factor(self.pressure(0.5 * (first + second)))
        ratio = self.mean_factor * drop / np.where(is_apart, viscous_drop, 1.0)
        return np.where(is_apart, ratio, derivative)

    def equivalent_gap(self, gap: Array, fraction: ArrayLike) -> Array:
        """Compute the gap [m] whose permeability by the cubic law is (h³/12) F(h, p)/F(h₀, p).

        gap : array (n1, n2), gap h [m].
        fraction : potential ψ at the pixels as a fraction of its drop, from which the pressure p follows. NaN is
            replaced by 0.5.
        """
        p = self.pressure(np.nan_to_num(reals(fraction), nan=0.5))
        p = np.maximum(p, self.least_pressure)
        # F may be infinite in closed gaps; any other gap will do there, because they stay closed
        open_gap = np.where(gap > 0, gap, self.gap)
        return widened(gap, self.law.factor(open_gap, p) / self._factor(p))


#: Unit potential drop of a viscous fluid.
VISCOUS = PressureDrop()
