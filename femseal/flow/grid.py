"""Networks of links on a grid of nodes: the fast path of the flow, which needs no mesh.

A bilinear element whose form is integrated at the midpoints of its edges is a network of four links, one on each edge
(`edge_conductances`). All elements between the pixels of a cell are stretched unit squares, so that their operator is a
network of five points, the `Stencil`: the permeability on a link times its weight (`link_weights`). It equals the
operator that `flow.plain` assembles on a mesh.

A gap is given at pixel centres. On the links between pixels it is interpolated by a four-point cubic (`gap_on_links`).
It is at least a tenth and at most four times the smaller of the two pixels. A link is therefore open exactly where both
its pixels are, and it closes continuously with them, so that a barrier of a vanishing gap seals. It is far below both
pixels only where the gap is curved at both: of the two second differences the larger one then counts at most four times
as much as the smaller one, so that a jump of the gap beyond a pixel hardly narrows the link.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from skfem import Basis, ElementQuad1, MeshQuad

from ..base import Array, InputError, Pair
from ..base.compiled import compiled, inner, over, rows
from . import forms

#: Limits of the interpolated gap over the smaller of its two pixels. On 140 gaps with eight pixels for the shortest
#: wave, in contact or cut by a plane, the upper one changes the median error of the permeability from 5.6e-3 to 5.3e-3.
_LEAST, _MOST = 0.1, 4.0
#: Where the cubic dips below this fraction of the smaller pixel, the larger second difference counts at most so many
#: times as much as the smaller one. The fraction makes the flow through two plates of different gaps exact: the dip
#: beside the jump adds the resistance that the link across the jump lacks.
_DIP, _JUMP = 0.88, 4.0


@dataclass(frozen=True)
class Stencil:
    """A network of links between neighbouring nodes of a grid, by the conductances of the links in any unit.

    Its matrix is symmetric and has five entries in a row, which sum to zero: minus the conductances of four links, and
    their sum on the diagonal.

    Attributes
    ----------
    along : array (n1, n2), conductances between the nodes (i, j) and (i + 1, j) of n1 + 1 rows. Row 0 is the inlet and
        row n1 the outlet; with `ring1` the rows form a ring, in which row n1 is row 0.
    across : array (n1 − 1, m2), conductances between the nodes (i, j) and (i, j + 1) of the rows 1 to n1 − 1, with
        `ring1` of all n1 rows. m2 is n2 with `ring2`, else n2 − 1. Links between nodes of one end carry no flow and are
        left out.
    ring2 : whether the columns form a ring, in which the last column is next to the first one.
    ring1 : whether the rows form a ring; there is no inlet and no outlet then.
    """

    along: Array
    across: Array
    ring2: bool = True
    ring1: bool = False

    @classmethod
    def network(cls, along: ArrayLike, across: ArrayLike, *, ring: bool = True) -> Stencil:
        """Make a network of links from conductances, and check them.

        Parameters
        ----------
        along : array (n1, n2), conductances >= 0.
        across : array (n1 − 1, n2), or with n2 − 1 columns without `ring`, conductances >= 0.
        ring : whether the columns form a ring.

        Raises
        ------
        InputError : shapes that do not match, conductances that are negative or not finite.
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
        """Numbers of rows, with both ends, and of columns of nodes."""
        n1, n2 = self.along.shape
        return (n1 if self.ring1 else n1 + 1), n2

    def conductances(
        self,
    ) -> Iterator[tuple[Array, NDArray[np.int64], NDArray[np.int64], tuple[int, int]]]:
        """Yield the links along each axis: conductances, numbers (row · n2 + column) of both nodes, and the step."""
        rows, n2 = self.nodes
        node = np.arange(rows * n2).reshape(rows, n2)
        below = np.roll(node, -1, axis=0) if self.ring1 else node[1:]
        here = node if self.ring1 else node[:-1]
        inner = node if self.ring1 else node[1:-1]
        m2 = self.across.shape[1]

        yield self.along, here, below, (1, 0)
        yield self.across, inner[:, :m2], np.roll(inner, -1, axis=1)[:, :m2], (0, 1)

    def energy(self, pressure: Array) -> float:
        """Return the energy Σ c (Δp)² of a pressure at the nodes; rows must not form a ring.

        It is a sum of positive terms, so that it keeps its relative accuracy.
        """
        return float(
            sum(over(rows(*self.along.shape), energy_of, self.along, self.across, pressure))
        )

    def dissipation(self, potential: Array) -> tuple[Array, Array]:
        """Return the dissipation c (Δφ)² of the links along both axes.

        potential : array (n1 + 1, n2), NaN in pockets, where nothing flows.
        """
        φ = np.nan_to_num(potential)
        across = (np.roll(φ, -1, axis=1) - φ)[1:-1, : self.across.shape[1]]
        return self.along * np.diff(φ, axis=0) ** 2, self.across * across**2

    def to_csr(self) -> sp.csr_array:
        """Return the matrix of all nodes, with those of both ends."""
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
    """Return the part of `Stencil.energy` of some rows of links, for a pressure p at the nodes."""
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


@lru_cache(maxsize=1)
def edge_conductances() -> Pair:
    """Return the conductances of an edge along x1 and of an edge along x2 of the unit square with K = 1.

    scikit-fem evaluates `forms.darcy_flow` on one bilinear element with quadrature at the midpoints of its edges, where
    K has the component along the edge alone. Each edge is then a link between its two corners.

    Raises
    ------
    ValueError : the form joins corners that have no edge in common, or is not driven by differences of the pressure.
    """
    basis = Basis(MeshQuad(), ElementQuad1(), quadrature=forms.EDGE_MIDPOINTS)
    k = np.zeros((2, 2, 1, 4))
    k[0, 0, 0, :2] = k[1, 1, 0, 2:] = 1.0
    matrix = forms.darcy_flow.assemble(basis, k=k).toarray()
    along, across = -matrix[0, 1], -matrix[1, 2]
    links = np.zeros((4, 4))
    for a, b, c in ((0, 1, along), (3, 2, along), (1, 2, across), (0, 3, across)):
        links[[a, b], [a, b]] += c
        links[[a, b], [b, a]] -= c
    if not np.allclose(matrix, links, rtol=0, atol=1e-12 * np.abs(matrix).max()):
        raise ValueError("the form is no flow that a drop of pressure along the edge drives")
    return float(along), float(across)


class LinkWeights(NamedTuple):
    """Conductances of the links between pixels with K = 1: along x1 inside a cell and at its ends, and along x2."""

    along: float
    at_ends: float
    across: float


def link_weights(spacing: Pair) -> LinkWeights:
    """Return the conductances of the links of a cell whose pixels have sides `spacing`, with K = 1.

    scikit-fem supplies the conductances of an element. The rest is geometry: two elements lie on either side of a link,
    and an element of d1 × d2 conducts d2/d1 times as much along x1 as a square. Links to an end are half as long.
    Elements beside a mirror and at an end are half as broad, and count twice.
    """
    d1, d2 = spacing
    along, across = edge_conductances()
    return LinkWeights(2 * along * d2 / d1, 4 * along * d2 / d1, 2 * across * d1 / d2)


def gap_on_links(gap: Array, ring1: bool, ring2: bool) -> tuple[Array, Array]:
    """Interpolate the gap midway between neighbouring pixels along both axes [m].

    Along an axis that forms a ring, n pixels have n links, from each to the next. Otherwise the first axis has n + 1
    links, with one to each end, beyond which the gap is mirrored, and the second axis has n − 1.
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
