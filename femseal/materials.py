"""Elastic-plastic solids.

Symbols: E Young's modulus, ν Poisson's ratio, E* contact modulus, σ_y yield stress, H hardness.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite

from .base.errors import InputError

#: H = HARDNESS_FACTOR · σ_y, full plasticity of an indentation (Johnson, Contact Mechanics, 1985, ch. 6).
HARDNESS_FACTOR = 2.8


@dataclass(frozen=True)
class Solid:
    """A linear elastic, perfectly plastic solid.

    Parameters
    ----------
    young : Young's modulus E [Pa], > 0.
    poisson : Poisson's ratio ν [-], -1 < ν <= 0.5.
    yield_stress : σ_y [Pa]; the hardness is then 2.8 σ_y.
    hardness : H [Pa], given directly; with neither of the two the solid stays elastic (H = inf).

    Raises
    ------
    InputError : a value out of its range, or both yield_stress and hardness given.

    Examples
    --------
    >>> Solid(young=210e9, poisson=0.3, yield_stress=500e6).hardness
    1400000000.0
    """

    young: float
    poisson: float
    yield_stress: float | None = None
    hardness: float | None = None

    def __post_init__(self) -> None:
        if not (isfinite(self.young) and self.young > 0):
            raise InputError("young", self.young, "a finite number > 0 [Pa]")
        if not -1 < self.poisson <= 0.5:
            raise InputError("poisson", self.poisson, "a number in (-1, 0.5]")
        if self.yield_stress is not None and self.hardness is not None:
            if self.hardness != HARDNESS_FACTOR * self.yield_stress:
                raise InputError("hardness", self.hardness, "yield_stress or hardness, not both")
        elif self.yield_stress is not None:
            if not (isfinite(self.yield_stress) and self.yield_stress > 0):
                raise InputError("yield_stress", self.yield_stress, "a finite number > 0 [Pa]")
            object.__setattr__(self, "hardness", HARDNESS_FACTOR * self.yield_stress)
        elif self.hardness is None:
            object.__setattr__(self, "hardness", inf)
        if self.hardness is None or not self.hardness > 0:
            raise InputError("hardness", self.hardness, "a number > 0 [Pa]")


def contact_modulus(a: Solid, b: Solid | None = None) -> float:
    """Contact modulus E* [Pa] of two half-spaces, 1/E* = (1−ν1²)/E1 + (1−ν2²)/E2.

    `b` None is a rigid counter-body. Lubrication texts use E′ = 2E*; here it is always E*.
    Source: Johnson, Contact Mechanics, 1985, eq. 4.20.

    >>> steel = Solid(210e9, 0.3)
    >>> round(contact_modulus(steel, steel) / 1e9, 2)
    115.38
    """
    compliance = (1 - a.poisson**2) / a.young
    if b is not None:
        compliance += (1 - b.poisson**2) / b.young
    return 1 / compliance
