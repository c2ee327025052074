"""The levels of multigrid on a structured grid, from the conductances of the finest one: compiled.

A level is the operator of a grid, with the fields that a multigrid cycle needs there. It is set up in double precision
and kept in single: a cycle is a preconditioner, and starts from zero, so that its rounding errors are relative to the
correction. Fields have a border of one node, with zeros at ends and closed sides and with copies of the other side
around a ring. They have the sign of a conductance: `right` (i, j)–(i, j + 1), `below` (i, j)–(i + 1, j); the finest
level has five points, coarser ones nine: `below_right` (i, j)–(i + 1, j + 1), `below_left` (i, j)–(i + 1, j − 1).
A node between coarse ones takes the mean of them that its own conductances would give it; coarse operators are
Galerkin's. Source: Dendy, J. Comput. Phys. 48, 1982, 366 (black box multigrid).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Array
from ...base.compiled import REORDERED, compiled, inner
from ...base.threads import ONE, over

#: Nodes of an axis at which coarsening ends.
FEWEST = 4
#: Coarsening also ends where so small a fraction of the nodes is left: their elimination costs less than the iterations
#: that bays and channels of the coarser grids do.
_ELIMINATED = 1 / 40
#: Largest inverse of a centre; single precision ends at 3e38.
_MOST_INVERSE = 1e30
#: Nodes from which threads share the work on a level, and rows of a strip.
_LARGE, _STRIP = 2**18, 64
#: Nodes of a level from which its fields stand apart, and rows between them.
_MANY, _APART = 2**16, 64
#: No operator.
_NOTHING: tuple[Array, ...] = (np.zeros((0, 0)),) * 5


def strips(rows: int) -> list[tuple[int, int]]:
    """First and last + 1 of the strips of a field of so many rows, the border among them."""
    return [(i, min(i + _STRIP, rows - 1)) for i in range(1, rows - 1, _STRIP)]


def large_levels(shape: NDArray[np.int64]) -> int:
    """Number of levels that threads share; the coarsest is none of them."""
    return sum(n1 * n2 >= _LARGE for n1, n2 in shape[:-1].tolist())


class Levels(NamedTuple):
    """All levels of multigrid in a few arrays; `level` gives views of one.

    shape (levels, 2) : rows and columns with the border. first (levels + 1,) : where the fields of each level start.
    fields : right, below, inverse centre, x, b and r, of coarser levels also below right and below left, see `level`.
    weight_first, weights : of the interpolation from the next level.
    """

    shape: NDArray[np.int64]
    first: NDArray[np.int64]
    fields: NDArray[np.float32]
    weight_first: NDArray[np.int64]
    weights: NDArray[np.float32]


@compiled(**REORDERED)
def level(shape, first, fields, k):
    """Views of level k, of the first fields of `Levels`: the six fields, below right and below left.

    The last two have one number each on the finest level.
    """
    n1, n2, own = shape[k, 0], shape[k, 1], fields[first[k] : first[k + 1]]
    rows = n1 + _rows_apart(n1 * n2)
    f = own.reshape((own.size // (rows * n2), rows, n2))
    six = f[0, :n1], f[1, :n1], f[2, :n1], f[3, :n1], f[4, :n1], f[5, :n1]
    if f.shape[0] > 6:
        return *six, f[6, :n1], f[7, :n1]
    none = own[:1].reshape((1, 1))
    return *six, none, none


@compiled(**REORDERED)
def _rows_apart(nodes):
    """Rows between the fields of a level, which nothing is written to: else nodes of 2ⁿ columns share cache lines."""
    return _APART if nodes >= _MANY else 0


@compiled(**REORDERED)
def weights_to(k, shape, weight_first, weights):
    """View of the weights of level k + 1 at the nodes of level k."""
    return weights[weight_first[k] : weight_first[k + 1]].reshape(
        (shape[k + 1, 0], shape[k + 1, 1], 3, 3)
    )


@compiled(**REORDERED)
def _links(first, end, along, across, ring, centre, right, below):
    """Write centres and conductances of some rows of a stencil."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    for i in range(first, end):
        for j in range(1, across.shape[1] + 1):
            right[i, j] = across[i - 1, j - 1]
        if ring:
            right[i, 0], right[i, n2 + 1] = right[i, n2], right[i, 1]
        for j in range(1, n2 + 1):
            if i < n1:
                below[i, j] = along[i, j - 1]
            centre[i, j] = along[i - 1, j - 1] + along[i, j - 1] + right[i, j - 1] + right[i, j]
        if ring:
            below[i, 0], below[i, n2 + 1] = below[i, n2], below[i, 1]


