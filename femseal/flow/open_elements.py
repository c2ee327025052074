"""Flow through a mesh whose elements are all open: its forms are assembled once, for many permeabilities.

The value is √(upper × lower) of the two bounds, of linear elements and of lowest-order Raviart-Thomas fluxes, which are
hybridised as in `mixed`. A drawn seal is solved some hundred times on the same mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from skfem import Basis, Mesh

from ..base.arrays import Array, Indices
from . import forms
from .mesh import KINDS, RTOL
from .solution import DarcyFlow, potential_rtol
from .solvers.amg import LinearSolution, solve_spd

#: Components of a symmetric tensor, by their unit tensors.
_UNITS = (np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0.0, 1.0], [1.0, 0.0]]))


@dataclass(frozen=True, eq=False)
class OpenElements:
    """Operators of a mesh of straight sides between facets of its ends.

    mesh : see `mesh.darcy_conductance`. inlet, outlet : boundary facets.
    """

    mesh: Mesh = field(repr=False)
    inlet: Indices = field(repr=False)
    outlet: Indices = field(repr=False)

    def flow(self, tensor: Array, solver: str = "auto", *, bounds: bool = True) -> DarcyFlow:
        """Flow for a unit drop through tensors (n, 2, 2) [m³], all of them positive definite.

        Without `bounds` it is that of linear elements alone.

        Raises NotConverged: the linear solver failed.
        """
        scale = float(np.abs(tensor).max())
        k = np.array([tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]]) / scale
        upper, potential, found = self._potential.solved(np.einsum("cn,cnij->nij", k, self._stiffness), solver)
        counts = (found.iterations, found.residual, 0.0, found.solver) if found else (0, 0.0, 0.0, "none")
        if not bounds:
            return DarcyFlow(scale * upper, potential, 1 - potential, True, *counts)
        det = k[0] * k[1] - k[2] ** 2
        inverse = np.array([k[1], k[0], -k[2]]) / det
        inverted = np.linalg.inv(np.einsum("cn,cnij->nij", inverse, self._resistance))
        column = inverted.sum(axis=2)
        schur = inverted - column[:, :, None] * column[:, None, :] / column.sum(axis=1)[:, None, None]
        lower, _, _ = self._facets.solved(schur, solver)
        lower = min(lower, upper)
        value = scale * float(np.sqrt(lower) * np.sqrt(upper))
        return DarcyFlow(value, potential, 1 - potential, True, *counts, lower=scale * lower, upper=scale * upper)

    @cached_property
    def _stiffness(self) -> Array:
        """Local matrices of linear elements, of every component (3, n, vertices, vertices)."""
        kind = KINDS[type(self.mesh)]
        basis = Basis(self.mesh, kind.element(), intorder=kind.intorder)
        return np.stack([forms.darcy_flow.coo_data(basis, k=_constant(unit)).tolocal() for unit in _UNITS])

    @cached_property
    def _resistance(self) -> Array:
        """Local resistances of outward fluxes, of every component (3, n, facets, facets)."""
        kind = KINDS[type(self.mesh)]
        assert kind.flux_element is not None
        basis = Basis(self.mesh, kind.flux_element(), intorder=kind.intorder)
        facets = self.mesh.t2f.T
        # a basis function is a unit flux out of the facet's first element
        outward = np.where(self.mesh.f2t[0, facets] == np.arange(len(facets))[:, None], 1.0, -1.0)
        local = [forms.flux_resistance.coo_data(basis, resistance=_constant(unit)).tolocal() for unit in _UNITS]
        return np.stack(local) * outward[:, :, None] * outward[:, None, :]

    @cached_property
    def _potential(self) -> _System:
        """Potentials of the vertices."""
        ends = [np.unique(self.mesh.facets[:, facets]) for facets in (self.inlet, self.outlet)]
        return _System.of(self.mesh.t.T, self.mesh.nvertices, ends)

    @cached_property
    def _facets(self) -> _System:
        """Potentials of the facets."""
        return _System.of(self.mesh.t2f.T, self.mesh.nfacets, [self.inlet, self.outlet])


def _constant(unit: Array) -> Array:
    return unit[:, :, None, None]


@dataclass(frozen=True, eq=False)
class _System:
    """Where local matrices go: degrees of freedom of elements (n, m), those at the inlet, and free ones by number."""

    dofs: Indices
    inlet: Indices
    unknown: Indices
    number: Indices

    @classmethod
    def of(cls, dofs: Indices, size: int, ends: Sequence[Indices]) -> _System:
        """Number the degrees of freedom between the ends."""
        free = np.ones(size, bool)
        free[np.concatenate(ends)] = False
        unknown = np.flatnonzero(free)
        number = np.full(size, -1)
        number[unknown] = np.arange(unknown.size)
        return cls(dofs, ends[0], unknown, number)

    def solved(self, local: Array, solver: str) -> tuple[float, Array, LinearSolution | None]:
        """Energy of the values that solve local matrices (n, m, m), 1 at the inlet and 0 at the outlet, and they."""
        values = np.zeros(self.number.size)
        values[self.inlet] = 1.0
        found = None
        if self.unknown.size:
            flux = (local @ values[self.dofs][:, :, None]).ravel()
            rhs = np.zeros(self.number.size)
            rhs -= np.bincount(self.dofs.ravel(), flux, self.number.size)
            rows, columns = self._places
            data = local.ravel()[self._inner]
            matrix = sp.coo_array((data, (rows, columns)), shape=(self.unknown.size,) * 2).tocsc()
            found = solve_spd(matrix, rhs[self.unknown], potential_rtol(RTOL), solver, unit_drop=True)
            values[self.unknown] = found.x
        # differences within an element: no cancellation where values are nearly constant
        drop = values[self.dofs] - values[self.dofs[:, :1]]
        return float(np.einsum("ni,nij,nj->", drop, local, drop)), values, found

    @cached_property
    def _inner(self) -> Indices:
        """Entries of local matrices between two free degrees of freedom."""
        of = self.number[self.dofs] >= 0
        return np.flatnonzero((of[:, :, None] & of[:, None, :]).ravel())

    @cached_property
    def _places(self) -> tuple[Indices, Indices]:
        """Rows and columns of these entries."""
        m = self.dofs.shape[1]
        rows = np.repeat(self.number[self.dofs], m, axis=1).ravel()
        columns = np.tile(self.number[self.dofs], (1, m)).ravel()
        return rows[self._inner], columns[self._inner]
