"""Permeability of a cell from its gap: ∇·(h³ ∇p) = 0, k = h³/12 for parallel plates.

Unknowns are the pressures at pixel centres. The conductance of the link between two pixels takes h, not h³,
interpolated by a four-point cubic at its midpoint; the links from the inlet edge to the first pixels and from the
last to the outlet edge have half the length. Order 2 in the pixel for smooth gaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..base import validate
from ..base.errors import InputError, NotConverged
from ..base.text import Shown
from .bounds import pixel_bounds
from .conductance import conductances_between, validated_cell, validated_gap
from .connectivity import winding_components
from .network import MAX_IMBALANCE, solve_network
from .solvers.amg import solve_spd

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Permeability(Shown):
    """Permeability of a cell along one axis, k with Q/L2 = (k/η) Δp/L1; exactly 0 where the gap does not percolate.

    lower, upper, resampling_error : NaN unless asked for.
    percolating_share : pixels that both ends reach, in shares of all.
    iterations, residual : of the linear solver, see `NetworkFlow`.
    fluid_pressure : (n1, n2), NaN at pixels in contact and in pockets that neither end reaches.
    """

    value: float = field(metadata={"unit": "m^3", "long_name": "permeability"})
    lower: float = field(metadata={"unit": "m^3", "long_name": "lower bound of the permeability"})
    upper: float = field(metadata={"unit": "m^3", "long_name": "upper bound of the permeability"})
    resampling_error: float = field(metadata={"unit": "1", "long_name": "estimated relative error of the resolution"})
    percolates: bool
    percolating_share: float
    iterations: int
    residual: float
    fluid_pressure: Array = field(metadata={"unit": "1", "long_name": "fluid pressure for a unit drop"}, repr=False)


def cell_permeability(
    gap: ArrayLike,
    spacing: tuple[float, float],
    *,
    axis: int = 0,
    sides: str = "mirror",
    bounds: bool = False,
    estimate: bool = False,
    rtol: float = 1e-6,
) -> Permeability:
    """Permeability [m³] of a cell whose gap h >= 0 is given at pixel centres; h = 0 is contact.

    Parameters
    ----------
    gap : h (n1, n2) [m].
    spacing : pixel (Δ1, Δ2) [m].
    axis : direction of the flow.
    sides : "mirror" (closed sides: the same as an even extension) or "periodic".
    bounds : also certify, for the gap taken constant on each pixel, lower <= k <= upper; otherwise both are NaN.
        The bounds enclose the flow through those pixels, not the resampling of the surface, so that `value`, which
        interpolates the gap between pixels, may lie outside where the gap is poorly resolved.
    estimate : also estimate how far the pixels resolve the gap: a third of the largest difference to the four values on
        every second pixel, as for order 2. It was 4 to 16 times the true error of gaps cut by a plane, with 8 pixels
        per shortest wave and up to 0.4 in contact; inf where some of these are closed and others not.
    rtol : relative error of k allowed to an iterative linear solver.

    Raises
    ------
    InputError : a gap that is negative, undefined or not two-dimensional; an unknown side or axis.
    NotConverged : the linear solver failed.
    """
    h, (d1, d2) = validated_cell(gap, spacing, axis, sides)
    validate.tolerance("rtol", rtol)
    scale = float(h.max()) or 1.0
    h = h / scale
    c1, c2 = link_conductances(h, (d1, d2), sides)
    flow = solve_network(c1, c2, rtol=rtol)
    n1, n2 = h.shape
    shape_factor = scale**3 * (n1 * d1) / (n2 * d2)
    lower, upper = np.nan, np.nan
    if bounds:
        lower, upper = (shape_factor * b for b in pixel_bounds(h, (d1, d2), sides))
    pressure = flow.potential[1:-1]
    return Permeability(
        value=shape_factor * flow.rate,
        lower=lower,
        upper=upper,
        resampling_error=_resampling_error(h, (d1, d2), sides, flow.rate, rtol) if estimate else np.nan,
        percolates=flow.percolates,
        percolating_share=float(np.isfinite(pressure).mean()) if flow.percolates else 0.0,
        iterations=flow.iterations,
        residual=flow.residual,
        fluid_pressure=pressure.T if axis == 1 else pressure,
    )


def cell_permeabilities(
    gaps: ArrayLike,
    spacing: tuple[float, float],
    *,
    axes: Sequence[int] = (0, 1),
    sides: str = "mirror",
    rtol: float = 1e-6,
    threads: int = 1,
) -> Array:
    """Permeabilities [m³] of many gaps, such as those of a load cycle, along one axis or both.

    Parameters
    ----------
    gaps : (n, n1, n2) [m].
    axes : directions of the flow.
    spacing, sides, rtol : as in `cell_permeability`.
    threads : gaps solved at the same time.

    Returns
    -------
    (n, number of axes), in the order of `axes`.

    Raises
    ------
    InputError, NotConverged : as `cell_permeability`; the input of all gaps is checked first.
    """
    try:
        stack = np.asarray(gaps, dtype=float)
    except (TypeError, ValueError):
        raise InputError.of("gaps", f"a {type(gaps).__name__}", "an array (n, n1, n2) of real numbers [m]") from None
    if stack.ndim != 3:
        raise InputError.of("gaps", f"shape {stack.shape}", "a shape (n, n1, n2)")
    threads = validate.count("threads", threads)
    if not np.iterable(axes):
        raise InputError.of("axes", repr(axes), "a list of 0 (x1) and 1 (x2)")
    axes = [validate.axis_number(axis) for axis in axes]
    for gap in stack:
        validated_cell(gap, spacing, 0, sides)
    validate.tolerance("rtol", rtol)
    cells = [(gap, axis) for gap in stack for axis in axes]

    def value(cell: tuple[Array, int]) -> float:
        return cell_permeability(cell[0], spacing, axis=cell[1], sides=sides, rtol=rtol).value

    with ThreadPoolExecutor(threads) as pool:
        values = list(pool.map(value, cells) if threads > 1 else map(value, cells))
    return np.array(values, dtype=float).reshape(len(stack), len(axes))


def link_conductances(gap: Array, spacing: tuple[float, float], sides: str) -> tuple[Array, Array]:
    """Conductances k Δ⊥/Δ∥ of the links of a cell: c1 (n1 + 1, n2) with the half links at both ends, and c2.

    c2 is (n1, n2) with periodic sides and (n1, n2 − 1) with closed ones. The gap continues evenly past the ends.
    """
    d1, d2 = spacing
    c1, c2 = conductances_between(gap, d2 / d1, d1 / d2, False, sides == "periodic")
    c1[0] *= 2
    c1[-1] *= 2
    return c1, c2


def _resampling_error(h: Array, spacing: tuple[float, float], sides: str, rate: float, rtol: float) -> float:
    """Estimated relative error of `rate`, from the four ways to take every second pixel along both axes."""
    if min(h.shape) < 4:
        return np.nan
    rates = [solve_network(*_coarse_links(h, spacing, sides, o), rtol=rtol).rate for o in np.ndindex(2, 2)]
    if rate == 0 or min(rates) == 0:
        return np.inf if max(rate, *rates) > 0 else 0.0
    return max(abs(rate - r) for r in rates) / (3 * rate)


def _coarse_links(h: Array, spacing: tuple[float, float], sides: str, offset: tuple[int, ...]) -> tuple[Array, Array]:
    """`link_conductances` of every second pixel from an offset on; the cell's borders are where they were."""
    c1, c2 = link_conductances(h[offset[0] :: 2, offset[1] :: 2], (2 * spacing[0], 2 * spacing[1]), sides)
    before, after = _to_the_borders(h.shape[0], offset[0])
    c1[0] /= 2 * before
    c1[-1] /= 2 * after
    width1 = np.ones((c2.shape[0], 1))
    width1[0] += before - 0.5
    width1[-1] += after - 0.5
    before, after = _to_the_borders(h.shape[1], offset[1])
    width2 = np.ones(c1.shape[1])
    if sides == "periodic":
        c2[:, -1] /= before + after
        before = after = (before + after) / 2
    width2[0] += before - 0.5
    width2[-1] += after - 0.5
    return c1 * width2, c2 * width1


