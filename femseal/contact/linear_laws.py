"""Define contact laws whose curve H(u) is a straight line: linear hardening and perfect plasticity."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Flags, InputError, Shape, reals, to_text
from .law import ContactLaw, values_of_points
from .yield_line import YieldLine


@dataclass(frozen=True, eq=False)
class LinearHardening(ContactLaw):
    """Contact law of points that harden linearly with their plastic deformation: H(u) = H + h u.

    During unloading, a point keeps the yield pressure H + h u that it has reached. Reloading is elastic up to the
    earlier peak load, unless points have yielded again during unloading. At loads above the earlier peak load, the
    contact follows the curve of first loading.

    Parameters
    ----------
    hardness : float or array (n1, n2)
        Hardness H > 0 at which yield begins [Pa].
    slope : float or array (n1, n2)
        Hardening modulus h >= 0 [Pa/m]; 0 for perfect plasticity.

    Raises
    ------
    InputError
        A hardness is not positive, or a slope is negative or infinite.

    Examples
    --------
    >>> law = LinearHardening(4e9, 2e15)
    >>> float(law.yield_pressure(1e-6))
    6000000000.0
    >>> law.capacity
    inf
    """

    hardness: float | Array
    slope: float | Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "hardness", _checked_numbers("hardness", self.hardness, "Pa"))
        slope = _checked_numbers("slope", self.slope, "Pa/m", allow_zero=True)
        object.__setattr__(self, "slope", slope)

    @property
    def linear(self) -> bool:
        """Whether H(u) is a straight line, which is always the case for this law."""
        return True

    @property
    def is_uniform(self) -> bool:
        """Whether hardness and slope are single numbers, which apply to all points."""
        return isinstance(self.hardness, float) and isinstance(self.slope, float)

    def of_points(self, is_chosen: Flags) -> ContactLaw:
        """Return the law of the chosen points, see `ContactLaw.of_points`."""
        if self.is_uniform:
            return self
        hardness, slope = (
            values_of_points(values, is_chosen) for values in (self.hardness, self.slope)
        )
        return LinearHardening(hardness, slope)

    @property
    def capacity(self) -> float:
        """Largest mean pressure [Pa] that the points can carry; infinite if at least one point hardens."""
        # a uniform law need not create arrays
        return self._uniform_line.capacity if self.is_uniform else super().capacity

    def tangent(self, shape: Shape, deformation: ArrayLike = 0.0) -> YieldLine:
        """Return the line H + h u, which is its own tangent at any deformation."""
        return self._uniform_line if self.is_uniform else super().tangent(shape, 0.0)

    @cached_property
    def _uniform_line(self) -> YieldLine:
        """Line H + h u of a uniform law. The line is stored, so that hardness and slope are checked only once."""
        return super().tangent((1, 1))

    def yield_pressure(self, deformation: Any = 0.0) -> Any:
        """Compute H + h u [Pa]."""
        return self.hardness + self.slope * reals(deformation)

    def hardening_modulus(self, deformation: Any = 0.0) -> Any:
        """Return h [Pa/m], which does not depend on the deformation."""
        return self.slope

    def __str__(self) -> str:
        hardening = f"{float(np.mean(self.slope)) / 1e15:.4g} GPa/µm"
        return f"elastic-plastic with hardness {to_text(self.mean_hardness, 'Pa')} and hardening {hardening}"


@dataclass(frozen=True, eq=False)
class PerfectlyPlastic(LinearHardening):
    """Contact law of points whose pressure is limited by a constant hardness: H(u) = H.

    Parameters
    ----------
    hardness : float or array (n1, n2)
        Hardness H > 0 [Pa]; infinite for elastic points.

    Raises
    ------
    InputError
        A hardness is not positive.

    Examples
    --------
    >>> float(PerfectlyPlastic(4e9).yield_pressure(1e-6))
    4000000000.0
    """

    hardness: float | Array = inf
    slope: float | Array = field(default=0.0, init=False, repr=False)

    def __str__(self) -> str:
        if self.is_elastic:
            return "elastic"
        return f"elastic-perfectly plastic with hardness {to_text(self.mean_hardness, 'Pa')}"


def contact_law(hardness: float | ArrayLike | ContactLaw) -> ContactLaw:
    """Return a contact law unchanged, or make the perfectly plastic law for a hardness [Pa].

    hardness : a law, a number, or an array (n1, n2).
    """
    if isinstance(hardness, ContactLaw):
        return hardness
    if isinstance(hardness, float):
        return _law_of_number(hardness)
    return PerfectlyPlastic(hardness)  # type: ignore[arg-type]


@lru_cache(maxsize=64)
def _law_of_number(hardness: float) -> PerfectlyPlastic:
    """Make the perfectly plastic law for a single hardness [Pa]; repeated calls return the same law."""
    return PerfectlyPlastic(hardness)


def _checked_numbers(
    name: str, value: Any, unit: str, *, allow_zero: bool = False
) -> float | Array:
    """Return a value as a float or an array, and raise InputError if it contains numbers that are not allowed.

    By default, all numbers must be positive; infinity is allowed. With `allow_zero`, all numbers must be finite and not
    negative.
    """
    expected = f"a number or an array (n1, n2) [{unit}]"
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        array = reals(value)
    except (TypeError, ValueError):
        raise InputError(name, repr(value), expected) from None
    if allow_zero:
        is_allowed = (array >= 0) & np.isfinite(array)
        expected = f"finite numbers >= 0 [{unit}]"
    else:
        is_allowed = array > 0
        expected = f"numbers > 0 [{unit}]"
    if not np.all(is_allowed):
        given = f"{array.min():g} {unit}" if array.size else "no numbers"
        raise InputError(name, given, expected)
    return float(array.item()) if array.size == 1 else array
