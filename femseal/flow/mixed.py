"""Lowest-order Raviart-Thomas flux on a mesh: a lower bound of the flow.

The method is hybridised, so that its unknowns are potentials of facets and its matrix is positive definite. The flux is
made to balance exactly on every element, so that its energy bounds the flow whatever the error of the solver.
Sources: Thomson's principle; Arnold & Brezzi, RAIRO M2AN 19, 1985, 7 (hybridisation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from skfem import Basis, ElementQuadRT0, ElementTriRT0, Mesh

from ..base.arrays import Array, Indices
from . import forms
from .balance import balanced_flux
from .connected_elements import connected_elements, elements_between, open_facets
from .solvers.amg import solve_spd


def flux_conductance(
    mesh: Mesh,
    tensor: Array,
    ends: tuple[Indices, Indices],
    element: ElementTriRT0 | ElementQuadRT0,
    intorder: int,
    *,
    rtol: float,
    solver: str = "auto",
) -> float:
    """Q²/∫ q·K⁻¹q of the lowest-order Raviart-Thomas flux; 0 if open elements connect in corners only.

    mesh : straight.
    tensor : K, invertible where not 0 (elements, 2, 2), of any one unit.
    ends : boundary facets of inlet and outlet.
    element, intorder : of the flux, and the degree that its quadrature integrates exactly.
    rtol : error of the potential allowed in the norm of the energy; balancing the flux magnifies it.
    solver : of the linear system.

    Raises NotConverged: the linear solver failed.
    """
    carrying, _, _ = connected_elements(mesh, tensor, ends, through_corners=False)
    if carrying.size == 0:
        return 0.0
    system = _Hybrid.of(mesh, tensor, element, intorder, carrying)
    inlet, outlet = (open_facets(mesh, f, carrying) for f in ends)
    lam = np.zeros(mesh.nfacets)
    lam[inlet] = 1.0
    system.solve(lam, (inlet, outlet), rtol, solver, unit_drop=True)
    flux, on_facet = system.balanced(lam, (inlet, outlet))
    total = min(abs(float(on_facet[f].sum())) for f in (inlet, outlet))
    return total**2 / float(np.einsum("ei,eij,ej->", flux, system.local, flux))


def flux_rates(
    mesh: Mesh,
    tensor: Array,
    ends: Sequence[Indices],
    levels: Sequence[float],
    element: ElementTriRT0 | ElementQuadRT0,
    intorder: int,
    *,
    rtol: float,
    solver: str = "auto",
) -> Array:
    """Flow into the mesh through each of several boundaries of given potentials (ends,).

    It is that of the lowest-order Raviart-Thomas flux, which balances on every element, so that its sum is 0 up to
    rounding; 0 at boundaries without an open path to another.

    ends : facets of the boundaries. levels : their potentials. The others are those of `flux_conductance`.

    Raises NotConverged: the linear solver failed.
    """
    carrying, _, joined = elements_between(mesh, tensor, ends, through_corners=False)
    if carrying.size == 0:
        return np.zeros(len(ends))
    with_potential = [open_facets(mesh, f, carrying) if more else f[:0] for f, more in zip(ends, joined, strict=True)]
    lam = np.zeros(mesh.nfacets)
    for facets, level in zip(with_potential, levels, strict=True):
        lam[facets] = level
    system = _Hybrid.of(mesh, tensor, element, intorder, carrying)
    system.solve(lam, with_potential, rtol, solver)
    _, on_facet = system.balanced(lam, with_potential)
    return np.array([-float(on_facet[facets].sum()) for facets in with_potential])


@dataclass(frozen=True, eq=False)
class _Hybrid:
    """The hybridised system of the elements that carry the flow.

    facets (elements, facets) : numbers of the facets of each element. local : resistance of the fluxes through them.
    schur : conductance between the potentials of the facets of each element, and matrix : of all facets.
    """

    mesh: Mesh
    carrying: Indices
    facets: Indices
    local: Array
    schur: Array
    matrix: sp.csr_array

    @classmethod
    def of(
        cls, mesh: Mesh, tensor: Array, element: ElementTriRT0 | ElementQuadRT0, intorder: int, carrying: Indices
    ) -> _Hybrid:
        """Assemble the system of the carrying elements."""
        basis = Basis(mesh, element, intorder=intorder, elements=carrying)
        resistance = np.moveaxis(np.linalg.inv(tensor[carrying]), 0, -1)[..., None]
        local = forms.flux_resistance.coo_data(basis, resistance=resistance).tolocal()
        facets = mesh.t2f[:, carrying].T
        # a basis function is a unit flux out of the facet's first element: turn it outward
        outward = np.where(mesh.f2t[0, facets] == carrying[:, None], 1.0, -1.0)
        local = local * outward[:, :, None] * outward[:, None, :]
        # A q = p − λ and Σq = 0 on each element give q = −S λ
        inverse = np.linalg.inv(local)
        column = inverse.sum(axis=2)
        schur = inverse - column[:, :, None] * column[:, None, :] / column.sum(axis=1)[:, None, None]
        n = facets.shape[1]
        rows, cols = np.repeat(facets, n, axis=1), np.tile(facets, (1, n))
        matrix = sp.coo_array((schur.ravel(), (rows.ravel(), cols.ravel())), shape=(mesh.nfacets, mesh.nfacets)).tocsr()
        return cls(mesh, carrying, facets, local, schur, matrix)

    def solve(
        self, lam: Array, dirichlet: Sequence[Indices], rtol: float, solver: str, *, unit_drop: bool = False
    ) -> None:
        """Fill in the potentials of all facets but those of the Dirichlet ends."""
        unknown = np.setdiff1d(np.unique(self.facets), np.concatenate(dirichlet))
        rows_of = self.matrix[unknown]
        rhs = -(rows_of @ lam)
        if rhs.any():
            lam[unknown] = solve_spd(rows_of[:, unknown], rhs, rtol, solver, unit_drop=unit_drop).x

    def balanced(self, lam: Array, dirichlet: Sequence[Indices]) -> tuple[Array, Array]:
        """Outward fluxes (elements, facets) that balance on elements and agree on facets, and those of all facets, out
        of their first element."""
        mesh, facets, carrying = self.mesh, self.facets, self.carrying
        # differences within an element: no cancellation where λ is nearly constant
        drop = lam[facets] - lam[facets[:, :1]]
        flux = -np.einsum("eij,ej->ei", self.schur, drop)
        node = np.zeros(mesh.nelements, np.int64)
        node[carrying] = np.arange(1, carrying.size + 1)
        first, second = mesh.f2t
        sign = np.where(first[facets] == carrying[:, None], 1.0, -1.0)
        sides = np.bincount(facets.ravel(), minlength=mesh.nfacets)
        mean = np.bincount(facets.ravel(), (sign * flux).ravel(), mesh.nfacets) / np.maximum(sides, 1)
        resistance = np.bincount(facets.ravel(), np.einsum("eii->ei", self.local).ravel(), mesh.nfacets)
        # links: facets between two carrying elements, and those of the ends, whose outer side is node 0
        link = np.concatenate([np.flatnonzero(sides == 2), *dirichlet])
        tail, head = node[first[link]], np.where(second[link] >= 0, node[second[link]], 0)
        on_facet = np.zeros(mesh.nfacets)
        on_facet[link] = balanced_flux(tail, head, 1 / resistance[link], mean[link], carrying.size + 1)
        return sign * on_facet[facets], on_facet
