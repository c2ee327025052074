"""Definitions that flow problems on grids and on meshes share: solver names, checks of the input, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import frexp, inf, ldexp, prod

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Lengths, NotConverged, Pair, counted, shown, validate

SIDES = ("mirror", "periodic")
#: Fast solvers, which require a five-point stencil; and sparse solvers, which accept any sparse matrix.
FAST_SOLVERS = ("multigrid", "elimination")
SPARSE_SOLVERS = ("amg", "direct")
#: All flow solvers. "auto" prefers the fast solvers, and chooses the one that is expected to take less time, see
#: `femseal.flow.solvers`.
SOLVERS = ("auto", *FAST_SOLVERS, *SPARSE_SOLVERS)
#: Solvers of a flow on a mesh.
MESH_SOLVERS = ("auto", *SPARSE_SOLVERS)
#: Largest relative difference between inlet and outlet flow that is accepted from a direct or a precise solution.
MAX_IMBALANCE = 1e-5
#: Advice, in error messages, about second-order elements.
USE_LINEAR_ELEMENTS = (
    "with linear elements; mesh with elements of the first order, finer where sides are curved"
)
#: Relative error of the potential, in the energy norm, that is allowed if the potential is plotted or saved.
FIELD_RTOL = 1e-6
#: Largest gap [m], largest ratio Δ1/Δ2 of the pixel lengths, and largest ratio of two open gaps. The smallest gap and
#: the smallest ratios are the reciprocals of these numbers.
_LARGEST, _SLENDER, _CONTRAST = 1e60, 1e60, 1e50
#: Largest number of links between the nodes of a grid. The fast solvers number nodes and links by integers of 32 bits,
#: because integers of 64 bits would take more memory on all grids.
MOST_LINKS = 2**31 - 1


def check_solver(solver: str, allowed: Sequence[str] = SOLVERS) -> None:
    """Raise an InputError unless the solver is one of the allowed ones."""
    if solver not in allowed:
        raise InputError("solver", repr(solver), f"one of {', '.join(allowed)}")


def check_links(what: str, shape: Sequence[int], links: int) -> None:
    """Raise an InputError if a grid has too many links to be numbered.

    what : name of the array that is given.
    shape : shape of this array.
    links : number of links of the grid.
    """
    if links > MOST_LINKS:
        expected = f"a grid with at most {MOST_LINKS} links between its points; resample it"
        raise InputError(what, f"shape {tuple(shape)}", expected)


def validated_gap(gap: ArrayLike, spacing: Lengths) -> tuple[Array, Pair]:
    """Check a gap and a spacing; return the gap as a new array (n1, n2), and the spacing as two numbers.

    Raises
    ------
    InputError : the gap has negative or undefined values, the spacing is not > 0, the cubes or ratios of the numbers
        exceed the range of double precision, or the gap has too many points.
    """
    shape = getattr(gap, "shape", ())
    # two links for each point, and one more for each point at the outlet
    check_links("gap", shape, 2 * prod(shape) + max(shape, default=0))
    h = validate.field("gap", gap, unit="m")
    lowest, largest = h.min(), h.max()
    if lowest < 0:
        raise InputError("gap", f"{lowest:g} m", "numbers >= 0 [m]")
    if largest > 0 and not 1 / _LARGEST <= largest <= _LARGEST:
        expected = f"one from {1 / _LARGEST:g} to {_LARGEST:g} m"
        raise InputError("gap", f"a largest gap of {largest:g} m", expected)
    if ((h > 0) & (h < largest / _CONTRAST)).any():
        given = f"{h[h > 0].min():g} m beside {largest:g} m"
        raise InputError(
            "gap", given, f"0, or gaps of at least {1 / _CONTRAST:g} of the largest gap"
        )
    d1, d2 = validate.lengths("spacing", spacing)
    if not 1 / _SLENDER <= d1 / d2 <= _SLENDER:
        expected = f"two lengths whose ratio is from {1 / _SLENDER:g} to {_SLENDER:g}"
        raise InputError("spacing", (d1, d2), expected)
    return h, (d1, d2)


def validated_cell(gap: ArrayLike, spacing: Lengths, axis: int, sides: str) -> tuple[Array, Pair]:
    """Check the input of a cell, and transpose gap and spacing if the flow is along the second axis.

    Raises
    ------
    InputError : see `validated_gap`; or the axis or the kind of sides is unknown.
    """
    h, (d1, d2) = validated_gap(gap, spacing)
    axis = validate.axis_number(axis)
    if sides not in SIDES:
        raise InputError("sides", sides, f"one of {', '.join(SIDES)}")
    return (h, (d1, d2)) if axis == 0 else (np.ascontiguousarray(h.T), (d2, d1))


def checked_permeability(name: str, permeability: ArrayLike, *shapes: tuple[int, ...]) -> Array:
    """Check a permeability, and return it as an array.

    Parameters
    ----------
    name : name of the argument for the error message.
    permeability : a number, or an array whose shape is one of `shapes` [m³]. All values must be finite. Negative values
        are only allowed as components of tensors, that is, in arrays with three axes.

    Raises
    ------
    InputError : the permeability has another shape, or an undefined or negative value.
    """
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


def unit_spacing(spacing: Pair) -> Pair:
    """Divide the two lengths of a pixel by a power of two, so that the larger length is in the range from 1 to 2.

    The flow depends only on the ratio Δ1/Δ2 of the pixel lengths. A division by a power of two causes no rounding
    error, so that the ratio Δ1/Δ2 does not change at all.

    >>> unit_spacing((3e-6, 1.5e-6))
    (1.572864, 0.786432)
    """
    exponent = frexp(max(spacing))[1] - 1
    return ldexp(spacing[0], -exponent), ldexp(spacing[1], -exponent)


def potential_rtol(rtol: float, field_rtol: float | None = None) -> float:
    """Compute the relative error of the potential, in the energy norm, that leads to the error `rtol` of the flow.

    The error of the flow is the square of the error of the potential. A smaller `field_rtol` takes precedence.
    """
    allowed = float(np.sqrt(rtol))
    return allowed if field_rtol is None else min(allowed, field_rtol)


def checked_imbalance(
    inflow: float,
    outflow: float,
    energy: float | None,
    *,
    scale: float,
    allowed: float,
    flow: str = "flow",
    advice: str = "",
) -> float:
    """Compute the relative imbalance of a flow, which is caused by the errors of the solver and of rounding.

    For a unit potential drop, the inflow, the outflow and the dissipated energy of an exact solution are equal. The
    imbalance is the larger of |inflow − outflow| and |inflow − energy|, divided by a flow rate.

    Parameters
    ----------
    inflow, outflow, energy : flow rates at inlet and outlet, and dissipated energy for a unit potential drop; None if
        the energy is not known.
    scale : flow rate by which the differences are divided. If it is not positive, the imbalance is infinite.
    allowed : largest imbalance that is accepted.
    flow, advice : which flow has been computed, and what the user should try, for the error message.

    Raises
    ------
    NotConverged : the imbalance is larger than `allowed`, or is not a number.
    """
    imbalance = inf
    if scale > 0:
        others = [outflow] if energy is None else [outflow, energy]
        imbalance = float(max(abs(inflow - other) for other in others) / scale)
    if not imbalance <= allowed:
        raise NotConverged(
            f"{flow}: the flow rates at inlet and outlet differ by {imbalance:.1e}, expected {allowed:.0e}"
            + (f"; {advice}" if advice else ""),
            imbalance,
        )
    return imbalance


@dataclass(frozen=True)
class DarcyFlow:
    """Flow through a grid or a mesh for a unit potential drop; exactly 0 without an open path from inlet to outlet.

    Attributes
    ----------
    conductance : flow rate for the unit potential drop, in the unit of the permeability (m³). The conductance is equal
        to the energy that the flow dissipates.
    potential : array with the potential at the nodes of the grid or the mesh. The potential is 1 at nodes that are only
        connected to the inlet, 0 at nodes that are only connected to the outlet, and NaN in pockets, which are
        connected to neither.
    complement : 1 − potential. The solver "elimination" computes the complement separately, so that even a very small
        complement has a small relative error.
    percolates : whether an open path connects inlet and outlet.
    iterations : number of iterations; 0 for a direct solution.
    residual : relative error of the potential in the energy norm: an upper bound for the solver "multigrid", an
        estimate for "amg", and 0 for "elimination". The relative error of the conductance is `residual` squared. For
        "direct", `residual` is ‖b − Ax‖/‖b‖ of the scaled linear system Ax = b.
    imbalance : relative difference between inlet and outlet flow.
    solver : name of the solver that was used: "multigrid", "elimination", "amg" or "direct"; "none" if there was no
        unknown.
    lower, upper : bounds of the conductance, NaN if they were not computed.
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
