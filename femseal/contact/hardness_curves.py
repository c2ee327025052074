"""Define contact laws whose hardness depends on the depth: from a table, by Nix and Gao, and for a coated body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..base import Array, Flags, InputError, counted, reals, to_text, validate
from ..materials import Coated
from .law import ContactLaw
from .linear_laws import contact_law

#: Depth interval, as a fraction of the thickness of a coating, in which H(u) changes from the hardness of the coating
#: to the hardness of the substrate. The change is gradual, because a step would have no finite slope.
_PASSAGE = 0.1
#: Depth [m] above which experiments agree with the law of Nix and Gao (Feng & Nix, Scripta Mater. 51, 2004, 599).
SMALLEST_DEPTH = 1e-7


@dataclass(frozen=True, eq=False)
class HardnessTable(ContactLaw):
    """Contact law with a table of hardness over depth, as instrumented indentation measures it.

    The plastic deformation u of a point is taken as the depth of an indentation, and H(u) as the hardness measured at
    this depth. Between the depths of the table, H(u) is interpolated by monotone cubics (PCHIP; Fritsch & Butland, SIAM
    J. Sci. Stat. Comput. 5, 1984, 300). Beyond the ends of the table, H(u) is constant.

    Parameters
    ----------
    depth : array (n,)
        Depths >= 0 in increasing order [m].
    hardness : array (n,)
        Hardness > 0 at each depth [Pa].

    Raises
    ------
    InputError
        The table has fewer than two rows, the depths do not increase, or a hardness is not positive and finite.

    Examples
    --------
    >>> law = HardnessTable([0.0, 1e-6], [1e9, 3e9])
    >>> law.yield_pressure(np.array([0.5e-6, 5e-6])).tolist()
    [2000000000.0, 3000000000.0]
    """

    depth: Array
    hardness: Array

    def __post_init__(self) -> None:
        for name, unit in (("depth", "m"), ("hardness", "Pa")):
            # `validate.field` checks two-dimensional arrays
            single_row = np.atleast_2d(np.asarray(getattr(self, name), dtype=object))
            values = validate.field(name, single_row, unit=unit)[0]
            object.__setattr__(self, name, values)
        if self.depth.size < 2 or self.depth.size != self.hardness.size:
            n_depths = counted(self.depth.size, "value")
            given = f"{n_depths} of depth and {self.hardness.size} of hardness"
            raise InputError(
                "hardness table", given, "the same number of depths and hardnesses, at least two"
            )
        if not (self.depth[0] >= 0 and np.all(np.diff(self.depth) > 0)):
            given = ", ".join(to_text(depth, "m") for depth in self.depth)
            raise InputError("depth", given, "rising depths >= 0")
        if not np.all(self.hardness > 0):
            raise InputError("hardness", f"{self.hardness.min():g} Pa", "numbers > 0 [Pa]")

    @cached_property
    def _curves(self) -> tuple[Any, Any]:
        """Interpolating functions for H(u) and for dH/du between the ends of the table."""
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator(self.depth, self.hardness)
        return curve, curve.derivative()

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry: the last hardness of the table.

        Beyond the last depth of the table, the hardness remains constant.
        """
        return float(self.hardness[-1])

    @property
    def constant_depth(self) -> float:
        """Smallest depth of the table [m], up to which the hardness is constant."""
        return float(self.depth[0])

    @property
    def bends(self) -> Array:
        """Depths of the table [m]. Between two depths, the curve H(u) is a cubic."""
        return self.depth

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Interpolate the hardness H(u) [Pa] in the table."""
        curve, _ = self._curves
        return curve(np.clip(deformation, self.depth[0], self.depth[-1]))

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute the slope dH/du [Pa/m] of the interpolated hardness, which is 0 beyond the ends of the table."""
        u = reals(deformation)
        first, last = self.depth[0], self.depth[-1]
        _, derivative = self._curves
        is_inside = (u >= first) & (u < last)
        return np.where(is_inside, derivative(np.clip(u, first, last)), 0.0)

    def __str__(self) -> str:
        ends = " to ".join(to_text(h, "Pa") for h in self.hardness[[0, -1]])
        depths = " to ".join(to_text(d, "m") for d in self.depth[[0, -1]])
        return f"elastic-plastic with hardness {ends} at depths of {depths}, by a table"


