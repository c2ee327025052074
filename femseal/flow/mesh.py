"""Darcy flow on an unstructured mesh: ∇·(K∇φ) = 0, φ = 1 on the inlet, 0 on the outlet, no flow elsewhere.

Value and upper bound: conforming elements, P1 or Q1 on straight meshes (order 2 in the flow), isoparametric P2 or Q2 on
second-order meshes (order 4). Lower bound: `mixed`.

Symbols: K permeability [m³] (any unit: the conductance has the same), φ potential for a unit drop.
Source: Dirichlet's principle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from skfem import (
    Basis,
    ElementQuad1,
    ElementQuad2,
    ElementQuadRT0,
    ElementTriP1,
    ElementTriP2,
    ElementTriRT0,
    Mesh,
    MeshQuad1,
    MeshQuad2,
    MeshTri1,
    MeshTri2,
)
from skfem.mesh import MeshQuad1DG

from ..base import Array, Indices, InputError, NotConverged, counted
from . import forms
from .connected_elements import connected_elements, open_facets
from .mixed import flux_conductance
from .solution import MAX_IMBALANCE, DarcyFlow, potential_rtol
from .solvers.amg import solve_spd

#: A tensor closed along one principal axis keeps this fraction of its other value there, so that K⁻¹ exists.
CLOSED_AXIS = 1e-10
#: Relative error of the conductance.
RTOL = 1e-8


@dataclass(frozen=True)
class _Kind:
    """How one kind of mesh is discretised."""

    element: type
    flux_element: type | None
    intorder: int


KINDS = {
    MeshTri1: _Kind(ElementTriP1, ElementTriRT0, 2),
    MeshQuad1: _Kind(ElementQuad1, ElementQuadRT0, 4),
    MeshTri2: _Kind(ElementTriP2, None, 6),
    MeshQuad2: _Kind(ElementQuad2, None, 6),
    MeshQuad1DG: _Kind(ElementQuad1, ElementQuadRT0, 4),
}


def darcy_conductance(
    mesh: Mesh,
    permeability: ArrayLike,
    inlet: ArrayLike,
    outlet: ArrayLike,
    *,
    bounds: bool = False,
    solver: str = "auto",
) -> DarcyFlow:
    """Flow [unit of K] through a mesh for a unit drop of potential between two parts of its boundary.

    mesh : scikit-fem MeshTri1, MeshQuad1, MeshTri2 or MeshQuad2 with n elements, or a periodic MeshQuad1DG of
    rectangles.
    permeability : K >= 0; a number, (n,), (n, 2) values along x and y, or (n, 2, 2) symmetric tensors; 0 is
    closed. A tensor closed along one principal axis only keeps 1e-10 of its other value there, and
    carries flow across facets only along the open one.
    inlet, outlet : indices of boundary facets, with no vertex in common.
    bounds : also enclose the conductance of this mesh (straight sides, K constant on each element), up
    to quadrature on quadrilaterals that are not parallelograms; otherwise both bounds are NaN.

    solver : of the linear system, "direct" (factorisation), "amg" (pyamg), or "auto", the faster of both.

    Returns DarcyFlow, `potential` at the vertices; it is 1 or 0 in dead ends of the inlet or outlet, NaN in
    closed pockets.

    Raises InputError: another kind of mesh, wrong facets, a bad K, or bounds on a curved mesh.
    NotConverged : inlet and outlet flow differ by more than 1e-5, or the linear solver failed.

    Notes
    -----
    The value is the energy ∫ ∇φ·K∇φ, so it equals `upper`. Open elements that meet in a corner are connected
    in the value and in the upper bound, and not in the lower one.
    """
    kind = KINDS.get(type(mesh))
    if kind is None:
        names = ", ".join(t.__name__ for t in KINDS)
        raise InputError("mesh", f"a {type(mesh).__name__}", f"one of {names}")
    if bounds and kind.flux_element is None:
        raise InputError("bounds", f"a curved mesh, {type(mesh).__name__}", "a straight mesh (first-order elements)")
    ends = _ends(mesh, inlet, outlet)
    tensor = permeability_tensors(permeability, mesh.nelements)
    scale = float(np.abs(tensor).max()) or 1.0
    tensor = tensor / scale
    carrying, at_inlet, at_outlet = connected_elements(mesh, tensor, ends, through_corners=True)
    potential = np.full(mesh.nvertices, np.nan)
    for value, elements, facets in ((0.0, at_outlet, ends[1]), (1.0, at_inlet, ends[0])):
        potential[mesh.t[:, elements]] = value
        potential[mesh.facets[:, facets]] = value
    if carrying.size == 0:
        bound = 0.0 if bounds else np.nan
        return DarcyFlow(0.0, potential, 1 - potential, False, lower=bound, upper=bound)
    tensor = invertible(tensor)
    basis = Basis(mesh, kind.element(), intorder=kind.intorder, elements=carrying)
    k = np.moveaxis(tensor[carrying], 0, -1)[..., None]
    flow = conforming_flow(basis, k, ends, rtol=RTOL, solver=solver)
    vertices = mesh.t[:, carrying]
    potential[vertices] = flow.potential[basis.nodal_dofs[0, vertices]]
    lower, upper = np.nan, np.nan
    if bounds and kind.flux_element is not None:
        upper = flow.conductance * scale
        lower = scale * flux_conductance(
            mesh, tensor, ends, kind.flux_element(), kind.intorder, rtol=RTOL, solver=solver
        )
        lower = min(lower, upper)
    return replace(
        flow,
        conductance=flow.conductance * scale,
        potential=potential,
        complement=1 - potential,
        lower=lower,
        upper=upper,
    )


def conforming_flow(
    basis: Basis, k: Array, ends: tuple[Indices, Indices], *, rtol: float, solver: str = "auto"
) -> DarcyFlow:
    """Flow of a conforming element, `potential` at its degrees of freedom.

    basis : over the elements that carry the flow, of the mesh.
    k : permeability tensors at the quadrature points, (2, 2, elements, points or 1), of any one unit.
    ends : boundary facets of inlet and outlet; those that no element of the basis has are left out.
    rtol : relative error of the conductance allowed to an iterative solver; the potential errs by about √rtol.
    solver : of the linear system.

    Raises NotConverged: inlet and outlet flow differ by more than 1e-5, and 0.01 √rtol, or the linear solver failed.
    """
    matrix = forms.darcy_flow.assemble(basis, k=k).tocsr()
    carrying = np.arange(basis.mesh.nelements) if basis.tind is None else basis.tind
    dofs = [basis.get_dofs(open_facets(basis.mesh, f, carrying)).flatten() for f in ends]
    phi = np.zeros(basis.N)
    phi[dofs[0]] = 1.0
    free = np.zeros(basis.N, bool)
    free[basis.element_dofs] = True
    free[np.concatenate(dofs)] = False
    unknown = np.flatnonzero(free)
    iterations, residual, used = 0, 0.0, "none"
    if unknown.size:
        rows = sp.csr_array(matrix)[unknown]
        solution = solve_spd(rows[:, unknown], -(rows @ phi), potential_rtol(rtol), solver, unit_drop=True)
        phi[unknown] = solution.x
        iterations, residual, used = solution.iterations, solution.residual, solution.solver
    conductance = float(forms.dissipation.assemble(basis, k=k, p=basis.interpolate(phi)))
    reaction = matrix @ phi
    imbalance = abs(float(reaction[dofs[0]].sum() + reaction[dofs[1]].sum())) / conductance
    allowed = max(MAX_IMBALANCE, 0.01 * potential_rtol(rtol))
    if not imbalance <= allowed:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, expected {allowed:.0e}; "
            "try a smaller contrast of the permeability",
            imbalance,
        )
    return DarcyFlow(conductance, phi, 1 - phi, True, iterations, residual, imbalance, used)


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """K as (elements, 2, 2) positive semidefinite tensors, from any allowed shape; or an InputError."""
    try:
        k = np.asarray(permeability, dtype=float)
    except (TypeError, ValueError):
        raise InputError("permeability", type(permeability).__name__, "numbers [m³]") from None
    n = elements
    if k.shape not in ((), (n,), (n, 2), (n, 2, 2)):
        raise InputError(
            "permeability",
            f"shape {k.shape}",
            f"a number, or shape ({n},), ({n}, 2) or ({n}, 2, 2) for {n} elements",
        )
    if not np.all(np.isfinite(k)):
        raise InputError(
            "permeability", f"{counted(np.count_nonzero(~np.isfinite(k)), 'value')} not finite", "numbers >= 0 [m³]"
        )
    if k.ndim < 3:
        if k.min(initial=0.0) < 0:
            raise InputError("permeability", f"{k.min():g}", "numbers >= 0 [m³]")
        principal = np.broadcast_to(k if k.ndim == 2 else k.reshape(-1, 1), (n, 2))
        return principal[:, :, None] * np.eye(2)
    size = np.abs(k).max(axis=(1, 2))
    skew = np.flatnonzero(np.abs(k[:, 0, 1] - k[:, 1, 0]) > 1e-9 * size)
    if skew.size:
        raise InputError("permeability", f"a tensor that is not symmetric in element {skew[0]}", "symmetric tensors")
    k = (k + k.transpose(0, 2, 1)) / 2
    negative = np.flatnonzero(np.linalg.eigvalsh(k)[:, 0] < -1e-12 * size)
    if negative.size:
        raise InputError(
            "permeability",
            f"a negative principal value in element {negative[0]}",
            "principal values >= 0 [m³]",
        )
    return k


def is_connected(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> bool:
    """Whether the mesh itself, all of it open, joins inlet and outlet; InputError if these cannot be ends."""
    unit = np.broadcast_to(np.eye(2), (mesh.nelements, 2, 2))
    return connected_elements(mesh, unit, _ends(mesh, inlet, outlet), through_corners=True)[0].size > 0


def _ends(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> tuple[Indices, Indices]:
    ends = _facets(mesh, inlet, "inlet"), _facets(mesh, outlet, "outlet")
    if np.intersect1d(mesh.facets[:, ends[0]], mesh.facets[:, ends[1]]).size:
        raise InputError("inlet and outlet", "boundaries that touch", "boundaries with no vertex in common")
    return ends


def _facets(mesh: Mesh, facets: ArrayLike, name: str) -> Indices:
    chosen = np.unique(np.asarray(facets).astype(np.int64))
    if chosen.size == 0:
        raise InputError(name, "no facets", "at least one facet of the boundary")
    if not np.all(np.isin(chosen, mesh.boundary_facets())):
        raise InputError(name, "facets inside the mesh", "facets of its boundary")
    return chosen


def invertible(tensor: Array) -> Array:
    """Tensors with a smaller principal value of CLOSED_AXIS of the larger instead of 0."""
    values, axes = np.linalg.eigh(tensor)
    half = (values[:, 1] > 0) & (values[:, 0] <= 1e-14 * values[:, 1])
    values[half, 0] = CLOSED_AXIS * values[half, 1]
    regular = np.einsum("eij,ej,ekj->eik", axes, values, axes)
    return np.where(half[:, None, None], regular, tensor)
