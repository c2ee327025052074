"""Find the nodes of a network that can carry flow (percolation), and the critical constriction.

Connected components are found by union-find. Nodes that are not connected to both the inlet and the outlet carry no
flow and are left out. If there is no open path from the inlet to the outlet, the flow is exactly 0. The critical
constriction, which is the narrowest point of the widest path from inlet to outlet, controls the leakage of a nearly
closed seal.
Sources: Ambegaokar, Halperin & Langer, Phys. Rev. B 4, 1971, 2612; for seals Persson & Yang, J. Phys. Condens. Matter
20, 2008, 315011.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import frexp, ldexp
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, Lengths, Pair
from ..base.compiled import compiled, inner, over, rows
from .grid import Stencil, gap_on_links
from .problem import validated_cell

#: Result of `nodes_reached` at a node that is connected to both inlet and outlet.
BOTH_ENDS = 3


@inner()
def find(parent, a):
    """Find the root of a node, and shorten the path to the root (path halving)."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = np.int64(parent[a])
    return a


@inner()
def union(parent, a, b):
    """Join the components of two nodes, and return whether the two components were different.

    The root of a component is the node with the lowest number in the component.
    """
    a = find(parent, np.int64(a))
    b = find(parent, np.int64(b))
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b
    return a != b


def nodes_reached(along: Array, across: Array, least: float = 0.0) -> NDArray[np.int8]:
    """Determine whether each node is connected to the inlet, to the outlet, to both or to neither.

    Parameters
    ----------
    along, across : conductances of the links between (n1 + 1, n2) nodes, see `Stencil`.
    least : smallest conductance of a link that counts as a connection; a link with the conductance 0 never counts.

    Returns
    -------
    Array (n1 + 1, n2). The value of a node is 0 if it is connected neither to the inlet nor to the outlet, 1 if it is
    connected to the inlet only, 2 if to the outlet only, and 3 (`BOTH_ENDS`) if to both. A dead end that branches off a
    path from inlet to outlet has the value 3, although it carries no flow.
    """
    n1, n2 = along.shape
    label = np.empty((n1 + 1, n2), np.int32)
    parent = np.empty((n1 + 1) * n2 + 2, np.int32)  # union-find: parent of each label
    parent[:2] = 0, 1  # labels of inlet and outlet
    parts = rows(n1 + 1, n2)
    over(parts, _label_rows, along, across, least, label, parent)
    for first, _ in parts[1:]:
        _join_rows(first, along, least, label, parent)
    reached = np.empty(label.shape, np.int8)
    over(parts, _reached_rows, label, parent, reached)
    return reached


@inner()
def _is_open(c, least):
    """Return whether a link with the conductance c is used."""
    return c > 0.0 and c >= least


@compiled()
def _label_rows(begin, end, along, across, least, label, parent):
    """Label the connected components in the rows `begin` to `end` − 1 of the nodes.

    The inlet has the label 0, and the outlet the label 1. The nodes of each row are labelled from left to right. A node
    takes the label of a connected neighbour above or to the left. If the neighbours above and to the left are both
    connected and have different labels, the two labels are united. If no neighbour above or to the left is connected,
    the node gets a new label.
    """
    n1, n2 = along.shape
    m2 = across.shape[1]
    count = begin * n2 + 2  # next new label; each part of the rows has its own range of labels
    if begin == 0:
        for j in range(n2):
            label[0, j] = 0
    for i in range(max(begin, 1), end):
        is_outlet = i == n1
        for j in range(n2):
            here = np.int32(1 if is_outlet else -1)  # label of this node; −1 if there is none yet
            # row i − 1 of `along` leads to row i of the nodes, and row i − 1 of `across` lies in row i of the nodes
            if i > begin and _is_open(along[i - 1, j], least):
                above = label[i - 1, j]
                if here < 0:
                    here = above
                elif here != above:
                    union(parent, here, above)
            if not is_outlet and j > 0 and _is_open(across[i - 1, j - 1], least):
                left = label[i, j - 1]
                if here < 0:
                    here = left
                elif here != left:
                    union(parent, here, left)
            if here < 0:
                here = np.int32(count)
                parent[count] = count
                count += 1
            label[i, j] = here
        is_ring = not is_outlet and m2 == n2 and n2 > 1
        if is_ring and _is_open(across[i - 1, n2 - 1], least) and label[i, n2 - 1] != label[i, 0]:
            union(parent, label[i, n2 - 1], label[i, 0])