@dataclass(frozen=True, eq=False)
class NixGao(ContactLaw):
    """Contact law of a metal that is harder at small depths: H(u) = H₀ √(1 + h*/u), constant below a smallest depth.

    The hardness of a metal that follows this law decreases as the metal yields (Nix & Gao, J. Mech. Phys. Solids 46,
    1998, 411). As the depth u tends to 0, the formula tends to infinity. The measured hardness, however, remains finite
    below about 0.1 µm (Feng & Nix, Scripta Mater. 51, 2004, 599). Below a smallest depth, H(u) is therefore constant.

    Parameters
    ----------
    hardness : float
        Hardness H₀ > 0 at large depths [Pa].
    depth : float
        Characteristic depth h* >= 0 [m].
    smallest_depth : float
        Depth > 0 below which the hardness is constant [m].

    Raises
    ------
    InputError
        A parameter is outside its permissible range.

    Examples
    --------
    >>> NixGao(1e9, 3e-6).yield_pressure(np.array([0.0, 1e-7, 1e-6])).round(-6)
    array([5.568e+09, 5.568e+09, 2.000e+09])
    """

    hardness: float
    depth: float
    smallest_depth: float = SMALLEST_DEPTH

    def __post_init__(self) -> None:
        for name, unit in (("hardness", "Pa"), ("depth", "m"), ("smallest_depth", "m")):
            value = validate.number(name, getattr(self, name), unit=unit, inclusive=name == "depth")
            object.__setattr__(self, name, value)

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry at any depth: the hardness H₀ at large depths."""
        return self.hardness

    @property
    def constant_depth(self) -> float:
        """Depth [m] up to which the hardness is constant: the parameter `smallest_depth`."""
        return self.smallest_depth

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute the hardness H₀ √(1 + h*/u) [Pa]; below the smallest depth, u is replaced by this depth."""
        u = np.maximum(deformation, self.smallest_depth)
        return self.hardness * np.sqrt(1 + self.depth / u)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute the slope dH/du <= 0 [Pa/m] of the hardness; below the smallest depth the slope is 0."""
        u = np.maximum(deformation, self.smallest_depth)
        slope = -0.5 * self.hardness * self.depth / (u**2 * np.sqrt(1 + self.depth / u))
        return np.where(np.asarray(deformation) >= self.smallest_depth, slope, 0.0)

    def __str__(self) -> str:
        first = to_text(self.mean_hardness, "Pa")
        return (
            f"elastic-plastic with hardness {to_text(self.hardness, 'Pa')} √(1 + {to_text(self.depth, 'm')}/depth), "
            f"{first} up to a depth of {to_text(self.smallest_depth, 'm')}"
        )


@dataclass(frozen=True, eq=False)
class CoatedLaw(ContactLaw):
    """Contact law of a coated body: H(u) is the hardness of the coating down to its thickness, then of the substrate.

    Up to the plastic deformation u = d, H(u) is the curve of the coating. Between d and 1.1 d, H(u) changes smoothly to
    the curve of the substrate. The curve of the substrate is evaluated at the substrate's plastic deformation u − d.

    The law assumes that the substrate does not constrain the plastic flow of the coating up to u = d. The assumption is
    a good approximation for contact patches that are at most about six times as wide as the coating is thick. On wider
    patches, the coating carries more pressure than the law assumes. Consider a strip of width w in contact, with a
    coating of yield stress σ_y that sticks to both faces. In plane strain, the mean pressure on the strip is (2/√3) σ_y
    (1 + w/4d) (slab method, Hosford & Caddell, Metal Forming, section 9.11). It exceeds the usual hardness 2.8 σ_y if
    w > 5.7 d: by 44 % for w = 10 d, and by a factor of 2.5 for w = 20 d. The contact law is evaluated point by point
    and therefore does not know the width w. A run warns if the width matters, see `checks.constrained_hardness_ratio`.

    Parameters
    ----------
    layer : ContactLaw
        Law of the coating.
    substrate : ContactLaw
        Law of the substrate.
    thickness : float
        Thickness d > 0 of the coating [m].

    Raises
    ------
    InputError
        The thickness is not positive.

    Examples
    --------
    >>> law = CoatedLaw(contact_law(150e6), contact_law(600e6), 20e-6)
    >>> law.yield_pressure(np.array([0.0, 19e-6, 30e-6])).tolist()
    [150000000.0, 150000000.0, 600000000.0]
    """

    layer: ContactLaw
    substrate: ContactLaw
    thickness: float

    def __post_init__(self) -> None:
        thickness = validate.number("thickness", self.thickness, unit="m")
        object.__setattr__(self, "thickness", thickness)

    @classmethod
    def of(cls, body: Coated) -> ContactLaw:
        """Make the contact law of a coated body from the hardness of its coating and of its substrate."""
        substrate = None if body.substrate is None else body.substrate.hardness
        return law_of_coating(
            contact_law(_hardness(body.layer.hardness)),
            None if substrate is None else contact_law(_hardness(substrate)),
            body.thickness,
        )

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry.

        The law of the substrate limits the mean pressure, because the coating may yield through its whole thickness.
        """
        return self.substrate.capacity

    @property
    def constant_depth(self) -> float:
        """Depth [m] up to which H(u) is constant, which is at most the thickness of the coating."""
        return min(self.layer.constant_depth, self.thickness)

    @property
    def bends(self) -> Array:
        """Depths [m] at which the formula of H(u) changes.

        These are the start and the end of the transition from coating to substrate, and the depths at which the law of
        either material changes its formula.
        """
        d = self.thickness
        return np.r_[self.layer.bends, d, (1 + _PASSAGE) * d, d + self.substrate.bends]

    def of_points(self, is_chosen: Flags) -> ContactLaw | None:
        """Return the contact law of the chosen points, see `ContactLaw.of_points`."""
        layer = self.layer.of_points(is_chosen)
        substrate = self.substrate.of_points(is_chosen)
        if layer is None or substrate is None:
            return None
        return CoatedLaw(layer, substrate, self.thickness)

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute the hardness H(u) [Pa] of the coated body."""
        u = reals(deformation)
        layer = self.layer.yield_pressure(u)
        share = self._share(u)
        return layer + share * (self.substrate.yield_pressure(self._below(u)) - layer)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute the slope dH/du [Pa/m] of the hardness of the coated body."""
        u = reals(deformation)
        x = self._passed(u)
        share = self._share(u)
        below = self._below(u)
        slope = (1 - share) * self.layer.hardening_modulus(u)
        slope = slope + np.where(below > 0, share * self.substrate.hardening_modulus(below), 0.0)
        difference = self.substrate.yield_pressure(below) - self.layer.yield_pressure(u)
        return slope + 6 * x * (1 - x) / (_PASSAGE * self.thickness) * difference

    def _below(self, u: Array) -> Array:
        """Return the plastic deformation of the substrate [m]: u minus the thickness of the coating, at least 0."""
        return np.maximum(u - self.thickness, 0.0)

    def _passed(self, u: Array) -> Array:
        """Return a coordinate x that rises from 0 at u = d to 1 at u = 1.1 d, where d is the coating thickness."""
        return np.clip((u / self.thickness - 1) / _PASSAGE, 0.0, 1.0)

    def _share(self, u: Array) -> Array:
        """Return the weight of the substrate's hardness in H(u): a smooth step 3x² − 2x³ from 0 to 1."""
        x = self._passed(u)
        return x**2 * (3 - 2 * x)

    def __str__(self) -> str:
        return f"a coating of {to_text(self.thickness, 'm')}, {self.layer}, on a substrate, {self.substrate}"


def law_of_coating(layer: ContactLaw, substrate: ContactLaw | None, thickness: float) -> ContactLaw:
    """Make the contact law of a coated body.

    If the substrate or the coating never yields, the law of the coating is returned, since it then applies at every
    depth. A substrate never yields if it is rigid (None) or has no given strength.

    Parameters
    ----------
    layer, substrate : ContactLaw
        Contact laws of the coating and of the substrate; the substrate is None if it is rigid.
    thickness : float
        Thickness of the coating [m].
    """
    if substrate is None or substrate.is_elastic or layer.is_elastic:
        return layer
    return CoatedLaw(layer, substrate, thickness)


def _hardness(hardness: float | None) -> float:
    """Return a hardness [Pa] as a number. None, which means that the solid never yields, is converted to infinity."""
    return np.inf if hardness is None else float(hardness)
