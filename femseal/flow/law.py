"""Flow laws: the permeability K(h, p) of a gap h between parallel plates at a fluid pressure p.

The mass flux per width is −K (ρ/η) ∇p. A fluid changes the variable (∫ρ/η dp, see `femseal.fluids`), its law changes K.
Each law is a small frozen class, given by how many times more it lets through than h³/12. Faces and cells are solved at
the gap that has the same permeability by the cubic law, taken at the pixels and interpolated between them as any gap.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import log, pi, sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, counted, reals, shown

#: D at which the formulas of the transition and of slip begin, after that below which molecules do not meet.
FREE_MOLECULAR, TRANSITION, SLIP = 0.01, 0.15, 5.0
#: Least D of the logarithm, which has no limit.
_LEAST = 1e-30
#: Q of plates without end at D = 1, and the c that makes the lowest two formulas meet.
_FREE = 1.5 * (1.0 - 0.5772156649015329) / sqrt(pi)
_EXCESS = (-2.22919e-2 + 2.10673 + 1.653 - 0.694 - _FREE + log(FREE_MOLECULAR) / sqrt(pi)) / (
    FREE_MOLECULAR * log(FREE_MOLECULAR) ** 2
)
#: Factors of D, 1, 1/D and 1/D² in the formulas.
_FACTORS = np.transpose(
    [
        (0.0, _FREE, 0.0, 0.0),
        (-2.22919, 2.10673, 0.01653, -0.0000694),
        (0.13852, 1.25087, 0.15653, -0.00969),
        (1 / 6, 1.0162, 1.0653, -2.1354),
    ]
)


def flow_rate(inverse_knudsen: ArrayLike) -> Array:
    """Q(D), the flow rate of a gas between plates over h²/√(2R_sT) times the pressure gradient; without slip D/6.

    inverse_knudsen : D = p h/(η√(2R_sT)) >= 0, √π/2 over the ratio of mean free path and gap. Below 1e-30 it is taken
        for 1e-30.

    Q has its least value, Knudsen's minimum, near D = 1. It is a fit to the linearised Boltzmann (BGK) equation for
    walls that reflect diffusely, within 0.9 % of a solution of that equation, and jumps by 0.27 % at D = 0.15 and
    0.14 % at D = 5. Below 0.01, where the fit ends, the limit of free molecules between plates without end takes over,
    within 0.3 %: (3(1 − γ)/2 − ln D)/√π with Euler's γ, plus c D ln²D, whose c makes it continuous.
    Sources: Fukui & Kaneko, J. Tribol. 112, 1990, 78; Cercignani & Daneri, J. Appl. Phys. 34, 1963, 3509.
    """
    d = np.maximum(reals(inverse_knudsen), _LEAST)
    a, b, c, e = _FACTORS[:, np.digitize(d, (FREE_MOLECULAR, TRANSITION, SLIP))]
    ln = np.log(np.where(d < FREE_MOLECULAR, d, 1.0))
    return np.asarray(a * d + b + c / d + e / d**2 - ln / sqrt(pi) + _EXCESS * d * ln**2)


def cubic_law(gap: Any) -> Any:
    """Permeability h³/12 [m³] of a gap h [m] between parallel plates."""
    return gap * gap * gap / 12.0


class FlowLaw(ABC):
    """Permeability of a gap, as K = (h³/12) F(h, p) with a factor F > 0; a law defines `factor`.

    Gaps h >= 0 [m] and pressures p >= 0 [Pa], absolute for a gas, are numbers or arrays that are broadcast.
    """

    #: Parameter of law and fluid with which the law's own length goes, such as a slip length; "" where it has none.
    length: ClassVar[str] = "length"
    #: Whether K depends on the pressure, so that a flow is a fixed point of pressures and permeabilities.
    depends_on_pressure: ClassVar[bool] = False

    @property
    def homogeneous(self) -> bool:
        """Whether K(s h) = s³ K(h): a law without a length of its own, whose flow holds for the scaled gap."""
        return not self.length

    @abstractmethod
    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """F(h, p), K over h³/12; it may be inf where h or p is 0."""

    def permeability(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """K(h, p) [m³], 0 where the gap is 0."""
        return np.asarray(cubic_law(self.equivalent_gap(gap, pressure)))

    def equivalent_gap(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Gap [m] whose permeability by the cubic law is K(h, p); 0 where the gap is 0.

        Raises
        ------
        InputError : a factor that is not > 0 and finite where the gap is open.
        """
        h, p = np.broadcast_arrays(np.asarray(gap, dtype=float), np.asarray(pressure, dtype=float))
        return widened(h, self.factor(h, p))

    def gap(self, permeability: float, pressure: float = 0.0) -> float:
        """Gap [m] with a permeability > 0 [m³], by the secant method in ln h."""
        from scipy.optimize import newton

        def excess(x: float) -> float:
            return float(np.log(self.permeability(np.exp(x), pressure) / permeability))

        start = np.log(np.cbrt(12 * permeability))
        return float(np.exp(newton(excess, start, tol=1e-14, disp=False)))


