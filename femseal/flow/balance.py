"""Correct a numerical flux so that inflow and outflow of every node are equal.

The excess of a node is its inflow less its outflow. The excess of each node is sent to the inlet or the outlet along a
spanning tree. The flux of a numerical solution is only conserved up to rounding errors, which matter if the
permeabilities differ by many orders of magnitude. A lower bound of the flow by Thomson's principle requires a flux that
is conserved exactly.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from ..base.compiled import compiled, inner
from .percolation import union

#: Largest binary exponent of a number in double precision.
_LARGEST = 1024
#: Number of binary exponents from the smallest to the largest number in double precision, rounded up.
_EXPONENTS = 2100
#: Number that is stored in place of the exponent of a closed link.
_CLOSED = -2000


@compiled()
def _exponents(width):
    """Return the binary exponent of the width of each link."""
    exponents = np.empty(width.size, np.int16)
    for k in range(width.size):
        exponents[k] = frexp(width[k])[1] if width[k] > 0.0 else _CLOSED
    return exponents


@compiled()
def balance(tail, head, width, flux, nodes):
    """Correct a flux in place so that it is conserved at every node except node 0.

    Node 0 stands for both ends of the seal, where fluid enters and leaves.

    Parameters
    ----------
    tail, head : arrays (links,), node at which each link begins and node at which it ends.
    width : array (links,), conductance of each link. Links with the conductance 0 keep their flux.
    flux : array (links,), flux from tail to head. It must be 0 in links with the conductance 0.
    nodes : number of nodes. Each node with a flux must be connected to node 0 by links with a conductance > 0.
    """
    excess = np.zeros(nodes)
    for k in range(flux.size):
        excess[tail[k]] -= flux[k]
        excess[head[k]] += flux[k]
    link = _send(tail, head, _exponents(width), excess)
    for node in range(1, nodes):
        if excess[node] != 0.0:
            k = link[node]
            is_outward = tail[k] == node  # the link begins at this node and ends at its parent
            flux[k] += excess[node] if is_outward else -excess[node]


@compiled()
def _send(tail, head, exponent, excess):
    """Send the excess of all nodes to node 0 along a spanning tree; return the link from each node to its parent.

    The tree consists of the widest links (Kruskal's algorithm), so that excess only passes a narrow link where there is
    no other path. On return, `excess` contains the flux from each node to its parent in the tree.
    """
    nodes = excess.size
    degree, links_xor = spanning_tree(tail, head, exponent, nodes)
    # Remove the leaves of the tree one after another. A leaf has a single remaining link, whose number is the exclusive
    # or of the numbers of its remaining links. After its removal, this number remains in `links_xor`.
    for leaf in range(1, nodes):
        node = np.int64(leaf)
        while node != 0 and degree[node] == 1:
            k = links_xor[node]
            parent = np.int64(tail[k]) + head[k] - node  # the other node of the link
            excess[parent] += excess[node]
            degree[node] = 0
            degree[parent] -= 1
            links_xor[parent] ^= k  # removes link k from the links of the parent
            node = parent  # the parent may have become a leaf
    return links_xor


@inner()
def spanning_tree(tail, head, exponent, nodes):
    """Find the spanning tree of the widest links (Kruskal's algorithm).

    Parameters
    ----------
    tail, head : arrays (links,), the two nodes of each link.
    exponent : array (links,), binary exponent of the width of each link; `_CLOSED` marks a closed link.
    nodes : number of nodes.

    Returns
    -------
    degree : array (nodes,), number of tree links at each node.
    links_xor : array (nodes,), exclusive or (XOR) of the numbers of all tree links at each node. When a link is removed
        from the tree, the exclusive or with its number removes this number from the value of both its nodes. A node
        with one remaining link (a leaf) therefore has the number of this link as its value.
    """
    degree = np.zeros(nodes, np.int32)
    links_xor = np.zeros(nodes, np.int32)
    parent = np.arange(nodes).astype(np.int32)
    for k in _widest_first(exponent):
        if union(parent, tail[k], head[k]):
            for node in (tail[k], head[k]):
                degree[node] += 1
                links_xor[node] ^= k
    return degree, links_xor


@inner()
def _widest_first(exponent):
    """Sort the open links by their exponents, widest first, and return their numbers.

    A counting sort by exponents takes a tenth of the time of sorting by widths.
    """
    # next position in the sorted list for the links of each exponent; slot 0 is the largest exponent
    position = np.zeros(_EXPONENTS + 1, np.int64)
    for e in exponent:
        if e != _CLOSED:
            position[_LARGEST - e + 1] += 1
    position = np.cumsum(position)
    order = np.empty(position[-1], np.int32)
    for k in range(exponent.size):
        if exponent[k] != _CLOSED:
            slot = _LARGEST - exponent[k]
            order[position[slot]] = k
            position[slot] += 1
    return order
