"""Flow through a face whose windows are finite elements, see `superelement`.

The flow through the assembled elements is the least energy in a subspace of the potentials, so that it is an upper
bound of the flow on all pixels. From there iterations between all points of the sides lower it, see `side_points`, and
what they take off estimates the error that is left. Whether anything flows is decided by the open pixels alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from ..base import Array, InputError, Shown, validate
from ..base.threads import number, on_threads
from ..flow.solvers.link_network import beside_sides, components, eliminate
from ..windows.partition import Partition
from .element_mesh import ElementMesh
from .side_points import PointLinks, SidePoints
from .superelement import WindowElement, WindowLinks, validated_face, window_links

#: Largest distance of two nodes on a side, in pixels.
NODE_SPACING = 8
#: Memory that flow through elements needs for each pixel [byte].
ELEMENT_BYTES = 36.0


@dataclass(frozen=True, repr=False)
class ElementFlow(Shown):
    """Flow along x1 through the window elements of a face for a unit drop; exactly 0 where the gap does not percolate.

    permeability : an upper bound of that of all pixels. node_permeability : from the nodes alone, a higher bound.
    error : estimated relative error of the permeability.
    dissipation : of each window (m1, m2); the sum is the conductance k L2/L1.
    row_potential (m1 + 1, n2), column_potential (n1, m2) : potential at the side points across x1, those of inlet and
        outlet among them, and at the side points before each column of windows; NaN where closed and in pockets.
    unknowns : number of nodes that were solved for.
    imbalance, solver : of the system of the nodes, see `femseal.flow.DarcyFlow`.
    """

    permeability: float = field(metadata={"unit": "m^3", "long_name": "permeability, upper bound"})
    node_permeability: float = field(metadata={"unit": "m^3", "long_name": "upper bound from the nodes alone"})
    dissipation: Array = field(metadata={"unit": "m^3", "long_name": "dissipation of windows for a unit drop"})
    row_potential: Array = field(metadata={"unit": "1", "long_name": "potential on sides across x1"}, repr=False)
    column_potential: Array = field(metadata={"unit": "1", "long_name": "potential on sides across x2"}, repr=False)
    percolates: bool
    error: float = field(default=0.0, metadata={"unit": "1", "long_name": "estimated relative error"})
    unknowns: int = 0
    imbalance: float = 0.0
    solver: str = "none"


def element_flow(gap: ArrayLike, partition: Partition, *, node_spacing: int = NODE_SPACING) -> ElementFlow:
    """Solve the flow along x1 through a gap that is periodic along x2, by an element for every window of the face.

    Parameters
    ----------
    gap : (n1, n2) [m]. partition : of the face; the windows are its cells.
    node_spacing : largest distance of two nodes on a side [pixels].

    Raises InputError: a gap that is negative, undefined or of another shape.
    NotConverged : inlet and outlet flow differ by more than 1e-5.
    """
    node_spacing = validate.count("node_spacing", node_spacing)
    h = validated_face(gap, partition)
    # several threads on products of small matrices took ten times as long
    with threadpool_limits(1):
        return _element_flow(h, partition, node_spacing)


def _element_flow(h: Array, partition: Partition, node_spacing: int) -> ElementFlow:
    """Condense every window, solve between the nodes, then between all side points; arguments as in `element_flow`."""
    (m1, m2), (w1, w2), (l1, l2) = partition.cells, partition.window, partition.window_size
    elements, points = [], SidePoints(partition)

    def condensed(links: WindowLinks) -> tuple[WindowElement, PointLinks]:
        element, conductances = WindowElement.with_points(links, node_spacing)
        return element, PointLinks.of(conductances)

    for i in range(m1):
        for j, (element, linked) in enumerate(on_threads(number(), condensed, window_links(h, partition, i))):
            elements.append(element)
            points.add(i, j, linked)
    mesh = ElementMesh.of_face(elements, partition.cells)
    nodes = mesh.solve()
    node, weight, potential = (
        np.zeros((points.count, 2), np.int64),
        np.zeros((points.count, 2)),
        np.full(points.count, np.nan),
    )
    for (i, j), element, of_element in zip(partition.places, elements, mesh.numbers, strict=True):
        at, is_open = points.numbers(i, j), element.node[:, 0] >= 0
        potential[at] = element.at_points(nodes.potential[of_element])
        node[at[is_open]], weight[at[is_open]] = of_element[element.node[is_open]], element.weight[is_open]
    percolates = mesh.percolates
    del elements, element, mesh  # large faces need their memory
    conductance, error, dissipation = nodes.conductance, 0.0, np.zeros(m1 * m2)
    if nodes.factors is not None:
        closed = np.isnan(potential)
        found = points.improved(np.nan_to_num(potential), conductance, node, weight, nodes.factors)
        conductance -= found.saved
        error, potential = found.error / conductance, np.where(closed, np.nan, found.potential)
        # conductances are in single precision, the sum is not
        dissipation = found.dissipation * (conductance / found.dissipation.sum())
    to_permeability = (m1 * l1) / (m2 * l2)
    lines = (m1 + 1) * m2 * w2
    return ElementFlow(
        permeability=to_permeability * conductance,
        node_permeability=to_permeability * nodes.conductance,
        dissipation=dissipation.reshape(m1, m2),
        row_potential=potential[:lines].reshape(m1 + 1, m2 * w2),
        column_potential=potential[lines:].reshape(m1 * w1, m2),
        percolates=percolates,
        error=error,
        unknowns=nodes.unknowns,
        imbalance=nodes.imbalance,
        solver=nodes.solver,
    )


@dataclass(frozen=True, eq=False)
class WindowFlow:
    """Flow inside a window for a unit drop over the face; zeros and NaN where nothing flows.

    potential : at the pixels (w1, w2), NaN in contact and in pockets.
    flux1 (w1 + 1, w2), flux2 (w1, w2 + 1) : flow through the links along x1 and x2, those to the sides included [m³].
    """

    potential: Array = field(metadata={"unit": "1", "long_name": "potential"})
    flux1: Array = field(metadata={"unit": "m^3", "long_name": "flow along x1 for a unit drop"})
    flux2: Array = field(metadata={"unit": "m^3", "long_name": "flow along x2 for a unit drop"})


def window_flow(gap: ArrayLike, partition: Partition, flow: ElementFlow, i: int, j: int) -> WindowFlow:
    """Flow inside the window (i, j) by back substitution, from the potential that `flow` has at its side points.

    Raises InputError: a gap that is negative, undefined or of another shape, a window that does not exist.
    """
    h = validated_face(gap, partition)
    m1, m2 = partition.cells
    if not (0 <= i < m1 and 0 <= j < m2):
        raise InputError("window", (i, j), f"(0 … {m1 - 1}, 0 … {m2 - 1})")
    return _inside(window_links(h, partition, i)[j], _at_sides(flow, partition, i, j))


def face_potential(gap: ArrayLike, partition: Partition, flow: ElementFlow) -> Array:
    """Potential at every pixel (n1, n2) of a face by back substitution in all windows; NaN in contact and in pockets.

    Raises
    ------
    InputError : a gap that is negative, undefined or of another shape.
    """
    h = validated_face(gap, partition)
    potential = np.empty(partition.shape)
    with threadpool_limits(1):
        for i in range(partition.cells[0]):
            for j, links in enumerate(window_links(h, partition, i)):
                inside = _inside(links, _at_sides(flow, partition, i, j))
                partition.cell(potential, i, j)[:] = np.where(partition.cell(h, i, j) > 0, inside.potential, np.nan)
    return potential


def _at_sides(flow: ElementFlow, partition: Partition, i: int, j: int) -> tuple[Array, Array, Array, Array]:
    (_, m2), (w1, w2) = partition.cells, partition.window
    rows, columns = slice(i * w1, (i + 1) * w1), slice(j * w2, (j + 1) * w2)
    return (
        flow.row_potential[i, columns],
        flow.row_potential[i + 1, columns],
        flow.column_potential[rows, j],
        flow.column_potential[rows, (j + 1) % m2],
    )


def _inside(links: WindowLinks, sides: tuple[Array, Array, Array, Array]) -> WindowFlow:
    """Solve a window for given potentials at the points of its four sides, NaN where nothing flows."""
    c1, c2 = links.along, links.across
    w1, w2 = c2.shape[0], c1.shape[1]
    values = np.concatenate(sides)
    known = np.isfinite(values)
    component = components(c1, c2)
    keep = np.isin(component[: w1 * w2], component[w1 * w2 :][known]).reshape(w1, w2)
    if not keep.any():
        return WindowFlow(np.full((w1, w2), np.nan), np.zeros(c1.shape), np.zeros(c2.shape))
    low = float(values[known].min())
    size = float(np.ptp(values[known])) or 1.0
    # a side point of a potential p between 0 and 1 acts as the inlet with the weight p and as the outlet with 1 − p
    link = np.concatenate([c1[0], c1[-1], c2[:, 0], c2[:, -1]])
    at_sides = np.flatnonzero((link > 0) & known)
    fraction = (values[at_sides] - low) / size
    node, end = np.tile(beside_sides(w1, w2)[at_sides], 2), np.repeat([0, 1], at_sides.size)
    links_to_ends = np.concatenate([link[at_sides] * fraction, link[at_sides] * (1 - fraction)])
    inner = np.ascontiguousarray(c2[:, 1:-1])
    _, high, _ = eliminate(np.ascontiguousarray(c1), inner, keep, False, node, end, links_to_ends)
    potential = np.where(keep, low + size * high, np.nan)
    before, after, left, right = sides
    drop1 = -np.diff(np.vstack([before, potential, after]), axis=0)
    drop2 = -np.diff(np.column_stack([left, potential, right]), axis=1)
    return WindowFlow(potential, c1 * np.nan_to_num(drop1), c2 * np.nan_to_num(drop2))
