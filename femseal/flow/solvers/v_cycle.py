"""One V-cycle of multigrid over the levels of `hierarchy`: compiled.

One sweep of Gauss-Seidel forward before and backward after the coarser grid keep the preconditioner symmetric. All
arithmetic is in single precision. Large levels are swept by strips of rows, every second one first, then those between
them, and backward in reverse: threads share the strips.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.compiled import REORDERED, compiled, inner
from ...base.threads import NO, ONE, over
from .coarsest import Coarsest, solve_by_parts, solve_coarsest
from .hierarchy import Levels, large_levels, level, strips, weights_to


@inner(**REORDERED)
def _rows_down(first, count, x, b, inverse, right, below, ring):
    """Gauss-Seidel forward on up to four rows of a network, column by column: each row waits for its own sum only."""
    n2 = x.shape[1] - 2
    i, k, m, n = (
        first,
        min(first + 1, x.shape[0] - 1),
        min(first + 2, x.shape[0] - 1),
        min(first + 3, x.shape[0] - 1),
    )
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


@inner(**REORDERED)
def _add_below(i, x, to, below, below_right, below_left, nine):
    """Add to a row what its links to the next one carry of x."""
    if nine:
        for j in range(1, x.shape[1] - 1):
            to[i, j] += (
                below[i, j] * x[i + 1, j]
                + below_right[i, j] * x[i + 1, j + 1]
                + below_left[i, j] * x[i + 1, j - 1]
            )
    else:
        for j in range(1, x.shape[1] - 1):
            to[i, j] += below[i, j] * x[i + 1, j]


@inner(**REORDERED)
def _residual(first, end, x, r, right, below, below_right, below_left, nine, ring):
    """Residual of some rows after Gauss-Seidel forward from zero: the links to later nodes."""
    n2 = x.shape[1] - 2
    for i in range(first, end):
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


@compiled(**REORDERED)
def _sweep_down(
    first, end, between, x, b, r, inverse, right, below, below_right, below_left, nine, ring
):
    """Gauss-Seidel forward from zero on a strip of rows, and the residual it leaves.

    Strips beside one that comes `between` were swept before it, and it changes their residuals; others come later.
    """
    n2 = x.shape[1] - 2
    after, last = x[end].copy(), b[end - 1].copy()
    if between:
        _add_below(end - 1, x, b, below, below_right, below_left, nine)
    else:
        x[first - 1] = 0.0
    x[end] = 0.0
    i: Any = np.int64(first)
    while i < end:
        start = max(i - 1, first)
        count = 1
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
        else:
            count = 4 if i + 4 <= end else 1
            _rows_down(i, count, x, b, inverse, right, below, ring)
        if ring:
            for row in range(i, i + count):
                x[row, 0], x[row, n2 + 1] = x[row, n2], x[row, 1]
        i += count
        _residual(start, i - 1, x, r, right, below, below_right, below_left, nine, ring)
    _residual(end - 1, end, x, r, right, below, below_right, below_left, nine, ring)
    if between:
        for j in range(n2 + 2):
            x[end, j], b[end - 1, j] = after[j], last[j]
        _add_below(first - 1, x, r, below, below_right, below_left, nine)
        for j in range(1, n2 + 1):
            r[end, j] += below[end - 1, j] * x[end - 1, j]
        if nine:
            for j in range(1, n2 + 1):
                r[end, j] += below_right[end - 1, j - 1] * x[end - 1, j - 1]
                r[end, j] += below_left[end - 1, j + 1] * x[end - 1, j + 1]
        if ring:
            r[first - 1, 0], r[end, 0] = r[first - 1, n2], r[end, n2]


@inner(**REORDERED)
def _rows_up(last, count, x, b, inverse, right, below, ring):
    """Gauss-Seidel backward on up to four rows of a network, column by column."""
    n2 = x.shape[1] - 2
    i, k, m, n = last, max(last - 1, 0), max(last - 2, 0), max(last - 3, 0)
    u, v, s, t = x[i, n2 + 1], x[k, n2 + 1], x[m, n2 + 1], x[n, n2 + 1]
    for j in range(n2, 0, -1):
        if j == 1 and ring:  # the first node comes after the last, which it is linked to
            for row in range(last - count + 1, last + 1):
                x[row, 0] = x[row, n2]
        rest = (
            b[i, j]
            + below[i - 1, j] * x[i - 1, j]
            + below[i, j] * x[i + 1, j]
            + right[i, j - 1] * x[i, j - 1]
        )
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


@compiled(**REORDERED)
def _sweep_up(first, end, x, b, inverse, right, below, below_right, below_left, nine, ring):
    """Gauss-Seidel backward on a strip of rows."""
    n2 = x.shape[1] - 2
    rest = np.empty(n2 + 2 if nine else 1, np.float32)
    i: Any = np.int64(end - 1)
    while i >= first:
        if not nine:
            count = 4 if i >= first + 3 else 1
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


@compiled(**REORDERED)
def _restrict(first, end, r, w, b):
    """Pᵀ r at some rows of the coarser grid."""
    m2 = b.shape[1] - 2
    for ci in range(first, end):
        i = 2 * ci - 1
        for cj in range(1, m2 + 1):
            j = 2 * cj - 1
            s = np.float32(0.0)
            for a in range(3):
                s += w[ci, cj, a, 0] * r[i + a - 1, j - 1]
                s += w[ci, cj, a, 1] * r[i + a - 1, j]
                s += w[ci, cj, a, 2] * r[i + a - 1, j + 1]
            b[ci, cj] = s


@compiled(**REORDERED)
def _prolong(first, end, coarse, w, x, ring):
    """x += P coarse of some rows of the coarser grid, the last of whose rows of x the next ones add to as well."""
    n2, m2 = x.shape[1] - 2, coarse.shape[1] - 2
    if ring:
        for i in range(2 * first - 2, 2 * end - 1):
            x[i, 0] = 0.0
    for ci in range(first, end):
        i = 2 * ci - 1
        for cj in range(1, m2 + 1):
            j = 2 * cj - 1
            v = coarse[ci, cj]
            for a in range(3):
                x[i + a - 1, j - 1] += v * w[ci, cj, a, 0]
                x[i + a - 1, j] += v * w[ci, cj, a, 1]
                x[i + a - 1, j + 1] += v * w[ci, cj, a, 2]
    if ring:
        for i in range(2 * first - 2, 2 * end - 1):
            x[i, n2] += x[i, 0]
            x[i, 0] = x[i, n2]
            x[i, n2 + 1] = x[i, 1]


@compiled(**REORDERED)
def v_cycle(levels, coarsest, ring, top):
    """One V-cycle from b to x of the level `top`; the finest one, 0, has five points, coarser ones nine."""
    shape, first, fields, weight_first, weights = levels
    last = shape.shape[0] - 1
    here = level(shape, first, fields, top)
    for step in range(2 * (last - top) + 1):
        k = min(top + step, 2 * last - top - step)
        if k == last:
            solve_coarsest(coarsest, here[4], here[3])
            continue
        down = step < last - top
        other = level(shape, first, fields, k + 1 if down else k)
        coarse, fine = (other, here) if down else (here, other)
        here = other
        right, below, inverse, x, b, r, below_right, below_left = fine
        w, nine = weights_to(k, shape, weight_first, weights), k > 0
        rows, coarse_rows = x.shape[0] - 1, coarse[4].shape[0] - 1
        if down:
            _sweep_down(
                ONE, rows, NO, x, b, r, inverse, right, below, below_right, below_left, nine, ring
            )
            _restrict(ONE, coarse_rows, r, w, coarse[4])
        else:
            _prolong(ONE, coarse_rows, coarse[3], w, x, ring)
            _sweep_up(ONE, rows, x, b, inverse, right, below, below_right, below_left, nine, ring)


def cycle(levels: Levels, coarsest: Coarsest, ring: bool) -> None:
    """`v_cycle` of the finest level, with threads on large ones."""
    large = large_levels(levels.shape)
    for step in range(2 * large + 1):
        k = min(step, 2 * large - step)
        if k == large and k == len(levels.shape) - 1:
            solve_by_parts(coarsest, *level(*levels[:3], k)[4:2:-1])
            continue
        if k == large:
            v_cycle(levels, coarsest, ring, large)
            continue
        (right, below, inverse, x, b, r, *corners), coarse = (
            level(*levels[:3], n) for n in (k, k + 1)
        )
        w, nine = weights_to(k, levels.shape, *levels[3:5]), k > 0
        swept, coarse_rows = strips(len(x)), strips(len(coarse[4]))
        links = right, below, *corners
        if step < large:
            for between in (False, True):
                over(swept[between::2], _sweep_down, between, x, b, r, inverse, *links, nine, ring)
            over(coarse_rows, _restrict, r, w, coarse[4])
        else:
            for between in (False, True):
                over(coarse_rows[between::2], _prolong, coarse[3], w, x, ring)
            for between in (True, False):
                over(swept[between::2], _sweep_up, x, b, inverse, *links, nine, ring)
