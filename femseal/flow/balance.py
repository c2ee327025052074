"""A flux made to balance: what a solver leaves over at the nodes of a graph is sent out along a spanning
tree.

The flux of a numerical solution balances up to rounding, which a high contrast makes matter. For a lower
bound of the flow (Thomson's principle) it must balance exactly.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def balanced_flux(tail: Indices, head: Indices, width: Array, flux: Array, nodes: int) -> Array:
    """Flux near `flux` that balances at every node but node 0, where it enters and leaves.

    Parameters
    ----------
    tail, head : nodes of each link, both ends of the seal being node 0.
    width : conductance of each link; links of width 0 are left alone. The tree is the one of the widest
        links, so that the rounding errors of wide links do not run through narrow ones unless they have to.
    flux : from tail to head; 0 where the width is.
    nodes : their number; those that no link of width > 0 joins to node 0 are left alone.
    """
    excess = np.bincount(head, flux, nodes) - np.bincount(tail, flux, nodes)
    order, parent, link = _widest_tree(tail, head, width, nodes)
    leaving, up = excess.tolist(), parent.tolist()
    for child in order[:0:-1].tolist():
        leaving[up[child]] += leaving[child]
    children = order[1:]
    outward = np.where(tail[link[children]] == children, 1.0, -1.0)
    result = flux.copy()
    result[link[children]] += outward * np.array(leaving)[children]
    return result


def _widest_tree(a: Indices, b: Indices, width: Array, nodes: int) -> tuple[Indices, Indices, Indices]:
    """Maximum spanning tree of the links a–b: nodes from node 0 outward, parents, links to the parents."""
    candidates = np.flatnonzero((width > 0) & (a != b))
    ranked = candidates[np.argsort(-width[candidates], kind="stable")]
    low, high = np.minimum(a, b)[ranked].astype(np.int64), np.maximum(a, b)[ranked]
    # of parallel links the widest; ranks instead of widths bear any contrast
    _, first = np.unique(low * nodes + high, return_index=True)
    graph = sp.csr_array((first + 1.0, (low[first], high[first])), shape=(nodes, nodes))
    tree = minimum_spanning_tree(graph).tocoo()
    order, parent = breadth_first_order(tree.tocsr(), 0, directed=False)
    child = np.where(parent[tree.col] == tree.row, tree.col, tree.row)
    link = np.zeros(nodes, np.int64)
    link[child] = ranked[tree.data.astype(np.int64) - 1]
    return order, parent, link
