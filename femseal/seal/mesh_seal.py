"""Define a seal of any plan shape by a mesh, with a given permeability of each element."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import Any, ClassVar

import numpy as np
from skfem import Mesh, MeshQuad1, MeshTri1

from ..base import Array, Indices, InputError, to_si
from ..flow.mesh import MeshOperators
from ..flow.mesh_input import is_connected, permeability_tensors
from ..flow.problem import MESH_SOLVERS, USE_LINEAR_ELEMENTS, DarcyFlow, check_solver
from .input_checks import check_inlet
from .mesh_checks import check_elements
from .mesh_files import NAME_BOUNDARIES, read_mesh
from .on_mesh import SealOnMesh
from .plane import polygon_areas

#: Names of boundaries, one or several.
Names = str | Sequence[str]


@dataclass(frozen=True)
class MeshSeal(SealOnMesh):
    """Define a seal of any plan shape by a mesh of linear triangles or quadrilaterals.

    The flow is computed with continuous pressures (conforming elements). Its error decreases with the square of the
    element size, and it is equal to the upper bound of the flow.

    Parameters
    ----------
    path : str, PathLike or Mesh
        File with a plane mesh (constant z) that meshio can read, or a scikit-fem mesh with named `boundaries` and
        coordinates in metres.
    inlet, outlet : str or sequence of str
        Names of the boundaries that form the inlet and the outlet, which must not touch each other. All other
        boundaries are closed.
    unit : str
        Unit of the coordinates in the file, such as "mm".

    Raises
    ------
    InputError
        The file is missing or is not a mesh; the mesh has no boundary with a given name; inlet and outlet touch each
        other, or the mesh does not connect inlet and outlet; or elements are degenerate, tangled or overlapping.
    """

    path: str | PathLike[str] | Mesh = field(repr=False)
    inlet: Names
    outlet: Names
    unit: str = field(default="m", repr=False)
    mesh: Mesh = field(init=False, repr=False, compare=False)

    #: Solvers that `flow` accepts.
    solvers: ClassVar[tuple[str, ...]] = MESH_SOLVERS

    def __post_init__(self) -> None:
        check_inlet(self.inlet)
        mesh = self.path
        if not isinstance(mesh, Mesh):
            mesh = read_mesh(mesh, to_si(f"1 {self.unit}", "m", "unit"))
        object.__setattr__(self, "mesh", mesh)
        if type(mesh) not in (MeshTri1, MeshQuad1):
            expected = f"a plane mesh of triangles or quadrilaterals, {USE_LINEAR_ELEMENTS}"
            raise InputError("path", f"a {type(mesh).__name__}", expected)
        _check_boundary_names(mesh, "inlet", self.inlet)
        _check_boundary_names(mesh, "outlet", self.outlet)
        check_elements(mesh)
        if not is_connected(mesh, *self.ends):
            raise InputError(
                "inlet and outlet",
                "boundaries that the mesh does not connect",
                "a mesh in one piece",
            )

    @property
    def ends(self) -> tuple[Indices, Indices]:
        """Boundary facets of inlet and outlet."""
        inlet, outlet = (
            np.unique(np.concatenate([self.mesh.boundaries[name] for name in _names(names)]))
            for names in (self.inlet, self.outlet)
        )
        return inlet, outlet

    @cached_property
    def _operators(self) -> MeshOperators:
        """Element matrices, which are stored because the flow may be computed for many permeabilities."""
        return MeshOperators(self.mesh, self.ends)

    @property
    def length(self) -> float:
        """Length of the outlet [m]."""
        _, outlet = self.ends
        # coordinates of the two ends of each facet, (axis, facet) each
        start, end = np.moveaxis(self.mesh.p[:, self.mesh.facets[:, outlet]], 1, 0)
        return float(np.hypot(*(end - start)).sum())

    @property
    def area(self) -> float:
        """Area of the seal [m²]."""
        return float(np.abs(polygon_areas(self.points[self.mesh.t.T])).sum())

    @property
    def points(self) -> Array:
        """Coordinates of the vertices (n_vertices, 2) [m]."""
        return np.ascontiguousarray(self.mesh.p.T)

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Compute the flow for a potential of 1 at the inlet and 0 at the outlet.

        Parameters
        ----------
        permeability : float or array, (n,), (n, 2) or (n, 2, 2)
            Permeability of the n elements [m³]: a number, a number for each element, values along x and y, or tensors.
        bounds : bool
            Whether to compute bounds of the flow as well.
        solver : str
            "amg", "direct" or "auto".

        Returns
        -------
        DarcyFlow
            Flow with the potential at the vertices of the mesh. The conductance is equal to the upper bound.
        """
        check_solver(solver, self.solvers)
        tensor = permeability_tensors(permeability, self.mesh.nelements)
        return self._operators.flow(tensor, bounds=bounds, solver=solver)

    def conforming_flow(self, permeability: Any, *, solver: str = "auto") -> DarcyFlow:
        """Compute the flow without bounds, see `flow`."""
        return self.flow(permeability, solver=solver)


def _check_boundary_names(mesh: Mesh, role: str, names: Names) -> None:
    """Raise InputError if the mesh has no boundary with a given name. `role` is "inlet" or "outlet"."""
    boundaries = mesh.boundaries or {}
    for name in _names(names) or (names,):
        if name in boundaries:
            continue
        present = ", ".join(repr(str(present)) for present in boundaries) or "none"
        expected = f"the name of a boundary of the mesh: {present}"
        if set(boundaries) <= {"0"}:  # edges without a name have the number 0
            expected += f"; {NAME_BOUNDARIES}"
        raise InputError(role, repr(name), expected)


def _names(given: Names) -> tuple[str, ...]:
    """Convert a name or a sequence of names to a tuple of names."""
    return (given,) if isinstance(given, str) else tuple(given)
