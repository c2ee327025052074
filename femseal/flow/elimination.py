"""Direct solution of a link network by star-mesh elimination, exact to rounding at any contrast.

Eliminating node i joins its neighbours j, k by c_jk += c_ij c_ik / Σ_l c_il. Nothing is ever subtracted, so the
effective conductance and the potentials keep their relative accuracy however small a constriction is; a factorisation
of the assembled matrix loses it, because weak links vanish in the diagonal sums. The order is minimum degree; the
structure depends on the shape of the network only and is found once. Sources: Grassmann, Taksar & Heyman, Oper. Res.
33, 1985, 1107 (subtraction-free elimination); George & Liu, Computer Solution of Large Sparse Positive Definite
Systems, 1981 (left-looking sparse elimination).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class EliminationPlan:
    """Order of elimination, structure of the columns, and where the matrix's off-diagonal entries go in them."""

    order: Indices
    starts: Indices
    rows: NDArray[np.int32]
    entries: Indices
    slots: Indices


def plan_elimination(matrix: sp.csc_array) -> EliminationPlan:
    """Plan for all matrices with the structure of a symmetric csc matrix; its values must be positive definite."""
    options = {"SymmetricMode": True}
    order = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).perm_c
    place = np.asarray(order, np.int64)  # new place of each node
    n = place.size
    row = place[matrix.indices]
    col = np.repeat(place, np.diff(matrix.indptr))
    entries = np.flatnonzero(row > col)
    lower = sp.csc_array((np.ones(entries.size), (row[entries], col[entries])), shape=(n, n))
    lower.sort_indices()
    counts = _column_counts(lower.indptr, lower.indices, n)
    starts = np.concatenate([[0], np.cumsum(counts)])
    rows = _column_rows(lower.indptr, lower.indices, starts)
    key = col[entries] * n + row[entries]
    column_of = np.repeat(np.arange(n), counts)
    slots = np.searchsorted(column_of * n + rows, key)
    return EliminationPlan(np.argsort(place), starts, rows, entries, slots)


@njit(cache=True)
def _column_counts(indptr, indices, n):
    """Number of entries below the diagonal in each column of the factor, by the elimination tree."""
    parent = np.full(n, -1, np.int64)
    ancestor = np.full(n, -1, np.int64)
    # rows of the lower triangle: the pattern of row k is the columns j < k with an entry (k, j)
    row_starts = np.zeros(n + 1, np.int64)
    for p in range(indices.size):
        row_starts[indices[p] + 1] += 1
    for k in range(n):
        row_starts[k + 1] += row_starts[k]
    row_columns = np.empty(indices.size, np.int64)
    fill = row_starts[:-1].copy()
    for j in range(n):
        for p in range(indptr[j], indptr[j + 1]):
            row_columns[fill[indices[p]]] = j
            fill[indices[p]] += 1
    counts = np.zeros(n, np.int64)
    mark = np.full(n, -1, np.int64)
    for k in range(n):
        for q in range(row_starts[k], row_starts[k + 1]):
            j = row_columns[q]
            while ancestor[j] != -1 and ancestor[j] != k:
                up = ancestor[j]
                ancestor[j] = k
                j = up
            if ancestor[j] == -1:
                ancestor[j] = k
                parent[j] = k
        mark[k] = k
        for q in range(row_starts[k], row_starts[k + 1]):
            j = row_columns[q]
            while mark[j] != k:
                counts[j] += 1
                mark[j] = k
                j = parent[j]
    return counts


@njit(cache=True)
def _column_rows(indptr, indices, starts):
    """Sorted row numbers of each column of the factor: its own and those of its children in the elimination tree."""
    n = starts.size - 1
    rows = np.empty(starts[n], np.int32)
    mark = np.full(n, -1, np.int64)
    first_child = np.full(n, -1, np.int64)
    next_child = np.full(n, -1, np.int64)
    for j in range(n):
        mark[j] = j
        q = starts[j]
        for p in range(indptr[j], indptr[j + 1]):
            if mark[indices[p]] != j:
                mark[indices[p]] = j
                rows[q] = indices[p]
                q += 1
        c = first_child[j]
        while c >= 0:
            for p in range(starts[c], starts[c + 1]):
                if mark[rows[p]] != j:
                    mark[rows[p]] = j
                    rows[q] = rows[p]
                    q += 1
            c = next_child[c]
        rows[starts[j] : q] = np.sort(rows[starts[j] : q])
        if q > starts[j]:
            parent = rows[starts[j]]
            next_child[j] = first_child[parent]
            first_child[parent] = j
    return rows


@njit(cache=True, nogil=True)
def eliminate(order, starts, rows, values, inlet, outlet):
    """Effective conductance from inlet to outlet, and the potential φ and 1 − φ of every node.

    values : conductances between nodes in the factor's structure, changed in place; inlet, outlet : conductances of
    each node to the two ends, where φ is 1 and 0. Nodes without any link get φ = 0 and 1 − φ = 0.
    """
    n = order.size
    head = np.full(n, -1, np.int64)
    chain = np.full(n, -1, np.int64)
    at = starts[:-1].copy()
    place = np.zeros(n, np.int64)
    a = np.empty(n)
    b = np.empty(n)
    for j in range(n):
        a[j] = inlet[order[j]]
        b[j] = outlet[order[j]]
    s = np.zeros(n)
    rate = 0.0
    for j in range(n):
        for p in range(starts[j], starts[j + 1]):
            place[rows[p]] = p
        i = head[j]
        while i >= 0:
            following = chain[i]
            q = at[i]
            if values[q] > 0.0:
                f = values[q] / s[i]
                for p in range(q + 1, starts[i + 1]):
                    values[place[rows[p]]] += f * values[p]
                a[j] += f * a[i]
                b[j] += f * b[i]
            q += 1
            at[i] = q
            if q < starts[i + 1]:
                chain[i] = head[rows[q]]
                head[rows[q]] = i
            i = following
        total = a[j] + b[j]
        for p in range(starts[j], starts[j + 1]):
            total += values[p]
        s[j] = total
        if total > 0.0:
            rate += a[j] * (b[j] / total)
        if starts[j] < starts[j + 1]:
            chain[j] = head[rows[starts[j]]]
            head[rows[starts[j]]] = j
    high = np.zeros(n)
    low = np.zeros(n)
    for j in range(n - 1, -1, -1):
        if s[j] > 0.0:
            u = a[j]
            w = b[j]
            for p in range(starts[j], starts[j + 1]):
                u += values[p] * high[rows[p]]
                w += values[p] * low[rows[p]]
            high[j] = u / s[j]
            low[j] = w / s[j]
    potential = np.zeros(n)
    complement = np.zeros(n)
    for j in range(n):
        potential[order[j]] = high[j]
        complement[order[j]] = low[j]
    return rate, potential, complement
