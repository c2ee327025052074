"""Describe liquids, and list all fluids that a case can choose. Each fluid is defined by its pressure potential.

If the density ρ and the viscosity η of a fluid depend on the pressure alone, the flow equation is linear in the
pressure potential φ with dφ = (ρ/η) dp [kg/(m³ s)]. The mass flow rate through a seal is the conductance of the seal
times the difference of φ between inlet and outlet.

The property `law` of a fluid is its flow law, which gives the permeability of a gap. If a fluid has no property `law`,
the cubic law is used (see `femseal.flow.law`).

To add a fluid, write a frozen dataclass with `potential`, `pressure` and `reference_density`. A fluid of this class can
be used from Python. For case files, the class must also be added to `FLUIDS`. A case file chooses a class of `FLUIDS`
by its `kind`, and the parameters of the class are keys of the case.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, log, nan, pi
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, InputError, Pair, reals, validate
from .base.leak_rates import LeakBasis
from .base.validate import check_parameters, parameter
from .flow.law import CUBIC_LAW, FlowLaw, SlipLength
from .gases import IdealGas, RealGas, solve_for_pressure
from .named_fluids import VISCOSITY, WITHOUT_NAME, viscosity_parameter

#: Constants of Roelands' law, which are the same for all liquids: the pressure p_r [Pa], and −ln of the viscosity
#: 6.31e-5 Pa s, which is 9.67.
_ROELANDS_PRESSURE, _ROELANDS_LOG = 1.962e8, -log(6.31e-5)
#: Gauss points and weights for the potential of Roelands' law, whose relative error is at most 1e-12 up to 5 GPa.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(48)


class Fluid(Protocol):
    """Define the properties of a fluid that `seal_leakage` needs."""

    @property
    def reference_density(self) -> float:
        """Density [kg/m³] by which a mass flow rate is divided to obtain the volume flow rate."""
        ...

    def potential(self, pressure: ArrayLike) -> Array:
        """Return the pressure potential φ(p) [kg/(m³ s)] with φ(0) = 0."""
        ...

    def pressure(self, potential: ArrayLike) -> Array:
        """Return the pressure [Pa] at a given potential (the inverse of `potential`)."""
        ...


#: Phrase that explains a key of several liquids in a case.
_BARUS = "increase of the viscosity with the pressure, by the law of Barus or of Roelands"


def _density(default: float) -> Any:
    """Declare the parameter `density` of a liquid class, for use in a case file."""
    allowed = "a density > 0"
    example = "870 kg/m^3"
    meaning = "density at the reference state"
    return parameter("kg/m^3", allowed, example, meaning, usual=(50.0, 2.5e4), default=default)


@dataclass(frozen=True, kw_only=True)
class _ConstantDensityLiquid:
    """Describe what liquids of constant density have in common: their properties at faces and in closed pockets.

    Parameters
    ----------
    surface_tension : float, optional
        Surface tension γ [N/m], for `capillary_entry_pressure`.
    contact_angle : float, optional
        Contact angle θ from 0 to π [rad], for `capillary_entry_pressure`.
    slip_length : float
        Slip length b on both faces [m], see `femseal.flow.law.SlipLength`.
    bulk_modulus : float, optional
        Bulk modulus B of liquid that is trapped in closed pockets [Pa]. By default, trapped liquid is incompressible.
    """

    #: Default outlet pressure in a case [Pa], relative to the ambient pressure.
    outlet_pressure: ClassVar[float] = 0.0
    surface_tension: float | None = parameter(
        "N/m",
        "a surface tension > 0",
        "73 mN/m",
        "surface tension; with a `contact_angle` above 90°, the results state the pressure at "
        "which the liquid enters the gap",
        usual=(1e-3, 3.0),
        default=None,
    )
    contact_angle: float | None = parameter(
        "rad",
        "a contact angle from 0 to 180°",
        "110 deg",
        "contact angle of the liquid on the surfaces",
        usual=(1e-3, 3.15),
        inclusive=True,
        default=None,
    )
    slip_length: float = parameter(
        "m",
        "a length >= 0",
        "20 nm",
        "slip length of the liquid on both surfaces",
        usual=(1e-10, 1e-5),
        inclusive=True,
        default=0.0,
        since="0.2",
    )
    bulk_modulus: float | None = parameter(
        "Pa",
        "a bulk modulus > 0",
        "2 GPa",
        "bulk modulus of trapped liquid, which is incompressible by default",
        usual=(5e7, 1e11),
        default=None,
        since="0.2",
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.contact_angle is not None and self.contact_angle > pi * (1 + 1e-9):
            expected = "an angle from 0 to π [rad], that is, from 0 to 180°"
            raise InputError("contact_angle", self.contact_angle, expected)

    @property
    def reference_density(self: Any) -> float:
        """Density of the liquid [kg/m³]."""
        return float(self.density)

    @property
    def law(self) -> FlowLaw:
        """Flow law: the slip-length law if the slip length is positive, otherwise the cubic law."""
        return SlipLength(self.slip_length) if self.slip_length else CUBIC_LAW


@dataclass(frozen=True)
class Liquid(_ConstantDensityLiquid):
    """Describe a liquid of constant density whose viscosity is constant, or increases with pressure by Barus' law.

    The viscosity is η = η₀ exp(αp). The pressure potential is φ = (ρ/η₀)(1 − exp(−αp))/α, and φ = ρp/η₀ for α = 0.

    Parameters
    ----------
    viscosity : float
        Viscosity η₀ at zero pressure [Pa s].
    density : float
        Density ρ [kg/m³], by default the density of water. Of all results, only the mass flow rate depends on ρ.
    pressure_viscosity : float
        Pressure-viscosity coefficient α [1/Pa], >= 0.
    surface_tension : float, optional
        Surface tension γ [N/m], for `capillary_entry_pressure`. Keyword only.
    contact_angle : float, optional
        Contact angle θ [rad], for `capillary_entry_pressure`. Keyword only.
    slip_length : float
        Slip length b on both faces [m], see `femseal.flow.law.SlipLength`. Keyword only.
    bulk_modulus : float, optional
        Bulk modulus of liquid that is trapped in closed pockets [Pa]. By default, trapped liquid is incompressible.
        Keyword only.

    Examples
    --------
    >>> oil = Liquid(viscosity=0.02, density=870, pressure_viscosity=20e-9)
    >>> round(float(oil.pressure(oil.potential(1e7))))
    10000000
    """

    kind: ClassVar[str] = "liquid"
    viscosity: float = viscosity_parameter("1 mPa*s")
    density: float = _density(1000.0)
    pressure_viscosity: float = parameter(
        "1/Pa",
        "a coefficient >= 0",
        "20 1/GPa",
        _BARUS,
        usual=(1e-10, 1e-7),
        inclusive=True,
        default=0.0,
    )

    def potential(self, pressure: ArrayLike) -> Array:
        """Return the pressure potential φ(p) [kg/(m³ s)]."""
        p = reals(pressure)
        α = self.pressure_viscosity
        reduced_pressure = p if α == 0 else -np.expm1(-α * p) / α
        return self.density / self.viscosity * reduced_pressure

    def pressure(self, potential: ArrayLike) -> Array:
        """Return the pressure [Pa] at which the potential has a given value."""
        reduced_pressure = reals(potential) * self.viscosity / self.density
        α = self.pressure_viscosity
        return reduced_pressure if α == 0 else -np.log1p(-α * reduced_pressure) / α


@dataclass(frozen=True)
class RoelandsLiquid(_ConstantDensityLiquid):
    """Describe a liquid whose viscosity increases with pressure by Roelands' law.

    The viscosity is η = η₀ exp{(ln η₀ + 9.67)(−1 + (1 + p/p_r)^Z)} with p_r = 196.2 MPa and Z = α p_r/(ln η₀ + 9.67).
    At high pressures, the viscosity increases less steeply than by Barus' law. The pressure potential ∫ρ/η dp is
    computed by Gauss quadrature. Source: Roelands, doctoral thesis, Delft, 1966.

    Parameters
    ----------
    viscosity : float
        Viscosity η₀ at zero pressure [Pa s], above 6.31e-5.
    pressure_viscosity : float
        Pressure-viscosity coefficient α = d ln η/dp at p = 0 [1/Pa], the same coefficient as in Barus' law.
    density : float
        Density ρ [kg/m³]. Of all results, only the mass flow rate depends on ρ.
    surface_tension : float, optional
        Surface tension γ [N/m], for `capillary_entry_pressure`. Keyword only.
    contact_angle : float, optional
        Contact angle θ [rad], for `capillary_entry_pressure`. Keyword only.
    slip_length : float
        Slip length b on both faces [m], see `femseal.flow.law.SlipLength`. Keyword only.
    bulk_modulus : float, optional
        Bulk modulus of liquid that is trapped in closed pockets [Pa]. By default, trapped liquid is incompressible.
        Keyword only.
    """

    kind: ClassVar[str] = "roelands-liquid"
    viscosity: float = parameter(
        "Pa*s",
        "a viscosity > 63.1 uPa*s",
        "50 mPa*s",
        VISCOSITY,
        usual=(1e-6, 1e3),
        above=6.31e-5,
        needed=WITHOUT_NAME,
    )
    pressure_viscosity: float = parameter(
        "1/Pa", "a coefficient > 0", "20 1/GPa", _BARUS, usual=(1e-10, 1e-7)
    )
    density: float = _density(870.0)

    @property
    def _scale_and_exponent(self) -> Pair:
        """Factor ln η₀ + 9.67 and exponent Z in Roelands' law, both dimensionless."""
        scale = log(self.viscosity) + _ROELANDS_LOG
        return scale, self.pressure_viscosity * _ROELANDS_PRESSURE / scale

    def viscosity_at(self, pressure: ArrayLike) -> Array:
        """Return the viscosity η(p) [Pa s]."""
        scale, exponent = self._scale_and_exponent
        x = np.log1p(reals(pressure) / _ROELANDS_PRESSURE)
        return self.viscosity * np.exp(scale * np.expm1(exponent * x))

    def potential(self, pressure: ArrayLike) -> Array:
        """Return the pressure potential φ(p) [kg/(m³ s)]."""
        # The integral is taken over x = ln(1 + p/p_r), in which the integrand is smooth.
        p = reals(pressure)
        x_end = np.log1p(p / _ROELANDS_PRESSURE)[..., None]  # (..., 1)
        # pressures at the Gauss points (..., points)
        p_at_points = _ROELANDS_PRESSURE * np.expm1(0.5 * x_end * (1 + _POINTS))
        integrand = (p_at_points + _ROELANDS_PRESSURE) / self.viscosity_at(p_at_points)
        return self.density * 0.5 * x_end[..., 0] * (integrand @ _WEIGHTS)

    def pressure(self, potential: ArrayLike) -> Array:
        """Return the pressure [Pa] at which the potential has a given value, by Newton's method.

        As p → ∞, the potential tends to a finite limit. For a value above the limit, the result is infinity.
        """
        φ = reals(potential)

        def slope(p: Array) -> Array:
            """Return dφ/dp."""
            return self.density / self.viscosity_at(p)

        # the slope dφ/dp falls with p, so that Newton's method approaches the solution from below
        start = φ * self.viscosity / self.density
        return solve_for_pressure(φ, start, self.potential, slope)


