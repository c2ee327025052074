"""Represent the flow operator on a grid by a network of links between nodes: the fast implementation without a mesh.

The weak form is integrated at the midpoints of the element edges. A bilinear element is therefore equivalent to four
links, one along each edge (`edge_conductances`). All elements between the pixels of a cell are rectangles, so that the
assembled operator is a five-point stencil (`Stencil`). The conductance of a link is the permeability at the middle of
the link times a geometric weight (`link_weights`). The operator of the network is equal to the matrix that `flow.plain`
assembles on a mesh.

The gap is given at the pixel centres. A cubic polynomial through four pixels interpolates the gap at the middle of each
link (`gap_on_links`). The interpolated gap is limited to the range from 0.1 to 4 times the smaller of the gaps at the
two ends of the link. A link is therefore open if and only if the pixels at its two ends are open. If the gap at one end
of a link tends to 0, the interpolated gap of the link tends to 0 as well. Pixels with a vanishing gap therefore stop
the flow.

The interpolated gap falls far below the gaps at both ends of a link only if the gap is strongly curved at both ends. If
the second differences of the gap at the two ends are very different, the larger second difference is reduced to at most
four times the smaller one. A jump of the gap between one end of a link and the next pixel therefore hardly narrows the
link.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from skfem import Basis, ElementQuad1, MeshQuad

from ..base import Array, Indices, InputError, Pair
from ..base.compiled import compiled, inner, over, rows
from . import forms

#: Limits of the ratio of the interpolated gap of a link to the smaller of the gaps at the two ends of the link. On 140
#: gaps with eight pixels for the shortest wave, in contact or cut by a plane, the upper limit changes the median error
#: of the permeability from 5.6e-3 to 5.3e-3.
_LEAST, _MOST = 0.1, 4.0
#: If the cubic is below the first number times the smaller adjacent gap, the larger second difference is limited to the
#: second number times the smaller one. With 0.88 the flow between plates with a step in the gap is exact: the reduced
#: gap beside the step adds the resistance that the link across the step lacks.
_DIP, _JUMP = 0.88, 4.0


@dataclass(frozen=True)
class Stencil:
    """A network of links between neighbouring nodes of a grid.

    Conductances may have any unit. The matrix of the network is symmetric. The row of a node has five entries: the
    negative conductances of its four links, and the sum of these conductances on the diagonal.

    Attributes
    ----------
    along : array (n1, n2), conductances of the links between the nodes (i, j) and (i + 1, j). The network has n1 + 1
        rows of nodes; row 0 is the inlet and row n1 the outlet.
    across : array (n1 − 1, m2), conductances of the links between the nodes (i, j) and (i, j + 1) in the rows
        i = 1 to n1 − 1. Links within the inlet or the outlet carry no flow and are left out. If the columns form a ring
        (`ring2`), m2 is n2; without a ring, m2 is n2 − 1.
    ring2 : whether the columns form a ring, in which the last column is linked to the first column.

    The arrays are not copied. Functions whose names end in `_in_place` change them.
    """

    along: Array
    across: Array
    ring2: bool = True

    @classmethod
    def network(cls, along: ArrayLike, across: ArrayLike, *, ring: bool = True) -> Stencil:
        """Make a network of links from given conductances, and check the conductances.

        Parameters
        ----------
        along : array (n1, n2), conductances >= 0, see `Stencil`.
        across : conductances >= 0, array (n1 − 1, n2) if the columns form a ring, and (n1 − 1, n2 − 1) otherwise.
        ring : whether the columns form a ring.

        Raises
        ------
        InputError : the shapes do not match, or a conductance is negative or not finite.
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
        """Number of rows of nodes, including inlet and outlet, and number of columns."""
        n1, n2 = self.along.shape
        return n1 + 1, n2

    def energy(self, pressure: Array) -> float:
        """Compute the energy Σ c (Δp)² of a pressure at the nodes.

        All terms of the sum are >= 0, so that the relative rounding error of the sum is small.
        """
        return float(
            sum(over(rows(*self.along.shape), energy_of, self.along, self.across, pressure))
        )

    def dissipation(self, potential: Array) -> tuple[Array, Array]:
        """Compute the dissipation c (Δφ)² in the links of `along` and in the links of `across`.

        potential : array (n1 + 1, n2), φ at the nodes; NaN in pockets, where nothing flows.

        Returns
        -------
        Array in the shape of `along`, and array in the shape of `across`.
        """
        φ = np.nan_to_num(potential)
        drop_along = np.diff(φ, axis=0)
        drop_across = (np.roll(φ, -1, axis=1) - φ)[1:-1, : self.across.shape[1]]
        return self.along * drop_along**2, self.across * drop_across**2

    def to_csr(self) -> sp.csr_array:
        """Assemble the sparse matrix of all nodes, including inlet and outlet.

        The node in row i and column j has the number i n2 + j.
        """
        node = np.arange(np.prod(self.nodes)).reshape(self.nodes)
        m2 = self.across.shape[1]
        inside = node[1:-1]
        conductance = np.concatenate([self.along.ravel(), self.across.ravel()])
        start = np.concatenate([node[:-1].ravel(), inside[:, :m2].ravel()])
        end = np.concatenate([node[1:].ravel(), np.roll(inside, -1, axis=1)[:, :m2].ravel()])
        return network_matrix(conductance, start, end, node.size)


