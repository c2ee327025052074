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
#: Numbers of the nodes of the ends.
INLET, OUTLET = 0, 1
_RTOL = 1e-8
#: Largest number of corrections, each a solution for the flow that the one before leaves unbalanced.
_CORRECTIONS = 2


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
        return cls(elements, numbers, int(first[-1]))

    @cached_property
    def component(self) -> Indices:
        """Component of every node (nodes,): nodes with the same number are joined by open pixels."""
        start, end, count = [], [], self.nodes
        for element, number in zip(self.elements, self.numbers, strict=True):
            point, which = np.nonzero(element.weight)
            start.append(number[element.node[point, which]])
            end.append(count + element.component[point])
            count += int(element.component.max()) + 1
        i, j = np.concatenate(start), np.concatenate(end)
        graph = sp.coo_array((np.ones(i.size, np.int8), (i, j)), shape=(count, count))
        return np.asarray(connected_components(graph, directed=False)[1][: self.nodes])

    @property
    def percolates(self) -> bool:
        """Whether a path of open pixels joins inlet and outlet."""
        return bool(self.component[INLET] == self.component[OUTLET])

    def solve(self, *, every_second: bool = False) -> ElementSolution:
        """Solve the mass balance of every node that joins both ends; `every_second` leaves out the nodes between.

        Raises
        ------
        NotConverged : the linear solver failed, or inlet and outlet flow differ by more than 1e-5.
        """
        if not self.percolates:
            return ElementSolution(0.0, np.zeros(len(self.elements)), np.full(self.nodes, np.nan))
        between = self._from_every_second if every_second else None
        return self._solved(np.array([INLET, OUTLET]), np.array([1.0, 0.0]), between)

    def solve_held(self, nodes: Indices, potential: Array) -> ElementSolution:
        """Solve with more nodes held at potentials between 0 and 1, besides inlet and outlet.

        Raises
        ------
        NotConverged : as `solve`.
        """
        held = np.concatenate([[INLET, OUTLET], nodes])
        return self._solved(held, np.concatenate([[1.0, 0.0], potential]), None)

    def _solved(self, held: Indices, values: Array, between: sp.csr_array | None) -> ElementSolution:
        """Solution with `values` at the nodes `held`; `between` (nodes, nodes) interpolates nodes between others."""
        first, second, couple, of = self._couples
        reached = np.isin(self.component, self.component[held])
        to_nodes = sp.eye_array(self.nodes, format="csr") if between is None else between
        matrix = (to_nodes.T @ _laplacian(first, second, couple, self.nodes) @ to_nodes).tocsr()
        free = reached & (to_nodes.diagonal() > 0)
        free[held] = False
        unknown = np.flatnonzero(free)
        rows = matrix[unknown]
        inner = rows[:, unknown]
        # potential and complement are solved for on their own, so that each keeps its relative accuracy
        xy = np.zeros((self.nodes, 2))
        xy[held] = np.column_stack([values, 1 - values])
        rhs = -(rows[:, held] @ xy[held])
        found = LinearSolution(xy[:, 0], xy[:, 1], 0, 0.0, "none")
        for correction in range(_CORRECTIONS + 1):
            if unknown.size:
                # what counts is the balance of flows below
                found = solve_spd(inner, rhs, _RTOL, unit_drop=correction == 0, largest_residual=np.inf)
                xy[unknown] += found.x
            x, y = (to_nodes @ xy).T
            drop = np.where(x[first] + x[second] < 1, x[first] - x[second], y[second] - y[first])
            drop[~reached[first]] = 0.0
            energy = np.bincount(of, couple * drop**2, len(self.elements)).astype(float)
            out = np.bincount(first, couple * drop, self.nodes) - np.bincount(second, couple * drop, self.nodes)
            out = to_nodes.T @ out
            rate = float(energy.sum())
            off = max(abs(float(out[held].sum())), abs(float(values @ out[held]) - rate))
            if off <= MAX_IMBALANCE * rate:
                break
            rhs = np.column_stack([-out[unknown], out[unknown]])
        else:
            imbalance = off / rate if rate > 0 else np.inf
            raise NotConverged(
                f"flow: inlet and outlet of the elements differ by {imbalance:.1e} of the flow, allowed is "
                f"{MAX_IMBALANCE:.0e}",
                imbalance,
            )
        return ElementSolution(
            conductance=rate,
            energy=energy,
            potential=np.where(reached, x, np.nan),
            unknowns=unknown.size,
            iterations=found.iterations,
            residual=found.residual,
            imbalance=off / rate if rate > 0 else 0.0,
            solver=found.solver,
        )

    @cached_property
    def _couples(self) -> tuple[Indices, Indices, Array, Indices]:
        """Pairs of nodes that are coupled: both numbers, the couple, the element."""
        parts = []
        for n, (element, number) in enumerate(zip(self.elements, self.numbers, strict=True)):
            a, b = np.nonzero(np.triu(element.couples))
            parts.append((number[a], number[b], element.couples[a, b], np.full(a.size, n)))
        first, second, couple, of = (np.concatenate(part) for part in zip(*parts, strict=True))
        chosen = first != second
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
