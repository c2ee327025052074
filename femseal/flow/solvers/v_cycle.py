"""One V-cycle of multigrid over the levels of `hierarchy`: compiled.

One sweep of Gauss-Seidel forward before and backward after the coarser grid, each with the clusters that a sweep does
not move, keep the preconditioner symmetric. All arithmetic is in single precision.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from .clusters import relax_backward, relax_forward
from .coarsest import solve_coarsest
from .compiled import COMPILED
from .hierarchy import level


@njit(**COMPILED)
def _rows_down(first, count, x, b, inverse, right, below, ring):
    """Gauss-Seidel forward on up to four rows of a network, column by column: each row waits for its own sum only."""
    n2 = x.shape[1] - 2
    i, k, m, n = first, min(first + 1, x.shape[0] - 1), min(first + 2, x.shape[0] - 1), min(first + 3, x.shape[0] - 1)
    u = v = s = t = np.float32(0.0)
    for j in range(1, n2 if ring else n2 + 1):
        u = (b[i, j] + below[i - 1, j] * x[i - 1, j] + right[i, j - 1] * u) * inverse[i, j]
        x[i, j] = u
        if count == 4:
            v = (b[k, j] + below[i, j] * u + right[k, j - 1] * v) * inverse[k, j]
            x[k, j] = v
            s = (b[m, j] + below[k, j] * v + right[m, j - 1] * s) * inverse[m, j]
            x[m, j] = s
            t = (b[n, j] + below[m, j] * s + right[n, j - 1] * t) * inverse[n, j]
            x[n, j] = t
    if ring:  # the last node comes after the first, which it is linked to
        for i in range(first, first + count):
            s = b[i, n2] + below[i - 1, n2] * x[i - 1, n2] + right[i, n2 - 1] * x[i, n2 - 1]
            x[i, n2] = (s + right[i, n2] * x[i, 1]) * inverse[i, n2]


@njit(**COMPILED)
def _sweep_down(x, b, r, inverse, right, below, below_right, below_left, nine, ring):
    """Gauss-Seidel forward from zero, and the residual it leaves: the links to later nodes."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    i: Any = np.int64(1)
    while i <= n1:
        x[i, n2 + 1] = 0.0
        if nine:
            before = np.float32(0.0)
            for j in range(1, n2 + 1):
                r[i, j] = (
                    b[i, j]
                    + below[i - 1, j] * x[i - 1, j]
                    + below_right[i - 1, j - 1] * x[i - 1, j - 1]
                    + below_left[i - 1, j + 1] * x[i - 1, j + 1]
                )
            for j in range(1, n2):
                before = (r[i, j] + right[i, j - 1] * before) * inverse[i, j]
                x[i, j] = before
            s = r[i, n2] + right[i, n2 - 1] * before
            if ring:
                s += right[i, n2] * x[i, 1]
            x[i, n2] = s * inverse[i, n2]
            if ring:
                x[i, 0] = x[i, n2]
                x[i, n2 + 1] = x[i, 1]
            i += 1
        else:
            count = 4 if i + 3 <= n1 else 1
            _rows_down(i, count, x, b, inverse, right, below, ring)
            for _ in range(count):
                x[i, 0] = x[i, n2] if ring else 0.0
                x[i, n2 + 1] = x[i, 1] if ring else 0.0
                i += 1
    for i in range(1, n1 + 1):
        if nine:
            for j in range(1, n2 + 1):
                r[i, j] = (
                    right[i, j] * x[i, j + 1]
                    + below[i, j] * x[i + 1, j]
                    + below_right[i, j] * x[i + 1, j + 1]
                    + below_left[i, j] * x[i + 1, j - 1]
                )
        else:
            for j in range(1, n2 + 1):
                r[i, j] = right[i, j] * x[i, j + 1] + below[i, j] * x[i + 1, j]
        if ring:
            # the last node comes after the first
            r[i, n2] -= right[i, n2] * x[i, 1]
            r[i, 1] += right[i, 0] * x[i, n2]
            r[i, 0] = r[i, n2]


@njit(**COMPILED)
def _rows_up(last, count, x, b, inverse, right, below, ring):
    """Gauss-Seidel backward on up to four rows of a network, column by column."""
    n2 = x.shape[1] - 2
    i, k, m, n = last, max(last - 1, 0), max(last - 2, 0), max(last - 3, 0)
    u, v, s, t = x[i, n2 + 1], x[k, n2 + 1], x[m, n2 + 1], x[n, n2 + 1]
    for j in range(n2, 0, -1):
        if j == 1 and ring:  # the first node comes after the last, which it is linked to
            for row in range(last - count + 1, last + 1):
                x[row, 0] = x[row, n2]
        rest = b[i, j] + below[i - 1, j] * x[i - 1, j] + below[i, j] * x[i + 1, j] + right[i, j - 1] * x[i, j - 1]
        u = (rest + right[i, j] * u) * inverse[i, j]
        x[i, j] = u
        if count == 4:
            rest = b[k, j] + below[k - 1, j] * x[k - 1, j] + right[k, j - 1] * x[k, j - 1]
            v = (rest + below[k, j] * u + right[k, j] * v) * inverse[k, j]
            x[k, j] = v
            rest = b[m, j] + below[m - 1, j] * x[m - 1, j] + right[m, j - 1] * x[m, j - 1]
            s = (rest + below[m, j] * v + right[m, j] * s) * inverse[m, j]
            x[m, j] = s
            rest = b[n, j] + below[n - 1, j] * x[n - 1, j] + right[n, j - 1] * x[n, j - 1]
            t = (rest + below[n, j] * s + right[n, j] * t) * inverse[n, j]
            x[n, j] = t


