"""From the weak form to the operator of a structured grid.

scikit-fem evaluates the form on the unit square, once for each sample of the coefficient: `elemental`. All elements of
a grid are stretched unit squares, so that these few local matrices, weighted with the coefficient and the stretch, are
summed to a `Stencil`. It equals scikit-fem's own assembly of the whole mesh, which takes longer than the solver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad

from ..base.arrays import Array
from ..base.compiled import compiled
from . import forms
from .grid import Grid
from .stencil import Stencil


@dataclass(frozen=True)
class Sample:
    """A point (ξ1, ξ2) of the unit square at which the coefficient along an axis is taken, and its weight."""

    point: tuple[float, float]
    weight: float
    axis: int


def _edges(first: float, last: float) -> tuple[Sample, ...]:
    """Edge midpoints: K11 on both edges along x1, K22 on the two along x2 with the weights given."""
    along = [Sample((0.5, side), 0.5, 0) for side in (0.0, 1.0)]
    return (*along, Sample((0.0, 0.5), first, 1), Sample((1.0, 0.5), last, 1))


#: With these samples, Q1 joins no nodes across corners: every sample joins the two nodes of its own edge.
EDGES = _edges(0.5, 0.5)
#: Half elements at the ends take K22 at the row of pixel centres only; along an end the pressure is constant.
EDGES_AT_INLET, EDGES_AT_OUTLET = _edges(0.0, 1.0), _edges(1.0, 0.0)
#: Corners (0, 0), (0, 1), (1, 0), (1, 1) of an element that each of its six conductances joins.
_PAIRS = ((0, 2), (1, 3), (0, 1), (2, 3), (0, 3), (1, 2))


def elemental(
    form: BilinearForm, element: type, samples: tuple[Sample, ...], coefficient: str = "k"
) -> Array:
    """Local matrices of a form on the unit square, one for each sample, from scikit-fem.

    form : bilinear form whose coefficient, a tensor of the name `coefficient`, is 1 along the axis of the sample.
    element : class of a scikit-fem element of quadrilaterals.
    samples : where the coefficient is taken.

    Returns (samples, n, n), the n degrees of freedom in the order of their coordinates: Q1 corners as (0, 0), (0, 1),
    (1, 0), (1, 1); RT0 facets as ξ1 = 0, ξ2 = 0, ξ2 = 1, ξ1 = 1. On a rectangle Δ1 × Δ2 the matrix of axis a is
    Δ1Δ2/Δa² times as large for gradients, Δa²/Δ1Δ2 times for total fluxes through the facets.
    """
    return _elemental(form, form.form, element, samples, coefficient)


@lru_cache(maxsize=32)
def _elemental(
    form: BilinearForm,
    _: Callable[..., Any],
    element: type,
    samples: tuple[Sample, ...],
    coefficient: str,
) -> Array:
    """The cache key has the form and its function, so that a changed form is evaluated again."""
    square = MeshQuad()  # the unit square, its first axis x1
    matrices = []
    for s in samples:
        basis = Basis(
            square, element(), quadrature=(np.array(s.point)[:, None], np.array([s.weight]))
        )
        tensor = np.zeros((2, 2, 1, 1))
        tensor[s.axis, s.axis] = 1.0
        order = np.lexsort(basis.doflocs[::-1])
        matrices.append(
            form.assemble(basis, **{coefficient: tensor}).toarray()[np.ix_(order, order)]
        )
    local = np.array(matrices)
    local.flags.writeable = False
    return local


def conductances_of(local: Array) -> Array:
    """Conductances (…, 6) of local Q1 matrices (…, 4, 4), minus their entries off the diagonal; row sums must be 0."""
    size = float(np.abs(local).max())
    if not np.abs(local.sum(axis=-1)).max() <= 1e-12 * size:
        raise ValueError(
            "the form has local matrices whose rows do not add up to 0: it is no flow of a pressure drop"
        )
    return np.stack([-(local[..., a, b] + local[..., b, a]) / 2 for a, b in _PAIRS], axis=-1)


def assemble_on_links(grid: Grid, k1: Array, k2: Array) -> Stencil:
    """Operator ∫ K∇p·∇q of Q1 with quadrature at the midpoints of edges: a five-point stencil.

    grid : of the nodes.
    k1, k2 : permeability on the edges along x1, (m1, n2), and on those along x2 between different nodes of the rows
    that are no end, for instance (m1 − 1, n2) on a strip [m³].

    Notes
    -----
    The elements on both sides of an edge have the same K there, so their parts are summed before they are weighted.
    """
    w = edge_weights(grid)
    along, across = np.empty(k1.shape), np.empty(k2.shape)
    weighted(0, len(k1), k1, w.rows1, w.columns1, w.kinds1, along)
    weighted(0, len(k2), k2, w.rows2, w.columns2, w.kinds2, across)
    return Stencil(along, across, ring1=grid.ring1, ring2=grid.ring2)


class EdgeWeights(NamedTuple):
    """Factors of the conductances of edges for K = 1: that of the row, times that of the column for the row's kind."""

    rows1: Array
    columns1: Array
    kinds1: NDArray[np.int64]
    rows2: Array
    columns2: Array
    kinds2: NDArray[np.int64]


