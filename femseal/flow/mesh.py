"""The structured mesh of a link network, and its assembly pattern.

Q1 with edge-midpoint quadrature: the x1-part of the form is integrated at the midpoints of an element's two x1-edges,
the x2-part at those of its x2-edges. The matrix is then that of a network of links between neighbouring nodes, and it
depends linearly on the links' conductances c = k Δ⊥/Δ∥, which carry the geometry (the mesh itself has unit squares).
scikit-fem assembles it once for each shape; a new conductance field is then one sparse product.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, ElementQuad1, MeshQuad

from .forms import flow_along_x1, flow_along_x2

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class LinkPattern:
    """Where each link's conductance goes in the matrix of the unknown nodes (rows 1 … n1 − 1 of n1 + 1)."""

    shape: tuple[int, int]
    indices: NDArray[np.int32]
    indptr: NDArray[np.int32]
    diagonal: Indices
    links_to_entries: sp.csr_array

    def matrix(self, c1: Array, c2: Array) -> sp.csc_array:
        """Matrix of the network with conductances c1 (n1, n2) along x1 and c2 along x2; symmetric."""
        data = self.links_to_entries @ np.concatenate([c1.ravel(), c2.ravel()])
        n = self.diagonal.size
        return sp.csc_array((data, self.indices, self.indptr), shape=(n, n))


@lru_cache(maxsize=16)
def link_pattern(n1: int, n2: int, periodic: bool) -> LinkPattern:
    """Pattern of n1 × n2 links along x1; along x2 there are n1 − 1 rows of n2 links (n2 − 1 if not periodic)."""
    columns = n2 if periodic else n2 - 1
    rows, cols, links, values = assemble_links(n1, n2, periodic)
    n = (n1 - 1) * n2
    row, col = rows - n2, cols - n2
    inside = (row >= 0) & (row < n) & (col >= 0) & (col < n) & (links >= 0) & (values != 0)
    key, entry = np.unique(col[inside] * n + row[inside], return_inverse=True)
    n_links = n1 * n2 + (n1 - 1) * columns
    product = sp.csr_array((values[inside], (entry, links[inside])), shape=(key.size, n_links))
    key_row, key_col = key % n, key // n
    indptr = np.searchsorted(key_col, np.arange(n + 1)).astype(np.int32)
    return LinkPattern((n1, n2), key_row.astype(np.int32), indptr, np.flatnonzero(key_row == key_col), product)


def assemble_links(n1: int, n2: int, periodic: bool) -> tuple[Indices, Indices, Indices, Array]:
    """Row node, column node, link and value of every local matrix entry, from scikit-fem on unit squares.

    Nodes are numbered i·n2 + j; links along x1 i·n2 + j, then those along x2 from row 1 on; −1 on the two end rows,
    whose pressure is given.
    """
    columns = n2 if periodic else n2 - 1
    mesh = MeshQuad.init_tensor(np.arange(n1 + 1.0), np.arange(columns + 1.0))
    element = np.arange(n1 * columns)
    i, j = element // columns, element % columns
    parts = []
    for form, along_x1 in ((flow_along_x1, True), (flow_along_x2, False)):
        for side in (0, 1):
            # local axis 0 of the element lies along x2
            point = np.array([[float(side)], [0.5]] if along_x1 else [[0.5], [float(side)]])
            basis = Basis(mesh, ElementQuad1(), quadrature=(point, np.array([0.5])))
            weight = np.ones((element.size, 1))
            if along_x1:
                link = i * n2 + (j + side) % n2
                if not periodic:  # the full width of a column at a closed side
                    weight[(j + side == 0) | (j + side == n2 - 1)] = 2.0
            else:
                row = i + side - 1
                link = np.where((row >= 0) & (row < n1 - 1), n1 * n2 + row * columns + j, -1)
            data = form.coo_data(basis, c=weight)
            nodes = (data.indices // (columns + 1)) * n2 + (data.indices % (columns + 1)) % n2
            parts.append((nodes[0], nodes[1], np.tile(link, data.data.size // element.size), data.data))
    rows, cols, links, values = (np.concatenate(p) for p in zip(*parts, strict=True))
    return rows.astype(np.int64), cols.astype(np.int64), links.astype(np.int64), values
