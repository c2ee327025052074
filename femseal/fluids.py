"""Fluids, each as a change of variable from pressure to pressure potential.

Every fluid whose density ρ and viscosity η depend on pressure alone solves the same linear equation in the
pressure potential φ, dφ = (ρ/η) dp [kg/(m³ s) = Pa·(kg/m³)/(Pa s)]; the mass rate is then conductance × drop of φ.
Its `law` is the permeability of a gap, the cubic one where it names none (see `femseal.flow.law`).
To add a fluid, write a frozen dataclass with `potential`, `pressure` and `reference_density`. Case files know it by its
`kind` once it is in `FLUIDS`, with a key for each of its parameters; fluids made in Python need neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, log, nan
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, InputError, Pair, reals, validate
from .base.leak_rates import GAS_CONSTANT, LeakBasis
from .base.validate import check_parameters, parameter
from .flow.law import CUBIC_LAW, FlowLaw, FukuiKaneko, SlipLength
from .named_fluids import Gas, RealGas, slip_of_gas, temperature_of_gas, with_potential

#: Constants of Roelands' law: pressure [Pa], and the natural logarithm of the viscosity [Pa s] common to all liquids.
_ROELANDS_PRESSURE, _ROELANDS_LOG = 1.962e8, -log(6.31e-5)
#: Gauss points of the potential of Roelands' law: right to 1e-12 up to 5 GPa.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(48)


class Fluid(Protocol):
    """Interface of the fluids that `seal_leakage` takes."""

    @property
    def reference_density(self) -> float:
        """Density [kg/m³] that converts a mass rate into a volume rate."""
        ...

    def potential(self, pressure: ArrayLike) -> Array:
        """Pressure potential φ(p) [kg/(m³ s)], φ(0) = 0."""
        ...

    def pressure(self, potential: ArrayLike) -> Array:
        """Inverse of `potential` [Pa]."""
        ...


#: What the keys of several fluids mean.
_VISCOSITY = 'dynamic, or kinematic such as `"46 cSt"` beside a density'
_NAMELESS = "without a `name`"
_BARUS = "rise of viscosity with pressure: by Barus, or by Roelands"


def _viscosity(example: str) -> Any:
    allowed = f"a viscosity > 0, such as '{example}'"
    return parameter("Pa*s", allowed, _VISCOSITY, usual=(1e-6, 1e3), needed=_NAMELESS)


def _density(default: float) -> Any:
    allowed, meaning = "a density > 0, such as '870 kg/m^3'", "at the reference state"
    return parameter("kg/m^3", allowed, meaning, usual=(50.0, 2.5e4), default=default)


@dataclass(frozen=True, kw_only=True)
class _OnFaces:
    """What a liquid of constant density does on the faces.

    surface_tension, contact_angle : γ [N/m] and θ [rad], for `capillary_entry_pressure`.
    slip_length : b [m], by which it slips on both faces, see `femseal.flow.law.SlipLength`.
    bulk_modulus : B [Pa] of liquid that is trapped between the faces; None is incompressible.
    """

    #: Outlet pressure of a case that gives none [Pa], above that of the surroundings.
    outlet_pressure: ClassVar[float] = 0.0
    surface_tension: float | None = parameter(
        "N/m",
        "a surface tension > 0, such as '73 mN/m'",
        "with a `contact_angle` above 90° gives the pressure of entry",
        usual=(1e-3, 3.0),
        default=None,
    )
    contact_angle: float | None = parameter(
        "rad",
        "a contact angle >= 0, such as '110 deg'",
        "on the faces",
        usual=(1e-3, 3.15),
        inclusive=True,
        default=None,
    )
    slip_length: float = parameter(
        "m",
        "a length >= 0, such as '20 nm'",
        "on both faces",
        usual=(1e-10, 1e-5),
        inclusive=True,
        default=0.0,
        since="0.2",
    )
    bulk_modulus: float | None = parameter(
        "Pa",
        "a bulk modulus > 0, such as '2 GPa'",
        "of trapped liquid, incompressible unless given",
        usual=(5e7, 1e11),
        default=None,
        since="0.2",
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    @property
    def reference_density(self: Any) -> float:
        """Density of the liquid [kg/m³]."""
        return float(self.density)

    @property
    def law(self) -> FlowLaw:
        """The cubic law, or that of the slip length."""
        return SlipLength(self.slip_length) if self.slip_length else CUBIC_LAW


@dataclass(frozen=True)
class Liquid(_OnFaces):
    """A liquid of constant density; viscosity η = η₀ exp(αp) (Barus), constant for α = 0.

    φ = (ρ/η₀)(1 − exp(−αp))/α, → ρp/η₀.

    Parameters
    ----------
    viscosity : η₀ [Pa s].
    density : ρ [kg/m³]; only the mass rate depends on it. Default: water.
    pressure_viscosity : α [1/Pa], >= 0.
    surface_tension, contact_angle, slip_length : γ [N/m], θ [rad] and b [m] on the faces, by keyword, for
        `capillary_entry_pressure` and `femseal.flow.law.SlipLength`.

    Examples
    --------
    >>> oil = Liquid(viscosity=0.02, density=870, pressure_viscosity=20e-9)
    >>> round(float(oil.pressure(oil.potential(1e7))))
    10000000
    """

    kind: ClassVar[str] = "liquid"
    viscosity: float = _viscosity("1 mPa*s")
    density: float = _density(1000.0)
    pressure_viscosity: float = parameter(
        "1/Pa",
        "a coefficient >= 0, such as '20 1/GPa'",
        _BARUS,
        usual=(1e-10, 1e-7),
        inclusive=True,
        default=0.0,
    )

    def potential(self, pressure: ArrayLike) -> Array:
        """Pressure potential φ(p) [kg/(m³ s)]."""
        p, α = reals(pressure), self.pressure_viscosity
        return self.density / self.viscosity * (p if α == 0 else -np.expm1(-α * p) / α)

    def pressure(self, potential: ArrayLike) -> Array:
        """Inverse of `potential` [Pa]."""
        p = reals(potential) * self.viscosity / self.density
        α = self.pressure_viscosity
        return p if α == 0 else -np.log1p(-α * p) / α


@dataclass(frozen=True)
class RoelandsLiquid(_OnFaces):
    """A liquid whose viscosity rises with pressure by Roelands' law, less steeply than Barus's at high pressure.

    η = η₀ exp{(ln η₀ + 9.67)(−1 + (1 + p/p_r)^Z)} with p_r = 196.2 MPa and Z = α p_r/(ln η₀ + 9.67); the potential
    ∫ρ/η dp is by quadrature. Source: Roelands, doctoral thesis, Delft, 1966.

    Parameters
    ----------
    viscosity : η₀ [Pa s], above 6.31e-5.
    pressure_viscosity : α = d ln η/dp at p = 0 [1/Pa], as that of Barus's law.
    density : ρ [kg/m³]; only the mass rate depends on it.
    surface_tension, contact_angle, slip_length : γ [N/m], θ [rad] and b [m] on the faces, by keyword, for
        `capillary_entry_pressure` and `femseal.flow.law.SlipLength`.
    """

    kind: ClassVar[str] = "roelands-liquid"
    viscosity: float = parameter(
        "Pa*s",
        "a viscosity > 63.1 uPa*s, such as '50 mPa*s'",
        _VISCOSITY,
        usual=(1e-6, 1e3),
        above=6.31e-5,
        needed=_NAMELESS,
    )
    pressure_viscosity: float = parameter(
        "1/Pa", "a coefficient > 0, such as '20 1/GPa'", _BARUS, usual=(1e-10, 1e-7)
    )
    density: float = _density(870.0)

    @property
    def _laws(self) -> Pair:
        scale = log(self.viscosity) + _ROELANDS_LOG
        return scale, self.pressure_viscosity * _ROELANDS_PRESSURE / scale

    def viscosity_at(self, pressure: ArrayLike) -> Array:
        """Viscosity η(p) [Pa s]."""
        scale, exponent = self._laws
        strain = np.log1p(reals(pressure) / _ROELANDS_PRESSURE)
        return self.viscosity * np.exp(scale * np.expm1(exponent * strain))

    def potential(self, pressure: ArrayLike) -> Array:
        """Pressure potential φ(p) [kg/(m³ s)]."""
        # by quadrature in x = ln(1 + p/p_r), in which the integrand is smooth
        p = reals(pressure)
        top = np.log1p(p / _ROELANDS_PRESSURE)[..., None]
        at = _ROELANDS_PRESSURE * np.expm1(0.5 * top * (1 + _POINTS))
        fluidity = (at + _ROELANDS_PRESSURE) / self.viscosity_at(at)
        return self.density * 0.5 * top[..., 0] * (fluidity @ _WEIGHTS)

    def pressure(self, potential: ArrayLike) -> Array:
        """Inverse of `potential` [Pa], by Newton's method; inf where no pressure has it."""
        φ = reals(potential)
        # φ rises ever more slowly, so that p is always below the solution
        start = φ * self.viscosity / self.density
        return with_potential(
            φ, start, self.potential, lambda p: self.density / self.viscosity_at(p)
        )


