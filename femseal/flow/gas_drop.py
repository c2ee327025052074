"""Flow of a gas whose flow factor depends on gap and pressure: −(h³/12) F(h, p) (ρ/η) ∇p, solved as a linear flow.

In the potential ψ with dψ = F(h₀, p) (ρ/η) dp the permeability is (h³/12) F(h, p)/F(h₀, p). Where h₀ is the gap of the
constrictions that control the flow, the ratio is nearly 1 there at every pressure: successive solutions, each with the
ratio at the pressure of the one before, then gain about two digits each on the flow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.errors import NotConverged
from .coefficient import equivalent_gap
from .constriction import critical_constriction
from .permeability_table import Mobility, table_pressures

Array = NDArray[np.float64]
Found = TypeVar("Found")
#: Intervals of the table of pressures, and Gauss points in each of them.
_INTERVALS, _POINTS = 2000, np.polynomial.legendre.leggauss(3)
#: Least pressure at which a flow factor is taken, in shares of the higher end.
_LEAST_PRESSURE = 1e-9
#: A flow factor nearer to 1 does not count.
_COUNTS = 1e-6
#: Most successive solutions.
_MOST_SOLUTIONS = 40


class SlippingFluid(Protocol):
    """The part of a fluid that decides on its flow through narrow gaps, see `fluids.IdealGas`."""

    def potential(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Pressure potential of the viscous flow [kg/(m³ s)]."""
        ...

    def pressure(self, potential: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `potential` [Pa]."""
        ...

    def flow_factor(self, gap: ArrayLike, pressure: ArrayLike) -> NDArray[np.float64]:
        """How many times more passes than of a viscous flow."""
        ...


@dataclass(frozen=True)
class GasDrop:
    """A pressure drop of a gas, in the potential ψ of a reference gap; all shares are of the drop, 1 at the inlet.

    gas : with a `potential` and a `flow_factor`. inlet, outlet : its pressures [Pa]. gap : h₀ [m], > 0.
    """

    gas: SlippingFluid
    inlet: float
    outlet: float
    gap: float

    @classmethod
    def of(cls, fluid: Any, inlet: float, outlet: float, gap: float = 1e-6) -> GasDrop | None:
        """The drop of a fluid whose flow factor counts, None for any other fluid; see `through` for a better gap."""
        slips = getattr(fluid, "slip", False) and hasattr(fluid, "flow_factor")
        return cls(fluid, float(inlet), float(outlet), float(gap)) if slips else None

    def through(self, gap: Array, spacing: tuple[float, float]) -> GasDrop | None:
        """The same drop in the potential of the critical constriction of a face (n1, n2) [m], periodic along x2.

        None where the face is closed, or the flow factor is within 1e-6 of 1 everywhere.
        """
        smallest = np.min(gap, where=gap > 0, initial=1.0)
        if self.gas.flow_factor(smallest, min(self.inlet, self.outlet)) <= 1 + _COUNTS:
            return None
        constriction = critical_constriction(gap, spacing, sides="periodic")
        return None if constriction is None else replace(self, gap=constriction.gap)

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """ψ and φ above those of the outlet [kg/(m³ s)], from outlet to inlet, and their pressures [Pa]."""
        # dense at the outlet, where the pressure of a gas changes most
        p = self.outlet + (self.inlet - self.outlet) * np.linspace(0, 1, _INTERVALS + 1) ** 2
        φ = self.gas.potential(p)
        points, weights = _POINTS
        step = 0.5 * np.diff(φ)
        between = self.gas.pressure((φ[:-1] + step)[:, None] + step[:, None] * points)
        ψ = np.concatenate([[0.0], np.cumsum(self._factor(between) @ weights * step)])
        return ψ, φ - φ[0], p

    def _factor(self, pressure: ArrayLike) -> Array:
        if not hasattr(self.gas, "flow_factor"):
            return np.ones(np.shape(pressure))
        return self.gas.flow_factor(self.gap, np.maximum(pressure, self.least_pressure))

    @cached_property
    def mobility(self) -> Mobility:
        """dφ/dp and dψ/dp [s/m²] between the ends, that of a pressure 0 taken at 1e-9 of the higher end."""
        p = np.maximum(self._table[2], self.least_pressure)
        step = 1e-3 * p
        slope = (self.gas.potential(p + step) - self.gas.potential(p - step)) / (2 * step)
        return Mobility(self.outlet, self.inlet, slope, slope * self._factor(p))

    @property
    def least_pressure(self) -> float:
        """Pressure [Pa] for which lower ones are taken: ratios of flow factors tend to a limit."""
        return _LEAST_PRESSURE * max(self.inlet, self.outlet)

    @cached_property
    def mean_factor(self) -> float:
        """Δψ/Δφ, the mean of F(h₀, p) over the viscous potential between both ends."""
        ψ, φ, _ = self._table
        return float(ψ[-1] / φ[-1]) if φ[-1] != 0 else float(self._factor(self.inlet))

    @cached_property
    def pressures(self) -> Array:
        """Pressures [Pa] at which permeabilities have to be known, see `table_pressures`; the inlet's is the first."""
        return table_pressures(self.inlet, self.outlet)

    def share(self, pressure: ArrayLike) -> Array:
        """Share of the drop of ψ at a pressure [Pa] between those of the ends."""
        ψ, _, p = self._table
        if ψ[-1] == 0:
            return np.full(np.shape(pressure), 0.5)
        rising = 1 if p[-1] > p[0] else -1
        return np.interp(np.asarray(pressure, dtype=float), p[::rising], (ψ / ψ[-1])[::rising])

    def pressure(self, share: ArrayLike) -> Array:
        """Pressure [Pa] where ψ has a share of its drop."""
        ψ, _, p = self._table
        if ψ[-1] == 0:
            return np.full(np.shape(share), self.inlet)
        return np.interp(np.asarray(share, dtype=float), ψ / ψ[-1], p)

    def viscous_share(self, share: ArrayLike) -> Array:
        """Share of the drop of the viscous potential φ where ψ has a share of its own."""
        ψ, φ, _ = self._table
        if ψ[-1] == 0:
            return np.asarray(share, dtype=float)
        return np.interp(np.asarray(share, dtype=float), ψ / ψ[-1], φ / φ[-1])

    def steepness(self, first: Array, second: Array) -> Array:
        """Δψ/Δφ between two shares of the drop, dψ/dφ where they are the same."""
        drop, viscous = first - second, self.viscous_share(first) - self.viscous_share(second)
        apart = np.abs(viscous) > 1e-9
        at = self._factor(self.pressure(0.5 * (first + second)))
        return np.where(apart, self.mean_factor * drop / np.where(apart, viscous, 1.0), at)

    def equivalent_gap(self, gap: Array, share: ArrayLike) -> Array:
        """Gap [m] with the permeability (h³/12) F(h, p)/F(h₀, p) by the cubic law; shares of NaN count as ½."""
        p = self.pressure(np.nan_to_num(np.asarray(share, dtype=float), nan=0.5))
        p = np.maximum(p, self.least_pressure)
        ratio = self.gas.flow_factor(np.where(gap > 0, gap, self.gap), p) / self._factor(p)
        return equivalent_gap(gap, ratio)


def successive(solve: Callable[[Any], tuple[float, Any, Found]], rtol: float, first: Any = 0.5) -> Found:
    """Solve again and again with the potential of the solution before, until the flow changes by less than `rtol`.

    Parameters
    ----------
    solve : from shares of the drop, `first` at first, to the flow, the shares that it has, and whatever is to be kept.
    rtol : relative error of the flow, estimated from the last three flows, whose differences fall by a factor each.

    Raises
    ------
    NotConverged : the flow still changes after 40 solutions.
    """
    share = first
    last, change = np.nan, np.nan
    error = np.inf
    for _ in range(_MOST_SOLUTIONS):
        flow, share, found = solve(share)
        if flow == 0:
            return found
        before, change, last = change, abs(flow / last - 1), flow
        ratio = change / before if before > 0 else np.nan
        error = change * ratio / (1 - ratio) if ratio < 0.5 else change
        if error <= rtol:
            return found
    raise NotConverged(f"flow of a rarefied gas: it still changes by {error:.1e}, expected {rtol:.0e}", error)