@dataclass(frozen=True)
class CubicLaw(FlowLaw):
    """A viscous fluid that sticks to both faces: K = h³/12.

    Source: Reynolds, Phil. Trans. R. Soc. 177, 1886, 157.
    """

    length: ClassVar[str] = ""

    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """Ones."""
        return np.ones(np.broadcast_shapes(np.shape(gap), np.shape(pressure)))

    def equivalent_gap(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """The gap as it is."""
        return np.asarray(gap, dtype=float)


@dataclass(frozen=True)
class SlipLength(FlowLaw):
    """A liquid that slips on both faces by a slip length b, u = b ∂u/∂n: K = (h³/12)(1 + 6b/h).

    slip_length : b >= 0 [m].
    Source: Navier's condition; Lauga, Brenner & Stone, Springer Handbook of Experimental Fluid Mechanics, 2007, 1219.
    """

    length: ClassVar[str] = "slip_length"
    slip_length: float

    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """1 + 6b/h."""
        h = np.broadcast_arrays(np.asarray(gap, dtype=float), pressure)[0]
        return 1 + np.divide(6 * self.slip_length, h, out=np.full(h.shape, np.inf), where=h > 0)


@dataclass(frozen=True)
class FukuiKaneko(FlowLaw):
    """A rarefied gas from molecules to continuum: F = Q(D)/(D/6), see `flow_rate` for Q and its source.

    viscosity : η [Pa s]. speed : √(2R_sT) of the molecules [m/s].
    """

    length: ClassVar[str] = "viscosity"
    depends_on_pressure: ClassVar[bool] = True
    viscosity: float
    speed: float

    def inverse_knudsen(self, gap: ArrayLike, pressure: ArrayLike) -> Array:
        """D = p h/(η√(2R_sT)); the mean free path is √π h/2D."""
        return (
            np.asarray(pressure, dtype=float)
            * np.asarray(gap, dtype=float)
            / (self.viscosity * self.speed)
        )

    def factor(self, gap: ArrayLike, pressure: ArrayLike = 0.0) -> Array:
        """6 Q(D)/D; inf where gap or pressure is 0."""

        d = self.inverse_knudsen(gap, pressure)
        return np.divide(6 * flow_rate(d), d, out=np.full(d.shape, np.inf), where=d > 0)


CUBIC_LAW = CubicLaw()


def law_of(fluid: Any) -> FlowLaw:
    """Law of a fluid, its `law`; the cubic one where it names none."""
    return getattr(fluid, "law", CUBIC_LAW)


def gap_by_law(gap: Array, law: FlowLaw, pressure: ArrayLike | None) -> Array:
    """`FlowLaw.equivalent_gap` of a checked gap (n1, n2) [m] at a fluid pressure [Pa], a number or (n1, n2).

    Raises
    ------
    InputError : no law, or no pressure, one of another shape, negative or undefined, where the law depends on it.
    """
    if not isinstance(law, FlowLaw):
        raise InputError(
            "law", repr(law), "a law of flow, such as femseal.flow.CubicLaw() or the law of a fluid"
        )
    if not law.depends_on_pressure:
        return law.equivalent_gap(gap)
    p = np.asarray(np.nan if pressure is None else pressure, dtype=float)
    if p.shape not in ((), gap.shape):
        raise InputError("pressure", f"shape {p.shape}", f"a number or shape {gap.shape} [Pa]")
    if not (np.isfinite(p).all() and p.min(initial=0.0) >= 0):
        given = "none" if pressure is None else "negative or undefined values"
        raise InputError(
            "pressure", given, f"finite numbers >= 0 [Pa], on which the law {law} depends"
        )
    return law.equivalent_gap(gap, p)


def widened(gap: Array, factor: ArrayLike) -> Array:
    """Gap [m] whose permeability by the cubic law is (h³/12) F with a factor F > 0; 0 where the gap is 0.

    Raises
    ------
    InputError : a factor that is not > 0 and finite where the gap is open.
    """
    factor = np.broadcast_to(np.asarray(factor, dtype=float), gap.shape)
    if not ((factor > 0) & np.isfinite(factor)).all(where=gap > 0):
        raise InputError(
            "law", "a factor <= 0 or undefined", "finite factors > 0 where the gap is open"
        )
    return np.multiply(gap, np.cbrt(factor), out=np.zeros(gap.shape), where=gap > 0)


def checked_permeability(name: str, permeability: ArrayLike, *shapes: tuple[int, ...]) -> Array:
    """Permeability as a finite number, or numbers of one of the shapes, >= 0 but for tensors; else InputError."""
    try:
        k = np.asarray(permeability, dtype=float)
    except (TypeError, ValueError):
        raise InputError(name, shown(permeability), "numbers [m³]") from None
    if k.shape not in ((), *shapes):
        allowed = f"a number or shape {' or '.join(map(str, shapes))}"
        raise InputError(name, f"shape {k.shape}", allowed)
    if undefined := np.count_nonzero(~np.isfinite(k)):
        raise InputError(name, f"{counted(undefined, 'value')} not finite", "numbers >= 0 [m³]")
    if k.ndim < 3 and k.min(initial=0.0) < 0:
        raise InputError(name, f"{k.min():g}", "numbers >= 0 [m³]")
    return k
