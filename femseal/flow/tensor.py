"""Permeability tensor of a doubly periodic cell."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ..base import Array, Indices, Lengths, NotConverged
from .grid import Stencil, gap_on_links, link_weights
from .law import CUBIC_LAW, FlowLaw, cubic_law, gap_by_law
from .problem import (
    MAX_IMBALANCE,
    PLAIN_SOLVERS,
    check_solver,
    unit_spacing,
    validated_gap,
)
from .solvers.sparse import solve_sparse

#: Relative error of the energy of the correction that is allowed to a solver; of what the first solution left over.
_RTOLS = 1e-9, 1e-2


def permeability_tensor(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    solver: str = "auto",
    law: FlowLaw = CUBIC_LAW,
    pressure: ArrayLike | None = None,
) -> Array:
    """Permeability tensor (2, 2) [m³] of a doubly periodic cell: mean flux −K∇p for a mean pressure gradient.

    K_ab = (1/|Ω|) ∫ h³/12 (e_a + ∇χ_a)·(e_b + ∇χ_b), χ periodic; symmetric, and exactly 0 along an axis around which
    no open path winds. It differs from `cell_permeability`, where the pressure is constant along inlet and outlet.

    Parameters
    ----------
    gap : h (n1, n2) [m].
    spacing : pixel (Δ1, Δ2) [m].
    solver : of the linear system, "amg" (pyamg), "direct" (a factorisation), or "auto", whichever is expected to be
        faster.
    law, pressure : as in `cell_permeability`.

    Raises
    ------
    InputError : a gap that is negative, undefined or not two-dimensional; another solver.
    NotConverged : the solution lost too many digits, as it may where gaps beside each other differ by 1e4 and more.

    Examples
    --------
    >>> gap = np.repeat([[1e-6], [2e-6]], 8, axis=0) * np.ones(16)  # grooves along x2
    >>> k = permeability_tensor(gap, (1e-6, 1e-6))
    >>> bool(k[1, 1] > k[0, 0]), k.shape
    (True, (2, 2))
    """
    h, (d1, d2) = validated_gap(gap, spacing)
    h = gap_by_law(h, law, pressure)
    check_solver(solver, ("auto", *PLAIN_SOLVERS))
    n1, n2 = h.shape
    scale = float(h.max()) or 1.0
    d1, d2 = unit_spacing((d1, d2))
    k1, k2 = map(cubic_law, gap_on_links(h / scale, True, True))
    label, winds = _winding_components(k1, k2)
    winds = winds[label].reshape(n1, n2, 2)
    carrying = winds.any(axis=2)
    if not carrying.any():
        return np.zeros((2, 2))
    k1, k2 = (np.where(carrying, k, 0.0) for k in (k1, k2))
    weights = link_weights((d1, d2))
    stencil = Stencil(weights.along * k1, weights.across * k2, ring1=True)
    closed = ~winds.any(axis=(0, 1))
    tensor, error = _solved(stencil, (d1, d2), label, carrying, closed, solver)
    if not error <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: energy and mean flux of the cell differ by {error:.1e}; the contrast is too high",
            error,
        )
    return scale**3 * tensor / (n1 * d1 * n2 * d2)


def _solved(
    stencil: Stencil,
    spacing: tuple[float, float],
    label: NDArray[np.int64],
    carrying: NDArray[np.bool_],
    closed: NDArray[np.bool_],
    solver: str,
) -> tuple[Array, float]:
    """Energy of unit mean gradients by a sparse solution, and its relative error.

    That is the difference from the mean flux, or what a second solution changes.
    """
    size, (d1, d2) = carrying.size, spacing
    # the mean gradient drops the pressure along every link; the correction is periodic
    parts = [(c.ravel(), a.ravel(), b.ravel(), np.full((c.size, 2), (s1 * d1, s2 * d2)))
             for c, a, b, (s1, s2) in stencil.conductances()]  # fmt: skip
    c, start, end, mean_drop = (np.concatenate(part) for part in zip(*parts, strict=True))
    # one node of each component is given; the others are unknown
    roots = np.zeros(size, bool)
    roots[np.unique(label, return_index=True)[1]] = True
    unknown = np.flatnonzero(carrying.ravel() & ~roots)
    matrix = stencil.to_csr()[unknown][:, unknown]
    drop, correction = mean_drop, np.zeros((size, 2))
    error, before = np.inf, np.full((2, 2), np.nan)
    for rtol in _RTOLS:
        outflow = c[:, None] * drop
        load = [np.bincount(start, q, size) - np.bincount(end, q, size) for q in outflow.T]
        if unknown.size:
            rest = np.stack(load, axis=1)[unknown]
            correction[unknown] += solve_sparse(
                matrix, rest, rtol, solver, largest_residual=max(rtol, 1e-8)
            ).x
        drop = mean_drop + correction[end] - correction[start]
        tensor = drop.T @ (c[:, None] * drop)
        flux = mean_drop.T @ (c[:, None] * drop)
        tensor = (tensor + tensor.T) / 2  # products of matrices round both halves apart
        for a in (tensor, flux):
            a[closed, :] = 0.0
            a[:, closed] = 0.0
        largest = np.sqrt(np.outer(tensor.diagonal(), tensor.diagonal()))
        # the energy errs by the square of the error of the pressure, and the flux by that error
        off = np.fmin(np.abs(tensor - flux), np.abs(tensor - before))
        error = float((off / np.where(largest > 0, largest, 1.0)).max())
        before = tensor
        if error <= MAX_IMBALANCE:
            break
    return before, error


def _winding_components(c1: Array, c2: Array) -> tuple[Indices, Any]:
    """Doubly periodic network: component of each node, and which components wind around each axis.

    c1, c2 (n1, n2) link node (i, j) to (i + 1, j) and (i, j + 1), wrapped. Each node gets its displacement from the
    root of a tree of its component, so that a link that is not in the tree shows how often its loop winds.
    """
    n = c1.size
    node = np.arange(n).reshape(c1.shape)
    parts = []
    for axis, c in enumerate((c1, c2)):
        at_seam = np.indices(c.shape)[axis] == c.shape[axis] - 1
        passes = np.zeros((*c.shape, 2), np.int64)
        passes[at_seam, axis] = 1
        parts.append((node[c > 0], np.roll(node, -1, axis)[c > 0], passes[c > 0]))
    # the nodes of each link, and how often it passes the seam of both axes
    start, end, seams = (np.concatenate(part) for part in zip(*parts, strict=True))
    graph = sp.coo_array((np.ones(start.size), (start, end)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    roots = np.unique(label, return_index=True)[1]
    # node n is joined to one node of each component, so that one search finds trees of all
    i = np.concatenate([start, np.full(count, n)])
    j = np.concatenate([end, roots])
    joined = sp.coo_array((np.ones(i.size), (i, j)), shape=(n + 1, n + 1)).tocsr()
    _, parent = breadth_first_order(joined, n, directed=False)
    parent[n] = n
    turns = np.zeros((n + 1, 2), np.int64)
    for a, b, sign in ((start, end, 1), (end, start, -1)):
        in_tree = parent[b] == a
        turns[b[in_tree]] = sign * seams[in_tree]
    while (parent != n).any():  # twice as far up each time
        turns += turns[parent]
        parent = parent[parent]
    winds = np.zeros((count, 2), bool)
    around = turns[start] + seams != turns[end]
    np.logical_or.at(winds, label[start], around)
    return label, winds
