"""Shapes of seals, and the conductance of a whole seal from the permeability of its parts.

A shape is a frozen dataclass with `length`, `points` and `flow` (see `Seal`); one on a structured grid has a `grid`
instead of `flow`. The form is the same in all conformal coordinates, so that a shape is a grid: (x1, x2) of a strip,
(ln r, θ) of a ring. The permeability is given on the links between nodes (Q1 with quadrature at the midpoints of edges:
a network of links).

Symbols: k permeability [m³], φ potential of a node for a unit drop, c conductance of a link = permeability × width /
length [m³], q its flow.
Source of the bounds: Dirichlet's and Thomson's principles for networks (Doyle & Snell, Random Walks and Electric
Networks, 1984).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Any, Protocol

import numpy as np

from ..base import Array, InputError, Pair, Shape, counted, validate
from ..flow import DarcyFlow, solve_flow
from ..flow.balance import energy_gap
from ..flow.grid import Grid, assemble_on_links
from ..flow.law import checked_permeability
from .lay import check_ring

_RTOL = 1e-8
#: Fraction by which both bounds are moved apart: rounding errors of their sums, measured up to 3e-14 of them.
_ROUNDING = 1e-13


class StructuredSeal:
    """A seal whose nodes lie on a structured grid: a shape has `cells`, `size` and `grid`.

    The grid is in coordinates in which the form is that of a plane strip.
    """

    cells: Shape
    grid: Any

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Flow for a unit drop, potential at the nodes (n1 + 1, n2), with an error of 1e-8 in the potential too.

        permeability : a number, or the links (k1, k2), numbers or arrays (n1, n2) and (n1 − 1, n2) [m³].
        bounds : enclose the flow of the network of links, and the value, whatever the error of the solver: the upper
            bound is the energy of the computed potential, the lower one that of a flux that balances at every node.
        solver : see `femseal.flow.solve_flow`.

        Raises InputError: a bad permeability.
        NotConverged : see `femseal.flow.solve_flow`.
        """
        stencil = assemble_on_links(self.grid, *link_permeabilities(permeability, self.cells))
        flow = solve_flow(stencil, rtol=_RTOL, solver=solver, field_rtol=_RTOL)
        if not bounds:
            return flow
        lower = upper = 0.0
        if flow.percolates:
            potential = np.nan_to_num(flow.potential)  # pockets carry no flow
            # an upper bound for any potential that is 1 and 0 at the ends
            upper = stencil.energy(potential)
            lower = max(0.0, upper * (1 - energy_gap(stencil, potential, 1 - potential)))
            lower = min(lower, flow.conductance) * (1 - _ROUNDING)
            upper = max(upper, flow.conductance) * (1 + _ROUNDING)
        return replace(flow, lower=lower, upper=upper)


def link_permeabilities(permeability: Any, cells: Shape) -> tuple[Array, Array]:
    """k1 (n1, n2) and k2 (n1 − 1, n2) [m³] from a number, or a pair of numbers or arrays; or InputError."""
    n1, n2 = cells
    shapes = (n1, n2), (n1 - 1, n2)
    pair = permeability
    if not isinstance(permeability, (tuple, list)):
        pair = [permeability] * (1 if np.ndim(permeability) else 2)
    if len(pair) != 2:
        allowed = f"a number, or the links (k1, k2), numbers or arrays {shapes[0]} and {shapes[1]}"
        raise InputError("permeability", counted(len(pair), "array"), allowed)
    k1, k2 = (
        np.broadcast_to(checked_permeability(f"permeability {name}", k, shape), shape)
        for name, k, shape in zip(("k1", "k2"), pair, shapes, strict=True)
    )
    return k1, k2


class Seal(Protocol):
    """Interface of the shapes that `seal_leakage` takes."""

    @property
    def length(self) -> float:
        """Length along the seal by which leakage is divided [m]."""
        ...

    @property
    def points(self) -> Array:
        """Coordinates (…, 2) [m] of the nodes at which the fluid pressure is given."""
        ...

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Flow for a unit drop of potential through the given permeability, checked."""
        ...


@dataclass(frozen=True)
class RectangularSeal(StructuredSeal):
    """A straight seal, inlet at x1 = 0, outlet at x1 = L1, periodic along x2.

    Nodes lie in n1 + 1 rows and at x2 = (j + ½)Δ2; permeabilities belong to the links between them, k1 (n1, n2)
    along the leakage and k2 (n1 − 1, n2) along the seal, from column j to j + 1. A link along the seal carries the flow
    from half way to the row before to half way to the row after.

    Parameters
    ----------
    size : (L1, L2) [m], L1 along the leakage.
    cells : (n1, n2).

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
        """Coordinates of the nodes (n1 + 1, n2, 2) [m]."""
        x2 = (np.arange(self.cells[1]) + 0.5) * (self.size[1] / self.cells[1])
        return np.stack(np.meshgrid(self.grid.lines1, x2, indexing="ij"), axis=-1)

    @cached_property
    def grid(self) -> Grid:
        """Nodes in rows x1 and columns x2."""
        x1 = np.linspace(0.0, self.size[0], self.cells[0] + 1)
        return Grid.of_strip(x1, self.size[1] / self.cells[1], self.cells[1])


@dataclass(frozen=True)
class AnnularSeal(StructuredSeal):
    """A ring, leaking along the radius; axis 0 always runs from the inlet to the outlet, axis 1 along the
    angle.

    Nodes lie at n_r + 1 radii and at n_θ angles. A radial link has the conductance k1 Δθ/ln(r₊/r₋), exact
    for constant k; a tangential one carries the flow from half way to the radius before to half way to the one after,
    in ln r, k2 ln(r₊/r₋)/2Δθ.

    Parameters
    ----------
    inner_radius, outer_radius : [m].
    cells : (n_r, n_θ).
    inlet : "inner" or "outer"; with "outer" the first row of k1 and of the fluid pressure lies outside.

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
        """Radii of the nodes (n_r + 1,) from inlet to outlet [m]."""
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
        """Cartesian coordinates of the nodes (n_r + 1, n_θ, 2) [m]."""
        θ = (np.arange(self.cells[1]) + 0.5) * (2 * pi / self.cells[1])
        return self.radii[:, None, None] * np.stack([np.cos(θ), np.sin(θ)], axis=-1)

    @cached_property
    def grid(self) -> Grid:
        """Nodes in rows of |ln r/r₀| and columns of θ, in which the form is that of a strip."""
        r = self.radii
        return Grid.of_strip(np.abs(np.log(r / r[0])), 2 * pi / self.cells[1], self.cells[1])
