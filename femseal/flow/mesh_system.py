"""The linear system of a flow through a mesh: local matrices, summed where degrees of freedom are free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..base.arrays import Array, Indices
from .solvers.amg import LinearSolution, solve_spd


@dataclass(frozen=True, eq=False)
class MeshSystem:
    """Where local matrices go: degrees of freedom of elements (n, m), and those of each boundary; `size` there are."""

    dofs: Indices
    ends: Sequence[Indices]
    size: int

    def solved(
        self, local: Array, levels: Sequence[float], rtol: float, solver: str
    ) -> tuple[Array, LinearSolution]:
        """Values that solve local matrices (n, m, m) between levels of the boundaries."""
        values = np.zeros(self.size)
        for level, at in zip(levels, self.ends, strict=True):
            values[at] = level
        if not self._unknown.size:
            return values, LinearSolution(values, 1 - values, 0, 0.0, "none")
        flux = np.einsum("nij,nj->ni", local, values[self.dofs])
        rhs = np.zeros(self.size)
        rhs -= np.bincount(self.dofs.ravel(), flux.ravel(), self.size)
        data = local.ravel()[self._inner]
        matrix = sp.coo_array((data, self._places), shape=(self._unknown.size,) * 2).tocsc()
        found = solve_spd(
            matrix, rhs[self._unknown], rtol, solver, unit_drop=tuple(levels) == (1.0, 0.0)
        )
        values[self._unknown] = found.x
        return values, found

    def into(self, flux: Array) -> Array:
        """What flows into the elements through each boundary, by what flows there from each degree of freedom."""
        total = np.bincount(self.dofs.ravel(), flux.ravel(), self.size)
        return np.array([float(total[at].sum()) for at in self.ends])

    @cached_property
    def _unknown(self) -> Indices:
        """Degrees of freedom between the boundaries."""
        free = np.zeros(self.size, bool)
        free[self.dofs] = True
        free[np.concatenate(self.ends)] = False
        return np.flatnonzero(free)

    @cached_property
    def _number(self) -> Indices:
        """Number of each degree of freedom among the unknown ones of its element, −1 where it is known (n, m)."""
        number = np.full(self.size, -1)
        number[self._unknown] = np.arange(self._unknown.size)
        return number[self.dofs]

    @cached_property
    def _inner(self) -> Indices:
        """Entries of local matrices between two unknowns."""
        of = self._number >= 0
        return np.flatnonzero((of[:, :, None] & of[:, None, :]).ravel())

    @cached_property
    def _places(self) -> tuple[Indices, Indices]:
        """Rows and columns of these entries."""
        m = self.dofs.shape[1]
        rows, columns = np.repeat(self._number, m, axis=1), np.tile(self._number, (1, m))
        return rows.ravel()[self._inner], columns.ravel()[self._inner]
