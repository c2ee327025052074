"""Solve Darcy flow on a mesh: ∇·(K∇φ) = 0 with φ = 1 at the inlet and φ = 0 at the outlet; other sides are closed.

The flow is computed with conforming elements (P1 or Q1), which converge with second order. The energy of the conforming
solution is an upper bound of the flow. The lower bound is computed with lowest-order Raviart-Thomas fluxes. By
hybridisation, the unknowns of the lower bound are the potentials of the facets, and the matrix is positive definite.
The Raviart-Thomas fluxes are corrected so that they are conserved exactly on each element. Any error of the solver can
therefore only make the lower bound smaller. The weak forms are assembled once for each component of K, because many
realisations of a seal are solved on the same mesh.

Symbols: φ is the potential, K the permeability [m³]. If K is given in another unit than m³, the flow has the unit of K.
Sources: principles of Dirichlet and Thomson; Arnold & Brezzi, RAIRO M2AN 19, 1985, 7 (hybridisation).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from skfem import (
    Basis,
    ElementQuad1,
    ElementQuadRT0,
    ElementTriP1,
    ElementTriRT0,
    Mesh,
    MeshQuad1,
    MeshTri1,
)
from skfem.mesh import MeshQuad1DG

from ..base import Array, Floats, Indices, InputError
from . import forms
from .balance import balance
from .mesh_input import (
    Connected,
    connected_elements,
    ends_of,
    invertible,
    open_facets,
    permeability_tensors,
)
from .problem import USE_LINEAR_ELEMENTS, DarcyFlow, checked_imbalance, potential_rtol
from .solvers.linear_solution import Ends, LinearSolution
from .solvers.sparse import solve_between_ends

#: Relative error of the flow.
RTOL = 1e-8
#: Potentials of the inlet and of the outlet.
_END_POTENTIALS = (1.0, 0.0)
#: Largest relative difference between inflow and outflow. The conductance is computed as an energy, whose error is
#: about the square of this difference. Of 400 meshes with permeabilities that differed by up to 1e16, five had a
#: difference above 1e-4, and the error of the conductance never exceeded 1e-13.
_MAX_IMBALANCE = 1e-3
#: Unit tensors of the three components K11, K22 and K12 of a symmetric tensor, (component, 2, 2, 1, 1).
_UNITS = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]], float)[..., None, None]


#: Conforming element, flux element and quadrature order for each kind of mesh.
KINDS = {
    MeshTri1: (ElementTriP1, ElementTriRT0, 2),
    MeshQuad1: (ElementQuad1, ElementQuadRT0, 4),
    MeshQuad1DG: (ElementQuad1, ElementQuadRT0, 4),
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
    """Solve the Darcy flow through a mesh for a unit potential drop between two parts of its boundary.

    Parameters
    ----------
    mesh : scikit-fem MeshTri1 or MeshQuad1 with n elements, or a periodic MeshQuad1DG of rectangles.
    permeability : permeability K >= 0 in any unit: a number, one number per element (n,), principal values along x and
        y (n, 2), or symmetric tensors (n, 2, 2). Elements with K = 0 are closed. One principal value of a tensor may be
        0. An element with such a tensor carries flow only across facets that are not parallel to its open principal
        axis. Before the solution, a principal value of 0 is replaced by 1e-10 times the other principal value.
    inlet, outlet : indices of boundary facets, or a flag for each facet of the mesh. Inlet and outlet must not have a
        vertex in common.
    bounds, solver : as in `MeshOperators.flow`.

    Returns
    -------
    DarcyFlow with the potential at the vertices, and the conductance in the unit of K.

    Raises
    ------
    InputError : the mesh is of another kind, the facets are not suitable, or K is not valid.
    NotConverged : inflow and outflow differ by more than 1e-3, or the linear solver failed.
    """
    if type(mesh) not in KINDS:
        names = ", ".join(kind.__name__ for kind in KINDS)
        raise InputError(
            "mesh", f"a {type(mesh).__name__}", f"one of {names}, {USE_LINEAR_ELEMENTS}"
        )
    operators = MeshOperators(mesh, ends_of(mesh, inlet, outlet))
    return operators.flow(
        permeability_tensors(permeability, mesh.nelements), bounds=bounds, solver=solver
    )


@dataclass(frozen=True, eq=False)
class MeshSystem:
    """Numbering of the degrees of freedom of a mesh: either its vertices or its facets.

    Attributes
    ----------
    dofs : array (n, m), the m degrees of freedom of each of n elements.
    ends : degrees of freedom at the inlet, and degrees of freedom at the outlet.
    size : total number of degrees of freedom.
    """

    dofs: Indices
    ends: tuple[Indices, Indices]
    size: int

    def solve(self, local: Array, rtol: float, solver: str) -> LinearSolution:
        """Assemble the matrices of the elements, and solve the system for a unit drop between inlet and outlet.

        Parameters
        ----------
        local : array (n, m, m), matrices of the elements. The sum of each row must be 0.
        rtol : largest relative error of the potential in the energy norm.
        solver : name of a solver of sparse matrices, see `MESH_SOLVERS`.

        Returns
        -------
        LinearSolution with the potentials of all degrees of freedom (size,), including the given potentials at inlet
        and outlet.
        """
        values = np.zeros(self.size)
        free = np.zeros(self.size, bool)
        free[self.dofs] = True
        for end_potential, at_end in zip(_END_POTENTIALS, self.ends, strict=True):
            values[at_end] = end_potential
            free[at_end] = False
        unknown = np.flatnonzero(free)
        if not unknown.size:
            return LinearSolution(values, 1 - values, 0, 0.0, "none", np.zeros(self.size))
        # number of each degree of freedom among the unknowns; −1 if its value is known
        number = np.full(self.size, -1)
        number[unknown] = np.arange(unknown.size)
        rows, columns = np.broadcast_arrays(
            number[self.dofs][:, :, None], number[self.dofs][:, None, :]
        )
        is_inner = (rows >= 0) & (columns >= 0)
        matrix = sp.coo_array(
            (local[is_inner], (rows[is_inner], columns[is_inner])),
            shape=(unknown.size, unknown.size),
        ).tocsc()
        # The function `condense` of scikit-fem would give the conductances to the inlet as the right-hand side, but the
        # conductances to the outlet only as differences of matrix entries, in which small values are lost by rounding.
        inlet, outlet = (self._conductances_to(at_end, local)[unknown] for at_end in self.ends)
        solution = solve_between_ends(matrix, Ends(inlet, outlet), rtol, solver)
        remainder = np.zeros(self.size)
        values[unknown] = solution.x
        remainder[unknown] = solution.remainder
        return replace(solution, x=values, complement=1 - values, remainder=remainder)

    def _conductances_to(self, at_end: Indices, local: Array) -> Array:
        """Compute the conductance (size,) between each degree of freedom and those at one end.

        at_end : degrees of freedom at the end.
        local : array (n, m, m), matrices of the elements, whose entries beside the diagonal are negative conductances.
        """
        is_at_end = np.zeros(self.size)
        is_at_end[at_end] = 1.0
        return 0.0 - self.total_flow(np.einsum("nij,nj->ni", local, is_at_end[self.dofs]))

    def total_flow(self, flux: Array) -> Array:
        """Compute the total flow (size,) from each degree of freedom into the elements around it.

        flux : array (n, m), flow into each of n elements from each of the m degrees of freedom of the element.
        """
        return np.asarray(np.bincount(self.dofs.ravel(), flux.ravel(), self.size), float)

    def flow_through_ends(self, flux: Array) -> Array:
        """Compute the flow into the mesh through the inlet and through the outlet; `flux` as in `total_flow`."""
        total = self.total_flow(flux)
        return np.array([total[at_end].sum() for at_end in self.ends])


@dataclass(frozen=True, eq=False)
class MeshOperators:
    """Element matrices of a mesh with straight sides, stored so that many flows can be solved on the same mesh.

    Attributes
    ----------
    mesh : mesh of a kind in `KINDS`.
    ends : boundary facets of the inlet, and boundary facets of the outlet, with no vertex in common.
    """

    mesh: Mesh = field(repr=False)
    ends: tuple[Indices, Indices] = field(repr=False)

    def flow(self, tensor: Array, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Solve the flow for a unit potential drop between inlet and outlet.

        Parameters
        ----------
        tensor : array (n, 2, 2), permeability K of each element, symmetric and positive semidefinite.
        bounds : also compute bounds of the flow, for a permeability that is constant on each element. On quadrilaterals
            that are not parallelograms, the bounds neglect quadrature errors. The conductance and the upper bound
            include flow between open elements that share only a corner; the lower bound excludes this flow.
        solver : "direct" (factorisation), "amg" (pyamg), or "auto" for the solver that is expected to be faster.

        Returns
        -------
        DarcyFlow with the potential at the vertices of the mesh; NaN at vertices in closed pockets. The conductance is
        computed with conforming elements, and is therefore equal to the upper bound.

        Raises
        ------
        NotConverged : inflow and outflow differ by more than 1e-3, or the linear solver failed.
        """
        scale = float(np.abs(tensor).max()) or 1.0
        tensor = tensor / scale
        connected, system = self._system(tensor, of_vertices=True)
        potential = self._potential_without_flow(connected)
        if not connected.is_joined.any():
            bound = 0.0 if bounds else np.nan
            return DarcyFlow(
                0.0,
                potential,
                1 - potential,
                percolates=False,
                lower=bound,
                upper=bound,
            )
        tensor = invertible(tensor)
        units = self._stiffness_of_axes if self._has_axes_along_edges(tensor) else self._stiffness
        local = _combine(tensor[connected.carrying], units, connected.carrying)
        # the relative error of the conductance is the square of the error of the potential
        solution = system.solve(local, potential_rtol(RTOL), solver)
        potential[system.dofs] = solution.x[system.dofs]
        energy, flux = _energy_and_flux(local, solution, system.dofs)
        imbalance = _imbalance(system.flow_through_ends(flux), energy)
        lower = upper = np.nan
        if bounds:
            lower = min(self._lower_bound(tensor, solver), energy)
            upper = energy
        return DarcyFlow(
            conductance=scale * energy,
            potential=potential,
            complement=1 - potential,
            percolates=True,
            iterations=solution.iterations,
            residual=solution.residual,
            imbalance=imbalance,
            solver=solution.solver,
            lower=scale * lower,
            upper=scale * upper,
        )

    def _lower_bound(self, tensor: Array, solver: str) -> float:
        """Compute the lower bound inflow² / ∫ q·K⁻¹q of the energy from conserved fluxes q.

        tensor : array (n, 2, 2), invertible permeabilities.
        """
        connected, system = self._system(tensor, of_vertices=False)
        if not connected.is_joined.any():
            return 0.0
        inverse = np.linalg.inv(tensor[connected.carrying])
        units = self._resistance_of_axes if self._has_axes_along_edges(tensor) else self._resistance
        resistance = _combine(inverse, units, connected.carrying)
        # Hybridisation: each element has the resistance matrix R, the outward fluxes q through its facets, the
        # potential p, and the potentials λ of its facets, with R q = p − λ and Σq = 0. Eliminating p gives q = −S λ
        # with the Schur complement S = R⁻¹ − R⁻¹1 1ᵀR⁻¹ / 1ᵀR⁻¹1, where 1 is a vector of ones.
        inverse = np.linalg.inv(resistance)  # R⁻¹ (element, facet, facet)
        column = inverse.sum(axis=2)  # R⁻¹1 (element, facet)
        total = column.sum(axis=1)[:, None, None]  # 1ᵀR⁻¹1 (element, 1, 1)
        schur = inverse - column[:, :, None] * column[:, None, :] / total
        # `RTOL` instead of its root: correcting the fluxes amplifies the error of the potential
        solution = system.solve(schur, RTOL, solver)
        # S λ = −q: the flow from the facets into each element
        _, inward_flux = _energy_and_flux(schur, solution, system.dofs)
        flux, facet_flux = self._conserved(connected.carrying, system, resistance, -inward_flux)
        inlet, _ = system.ends
        inflow = float(facet_flux[inlet].sum())
        energy = float(np.einsum("ei,eij,ej->", flux, resistance, flux))
        return inflow**2 / energy

    def _conserved(
        self, carrying: Indices, system: MeshSystem, resistance: Array, flux: Array
    ) -> tuple[Array, Array]:
        """Correct fluxes so that they are conserved on each element and continuous across each facet.

        Parameters
        ----------
        carrying : elements that carry flow.
        system : numbering of the facets of the elements that carry flow.
        resistance : array (elements, facets, facets), resistance matrix of each element that carries flow.
        flux : array (elements, facets), flux out of each element through each of its facets.

        Returns
        -------
        Corrected fluxes out of the elements, in the shape of `flux`; and corrected flux through each facet of the mesh,
        positive if it leaves the first element of the facet.
        """
        mesh = self.mesh
        facets = system.dofs
        # Facets and elements form a network: the elements that carry flow are the nodes 1, 2, …, inlet and outlet
        # together are node 0, and the facets are the links between the nodes.
        node = np.zeros(mesh.nelements, np.int64)
        node[carrying] = np.arange(1, carrying.size + 1)
        first, second = mesh.f2t  # the two elements of each facet; the second is −1 on the boundary
        # a flux through a facet is counted as positive if it leaves the first element of the facet
        sign = np.where(first[facets] == carrying[:, None], 1.0, -1.0)
        # number of elements at each facet that carry flow: 2 inside the mesh, 1 on a boundary
        sides = system.total_flow(np.ones(facets.shape))
        link = np.concatenate([np.flatnonzero(sides == 2), *system.ends])
        tail = node[first[link]]
        head = np.where(second[link] >= 0, node[second[link]], 0)
        # mean of the fluxes that the elements on both sides of a facet give
        facet_flux = (system.total_flow(sign * flux) / np.maximum(sides, 1))[link]
        # approximate conductance of a facet: 1 over the resistances of its elements to a unit flux
        conductance = 1 / system.total_flow(np.einsum("eii->ei", resistance))[link]
        balance(tail, head, conductance, facet_flux, carrying.size + 1)
        mesh_flux = np.zeros(mesh.nfacets)
        mesh_flux[link] = facet_flux
        return sign * mesh_flux[facets], mesh_flux

    def _potential_without_flow(self, connected: Connected) -> Array:
        """Return the potential of each vertex that carries no flow.

        The potential is 1 at vertices that are connected to the inlet only, 0 at vertices that are connected to the
        outlet only, and NaN in pockets, which are connected to neither.
        """
        mesh = self.mesh
        potential = np.full(mesh.nvertices, np.nan)
        for value, elements in zip(_END_POTENTIALS, connected.at_one_boundary, strict=True):
            potential[mesh.t[:, elements]] = value
        for value, facets in zip(_END_POTENTIALS, self.ends, strict=True):
            potential[mesh.facets[:, facets]] = value
        return potential

    def _system(self, tensor: Array, *, of_vertices: bool) -> tuple[Connected, MeshSystem]:
        """Find the elements that carry flow, and number their vertices or their facets.

        If the vertices are the degrees of freedom, elements that share only a corner count as connected.
        """
        mesh = self.mesh
        connected = connected_elements(mesh, tensor, self.ends, through_corners=of_vertices)
        carrying = connected.carrying
        # facets of inlet and outlet through which fluid flows; no facets at a boundary without a connection to the
        # other
        inlet, outlet = (
            open_facets(mesh, facets, carrying) if joined else facets[:0]
            for facets, joined in zip(self.ends, connected.is_joined, strict=True)
        )
        if of_vertices:
            vertices = mesh.t.T[carrying]  # (element, vertex)
            ends = np.unique(mesh.facets[:, inlet]), np.unique(mesh.facets[:, outlet])
            return connected, MeshSystem(vertices, ends, mesh.nvertices)
        facets = mesh.t2f.T[carrying]  # (element, facet)
        return connected, MeshSystem(facets, (inlet, outlet), mesh.nfacets)

    @cached_property
    def _stiffness(self) -> Array:
        """Element matrices of the conforming elements for each component of K.

        Array (component, element, vertex, vertex).
        """
        element, _, order = KINDS[type(self.mesh)]
        basis = Basis(self.mesh, element(), intorder=order)
        return _local_matrices(forms.darcy_flow, basis, "k", _UNITS)

    @cached_property
    def _stiffness_of_axes(self) -> Array:
        """Matrices like `_stiffness`, for rectangles whose tensors have principal axes along the edges.

        The matrices are integrated at the midpoints of the edges, so that each edge is equivalent to a link between two
        vertices.
        """
        basis = Basis(self.mesh, ElementQuad1(), quadrature=forms.EDGE_MIDPOINTS)
        # (component, 2, 2, element, edge): K11 acts on the edges along x1, which come first, and K22 on those along x2
        units = np.zeros((3, 2, 2, 1, 4))
        units[0, 0, 0, 0, :2] = 1.0
        units[1, 1, 1, 0, 2:] = 1.0
        return _local_matrices(forms.darcy_flow, basis, "k", units)

    @cached_property
    def _resistance(self) -> Array:
        """Resistance matrices of the elements for each component of K⁻¹, with fluxes counted as positive outward.

        Array (component, element, facet, facet).
        """
        _, element, order = KINDS[type(self.mesh)]
        return self._outward(Basis(self.mesh, element(), intorder=order))

    @cached_property
    def _resistance_of_axes(self) -> Array:
        """Matrices like `_resistance`, for rectangles whose tensors have principal axes along the edges.

        The matrices are integrated at the corners, so that the flux along one axis is not coupled to the flux along the
        other axis.
        """
        return self._outward(Basis(self.mesh, ElementQuadRT0(), quadrature=forms.CORNERS))

    def _outward(self, basis: Basis) -> Array:
        """Compute the resistance matrix of each element, for unit fluxes out of the element through its facets.

        In scikit-fem, the basis function of a facet is a flux from the first element of the facet to the second
        element. The sign of the basis function is therefore changed in the second element of the facet.
        """
        facets = self.mesh.t2f.T
        # (element, facet): 1 in the first element of a facet, −1 in the second element
        sign = np.where(self.mesh.f2t[0, facets] == np.arange(len(facets))[:, None], 1.0, -1.0)
        local = _local_matrices(forms.flux_resistance, basis, "resistance", _UNITS)
        return local * sign[:, :, None] * sign[:, None, :]

    def _has_axes_along_edges(self, tensor: Array) -> bool:
        """Return whether all elements are rectangles and the principal axes of their tensors lie along the edges."""
        return self._has_rectangles and not tensor[:, 0, 1].any()

    @cached_property
    def _has_rectangles(self) -> bool:
        """Whether the mesh is a periodic mesh of rectangles, and the first edge of each rectangle is along x1."""
        if type(self.mesh) is not MeshQuad1DG:
            return False
        # coordinates (element, corner); the corners of an element are numbered around the element
        x1, x2 = self.mesh.mapping().F(self.mesh.refdom.p)
        # the edges from corner 0 to corner 1 and from corner 2 to corner 3 are along x1
        has_edges_along_x1 = np.array_equal(x2[:, [0, 2]], x2[:, [1, 3]])
        # the edges from corner 0 to corner 3 and from corner 1 to corner 2 are along x2
        return has_edges_along_x1 and np.array_equal(x1[:, [0, 1]], x1[:, [3, 2]])


