"""Define flow laws: the permeability K(h, p) of a gap h between parallel plates at a fluid pressure p.

The mass flux per width is −K (ρ/η) ∇p. The density ρ and the viscosity η of a fluid enter through the pressure
potential ∫ρ/η dp, see `femseal.fluids`; the flow law gives K.

Each flow law is a frozen dataclass that defines the ratio of K to the cubic law h³/12. The equivalent gap is the gap
whose permeability by the cubic law is equal to K. The flow through faces and cells is solved for the equivalent gap.
The equivalent gap is computed at the pixels, and interpolated between the pixels in the same way as the gap itself.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import log, pi, sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, NotConverged, reals, validate

#: Inverse Knudsen numbers D between the four formulas of `flow_rate`: from free molecules to the first formula of the
#: transition, from there to the second one, and from there to slip flow.
FREE_MOLECULAR, TRANSITION, SLIP = 0.01, 0.15, 5.0
#: Largest relative error of the permeability of a gap that `FlowLaw.gap` computes. The formulas of `FukuiKaneko` have
#: jumps of up to 0.3 % between them.
_LARGEST_JUMP = 0.01
#: Smallest D that is used, because ln D diverges at 0.
_LEAST = 1e-30
#: Constant term of the free-molecular Q(D) between infinite plates, with Euler's constant 0.577….
_FREE = 1.5 * (1.0 - 0.5772156649015329) / sqrt(pi)
#: Coefficient c of D ln²D, which is chosen so that Q is continuous at D = 0.01. The first four numbers are the terms of
#: the first formula of the transition at this D.
_EXCESS = (-2.22919e-2 + 2.10673 + 1.653 - 0.694 - _FREE + log(FREE_MOLECULAR) / sqrt(pi)) / (
    FREE_MOLECULAR * log(FREE_MOLECULAR) ** 2
)
#: Coefficients of D, 1, 1/D and 1/D² in each of the four formulas, transposed to (coefficient, formula).
_FACTORS = np.transpose(
    [
        (0.0, _FREE, 0.0, 0.0),
        (-2.22919, 2.10673, 0.01653, -0.0000694),
        (0.13852, 1.25087, 0.15653, -0.00969),
        (1 / 6, 1.0162, 1.0653, -2.1354),
    ]
)


def flow_rate(inverse_knudsen: ArrayLike) -> Array:
    """Compute the dimensionless flow rate Q(D) of a rarefied gas between parallel plates.

    For a gap h, the mass flow rate per width is Q h²/√(2R_sT) times the pressure gradient, with the specific gas
    constant R_s and the temperature T. For viscous flow without slip, Q = D/6.

    Q is a fit to a numerical solution of the linearised Boltzmann (BGK) equation with diffusely reflecting walls, with
    an error of at most 0.9 %. The minimum of Q near D = 1 is known as Knudsen's minimum. At D = 0.15 and D = 5, where
    the formulas of the fit change, Q jumps by 0.27 % and 0.14 %.

    The fit of Q is limited to D >= 0.01. For smaller D, the free-molecular limit between infinite plates is used: Q =
    (3(1 − γ)/2 − ln D)/√π + c D ln²D, where γ is Euler's constant. The coefficient c makes Q continuous at D = 0.01.
    For D < 0.01, Q is accurate within 0.3 %.

    Parameters
    ----------
    inverse_knudsen : inverse Knudsen number D = p h/(η√(2R_sT)) >= 0, a number or an array. D is √π/2 times the ratio
        of the gap to the mean free path. Values of D below 1e-30 are replaced by 1e-30.

    References
    ----------
    Fukui & Kaneko, J. Tribol. 112, 1990, 78; Cercignani & Daneri, J. Appl. Phys. 34, 1963, 3509.
    """
    d = np.maximum(reals(inverse_knudsen), _LEAST)
    formula = np.digitize(d, (FREE_MOLECULAR, TRANSITION, SLIP))  # 0 to 3
    a, b, c, e = _FACTORS[:, formula]
    # only the free-molecular formula has logarithmic terms; ln 1 = 0 removes the logarithmic terms elsewhere
    ln = np.log(np.where(d < FREE_MOLECULAR, d, 1.0))
    return np.asarray(a * d + b + c / d + e / d**2 - ln / sqrt(pi) + _EXCESS * d * ln**2)


def cubic_law(gap: Any) -> Any:
    """Compute the permeability h³/12 [m³] of a gap h [m] between parallel plates."""
    return gap * gap * gap / 12.0


class FlowLaw(ABC):
    """Base class of flow laws, which give the permeability of a gap as K = (h³/12) F(h, p) with a factor F > 0.

    A flow law defines the method `factor`, and should be a frozen dataclass whose fields are its parameters. In all
    methods, the gap h >= 0 [m] and the pressure p >= 0 [Pa] are numbers or arrays that are broadcast together. The
    pressure of a gas is absolute.

    Examples
    --------
    Define a flow law that reduces the permeability in narrow gaps:

    >>> from dataclasses import dataclass
    >>> import femseal as fs
    >>> @dataclass(frozen=True)
    ... class Hindered(fs.FlowLaw):
    ...     scale_parameter = "size"  # name of the parameter that sets the characteristic length
    ...     size: float  # [m]
    ...
    ...     def factor(self, gap, pressure=0.0):
    ...         return 1 / (1 + self.size / np.asarray(gap))
    >>> gap = np.full((16, 16), 1e-6)
    >>> k = fs.cell_permeability(gap, (1e-6, 1e-6), law=Hindered(1e-6)).value
    >>> round(12 * k / 1e-18, 6)  # relative to h³/12
    0.5
    """

    #: Name of the parameter, of the law and of the fluid, to which the characteristic length of the law is
    #: proportional, such as "slip_length", or "viscosity" for the mean free path of a gas; "" if there is none.
    scale_parameter: ClassVar[str] = ""
    #: Whether K(s h) = s³ K(h) for every factor s. The flow through the gap s h is then s³ times the flow through h.
    homogeneous: ClassVar[bool] = False
    #: Whether K depends on the pressure. Pressure and permeability are then computed by a fixed-point iteration.
    depends_on_pressure: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        """Accept the former name `length` of `scale_parameter`."""
        super().__init_subclass__(**options)
        former = cls.__dict__.get("length")
        if isinstance(former, str):
            warnings.warn(
                "length is scale_parameter now; also set homogeneous = True if it is empty",
                DeprecationWarning,
                stacklevel=3,
            )
            cls.scale_parameter = former
            cls.homogeneous = not former

    @abstractmethod
    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Compute the ratio F(h, p) of K to h³/12; it may be infinite where h or p is 0."""

    def permeability(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Compute K(h, p) [m³], which is 0 where the gap is 0."""
        return np.asarray(cubic_law(self.equivalent_gap(gap, pressure)))

    def equivalent_gap(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Compute the gap [m] whose permeability by the cubic law is K(h, p); 0 where the gap is 0.

        Raises
        ------
        InputError : the factor F of the flow law is not positive and finite where the gap is open.
        """
        h, p = np.broadcast_arrays(np.asarray(gap, dtype=float), np.asarray(pressure, dtype=float))
        with np.errstate(
            divide="ignore", invalid="ignore"
        ):  # the factor is not used where the gap is 0
            factor = self.factor(h, p)
        return gap_with_factor(h, factor)

    def gap(self, permeability: float, pressure: float = 0.0) -> float:
        """Compute the gap [m] that has a given permeability > 0 [m³], by the secant method in ln h.

        A law that consists of several formulas may have small jumps between them. If a permeability lies within a jump
        of at most 1 %, the gap at the jump is returned.

        Raises
        ------
        InputError : the permeability is not a number > 0.
        NotConverged : no gap has this permeability within 1 %.
        """
        from scipy.optimize import newton

        validate.number("permeability", permeability, unit="m³")

        def log_ratio(log_gap: float) -> float:
            return float(np.log(self.permeability(np.exp(log_gap), pressure) / permeability))

        start = np.log(np.cbrt(12 * permeability))
        log_gap = newton(log_ratio, start, tol=1e-14, disp=False)
        error = abs(log_ratio(log_gap))
        if not error <= _LARGEST_JUMP:
            raise NotConverged(
                f"gap of a flow law: no gap with the permeability {permeability:g} m³ was found for {self}; at the "
                f"last gap, {np.exp(log_gap):g} m, the permeability differs by a factor of {np.exp(error):.3g}. "
                "The permeability of a flow law must increase continuously with the gap",
                error,
            )
        return float(np.exp(log_gap))


@dataclass(frozen=True)
class CubicLaw(FlowLaw):
    """Flow law of a viscous fluid without slip at the faces: K = h³/12.

    Source: Reynolds, Phil. Trans. R. Soc. 177, 1886, 157.
    """

    homogeneous: ClassVar[bool] = True

    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Return ones."""
        return np.ones(np.broadcast_shapes(np.shape(gap), np.shape(pressure)))

    def equivalent_gap(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Return the gap itself."""
        return np.asarray(gap, dtype=float)


@dataclass(frozen=True)
class SlipLength(FlowLaw):
    """Flow law of a liquid that slips on both faces: K = (h³/12)(1 + 6b/h).

    slip_length : slip length b >= 0 [m], defined by u = b ∂u/∂n at a face, where u is the velocity of the fluid and n
        the distance from the face.

    Source: Navier's condition; Lauga, Brenner & Stone, Springer Handbook of Experimental Fluid Mechanics, 2007, 1219.
    """

    scale_parameter: ClassVar[str] = "slip_length"
    slip_length: float

    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Compute 1 + 6b/h."""
        h, _ = np.broadcast_arrays(np.asarray(gap, dtype=float), pressure)
        return 1 + np.divide(6 * self.slip_length, h, out=np.full(h.shape, np.inf), where=h > 0)


@dataclass(frozen=True)
class FukuiKaneko(FlowLaw):
    """Flow law of a rarefied gas from free-molecular to continuum flow: F = Q(D)/(D/6), see `flow_rate` for Q.

    viscosity : viscosity η of the gas [Pa s].
    speed : most probable speed √(2R_sT) of the gas molecules [m/s].
    """

    scale_parameter: ClassVar[str] = "viscosity"
    depends_on_pressure: ClassVar[bool] = True
    viscosity: float
    speed: float

    def inverse_knudsen(self, gap: ArrayLike, pressure: ArrayLike) -> Array:
        """Compute the inverse Knudsen number D = p h/(η√(2R_sT)); the mean free path is √π h/(2D)."""
        return (
            np.asarray(pressure, dtype=float)
            * np.asarray(gap, dtype=float)
            / (self.viscosity * self.speed)
        )

    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Compute 6 Q(D)/D, which is infinite where the gap or the pressure is 0."""
        d = self.inverse_knudsen(gap, pressure)
        return np.divide(6 * flow_rate(d), d, out=np.full(d.shape, np.inf), where=d > 0)


CUBIC_LAW = CubicLaw()


def law_of(fluid: Any) -> FlowLaw:
    """Return the flow law of a fluid, which is the cubic law if the fluid has no attribute `law`."""
    return getattr(fluid, "law", CUBIC_LAW)


def checked_equivalent_gap(gap: Array, law: FlowLaw, pressure: ArrayLike | None) -> Array:
    """Compute the equivalent gap [m] of a gap (n1, n2) [m] for a flow law, after a check of the law and the pressure.

    pressure : fluid pressure [Pa], a number or an array (n1, n2); only used if the flow law depends on the pressure.

    Raises
    ------
    InputError : `law` is not a flow law; or the law depends on the pressure, and the pressure is missing, has another
        shape, or has negative or undefined values.
    """
    if not isinstance(law, FlowLaw):
        raise InputError(
            "law", repr(law), "a flow law, such as femseal.flow.CubicLaw() or the law of a fluid"
        )
    if not law.depends_on_pressure:
        return law.equivalent_gap(gap)
    p = np.asarray(np.nan if pressure is None else pressure, dtype=float)
    if p.shape not in ((), gap.shape):
        raise InputError("pressure", f"shape {p.shape}", f"a number or shape {gap.shape} [Pa]")
    if not (np.isfinite(p).all() and p.min(initial=0.0) >= 0):
        given = "none" if pressure is None else "negative or undefined values"
        raise InputError(
            "pressure",
            given,
            f"finite numbers >= 0 [Pa], because the flow law {law} depends on the pressure",
        )
    return law.equivalent_gap(gap, p)


def gap_with_factor(gap: Array, factor: ArrayLike) -> Array:
    """Compute the gap [m] whose permeability by the cubic law is (h³/12) F with a factor F > 0; 0 where h is 0.

    Raises
    ------
    InputError : F is not positive and finite where the gap is open.
    """
    factor = np.broadcast_to(np.asarray(factor, dtype=float), gap.shape)
    if not ((factor > 0) & np.isfinite(factor)).all(where=gap > 0):
        raise InputError(
            "law", "a factor <= 0 or undefined", "finite factors > 0 where the gap is open"
        )
    return np.multiply(gap, np.cbrt(factor), out=np.zeros(gap.shape), where=gap > 0)
