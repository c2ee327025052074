"""The operator of the finest level of multigrid, from the conductances of a stencil: compiled."""

from __future__ import annotations

from numba import njit

from .compiled import COMPILED


@njit(**COMPILED)
def straight_links(first, end, along, across, ring, centre, right, below):
    """Write centres and conductances of some rows of a stencil, but for those across corners."""
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


@njit(**COMPILED)
def corner_links(falling, rising, ring, centre, below_right, below_left):
    """Add the conductances across corners of a stencil."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    for i in range(n1 + 1):
        for j in range(falling.shape[1]):
            k = (j + 1) % n2
            down, up = falling[i, j], rising[i, j]
            if i > 0:
                centre[i, j + 1] += down
                centre[i, k + 1] += up
            if i < n1:
                centre[i + 1, k + 1] += down
                centre[i + 1, j + 1] += up
            if 0 < i < n1:
                below_right[i, j + 1] = down
                below_left[i, k + 1] = up
        if ring:
            below_right[i, 0], below_right[i, n2 + 1] = below_right[i, n2], below_right[i, 1]
            below_left[i, 0], below_left[i, n2 + 1] = below_left[i, n2], below_left[i, 1]
