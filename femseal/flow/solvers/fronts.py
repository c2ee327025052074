"""Fronts of a multifrontal elimination: dense arrays of the links of nodes that are eliminated together.

A front has a row for each of its nodes; what its elimination leaves are links within its border, which wait for the
front's parent. Source: Duff & Reid, ACM TOMS 9, 1983, 302.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

#: Pivots eliminated one by one before what follows takes them as one product of matrices.
_PANEL = 32
#: Multiplications from which a product of matrices is left to BLAS.
_BLAS = 30_000

_exact: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {**_exact, "error_model": "numpy", "fastmath": {"reassoc", "contract"}}


@njit(**_exact)
def sort_places(values):
    """Sort in place by Shell's method with Tokuda's gaps; most lists are short and nearly sorted."""
    gap = 1
    while gap < values.size:
        gap = (9 * gap) // 4 + 1
    while gap > 0:
        for i in range(gap, values.size):
            here = values[i]
            j = i - gap
            while j >= 0 and values[j] > here:
                values[j + gap] = values[j]
                j -= gap
            values[j + gap] = here
        gap = (4 * gap) // 9


@njit(**_exact)
def gather(f, parent, pending, n_pending, border, start, left, top, local, front, rest):
    """Add what the children of front f left to its arrays; the fronts that wait still, and the end of what they left.

    pending : the fronts that wait, the last ones first to be taken. border, start : nodes of the borders of all fronts
    and where they start. left : links within the borders of the fronts that wait. local : numbers of nodes in front f.
    """
    while n_pending > 0 and parent[pending[n_pending - 1]] == f:
        n_pending -= 1
        child = pending[n_pending]
        m = start[child + 1] - start[child]
        top -= m * m
        links = left[top : top + m * m].reshape(m, m)
        _add_links(links, border[start[child] : start[child + 1]], local, front.shape[0], front, rest)
    return n_pending, top


@njit(**_exact)
def _add_links(links, nodes, local, p, front, rest):
    """Add the remaining links of a child to the arrays of its parent; both number their nodes in the same order."""
    m = nodes.size
    at = np.empty(m, np.int64)
    for i in range(m):
        at[i] = local[nodes[i]]
    for i in range(m):
        if at[i] < p:
            for j in range(i + 1, m):
                front[at[i], at[j]] += links[i, j]
        else:
            for j in range(i + 1, m):
                rest[at[i] - p, at[j] - p] += links[i, j]


@njit(**_fast)
def eliminate_front(front, rest, total):
    """Eliminate the pivots of a front, the rows of `front`; links to later nodes only, also within its border."""
    p, q = total.size, rest.shape[0]
    for start in range(0, p, _PANEL):
        end = min(start + _PANEL, p)
        for i in range(start, end):
            s = 0.0
            for j in range(i + 1, p + q):
                s += front[i, j]
            total[i] = s
            for j in range(i + 1, end):
                if front[i, j] != 0.0:
                    f = front[i, j] / s
                    for k in range(j + 1, p + q):
                        front[j, k] += f * front[i, k]
        if end < p:
            later = front[start:end, end:].copy()
            shares = np.empty((end - start, p - end))
            for i in range(end - start):
                for j in range(p - end):
                    shares[i, j] = later[i, j] / total[start + i]
            product = np.dot(shares.T, later)
            for i in range(end, p):
                for j in range(end, p + q):
                    front[i, j] += product[i - end, j - end]
    if p * q * q > _BLAS:
        later = front[:, p:].copy()
        shares = np.empty((p, q))
        for i in range(p):
            for j in range(q):
                shares[i, j] = later[i, j] / total[i]
        product = np.dot(shares.T, later)
        for i in range(q):
            for j in range(q):
                rest[i, j] += product[i, j]
        return
    # four pivots at once
    for i in range(0, p, 4):
        i1, i2, i3 = min(i + 1, p - 1), min(i + 2, p - 1), min(i + 3, p - 1)
        s0 = 1.0 / total[i]
        s1 = 1.0 / total[i1] if i + 1 < p else 0.0
        s2 = 1.0 / total[i2] if i + 2 < p else 0.0
        s3 = 1.0 / total[i3] if i + 3 < p else 0.0
        for j in range(q):
            f0, f1, f2, f3 = s0 * front[i, p + j], s1 * front[i1, p + j], s2 * front[i2, p + j], s3 * front[i3, p + j]
            if f0 != 0.0 or f1 != 0.0 or f2 != 0.0 or f3 != 0.0:
                for k in range(j + 1, q):
                    rest[j, k] += (
                        f0 * front[i, p + k] + f1 * front[i1, p + k] + f2 * front[i2, p + k] + f3 * front[i3, p + k]
                    )


@njit(**_exact)
def leave(rest, left, top):
    """Keep the links within the border of a front for its parent; the new end of what is left."""
    for i in range(rest.shape[0]):
        for j in range(rest.shape[1]):
            left[top] = rest[i, j]
            top += 1
    return top
