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

#: Relative tolerances, in the energy norm, of the first solution for the correction and of a second one that solves for
#: what the first one has left.
_RTOLS = 1e-9, 1e-2


def permeability_tensor(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    solver: str = "auto",
    law: FlowLaw = CUBIC_LAW,
    pressure: ArrayLike | None = None,
) -> Array:
    """Compute the permeability tensor of a doubly periodic cell.

    The tensor K gives the mean flux −K∇p for a mean pressure gradient ∇p. It follows from the periodic corrections χ_a
    of the pressure: K_ab = (1/|Ω|) ∫ h³/12 (e_a + ∇χ_a)·(e_b + ∇χ_b). It is symmetric, and exactly 0 along an axis
    along which no open path crosses the periodic cell. It differs from the result of `cell_permeability`, for which the
    pressure is constant along inlet and outlet.

    Parameters
    ----------
    gap : array (n1, n2), gap h >= 0 [m].
    spacing : lengths (Δ1, Δ2) of a pixel [m].
    solver : solver of the linear system, "amg" (pyamg), "direct" (factorisation), or "auto" for the solver that is
        expected to be faster.
    law, pressure : as in `cell_permeability`.

    Returns
    -------
    Array (2, 2), permeability tensor [m³].

    Raises
    ------
    InputError : the gap is negative, undefined or not two-dimensional, or the solver is unknown.
    NotConverged : rounding errors are too large. This may happen if adjacent gaps differ by a factor of 1e4 or more.

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
    closed = ~winds.any(axis=(0, 1))  # axes that no open path crosses
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
    """Solve for the periodic corrections, and compute the energies (2, 2) of unit mean gradients.

    The relative error is also returned. It is the difference between energy and mean flux, or between two successive
    solutions, whichever is smaller.

    label : component of each node, (nodes,).
    carrying : flags (n1, n2) of the nodes that carry flow.
    closed : flags (2,) of the axes without a flow.
    """
    size = carrying.size
    d1, d2 = spacing
    # for each link: conductance, both nodes, and the pressure drop due to unit mean gradients along both axes
    parts = [(c.ravel(), a.ravel(), b.ravel(), np.full((c.size, 2), (s1 * d1, s2 * d2)))
             for c, a, b, (s1, s2) in stencil.conductances()]  # fmt: skip
    c, start, end, mean_drop = (np.concatenate(part) for part in zip(*parts, strict=True))
    # the correction is defined up to a constant in each component, and is set to 0 at one node of each
    roots = np.zeros(size, bool)
    roots[np.unique(label, return_index=True)[1]] = True
    unknown = np.flatnonzero(carrying.ravel() & ~roots)
    matrix = stencil.to_csr()[unknown][:, unknown]
    drop = mean_drop
    correction = np.zeros((size, 2))
    error = np.inf
    before = np.full((2, 2), np.nan)  # energies of the previous solution
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
        tensor = (tensor + tensor.T) / 2  # a matrix product is not exactly symmetric after rounding
        for a in (tensor, flux):
            a[closed, :] = 0.0
            a[:, closed] = 0.0
        largest = np.sqrt(np.outer(tensor.diagonal(), tensor.diagonal()))
        # the flux has the relative error of the pressure, the energy only the square of it
        deviation = np.fmin(np.abs(tensor - flux), np.abs(tensor - before))
        error = float((deviation / np.where(largest > 0, largest, 1.0)).max())
        before = tensor
        if error <= MAX_IMBALANCE:
            break
    return before, error


def _winding_components(c1: Array, c2: Array) -> tuple[Indices, Any]:
    """Find the connected components of a doubly periodic network, and the axes along which each of them percolates.

    A component percolates along an axis if it contains a closed loop that crosses the periodic boundary of this axis.
    A spanning tree of the component gives, for each node, how often its path to the root crosses both boundaries. A
    link closes such a loop if these numbers do not match at its two nodes.

    c1, c2 : arrays (n1, n2), conductances from node (i, j) to the nodes (i + 1, j) and (i, j + 1), periodic.

    Returns
    -------
    Component of each node (nodes,), and flags (components, 2) of the axes along which the components percolate.
    """
    n = c1.size
    node = np.arange(n).reshape(c1.shape)
    parts = []
    for axis, c in enumerate((c1, c2)):
        at_seam = np.indices(c.shape)[axis] == c.shape[axis] - 1
        passes = np.zeros((*c.shape, 2), np.int64)
        passes[at_seam, axis] = 1
        parts.append((node[c > 0], np.roll(node, -1, axis)[c > 0], passes[c > 0]))
    # both nodes of each link, and how often it crosses the periodic boundaries of both axes (link, axis)
    start, end, seams = (np.concatenate(part) for part in zip(*parts, strict=True))
    graph = sp.coo_array((np.ones(start.size), (start, end)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    roots = np.unique(label, return_index=True)[1]
    # an additional node n is linked to one node of each component, so that one search finds the trees of all
    i = np.concatenate([start, np.full(count, n)])
    j = np.concatenate([end, roots])
    joined = sp.coo_array((np.ones(i.size), (i, j)), shape=(n + 1, n + 1)).tocsr()
    _, parent = breadth_first_order(joined, n, directed=False)
    parent[n] = n
    turns = np.zeros((n + 1, 2), np.int64)
    for a, b, sign in ((start, end, 1), (end, start, -1)):
        in_tree = parent[b] == a
        turns[b[in_tree]] = sign * seams[in_tree]
    while (
        parent != n
    ).any():  # add up the crossings towards the root; each step doubles the length of the path
        turns += turns[parent]
        parent = parent[parent]
    winds = np.zeros((count, 2), bool)
    around = turns[start] + seams != turns[end]
    np.logical_or.at(winds, label[start], around)
    return label, winds