@compiled()
def _join_rows(i, along, least, label, parent):
    """Unite the labels of the nodes in row i with the labels of the nodes in row i − 1 to which they are linked."""
    for j in range(along.shape[1]):
        if _is_open(along[i - 1, j], least):
            union(parent, label[i - 1, j], label[i, j])


@compiled()
def _reached_rows(begin, end, label, parent, reached):
    """Compute the rows `begin` to `end` − 1 of the result of `nodes_reached` from the labels of the nodes."""
    for i in range(begin, end):
        for j in range(label.shape[1]):
            reached[i, j] = _ends_of_label(parent, label[i, j])


@inner()
def _ends_of_label(parent, a):
    """Determine whether the component with the label `a` is connected to the inlet or the outlet, see `nodes_reached`.

    The path to the root is not shortened, so that several threads can read `parent` at the same time.

    Returns 0 if the component is connected neither to the inlet nor to the outlet, 1 for the inlet only, 2 for the
    outlet only, and 3 for both.
    """
    while parent[a] != a:
        a = parent[a]
    # a is now the root, the lowest label of the component; the inlet has the label 0, and the outlet the label 1
    if a > 1:
        return 0  # connected neither to the inlet nor to the outlet
    if parent[1] == 0:  # inlet and outlet are connected
        return BOTH_ENDS
    return a + 1  # 1 for the inlet, 2 for the outlet


@contextmanager
def closed_in_place(
    stencil: Stencil, keep: NDArray[np.bool_] | None, least: float = 0.0
) -> Iterator[None]:
    """Close some links of a stencil during a `with` block, at whose end they have their conductances again.

    A link is closed if one of its nodes is not marked in `keep`, or if its conductance is below `least`. If `keep` is
    None, no link is closed. The arrays of the stencil are changed in place, because a copy would need as much memory as
    the conductances of a whole face; only the conductances of the closed links are copied.

    keep : flags (n1 + 1, n2) of the nodes whose links remain open, or None.
    """
    saved = []  # (conductances, indices of closed links, their conductances)
    if keep is not None:
        inner = keep[1:-1]
        # flags of the links whose two nodes are marked, in the shapes of `along` and `across`
        keeps_along = keep[:-1] & keep[1:]
        keeps_across = np.roll(inner, -1, axis=1)
        keeps_across &= inner
        # only a ring has links over the seam
        keeps_across = keeps_across[:, : stencil.across.shape[1]]
        for c, keeps_link in ((stencil.along, keeps_along), (stencil.across, keeps_across)):
            links = c.reshape(-1)
            closed_links = np.flatnonzero((c > 0) & ~(keeps_link & (c >= least)))
            saved.append((links, closed_links, links[closed_links]))
            links[closed_links] = 0.0
    try:
        yield
    finally:
        for links, closed_links, conductances in saved:
            links[closed_links] = conductances


@compiled()
def _restrict(begin, end, along, across, keep, first, second):
    """Close the links of all nodes that are not marked in `keep`, and scale the conductances of the open links.

    begin, end : only links in the rows `begin` to `end` − 1 are changed.
    keep : flags (n1 + 1, n2) of the nodes whose links remain open.
    first, second : factors by which the conductances of open links are multiplied, one after the other.
    """
    n2, m2 = along.shape[1], across.shape[1]
    for i in range(begin, end):
        for j in range(n2):
            keeps_link = keep[i, j] and keep[i + 1, j]
            along[i, j] = second * (first * along[i, j]) if keeps_link else 0.0
    for i in range(begin, min(end, across.shape[0])):
        for j in range(m2):
            keeps_link = keep[i + 1, j] and keep[i + 1, (j + 1) % n2]
            across[i, j] = second * (first * across[i, j]) if keeps_link else 0.0