def edge_weights(grid: Grid) -> EdgeWeights:
    """Weights of the edges of a grid by `forms.darcy_flow`, with quadrature at their midpoints."""
    return _edge_weights(grid, forms.darcy_flow, forms.darcy_flow.form)


@lru_cache(maxsize=64)
def _edge_weights(grid: Grid, form: BilinearForm, _: Callable[..., Any]) -> EdgeWeights:
    """The weights of a form; the cache key has the form and its function, so that a changed form is evaluated again."""
    m1, m2 = grid.elements
    d1, d2 = np.diff(grid.lines1), np.diff(grid.lines2)
    quadratures = (EDGES_AT_INLET, EDGES, EDGES_AT_OUTLET) if grid.half_ends else (EDGES,) * 3
    conductances = np.array(
        [_own_conductances(elemental(form, ElementQuad1, samples)) for samples in quadratures]
    )
    kinds = np.ones(m1, np.int64)
    kinds[0], kinds[-1] = 0, 2
    columns, rows = np.zeros((3, grid.nodes[1])), np.zeros(grid.nodes[0])
    for side in (0, 1):  # an edge has an element on either side
        for kind in range(3):
            columns[kind] += np.bincount(
                grid.columns[side : m2 + side], d2 * conductances[kind, side], grid.nodes[1]
            )
        rows += np.bincount(
            grid.rows[side : m1 + side], d1 * conductances[kinds, 2 + side], grid.nodes[0]
        )
    inner = rows if grid.ring1 else rows[1:-1]
    # the links of a ring are all there, even that of an only column to itself
    apart = (grid.columns[:-1] != grid.columns[1:]) | grid.ring2
    columns2 = (1 / d2[apart])[None]
    if (
        columns2.size == 1 and grid.ring2 and not grid.ring1
    ):  # what an only column drives around it is nothing
        columns2[:] = 0.0
    return EdgeWeights(1 / d1, columns, kinds, inner, columns2, np.zeros(inner.size, np.int64))


def _own_conductances(local: Array) -> Array:
    """Conductance of the edge on which each sample lies; a sample must have no other."""
    conductances = conductances_of(local)
    own = conductances[[0, 1, 2, 3], [0, 1, 2, 3]]
    conductances[[0, 1, 2, 3], [0, 1, 2, 3]] = 0.0
    if np.any(conductances):
        raise ValueError(
            "the form joins nodes beyond the edge at whose midpoint its coefficient is taken"
        )
    return own


@compiled()
def weighted(first, end, k, by_row, by_column, kind, out):
    """Write some rows of k times the weight of the row and, by the kind of the row, of the column."""
    for i in range(first, end):
        of_row, of_column = by_row[i], by_column[kind[i]]
        for j in range(k.shape[1]):
            out[i, j] = k[i, j] * (of_row * of_column[j])
