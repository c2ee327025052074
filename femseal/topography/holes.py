"""Undefined points of a measured map filled by the harmonic surface through their rims, ∇²z = 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve


def fill_holes(heights: NDArray, spacing: tuple[float, float], periodic: tuple[bool, bool]) -> NDArray:
    """`heights` (n1, n2) [m] with every NaN replaced; at least one point must be defined.

    Five-point Laplacian on the holes, defined neighbours as Dirichlet values, wrapped on periodic axes, no
    flux through the other borders. Exact for a plane in holes that do not touch a border; the filled values
    stay between the extremes of the rim (maximum principle), so a hole adds no new summit.
    """
    holes = np.argwhere(np.isnan(heights))
    if not len(holes):
        return heights
    number = np.full(heights.shape, -1)
    number[tuple(holes.T)] = np.arange(len(holes))
    diagonal, right = np.zeros(len(holes)), np.zeros(len(holes))
    rows, columns, values = [], [], []
    for axis in (0, 1):
        n, weight = heights.shape[axis], (spacing[0] / spacing[axis]) ** 2
        for step in (-1, 1):
            at = holes.copy()
            at[:, axis] += step
            inside = np.full(len(at), True) if periodic[axis] else (at[:, axis] >= 0) & (at[:, axis] < n)
            at[:, axis] %= n
            neighbour = number[tuple(at.T)]
            unknown, known = inside & (neighbour >= 0), inside & (neighbour < 0)
            diagonal[inside] += weight
            right[known] += weight * heights[tuple(at[known].T)]
            rows.append(np.flatnonzero(unknown))
            columns.append(neighbour[unknown])
            values.append(np.full(np.count_nonzero(unknown), -weight))
    index = np.arange(len(holes))
    entries = np.concatenate([*values, diagonal])
    where = (np.concatenate([*rows, index]), np.concatenate([*columns, index]))
    laplacian = sparse.csc_array((entries, where), shape=(len(holes), len(holes)))
    filled = heights.copy()
    filled[tuple(holes.T)] = spsolve(laplacian, right)
    return filled
