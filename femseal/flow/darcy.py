"""Darcy flow on an unstructured mesh: ∇·(K∇φ) = 0, φ = 1 on the inlet, 0 on the outlet, no flow elsewhere.

Value and upper bound: conforming elements, P1 or Q1 on straight meshes (order 2 in the flow), isoparametric
P2 or Q2 on second-order meshes (order 4). Lower bound: lowest-order Raviart-Thomas flux, hybridised, so that
its unknowns are potentials of facets and its matrix is positive definite.

Symbols: K permeability [m³] (any unit: the conductance has the same), φ potential for a unit drop, q flux.
Sources: Dirichlet's and Thomson's principles; Arnold & Brezzi, RAIRO M2AN 19, 1985, 7 (hybridisation).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components
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

from ..base.errors import InputError, NotConverged
from .balance import balanced_flux
from .forms import darcy_flow, dissipation, flux_resistance
from .network import MAX_IMBALANCE
from .solvers.amg import solve_spd

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Open = NDArray[np.bool_]
#: A tensor closed along one principal axis keeps this share of its other value there, so that K⁻¹ exists.
CLOSED_AXIS = 1e-10
_RTOL = 1e-8


@dataclass(frozen=True)
class DarcyFlow:
    """Flow for a unit drop of potential; exactly 0 without an open path from inlet to outlet."""

    conductance: float = field(metadata={"unit": "m^3", "long_name": "flow for a unit drop of potential"})
    lower: float = field(metadata={"unit": "m^3", "long_name": "lower bound of the conductance"})
    upper: float = field(metadata={"unit": "m^3", "long_name": "upper bound of the conductance"})
    potential: Array = field(metadata={"unit": "1", "long_name": "potential at the nodes"}, repr=False)
    percolates: bool
    iterations: int
    residual: float
    imbalance: float


@dataclass(frozen=True)
class _Kind:
    """How one kind of mesh is discretised."""

    element: type
    flux_element: type | None
    intorder: int


_KINDS = {
    MeshTri1: _Kind(ElementTriP1, ElementTriRT0, 2),
    MeshQuad1: _Kind(ElementQuad1, ElementQuadRT0, 4),
    MeshTri2: _Kind(ElementTriP2, None, 6),
    MeshQuad2: _Kind(ElementQuad2, None, 6),
}


def darcy_conductance(
    mesh: Mesh, permeability: ArrayLike, inlet: ArrayLike, outlet: ArrayLike, *, bounds: bool = False
) -> DarcyFlow:
    """Flow [unit of K] through a mesh for a unit drop of potential between two parts of its boundary.

    Parameters
    ----------
    mesh : scikit-fem MeshTri1, MeshQuad1, MeshTri2 or MeshQuad2 with n elements.
    permeability : K >= 0; a number, (n,), (n, 2) values along x and y, or (n, 2, 2) symmetric tensors; 0 is
        closed. A tensor closed along one principal axis only keeps 1e-10 of its other value there, and
        carries flow across facets only along the open one.
    inlet, outlet : indices of boundary facets, with no vertex in common.
    bounds : also enclose the conductance of this very mesh (straight sides, K constant on each element), up
        to quadrature on quadrilaterals that are not parallelograms; otherwise both bounds are NaN.

    Returns
    -------
    DarcyFlow, `potential` at the vertices; it is 1 or 0 in dead ends of the inlet or outlet, NaN in
    closed pockets.

    Raises
    ------
    InputError : another kind of mesh, wrong facets, a bad K, or bounds asked of a curved mesh.
    NotConverged : inlet and outlet flow differ by more than 1e-5, or the linear solver failed.

    Notes
    -----
    The value is the energy ∫ ∇φ·K∇φ, so it equals `upper`. Open elements that meet in a corner are connected
    in the value and in the upper bound, and not in the lower one.
    """
    kind = _KINDS.get(type(mesh))
    if kind is None:
        names = ", ".join(t.__name__ for t in _KINDS)
        raise InputError.of("mesh", f"a {type(mesh).__name__}", f"one of {names}")
    if bounds and kind.flux_element is None:
        raise InputError.of("bounds", f"a curved mesh, {type(mesh).__name__}", "a straight mesh (first-order elements)")
    ends = _ends(mesh, inlet, outlet)
    tensor = permeability_tensors(permeability, mesh.nelements)
    scale = float(np.abs(tensor).max()) or 1.0
    tensor = tensor / scale
    carrying, at_inlet, at_outlet = _elements_reached(mesh, tensor, ends, through_corners=True)
    potential = np.full(mesh.nvertices, np.nan)
    for value, elements, facets in ((0.0, at_outlet, ends[1]), (1.0, at_inlet, ends[0])):
        potential[mesh.t[:, elements]] = value
        potential[mesh.facets[:, facets]] = value
    if carrying.size == 0:
        bound = 0.0 if bounds else np.nan
        return DarcyFlow(0.0, bound, bound, potential, False, 0, 0.0, 0.0)
    tensor = _invertible(tensor)

    basis = Basis(mesh, kind.element(), intorder=kind.intorder, elements=carrying)
    k = np.moveaxis(tensor[carrying], 0, -1)[..., None]
    matrix = darcy_flow.assemble(basis, k=k).tocsr()
    dofs = [basis.get_dofs(_open_facets(mesh, f, carrying)).flatten() for f in ends]
    phi = np.zeros(basis.N)
    phi[dofs[0]] = 1.0
    unknown = np.setdiff1d(np.unique(basis.element_dofs), np.concatenate(dofs))
    iterations, residual = _solve_free(matrix, unknown, phi)
    conductance = float(dissipation.assemble(basis, k=k, p=basis.interpolate(phi)))
    reaction = matrix @ phi
    imbalance = abs(float(reaction[dofs[0]].sum() + reaction[dofs[1]].sum())) / conductance
    if not imbalance <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, allowed is {MAX_IMBALANCE:.0e}; "
            "try a smaller contrast of the permeability",
            imbalance,
        )
    vertices = np.unique(mesh.t[:, carrying])
    potential[vertices] = phi[basis.nodal_dofs[0, vertices]]
    lower, upper = np.nan, np.nan
    if bounds and kind.flux_element is not None:
        upper = conductance
        flux = _flux_conductance(mesh, tensor, ends, kind.flux_element(), kind.intorder)
        lower = min(flux, upper)
        lower, upper = lower * scale, upper * scale
    return DarcyFlow(conductance * scale, lower, upper, potential, True, iterations, residual, imbalance)


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """K as (elements, 2, 2) positive semidefinite tensors, from any allowed shape; or an InputError."""
    try:
        k = np.asarray(permeability, dtype=float)
    except (TypeError, ValueError):
        raise InputError.of("permeability", type(permeability).__name__, "numbers [m³]") from None
    n = elements
    if k.shape not in ((), (n,), (n, 2), (n, 2, 2)):
        raise InputError.of(
            "permeability",
            f"shape {k.shape}",
            f"a number, or shape ({n},), ({n}, 2) or ({n}, 2, 2) for {n} elements",
        )
    if not np.all(np.isfinite(k)):
        raise InputError.of(
            "permeability", f"{np.count_nonzero(~np.isfinite(k))} values not finite", "numbers >= 0 [m³]"
        )
    if k.ndim < 3:
        if k.min(initial=0.0) < 0:
            raise InputError.of("permeability", f"{k.min():g}", "numbers >= 0 [m³]")
        principal = np.broadcast_to(k if k.ndim == 2 else k.reshape(-1, 1), (n, 2))
        return principal[:, :, None] * np.eye(2)
    size = np.abs(k).max(axis=(1, 2))
    skew = np.flatnonzero(np.abs(k[:, 0, 1] - k[:, 1, 0]) > 1e-9 * size)
    if skew.size:
        raise InputError.of("permeability", f"a tensor that is not symmetric in element {skew[0]}", "symmetric tensors")
    k = (k + k.transpose(0, 2, 1)) / 2
    negative = np.flatnonzero(np.linalg.eigvalsh(k)[:, 0] < -1e-12 * size)
    if negative.size:
        raise InputError.of(
            "permeability",
            f"a negative principal value in element {negative[0]}",
            "principal values >= 0 [m³]",
        )
    return k


def is_connected(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> bool:
    """Whether the mesh itself, all of it open, joins inlet and outlet; InputError if these cannot be ends."""
    unit = np.broadcast_to(np.eye(2), (mesh.nelements, 2, 2))
    return _elements_reached(mesh, unit, _ends(mesh, inlet, outlet), through_corners=True)[0].size > 0


def _ends(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> tuple[Indices, Indices]:
    ends = _facets(mesh, inlet, "inlet"), _facets(mesh, outlet, "outlet")
    if np.intersect1d(mesh.facets[:, ends[0]], mesh.facets[:, ends[1]]).size:
        raise InputError("inlet and outlet: they touch, allowed are boundaries with no vertex in common")
    return ends


def _facets(mesh: Mesh, facets: ArrayLike, name: str) -> Indices:
    chosen = np.unique(np.asarray(facets).astype(np.int64))
    if chosen.size == 0:
        raise InputError.of(name, "no facets", "at least one facet of the boundary")
    if not np.all(np.isin(chosen, mesh.boundary_facets())):
        raise InputError.of(name, "facets inside the mesh", "facets of its boundary")
    return chosen


def _open_facets(mesh: Mesh, facets: Indices, elements: Indices) -> Indices:
    return facets[np.isin(mesh.f2t[0, facets], elements)]


def _invertible(tensor: Array) -> Array:
    """Tensors with a smaller principal value of CLOSED_AXIS of the larger instead of 0."""
    values, axes = np.linalg.eigh(tensor)
    half = (values[:, 1] > 0) & (values[:, 0] <= 1e-14 * values[:, 1])
    values[half, 0] = CLOSED_AXIS * values[half, 1]
    regular = np.einsum("eij,ej,ekj->eik", axes, values, axes)
    return np.where(half[:, None, None], regular, tensor)


def _elements_reached(
    mesh: Mesh, tensor: Array, ends: tuple[Indices, Indices], *, through_corners: bool
) -> tuple[Indices, Indices, Indices]:
    """Elements connected to both inlet and outlet, to the inlet alone, and to the outlet alone.

    Elements connect through a facet that both can carry flow across, n·Kn > 0; with `through_corners` also
    through a vertex if both are open in every direction.
    """
    values = np.linalg.eigvalsh(tensor)
    full = values[:, 0] > 1e-14 * values[:, 1]
    # normals of the chords: their length does not matter
    chord = mesh.p[:, mesh.facets[1]] - mesh.p[:, mesh.facets[0]]
    normal = np.array([chord[1], -chord[0]]) / np.linalg.norm(chord, axis=0)
    n = normal[:, mesh.t2f]
    across = np.einsum("ife,eij,jfe->fe", n, tensor, n) > 1e-12 * values[:, 1]
    slot, element = np.nonzero(across)
    facet = mesh.t2f[slot, element]
    # one graph of elements, facets, vertices and the two ends
    ne, nf = mesh.nelements, mesh.nfacets
    inlet, outlet = ne + nf + mesh.nvertices, ne + nf + mesh.nvertices + 1
    start, end = [element], [ne + facet]
    if through_corners:
        open_ = np.flatnonzero(full)
        start.append(np.tile(open_, mesh.t.shape[0]))
        end.append(ne + nf + mesh.t[:, open_].ravel())
    for facets, node in zip(ends, (inlet, outlet), strict=True):
        start.append(ne + facets)
        end.append(np.full(facets.size, node))
    i, j = np.concatenate(start), np.concatenate(end)
    graph = sp.coo_array((np.ones(i.size), (i, j)), shape=(outlet + 1, outlet + 1))
    _, label = connected_components(graph, directed=False)
    empty = np.empty(0, np.int64)
    at_inlet, at_outlet = (np.flatnonzero(label[:ne] == label[end]) for end in (inlet, outlet))
    return (at_inlet, empty, empty) if label[inlet] == label[outlet] else (empty, at_inlet, at_outlet)


def _solve_free(matrix: sp.csr_array, unknown: Indices, phi: Array) -> tuple[int, float]:
    """Solve the rows `unknown` for phi in place, the other values given."""
    if unknown.size == 0:
        return 0, 0.0
    rows = sp.csr_array(matrix)[unknown]
    solution = solve_spd(rows[:, unknown], -(rows @ phi), _RTOL, unit_drop=True)
    phi[unknown] = solution.x
    return solution.iterations, solution.residual


def _flux_conductance(
    mesh: Mesh,
    tensor: Array,
    ends: tuple[Indices, Indices],
    element: ElementTriRT0 | ElementQuadRT0,
    intorder: int,
) -> float:
    """Q²/∫ q·K⁻¹q of the lowest-order Raviart-Thomas flux; 0 if open elements connect in corners only."""
    carrying, _, _ = _elements_reached(mesh, tensor, ends, through_corners=False)
    if carrying.size == 0:
        return 0.0
    basis = Basis(mesh, element, intorder=intorder, elements=carrying)
    resistance = np.moveaxis(np.linalg.inv(tensor[carrying]), 0, -1)[..., None]
    local = flux_resistance.coo_data(basis, resistance=resistance).tolocal()
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
    inlet, outlet = (_open_facets(mesh, f, carrying) for f in ends)
    lam = np.zeros(mesh.nfacets)
    lam[inlet] = 1.0
    _solve_free(matrix, np.setdiff1d(np.unique(facets), np.concatenate([inlet, outlet])), lam)
    # differences within an element: no cancellation where λ is nearly constant
    drop = lam[facets] - lam[facets[:, :1]]
    flux = -np.einsum("eij,ej->ei", schur, drop)
    flux, total = _balanced_on_facets(mesh, facets, carrying, flux, local, (inlet, outlet))
    return total**2 / float(np.einsum("ei,eij,ej->", flux, local, flux))


def _balanced_on_facets(
    mesh: Mesh,
    facets: Indices,
    carrying: Indices,
    flux: Array,
    local: Array,
    ends: tuple[Indices, Indices],
) -> tuple[Array, float]:
    """Outward fluxes (elements, facets) made to balance on elements and agree on facets; and their total."""
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