@dataclass(frozen=True)
class IdealGas(Gas):
    """Isothermal ideal gas: φ = M p²/(2 R T η), so that without slip the mass rate goes with p_in² − p_out².

    In gaps that are not large against the mean free path more gas flows: `flow_factor` times as much, which depends on
    gap and pressure. Volume rates are stated at 101 325 Pa and the gas's own temperature.

    Parameters
    ----------
    viscosity : η [Pa s].
    molar_mass : M [kg/mol].
    temperature : T [K].
    slip : whether the flow factor counts; without it the gas is viscous in every gap.

    Examples
    --------
    >>> helium = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
    >>> bool(helium.flow_factor(100e-9, 1e5) > helium.flow_factor(1e-6, 1e5) > 1)
    True
    """

    kind: ClassVar[str] = "ideal-gas"
    viscosity: float = _viscosity("18 uPa*s")
    molar_mass: float = parameter(
        "kg/mol",
        "a molar mass > 0, such as '29 g/mol'",
        "of the gas",
        usual=(1e-3, 1.0),
        needed=_NAMELESS,
    )
    temperature: float = temperature_of_gas(needed=_NAMELESS)
    slip: bool = slip_of_gas()

    @property
    def law(self) -> FlowLaw:
        """Fukui & Kaneko's law, or the cubic one without slip."""
        if not self.slip:
            return CUBIC_LAW
        return FukuiKaneko(self.viscosity, self.speed)

    @property
    def _factor(self) -> float:
        return self.molar_mass / (2 * GAS_CONSTANT * self.temperature * self.viscosity)

    def potential(self, pressure: ArrayLike) -> Array:
        """Pressure potential φ(p) of the viscous flow [kg/(m³ s)]; p is absolute."""
        return self._factor * reals(pressure) ** 2

    def pressure(self, potential: ArrayLike) -> Array:
        """Inverse of `potential` [Pa], absolute."""
        return np.sqrt(reals(potential) / self._factor)

    def flow_factor(self, gap: ArrayLike, pressure: ArrayLike) -> Array:
        """F = Q(D)/(D/6), how many times more gas a gap [m] lets through than the cubic law says; 1 without `slip`.

        Parameters
        ----------
        gap, pressure : h >= 0 [m] and absolute p >= 0 [Pa], which are broadcast. F is inf where one of them is 0.

        Raises
        ------
        InputError : negative or undefined values.

        Notes
        -----
        See `femseal.flow.law.flow_rate` for Q(D), its source and its errors. Helium of 1 bar at 20 °C: 2.5 at 1 µm, 21
        at 100 nm.

        Examples
        --------
        >>> IdealGas(19.6e-6, 4.0026e-3, 293.15).flow_factor([1e-6, 100e-9, 30e-9], 1e5).round(1)
        array([ 2.5, 20.9, 82.8])
        """
        h, p = np.broadcast_arrays(*(reals(value) for value in (gap, pressure)))
        for name, values, unit in (("gap", h, "m"), ("pressure", p, "Pa, absolute")):
            if not (np.isfinite(values).all() and values.min(initial=0.0) >= 0):
                raise InputError(
                    name, "negative or undefined values", f"finite numbers >= 0 [{unit}]"
                )
        return self.law.factor(h, p)