def network_matrix(conductance: Array, start: Indices, end: Indices, nodes: int) -> sp.csr_array:
    """Assemble the symmetric matrix (nodes, nodes) of a network of links.

    conductance, start, end : arrays (links,), conductance and the two nodes of each link. A closed link, or a link from
        a node to itself, has no effect.
    """
    chosen = (conductance != 0) & (start != end)
    c, a, b = conductance[chosen], start[chosen], end[chosen]
    # each link (a, b) has two entries beside the diagonal and contributes to the diagonal of both its nodes
    entries = np.concatenate([-c, -c, c, c])
    i = np.concatenate([a, b, a, b])
    j = np.concatenate([b, a, a, b])
    return sp.coo_array((entries, (i, j)), shape=(nodes, nodes)).tocsr()


@compiled()
def energy_of(begin, end, along, across, p):
    """Compute the contribution of some rows of links to the energy Σ c (Δp)², see `Stencil.energy`.

    begin, end : the rows of links are `begin` to `end` − 1.
    p : array (n1 + 1, n2), pressure at the nodes.
    """
    n2 = along.shape[1]
    m2 = across.shape[1]
    total = 0.0
    for i in range(begin, end):
        here, below = p[i], p[i + 1]
        row_energy = 0.0
        for j in range(n2):
            row_energy += along[i, j] * (here[j] - below[j]) ** 2
        total += row_energy
    for i in range(begin, min(end, across.shape[0])):
        here = p[i + 1]  # the first row of `across` belongs to the row of nodes after the inlet
        row_energy = 0.0
        for j in range(n2 - 1):
            row_energy += across[i, j] * (here[j] - here[j + 1]) ** 2
        if m2 == n2:
            row_energy += across[i, n2 - 1] * (here[n2 - 1] - here[0]) ** 2
        total += row_energy
    return total


@lru_cache(maxsize=1)
def edge_conductances() -> Pair:
    """Compute the conductances of an edge along x1 and of an edge along x2 of the unit square for K = 1.

    scikit-fem evaluates `forms.darcy_flow` on one bilinear element with quadrature at the midpoints of its edges. At
    the midpoint of an edge along x1, K11 is 1; at the midpoint of an edge along x2, K22 is 1; all other components of K
    are 0. Each edge is therefore equivalent to a link between the two corners of the edge.

    Raises
    ------
    ValueError : the form couples corners that do not share an edge, or a constant pressure causes a flow.
    """
    basis = Basis(MeshQuad(), ElementQuad1(), quadrature=forms.EDGE_MIDPOINTS)
    k = np.zeros((2, 2, 1, 4))  # (component, component, element, edge)
    k[0, 0, 0, :2] = 1.0  # K11 at the midpoints of the edges along x1
    k[1, 1, 0, 2:] = 1.0  # K22 at the midpoints of the edges along x2
    matrix = forms.darcy_flow.assemble(basis, k=k).toarray()
    along = -matrix[0, 1]
    across = -matrix[1, 2]
    # matrix of the four links, with the corners numbered anticlockwise
    links = np.zeros((4, 4))
    for a, b, c in ((0, 1, along), (3, 2, along), (1, 2, across), (0, 3, across)):
        links[[a, b], [a, b]] += c
        links[[a, b], [b, a]] -= c
    if not np.allclose(matrix, links, rtol=0, atol=1e-12 * np.abs(matrix).max()):
        raise ValueError(
            "the form does not describe a flow: its element matrix must be the matrix of a network with one "
            "conductance for each edge of the element"
        )
    return float(along), float(across)


class LinkWeights(NamedTuple):
    """Geometric weights of the links of a cell: the conductances of the links for K = 1.

    along : conductance of a link along x1 between two pixels.
    at_ends : conductance of a link along x1 from a pixel to the inlet or to the outlet.
    across : conductance of a link along x2 between two pixels.
    """

    along: float
    at_ends: float
    across: float


