"""Find clusters of nodes that a coarser grid hardly moves, and correct the potential of each cluster.

The interpolation from a coarser grid may be poor at nodes whose links to coarse nodes are narrow, for example in a bay
behind a narrow mouth, or in a channel between two rows of coarse nodes. If such nodes have wide links to each other,
they form a cluster. Neither the coarser grid nor a sweep of Jacobi changes the potential that the nodes of a cluster
have in common, so that each cluster would cost several iterations of conjugate gradients.

The potentials of all nodes of a cluster are therefore changed by the same amount, such that the inflow of the cluster
is equal to its outflow. Operators, levels and borders are as in `hierarchy`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base import Singles
from ...base.compiled import REORDERED, compiled, inlined, inner

#: A node is held by the coarser grid if its links to coarse nodes, or to other nodes that are held, have at least this
#: fraction of the sum of its conductances.
HOLDING = 0.1
#: Number of links over which nodes are held, in addition to the links that `hierarchy` takes into account.
_PASSES = 2
#: Two neighbours that are not held belong to the same cluster if the conductance of their link is at least this
#: fraction of the sum of all conductances of one of them.
_JOINING = 0.1
#: A diagonal entry less the conductances to all neighbours is the conductance to inlet and outlet. The difference
#: counts as a rounding error if it is below this fraction of the diagonal entry.
_ROUNDING = 1e-10
#: Smallest sum of the conductances between a cluster and its surroundings for which the cluster is corrected.
_LEAST_OUTWARD = 1e-30
#: Offsets (rows, columns) of the neighbours of a node; the last four are the neighbours along the diagonals.
_NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


class Clusters(NamedTuple):
    """Clusters of a multigrid level.

    nodes : array (nodes, 2), row and column of all nodes of all clusters.
    first : array (clusters + 1,); cluster k has the nodes `first[k]` to `first[k + 1] − 1`.
    outside : array (nodes,), bit k is set if neighbour number k in `_NEIGHBOURS` does not belong to the cluster.
    to_ends : array (nodes,), conductance from each node to inlet and outlet.
    inverse : array (clusters,), 1 over the sum of all conductances between a cluster and its surroundings.
    """

    nodes: NDArray[np.int32]
    first: NDArray[np.int32]
    outside: NDArray[np.uint8]
    to_ends: Singles
    inverse: Singles


@inner(**REORDERED)
def _link(links, i, j, k):
    """Return the conductance of the link from node (i, j) to its neighbour number k in `_NEIGHBOURS`.

    links : arrays `right`, `below`, `below_right` and `below_left`, see `hierarchy`.
    """
    right, below, below_right, below_left = links
    if k == 0:
        return right[i, j]
    if k == 1:
        return right[i, j - 1]
    if k == 2:
        return below[i, j]
    if k == 3:
        return below[i - 1, j]
    if k == 4:
        return below_right[i, j]
    if k == 5:
        return below_right[i - 1, j - 1]
    if k == 6:
        return below_left[i, j]
    return below_left[i - 1, j + 1]


@inner(**REORDERED)
def _neighbour(i, j, k, n2, ring):
    """Return row and column of neighbour number k of a node; the n2 columns may form a ring."""
    di, dj = _NEIGHBOURS[k]
    column = j + dj
    if ring:
        column = (column - 1) % n2 + 1
    return i + di, column


@inlined(**REORDERED)
def _without_held(loose, is_loose, centre, links, neighbours, ring):
    """Return the loose nodes without those that have sufficient links to nodes that are held.

    loose : array (nodes, 2), row and column of the loose nodes; the array is overwritten.
    is_loose : flags of the loose nodes, which are updated.
    """
    n2 = centre.shape[1] - 2
    is_held = np.zeros(len(loose), np.bool_)
    for q in range(len(loose)):
        i, j = loose[q]
        to_held = 0.0
        for k in range(neighbours):
            a, b = _neighbour(i, j, k, n2, ring)
            if not is_loose[a, b]:
                to_held += _link(links, i, j, k)
        is_held[q] = to_held >= HOLDING * centre[i, j]
    count = 0
    for q in range(len(loose)):
        if is_held[q]:
            is_loose[loose[q, 0], loose[q, 1]] = False
        else:
            # the assignment of a whole row would compile a message about its shape, which takes several seconds
            loose[count, 0], loose[count, 1] = loose[q, 0], loose[q, 1]
            count += 1
    return loose[:count]


@compiled(**REORDERED)
def find_clusters(is_loose, operator, is_nine_point, ring):
    """Find the clusters of a level: groups of loose nodes with wide links to each other.

    A node is loose if its links to nodes that are held by the coarser grid are too narrow to hold it as well.

    is_loose : flags of the nodes that are not held directly by the coarser grid, with a border of one node. The flags
        are overwritten.
    operator : arrays `centre`, `right`, `below`, `below_right` and `below_left` of the level.
    ring : whether the columns form a ring.
    """
    centre, right, below, below_right, below_left = operator
    links = right, below, below_right, below_left
    neighbours = 8 if is_nine_point else 4
    loose = _list_flagged(is_loose)
    for _ in range(_PASSES):
        loose = _without_held(loose, is_loose, centre, links, neighbours, ring)
    nodes, first = _join_loose_nodes(loose, is_loose, centre, links, neighbours, ring)
    outside, to_ends, inverse = _find_surroundings(nodes, first, centre, links, neighbours, ring)
    return Clusters(nodes, first, outside, to_ends, inverse)


@inlined(**REORDERED)
def _join_loose_nodes(loose, is_loose, centre, links, neighbours, ring):
    """Join loose nodes that are connected by wide links to clusters of two or more nodes.

    Each cluster grows from its first node: the loose neighbours of its nodes are added until none is left (flood fill).
    A single node is no cluster, because a sweep of Jacobi changes its potential.

    loose : array (nodes, 2), row and column of the loose nodes.
    is_loose : flags of the loose nodes. The flag of a node is cleared when it is added to a cluster.
    neighbours : number of neighbours of a node, 4 or 8.

    Returns the arrays `nodes` and `first` of `Clusters`.
    """
    n2 = centre.shape[1] - 2
    nodes = np.empty_like(loose)
    first = np.zeros(len(loose) + 1, np.int32)
    clusters = 0
    size = 0  # number of nodes in clusters
    for q in range(len(loose)):
        i, j = loose[q]
        if not is_loose[i, j]:  # already in a cluster
            continue
        begin = size
        nodes[size, 0], nodes[size, 1] = i, j
        is_loose[i, j] = False
        size += 1
        visited = begin  # the nodes `begin` to `visited` − 1 have no further loose neighbours
        while visited < size:
            i, j = nodes[visited]
            visited += 1
            for k in range(neighbours):
                a, b = _neighbour(i, j, k, n2, ring)
                conductance = _link(links, i, j, k)
                is_wide = conductance >= _JOINING * min(centre[i, j], centre[a, b])
                if is_loose[a, b] and is_wide and conductance > 0.0:
                    is_loose[a, b] = False
                    nodes[size, 0], nodes[size, 1] = a, b
                    size += 1
        if size == begin + 1:
            size = begin  # a single node is removed again
            continue
        first[clusters + 1] = size
        clusters += 1
    return nodes[:size].copy(), first[: clusters + 1].copy()


@inlined(**REORDERED)
def _find_surroundings(nodes, first, centre, links, neighbours, ring):
    """Find the links from each cluster to its surroundings, and the sum of their conductances.

    nodes, first : see `Clusters`.
    neighbours : number of neighbours of a node, 4 or 8.

    Returns the arrays `outside`, `to_ends` and `inverse` of `Clusters`.
    """
    n2 = centre.shape[1] - 2
    clusters = len(first) - 1
    # number of the cluster of each node, counted from 1; 0 outside of clusters
    cluster_of = np.zeros(centre.shape if clusters > 0 else (0, 0), np.int32)
    for c in range(clusters):
        for m in range(first[c], first[c + 1]):
            cluster_of[nodes[m, 0], nodes[m, 1]] = c + 1
    outside = np.zeros(len(nodes), np.uint8)
    to_ends = np.zeros(len(nodes), np.float32)
    inverse = np.empty(clusters, np.float32)
    for c in range(clusters):
        outward = 0.0  # sum of the conductances between the cluster and its surroundings
        for m in range(first[c], first[c + 1]):
            i, j = nodes[m]
            # the diagonal entry less the conductances to all neighbours is the conductance to inlet and outlet
            rest = centre[i, j]
            for k in range(neighbours):
                a, b = _neighbour(i, j, k, n2, ring)
                conductance = _link(links, i, j, k)
                rest -= conductance
                # a level stores negative conductances as 0
                if cluster_of[a, b] != c + 1 and conductance > 0.0:
                    outside[m] |= 1 << k
                    outward += conductance
            if rest > _ROUNDING * centre[i, j]:
                to_ends[m] = rest
                outward += rest
        inverse[c] = 1.0 / outward if outward > _LEAST_OUTWARD else 0.0
    return outside, to_ends, inverse


def no_clusters() -> Clusters:
    """Return the clusters of a level without clusters."""
    none = np.zeros(0, np.float32)
    return Clusters(
        np.zeros((0, 2), np.int32), np.zeros(1, np.int32), np.zeros(0, np.uint8), none, none
    )


@inlined(**REORDERED)
def _list_flagged(flags):
    """Return row and column of all flagged nodes that are not in the border."""
    count = 0
    for i in range(1, flags.shape[0] - 1):
        for j in range(1, flags.shape[1] - 1):
            count += flags[i, j]
    nodes = np.empty((count, 2), np.int32)
    count = 0
    for i in range(1, flags.shape[0] - 1):
        for j in range(1, flags.shape[1] - 1):
            if flags[i, j]:
                nodes[count, 0], nodes[count, 1] = i, j
                count += 1
    return nodes


@compiled(**REORDERED)
def correct_clusters(level, ring, is_forward):
    """Change the potential x of each cluster in turn, such that the inflow of the cluster is equal to its outflow.

    is_forward : whether to begin with the first cluster, and to update the residual r; otherwise, the function begins
        with the last cluster, and does not use r.
    """
    nodes, first, outside, to_ends, inverse = level.clusters
    links, x, b, r = level.links, level.x, level.b, level.r
    n2 = x.shape[1] - 2
    for step in range(inverse.size):
        c = step if is_forward else inverse.size - 1 - step
        # Sources of all nodes, and inflow from the surroundings. The flow between two nodes of the cluster is left out,
        # because its rounding error may exceed the flow into the cluster.
        excess = 0.0
        for m in range(first[c], first[c + 1]):
            i, j = nodes[m]
            excess += b[i, j] - to_ends[m] * x[i, j]
            for k in range(8):
                if outside[m] >> k & 1:
                    a, d = _neighbour(i, j, k, n2, ring)
                    excess += _link(links, i, j, k) * (x[a, d] - x[i, j])
        change = np.float32(excess * inverse[c])
        for m in range(first[c], first[c + 1]):
            i, j = nodes[m]
            x[i, j] += change
            _wrap(x, i, j, ring)
            if not is_forward:
                continue
            outward = to_ends[m]
            for k in range(8):
                if outside[m] >> k & 1:
                    a, d = _neighbour(i, j, k, n2, ring)
                    conductance = _link(links, i, j, k)
                    outward += conductance
                    r[a, d] += change * conductance
                    _wrap(r, a, d, ring)
            r[i, j] -= change * outward
            _wrap(r, i, j, ring)


@inner(**REORDERED)
def _wrap(field, i, j, ring):
    """Copy the value of a node at the first or last column of a ring to the border at the opposite side."""
    n2 = field.shape[1] - 2
    if ring and j == 1:
        field[i, n2 + 1] = field[i, 1]
    if ring and j == n2:
        field[i, 0] = field[i, n2]