def _local_matrices(form: Any, basis: Basis, coefficient: str, unit_tensors: Array) -> Array:
    """Compute the element matrices (3, n, m, m) of a form for each unit tensor of its coefficient.

    coefficient : name of the coefficient in the form, such as "k".
    unit_tensors : array (3, 2, 2, …), three tensors in which only K11, only K22 or only K12 = K21 is 1.
    """
    matrices = [form.coo_data(basis, **{coefficient: unit}).tolocal() for unit in unit_tensors]
    return np.stack(matrices)


def _combine(tensor: Floats, units: Array, elements: Indices) -> Array:
    """Compute the element matrices of given tensors as linear combinations of the matrices of the unit tensors.

    tensor : array (elements, 2, 2), tensor of each chosen element.
    units : array (3, n, m, m), element matrices of all n elements of the mesh, for each unit tensor.
    elements : numbers of the chosen elements.
    """
    k = np.array([tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]])
    return np.asarray(np.einsum("cn,cnij->nij", k, units[:, elements]))


def _energy_and_flux(local: Array, solution: LinearSolution, dofs: Indices) -> tuple[float, Array]:
    """Compute the energy of a solution, and the flow from each degree of freedom of an element into the element.

    local : array (n, m, m), matrices of the elements.
    dofs : array (n, m), degrees of freedom of the elements.

    Returns
    -------
    Energy, and flow as an array (n, m).
    """
    # subtracting the first value of an element avoids cancellation where the values are nearly constant
    values, remainder = solution.x[dofs], np.asarray(solution.remainder)[dofs]
    drop = (values - values[:, :1]) + (remainder - remainder[:, :1])
    flux = np.einsum("nij,nj->ni", local, drop)
    return float(np.einsum("ni,ni->", drop, flux)), flux


def _imbalance(rates: Array, energy: float) -> float:
    """Compute the relative imbalance of a flow.

    The imbalance is the larger of |inflow − outflow| and |inflow − energy|, divided by the larger of inflow and energy.

    rates : flow rate into the mesh through the inlet, and flow rate into the mesh through the outlet.

    Raises
    ------
    NotConverged : the imbalance is too large. This happens if the whole flow passes through very narrow links, because
        their conductances are lost by rounding when they are added to much larger ones.
    """
    inflow, outflow = float(rates[0]), -float(rates[1])
    largest = max(float(np.maximum(rates, 0.0).sum()), energy)
    if not largest > 0:
        return 0.0
    return checked_imbalance(
        inflow,
        outflow,
        energy,
        scale=largest,
        allowed=_MAX_IMBALANCE,
        advice="try a smaller permeability contrast",
    )
