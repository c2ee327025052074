"""A fluid between two pressures, and its flow where the permeability depends on the pressure: −K(h, p) (ρ/η) ∇p.

In the potential ψ with dψ = F(h₀, p) (ρ/η) dp, where K = (h³/12) F, the permeability is (h³/12) F(h, p)/F(h₀, p). Where
h₀ is the gap of the constrictions that control the flow, the ratio is nearly 1 there at every pressure: each solution
of the fixed point, with the ratio at the pressures of the one before, then gains about two digits of the flow of a gas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, reals
from ..base.fixed_point import fixed_point
from .law import CUBIC_LAW, FlowLaw, law_of, widened
from .percolation import critical_constriction
from .permeability_table import Mobility, table_pressures

Found = TypeVar("Found")
#: Intervals of the table of pressures, and Gauss points in each of them.
_INTERVALS, _POINTS = 2000, np.polynomial.legendre.leggauss(3)
#: Least pressure at which a factor is taken, as a fraction of the higher end.
_LEAST_PRESSURE = 1e-9
#: Gap [m], far below an atom, that stands for a closed one where a factor is computed.
_LEAST_GAP = 1e-12


class FlowingFluid(Protocol):
    """The part of a fluid that flows through gaps: its potential, and its `law` where that is not the cubic one."""

    def potential(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Pressure potential of the viscous flow [kg/(m³ s)]."""
        ...

    def pressure(self, potential: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `potential` [Pa]."""
        ...


@dataclass(frozen=True)
class _UnitFluid:
    """A fluid whose potential is its pressure, with a law."""

    law: FlowLaw = CUBIC_LAW

    def potential(self, pressure: ArrayLike) -> Array:
        """The pressure itself, a number or an array."""
        return np.asarray(pressure, dtype=float)

    pressure = potential


def pressure_between(
    fluid: FlowingFluid, inlet: float, outlet: float, fraction: ArrayLike
) -> Array:
    """Pressure [Pa] where the viscous potential has a fraction of its drop, 1 at the inlet and 0 at the outlet."""
    high, low = fluid.potential([inlet, outlet])
    return fluid.pressure(low + (high - low) * reals(fraction))


@dataclass(frozen=True)
class PressureDrop:
    """A fluid between two pressures, in the potential ψ of a reference gap; fractions are of its drop, 1 at the inlet.

    Where the law does not depend on the pressure, ψ is the viscous potential φ.
    fluid : with a potential and a law. inlet, outlet : its pressures [Pa]. gap : h₀ [m], > 0, see `at_constriction`.
    """

    fluid: FlowingFluid = _UnitFluid()
    inlet: float = 1.0
    outlet: float = 0.0
    gap: float = 1e-6

    @classmethod
    def of(cls, fluid: FlowingFluid, inlet: float, outlet: float) -> PressureDrop:
        """The drop of a fluid; where its law does not depend on the pressure a unit drop, the same for all fluids."""
        if not (law := law_of(fluid)).depends_on_pressure:
            return cls(_UnitFluid(law))
        return cls(fluid, float(inlet), float(outlet))

    @cached_property
    def law(self) -> FlowLaw:
        """Law of the fluid."""
        return law_of(self.fluid)

    @cached_property
    def pressures(self) -> Array:
        """Pressures [Pa] at which permeabilities have to be known, the inlet's first; only that of other laws."""
        if not self.law.depends_on_pressure:
            return np.array([self.inlet])
        return table_pressures(self.inlet, self.outlet)

    def solve_face(
        self,
        gap: Array,
        spacing: tuple[float, float],
        solve: Callable[[Array], tuple[float, Array, Found]],
        rtol: float,
    ) -> tuple[Found, PressureDrop]:
        """Solve the flow through a face (n1, n2) [m], periodic along x2, at the pressures in it.

        solve : from a gap [m], by the cubic law, to the permeability, the potential at the pixels and what is kept.
        rtol : relative error at which the fixed point ends, where the law depends on the pressure.

        Returns what is kept of the last solution, and the drop whose fractions its potential is; the `mean_factor` of
        that multiplies the permeability.

        Raises NotConverged: the linear solver failed, or the flow still changes after many solutions.
        """
        drop = self.at_constriction(gap, spacing)
        if not drop.law.depends_on_pressure:
            return solve(drop.law.equivalent_gap(gap))[2], drop
        solved = fixed_point(
            lambda fraction: drop.equivalent_gap(gap, fraction),
            solve,
            0.5,
            rtol=rtol,
            name="flow through a face",
        )
        return solved.solution, drop

    def at_constriction(self, gap: Array, spacing: tuple[float, float]) -> PressureDrop:
        """The same drop in the potential of the critical constriction of a face (n1, n2) [m], periodic along x2.

        That of a viscous fluid where the face is closed.
        """
        if not self.law.depends_on_pressure:
            return self
        constriction = critical_constriction(gap, spacing, sides="periodic")
        return PressureDrop() if constriction is None else replace(self, gap=constriction.gap)

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """ψ and φ above those of the outlet [kg/(m³ s)], from outlet to inlet, and their pressures [Pa]."""
        # dense at the outlet, where the pressure of a gas changes most
        p = self.outlet + (self.inlet - self.outlet) * np.linspace(0, 1, _INTERVALS + 1) ** 2
        φ = self.fluid.potential(p)
        points, weights = _POINTS
        step = 0.5 * np.diff(φ)
        between = self.fluid.pressure((φ[:-1] + step)[:, None] + step[:, None] * points)
        ψ = np.concatenate([[0.0], np.cumsum(self._factor(between) @ weights * step)])
        return ψ, φ - φ[0], p

    def _factor(self, pressure: ArrayLike) -> Array:
        if not self.law.depends_on_pressure:
            return np.ones(np.shape(pressure))
        return self.law.factor(self.gap, np.maximum(pressure, self.least_pressure))

    @cached_property
    def mobility(self) -> Mobility:
        """dφ/dp and dψ/dp [s/m²] between the ends, that of a pressure 0 taken at 1e-9 of the higher end."""
        p = np.maximum(self._table[2], self.least_pressure)
        step = 1e-3 * p
        slope = (self.fluid.potential(p + step) - self.fluid.potential(p - step)) / (2 * step)
        rising = np.argsort(self._table[2])
        return Mobility(self._table[2][rising], slope[rising], (slope * self._factor(p))[rising])

    @property
    def least_pressure(self) -> float:
        """Pressure [Pa] for which lower ones are taken: ratios of factors tend to a limit."""
        return _LEAST_PRESSURE * max(self.inlet, self.outlet)

    @cached_property
    def mean_factor(self) -> float:
        """Δψ/Δφ, the mean of F(h₀, p) over the viscous potential between both ends."""
        if not self.law.depends_on_pressure:
            return 1.0
        ψ, φ, _ = self._table
        return float(ψ[-1] / φ[-1]) if φ[-1] != 0 else float(self._factor(self.inlet))

    def mean_factor_of(self, gap: float) -> float:
        """Compute how many times the viscous flow passes between plates with a gap >= 0 [m], NaN for an unknown gap.

        It is the mean of F(h, p) over the viscous potential, ∫F dφ/Δφ, and stays finite where the outlet is a vacuum.
        There F itself has no limit: a mean of its values at inlet and outlet says nothing about the flow.
        """
        return replace(self, gap=max(gap, _LEAST_GAP)).mean_factor

    def pressure(self, fraction: ArrayLike) -> Array:
        """Pressure [Pa] where ψ has a fraction of its drop."""
        ψ, _, p = self._table
        if ψ[-1] == 0:
            return np.full(np.shape(fraction), self.inlet)
        return np.interp(reals(fraction), ψ / ψ[-1], p)

    def viscous_fraction(self, fraction: ArrayLike) -> Array:
        """Fraction of the drop of the viscous potential φ where ψ has a fraction of its own."""
        if not self.law.depends_on_pressure:
            return np.asarray(fraction)
        ψ, φ, _ = self._table
        if ψ[-1] == 0:
            return reals(fraction)
        return np.interp(reals(fraction), ψ / ψ[-1], φ / φ[-1])

    def steepness(self, first: Array, second: Array) -> Array:
        """Δψ/Δφ between two fractions of the drop, dψ/dφ where they are the same."""
        drop = first - second
        viscous = self.viscous_fraction(first) - self.viscous_fraction(second)
        apart = np.abs(viscous) > 1e-9
        at = self._factor(self.pressure(0.5 * (first + second)))
        return np.where(apart, self.mean_factor * drop / np.where(apart, viscous, 1.0), at)

    def equivalent_gap(self, gap: Array, fraction: ArrayLike) -> Array:
        """Gap [m] with the permeability (h³/12) F(h, p)/F(h₀, p) by the cubic law; fractions of NaN count as ½."""
        p = self.pressure(np.nan_to_num(reals(fraction), nan=0.5))
        p = np.maximum(p, self.least_pressure)
        return widened(gap, self.law.factor(np.where(gap > 0, gap, self.gap), p) / self._factor(p))


#: A viscous fluid between a unit drop of its potential.
VISCOUS = PressureDrop()
