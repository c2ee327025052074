"""Darcy flow on a mesh: ∇·(K∇φ) = 0 from the inlet, φ = 1, to the outlet, φ = 0 (Dirichlet); other sides are closed.

Upper bound of the energy, and value: conforming elements, P1 or Q1, of order 2 in the flow. Lower bound: lowest-order
Raviart-Thomas fluxes. Their system is hybridised, so that its unknowns are potentials of facets and its matrix is
positive definite; they are made to balance exactly on every element, so that their energy is a bound whatever the error
of the solver. The forms are assembled once for each component of K, as a drawn seal is solved many times on one mesh.

Symbols: K permeability [m³] (any unit: the flow has the same), φ potential.
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

from ..base import Array, Floats, Indices, InputError, NotConverged
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
from .problem import LINEAR, DarcyFlow, potential_rtol
from .solvers.direct import Ends, LinearSolution
from .solvers.sparse import solve_sparse

#: Relative error of the flow.
RTOL = 1e-8
#: Potentials of the inlet and of the outlet.
_LEVELS = (1.0, 0.0)
#: Difference of inflow and outflow that is allowed, over the flow: the conductance is an energy,
#: which errs by its square. Of 400 meshes whose permeabilities differed by up to 1e16 five were out of balance by more
#: than 1e-4, and the conductance of none erred by more than 1e-13.
_MAX_IMBALANCE = 1e-3
#: Components of a symmetric tensor, by their unit tensors.
_UNITS = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]], float)[..., None, None]


#: Conforming element, element of fluxes and order of quadrature of each kind of mesh.
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
    """Solve the flow through a mesh for a unit drop of the potential between two parts of its boundary.

    Parameters
    ----------
    mesh : scikit-fem MeshTri1 or MeshQuad1 with n elements, or a periodic MeshQuad1DG of rectangles.
    permeability : K >= 0 in any unit, a number, (n,), (n, 2) along x and y, or symmetric tensors (n, 2, 2); elements
        with 0 are closed. A tensor that is closed along one principal axis keeps 1e-10 of its other value there, and
        carries flow only across facets that its open axis crosses.
    inlet, outlet : indices of boundary facets, with no vertex in common.
    bounds, solver : as in `MeshOperators.flow`.

    Returns
    -------
    DarcyFlow with the potential at the vertices, and the conductance in the unit of K.

    Raises
    ------
    InputError : another kind of mesh, wrong facets, or a bad K.
    NotConverged : inflow and outflow differ by more than 1e-3, or the linear solver failed.
    """
    if type(mesh) not in KINDS:
        names = ", ".join(kind.__name__ for kind in KINDS)
        raise InputError("mesh", f"a {type(mesh).__name__}", f"one of {names}, {LINEAR}")
    operators = MeshOperators(mesh, ends_of(mesh, inlet, outlet))
    return operators.flow(
        permeability_tensors(permeability, mesh.nelements), bounds=bounds, solver=solver
    )


@dataclass(frozen=True, eq=False)
class MeshSystem:
    """Numbering of the unknowns of a mesh.

    Attributes
    ----------
    dofs : array (n, m), degrees of freedom of each element.
    ends : degrees of freedom at the inlet and at the outlet.
    size : number of all degrees of freedom.
    """

    dofs: Indices
    ends: tuple[Indices, Indices]
    size: int

    def solved(self, local: Array, rtol: float, solver: str) -> LinearSolution:
        """Assemble local matrices (n, m, m), whose rows sum to 0, and solve them for a unit drop between the ends.

        Returns the solution with a value for every degree of freedom (size,), at an end its potential.
        """
        values = np.zeros(self.size)
        free = np.zeros(self.size, bool)
        free[self.dofs] = True
        for level, at in zip(_LEVELS, self.ends, strict=True):
            values[at] = level
            free[at] = False
        unknown = np.flatnonzero(free)
        if not unknown.size:
            return LinearSolution(values, 1 - values, 0, 0.0, "none", np.zeros(self.size))
        number = np.full(self.size, -1)
        number[unknown] = np.arange(unknown.size)
        rows, columns = np.broadcast_arrays(
            number[self.dofs][:, :, None], number[self.dofs][:, None, :]
        )
        inner = (rows >= 0) & (columns >= 0)
        matrix = sp.coo_array(
            (local[inner], (rows[inner], columns[inner])), shape=(unknown.size, unknown.size)
        ).tocsc()
        links = []
        for at in self.ends:
            of_end = np.zeros(self.size)
            of_end[at] = 1.0
            into = self.total(np.einsum("nij,nj->ni", local, of_end[self.dofs]))
            links.append(0.0 - into[unknown])
        ends = Ends(np.array(_LEVELS), np.array(links))
        rhs = ends.levels @ ends.links
        solution = solve_sparse(matrix, rhs, rtol, solver, unit_drop=True, ends=ends)
        remainder = np.zeros(self.size)
        values[unknown] = solution.x
        remainder[unknown] = solution.remainder
        return replace(solution, x=values, complement=1 - values, remainder=remainder)

    def total(self, flux: Array) -> Array:
        """Sum up the flow from each degree of freedom into the elements, from that into each element (n, m)."""
        return np.asarray(np.bincount(self.dofs.ravel(), flux.ravel(), self.size), float)

    def into(self, flux: Array) -> Array:
        """Sum up the flow into the elements through each end, from that into each element (n, m)."""
        total = self.total(flux)
        return np.array([total[at].sum() for at in self.ends])


@dataclass(frozen=True, eq=False)
class MeshOperators:
    """Local matrices of a mesh of straight sides, with which flows through it are solved one after another.

    Attributes
    ----------
    mesh : one of `KINDS`.
    ends : boundary facets of the inlet and of the outlet, with no vertex in common.
    """

    mesh: Mesh = field(repr=False)
    ends: tuple[Indices, Indices] = field(repr=False)

    def flow(self, tensor: Array, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Solve the flow for a unit drop.

        Parameters
        ----------
        tensor : array (n, 2, 2), K of each element, symmetric and positive semidefinite.
        bounds : also enclose the flow with K constant on each element, up to quadrature on quadrilaterals that are no
            parallelograms. Open elements that share only a corner are connected in the value and in the upper bound,
            and not in the lower bound.
        solver : "direct" (factorisation), "amg" (pyamg), or "auto" for the faster of both.

        Returns
        -------
        DarcyFlow with the potential at the vertices, NaN in closed pockets. Its conductance is that of conforming
        elements, which is the upper bound.

        Raises
        ------
        NotConverged : inflow and outflow differ by more than 1e-3, or the linear solver failed.
        """
        scale = float(np.abs(tensor).max()) or 1.0
        tensor = tensor / scale
        connected, system = self._system(tensor, of_vertices=True)
        potential = self._at_rest(connected)
        if not connected.joined.any():
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
        units = self._stiffness_of_axes if self._are_axes_along_edges(tensor) else self._stiffness
        local = _weighted(tensor[connected.between], units, connected.between)
        # the conductance is an energy, which errs by the square of the potential
        solution = system.solved(local, potential_rtol(RTOL), solver)
        potential[system.dofs] = solution.x[system.dofs]
        energy, flux = _dissipated(local, solution, system.dofs)
        imbalance = _imbalance(system.into(flux), energy)
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
        """Return the lower bound inflow² / ∫ q·K⁻¹q of the energy by fluxes q; tensors are invertible."""
        connected, system = self._system(tensor, of_vertices=False)
        if not connected.joined.any():
            return 0.0
        inverse = np.linalg.inv(tensor[connected.between])
        units = self._resistance_of_axes if self._are_axes_along_edges(tensor) else self._resistance
        resistance = _weighted(inverse, units, connected.between)
        # R q = p − λ and Σq = 0 on each element give q = −S λ
        inverse = np.linalg.inv(resistance)
        column = inverse.sum(axis=2)
        schur = (
            inverse - column[:, :, None] * column[:, None, :] / column.sum(axis=1)[:, None, None]
        )
        # balancing the fluxes magnifies the error of the potential
        solution = system.solved(schur, RTOL, solver)
        _, inward = _dissipated(schur, solution, system.dofs)
        flux, on_facet = self._balanced(connected.between, system, resistance, -inward)
        inflow = float(on_facet[system.ends[0]].sum())
        energy = float(np.einsum("ei,eij,ej->", flux, resistance, flux))
        return inflow**2 / energy

    def _balanced(
        self, carrying: Indices, system: MeshSystem, resistance: Array, flux: Array
    ) -> tuple[Array, Array]:
        """Correct outward fluxes (elements, facets) so that they balance on elements and agree on facets.

        Returns the corrected fluxes, and the flux of each facet of the mesh out of its first element.
        """
        mesh, facets = self.mesh, system.dofs
        node = np.zeros(mesh.nelements, np.int64)
        node[carrying] = np.arange(1, carrying.size + 1)
        first, second = mesh.f2t
        sign = np.where(first[facets] == carrying[:, None], 1.0, -1.0)
        sides = system.total(np.ones(facets.shape))
        # facets between two carrying elements, and those of the ends, whose outer side is node 0
        link = np.concatenate([np.flatnonzero(sides == 2), *system.ends])
        tail = node[first[link]]
        head = np.where(second[link] >= 0, node[second[link]], 0)
        through = (system.total(sign * flux) / np.maximum(sides, 1))[link]
        width = 1 / system.total(np.einsum("eii->ei", resistance))[link]
        balance(tail, head, width, through, carrying.size + 1)
        on_facet = np.zeros(mesh.nfacets)
        on_facet[link] = through
        return sign * on_facet[facets], on_facet

    def _at_rest(self, connected: Connected) -> Array:
        """Return the potential of the vertices that are connected to one end alone; NaN elsewhere."""
        mesh = self.mesh
        potential = np.full(mesh.nvertices, np.nan)
        for level, elements in zip(_LEVELS, connected.alone, strict=True):
            potential[mesh.t[:, elements]] = level
        for level, facets in zip(_LEVELS, self.ends, strict=True):
            potential[mesh.facets[:, facets]] = level
        return potential

    def _system(self, tensor: Array, *, of_vertices: bool) -> tuple[Connected, MeshSystem]:
        """Find the elements that carry flow, and number their vertices, which also connect in corners, or facets."""
        mesh = self.mesh
        connected = connected_elements(mesh, tensor, self.ends, through_corners=of_vertices)
        inlet, outlet = (
            open_facets(mesh, facets, connected.between) if joined else facets[:0]
            for facets, joined in zip(self.ends, connected.joined, strict=True)
        )
        if of_vertices:
            ends = np.unique(mesh.facets[:, inlet]), np.unique(mesh.facets[:, outlet])
            return connected, MeshSystem(mesh.t.T[connected.between], ends, mesh.nvertices)
        return connected, MeshSystem(mesh.t2f.T[connected.between], (inlet, outlet), mesh.nfacets)

    @cached_property
    def _stiffness(self) -> Array:
        """Local matrices of conforming elements for every component of K, (3, n, vertices, vertices)."""
        element, _, order = KINDS[type(self.mesh)]
        return _local_matrices(
            forms.darcy_flow, Basis(self.mesh, element(), intorder=order), k=_UNITS
        )

    @cached_property
    def _stiffness_of_axes(self) -> Array:
        """The same of rectangles with principal axes along their edges, integrated at the midpoints of the edges."""
        basis = Basis(self.mesh, ElementQuad1(), quadrature=forms.EDGE_MIDPOINTS)
        units = np.zeros((3, 2, 2, 1, 4))
        units[0, 0, 0, 0, :2] = units[1, 1, 1, 0, 2:] = 1.0
        return _local_matrices(forms.darcy_flow, basis, k=units)

    @cached_property
    def _resistance(self) -> Array:
        """Local resistances of outward fluxes, of every component of K⁻¹ (3, n, facets, facets)."""
        _, element, order = KINDS[type(self.mesh)]
        return self._outward(Basis(self.mesh, element(), intorder=order))

    @cached_property
    def _resistance_of_axes(self) -> Array:
        """The same of rectangles with principal axes along their edges, integrated at the corners."""
        return self._outward(Basis(self.mesh, ElementQuadRT0(), quadrature=forms.CORNERS))

    def _outward(self, basis: Basis) -> Array:
        """Local resistances of unit fluxes out of an element; a basis function leaves the facet's first element."""
        facets = self.mesh.t2f.T
        sign = np.where(self.mesh.f2t[0, facets] == np.arange(len(facets))[:, None], 1.0, -1.0)
        local = _local_matrices(forms.flux_resistance, basis, resistance=_UNITS)
        return local * sign[:, :, None] * sign[:, None, :]

    def _are_axes_along_edges(self, tensor: Array) -> bool:
        """Whether the elements are rectangles whose principal axes are along their edges."""
        return self._has_rectangles and not tensor[:, 0, 1].any()

    @cached_property
    def _has_rectangles(self) -> bool:
        """Whether the mesh is periodic and of rectangles that begin with their edge along x1."""
        if type(self.mesh) is not MeshQuad1DG:
            return False
        x1, x2 = self.mesh.mapping().F(self.mesh.refdom.p)  # (element, corner)
        along_x1 = np.array_equal(x2[:, [0, 2]], x2[:, [1, 3]])
        return along_x1 and np.array_equal(x1[:, [0, 1]], x1[:, [3, 2]])