@inner(**REORDERED)
def _share(part, whole):
    """part / whole, or 0 if either is not > 0."""
    return part / whole if part > 0.0 and whole > 0.0 else 0.0


@compiled(**REORDERED)
def _along_rows(first, end, centre, right, below, below_right, below_left, nine, ring, w):
    """Write the weight w of each coarse node, at (2I − 1, 2J − 1), at itself and beside it in some coarse rows."""
    n2, m2 = centre.shape[1] - 2, w.shape[1] - 2
    for i in range(2 * first - 1, 2 * end - 1, 2):
        for j in range(1, m2 + 1):
            w[(i + 1) // 2, j, 1, 1] = 1.0
        # links above and below are added to those along the row, or left out
        for j in range(2, n2 + 1, 2):
            west, east = right[i, j - 1], right[i, j]
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


@compiled(**REORDERED)
def _between_rows(first, end, centre, right, below, below_right, below_left, nine, ring, w):
    """Write the weights of coarse nodes in the rows after some coarse rows, once those of `_along_rows` are there."""
    n1, n2, m2 = centre.shape[0] - 2, centre.shape[1] - 2, w.shape[1] - 2
    for i in range(2 * first, min(2 * end, n1 + 1), 2):
        for j in range(1, n2 + 1, 2):
            north, south = below[i - 1, j], below[i, j]
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
            north, south, west, east = below[i - 1, j], below[i, j], right[i, j - 1], right[i, j]
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


@compiled(**REORDERED)
def _galerkin(
    first, end, centre, right, below, below_right, below_left, w, nine, ring, to0, to1, to2, to3, to4
):  # fmt: skip
    """PᵀAP: write centres and conductances of some rows of the next level, in the order of these."""
    n1, n2, m2 = centre.shape[0] - 2, centre.shape[1] - 2, w.shape[1] - 2
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
            to0[ci, cj], to1[ci, cj], to2[ci, cj], to3[ci, cj], to4[ci, cj] = (
                out[0],
                -out[1],
                -out[2],
                -out[3],
                -out[4],
            )
        if ring:
            to1[ci, 0], to1[ci, m2 + 1] = to1[ci, m2], to1[ci, 1]
            to2[ci, 0], to2[ci, m2 + 1] = to2[ci, m2], to2[ci, 1]
            to3[ci, 0], to3[ci, m2 + 1] = to3[ci, m2], to3[ci, 1]
            to4[ci, 0], to4[ci, m2 + 1] = to4[ci, m2], to4[ci, 1]


def hierarchy(along: Array, across: Array, ring: bool) -> tuple[Levels, tuple[Array, ...]]:
    """`Levels` of a stencil, and centres and conductances of the coarsest one in double precision."""
    place = _places(along.shape[0] - 1, along.shape[1])
    shape, *_, weight_first, weights = place
    fewest, large = 0.0, large_levels(shape)
    operator = _NOTHING
    if large:
        operator = *np.zeros((3, *shape[0])), *np.zeros((2, 1, 1))
        over(strips(shape[0, 0]), _links, along, across, ring, *operator[:3])
    for k in range(large):
        count = sum(over(strips(shape[k, 0]), _store, *operator, *level(*place[:3], k)))
        fewest = fewest or _ELIMINATED * count
        if count <= fewest:
            return _levels(place, k + 1), operator
        rows, w = strips(shape[k + 1, 0]), weights_to(k, shape, weight_first, weights)
        over(rows, _along_rows, *operator, k > 0, ring, w)
        over(rows, _between_rows, *operator, k > 0, ring, w)
        coarse = tuple(np.zeros((5, *shape[k + 1])))
        over(rows, _galerkin, *operator, w, k > 0, ring, *coarse)
        operator = coarse
    count, operator = _filled_from(large, operator, along, across, fewest, ring, *place)
    return _levels(place, count), operator


def _places(n1: int, n2: int) -> tuple[NDArray[Any], ...]:
    """Sizes and memory of what the levels have, in the order of `Levels`."""
    shape, first, weight_first = _sizes(n1, n2, FEWEST)
    # zeros of numpy take no memory before they are written to
    return (
        shape,
        first,
        np.zeros(first[-1], np.float32),
        weight_first,
        np.zeros(weight_first[-1], np.float32),
    )


@lru_cache(16)
def _sizes(n1: int, n2: int, fewest: int) -> tuple[NDArray[np.int64], ...]:
    """Sizes of all levels, and where their fields and weights start, see `Levels`."""
    sizes = [(n1 + 2, n2 + 2)]
    while min(n1, n2) > fewest:
        n1, n2 = (n1 + 1) // 2, (n2 + 1) // 2
        sizes.append((n1 + 2, n2 + 2))
    nodes = np.array([a * b for a, b in sizes])
    each = [6] + [8] * (len(sizes) - 1)
    fields = [
        count * (a + _rows_apart(a * b)) * b for count, (a, b) in zip(each, sizes, strict=True)
    ]
    return np.array(sizes), np.cumsum([0, *fields]), 9 * (np.cumsum(nodes) - nodes[0])


def _levels(place: tuple[NDArray[Any], ...], n: int) -> Levels:
    """`Levels` of which n are filled."""
    shape, first, fields, weight_first, weights = place
    return Levels(shape[:n], first[: n + 1], fields, weight_first[:n], weights)


@compiled(**REORDERED)
def _filled_from(
    k, operator, along, across, fewest, ring, shape, first, fields, weight_first, weights
):  # fmt: skip
    """Fill the levels from level k on, see `Levels`; their number, and the operator of the last one.

    For k > 0 `operator` has that of level k, and `fewest` nodes are those where coarsening ends.
    """
    if k == 0:
        size = shape[0, 0], shape[0, 1]
        operator = (
            np.zeros(size),
            np.zeros(size),
            np.zeros(size),
            np.zeros((1, 1)),
            np.zeros((1, 1)),
        )
        _links(ONE, size[0] - 1, along, across, ring, operator[0], operator[1], operator[2])
    while True:
        centre, right, below, below_right, below_left = operator
        of_level = level(shape, first, fields, k)
        count = _store(
            ONE, centre.shape[0] - 1, centre, right, below, below_right, below_left, *of_level
        )
        if k == 0:
            fewest = _ELIMINATED * count
        if k == shape.shape[0] - 1 or count <= fewest:
            break
        nine = k > 0
        m1, m2 = shape[k + 1, 0], shape[k + 1, 1]
        w = weights_to(k, shape, weight_first, weights)
        _along_rows(ONE, m1 - 1, centre, right, below, below_right, below_left, nine, ring, w)
        _between_rows(ONE, m1 - 1, centre, right, below, below_right, below_left, nine, ring, w)
        to0, to1, to2 = np.zeros((m1, m2)), np.zeros((m1, m2)), np.zeros((m1, m2))
        to3, to4 = np.zeros((m1, m2)), np.zeros((m1, m2))
        _galerkin(
            ONE, m1 - 1, centre, right, below, below_right, below_left, w, nine, ring, to0, to1, to2, to3, to4
        )  # fmt: skip
        operator = to0, to1, to2, to3, to4
        k += 1
    return k + 1, operator


@compiled(**REORDERED)
def _store(
    start, end, centre, right, below, below_right, below_left,
    to_right, to_below, inverse, x, b, r, to_below_right, to_below_left,
):  # fmt: skip
    """Write some rows of an operator to a level; the number of their nodes that have conductances."""
    count = 0
    for i in range(start, end):
        for j in range(centre.shape[1]):
            if centre[i, j] > 0.0:
                inverse[i, j] = min(1.0 / centre[i, j], _MOST_INVERSE)
                count += 1
            to_right[i, j], to_below[i, j] = right[i, j], below[i, j]
        if below_right.size > 1:
            for j in range(centre.shape[1]):
                to_below_right[i, j], to_below_left[i, j] = below_right[i, j], below_left[i, j]
    return count
