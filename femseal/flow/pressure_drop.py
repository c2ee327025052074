"""Describe the pressure drop of a fluid, and solve flows −K(h, p) (ρ/η) ∇p with a pressure-dependent permeability.

The permeability is K = (h³/12) F(h, p). The potential ψ of a reference gap h₀ is defined by dψ = F(h₀, p) (ρ/η) dp. The
flux is then −k ∇ψ with the permeability k = (h³/12) F(h, p)/F(h₀, p). The flow is solved by a fixed-point iteration:
the pressures of one solution give the ratio F(h, p)/F(h₀, p) for the next solution. The reference gap h₀ is the gap at
the critical constriction, which controls the flow. At the critical constriction, the ratio F(h, p)/F(h₀, p) is close to
1 at all pressures. For a gas, each iteration therefore gains about two digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import isnan, nan
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, reals
from ..base.fixed_point import fixed_point
from .law import CUBIC_LAW, FlowLaw, gap_with_factor, law_of
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

    The flow depends on the pressure potential and on the flow law of the fluid. A fluid without the attribute `law`
    follows the cubic law.
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
        """Return the potential, which is equal to the pressure, as an array."""
        return np.asarray(pressure, dtype=float)

    pressure = potential


class _PotentialTable(NamedTuple):
    """Two potentials and the pressure of a fluid, tabulated from the outlet pressure to the inlet pressure.

    All arrays have the shape (points,).

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

    A pressure p is given as the ψ fraction (ψ(p) − ψ(outlet))/(ψ(inlet) − ψ(outlet)), which is 0 at the outlet and 1
    at the inlet. The φ fraction is the same fraction of the viscous potential φ. If the flow law does not depend on the
    pressure, ψ is equal to φ. The default attributes describe the unit drop of a viscous fluid, whose pressures are
    never needed.

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

        If the flow law does not depend on the pressure, the permeability is the same at all pressures. A pressure drop
        from 1 to 0 is then returned instead of the given one.
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
        """Pressures [Pa] at which the permeability has to be computed, from the highest to the lowest.

        If the flow law does not depend on the pressure, the array contains only the inlet pressure.
        """
        if not self.law.depends_on_pressure:
            return np.array([self.inlet])
        return table_pressures(self.inlet, self.outlet)

    def at_constriction(self, gap: Array, spacing: tuple[float, float]) -> PressureDrop:
        """Return the same pressure drop, but with the gap at the critical constriction of a face as the reference gap.

        The face is periodic along x2. If the face is closed, the unit potential drop of a viscous fluid is returned.

        gap : array (n1, n2), gap of the face [m].
        spacing : lengths of a pixel [m].
        """
        if not self.law.depends_on_pressure:
            return self
        constriction = critical_constriction(gap, spacing, sides="periodic")
        if constriction is None:
            return PressureDrop()
        return replace(self, gap=constriction.gap)

    @cached_property
    def _table(self) -> _PotentialTable:
        """Table of the potentials ψ and φ and of the pressure p, from the outlet to the inlet."""
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
        """Derivatives dφ/dp and dψ/dp [s/m²] at pressures from the outlet pressure to the inlet pressure.

        Below `least_pressure`, the derivatives at `least_pressure` are used.
        """
        tabulated = self._table.p
        p = np.maximum(tabulated, self.least_pressure)
        step = 1e-3 * p
        slope = (self.fluid.potential(p + step) - self.fluid.potential(p - step)) / (2 * step)
        rising = np.argsort(tabulated)
        return Mobility(tabulated[rising], slope[rising], (slope * self._factor(p))[rising])

    @property
    def least_pressure(self) -> float:
        """Lowest pressure [Pa] at which the factor F(h, p) is computed, because F may be infinite at a pressure of 0.

        The value of `least_pressure` hardly matters, because the ratio of F at two gaps tends to a limit as the
        pressure tends to 0.
        """
        return _LEAST_PRESSURE * max(self.inlet, self.outlet)

    @cached_property
    def reference_factor(self) -> float:
        """Ratio Δψ/Δφ by which a solved permeability is multiplied.

        If the flow law depends on the pressure, the ratio is the mean value of the factor F(h₀, p) of the reference gap
        over the viscous potential φ between inlet and outlet. Otherwise, the ratio is 1, because the flow is solved for
        the equivalent gap, which contains the whole factor F.
        """
        if not self.law.depends_on_pressure:
            return 1.0
        ψ, φ, _ = self._table
        if φ[-1] == 0:  # no pressure drop
            return float(self._factor(self.inlet))
        return float(ψ[-1] / φ[-1])

    def mean_factor_of(self, gap: float) -> float:
        """Compute the ratio of the flow between parallel plates with a given gap >= 0 [m] to the viscous flow.

        The ratio is ∫F dφ/Δφ, the mean of the factor F(h, p) over the viscous potential φ. The mean of F is finite even
        if the outlet is a vacuum, where F itself is infinite. For an undefined gap, the function returns NaN.
        """
        if isnan(gap):
            return nan
        open_gap = max(gap, _LEAST_GAP)
        if not self.law.depends_on_pressure:
            return float(self.law.factor(open_gap))
        return replace(self, gap=open_gap).reference_factor

    def pressure(self, ψ_fraction: ArrayLike) -> Array:
        """Compute the pressure [Pa] at a ψ fraction, from 0 at the outlet to 1 at the inlet."""
        ψ, _, p = self._table
        if ψ[-1] == 0:
            return np.full(np.shape(ψ_fraction), self.inlet)
        return np.interp(reals(ψ_fraction), ψ / ψ[-1], p)

    def φ_fraction(self, ψ_fraction: ArrayLike) -> Array:
        """Convert a ψ fraction to the φ fraction at the same pressure."""
        if not self.law.depends_on_pressure:
            return np.asarray(ψ_fraction)
        ψ, φ, _ = self._table
        if ψ[-1] == 0:
            return reals(ψ_fraction)
        return np.interp(reals(ψ_fraction), ψ / ψ[-1], φ / φ[-1])

    def steepness(self, first: Array, second: Array) -> Array:
        """Compute Δψ/Δφ between two pressures, or dψ/dφ where the two pressures are equal.

        first, second : ψ fractions of the two pressures.
        """
        ψ_drop = first - second
        φ_drop = self.φ_fraction(first) - self.φ_fraction(second)
        is_apart = np.abs(φ_drop) > 1e-9
        derivative = self._factor(self.pressure(0.5 * (first + second)))
        ratio = self.reference_factor * ψ_drop / np.where(is_apart, φ_drop, 1.0)
        return np.where(is_apart, ratio, derivative)

    def gap_for_ψ(self, gap: Array, ψ_fraction: ArrayLike) -> Array:
        """Compute the gap [m] whose permeability by the cubic law is (h³/12) F(h, p)/F(h₀, p).

        gap : array (n1, n2), gap h [m].
        ψ_fraction : ψ fraction at the pixels, from which the pressure p is computed; NaN is replaced by 0.5.
        """
        p = self.pressure(np.nan_to_num(reals(ψ_fraction), nan=0.5))
        p = np.maximum(p, self.least_pressure)
        # F may be infinite in closed gaps; any other gap will do there, because they stay closed
        open_gap = np.where(gap > 0, gap, self.gap)
        return gap_with_factor(gap, self.law.factor(open_gap, p) / self._factor(p))