class PreparedLinks(NamedTuple):
    """Links of a stencil in the form that the fast solvers require, see `prepare_links_in_place`.

    along, across : conductances divided by 2^exponent, in the shapes of `Stencil`. If inlet and outlet are connected,
        the links of all nodes that are not connected to both inlet and outlet are closed.
    reached : array (n1 + 1, n2), whether each node is connected to the inlet, to the outlet, to both or to neither, see
        `nodes_reached`.
    exponent : exponent of the power of two by which the conductances are divided.
    """

    along: Array
    across: Array
    reached: NDArray[np.int8]
    exponent: int

    @property
    def percolate(self) -> bool:
        """Whether an open path connects the inlet and the outlet."""
        return bool(self.reached[0, 0] == BOTH_ENDS)


def prepare_links_in_place(along: Array, across: Array) -> PreparedLinks:
    """Prepare the conductances of a stencil for `solve_in_place`, in the arrays `along` and `across` themselves.

    In a network that connects inlet and outlet, the links of all nodes that are not connected to both inlet and outlet
    are closed. The conductances are divided by a power of two near the largest conductance.
    """
    parts = rows(*along.shape)
    reached = nodes_reached(along, across)
    percolates = reached[0, 0] == BOTH_ENDS and len(along) > 1
    exponent = 0
    keep = np.ones(reached.shape, np.bool_)
    if percolates:
        exponent = frexp(max(along.max(), across.max(initial=0.0)))[1] - 1
        keep = np.equal(reached, BOTH_ENDS)
    # Scaling by a power of two causes no rounding errors. The power of two may be out of the range of double precision,
    # and is therefore split into two factors.
    half = exponent // 2
    over(parts, _restrict, along, across, keep, ldexp(1.0, -half), ldexp(1.0, half - exponent))
    return PreparedLinks(along, across, reached, exponent)


@dataclass(frozen=True)
class Constriction:
    """Critical constriction: the narrowest point of the widest path from inlet to outlet.

    position : coordinates (x1, x2) of the constriction, which lies midway between two pixel centres [m].
    gap : gap at the constriction [m].
    """

    position: Pair
    gap: float


def critical_constriction(
    gap: ArrayLike, spacing: Lengths, *, axis: int = 0, sides: str = "mirror"
) -> Constriction | None:
    """Find the critical constriction of a cell: the narrowest point of the widest path.

    Parameters
    ----------
    gap, spacing, axis, sides : as in `cell_permeability`. The gap between two pixels is interpolated as in
        `cell_permeability`.

    Returns
    -------
    Constriction, or None if the cell does not percolate.

    Raises
    ------
    InputError : as in `cell_permeability`.
    """
    h, (d1, d2) = validated_cell(gap, spacing, axis, sides)
    h1, h2 = gap_on_links(h, False, sides == "periodic")
    widths = np.unique(np.concatenate([h1.ravel(), h2.ravel()]))
    widths = widths[widths > 0]

    def is_blocked(width: float) -> bool:
        """Return whether inlet and outlet are separated if all links with a gap below `width` are closed."""
        return bool(nodes_reached(h1, h2, width)[0, 0] != BOTH_ENDS)

    # bisection in the sorted widths: the number of widths at which a path exists
    open_widths = bisect_left(widths, True, key=is_blocked)
    if open_widths == 0:
        return None
    width = widths[open_widths - 1]
    if (h1 == width).any():
        i, j = np.argwhere(h1 == width)[0]
        # link i of the first axis is before pixel i, whose centre is at (i + ½) d1
        position = float(i * d1), float((j + 0.5) * d2)
    else:
        i, j = np.argwhere(h2 == width)[0]
        # link j of the second axis is after pixel j
        position = float((i + 0.5) * d1), float((j + 1) * d2)
    return Constriction(position if axis == 0 else position[::-1], float(width))