def potential_of(fluid: Fluid, name: str, pressure: Any) -> float:
    """Check a pressure, and return the pressure potential of a fluid [kg/(m³ s)] at this pressure.

    Parameters
    ----------
    fluid : Fluid
        Fluid whose potential is returned.
    name : str
        Name of the parameter that contains the pressure, for the error message.
    pressure : float
        Pressure [Pa], absolute for a gas.

    Raises
    ------
    InputError
        The pressure is not a finite number, the pressure of a gas is negative, or the pressure of a liquid is so high
        that the formula for its viscosity is no longer valid.
    """
    p = validate.number(name, pressure, unit="Pa", above=-inf)
    if hasattr(fluid, "check_pressure"):
        fluid.check_pressure(name, p)
    # conversion to the potential and back returns the same pressure, unless it is outside the range of the fluid
    with np.errstate(all="ignore"):
        potential = float(fluid.potential(p))
        returned_pressure = float(fluid.pressure(potential))
    if abs(returned_pressure - p) <= 1e-6 * abs(p):
        return potential
    expected = (
        f"a pressure that {fluid} can have (for a gas absolute and >= 0; for a liquid αp below 20)"
    )
    raise InputError(name, f"{p:g} Pa", expected)


def capillary_entry_pressure(fluid: Fluid, gap: float) -> float:
    """Return the capillary pressure 2γ|cos θ|/h, below which a non-wetting liquid does not enter a gap.

    Parameters
    ----------
    fluid : Fluid
        Fluid with the properties `surface_tension` γ and `contact_angle` θ.
    gap : float
        Gap h between two parallel plates [m].

    Returns
    -------
    float
        Capillary entry pressure [Pa]; infinite for a gap of 0; NaN if the liquid wets the faces (θ <= 90°), or if the
        surface tension or the contact angle is unknown.

    Examples
    --------
    >>> from math import radians
    >>> water = Liquid(1e-3, surface_tension=0.073, contact_angle=radians(120))
    >>> round(capillary_entry_pressure(water, 1e-6))
    73000
    """
    tension = getattr(fluid, "surface_tension", None)
    angle = getattr(fluid, "contact_angle", None)
    if tension is None or angle is None or cos(angle) >= 0:
        return nan
    if gap <= 0:
        return inf
    return -2 * tension * cos(angle) / gap


