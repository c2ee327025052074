"""Strips and rings, and the interface of all shapes of seals.

Both are rows of rectangles from the inlet to the outlet, periodic along the seal: (x1, x2) of a strip, (ln r, θ) of a
ring, in which the form of Darcy's law is the same. Each rectangle has its own permeability, constant in it. Their flow
is that of `femseal.flow.rectangles`.

A shape is a frozen dataclass with what `Seal` lists.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Any, ClassVar, Protocol

import numpy as np

from ..base import Array, InputError, Pair, Shape, validate
from ..flow import DarcyFlow
from ..flow.law import checked_permeability
from ..flow.mesh_input import permeability_tensors
from ..flow.problem import PLAIN_SOLVERS, check_solver
from ..flow.rectangles import FEWEST_COLUMNS, Rectangles
from .lay import check_ring
from .mesh_seal import ElementSeal


class Seal(Protocol):
    """Interface of the shapes that `seal_leakage` takes.

    value_needs_bounds : whether the flow is computed from both of its bounds, so that `bounds` has to be asked for.
    element_shapes : shapes of a permeability of the elements, the first with a number for each of them.
    """

    value_needs_bounds: ClassVar[bool]

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of a permeability of the elements."""
        ...

    @property
    def length(self) -> float:
        """Length along the seal by which leakage is divided [m]."""
        ...

    @property
    def points(self) -> Array:
        """Coordinates (…, 2) [m] of the points at which the fluid pressure is given."""
        ...

    def corner_values(self, values: Array) -> Array:
        """Values at the corners of the elements (n, corners), from those at the points."""
        ...

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Flow for a unit drop of potential through the given permeability, checked."""
        ...


class PeriodicSeal:
    """A strip or a ring of rectangles: a shape has `cells`, and `rectangles` in coordinates of a plane strip."""

    cells: Shape
    value_needs_bounds: ClassVar[bool] = False

    @property
    def rectangles(self) -> Rectangles:
        """The rectangles in coordinates in which the form is that of a plane strip."""
        raise NotImplementedError

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of a permeability of the elements that is no tensor."""
        n1, n2 = self.cells
        return (n1 * n2,), (n1, n2), (n1 * n2, 2), (n1, n2, 2)

    def corner_values(self, values: Array) -> Array:
        """Values at the corners of the elements (n, 4), from those at the points (n1 + 1, n2)."""
        beside = np.roll(values, -1, axis=1)
        corners = values[:-1], values[1:], beside[1:], beside[:-1]
        return np.stack(corners, axis=-1).reshape(-1, 4)

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Solve the flow for a unit drop.

        Parameters
        ----------
        permeability : a number, or one per element [m³]: (n1, n2), or (n1, n2, 2) along x1 and x2 of a strip, along the
            radius and the angle of a ring; or, with the n = n1 n2 elements row by row, (n,), (n, 2), or tensors
            (n, 2, 2).
        bounds : also enclose the flow between `lower` and `upper`, whatever the error of the solver.
        solver : "multigrid" or "elimination" (the fast path), "amg" or "direct" (on a mesh of scikit-fem), or "auto".
            Tensors whose axes are not those of the rectangles take the mesh.

        Returns
        -------
        DarcyFlow with the potential at the corners of the rectangles, array (n1 + 1, n2).

        Raises
        ------
        InputError : a bad permeability.
        NotConverged : see `femseal.flow.solve_flow`.
        """
        check_solver(solver)
        k = self._element_permeability(permeability)
        is_oblique = k.ndim == 4 and bool(k[..., 0, 1].any())
        if is_oblique or solver in PLAIN_SOLVERS:
            return self._flow_on_mesh(k, bounds, solver if solver in PLAIN_SOLVERS else "auto")
        k1, k2 = (k[..., 0], k[..., 1]) if k.ndim == 3 else (k[..., 0, 0], k[..., 1, 1])
        return self.rectangles.flow(k1, k2, bounds=bounds, solver=solver)

    def _element_permeability(self, permeability: Any) -> Array:
        """Permeability along the axes (n1, n2, 2), or tensors (n1, n2, 2, 2), from all that `flow` takes."""
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
        if k.shape in ((), (n1, n2), (n1 * n2,)):
            k = k.reshape(self.cells if k.ndim else (1, 1))[..., None]
        else:
            k = k.reshape(n1, n2, 2)
        return np.broadcast_to(k, (n1, n2, 2))

    def _flow_on_mesh(self, permeability: Array, bounds: bool, solver: str) -> DarcyFlow:
        """Solve the flow by scikit-fem, with permeability (n1, n2, 2) or (n1, n2, 2, 2); few columns are repeated."""
        n2 = self.cells[1]
        times = -(-FEWEST_COLUMNS // n2)
        strip = self.rectangles
        repeated = Rectangles(strip.lines, times * strip.period, times * n2)
        outlines = repeated.outlines
        elements = ElementSeal(
            repeated.mesh,
            *repeated.ends,
            size=(float(np.ptp(strip.lines)), repeated.period),
            outlines=outlines,
            axes=np.broadcast_to(np.eye(2), (len(outlines), 2, 2)),
        )
        k = np.concatenate([permeability] * times, axis=1)
        flow = elements.flow(k.reshape(-1, *k.shape[2:]), bounds=True, solver=solver)
        vertices = repeated.vertices[:, :n2]
        return replace(
            flow,
            conductance=flow.conductance / times,
            lower=flow.lower / times if bounds else np.nan,
            upper=flow.upper / times if bounds else np.nan,
            potential=flow.potential[vertices],
            complement=flow.complement[vertices],
        )


@dataclass(frozen=True)
class RectangularSeal(PeriodicSeal):
    """A straight seal, inlet at x1 = 0, outlet at x1 = L1, periodic along x2.

    It is made of equal rectangles in n1 rows and n2 columns, each with its own permeability along x1 and x2. The fluid
    pressure is given at their corners.

    Parameters
    ----------
    size : (L1, L2) [m], L1 along the leakage.
    cells : (n1, n2), numbers of rows and columns.

    Raises
    ------
    InputError : sizes that are not > 0, cells that are not whole numbers >= 1.

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
        """L2 [m]."""
        return self.size[1]

    @property
    def points(self) -> Array:
        """Coordinates of the corners of the elements (n1 + 1, n2, 2) [m]."""
        x2 = np.arange(self.cells[1]) * (self.size[1] / self.cells[1])
        return np.stack(np.meshgrid(self.rectangles.lines, x2, indexing="ij"), axis=-1)

    @cached_property
    def rectangles(self) -> Rectangles:
        """Its rectangles in (x1, x2)."""
        lines = np.linspace(0.0, self.size[0], self.cells[0] + 1)
        return Rectangles(lines, self.size[1], self.cells[1])


