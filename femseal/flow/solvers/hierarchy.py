"""The levels of multigrid on a structured grid, from the conductances of the finest one.

A level is the operator of a grid, with the fields that a multigrid cycle needs there. It is set up in double precision
and kept in single: a cycle is a preconditioner, and starts from zero, so that its rounding errors are relative to the
correction. Fields have a border of one node, with zeros at ends and closed sides and with copies of the other side
around a ring. They have the sign of a conductance: `right` (i, j)–(i, j + 1), `below` (i, j)–(i + 1, j); the finest
level has five points, coarser ones nine: `below_right` (i, j)–(i + 1, j + 1), `below_left` (i, j)–(i + 1, j − 1).
A node between coarse ones takes the mean of them that its own conductances would give it; coarse operators are
Galerkin's. Source: Dendy, J. Comput. Phys. 48, 1982, 366 (black box multigrid).

Of the coarsest level the nodes are eliminated one after another, row by row. The ends are one node, at potential 0.
Nothing is subtracted, see `elimination`: that of a band needs no order of its own, and takes a small part of the time
of a solution as long as the level is small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base import Indices, Singles
from ...base.compiled import REORDERED, by_rows, compiled, inner, leader

#: Nodes of an axis at which coarsening ends.
FEWEST = 4
#: Coarsening also ends where so small a fraction of the nodes is left, if these are no more than so many: they are
#: eliminated in less time than the iterations take that bays and channels of the coarser grids do.
_ELIMINATED, _MOST_ELIMINATED = 1 / 40, 20000
#: Largest inverse of a centre; single precision ends at 3e38.
_MOST_INVERSE = 1e30
#: What the centre has beyond all conductances is taken for a rounding error below this fraction.
_ROUNDING = 1e-13


class Level(NamedTuple):
    """Fields of a level, each with a border.

    links : right, below, below right and below left; the last two (1, 1) of five points. inverse : of the centres, 0
    where there are no conductances. b : right side of a cycle. x : what it has after the first sweep. r : the residual,
    and in the end the solution. weights (…, 3, 3) : of the nodes of the next level at those of this one.
    """

    links: tuple[Singles, Singles, Singles, Singles]
    inverse: Singles
    b: Singles
    x: Singles
    r: Singles
    weights: Singles


class Coarsest(NamedTuple):
    """The eliminated level.

    number (n1, n2) : of each node, in the order of elimination. band (n, width) : links of each node to the next ones
    at the time it was eliminated. inverse (n,) : 1 over their sum, or 0.
    """

    number: Indices
    band: Singles
    inverse: Singles


@compiled()
def _numbered(n1, n2, ring):
    """Numbers of the nodes along the shorter axis first, and the most by which those of two linked nodes differ.

    Around a ring both sides are numbered alternately.
    """
    number = np.empty((n1, n2), np.int64)
    for j in range(n2):
        place = j
        if ring:
            place = 2 * j if 2 * j < n2 else 2 * (n2 - 1 - j) + 1
        for i in range(n1):
            number[i, j] = i * n2 + place if n2 <= n1 else place * n1 + i
    step = 2 if ring else 1
    return number, (n2 + step if n2 <= n1 else step * n1 + 1)


@compiled(**REORDERED)
def eliminated(operator, ring):
    """`Coarsest` of an operator, see `hierarchy`."""
    centre = operator[0]
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    number, width = _numbered(n1, n2, ring)
    n = n1 * n2
    # rows without nodes at the end, so that no loop needs to stop before them
    band = np.zeros((n + width, width), np.float32)
    ends = np.zeros(n + width, np.float32)
    inverse = np.zeros(n, np.float32)
    for i in range(n1):
        for j in range(n2):
            k = number[i, j]
            rest = centre[i + 1, j + 1]
            for side in range(1, 5):
                down = (0, 1, 1, 1)[side - 1]
                right = (1, 0, 1, -1)[side - 1]
                link = operator[side]
                if link.size == 1:
                    continue
                rest -= link[i + 1, j + 1] + link[i + 1 - down, j + 1 - right]
                column = (j + right) % n2 if ring else j + right
                if i + down < n1 and 0 <= column < n2 and number[i + down, column] != k:
                    other = number[i + down, column]
                    band[min(k, other), abs(k - other) - 1] += link[i + 1, j + 1]
            if rest > _ROUNDING * centre[i + 1, j + 1]:
                ends[k] = rest
    for k in range(n):
        row = band[k]
        later = band[k + 1 : k + 1 + width]
        total = ends[k]
        for a in range(width):
            total += row[a]
        if not total > 0.0:
            continue
        inverse[k] = np.float32(1.0) / total
        for a in range(width):
            fraction = row[a] * inverse[k]
            if fraction != np.float32(0.0):
                ends[k + 1 + a] += fraction * ends[k]
                for b in range(width - 1 - a):
                    later[a, b] += fraction * row[a + 1 + b]
    return Coarsest(number, band, inverse)


@compiled(**REORDERED)
def solve_coarsest(coarsest, b, ring, x):
    """Write x of the level from its right-hand side b, both with a border."""
    number, band, inverse = coarsest
    n1, n2 = number.shape
    n, width = inverse.size, band.shape[1]
    v = np.zeros(n + width, np.float32)
    for i in range(n1):
        for j in range(n2):
            v[number[i, j]] = b[i + 1, j + 1]
    for k in range(n):
        here = v[k] * inverse[k]
        v[k] = here
        for a in range(width):
            v[k + 1 + a] += band[k, a] * here
    for k in range(n - 1, -1, -1):
        s = np.float32(0.0)
        for a in range(width):
            s += band[k, a] * v[k + 1 + a]
        v[k] += s * inverse[k]
    for i in range(n1):
        for j in range(n2):
            x[i + 1, j + 1] = v[number[i, j]]
        if ring:
            x[i + 1, 0], x[i + 1, n2 + 1] = x[i + 1, n2], x[i + 1, 1]


@inner(**REORDERED)
def close_ring(row):
    """Copy the ends of a row to the borders beyond the other side."""
    row[0], row[-1] = row[-2], row[1]


@by_rows(**REORDERED)
def _links(first, end, centre, right, below, along, across, ring):
    """Write centres and conductances of some rows of a stencil."""
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    for i in range(first, end):
        for j in range(1, across.shape[1] + 1):
            right[i, j] = across[i - 1, j - 1]
        if ring:
            close_ring(right[i])
        for j in range(1, n2 + 1):
            if i < n1:
                below[i, j] = along[i, j - 1]
            centre[i, j] = along[i - 1, j - 1] + along[i, j - 1] + right[i, j - 1] + right[i, j]
        if ring:
            close_ring(below[i])


@inner(**REORDERED)
def _share(part, whole):
    """part / whole, or 0 if either is not > 0."""
    return part / whole if part > 0.0 and whole > 0.0 else 0.0


@by_rows(**REORDERED)
def _along_rows(first, end, w, operator, nine, ring):
    """Write the weight w of each coarse node, at (2I − 1, 2J − 1), at itself and beside it in some coarse rows."""
    centre, right, below, below_right, below_left = operator
    n2 = centre.shape[1] - 2
    m2 = w.shape[1] - 2
    for i in range(2 * first - 1, 2 * end - 1, 2):
        for j in range(1, m2 + 1):
            w[(i + 1) // 2, j, 1, 1] = 1.0
        # links above and below are added to those along the row, or left out
        for j in range(2, n2 + 1, 2):
            west = right[i, j - 1]
            east = right[i, j]
            if nine:
                west += below_right[i - 1, j - 1] + below_left[i, j]
                east += below_left[i - 1, j + 1] + below_right[i, j]
            whole = max(centre[i, j] - below[i - 1, j] - below[i, j], west + east)
            w[(i + 1) // 2, j // 2, 1, 2] = _share(west, whole)
            w[(i + 1) // 2, (j // 2) % m2 + 1 if j == n2 else j // 2 + 1, 1, 0] = _share(
                east, whole
            )
        if ring:
            _round(w, (i + 1) // 2, 1)


@by_rows(**REORDERED)
def _between_rows(first, end, w, operator, nine, ring):
    """Write the weights of coarse nodes in the rows after some coarse rows, once those of `_along_rows` are there."""
    centre, right, below, below_right, below_left = operator
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    m2 = w.shape[1] - 2
    for i in range(2 * first, min(2 * end, n1 + 1), 2):
        for j in range(1, n2 + 1, 2):
            north = below[i - 1, j]
            south = below[i, j]
            if nine:
                north += below_right[i - 1, j - 1] + below_left[i - 1, j + 1]
                south += below_left[i, j] + below_right[i, j]
            whole = max(centre[i, j] - right[i, j - 1] - right[i, j], north + south)
            w[i // 2, (j + 1) // 2, 2, 1] = _share(north, whole)
            w[i // 2 + 1, (j + 1) // 2, 0, 1] = _share(south, whole)
        for j in range(2, n2 + 1, 2):
            c = centre[i, j]
            if c <= 0.0:
                continue
            top, bottom, left = i // 2, i // 2 + 1, j // 2
            right_one = (j // 2) % m2 + 1 if j == n2 else j // 2 + 1
            north = below[i - 1, j]
            south = below[i, j]
            west = right[i, j - 1]
            east = right[i, j]
            nw = north * w[top, left, 1, 2] + west * w[top, left, 2, 1]
            ne = north * w[top, right_one, 1, 0] + east * w[top, right_one, 2, 1]
            sw = south * w[bottom, left, 1, 2] + west * w[bottom, left, 0, 1]
            se = south * w[bottom, right_one, 1, 0] + east * w[bottom, right_one, 0, 1]
            if nine:
                nw += below_right[i - 1, j - 1]
                ne += below_left[i - 1, j + 1]
                sw += below_left[i, j]
                se += below_right[i, j]
            w[top, left, 2, 2] = _share(nw, c)
            w[top, right_one, 2, 0] = _share(ne, c)
            w[bottom, left, 0, 2] = _share(sw, c)
            w[bottom, right_one, 0, 0] = _share(se, c)
        if ring:
            _round(w, i // 2, 2)
            _round(w, i // 2 + 1, 0)


@inner(**REORDERED)
def _round(w, i, a):
    """Copy weights of a row around a ring."""
    m2 = w.shape[1] - 2
    for b in range(3):
        w[i, 0, a, b], w[i, m2 + 1, a, b] = w[i, m2, a, b], w[i, 1, a, b]


@by_rows(**REORDERED)
def _galerkin(first, end, w, operator, nine, ring, to):
    """PᵀAP: write centres and conductances of some rows of the next level, in the order of these."""
    centre, right, below, below_right, below_left = operator
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    m2 = w.shape[1] - 2
    row = np.empty((5, 5))  # of A P_I at the fine nodes around a coarse one
    out = np.empty(5)
    for ci in range(first, end):
        for cj in range(1, m2 + 1):
            for a in range(25):
                row[a // 5, a % 5] = 0.0
            for a in range(3):
                i = 2 * ci - 2 + a
                if i < 1 or i > n1:
                    continue
                for b in range(3):
                    v = w[ci, cj, a, b]
                    j = 2 * cj - 2 + b
                    if j < 1:
                        j = n2 if ring else 0
                    if v == 0.0 or j < 1 or j > n2:
                        continue
                    row[a + 1, b + 1] += centre[i, j] * v
                    row[a + 1, b] -= right[i, j - 1] * v
                    row[a + 1, b + 2] -= right[i, j] * v
                    row[a, b + 1] -= below[i - 1, j] * v
                    row[a + 2, b + 1] -= below[i, j] * v
                    if nine:
                        row[a, b] -= below_right[i - 1, j - 1] * v
                        row[a, b + 2] -= below_left[i - 1, j + 1] * v
                        row[a + 2, b] -= below_left[i, j] * v
                        row[a + 2, b + 2] -= below_right[i, j] * v
            # with itself and the coarse nodes at the right, below, below right and below left
            for k in range(5):
                di = (0, 0, 1, 1, 1)[k]
                dj = (0, 1, 0, 1, -1)[k]
                # the last and the first coarse node of an odd ring are neighbours on the finer one
                seam = (dj == 1 and cj == m2) or (dj == -1 and cj == 1)
                shift = dj if seam and n2 % 2 else 2 * dj
                s = 0.0
                for a in range(3):
                    y = 2 * di + a + 1
                    if y > 4:
                        continue
                    for b in range(3):
                        x = shift + b + 1
                        if 0 <= x <= 4:
                            s += w[ci + di, cj + dj, a, b] * row[y, x]
                out[k] = s
            to[0, ci, cj] = out[0]
            for k in range(1, 5):
                to[k, ci, cj] = -out[k]
        if ring:
            for k in range(1, 5):
                close_ring(to[k, ci])


@leader(**REORDERED)
def hierarchy(along, across, ring):
    """The levels of a stencil, and the last one eliminated."""
    fine = np.zeros((3, along.shape[0] + 1, along.shape[1] + 2))
    _links(fine[0], fine[1], fine[2], along, across, ring)
    return levels_of(fine, ring)


@leader(**REORDERED)
def levels_of(fine, ring):
    """`hierarchy` of an operator of five points: its centres, right and lower conductances, with a border."""
    none = np.zeros((1, 1))
    operator = fine[0], fine[1], fine[2], none, none
    levels: list[Level] = []
    fewest = 0.0
    while True:
        n1, n2 = operator[0].shape
        corners = np.zeros((2, n1, n2) if levels else (2, 1, 1), np.float32)
        f = np.zeros((6, n1, n2), np.float32)
        links = f[0], f[1], corners[0], corners[1]
        _store(f[2], links, operator)
        count = np.count_nonzero(f[2])
        if not levels:
            fewest = min(_ELIMINATED * count, _MOST_ELIMINATED)
        ends = min(n1, n2) - 2 <= FEWEST or count <= fewest
        m1, m2 = (0, 0) if ends else coarser(n1, n2)
        weights = np.zeros((m1, m2, 3, 3), np.float32)
        nine = len(levels) > 0
        levels.append(Level(links, f[2], f[3], f[4], f[5], weights))
        if ends:
            return levels, eliminated(operator, ring)
        to = np.zeros((5, m1, m2))
        _along_rows(weights, operator, nine, ring)
        _between_rows(weights, operator, nine, ring)
        _galerkin(weights, operator, nine, ring, to)
        operator = to[0], to[1], to[2], to[3], to[4]


@leader(**REORDERED)
def coarser(n1, n2):
    """Shape of the next level with the border."""
    return (n1 + 1) // 2 + 1, (n2 + 1) // 2 + 1


@by_rows(**REORDERED)
def _store(first, end, inverse, links, operator):
    """Write some rows of an operator to a level, Galerkin's negative conductances left out: a sweep with them might not
    converge.
    """
    centre, right, below, below_right, below_left = operator
    to_right, to_below, to_below_right, to_below_left = links
    nine = below_right.size > 1
    for i in range(first, end):
        for j in range(centre.shape[1]):
            to_right[i, j], to_below[i, j] = max(right[i, j], 0.0), max(below[i, j], 0.0)
            if nine:
                to_below_right[i, j] = max(below_right[i, j], 0.0)
                to_below_left[i, j] = max(below_left[i, j], 0.0)
            whole = centre[i, j]
            if whole > 0.0:
                if nine:
                    beside = min(right[i, j], 0.0) + min(right[i, j - 1], 0.0)
                    beside += min(below[i, j], 0.0) + min(below[i - 1, j], 0.0)
                    beside += min(below_right[i, j], 0.0) + min(below_right[i - 1, j - 1], 0.0)
                    whole -= (
                        beside + min(below_left[i, j], 0.0) + min(below_left[i - 1, j + 1], 0.0)
                    )
                inverse[i, j] = min(1.0 / whole, _MOST_INVERSE)