def link_weights(spacing: Pair) -> LinkWeights:
    """Compute the conductances of the links of a cell for K = 1.

    `edge_conductances` gives the conductance of the edges of a square element. An edge along x1 of a rectangle d1 × d2
    has d2/d1 times the conductance of the edge of a square. Two elements share each edge, so that the conductance of a
    link is twice the conductance of an edge. A link to the inlet or the outlet has half the length of a link between
    two pixels, and therefore twice the conductance.

    spacing : lengths d1 and d2 of a pixel along x1 and x2.
    """
    d1, d2 = spacing
    along, across = edge_conductances()
    return LinkWeights(
        along=2 * along * d2 / d1, at_ends=4 * along * d2 / d1, across=2 * across * d1 / d2
    )


def gap_on_links(gap: Array, ring1: bool, ring2: bool) -> tuple[Array, Array]:
    """Interpolate the gap [m] midway between neighbouring pixels, for the links along both axes.

    Parameters
    ----------
    gap : array (n1, n2), gap at the pixels [m].
    ring1, ring2 : whether the gap is periodic along the first axis, and along the second axis. Along an axis that is
        not periodic, the gap is continued by its mirror image.

    Returns
    -------
    Gaps on the links along the first axis, and gaps on the links along the second axis. Along a periodic axis, the
    array has the shape (n1, n2). Without `ring1`, the first array has the shape (n1 + 1, n2), because it includes the
    links to the inlet and the outlet. Without `ring2`, the second array has the shape (n1, n2 − 1).
    """
    n1, n2 = gap.shape
    on1 = np.empty((n1 if ring1 else n1 + 1, n2))
    on2 = np.empty((n1, n2 if ring2 else n2 - 1))
    over(rows(n1, n2), gap_on_rows, gap, ring1, ring2, on1, on2)
    return on1, on2


@inner()
def _midway(before, a, b, after):
    """Interpolate the gap midway between two pixels with the gaps a and b, by a limited cubic through four pixels.

    `before` is the gap of the pixel before a, and `after` the gap of the pixel after b. The interpolated gap is a
    continuous function of the four gaps, and is 0 if a or b is 0. The docstring of the module `flow.grid` explains the
    limits.
    """
    smaller = min(a, b)
    cubic = (9.0 * (a + b) - (before + after)) / 16.0
    # The cubic is the mean of a and b less 1/16 of the sum of the second differences at a (`left`) and at b (`right`).
    # A jump of the gap next to a or b makes one second difference large. The larger second difference is therefore
    # reduced to at most _JUMP times the smaller one.
    left = before - 2.0 * a + b
    right = a - 2.0 * b + after
    least = max(min(left, right), 0.0)
    most = min(max(left, right), _JUMP * least)
    limited = 0.5 * (a + b) - (least + most) / 16.0
    # the limited value replaces the cubic only if the cubic is lower, and only up to _DIP times the smaller gap
    middle = max(cubic, min(limited, _DIP * smaller))
    # the limits are multiples of the smaller gap, so that the link closes if one of its pixels closes
    return max(min(middle, _MOST * smaller), _LEAST * smaller)


@inner()
def _inside(i, n, ring):
    """Return the index of the pixel whose gap is used at the index i, which may lie outside the grid of n pixels.

    A ring is continued periodically, and an axis that is not a ring by its mirror image.
    """
    while i < 0 or i >= n:
        if ring:
            i %= n
        else:
            i = -1 - i if i < 0 else 2 * n - 1 - i
    return i


@compiled()
def gap_on_rows(first, end, gap, ring1, ring2, on1, on2):
    """Compute the gaps on the links of the pixel rows `first` to `end` − 1, see `gap_on_links`.

    Together with the last row of pixels, the links from the last row to the outlet are computed.
    """
    n1, n2 = gap.shape
    for i in range(first, on1.shape[0] if end == n1 else end):
        # Four pixels around link i, which lies between the second and the third of these pixels. In a ring, the second
        # and the third pixel are i and i + 1. Without a ring they are i − 1 and i, because link 0 is at the inlet.
        start = i - 1 if ring1 else i - 2
        four = [_inside(start + k, n1, ring1) for k in range(4)]
        before, a, b, after = gap[four[0]], gap[four[1]], gap[four[2]], gap[four[3]]
        for j in range(n2):
            on1[i, j] = _midway(before[j], a[j], b[j], after[j])
    for i in range(first, end):
        row = gap[i]
        for j in range(1, n2 - 2):
            on2[i, j] = _midway(row[j - 1], row[j], row[j + 1], row[j + 2])
        for j in (0, n2 - 2, n2 - 1):  # links with neighbours beyond the sides
            if 0 <= j < on2.shape[1]:
                before = row[_inside(j - 1, n2, ring2)]
                after = row[_inside(j + 2, n2, ring2)]
                on2[i, j] = _midway(before, row[j], row[(j + 1) % n2], after)