def potential_of(fluid: Fluid, name: str, pressure: Any) -> float:
    """Pressure potential of a fluid at a pressure that is called `name` [kg/(m³ s)].

    Raises InputError: no finite number, or a pressure that the potential does not give back, as of a liquid that is
    solid there.
    """
    p = validate.number(name, pressure, unit="Pa", above=-inf)
    if hasattr(fluid, "check_pressure"):
        fluid.check_pressure(name, p)
    with np.errstate(all="ignore"):
        potential = float(fluid.potential(p))
        back = float(fluid.pressure(potential))
    if abs(back - p) <= 1e-6 * abs(p):
        return potential
    can_have = (
        f"a pressure that {fluid} can have (of a gas absolute, >= 0; of a liquid αp below 20)"
    )
    raise InputError(name, f"{p:g} Pa", can_have)


def capillary_entry_pressure(fluid: Fluid, gap: float) -> float:
    """Pressure 2γ|cos θ|/h [Pa] below which a liquid that does not wet the faces enters no gap h [m] between plates.

    NaN of a liquid that wets them (θ <= 90°), or of which surface tension or contact angle is not known; inf where the
    gap is 0.

    >>> from math import radians
    >>> water = Liquid(1e-3, surface_tension=0.073, contact_angle=radians(120))
    >>> round(capillary_entry_pressure(water, 1e-6))
    73000
    """
    tension, angle = (getattr(fluid, name, None) for name in ("surface_tension", "contact_angle"))
    if tension is None or angle is None or cos(angle) >= 0:
        return nan
    return -2 * tension * cos(angle) / gap if gap > 0 else inf


def leak_basis(
    fluid: Fluid, length: float, stated: float | None = None, **valve: float
) -> LeakBasis:
    """What turns the leakage of a fluid through a seal of a length [m] into any unit.

    A fluid that has a `reference_pressure`, at which its volumes are stated, and a `temperature` is a gas; its
    pressure × volume is stated at the temperature `stated` [K], its own unless given. valve : what some units and
    classes need besides, `drop`, `bubble`, `pressure_drop`, `capacity` of `LeakBasis`.
    """
    pressure = getattr(fluid, "reference_pressure", None)
    temperature, molar_mass = (
        None if pressure is None else getattr(fluid, name, None)
        for name in ("temperature", "molar_mass")
    )
    return LeakBasis(
        length, fluid.reference_density, pressure, temperature, molar_mass, stated, **valve
    )


#: Fluids that a case can choose, by their kind.
FLUIDS: dict[str, Any] = {
    fluid.kind: fluid for fluid in (Liquid, RoelandsLiquid, IdealGas, RealGas)
}
