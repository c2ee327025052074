"""Structured grids of nodes, and the operator of the flow on them: from the weak form to conductances of neighbours.

scikit-fem evaluates the form on the unit square, once for each sample of the coefficient: `elemental`. All elements of
a grid are stretched unit squares, so that these few local matrices, weighted with the coefficient and the stretch, are
summed to a `Stencil`. It equals scikit-fem's own assembly of the whole mesh, which takes longer than the solver.

A gap is given at pixel centres. On the links between pixels, the midpoints of the edges of the elements, it is
interpolated by a four-point cubic. It is at least a tenth and at most four times the smaller of the two pixels. A link
is therefore open exactly where both its pixels are, and it closes continuously with them, so that a barrier of a
vanishing gap seals. It is far below both pixels only where the gap is curved at both: of the two second differences the
larger one then counts at most four times as much as the smaller one, so that a jump of the gap beyond a pixel hardly
narrows the link.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad

from ..base import Array, Indices, InputError
from ..base.compiled import compiled, inner, over, rows
from . import forms

#: Limits of the interpolated gap over the smaller of its two pixels. On 140 gaps with eight pixels for the shortest
#: wave, in contact or cut by a plane, the upper one changes the median error of the permeability from 5.6e-3 to 5.3e-3.
_LEAST, _MOST = 0.1, 4.0
#: Where the cubic dips below this fraction of the smaller pixel, the larger second difference counts at most so many
#: times as much as the smaller one. The fraction makes the flow through two plates of different gaps exact: the dip
#: beside the jump adds the resistance that the link across the jump lacks.
_DIP, _JUMP = 0.88, 4.0
#: Corners (0, 0), (0, 1), (1, 0), (1, 1) of an element that the edge of each sample joins.
_PAIRS = (0, 2), (1, 3), (0, 1), (2, 3)


@dataclass(frozen=True, eq=False)
class Grid:
    """Elements between m1 + 1 rows and m2 + 1 columns of nodes.

    A periodic or a mirrored side is an identification: the last column of a ring is the first one; the outer line of a
    half element beside a mirror carries the degrees of freedom of its inner line.

    lines1 (m1 + 1,), lines2 (m2 + 1,) : coordinates of the lines of nodes, rising. All conformal coordinates
        will do, since the form is the same in them, such as (ln r, θ) of a ring.
    rows (m1 + 1,), columns (m2 + 1,) : number of the degrees of freedom of each line.
    ring1, ring2 : whether rows and columns form a ring; without ring1 the first row is the inlet, the last the outlet.
    half_ends : the first and last elements are half pixels between an end and the centres of the pixels beside it.
    """

    lines1: Array
    lines2: Array
    rows: Indices
    columns: Indices
    ring1: bool = False
    ring2: bool = True
    half_ends: bool = False

    @staticmethod
    @lru_cache(maxsize=64)
    def of_pixel_centres(shape: tuple[int, int], spacing: tuple[float, float], sides: str) -> Grid:
        """Nodes at the centres of a cell's pixels and on its ends; the same object for the same cell.

        Half elements reach from the ends, and from mirrored sides, to the first nodes.
        """
        (n1, n2), (d1, d2) = shape, spacing
        lines1 = np.concatenate([[0.0], _centres(n1, d1), [n1 * d1]])
        if sides == "periodic":
            return replace(Grid.of_strip(lines1, d2, n2), half_ends=True)
        lines2 = np.concatenate([[0.0], _centres(n2, d2), [n2 * d2]])
        columns = np.clip(np.arange(-1, n2 + 1), 0, n2 - 1)
        return Grid(lines1, lines2, np.arange(n1 + 2), columns, ring2=False, half_ends=True)

    @classmethod
    def of_torus(cls, shape: tuple[int, int], spacing: tuple[float, float]) -> Grid:
        """Nodes at the centres of the pixels of a cell that is periodic along both axes."""
        n1, n2 = shape
        strip = cls.of_strip(_centres(n1 + 1, spacing[0]), spacing[1], n2)
        return replace(strip, rows=strip.rows % n1, ring1=True)

    @classmethod
    def of_strip(cls, lines1: Array, width: float, n2: int) -> Grid:
        """Rows of nodes at given coordinates from the inlet to the outlet, and a ring of n2 columns `width` apart."""
        return cls(lines1, _centres(n2 + 1, width), np.arange(lines1.size), np.arange(n2 + 1) % n2)

    @property
    def elements(self) -> tuple[int, int]:
        """Elements along both axes."""
        return self.lines1.size - 1, self.lines2.size - 1

    @property
    def nodes(self) -> tuple[int, int]:
        """Rows and columns of degrees of freedom."""
        return int(self.rows.max()) + 1, int(self.columns.max()) + 1


def _centres(n: int, spacing: float) -> Array:
    return np.asarray((np.arange(n) + 0.5) * spacing)


@dataclass(frozen=True)
class Stencil:
    """Conductances of neighbouring nodes: minus the entries of a symmetric matrix with zero row sums, in any one unit.

    A conductance c > 0 is that of a link between two nodes, so that a stencil, of five points, is a network of links.

    along (n1, n2) : nodes (i, j) and (i + 1, j) of n1 + 1 rows. Row 0 is the inlet, row n1 the outlet; in a `ring1`
        the rows form a ring, row n1 being row 0.
    across (n1 − 1, m2) : nodes (i, j) and (i, j + 1) of rows 1 … n1 − 1 (in a `ring1` of all n1 rows); m2 is n2 if the
        columns form a ring (`ring2`), else n2 − 1. Nodes of one end have one pressure: their conductances drop out.
    """

    along: Array
    across: Array
    ring2: bool = True
    ring1: bool = False

    @classmethod
    def network(cls, along: ArrayLike, across: ArrayLike, *, ring: bool = True) -> Stencil:
        """A network of links of given conductances, checked.

        along (n1, n2), across (n1 − 1, n2) : conductances >= 0; across has n2 − 1 columns if these form no `ring`.

        Raises InputError: shapes that do not match, conductances that are negative or not finite.
        """
        try:
            if np.iscomplexobj(along) or np.iscomplexobj(across):
                raise TypeError
            c1, c2 = (np.ascontiguousarray(c, dtype=float) for c in (along, across))
        except (TypeError, ValueError):
            raise InputError(
                "along, across",
                "no arrays of real numbers",
                "arrays of shapes (n1, n2) and (n1 - 1, n2)",
            ) from None
        if c1.ndim != 2 or c1.size == 0:
            raise InputError("along", f"shape {c1.shape}", "a shape (n1, n2)")
        expected = (c1.shape[0] - 1, c1.shape[1] - (not ring))
        if c2.shape != expected:
            raise InputError("across", f"shape {c2.shape}", f"shape {expected}")
        for name, c in (("along", c1), ("across", c2)):
            if not (np.isfinite(c).all() and c.min(initial=0.0) >= 0):
                raise InputError(name, "negative or undefined values", "finite conductances >= 0")
        if ring and c1.shape[1] == 1:  # the only node of a row is not its own neighbour
            c2 = np.zeros_like(c2)
        return cls(c1, c2, ring2=ring)

    @property
    def nodes(self) -> tuple[int, int]:
        """Rows and columns of nodes, the ends among the rows."""
        n1, n2 = self.along.shape
        return (n1 if self.ring1 else n1 + 1), n2

    def conductances(
        self,
    ) -> Iterator[tuple[Array, NDArray[np.int64], NDArray[np.int64], tuple[int, int]]]:
        """Arrays of conductances, numbers (row · n2 + column) of their two nodes, and steps from one to the other."""
        rows, n2 = self.nodes
        node = np.arange(rows * n2).reshape(rows, n2)
        below = np.roll(node, -1, axis=0) if self.ring1 else node[1:]
        here = node if self.ring1 else node[:-1]
        inner = node if self.ring1 else node[1:-1]
        m2 = self.across.shape[1]

        yield self.along, here, below, (1, 0)
        yield self.across, inner[:, :m2], np.roll(inner, -1, axis=1)[:, :m2], (0, 1)

    def energy(self, pressure: Array) -> float:
        """Σ c (Δp)² over all conductances for a pressure at the nodes, from differences, so that nothing cancels.

        Rows must not form a ring.
        """
        return float(
            sum(over(rows(*self.along.shape), energy_of, self.along, self.across, pressure))
        )

    def dissipation(self, potential: Array) -> tuple[Array, Array]:
        """Dissipation c (Δφ)² of the conductances along both axes .

        `potential` (n1 + 1, n2) is NaN in pockets, where nothing flows.
        """
        φ = np.nan_to_num(potential)
        across = (np.roll(φ, -1, axis=1) - φ)[1:-1, : self.across.shape[1]]
        return self.along * np.diff(φ, axis=0) ** 2, self.across * across**2

    def to_csr(self) -> sp.csr_array:
        """The matrix of all nodes, those of the ends among them; conductances between nodes of one end are left out."""
        rows, n2 = self.nodes
        size = rows * n2
        parts = [(c.ravel(), a.ravel(), b.ravel()) for c, a, b, _ in self.conductances()]
        c, a, b = (np.concatenate(part) for part in zip(*parts, strict=True))
        chosen = (c != 0) & (a != b)
        c, a, b = c[chosen], a[chosen], b[chosen]
        entries = np.concatenate([-c, -c, c, c])
        i = np.concatenate([a, b, a, b])
        j = np.concatenate([b, a, a, b])
        return sp.coo_array((entries, (i, j)), shape=(size, size)).tocsr()


@compiled()
def energy_of(begin, end, along, across, p):
    """`Stencil.energy` of a pressure p, of some rows of conductances."""
    n2 = along.shape[1]
    m2 = across.shape[1]
    total = 0.0
    for i in range(begin, end):
        here, below = p[i], p[i + 1]
        of_row = 0.0
        for j in range(n2):
            of_row += along[i, j] * (here[j] - below[j]) ** 2
        total += of_row
    for i in range(begin, min(end, across.shape[0])):
        here = p[i + 1]
        of_row = 0.0
        for j in range(n2 - 1):
            of_row += across[i, j] * (here[j] - here[j + 1]) ** 2
        if m2 == n2:
            of_row += across[i, n2 - 1] * (here[n2 - 1] - here[0]) ** 2
        total += of_row
    return total


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


@lru_cache(maxsize=32)
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


def own_conductances(local: Array) -> Array:
    """Conductance of the edge on which each sample lies, of local Q1 matrices (4, 4, 4), which have no other."""
    drops = np.zeros((4, 4))
    for sample, (first, last) in enumerate(_PAIRS):
        drops[sample, [first, last]] = 1.0, -1.0
    own = np.einsum("si,sij,sj->s", drops, local, drops) / 4
    others = local - np.einsum("s,si,sj->sij", own, drops, drops)
    if not np.abs(others).max() <= 1e-12 * np.abs(local).max():
        raise ValueError("the form is no flow that a drop of pressure along the edge drives")
    return own


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
    along = k1 * np.multiply.outer(w.rows1, w.columns1)
    across = k2 * np.multiply.outer(w.rows2, w.columns2)
    return Stencil(along, across, ring1=grid.ring1, ring2=grid.ring2)


class EdgeWeights(NamedTuple):
    """Conductances of the edges along both axes for K = 1: the factor of the row times that of the column."""

    rows1: Array
    columns1: Array
    rows2: Array
    columns2: Array


@lru_cache(maxsize=64)
def edge_weights(grid: Grid) -> EdgeWeights:
    """Weights of the edges of a grid by `forms.darcy_flow`, with quadrature at their midpoints."""
    m1, m2 = grid.elements
    d1, d2 = np.diff(grid.lines1), np.diff(grid.lines2)
    ends = (EDGES_AT_INLET, EDGES_AT_OUTLET) if grid.half_ends else (EDGES, EDGES)
    first, inside, last = (
        own_conductances(elemental(forms.darcy_flow, ElementQuad1, samples))
        for samples in (ends[0], EDGES, ends[1])
    )
    of_rows = np.tile(inside, (m1, 1))
    of_rows[0], of_rows[-1] = first, last
    columns = np.zeros(grid.nodes[1])
    rows = np.zeros(grid.nodes[0])
    for side in (0, 1):  # an edge has an element on either side
        columns += np.bincount(grid.columns[side : m2 + side], d2 * inside[side], columns.size)
        rows += np.bincount(grid.rows[side : m1 + side], d1 * of_rows[:, 2 + side], rows.size)
    # the links of a ring are all there, even that of an only column to itself
    columns2 = 1 / d2[(grid.columns[:-1] != grid.columns[1:]) | grid.ring2]
    if columns2.size == 1 and grid.ring2 and not grid.ring1:
        columns2[:] = 0.0  # what an only column drives around it is nothing
    return EdgeWeights(1 / d1, columns, rows if grid.ring1 else rows[1:-1], columns2)


def gap_on_links(gap: Array, ring1: bool, ring2: bool) -> tuple[Array, Array]:
    """Gap midway between neighbouring pixels along both axes [m].

    Along an axis that forms a ring n pixels have n links, from each to the next; otherwise the first axis has n + 1
    links, one to each end, beyond which the gap is mirrored, and the second n − 1.
    """
    n1, n2 = gap.shape
    on1 = np.empty((n1 if ring1 else n1 + 1, n2))
    on2 = np.empty((n1, n2 if ring2 else n2 - 1))
    over(rows(n1, n2), gap_on_rows, gap, ring1, ring2, on1, on2)
    return on1, on2


@inner()
def _midway(before, a, b, after):
    """Interpolate the gap midway between two pixels a and b from a cubic through them and their outer neighbours.

    The result changes continuously with all four gaps, and is 0 where a or b is 0.
    """
    smaller = min(a, b)
    cubic = (9.0 * (a + b) - (before + after)) / 16.0
    # a jump of the gap beyond one pixel makes one second difference large, and the cubic dip below both pixels
    left = before - 2.0 * a + b
    right = a - 2.0 * b + after
    least = max(min(left, right), 0.0)
    most = min(max(left, right), _JUMP * least)
    limited = 0.5 * (a + b) - (least + most) / 16.0
    middle = max(cubic, min(limited, _DIP * smaller))
    return max(min(middle, _MOST * smaller), _LEAST * smaller)


@inner()
def _inside(i, n, ring):
    """Index of the pixel that stands for i beyond the ends of an axis, which is periodic (`ring`) or mirrored."""
    while i < 0 or i >= n:
        if ring:
            i %= n
        else:
            i = -1 - i if i < 0 else 2 * n - 1 - i
    return i


@compiled()
def gap_on_rows(first, end, gap, ring1, ring2, on1, on2):
    """Write `gap_on_links` of some rows, with the last one those after it along the first axis."""
    n1, n2 = gap.shape
    for i in range(first, on1.shape[0] if end == n1 else end):
        start = i - 1 if ring1 else i - 2
        rows = [_inside(start + k, n1, ring1) for k in range(4)]
        before, a, b, after = gap[rows[0]], gap[rows[1]], gap[rows[2]], gap[rows[3]]
        for j in range(n2):
            on1[i, j] = _midway(before[j], a[j], b[j], after[j])
    for i in range(first, end):
        row = gap[i]
        for j in range(1, n2 - 2):
            on2[i, j] = _midway(row[j - 1], row[j], row[j + 1], row[j + 2])
        for j in (0, n2 - 2, n2 - 1):
            if 0 <= j < on2.shape[1]:
                before = row[_inside(j - 1, n2, ring2)]
                after = row[_inside(j + 2, n2, ring2)]
                on2[i, j] = _midway(before, row[j], row[(j + 1) % n2], after)
