"""Window elements assembled to one system, and its solution for a unit drop between inlet and outlet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..base.errors import NotConverged
from ..flow.solution import MAX_IMBALANCE
from ..flow.solvers.amg import LinearSolution, solve_spd
from .superelement import WindowElement

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
#: Numbers of the nodes of the ends.
INLET, OUTLET = 0, 1
_RTOL = 1e-8


@dataclass(frozen=True, eq=False)
class ElementSolution:
    """Potential of the nodes of an `ElementMesh` for a unit drop.

    conductance : the energy [m³]. energy : of each element. potential : NaN at nodes that do not join both ends.
    unknowns : number of nodes that were solved for. iterations, residual, imbalance, solver : see `flow.DarcyFlow`.
    """

    conductance: float
    energy: Array
    potential: Array
    unknowns: int = 0
    iterations: int = 0
    residual: float = 0.0
    imbalance: float = 0.0
    solver: str = "none"


@dataclass(frozen=True, eq=False)
class ElementMesh:
    """Window elements, and the number of each of their nodes among all nodes.

    elements : the elements. numbers : for each element the numbers of its nodes (n,); 0 is the inlet, 1 the outlet.
    nodes : number of all nodes.
    """

    elements: list[WindowElement]
    numbers: list[Indices]
    nodes: int

    @classmethod
    def of_face(cls, elements: list[WindowElement], cells: tuple[int, int]) -> ElementMesh:
        """Elements of the windows of a face, row after row; the columns form a ring."""
        m1, m2 = cells
        counts = np.array([e.counts for e in elements]).reshape(m1, m2, 4)
        # nodes of the sides before each row but the first, then those before each column
        sides = np.concatenate([[2], counts[1:, :, 0].ravel(), counts[:, :, 2].ravel()])
        first = np.cumsum(sides)
        before_rows, before_columns = np.split(first[:-1], [(m1 - 1) * m2])
        ends = np.full(m2, INLET), np.full(m2, OUTLET)
        rows = np.concatenate([ends[0], before_rows, ends[1]]).reshape(m1 + 1, m2)
        columns = before_columns.reshape(m1, m2)
        numbers = []
        for i, j in np.ndindex(m1, m2):
            starts = rows[i, j], rows[i + 1, j], columns[i, j], columns[i, (j + 1) % m2]
            parts = [start + np.arange(n) for start, n in zip(starts, counts[i, j], strict=True)]
            numbers.append(np.concatenate(parts))
        return cls(elements, numbers, int(first[-1]))

    @cached_property
    def reached(self) -> Flags:
        """Nodes that open pixels join to both ends (nodes,); none if no path joins inlet and outlet."""
        start, end, count = [], [], self.nodes
        for element, number in zip(self.elements, self.numbers, strict=True):
            point, which = np.nonzero(element.weight)
            start.append(number[element.node[point, which]])
            end.append(count + element.component[point])
            count += int(element.component.max()) + 1
        i, j = np.concatenate(start), np.concatenate(end)
        graph = sp.coo_array((np.ones(i.size, np.int8), (i, j)), shape=(count, count))
        label = connected_components(graph, directed=False)[1]
        joined = label[INLET] == label[OUTLET]
        return (label[: self.nodes] == label[INLET]) & joined

    @property
    def percolates(self) -> bool:
        """Whether a path of open pixels joins inlet and outlet."""
        return bool(self.reached[INLET])

    def solve(self, *, every_second: bool = False) -> ElementSolution:
        """Solve the mass balance of every node that joins both ends; `every_second` leaves out the nodes between.

        Raises
        ------
        NotConverged : the linear solver failed, or inlet and outlet flow differ by more than 1e-5.
        """
        first, second, couple, of = self._couples
        if not self.percolates:
            return ElementSolution(0.0, np.zeros(len(self.elements)), np.full(self.nodes, np.nan))
        keep = self.reached.copy()
        matrix = _laplacian(first, second, couple, self.nodes)
        to_nodes = sp.eye_array(self.nodes, format="csr")
        if every_second:
            to_nodes = self._from_every_second
            matrix = (to_nodes.T @ matrix @ to_nodes).tocsr()
            keep &= to_nodes.diagonal() > 0
        keep[[INLET, OUTLET]] = False
        unknown = np.flatnonzero(keep)
        x, y = np.zeros((2, self.nodes))
        x[INLET] = y[OUTLET] = 1.0
        found = LinearSolution(x, y, 0, 0.0, "none")
        if unknown.size:
            rows = matrix[unknown]
            # potential and complement are solved for on their own, so that each keeps its relative accuracy
            found = solve_spd(rows[:, unknown], -rows[:, [INLET, OUTLET]].toarray(), _RTOL, unit_drop=True)
            x[unknown], y[unknown] = found.x.T
        x, y = to_nodes @ x, to_nodes @ y
        drop = np.where(x[first] + x[second] < 1, x[first] - x[second], y[second] - y[first])
        energy = np.bincount(of, couple * drop**2, len(self.elements)).astype(float)
        rate = float(energy.sum())
        inlet, outlet = (
            float(couple @ (np.where(first == end, z[second], 0.0) + np.where(second == end, z[first], 0.0)))
            for end, z in ((INLET, y), (OUTLET, x))
        )
        imbalance = max(abs(inlet - outlet), abs(inlet - rate)) / rate if rate > 0 else np.inf
        if not imbalance <= MAX_IMBALANCE:
            raise NotConverged(
                f"flow: inlet and outlet of the elements differ by {imbalance:.1e} of the flow, allowed is "
                f"{MAX_IMBALANCE:.0e}",
                imbalance,
            )
        potential = np.where(self.reached, x, np.nan)
        return ElementSolution(
            rate, energy, potential, unknown.size, found.iterations, found.residual, imbalance, found.solver
        )

    @cached_property
    def _couples(self) -> tuple[Indices, Indices, Array, Indices]:
        """Pairs of nodes that are coupled, and joined to both ends: both numbers, the couple, the element."""
        parts = []
        for n, (element, number) in enumerate(zip(self.elements, self.numbers, strict=True)):
            a, b = np.nonzero(np.triu(element.couples))
            parts.append((number[a], number[b], element.couples[a, b], np.full(a.size, n)))
        first, second, couple, of = (np.concatenate(part) for part in zip(*parts, strict=True))
        chosen = self.reached[first] & (first != second)
        return first[chosen], second[chosen], couple[chosen], of[chosen]

    @cached_property
    def _from_every_second(self) -> sp.csr_array:
        """Interpolation (nodes, nodes) from every second node; columns of the others are 0."""
        node, weight = np.zeros((self.nodes, 2), np.int64), np.zeros((self.nodes, 2))
        for element, number in zip(self.elements, self.numbers, strict=True):
            node[number], weight[number] = number[element.coarse], element.coarse_weight
        row = np.arange(self.nodes)
        entries = (weight.T.ravel(), (np.tile(row, 2), node.T.ravel()))
        return sp.coo_array(entries, shape=(self.nodes, self.nodes)).tocsr()


def _laplacian(first: Indices, second: Indices, couple: Array, nodes: int) -> sp.csr_array:
    i, j = np.concatenate([first, second] * 2), np.concatenate([second, first, first, second])
    return sp.coo_array((np.concatenate([-couple, -couple, couple, couple]), (i, j)), shape=(nodes, nodes)).tocsr()
