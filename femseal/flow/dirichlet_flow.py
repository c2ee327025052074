"""Darcy flow on a mesh between several boundaries of given potentials (Dirichlet); other sides are closed (Neumann).

Conforming elements as in `mesh`, in one solution. The flow through one of several boundaries is no energy, so that no
principle bounds it from both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from skfem import Basis, Mesh

from ..base import Array, Indices, NotConverged
from . import forms
from .connected_elements import elements_between, open_facets
from .mesh import KINDS, RTOL, invertible, permeability_tensors
from .mixed import flux_rates
from .solution import MAX_IMBALANCE
from .solvers.amg import solve_spd


@dataclass(frozen=True)
class DirichletFlow:
    """Flow between boundaries of given potentials.

    rates : into the mesh through every boundary (boundaries,) [unit of K × potential]; exactly 0 without an open path
        to another boundary.
    flux_rates : those of Raviart-Thomas fluxes, where asked for.
    potential : at the vertices; that of a boundary in its dead ends, NaN in closed pockets.
    joined : whether an open path joins each boundary to another one.
    iterations, residual, imbalance, solver : as in `DarcyFlow`; imbalance is relative to the flow into the mesh.
    """

    rates: Array
    flux_rates: Array | None
    potential: Array
    joined: NDArray[np.bool_]
    iterations: int = 0
    residual: float = 0.0
    imbalance: float = 0.0
    solver: str = "none"


def dirichlet_flow(
    mesh: Mesh,
    permeability: ArrayLike,
    boundaries: Sequence[Indices],
    levels: Sequence[float],
    *,
    fluxes: bool = False,
    solver: str = "auto",
) -> DirichletFlow:
    """Flow through a mesh between boundaries at several potentials.

    mesh, permeability, solver : as in `mesh.darcy_conductance`.
    boundaries : facets of each boundary; no two have a vertex in common. levels : their potentials, about 1.
    fluxes : also solve for Raviart-Thomas fluxes, on straight meshes.

    Raises InputError: a bad permeability.
    NotConverged : inflow and outflow differ by more than 1e-5, or the linear solver failed.
    """
    kind = KINDS[type(mesh)]
    tensor = permeability_tensors(permeability, mesh.nelements)
    scale = float(np.abs(tensor).max()) or 1.0
    tensor = tensor / scale
    carrying, alone, joined = elements_between(mesh, tensor, boundaries, through_corners=True)
    potential, rates = np.full(mesh.nvertices, np.nan), np.zeros(len(boundaries))
    for level, elements in zip(levels, alone, strict=True):
        potential[mesh.t[:, elements]] = level
    for level, facets in zip(levels, boundaries, strict=True):
        potential[mesh.facets[:, facets]] = level
    if carrying.size == 0:
        return DirichletFlow(rates, np.zeros_like(rates) if fluxes else None, potential, joined)
    tensor = invertible(tensor)
    basis = Basis(mesh, kind.element(), intorder=kind.intorder, elements=carrying)
    matrix = forms.darcy_flow.assemble(basis, k=np.moveaxis(tensor[carrying], 0, -1)[..., None]).tocsr()
    ends = [open_facets(mesh, f, carrying) if more else f[:0] for f, more in zip(boundaries, joined, strict=True)]
    dofs = [basis.get_dofs(facets).flatten() for facets in ends]
    phi, free = np.zeros(basis.N), np.zeros(basis.N, bool)
    free[basis.element_dofs] = True
    for level, at in zip(levels, dofs, strict=True):
        phi[at], free[at] = level, False
    unknown = np.flatnonzero(free)
    rows = sp.csr_array(matrix)[unknown]
    found, rhs = None, -(rows @ phi)
    if rhs.any():
        # a flow through a boundary errs by as much as the potential, not by its square as an energy does
        found = solve_spd(rows[:, unknown], rhs, RTOL, solver)
        phi[unknown] = found.x
    # the rows of the matrix sum to 0: differences from the level of a boundary do not cancel there
    through = [(matrix[at] @ (phi - level)).sum() for level, at in zip(levels, dofs, strict=True)]
    rates = np.where(joined, through, 0.0)
    into = float(np.maximum(rates, 0.0).sum())
    imbalance = abs(float(rates.sum())) / into if into > 0 else 0.0
    if not imbalance <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: inflow and outflow differ by {imbalance:.1e} of the flow, expected {MAX_IMBALANCE:.0e}; "
            "try a smaller contrast of the permeability",
            imbalance,
        )
    vertices = mesh.t[:, carrying]
    potential[vertices] = phi[basis.nodal_dofs[0, vertices]]
    of_fluxes = None
    if fluxes and kind.flux_element is not None:
        element = kind.flux_element()
        of_fluxes = scale * flux_rates(
            mesh, tensor, boundaries, levels, element, kind.intorder, rtol=RTOL, solver=solver
        )
    solved = (found.iterations, found.residual, imbalance, found.solver) if found else (0, 0.0, imbalance, "none")
    return DirichletFlow(scale * rates, of_fluxes, potential, joined, *solved)
