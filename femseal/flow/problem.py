"""Problems of flow on grids and meshes: names of solvers, checks of the input, and the solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import frexp, ldexp

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Lengths, Pair, validate

SIDES = ("mirror", "periodic")
#: Solvers of the fast path, which know a grid of five points, and of the plain path, which take any sparse matrix.
FAST_SOLVERS = ("multigrid", "elimination")
PLAIN_SOLVERS = ("amg", "direct")
#: All solvers of a flow. "auto" takes the fast path where there is one, and the solver that is expected to be faster.
SOLVERS = ("auto", *FAST_SOLVERS, *PLAIN_SOLVERS)
#: Inlet and outlet flow may differ by this fraction before a direct or a precise solution is refused.
MAX_IMBALANCE = 1e-5
#: What to do about elements of the second order.
LINEAR = "with linear elements; mesh with elements of the first order, finer where sides are curved"
#: Error of the potential in the norm of the energy that is allowed where it is shown or written.
FIELD_RTOL = 1e-6
#: Largest gap [m], largest ratio of spacings and of two open gaps; the inverses are the smallest.
_LARGEST, _SLENDER, _CONTRAST = 1e60, 1e60, 1e50


def check_solver(solver: str, allowed: Sequence[str] = SOLVERS) -> None:
    """Raise InputError unless the solver is one of those that are allowed."""
    if solver not in allowed:
        raise InputError("solver", repr(solver), f"one of {', '.join(allowed)}")


def validated_gap(gap: ArrayLike, spacing: Lengths) -> tuple[Array, Pair]:
    """Gap as a new array (n1, n2) of finite numbers >= 0 and spacing as two numbers > 0, or an InputError.

    Numbers whose cubes or ratios double precision cannot bear are refused too.
    """
    h = validate.field("gap", gap, unit="m")
    lowest, largest = h.min(), h.max()
    if lowest < 0:
        raise InputError("gap", f"{lowest:g} m", "numbers >= 0 [m]")
    if largest > 0 and not 1 / _LARGEST <= largest <= _LARGEST:
        expected = f"one from {1 / _LARGEST:g} to {_LARGEST:g} m"
        raise InputError("gap", f"a largest gap of {largest:g} m", expected)
    if ((h > 0) & (h < largest / _CONTRAST)).any():
        given = f"{h[h > 0].min():g} m beside {largest:g} m"
        raise InputError("gap", given, f"0, or numbers >= {1 / _CONTRAST:g} of the largest")
    d1, d2 = validate.lengths("spacing", spacing)
    if not 1 / _SLENDER <= d1 / d2 <= _SLENDER:
        expected = f"two lengths whose ratio is from {1 / _SLENDER:g} to {_SLENDER:g}"
        raise InputError("spacing", (d1, d2), expected)
    return h, (d1, d2)


def validated_cell(gap: ArrayLike, spacing: Lengths, axis: int, sides: str) -> tuple[Array, Pair]:
    """Gap and spacing with the flow along the first axis, or an InputError that names what is wrong."""
    h, (d1, d2) = validated_gap(gap, spacing)
    axis = validate.axis_number(axis)
    if sides not in SIDES:
        raise InputError("sides", sides, f"one of {', '.join(SIDES)}")
    return (h, (d1, d2)) if axis == 0 else (np.ascontiguousarray(h.T), (d2, d1))


def unit_spacing(spacing: Pair) -> Pair:
    """Spacing over a power of two near the larger length: the flow depends on the ratio only, which keeps its digits.

    >>> unit_spacing((3e-6, 1.5e-6))
    (1.572864, 0.786432)
    """
    exponent = frexp(max(spacing))[1] - 1
    return ldexp(spacing[0], -exponent), ldexp(spacing[1], -exponent)


def potential_rtol(rtol: float, field_rtol: float | None = None) -> float:
    """Error allowed to the potential in the norm of the energy, of which the flow has the square."""
    return float(np.sqrt(rtol)) if field_rtol is None else min(float(np.sqrt(rtol)), field_rtol)


@dataclass(frozen=True)
class DarcyFlow:
    """Flow for a unit drop of potential; exactly 0 without an open path from inlet to outlet.

    conductance : equal to the energy that the potential dissipates, in the unit of the permeability, m³.
    potential : at the nodes; 1 or 0 where it is connected to one end only, NaN in pockets, connected to neither.
    complement : 1 − potential; elimination computes it with a relative accuracy of its own.
    iterations, residual : 0 for a direct solution; otherwise residual is the estimated error of the potential in the
        norm of the energy, whose square is that of the conductance.
    imbalance : relative difference of inlet and outlet flow.
    solver : that found the solution: "multigrid", "elimination", "amg" or "direct"; "none" if
        there was no unknown.
    lower, upper : bounds of the conductance, NaN if not computed.
    """

    conductance: float
    potential: Array = field(repr=False)
    complement: Array = field(repr=False)
    percolates: bool
    iterations: int = 0
    residual: float = 0.0
    imbalance: float = 0.0
    solver: str = "none"
    lower: float = np.nan
    upper: float = np.nan
