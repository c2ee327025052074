"""Window elements assembled to one system, and its direct solution for a unit drop between inlet and outlet.

Nodes are eliminated while blocks of elements are joined, two at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..base import Array, Indices, NotConverged
from ..base.compiled import compiled
from ..flow.solution import MAX_IMBALANCE
from ..flow.solvers.elimination import Factors, Links, Order, carry_sources, factored, find_potentials
from .superelement import WindowElement


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
    starts = np.cumsum([0, *(front.size for front in fronts)])
    # counted first: all links as a list would take their memory several times
    row, later, value = np.zeros(n + 2, np.int64), np.empty(0, np.int64), np.empty(0)
    for counted in range(2):
        if counted:
            np.cumsum(row, out=row)
            later, value = np.empty(row[-1], np.int64), np.empty(row[-1])
        for c, number in zip(conductances, numbers, strict=True):
            _add_links(c, rank[number], row[2 - counted :][:n], later, value)
    links = Links(row[:-1], later, value)
    factors = factored(Order(order, starts, np.array(parent, np.int64)), links, dirichlet.size)
    return MeshFactors(nodes, order, factors)


@compiled()
def _add_links(conductances, rank, end, later, value):
    """Add the links of an element behind those that each eliminated node has, which end at `end`; without room count.

    rank : place of each node of the element in the order of all.
    """
    for i in range(rank.size):
        for j in range(i + 1, rank.size):
            first = min(rank[i], rank[j])
            if conductances[i, j] != 0.0 and first < end.size and rank[i] != rank[j]:
                if later.size > 0:
                    later[end[first]], value[end[first]] = max(rank[i], rank[j]), conductances[i, j]
                end[first] += 1


#: Numbers of the nodes of the ends.
INLET, OUTLET = 0, 1


@dataclass(frozen=True, eq=False)
class ElementSolution:
    """Potential of the nodes of an `ElementMesh` for a unit drop.

    conductance : the energy [m³]. potential : NaN in pockets, which open pixels join to no Dirichlet node.
    energy : of each element; empty if nothing flows. unknowns : number of nodes that were solved for.
    flow : into each element through its four sides (elements, 4) [m³]; empty if nothing flows.
    imbalance, solver : see `flow.DarcyFlow`. factors : of the system; None if nothing flows.
    """

    conductance: float
    potential: Array
    energy: Array = field(default_factory=lambda: np.zeros(0))
    flow: Array = field(default_factory=lambda: np.zeros((0, 4)))
    unknowns: int = 0
    imbalance: float = 0.0
    solver: str = "none"
    factors: MeshFactors | None = None


@dataclass(frozen=True, eq=False)
class ElementMesh:
    """Window elements, and the number of each of their nodes among all nodes.

    elements : the elements. numbers : for each element the numbers of its nodes (n,); 0 is the inlet, 1 the outlet.
    nodes : number of all nodes. cells : rows and columns of elements.
    """

    elements: list[WindowElement]
    numbers: list[Indices]
    nodes: int
    cells: tuple[int, int]

    @classmethod
    def of_face(cls, elements: list[WindowElement], cells: tuple[int, int], *, ring: bool = True) -> ElementMesh:
        """Elements of windows, row after row; their columns form a ring, or the outer sides are closed."""
        m1, m2 = cells
        counts = np.array([e.counts for e in elements]).reshape(m1, m2, 4)
        # nodes of the sides before each row but the first, before each column, and without a ring after the last
        last = counts[: 0 if ring else m1, -1, 3]
        first = np.cumsum(np.concatenate([[2], counts[1:, :, 0].ravel(), counts[:, :, 2].ravel(), last]))
        before_rows, before_columns, after = np.split(first[:-1], [(m1 - 1) * m2, (2 * m1 - 1) * m2])
        ends = np.full(m2, INLET), np.full(m2, OUTLET)
        rows = np.concatenate([ends[0], before_rows, ends[1]]).reshape(m1 + 1, m2)
        columns = before_columns.reshape(m1, m2)
        columns = np.column_stack([columns, columns[:, 0] if ring else after])
        numbers = []
        for i, j in np.ndindex(m1, m2):
            starts = rows[i, j], rows[i + 1, j], columns[i, j], columns[i, j + 1]
            parts = [start + np.arange(n) for start, n in zip(starts, counts[i, j], strict=True)]
            numbers.append(np.concatenate(parts))
        return cls(elements, numbers, int(first[-1]), cells)

    @cached_property
    def component(self) -> Indices:
        """Component of every node (nodes,): nodes with the same number are joined by open pixels."""
        start, end, count = [], [], self.nodes
        for element, number in zip(self.elements, self.numbers, strict=True):
            point, which = np.nonzero(element.weight)
            start.append(number[element.node[point, which]])
            names, name = np.unique(element.component[point], return_inverse=True)
            end.append(count + name)
            count += names.size
        i, j = np.concatenate(start), np.concatenate(end)
        graph = sp.coo_array((np.ones(i.size, np.int8), (i, j)), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1][: self.nodes])

    @property
    def percolates(self) -> bool:
        """Whether a path of open pixels joins inlet and outlet."""
        return bool(self.component[INLET] == self.component[OUTLET])

    def solve(self) -> ElementSolution:
        """Solve the mass balance of every node that joins both ends.

        Raises NotConverged: inlet and outlet flow differ by more than 1e-5.
        """
        if not self.percolates:
            at = self.component
            beside = [at == at[INLET], at == at[OUTLET]]
            return ElementSolution(0.0, np.select(beside, [1.0, 0.0], np.nan))
        solution = self._solved(np.array([INLET, OUTLET]), np.array([1.0, 0.0]))
        if not solution.imbalance <= MAX_IMBALANCE:
            raise NotConverged(
                f"flow: inlet and outlet of the elements differ by {solution.imbalance:.1e} of the flow, expected "
                f"{MAX_IMBALANCE:.0e}",
                solution.imbalance,
            )
        return solution

    def solve_dirichlet(self, nodes: Indices, potential: Array) -> ElementSolution:
        """Solve with given potentials between 0 and 1 at more nodes than inlet and outlet.

        The energy of any potential is an upper bound, so that rounding can make this one wider, not wrong.
        """
        dirichlet = np.concatenate([[INLET, OUTLET], nodes])
        return self._solved(dirichlet, np.concatenate([[1.0, 0.0], potential]))

    def _solved(self, dirichlet: Indices, values: Array) -> ElementSolution:
        """Solution with `values` at the Dirichlet nodes."""
        conductances = [e.conductances for e in self.elements]
        # potential and complement are solved for on their own, so that each keeps its relative accuracy
        factors = mesh_factors(conductances, self.numbers, self.cells, dirichlet, self.nodes)
        x, y = factors.dirichlet(values), factors.dirichlet(1 - values)
        reached = np.isin(self.component, self.component[dirichlet])
        energy, through, out = np.zeros(len(conductances)), np.zeros((len(conductances), 4)), np.zeros(self.nodes)
        for n, (c, number) in enumerate(zip(conductances, self.numbers, strict=True)):
            chosen = reached[number]
            i = number[chosen]
            p, q = x[i], y[i]
            drop = np.where(p[:, None] + p < 1, p[:, None] - p, q - q[:, None])
            flow = c[np.ix_(chosen, chosen)] * drop
            energy[n] = 0.5 * float((flow * drop).sum())
            inwards = flow.sum(axis=1)
            np.add.at(out, i, inwards)
            through[n] = np.bincount(self.elements[n].side[chosen], inwards, minlength=4)
        rate = float(energy.sum())
        imbalance = max(abs(float(out[dirichlet].sum())), abs(float(values @ out[dirichlet]) - rate))
        imbalance = imbalance / rate if rate > 0 else 0.0
        unknowns = int(np.count_nonzero(reached)) - dirichlet.size
        solver = "elimination" if unknowns else "none"
        return ElementSolution(
            rate, np.where(reached, x, np.nan), energy, through, unknowns, imbalance, solver, factors
        )
