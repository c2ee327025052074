"""Define contact laws whose hardness is a curve over depth: from a table, or by Nix and Gao."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..base import Array, InputError, counted, reals, to_text, validate
from .law import ContactLaw

#: Depth [m] above which experiments agree with the law of Nix and Gao (Feng & Nix, Scripta Mater. 51, 2004, 599).
SMALLEST_DEPTH = 1e-7


@dataclass(frozen=True, eq=False)
class HardnessTable(ContactLaw):
    """Law with a table of hardness over depth, as instrumented indentation measures it.

    A point that yields to the depth u is assumed to carry the pressure of an indentation of this depth. H(u) is
    interpolated with a monotone cubic (PCHIP; Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 1984, 300), and constant
    beyond the ends of the table.

    Parameters
    ----------
    depth : array (n,)
        Depths >= 0 [m], which rise.
    hardness : array (n,)
        Hardness > 0 at each depth [Pa].

    Raises
    ------
    InputError
        There are fewer than two points, the depths do not rise, or a hardness is not a finite number > 0.

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
            one_row = np.atleast_2d(np.asarray(getattr(self, name), dtype=object))
            values = validate.field(name, one_row, unit=unit)[0]
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
        """H(u) between the ends, and its derivative."""
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator(self.depth, self.hardness)
        return curve, curve.derivative()

    @property
    def capacity(self) -> float:
        """Hardness at the end of the table [Pa], which points carry at any larger depth."""
        return float(self.hardness[-1])

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Interpolate H(u) [Pa]."""
        curve, _ = self._curves
        return curve(np.clip(deformation, self.depth[0], self.depth[-1]))

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute dH/du [Pa/m], which is 0 beyond the ends of the table."""
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
    """Law of a metal that is harder at small depths: H(u) = H₀ √(1 + h*/u), constant below a smallest depth.

    Such a metal softens as it yields (Nix & Gao, J. Mech. Phys. Solids 46, 1998, 411). Below about 0.1 µm the measured
    hardness remains finite (Feng & Nix, Scripta Mater. 51, 2004, 599), whereas the formula becomes infinite; this is
    what the smallest depth is for.

    Parameters
    ----------
    hardness : float
        Hardness H₀ > 0 at large depths [Pa].
    depth : float
        Length h* >= 0 of the law [m].
    smallest_depth : float
        Depth > 0 below which the hardness is constant [m].

    Raises
    ------
    InputError
        A value is out of its range.

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
        """Hardness H₀ at large depths [Pa], which points carry at any depth."""
        return self.hardness

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute H₀ √(1 + h*/u) [Pa]."""
        u = np.maximum(deformation, self.smallest_depth)
        return self.hardness * np.sqrt(1 + self.depth / u)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Compute dH/du <= 0 [Pa/m]."""
        u = np.maximum(deformation, self.smallest_depth)
        slope = -0.5 * self.hardness * self.depth / (u**2 * np.sqrt(1 + self.depth / u))
        return np.where(np.asarray(deformation) >= self.smallest_depth, slope, 0.0)

    def __str__(self) -> str:
        first = to_text(self.mean_hardness, "Pa")
        return (
            f"elastic-plastic with hardness {to_text(self.hardness, 'Pa')} √(1 + {to_text(self.depth, 'm')}/depth), "
            f"{first} up to a depth of {to_text(self.smallest_depth, 'm')}"
        )