def leak_basis(
    fluid: Fluid, length: float, throughput_temperature: float | None = None, **valve: float
) -> LeakBasis:
    """Collect the data needed to convert the leakage of a fluid through a seal to any unit.

    Parameters
    ----------
    fluid : Fluid
        Fluid that leaks. A fluid with the attribute `reference_pressure` is a gas, whose volumes refer to this
        pressure.
    length : float
        Length of the seal [m].
    throughput_temperature : float, optional
        Temperature to which the throughput (pressure × volume per time) of a gas refers [K]; by default the temperature
        of the gas.
    **valve : float
        Quantities that only some units and leakage classes need: the parameters `drop_volume`, `bubble_volume`,
        `pressure_drop` and `capacity` of `LeakBasis`.
    """
    pressure = getattr(fluid, "reference_pressure", None)
    temperature = molar_mass = None
    if pressure is not None:
        temperature = getattr(fluid, "temperature", None)
        molar_mass = getattr(fluid, "molar_mass", None)
    return LeakBasis(
        length,
        fluid.reference_density,
        pressure,
        temperature,
        molar_mass,
        throughput_temperature,
        **valve,
    )


#: Classes of fluids that a case file can choose, by their kinds.
FLUIDS: dict[str, Any] = {
    fluid.kind: fluid for fluid in (Liquid, RoelandsLiquid, IdealGas, RealGas)
}