#: Unit potential drop of a viscous fluid.
VISCOUS = PressureDrop()


def solve_face(
    drop: PressureDrop,
    gap: Array,
    spacing: tuple[float, float],
    solve: Callable[[Array], tuple[float, Array, FaceSolution]],
    rtol: float,
) -> tuple[FaceSolution, PressureDrop]:
    """Solve the flow through a face whose permeability may depend on the local fluid pressure.

    The face is periodic along x2.

    Parameters
    ----------
    drop : pressure drop of the fluid.
    gap : array (n1, n2), gap [m].
    spacing : lengths of a pixel [m].
    solve : function that solves the flow through a gap [m] by the cubic law. The function returns the permeability, the
        potential at the pixels, and an object that describes the whole solution.
    rtol : relative error at which the fixed-point iteration stops; not used if the flow law does not depend on the
        pressure.

    Returns
    -------
    Solution returned by the last call of `solve`, and pressure drop with the reference gap of the face. The potential
    in the solution is a ψ fraction. To get the permeability of the face, multiply the permeability in the solution by
    the `reference_factor` of the returned pressure drop.

    Raises
    ------
    NotConverged : the linear solver failed, or the fixed-point iteration did not converge.
    """
    drop = drop.at_constriction(gap, spacing)
    if not drop.law.depends_on_pressure:
        _, _, solution = solve(drop.law.equivalent_gap(gap))
        return solution, drop
    start = 0.5  # at first, the potential is in the middle of its drop at all pixels
    solved = fixed_point(
        lambda ψ_fraction: drop.gap_for_ψ(gap, ψ_fraction),
        solve,
        start,
        rtol=rtol,
        name="flow through a face",
    )
    return solved.solution, drop
