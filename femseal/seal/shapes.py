"""Define strips and rings, and the properties and methods that every shape of seals needs.

Strips and rings consist of rows of rectangles and are periodic along the seal. The first row is at the inlet and the
last row at the outlet. The coordinates of a strip are (x1, x2). The coordinates of a ring are (|ln r/r₀|, θ) with the
radius r₀ of the inlet, in which Darcy's law has the same form as on a plane strip, see `Ring`. The permeability is
constant in each rectangle. The flow is computed by `femseal.flow.rectangles`.

A shape is a frozen dataclass with the properties and methods of the protocol `Seal`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Any, ClassVar, Protocol

import numpy as np

from ..base import Array, InputError, Pair, Shape, validate
from ..flow import DarcyFlow
from ..flow.mesh_input import permeability_tensors
from ..flow.problem import MESH_SOLVERS, SOLVERS, SPARSE_SOLVERS, check_solver, checked_permeability
from ..flow.rectangles import Rectangles
from .element_seal import ElementSeal
from .ring import Ring


class Seal(Protocol):
    """Define the properties and methods that a seal needs to be accepted by `seal_leakage`.

    Attributes
    ----------
    solvers : tuple of str
        Names of the solvers that `flow` accepts.
    element_shapes : tuple of tuple of int
        Allowed shapes of a permeability array that does not contain tensors. The first allowed shape is (n_elements,).
    """

    @property
    def solvers(self) -> tuple[str, ...]:
        """Names of the solvers that `flow` accepts."""
        ...

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Allowed shapes of a permeability array that does not contain tensors."""
        ...

    @property
    def length(self) -> float:
        """Length of the seal [m], by which the leakage is divided to obtain the leakage per unit length."""
        ...

    @property
    def points(self) -> Array:
        """Coordinates (…, 2) [m] of the points at which the fluid pressure is given."""
        ...

    def corner_values(self, values: Array) -> Array:
        """Return the values at the corners of each element (n, corners) from the values at all points."""
        ...

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Check the permeability, and compute the flow for a potential of 1 at the inlet and 0 at the outlet.

        The conductance of the flow is the value that is reported as the leakage; it does not depend on `bounds`. With
        `bounds`, the flow also has a lower and an upper bound.
        """
        ...

    def conforming_flow(self, permeability: Any, *, solver: str = "auto") -> DarcyFlow:
        """Compute the flow with continuous pressures, whose conductance is an upper bound.

        The potential is equal to the potential that `flow` returns, but less work is needed.
        """
        ...


class PeriodicSeal:
    """Compute the flow over strips and rings. A subclass must define the properties `cells` and `rectangles`."""

    cells: Shape
    #: Solvers that `flow` accepts.
    solvers: ClassVar[tuple[str, ...]] = SOLVERS

    @property
    def rectangles(self) -> Rectangles:
        """Rectangular elements of the seal, in the coordinates (x1, x2) of a strip or (|ln r/r₀|, θ) of a ring."""
        raise NotImplementedError

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Allowed shapes of a permeability array that does not contain tensors."""
        n1, n2 = self.cells
        return (n1 * n2,), (n1, n2), (n1 * n2, 2), (n1, n2, 2)

    def corner_values(self, values: Array) -> Array:
        """Return values at the corners of each element (n, 4) from values at the points (n1 + 1, n2).

        The seal is periodic, so that the last column of elements shares its corners with the first column.
        """
        next_column = np.roll(values, -1, axis=1)
        corners = values[:-1], values[1:], next_column[1:], next_column[:-1]
        return np.stack(corners, axis=-1).reshape(-1, 4)

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Compute the flow for a potential of 1 at the inlet and 0 at the outlet.

        The flow is the geometric mean of the upper bound and the lower bound.

        Parameters
        ----------
        permeability : float or array
            Permeability [m³]: a number; a number for each element (n1, n2); or two numbers for each element (n1, n2,
            2), along x1 and x2 of a strip or along radius and angle of a ring. If the n = n1 n2 elements are in a
            single sequence, row by row, the shapes are (n,) and (n, 2), or (n, 2, 2) for tensors.
        bounds : bool
            Whether to return a `lower` and an `upper` bound, which include the error of the solver.
        solver : str
            "multigrid" or "elimination" (fast solvers for rectangles), "amg" or "direct" (on a scikit-fem mesh), or
            "auto". The fast solvers do not accept tensors whose principal axes are not parallel to the edges of the
            rectangles.

        Returns
        -------
        DarcyFlow
            Flow with the potential at the corners of the rectangles, array (n1 + 1, n2).

        Raises
        ------
        InputError
            The permeability has a wrong shape, or is negative or not finite; or the solver does not accept it.
        NotConverged
            See `femseal.flow.solve_flow`.
        """
        k = self._element_permeability(permeability)
        if self._needs_mesh(k, solver):
            return self._flow_on_mesh(
                k, lambda mesh, values: mesh.flow(values, bounds=bounds, solver=solver)
            )
        return self.rectangles.flow(*_principal_values(k), bounds=bounds, solver=solver)

    def conforming_flow(self, permeability: Any, *, solver: str = "auto") -> DarcyFlow:
        """Compute the flow with continuous pressures, whose conductance is an upper bound.

        The potential is equal to the potential that `flow` returns, but less work is needed.

        permeability, solver : as in `flow`.
        """
        k = self._element_permeability(permeability)
        if self._needs_mesh(k, solver):
            return self._flow_on_mesh(
                k, lambda mesh, values: mesh.conforming_flow(values, solver=solver)
            )
        return self.rectangles.conforming_flow(*_principal_values(k), solver=solver)

    def _needs_mesh(self, permeability: Array, solver: str) -> bool:
        """Check the solver, and return whether the flow is solved on a mesh instead of a network of links.

        permeability : array (n1, n2, 2), or (n1, n2, 2, 2) for tensors.
        """
        is_oblique = permeability.ndim == 4 and bool(permeability[..., 0, 1].any())
        check_solver(solver, MESH_SOLVERS if is_oblique else self.solvers)
        return is_oblique or solver in SPARSE_SOLVERS

    def _element_permeability(self, permeability: Any) -> Array:
        """Bring a permeability into the shape (n1, n2, 2), or (n1, n2, 2, 2) for tensors."""
        n1, n2 = self.cells
        is_pair = isinstance(permeability, (tuple, list)) and len(permeability) == 2
        if is_pair and any(np.ndim(k) == 2 for k in permeability):
            expected = (
                "one array, of shape (n1, n2), or (n1, n2, 2) for two permeabilities of each element; "
                "a network of links is a femseal.flow.Stencil"
            )
            raise InputError("permeability", "a pair of arrays, as of links", expected)
        tensors = (n1 * n2, 2, 2)
        k = checked_permeability("permeability", permeability, *self.element_shapes, tensors)
        if k.shape == tensors:
            return permeability_tensors(k, n1 * n2).reshape(n1, n2, 2, 2)
        # axes (row, column, axis of the element)
        if k.shape == ():
            k = k.reshape(1, 1, 1)
        elif k.shape in ((n1, n2), (n1 * n2,)):
            k = k.reshape(n1, n2, 1)
        else:
            k = k.reshape(n1, n2, 2)
        return np.broadcast_to(k, (n1, n2, 2))

    def _flow_on_mesh(
        self, permeability: Array, solve: Callable[[ElementSeal, Array], DarcyFlow]
    ) -> DarcyFlow:
        """Compute the flow by scikit-fem for a permeability (n1, n2, 2) or (n1, n2, 2, 2).

        The mesh may contain several copies of the seal along its length, see `Rectangles.repeated`. The returned flow
        is the flow through a single copy of the seal.

        solve : function that computes the flow through a seal on a mesh from the permeability of its elements.
        """
        n2 = self.cells[1]
        repeated, repetitions = self.rectangles.repeated()
        outlines = repeated.outlines
        elements = ElementSeal(
            repeated.mesh,
            *repeated.ends,
            size=(float(np.ptp(repeated.lines)), repeated.period),
            outlines=outlines,
            axes=np.broadcast_to(np.eye(2), (len(outlines), 2, 2)),
        )
        k = np.concatenate([permeability] * repetitions, axis=1)
        flow = solve(elements, k.reshape(-1, *k.shape[2:]))
        # vertices of the columns without the repetitions, (n1 + 1, n2)
        vertices = repeated.vertices[:, :n2]
        return replace(
            flow,
            conductance=flow.conductance / repetitions,
            lower=flow.lower / repetitions,
            upper=flow.upper / repetitions,
            potential=flow.potential[vertices],
            complement=flow.complement[vertices],
        )


def _principal_values(permeability: Array) -> tuple[Array, Array]:
    """Return the permeabilities (n1, n2) along x1 and along x2, from an array (n1, n2, 2) or (n1, n2, 2, 2)."""
    if permeability.ndim == 4:
        return permeability[..., 0, 0], permeability[..., 1, 1]
    return permeability[..., 0], permeability[..., 1]


@dataclass(frozen=True)
class RectangularSeal(PeriodicSeal):
    """Define a straight seal with the inlet at x1 = 0 and the outlet at x1 = L1, periodic along x2.

    The seal consists of equal rectangles in n1 rows and n2 columns. The permeability along x1 and along x2 may differ
    from rectangle to rectangle. The fluid pressure is given at the corners of the rectangles.

    Parameters
    ----------
    size : tuple of two float
        Size L1 in the direction of the leakage, and size L2 along the seal [m].
    cells : tuple of two int
        Numbers of rows n1 and columns n2.

    Raises
    ------
    InputError
        A size is not > 0, or a number of rows or columns is not a whole number >= 1.

    Examples
    --------
    >>> seal = RectangularSeal((1e-3, 0.1), cells=(4, 400))
    >>> seal.length, seal.points.shape
    (0.1, (5, 400, 2))
    """

    size: Pair
    cells: Shape

    def __post_init__(self) -> None:
        if np.shape(self.size) != (2,):
            raise InputError("size", repr(self.size), "two finite numbers > 0 [m]")
        size = tuple(validate.number("size", side, unit="m") for side in self.size)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "cells", validate.grid("cells", self.cells))

    @property
    def length(self) -> float:
        """Length of the seal [m], which is the size L2 along x2."""
        return self.size[1]

    @property
    def points(self) -> Array:
        """Coordinates of the corners of the elements (n1 + 1, n2, 2) [m]."""
        x2 = np.arange(self.cells[1]) * (self.size[1] / self.cells[1])
        return np.stack(np.meshgrid(self.rectangles.lines, x2, indexing="ij"), axis=-1)

    @cached_property
    def rectangles(self) -> Rectangles:
        """Rectangular elements of the strip, in the coordinates (x1, x2)."""
        lines = np.linspace(0.0, self.size[0], self.cells[0] + 1)
        return Rectangles(lines, self.size[1], self.cells[1])


@dataclass(frozen=True)
class AnnularSeal(PeriodicSeal):
    """Define a ring-shaped seal with radial leakage.

    The ring consists of n_r rows of equal width; the first row is at the inlet and the last row at the outlet. Each row
    has n_θ elements. The permeability along the radius and along the angle may differ from element to element. In the
    coordinates (ln r, θ), the elements are rectangles. If the permeability does not vary around the ring, the computed
    flow is therefore exact. The fluid pressure is given at the corners of the elements.

    Parameters
    ----------
    inner_radius, outer_radius : float
        Radii of the ring [m].
    cells : tuple of two int
        Numbers of rows n_r and columns n_θ.
    inlet : "inner" or "outer"
        Radius at which the fluid enters. The rows of elements are counted from the inlet.

    Raises
    ------
    InputError
        The inner radius is not > 0, the outer radius is not larger than the inner radius, or `cells` or `inlet` is
        invalid.

    Examples
    --------
    >>> ring = AnnularSeal(0.01, 0.012, cells=(4, 100), inlet="inner")
    >>> round(ring.length, 4)
    0.0691
    """

    inner_radius: float
    outer_radius: float
    cells: Shape
    inlet: str = "inner"

    def __post_init__(self) -> None:
        for name in ("inner_radius", "outer_radius"):
            object.__setattr__(self, name, validate.number(name, getattr(self, name), unit="m"))
        # raises an InputError if they are invalid
        Ring(self.inner_radius, self.outer_radius, self.inlet)
        object.__setattr__(self, "cells", validate.grid("cells", self.cells))

    @property
    def _ring(self) -> Ring:
        """Geometry of the ring."""
        return Ring(self.inner_radius, self.outer_radius, self.inlet)

    @property
    def radii(self) -> Array:
        """Radii of the row boundaries from inlet to outlet (n_r + 1,) [m]."""
        return self._ring.row_radii(self.cells[0])

    @property
    def size(self) -> Pair:
        """Width of the ring from inlet to outlet, and mean circumference [m]."""
        return self._ring.breadth, self.length

    @property
    def length(self) -> float:
        """Mean circumference π(r_i + r_o) [m]."""
        return self._ring.circumference

    @property
    def points(self) -> Array:
        """Cartesian coordinates of the corners of the elements (n_r + 1, n_θ, 2) [m]."""
        θ = np.arange(self.cells[1]) * (2 * pi / self.cells[1])
        return self.radii[:, None, None] * np.stack([np.cos(θ), np.sin(θ)], axis=-1)

    @cached_property
    def rectangles(self) -> Rectangles:
        """Rectangular elements of the ring in the coordinates (|ln r/r₀|, θ), where r₀ is the radius of the inlet."""
        return Rectangles(self._ring.strip_lines(self.cells[0]), 2 * pi, self.cells[1])