@dataclass(frozen=True)
class AnnularSeal(PeriodicSeal):
    """A ring, leaking along the radius.

    It is made of n_r rows of equal breadth, from the inlet to the outlet, with n_θ elements each. Every element has its
    own permeability along the radius and the angle. In (ln r, θ) they are rectangles, with which the flow is exact
    where the permeability is the same all around. The fluid pressure is given at their corners.

    Parameters
    ----------
    inner_radius, outer_radius : [m].
    cells : (n_r, n_θ), numbers of rows and columns.
    inlet : "inner" or "outer"; with "outer" the first row of elements and of the fluid pressure lies outside.

    Raises
    ------
    InputError : radii that do not increase from above 0, bad cells, another inlet.

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
        check_ring(self.inner_radius, self.outer_radius, self.inlet)
        object.__setattr__(self, "cells", validate.grid("cells", self.cells))

    @property
    def radii(self) -> Array:
        """Radii of the lines between the rows (n_r + 1,) from inlet to outlet [m]."""
        x1 = np.linspace(0.0, self.outer_radius - self.inner_radius, self.cells[0] + 1)
        return self.inner_radius + x1 if self.inlet == "inner" else self.outer_radius - x1

    @property
    def size(self) -> Pair:
        """Breadth from inlet to outlet and mean circumference [m]."""
        return (self.outer_radius - self.inner_radius, self.length)

    @property
    def length(self) -> float:
        """Mean circumference π(r_i + r_o) [m]."""
        return pi * (self.inner_radius + self.outer_radius)

    @property
    def points(self) -> Array:
        """Cartesian coordinates of the corners of the elements (n_r + 1, n_θ, 2) [m]."""
        θ = np.arange(self.cells[1]) * (2 * pi / self.cells[1])
        return self.radii[:, None, None] * np.stack([np.cos(θ), np.sin(θ)], axis=-1)

    @cached_property
    def rectangles(self) -> Rectangles:
        """Its elements as rectangles in (|ln r/r₀|, θ), with the radius r₀ of the inlet."""
        r = self.radii
        return Rectangles(np.abs(np.log(r / r[0])), 2 * pi, self.cells[1])