@njit(**COMPILED)
def _sweep_up(x, b, inverse, right, below, below_right, below_left, nine, ring):
    """Gauss-Seidel backward."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    rest = np.empty(n2 + 2 if nine else 1, np.float32)
    i = n1
    while i > 0:
        if not nine:
            count = 4 if i >= 4 else 1
            _rows_up(i, count, x, b, inverse, right, below, ring)
            for _ in range(count):
                if ring:
                    x[i, 0] = x[i, n2]
                    x[i, n2 + 1] = x[i, 1]
                i -= 1
            continue
        for j in range(1, n2 + 1):
            rest[j] = (
                b[i, j]
                + below[i - 1, j] * x[i - 1, j]
                + below[i, j] * x[i + 1, j]
                + below_right[i - 1, j - 1] * x[i - 1, j - 1]
                + below_left[i - 1, j + 1] * x[i - 1, j + 1]
                + below_right[i, j] * x[i + 1, j + 1]
                + below_left[i, j] * x[i + 1, j - 1]
            )
        after = x[i, n2 + 1]
        for j in range(n2, 0, -1):
            if j == 1 and ring:
                x[i, 0] = x[i, n2]
            after = (rest[j] + right[i, j - 1] * x[i, j - 1] + right[i, j] * after) * inverse[i, j]
            x[i, j] = after
        if ring:
            x[i, 0] = x[i, n2]
            x[i, n2 + 1] = x[i, 1]
        i -= 1


@njit(**COMPILED)
def _restrict(r, w, b):
    """Pᵀ r."""
    m1, m2 = b.shape[0] - 2, b.shape[1] - 2
    for ci in range(1, m1 + 1):
        i = 2 * ci - 1
        for cj in range(1, m2 + 1):
            j = 2 * cj - 1
            s = np.float32(0.0)
            for a in range(3):
                s += w[ci, cj, a, 0] * r[i + a - 1, j - 1]
                s += w[ci, cj, a, 1] * r[i + a - 1, j]
                s += w[ci, cj, a, 2] * r[i + a - 1, j + 1]
            b[ci, cj] = s


@njit(**COMPILED)
def _prolong(coarse, w, x, ring):
    """x += P coarse."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    m1, m2 = coarse.shape[0] - 2, coarse.shape[1] - 2
    if ring:
        for i in range(1, n1 + 1):
            x[i, 0] = 0.0
    for ci in range(1, m1 + 1):
        i = 2 * ci - 1
        for cj in range(1, m2 + 1):
            j = 2 * cj - 1
            v = coarse[ci, cj]
            for a in range(3):
                x[i + a - 1, j - 1] += v * w[ci, cj, a, 0]
                x[i + a - 1, j] += v * w[ci, cj, a, 1]
                x[i + a - 1, j + 1] += v * w[ci, cj, a, 2]
    if ring:
        for i in range(1, n1 + 1):
            x[i, n2] += x[i, 0]
            x[i, 0] = x[i, n2]
            x[i, n2 + 1] = x[i, 1]


@njit(**COMPILED)
def v_cycle(levels, coarsest, nine, ring):
    """One V-cycle from b to x of the finest level, which has nine points or five."""
    shape, first, fields, corner_first, corners, weight_first, weights = levels[:7]
    cluster_first, start, nodes, outside, ground, inverses = levels[7:]
    last = shape.shape[0] - 1
    for step in range(2 * last + 1):
        k = min(step, 2 * last - step)
        right, below, inverse, x, b, r, below_right, below_left = level(shape, first, fields, corner_first, corners, k)
        if k == last:
            solve_coarsest(coarsest, b, x)
            continue
        coarse = level(shape, first, fields, corner_first, corners, k + 1)
        w = weights[weight_first[k] : weight_first[k + 1]].reshape((shape[k + 1, 0], shape[k + 1, 1], 3, 3))
        all_nine = nine or k > 0
        c, d = cluster_first[k], cluster_first[k + 1]
        moved = nodes, start[c : d + 1], outside, ground, inverses[c:d]
        if step < last:
            _sweep_down(x, b, r, inverse, right, below, below_right, below_left, all_nine, ring)
            if d > c:
                relax_forward(*moved, x, r, right, below, below_right, below_left, ring)
            _restrict(r, w, coarse[4])
        else:
            _prolong(coarse[3], w, x, ring)
            if d > c:
                relax_backward(*moved, x, b, right, below, below_right, below_left, ring)
            _sweep_up(x, b, inverse, right, below, below_right, below_left, all_nine, ring)