def _to_the_borders(n: int, offset: int) -> tuple[float, float]:
    """Distance of the first and the last of every second of n pixels to the borders, in spacings of two pixels."""
    last = offset + 2 * ((n - 1 - offset) // 2)
    return (offset + 0.5) / 2, (n - last - 0.5) / 2


def permeability_tensor(gap: ArrayLike, spacing: tuple[float, float]) -> Array:
    """Permeability tensor (2, 2) [m³] of a doubly periodic cell: mean flux −K∇p for a mean pressure gradient.

    K_ab = (1/|Ω|) ∫ h³/12 (e_a + ∇χ_a)·(e_b + ∇χ_b), χ periodic; symmetric, and exactly 0 along an axis around which
    no open path winds. It is another quantity than `cell_permeability`, whose inlet and outlet are straight.

    Raises
    ------
    InputError : a gap that is negative, undefined or not two-dimensional.
    NotConverged : the solution lost too many digits, as it may at contrasts of the gap above 1e4.
    """
    h, (d1, d2) = validated_gap(gap, spacing)
    n1, n2 = h.shape
    scale = float(h.max()) or 1.0
    h = h / scale
    c1, c2 = conductances_between(h, d2 / d1, d1 / d2, True, True)
    label, winds = winding_components(c1, c2)
    winds = winds[label].reshape(n1, n2, 2)
    carrying = winds.any(axis=2)
    if not carrying.any():
        return np.zeros((2, 2))
    c1, c2 = np.where(carrying, c1, 0.0), np.where(carrying, c2, 0.0)
    node = np.arange(n1 * n2).reshape(n1, n2)
    start = np.concatenate([node.ravel(), node.ravel()])
    end = np.concatenate([np.roll(node, -1, axis=0).ravel(), np.roll(node, -1, axis=1).ravel()])
    c = np.concatenate([c1.ravel(), c2.ravel()])
    links = np.arange(c.size)
    gradient = sp.csr_array(
        (np.r_[np.ones(c.size), -np.ones(c.size)], (np.r_[links, links], np.r_[end, start])), shape=(c.size, node.size)
    )
    mean_drop = np.zeros((c.size, 2))
    mean_drop[: n1 * n2, 0], mean_drop[n1 * n2 :, 1] = d1, d2
    # one node of each component is held; the others are unknown
    roots = np.zeros(node.size, bool)
    roots[np.unique(label)] = True
    unknown = np.flatnonzero(carrying.ravel() & ~roots)
    correction = np.zeros((node.size, 2))
    if unknown.size:
        g = gradient[:, unknown]
        matrix = (g.T @ sp.diags_array(c) @ g).tocsc()
        correction[unknown] = solve_spd(matrix, -(g.T @ (c[:, None] * mean_drop)), 1e-12).x
    drop = mean_drop + gradient @ correction
    tensor, flux = drop.T @ (c[:, None] * drop), mean_drop.T @ (c[:, None] * drop)
    closed = ~winds.any(axis=(0, 1))
    for a in (tensor, flux):
        a[closed, :] = 0.0
        a[:, closed] = 0.0
    largest = np.sqrt(np.outer(tensor.diagonal(), tensor.diagonal()))
    error = float((np.abs(tensor - flux) / np.where(largest > 0, largest, 1.0)).max())
    if not error <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: energy and mean flux of the cell differ by {error:.1e}; the contrast is too high", error
        )
    return scale**3 * tensor / (n1 * d1 * n2 * d2)
