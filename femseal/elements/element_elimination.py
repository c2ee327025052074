"""Direct solution of an element mesh: nodes are eliminated while blocks of elements are joined, two at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Indices
from ..flow.solvers.elimination import Factors, Links, Order, carry_sources, factored, find_potentials


@dataclass(frozen=True, eq=False)
class MeshFactors:
    """The eliminated system of an element mesh.

    nodes : number of all nodes. order : numbers of the eliminated nodes and then of the Dirichlet nodes.
    factors : see `elimination.Factors`.
    """

    nodes: int
    order: Indices
    factors: Factors

    def dirichlet(self, values: Array) -> Array:
        """Potentials (nodes,) that balance at every node, with those of the Dirichlet nodes (h,)."""
        return self._found(np.concatenate([np.zeros(self.order.size - values.size), values]))

    def under(self, sources: Array) -> Array:
        """Potentials (nodes,) for sources at the nodes (nodes,), with 0 at the Dirichlet nodes."""
        v = sources[self.order]
        carry_sources(self.factors, v)
        v[self.factors.inverse.size :] = 0.0
        return self._found(v)

    def _found(self, v: Array) -> Array:
        find_potentials(self.factors, v)
        x = np.zeros(self.nodes)
        x[self.order] = v
        return x


def mesh_factors(
    conductances: list[Array], numbers: list[Indices], cells: tuple[int, int], dirichlet: Indices, nodes: int
) -> MeshFactors:
    """Eliminate all nodes of an element mesh but the Dirichlet nodes.

    conductances, numbers : of every element what links its nodes (n, n) and their numbers (n,), row after row.
    cells : rows and columns of elements, which tell what lies side by side.
    dirichlet (h,) : nodes whose potential is given.
    nodes : number of all nodes. Those that nothing joins to a Dirichlet node get 0.
    """
    # rows and columns of the elements that a node belongs to: the first ones, and the ends
    low, high = np.full((2, nodes), max(cells)), np.zeros((2, nodes), np.int64)
    for place, number in enumerate(numbers):
        for axis, at in enumerate(divmod(place, cells[1])):
            low[axis, number] = np.minimum(low[axis, number], at)
            high[axis, number] = np.maximum(high[axis, number], at + 1)
    fronts: list[Indices] = []
    parent: list[int] = []

    def joined(inside: Indices, begin: tuple[int, int], end: tuple[int, int]) -> list[int]:
        """Fronts of a block of elements and of the nodes inside it, those that are linked to what lies outside."""
        extent = end[0] - begin[0], end[1] - begin[1]
        roots: list[int] = []
        if extent != (1, 1):
            axis = 0 if extent[0] >= extent[1] else 1
            middle = (begin[axis] + end[axis]) // 2
            before, after = high[axis, inside] <= middle, low[axis, inside] >= middle
            cut = (middle, end[1]) if axis == 0 else (end[0], middle)
            roots += joined(inside[before], begin, cut)
            cut = (middle, begin[1]) if axis == 0 else (begin[0], middle)
            roots += joined(inside[after], cut, end)
            inside = inside[~(before | after)]
        if not inside.size:
            return roots
        for root in roots:
            parent[root] = len(fronts)
        fronts.append(inside)
        parent.append(-1)
        return [len(fronts) - 1]

    own = high[0] > 0
    own[dirichlet] = False
    joined(np.flatnonzero(own), (0, 0), cells)
    order = np.concatenate([*fronts, dirichlet]).astype(np.int64)
    n = order.size - dirichlet.size
    rank = np.full(nodes, -1, np.int32)
    rank[order] = np.arange(order.size)
    parts = []
    for c, number in zip(conductances, numbers, strict=True):
        i, j = np.nonzero(np.triu(c, 1))
        one, other = rank[number[i]], rank[number[j]]
        parts.append((np.minimum(one, other), np.maximum(one, other), c[i, j]))
    first, later, value = (np.concatenate(part) for part in zip(*parts, strict=True))
    del parts  # large faces need their memory
    chosen = np.flatnonzero((first < n) & (first != later))
    chosen = chosen[np.argsort(first[chosen], kind="stable")]
    row = np.searchsorted(first[chosen], np.arange(n + 1))
    starts = np.cumsum([0, *(front.size for front in fronts)])
    links = Links(row, later[chosen].astype(np.int64), value[chosen])
    del first, later, value, chosen
    factors = factored(Order(order, starts, np.array(parent, np.int64)), links, dirichlet.size)
    return MeshFactors(nodes, order, factors)
