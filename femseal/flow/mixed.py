"""Lowest-order Raviart-Thomas flux on a mesh: a lower bound of the flow, and the mixed discretisation of a cell.

The method is hybridised, so that its unknowns are potentials of facets and its matrix is positive definite. The flux is
made to balance exactly on every element, so that its energy bounds the flow whatever the error of the solver.
Sources: Thomson's principle; Arnold & Brezzi, RAIRO M2AN 19, 1985, 7 (hybridisation).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, ElementQuadRT0, ElementTriRT0, Mesh

from . import forms
from .balance import balanced_flux
from .reach import elements_reached, open_facets
from .solution import DarcyFlow
from .solvers.amg import solve_spd

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def flux_conductance(
    mesh: Mesh,
    tensor: Array,
    ends: tuple[Indices, Indices],
    element: ElementTriRT0 | ElementQuadRT0,
    intorder: int,
    *,
    rtol: float,
    solver: str = "auto",
) -> DarcyFlow:
    """Q²/∫ q·K⁻¹q of the lowest-order Raviart-Thomas flux; 0 if open elements connect in corners only.

    Parameters
    ----------
    mesh : straight.
    tensor : K, invertible where not 0 (elements, 2, 2), of any one unit.
    ends : boundary facets of inlet and outlet.
    element, intorder : of the flux, and the degree that its quadrature integrates exactly.
    rtol : error of the potential allowed in the norm of the energy; balancing the flux magnifies it.
    solver : of the linear system.

    Returns
    -------
    DarcyFlow, `potential` the mean of each element.

    Raises
    ------
    NotConverged : the linear solver failed.
    """
    carrying, at_inlet, at_outlet = elements_reached(mesh, tensor, ends, through_corners=False)
    potential = np.full(mesh.nelements, np.nan)
    potential[at_inlet], potential[at_outlet] = 1.0, 0.0
    if carrying.size == 0:
        return DarcyFlow(0.0, potential, 1 - potential, False)
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
    inlet, outlet = (open_facets(mesh, f, carrying) for f in ends)
    lam = np.zeros(mesh.nfacets)
    lam[inlet] = 1.0
    unknown = np.setdiff1d(np.unique(facets), np.concatenate([inlet, outlet]))
    iterations, residual, used = 0, 0.0, "none"
    if unknown.size:
        rows_of = matrix[unknown]
        found = solve_spd(rows_of[:, unknown], -(rows_of @ lam), rtol, solver, unit_drop=True)
        lam[unknown] = found.x
        iterations, residual, used = found.iterations, found.residual, found.solver
    # differences within an element: no cancellation where λ is nearly constant
    drop = lam[facets] - lam[facets[:, :1]]
    flux = -np.einsum("eij,ej->ei", schur, drop)
    flux, total = _balanced_on_facets(mesh, facets, carrying, flux, local, (inlet, outlet))
    conductance = total**2 / float(np.einsum("ei,eij,ej->", flux, local, flux))
    potential[carrying] = (column * lam[facets]).sum(axis=1) / column.sum(axis=1)
    return DarcyFlow(conductance, potential, 1 - potential, True, iterations, residual, 0.0, used)


def _balanced_on_facets(
    mesh: Mesh,
    facets: Indices,
    carrying: Indices,
    flux: Array,
    local: Array,
    ends: tuple[Indices, Indices],
) -> tuple[Array, float]:
    """Outward fluxes (elements, facets) that balance on elements and agree on facets, and the total flow."""
    node = np.zeros(mesh.nelements, np.int64)
    node[carrying] = np.arange(1, carrying.size + 1)
    first, second = mesh.f2t
    sign = np.where(first[facets] == carrying[:, None], 1.0, -1.0)
    sides = np.bincount(facets.ravel(), minlength=mesh.nfacets)
    mean = np.bincount(facets.ravel(), (sign * flux).ravel(), mesh.nfacets) / np.maximum(sides, 1)
    resistance = np.bincount(facets.ravel(), np.einsum("eii->ei", local).ravel(), mesh.nfacets)
    # links: facets between two carrying elements, and those of the ends, whose outer side is node 0
    link = np.concatenate([np.flatnonzero(sides == 2), *ends])
    tail, head = node[first[link]], np.where(second[link] >= 0, node[second[link]], 0)
    on_facet = np.zeros(mesh.nfacets)
    on_facet[link] = balanced_flux(tail, head, 1 / resistance[link], mean[link], carrying.size + 1)
    totals = [abs(float(on_facet[f].sum())) for f in ends]
    return sign * on_facet[facets], min(totals)
