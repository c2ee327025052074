"""Compute the permeability tensor of a doubly periodic cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ..base import Array, Flags, Indices, Lengths, NotConverged, Shape
from .grid import gap_on_links, link_weights, network_matrix
from .law import CUBIC_LAW, FlowLaw, checked_equivalent_gap, cubic_law
from .problem import (
    MAX_IMBALANCE,
    MESH_SOLVERS,
    check_solver,
    unit_spacing,
    validated_gap,
)
from .solvers.sparse import solve_spd

#: Relative tolerances in the energy norm: of the first solution for the corrections, and of a second solution for the
#: residual that the first solution has left.
_RTOLS = 1e-9, 1e-2


class _Components(NamedTuple):
    """Connected components of a doubly periodic network.

    label : array (nodes,), number of the connected component of each node.
    percolates : flags (components, 2), whether a component percolates along each axis.
    """

    label: Indices
    percolates: Flags


class _PeriodicLinks(NamedTuple):
    """Links of a doubly periodic network: first all links along x1, then all links along x2.

    start, end : arrays (links,), number of the first node and number of the second node of each link.
    axis : array (links,), axis of each link.
    crosses : flags (links,), whether each link crosses the periodic boundary of its axis.
    """

    start: Indices
    end: Indices
    axis: Indices
    crosses: Flags

    @classmethod
    def of_grid(cls, shape: Shape) -> _PeriodicLinks:
        """List the links of a grid of nodes, in which each node is linked to the next node along both axes."""
        node = np.arange(np.prod(shape)).reshape(shape)
        row, column = np.indices(shape)
        return cls(
            start=np.tile(node.ravel(), 2),
            end=np.concatenate([np.roll(node, -1, axis).ravel() for axis in (0, 1)]),
            axis=np.repeat([0, 1], node.size),
            crosses=np.concatenate([row == shape[0] - 1, column == shape[1] - 1]).ravel(),
        )

    def along_axes(self, values: ArrayLike) -> Array:
        """Return an array (links, 2) with the value of each link in the column of its axis, and 0 in the other one."""
        return np.where(self.axis[:, None] == [0, 1], np.reshape(values, (-1, 1)), 0.0)


def permeability_tensor(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    solver: str = "auto",
    law: FlowLaw = CUBIC_LAW,
    pressure: ArrayLike | None = None,
) -> Array:
    """Compute the permeability tensor of a doubly periodic cell.

    The tensor K gives the mean flux −K∇p for a mean pressure gradient ∇p. The components of K are K_ab = (1/|Ω|) ∫
    h³/12 (e_a + ∇χ_a)·(e_b + ∇χ_b), where |Ω| is the area of the cell, e_a the unit vector along axis a, and χ_a the
    periodic correction of the pressure for a mean gradient e_a. The tensor K is symmetric. If no open path crosses the
    periodic cell along an axis, all components of K for this axis are exactly 0. K differs from the result of
    `cell_permeability`, which is computed for a constant pressure along the inlet and along the outlet.

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
    NotConverged : rounding errors are too large, which may happen if adjacent gaps differ by a factor of 1e4 or more.

    Examples
    --------
    >>> gap = np.repeat([[1e-6], [2e-6]], 8, axis=0) * np.ones(16)  # grooves along x2
    >>> k = permeability_tensor(gap, (1e-6, 1e-6))
    >>> bool(k[1, 1] > k[0, 0]), k.shape
    (True, (2, 2))
    """
    h, (d1, d2) = validated_gap(gap, spacing)
    h = checked_equivalent_gap(h, law, pressure)
    check_solver(solver, MESH_SOLVERS)
    n1, n2 = h.shape
    scale = float(h.max()) or 1.0
    d1, d2 = unit_spacing((d1, d2))
    k1, k2 = map(cubic_law, gap_on_links(h / scale, True, True))
    links = _PeriodicLinks.of_grid((n1, n2))
    is_open = np.concatenate([k1.ravel(), k2.ravel()]) > 0
    label, component_percolates = _percolating_components(links, is_open, h.size)
    percolates = component_percolates[label]  # (node, axis)
    carries_flow: Flags = np.any(percolates, axis=1)
    if not carries_flow.any():
        return np.zeros((2, 2))
    weights = link_weights((d1, d2))
    conductance = np.where(
        carries_flow, [weights.along * k1.ravel(), weights.across * k2.ravel()], 0.0
    ).ravel()
    # axes along which no open path crosses the cell
    closed: Flags = ~np.any(percolates, axis=0)
    # pressure drop over each link due to unit mean gradients along both axes, (link, axis)
    mean_drop = links.along_axes(np.take((d1, d2), links.axis))
    # the correction is defined up to a constant in each component, and is set to 0 at one node of each
    is_unknown = carries_flow.copy()
    is_unknown[_first_nodes(label)] = False
    tensor, error = _solve_corrections(links, conductance, mean_drop, is_unknown, closed, solver)
    if not error <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: energy and mean flux of the cell differ by {error:.1e}; the contrast is too high",
            error,
        )
    return scale**3 * tensor / (n1 * d1 * n2 * d2)


def _solve_corrections(
    links: _PeriodicLinks,
    conductance: Array,
    mean_drop: Array,
    is_unknown: Flags,
    closed: Flags,
    solver: str,
) -> tuple[Array, float]:
    """Solve for the periodic corrections χ of the pressure due to unit mean gradients along the two axes.

    The pressure drop over a link is the drop of the mean gradient plus χ(end) − χ(start). The corrections χ are chosen
    so that the flows c · drop through the links at each node add up to 0.

    Parameters
    ----------
    links : links of the network.
    conductance : array (links,), conductance of each link.
    mean_drop : array (links, 2), pressure drop over each link due to unit mean gradients along the two axes.
    is_unknown : flags (nodes,) of the nodes at which χ is computed; at all other nodes χ is 0.
    closed : flags (2,) of the axes along which nothing flows.
    solver : name of the linear solver.

    Returns
    -------
    Array (2, 2) with the energies of the unit mean gradients, and relative error of the energies. The error is
    estimated in two ways, and the smaller estimate is returned: the difference between the energy and the mean flux,
    and the difference between the energies of two successive solutions.
    """
    size = is_unknown.size
    start, end = links.start, links.end
    c = conductance[:, None]  # (link, 1)
    unknown = np.flatnonzero(is_unknown)
    matrix = network_matrix(conductance, start, end, size)[unknown][:, unknown]
    drop = mean_drop
    correction = np.zeros((size, 2))  # (node, axis of the mean gradient)
    error = np.inf
    previous = np.full((2, 2), np.nan)  # energies of the previous solution
    for rtol in _RTOLS:
        # sum of the flows out of each node, for each axis of the mean gradient
        net_outflow = [
            np.bincount(start, flow, size) - np.bincount(end, flow, size) for flow in (c * drop).T
        ]
        if unknown.size:
            residual = np.stack(net_outflow, axis=1)[unknown]
            correction[unknown] += solve_spd(
                matrix, residual, rtol, solver, largest_residual=max(rtol, 1e-8)
            ).x
        drop = mean_drop + correction[end] - correction[start]
        energy = drop.T @ (c * drop)
        mean_flux = mean_drop.T @ (c * drop)
        energy = (energy + energy.T) / 2  # a matrix product is not exactly symmetric after rounding
        for tensor in (energy, mean_flux):
            tensor[closed, :] = 0.0
            tensor[:, closed] = 0.0
        largest = np.sqrt(np.outer(energy.diagonal(), energy.diagonal()))
        # the mean flux has the relative error of the pressure, and the energy the square of this error
        from_mean_flux = np.abs(energy - mean_flux)
        from_previous = np.abs(energy - previous)
        deviation = np.fmin(from_mean_flux, from_previous)
        error = float((deviation / np.where(largest > 0, largest, 1.0)).max())
        previous = energy
        if error <= MAX_IMBALANCE:
            break
    return previous, error


def _percolating_components(links: _PeriodicLinks, is_open: Flags, nodes: int) -> _Components:
    """Find the connected components of a doubly periodic network, and the axes along which each component percolates.

    A component percolates along an axis if it contains a closed loop that crosses the periodic boundary of the axis;
    crossings in opposite directions cancel. To find a percolating loop, the crossings on the path from the root of a
    spanning tree to each node are counted. Let n_a and n_b be the counts at two nodes a and b. A link from a to b
    closes a percolating loop unless n_b − n_a is equal to the number of crossings of the link.

    links : links of the network.
    is_open : flags (links,) of the links with a conductance > 0.
    nodes : number of nodes.
    """
    start, end = links.start[is_open], links.end[is_open]
    crossings = links.along_axes(links.crosses).astype(np.int64)[is_open]  # (open link, axis)
    graph = sp.coo_array((np.ones(start.size), (start, end)), shape=(nodes, nodes))
    count, label = connected_components(graph, directed=False)
    from_root = _crossings_from_roots(start, end, crossings, _first_nodes(label), nodes)
    closes_loop = from_root[start] + crossings != from_root[end]
    percolates = np.zeros((count, 2), bool)
    np.logical_or.at(percolates, label[start], closes_loop)
    return _Components(label, percolates)


def _first_nodes(label: Indices) -> Indices:
    """Return the node with the lowest number in each component."""
    _, first = np.unique(label, return_index=True)
    return first


def _crossings_from_roots(
    start: Indices, end: Indices, link_crossings: Indices, roots: Indices, n: int
) -> Indices:
    """Count the crossings of the periodic boundaries on the path from the root of a spanning tree to each node.

    Parameters
    ----------
    start, end : arrays (links,), first node and second node of each open link.
    link_crossings : array (links, 2), how often each link, followed from `start` to `end`, crosses the boundary of each
        axis.
    roots : root of the spanning tree of each connected component.
    n : number of nodes.

    Returns
    -------
    Array (n + 1, 2), number of crossings of the periodic boundary of each axis. A crossing in the negative direction
    counts as −1. Row n of the array belongs to an additional node, which is linked to all roots.
    """
    # an additional node n is linked to the roots, so that a single search finds the trees of all components
    i = np.concatenate([start, np.full(roots.size, n)])
    j = np.concatenate([end, roots])
    graph = sp.coo_array((np.ones(i.size), (i, j)), shape=(n + 1, n + 1)).tocsr()
    _, parent = breadth_first_order(graph, n, directed=False)
    parent[n] = n
    crossings = np.zeros((n + 1, 2), np.int64)  # at first, of the link from the parent to each node
    for a, b, sign in ((start, end, 1), (end, start, -1)):
        is_in_tree = parent[b] == a
        crossings[b[is_in_tree]] = sign * link_crossings[is_in_tree]
    # add the crossings of the ancestors; each step doubles the number of links that have been added up
    while (parent != n).any():
        crossings += crossings[parent]
        parent = parent[parent]
    return crossings