def _local_matrices(form: Any, basis: Basis, **units: Array) -> Array:
    """Local matrices of a form for every unit tensor of its coefficient (3, n, m, m)."""
    ((name, tensors),) = units.items()
    return np.stack([form.coo_data(basis, **{name: unit}).tolocal() for unit in tensors])


def _weighted(tensor: Floats, units: Array, elements: Indices) -> Array:
    """Return local matrices (elements, m, m) of tensors, from those of unit components of K (3, n, m, m)."""
    k = np.array([tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]])
    return np.asarray(np.einsum("cn,cnij->nij", k, units[:, elements]))


def _dissipated(local: Array, solution: LinearSolution, dofs: Indices) -> tuple[float, Array]:
    """Return the energy of a solution, and the flow into each element from each of its degrees of freedom (n, m).

    local : matrices (n, m, m) of the elements. dofs : their degrees of freedom (n, m).
    """
    # differences within an element: no cancellation where values are nearly constant
    values, remainder = solution.x[dofs], np.asarray(solution.remainder)[dofs]
    drop = (values - values[:, :1]) + (remainder - remainder[:, :1])
    flux = np.einsum("nij,nj->ni", local, drop)
    return float(np.einsum("ni,ni->", drop, flux)), flux


def _imbalance(rates: Array, energy: float) -> float:
    """Return the difference of inflow and outflow, or of inflow and energy, over the larger of inflow and energy.

    rates : into the mesh through inlet and outlet.

    Raises NotConverged: that is too much, as where all flow passes links that are lost in sums with others.
    """
    inflow, total = float(rates[0]), float(rates.sum())
    largest = max(float(np.maximum(rates, 0.0).sum()), energy)
    imbalance = max(abs(total), abs(inflow - energy)) / largest if largest > 0 else 0.0
    if not imbalance <= _MAX_IMBALANCE:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, expected {_MAX_IMBALANCE:.0e}; "
            "try a smaller contrast of the permeability",
            imbalance,
        )
    return imbalance
