"""Contact laws whose hardness is a curve of the depth: of a table, or by Nix and Gao."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..base import Array, InputError, counted, reals, to_text, validate
from .law import ContactLaw

#: Depth [m] above which Nix and Gao's law was found to hold (Feng & Nix, Scripta Mater. 51, 2004, 599).
SMALLEST_DEPTH = 1e-7


@dataclass(frozen=True, eq=False)
class HardnessTable(ContactLaw):
    """Hardness over depth, as instrumented indentation measures it: H(u) through the points of a table.

    Between the points it is a monotone cubic (PCHIP), beyond the ends the hardness of the end; a point that yields to
    the depth u is taken to carry what an indentation of this depth does.
    Source: Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 1984, 300 (interpolation).

    Parameters
    ----------
    depth : rising depths >= 0 [m]. hardness : as many hardnesses > 0 [Pa].

    Raises
    ------
    InputError : fewer than two points, depths that do not rise, or hardnesses that are not finite numbers > 0.

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
            values = validate.field(
                name, np.atleast_2d(np.asarray(getattr(self, name), dtype=object)), unit=unit
            )[0]
            object.__setattr__(self, name, values)
        if self.depth.size < 2 or self.depth.size != self.hardness.size:
            given = (
                f"{counted(self.depth.size, 'value')} of depth and {self.hardness.size} of hardness"
            )
            raise InputError("hardness table", given, "as many of both, two or more")
        if not (self.depth[0] >= 0 and np.all(np.diff(self.depth) > 0)):
            raise InputError(
                "depth", ", ".join(to_text(d, "m") for d in self.depth), "depths >= 0 that rise"
            )
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
        """The hardness at the end of the table: what all points carry, however deep."""
        return float(self.hardness[-1])

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """H(u)."""
        return self._curves[0](np.clip(deformation, self.depth[0], self.depth[-1]))

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """dH/du; 0 beyond the ends."""
        u = reals(deformation)
        inside = (u >= self.depth[0]) & (u < self.depth[-1])
        return np.where(inside, self._curves[1](np.clip(u, self.depth[0], self.depth[-1])), 0.0)

    def __str__(self) -> str:
        ends = " to ".join(to_text(h, "Pa") for h in self.hardness[[0, -1]])
        depths = " to ".join(to_text(d, "m") for d in self.depth[[0, -1]])
        return f"elastic-plastic with hardness {ends} at depths of {depths}, by a table"


@dataclass(frozen=True, eq=False)
class NixGao(ContactLaw):
    """A metal that is the harder the less deep it has yielded: H(u) = H₀ √(1 + h*/u), constant below a smallest depth.

    It softens as it yields. Without the smallest depth the first yield would take an endless pressure; the law itself
    fails below about 0.1 µm, where hardness stays finite.
    Source: Nix & Gao, J. Mech. Phys. Solids 46, 1998, 411; Feng & Nix, Scripta Mater. 51, 2004, 599.

    Parameters
    ----------
    hardness : H₀ > 0 of large depths [Pa]. depth : h* >= 0 [m]. smallest_depth : > 0 [m].

    Raises
    ------
    InputError : values out of these ranges.

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
        """H₀: what all points carry, however deep."""
        return self.hardness

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """H₀ √(1 + h*/u)."""
        return self.hardness * np.sqrt(
            1 + self.depth / np.maximum(deformation, self.smallest_depth)
        )

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """dH/du, at most 0."""
        u = np.maximum(deformation, self.smallest_depth)
        slope = -0.5 * self.hardness * self.depth / (u**2 * np.sqrt(1 + self.depth / u))
        return np.where(np.asarray(deformation) >= self.smallest_depth, slope, 0.0)

    def __str__(self) -> str:
        first = to_text(self.mean_hardness, "Pa")
        return (
            f"elastic-plastic with hardness {to_text(self.hardness, 'Pa')} √(1 + {to_text(self.depth, 'm')}/depth), "
            f"{first} up to a depth of {to_text(self.smallest_depth, 'm')}"
        )
