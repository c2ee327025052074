"""Fluids, each as a change of variable from pressure to pressure potential.

Every fluid whose density ρ and viscosity η depend on pressure alone solves the same linear equation in the
pressure potential φ, dφ = (ρ/η) dp [kg/(m³ s) = Pa·(kg/m³)/(Pa s)]; the mass rate is then conductance × drop of φ.
To add a fluid, write a frozen dataclass with `potential`, `pressure` and `reference_density`. Case files know it by its
`kind` once it is in `FLUIDS`, with a key for each of its parameters; fluids made in Python need neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .base.leak_units import STANDARD_PRESSURE, LeakBasis
from .base.parameters import check_parameters, parameter

#: Molar gas constant [J/(mol K)], CODATA (exact since 2019).
GAS_CONSTANT = 8.31446261815324


class Fluid(Protocol):
    """Interface of the fluids that `seal_leakage` takes."""

    @property
    def reference_density(self) -> float:
        """Density [kg/m³] that converts a mass rate into a volume rate."""
        ...

    def potential(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Pressure potential φ(p) [kg/(m³ s)], φ(0) = 0."""
        ...

    def pressure(self, potential: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `potential` [Pa]."""
        ...


def _viscosity() -> Any:
    return parameter("Pa*s", "a viscosity > 0, such as '1 mPa*s'")


@dataclass(frozen=True)
class Liquid:
    """A liquid of constant density; viscosity η = η₀ exp(αp) (Barus), constant for α = 0.

    φ = (ρ/η₀)(1 − exp(−αp))/α, → ρp/η₀.

    Parameters
    ----------
    viscosity : η₀ [Pa s].
    density : ρ [kg/m³]; only the mass rate depends on it. Default: water.
    pressure_viscosity : α [1/Pa], >= 0.
    """

    kind: ClassVar[str] = "liquid"
    #: Outlet pressure of a case that gives none [Pa], above that of the surroundings.
    outlet_pressure: ClassVar[float] = 0.0
    viscosity: float = _viscosity()
    density: float = parameter("kg/m^3", "a density > 0, such as '870 kg/m^3'", default=1000.0)
    pressure_viscosity: float = parameter("1/Pa", "a coefficient >= 0, such as '20 1/GPa'", inclusive=True, default=0.0)

    def __post_init__(self) -> None:
        check_parameters(self)

    @property
    def reference_density(self) -> float:
        """Density of the liquid [kg/m³]."""
        return self.density

    def potential(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Pressure potential φ(p) [kg/(m³ s)]."""
        p, α = np.asarray(pressure, dtype=float), self.pressure_viscosity
        return self.density / self.viscosity * (p if α == 0 else -np.expm1(-α * p) / α)

    def pressure(self, potential: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `potential` [Pa]."""
        p, α = np.asarray(potential, dtype=float) * self.viscosity / self.density, self.pressure_viscosity
        return p if α == 0 else -np.log1p(-α * p) / α


@dataclass(frozen=True)
class IdealGas:
    """Isothermal ideal gas without slip: φ = M p²/(2 R T η), so the mass rate goes with p_in² − p_out².

    Volume rates are stated at 101 325 Pa and the gas's own temperature.

    Parameters
    ----------
    viscosity : η [Pa s].
    molar_mass : M [kg/mol].
    temperature : T [K].
    """

    kind: ClassVar[str] = "ideal-gas"
    #: Outlet pressure of a case that gives none [Pa], absolute.
    outlet_pressure: ClassVar[float] = STANDARD_PRESSURE
    viscosity: float = _viscosity()
    molar_mass: float = parameter("kg/mol", "a molar mass > 0, such as '29 g/mol'")
    temperature: float = parameter("K", "a temperature above absolute zero, such as '20 °C'")

    def __post_init__(self) -> None:
        check_parameters(self)

    @property
    def reference_density(self) -> float:
        """Density at 101 325 Pa [kg/m³]."""
        return STANDARD_PRESSURE * self.molar_mass / (GAS_CONSTANT * self.temperature)

    @property
    def reference_pressure(self) -> float:
        """Pressure at which volumes are stated [Pa], absolute; their temperature is the gas's own."""
        return STANDARD_PRESSURE

    @property
    def _factor(self) -> float:
        return self.molar_mass / (2 * GAS_CONSTANT * self.temperature * self.viscosity)

    def potential(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Pressure potential φ(p) [kg/(m³ s)]; p is absolute."""
        return self._factor * np.asarray(pressure, dtype=float) ** 2

    def pressure(self, potential: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `potential` [Pa], absolute."""
        return np.sqrt(np.asarray(potential, dtype=float) / self._factor)


def leak_basis(fluid: Fluid, length: float, stated: float | None = None) -> LeakBasis:
    """What turns the leakage of a fluid through a seal of a length [m] into any unit.

    A fluid that has a `reference_pressure`, at which its volumes are stated, and a `temperature` is a gas; its
    pressure × volume is told at the temperature `stated` [K], its own unless given.
    """
    pressure = getattr(fluid, "reference_pressure", None)
    temperature, molar_mass = (
        None if pressure is None else getattr(fluid, name, None) for name in ("temperature", "molar_mass")
    )
    return LeakBasis(length, fluid.reference_density, pressure, temperature, molar_mass, stated)


#: Fluids that a case can choose, by their kind.
FLUIDS: dict[str, Any] = {fluid.kind: fluid for fluid in (Liquid, IdealGas)}
