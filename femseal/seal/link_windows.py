"""Windows drawn for the links of a seal on a structured grid, whose lay runs along one of its axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..base.arrays import Array
from .shapes import AnnularSeal, RectangularSeal


@dataclass(frozen=True, eq=False)
class LinkWindows:
    """One window for each link between nodes, see `layouts.SealWindows`.

    turned : the lay runs along axis 0, from inlet to outlet, so that links take the other axis of a window.
    """

    seal: RectangularSeal | AnnularSeal
    turned: bool = False
    warnings: tuple[str, ...] = ()

    together: ClassVar[bool] = False

    @property
    def axes(self) -> tuple[int, int]:
        """Axis of the windows along which the links along axes 0 and 1 take their permeability."""
        return (1, 0) if self.turned else (0, 1)

    @property
    def rows(self) -> int:
        """Rows of windows from inlet to outlet that are like those of a face; 0 where windows are turned."""
        return 0 if self.turned else self.seal.cells[0]

    @property
    def draws(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Rows and columns of the links along both axes."""
        n1, n2 = self.seal.cells
        return (n1, n2), (n1 - 1, n2)

    def places(self, axis: int) -> Array:
        """Middles of the links along an axis (rows, columns, 2) [m]."""
        x1, columns = np.asarray(self.seal.rows), np.arange(self.seal.cells[1])
        if axis == 0:
            return self.seal.place((x1[:-1] + x1[1:]) / 2, columns)
        return self.seal.place(x1[1:-1], columns + 0.5)

    def permeability(self, along: Array, across: Array) -> tuple[Array, Array]:
        """The permeabilities of the links, as the seal takes them."""
        return along, across

    def with_rows(self, rows: tuple[float, ...]) -> LinkWindows:
        """The same windows between rows of nodes at other distances from the inlet [m]; as they are without any."""
        if not rows:
            return self
        stretch = self.seal.size[0] / rows[-1]
        return replace(self, seal=replace(self.seal, rows=tuple(stretch * x for x in rows)))

    @property
    def outlines(self) -> Array:
        """Corners of the surroundings of the links along axis 0 (n1 n2, 4, 2) [m], which pictures show."""
        corners = self.seal.place(self.seal.rows, np.arange(self.seal.cells[1] + 1) - 0.5)
        around = [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]]
        return np.stack(around, axis=2).reshape(-1, 4, 2)

    def shown(self, permeability: tuple[Array, Array], fluid_pressure: Array) -> tuple[Array, Array]:
        """Permeability [m³] along axis 0 and fluid pressure [Pa] of every part (n1 n2,)."""
        return permeability[0].ravel(), ((fluid_pressure[:-1] + fluid_pressure[1:]) / 2).ravel()

    def means(self, values: Array) -> Array:
        """Means (n1 n2,) over the windows of every part of values (rows, columns) drawn along axis 0."""
        return values.ravel()

    def flux(self, permeability: tuple[Array, Array], potential: Array, rate: float) -> Array:
        """Volume rate per width (n1 n2, 2) [m²/s] in every part, in the plane of the seal.

        It is that of its link along axis 0, and the mean of those along axis 1 at its corners.

        permeability : of the links [m³]. potential : of the nodes (n1 + 1, n2) over the density of volume rates [1/s],
        NaN in pockets. rate : leakage of the seal [m³/s]; the links carry it as they are.
        """
        along = _link_flux(permeability[0], np.diff(potential, axis=0), np.diff(self.seal.points, axis=0))
        across = np.zeros((self.seal.cells[0] + 1, self.seal.cells[1], 2))
        if self.seal.cells[1] > 1:
            following = self.seal.place(self.seal.rows, np.arange(1, self.seal.cells[1] + 1))
            drop, way = np.roll(potential, -1, axis=1) - potential, following - self.seal.points
            across[1:-1] = _link_flux(permeability[1], drop[1:-1], way[1:-1])
        rows = (across[:-1] + across[1:]) / 2
        return (along + (rows + np.roll(rows, 1, axis=1)) / 2).reshape(-1, 2)

    @property
    def unknowns(self) -> tuple[int, int]:
        """Rows and columns of the network."""
        return self.seal.cells

    def __str__(self) -> str:
        n1, n2 = self.seal.cells
        return f"{n1} × {n2} links"


@dataclass(frozen=True, eq=False)
class SpiralWindows(LinkWindows):
    """Windows for links whose grooves wind: each along axis 0 has k₁ cos²α + k₂ sin²α, with k₂ of a whole row.

    tangent : tan α of every row of links along axis 0 (n1,). Where all windows are alike the pressure depends on that
    axis alone, and the rest of their tensors does not matter.
    """

    tangent: tuple[float, ...] = ()

    together: ClassVar[bool] = True

    @property
    def rows(self) -> int:
        """0: windows keep no place of a face."""
        return 0

    @property
    def draws(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Rows and columns of the windows, of which each is drawn with both of its permeabilities."""
        return self.seal.cells, self.seal.cells

    def places(self, axis: int) -> Array:
        """Middles of the windows (rows, columns, 2) [m]."""
        return super().places(0)

    def permeability(self, along: Array, across: Array) -> tuple[Array, Array]:
        """The permeabilities of the links from those of the windows; across, the mean of the rows beside.

        A groove passes all windows of a row: its flow along x1 has their harmonic mean.
        """
        square = np.square(self.tangent)[:, None]
        radial = (along + square * along_grooves(across)) / (1 + square)
        round_ = (across + square * along) / (1 + square)
        return radial, (round_[:-1] + round_[1:]) / 2


def along_grooves(across: Array) -> Array:
    """Permeability of grooves (rows, 1) [m³] that pass all windows of a row (rows, columns): the harmonic mean."""
    with np.errstate(divide="ignore"):
        groove: Array = 1 / np.mean(1 / across, axis=1, keepdims=True)
    return groove


def _link_flux(k: Array, drop: Array, way: Array) -> Array:
    """Flux (…, 2) along links whose ends differ by so much in potential (…) and in place (…, 2)."""
    return -(k * np.nan_to_num(drop) / (way**2).sum(axis=-1))[..., None] * way
