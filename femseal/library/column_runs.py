"""Runs of neighbouring columns of windows, whose sides inside match, as pieces of a long seal.

In a chain of runs the sides that meet do not match. Its flow is least if nothing flows through these cuts (Neumann),
and at most what flows if all of them have one profile of the potential from inlet to outlet (Dirichlet), as the energy
of any potential is more than the least. Both are sums over the runs. The profile is the mean over the uncut face, whose
flow lies between both as well and says where: see `RunFlows.weight`.
Source: Huet, J. Mech. Phys. Solids 38, 1990, 813 (bounds from pieces with both kinds of boundary).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Indices, InputError, counted, validate
from ..elements.element_mesh import ElementMesh, ElementSolution, mesh_factors
from ..elements.elements import NODE_SPACING
from ..elements.superelement import WindowElement, WindowLinks, validated_face, window_links
from ..windows import Partition, SolverCounts

#: Places at which runs start, for each run that the face has without overlap.
STARTS = 2


@dataclass(frozen=True, eq=False)
class RunFlows:
    """Flow through runs of a face for a unit drop at one state [m³].

    length : columns of a run. independent : number of runs that the face has without overlap.
    starts (runs,) : first column of each run.
    neumann (runs,), dirichlet (runs,) : conductance with no flow through the cuts, and with the profile along them.
    whole : conductance of the uncut face over as many columns as a run has.
    solvers : number of systems by solver.
    """

    length: int
    independent: int
    starts: Indices
    neumann: Array
    dirichlet: Array
    whole: float
    solvers: SolverCounts

    @property
    def weight(self) -> float:
        """Fraction of the way from Neumann to Dirichlet cuts at which the runs have the mean of the uncut face."""
        low, high = float(self.neumann.mean()), float(self.dirichlet.mean())
        return float(np.clip((self.whole - low) / (high - low), 0.0, 1.0)) if high > low else 0.0

    @property
    def value(self) -> Array:
        """Conductance of each run (runs,), between both kinds of cuts, with the mean of the uncut face."""
        return self.neumann + self.weight * (self.dirichlet - self.neumann)

    @property
    def cut_error(self) -> float:
        """Half the distance of ln(conductance) between both kinds of cuts; inf if Neumann cuts leave no flow."""
        low, high = float(self.neumann.mean()), float(self.dirichlet.mean())
        return float(0.5 * np.log(high / low)) if low > 0 else np.inf if high > 0 else 0.0

    @property
    def scatter(self) -> float:
        """Standard error of the mean of ln(conductance), from the runs that do not overlap; inf for a single one."""
        mean = float(self.value.mean())
        if self.independent < 2:
            return np.inf
        # runs of a face scatter about its own mean
        return float(self.value.std()) / mean / np.sqrt(self.independent - 1) if mean > 0 else 0.0


@dataclass(frozen=True, eq=False)
class ColumnRuns:
    """The windows of a face as elements, of which runs of neighbouring columns are solved.

    elements, links : of every window, row after row. mesh, face : the uncut face, periodic along x2, and its flow.
    """

    partition: Partition
    elements: list[WindowElement]
    links: list[WindowLinks]
    mesh: ElementMesh
    face: ElementSolution

    @classmethod
    def of(cls, gap: ArrayLike, partition: Partition, *, node_spacing: int = NODE_SPACING) -> ColumnRuns:
        """Condense the windows of a face, and solve the flow through it.

        gap : (n1, n2) [m]. partition : of the face.
        node_spacing : largest distance of two nodes on a side [pixels].

        Raises InputError: a gap that is negative, undefined or of another shape.
        NotConverged : see `element_mesh.ElementMesh.solve`.
        """
        h = validated_face(gap, partition)
        links = [link for row in range(partition.cells[0]) for link in window_links(h, partition, row)]
        elements = [WindowElement.of(link, node_spacing) for link in links]
        mesh = ElementMesh.of_face(elements, partition.cells)
        return cls(partition, elements, links, mesh, mesh.solve())

    def flows(self, length: int) -> RunFlows:
        """Flow through runs of so many columns, which start at places all along the face.

        Raises InputError: more columns than the face has.
        NotConverged : see `element_mesh.ElementMesh.solve`.
        """
        m1, m2 = self.partition.cells
        length = validate.count("length", length)
        if length > m2:
            raise InputError("length", length, f"at most {counted(m2, 'column')}, as the face has")
        independent = m2 // length
        starts = np.unique(np.linspace(0, m2, min(m2, STARTS * independent), endpoint=False).astype(int))
        neumann, dirichlet = [], []
        if self.face.conductance > 0:
            profile = _profile(self.mesh, self.face.potential, self.links, self.partition)
            for start in starts:
                chosen = [self.elements[i * m2 + (start + j) % m2] for i in range(m1) for j in range(length)]
                run = ElementMesh.of_face(chosen, (m1, length), ring=False)
                neumann.append(run.solve())
                nodes, row = _on_cuts(run, self.partition, length)
                dirichlet.append(run.solve_dirichlet(nodes, profile[row]))
        return RunFlows(
            length=length,
            independent=independent,
            starts=starts,
            neumann=np.array([run.conductance for run in neumann] or np.zeros(starts.size)),
            dirichlet=np.array([run.conductance for run in dirichlet] or np.zeros(starts.size)),
            whole=self.face.conductance * length / m2,
            solvers=SolverCounts.total(SolverCounts.of(s) for s in (*neumann, *dirichlet)),
        )

    def window_permeability(self) -> Array:
        """Permeability of every window along x1 (m1, m2) [m³], its sides across x2 closed."""
        (l1, l2), w2 = self.partition.window_size, self.partition.window[1]
        k = np.zeros(self.partition.cells)
        for place, element in zip(self.partition.places, self.elements, strict=True):
            k[place] = _through(element, w2) * l1 / l2
        return k

    def window_potential(self) -> Array:
        """Potential in every window (m1, m2), the mean over its open side points; NaN where pockets or contact fill it.

        It is that in the uncut face for a unit drop.
        """
        mean = np.full(self.partition.cells, np.nan)
        for place, element, number in zip(self.partition.places, self.elements, self.mesh.numbers, strict=True):
            values = element.at_points(self.face.potential[number])
            if np.isfinite(values).any():
                mean[place] = np.nanmean(values)
        return mean

    def window_flux(self) -> Array:
        """Flow per width through every window of the uncut face along x1 and x2 (m1, m2, 2) [m²] for a unit drop.

        Along each axis it is the mean over the two sides across it.
        """
        if not self.face.flow.size:
            return np.zeros((*self.partition.cells, 2))
        through = self.face.flow.reshape(*self.partition.cells, 2, 2)
        return 0.5 * (through[..., 0] - through[..., 1]) / np.array(self.partition.window_size[::-1])


def _profile(face: ElementMesh, potential: Array, links: list[WindowLinks], partition: Partition) -> Array:
    """Mean potential over x2 of the points on the sides before all columns (n1,), weighted with their conductance."""
    w1, w2 = partition.window
    before = slice(2 * w2, 2 * w2 + w1)
    at_points = [e.at_points(potential[n])[before] for e, n in zip(face.elements, face.numbers, strict=True)]
    # rows of windows, columns, rows of pixels
    values = np.reshape(at_points, (*partition.cells, w1))
    weight = np.where(np.isfinite(values), np.reshape([link.across[:, 0] for link in links], values.shape), 0.0)
    total = weight.sum(axis=1).ravel()
    rows = np.flatnonzero(total)
    mean = (weight * np.nan_to_num(values)).sum(axis=1).ravel()[rows] / total[rows]
    n1 = partition.shape[0]
    return np.interp(np.arange(n1) + 0.5, np.r_[0.0, rows + 0.5, n1], np.r_[1.0, mean, 0.0])


def _through(element: WindowElement, w2: int) -> float:
    """Conductance of a window between its sides across x1, those across x2 closed [m³]."""
    is_open = element.node[:, 0] >= 0
    first, last = (np.unique(element.component[side][is_open[side]]) for side in (np.s_[:w2], np.s_[w2 : 2 * w2]))
    if not np.intersect1d(first, last).size:
        return 0.0
    nodes, (before, after) = np.arange(len(element.conductances)), element.counts[:2]
    dirichlet = nodes[: before + after]
    factors = mesh_factors([element.conductances], [nodes], (1, 1), dirichlet, nodes.size)
    potential = factors.dirichlet((dirichlet < before).astype(float))
    return float(0.5 * (element.conductances * (potential[:, None] - potential) ** 2).sum())


def _on_cuts(run: ElementMesh, partition: Partition, length: int) -> tuple[Indices, Indices]:
    """Nodes on both cuts of a run, and the row of pixels at which each of them lies."""
    nodes, rows = [], []
    for n, (element, number) in enumerate(zip(run.elements, run.numbers, strict=True)):
        row, column = divmod(n, length)
        on_cut = ((element.side == 2) & (column == 0)) | ((element.side == 3) & (column == length - 1))
        nodes.append(number[on_cut])
        rows.append(row * partition.window[0] + element.place[on_cut])
    return np.concatenate(nodes), np.concatenate(rows)
