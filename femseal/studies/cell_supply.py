"""Provide the permeabilities that the tiles of a seal take from random cells, at the pressure of each tile."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array, Indices, Mapper
from ..face.cell_flow import attempt
from ..face.cells import Cut
from ..face.curves import CellCurves
from ..flow.permeability_table import tabulate
from ..scene import Scene
from ..seal.layouts import RectangularLayout
from ..seal.tiles import SealTiles
from .cell_states import (
    FaceCells,
    choose_tabulated_pressures,
    interpolate_along_paths,
    solve_cells_at_pressures,
)
from .face_study import cut_into_cells
from .patch_state import PatchState
from .sampling import TileFluid, distinct_paths

#: Estimated relative error at which the leakage of a realisation has converged, if permeabilities depend on the fluid
#: pressure. The true error was below 1e-3 up to a fluid pressure of 0.95 of the load.
REALISATION_RTOL = 3e-4


@dataclass(frozen=True, eq=False)
class CellSupply:
    """Hold the permeabilities of all cells; every tile of a seal takes the permeability of a random cell.

    A pressure path contains the nominal pressure of a tile at each load step. Tiles with the same pressures share a
    path.

    Parameters
    ----------
    scene : Scene
        The surface, its load and its fluid.
    tiles : SealTiles
        Tiles of the seal.
    cells : FaceCells
        Cells of the surface, at the loads of the scene or at tabulated pressures.
    k : array (fluid pressures, 2, steps, paths, cells), m³
        Permeability of every cell along x1 and x2 on every pressure path.
    fluid : TileFluid
        Fluid pressures at which the permeabilities are known.
    path_of_tile : array of int (tiles,)
        Number of the pressure path of each tile.
    paths : array (steps, paths), Pa
        Nominal pressure of each path at every step.
    unsolved : tuple of (int, str)
        Index of each step that has no solution, and the reason.
    added_k : array (steps, tiles), m³, optional
        Increase of the permeability where the form of the seal holds the surfaces apart, see `opening_permeability`;
        None for a seal without form.
    """

    scene: Scene
    tiles: SealTiles
    cells: FaceCells
    k: Array
    fluid: TileFluid
    path_of_tile: Indices
    paths: Array
    unsolved: tuple[tuple[int, str], ...]
    added_k: Array | None = None

    @property
    def solved_steps(self) -> list[int]:
        """Indices of the steps at which all permeabilities are known."""
        known = np.flatnonzero(np.isfinite(self.k).all(axis=(0, 1, 3, 4)))
        return np.setdiff1d(known, [s for s, _ in self.unsolved]).tolist()

    def choose_cells(self, seed: int, realisation: int) -> Indices:
        """Choose a random cell for every tile (tiles,). The same seed and realisation always give the same cells."""
        stream = np.random.SeedSequence(seed, spawn_key=(realisation,))
        return self.tiles.choose_cells(self.cells.cut.shape, np.random.default_rng(stream))

    def solve_flow(self, cell_of_tile: Indices, step: int) -> tuple[Any, Any]:
        """Solve the flow through the seal at a load step, for one choice of the cells in its tiles.

        cell_of_tile : number of the cell in each tile (tiles,).

        Returns the permeabilities of the elements, and the leakage or the reason why the solver failed.
        """
        k = self.k[:, :, step, self.path_of_tile, cell_of_tile]  # (fluid pressure, axis, tile)
        if self.added_k is not None:
            k = k + self.added_k[step]
        element_k = list(self.tiles.permeability(k[:, 0], k[:, 1]))
        permeability = tabulate(self.fluid.pressures, element_k, self.fluid.piecewise)
        flow = attempt(self.scene.leakage, self.tiles.seal, permeability, REALISATION_RTOL)
        return permeability, flow

    def over_tiles(self, values: Array) -> Array:
        """Interpolate a quantity of the contact states at the pressure of each tile, and average it over the tiles.

        The quantity must decrease with increasing pressure, as a permeability does.
        """
        tiles_of_path = np.bincount(self.path_of_tile, minlength=self.paths.shape[1])
        return self._interpolate(values, self.paths, tiles_of_path / self.path_of_tile.size)

    def at_nominal(self, values: Array) -> Array:
        """Interpolate a quantity of the contact states at the nominal pressures of the load steps.

        The quantity must decrease with increasing pressure, as a permeability does.
        """
        return self._interpolate(values, self.scene.steps.pressures[:, None], np.ones(1))

    def _interpolate(self, values: Array, paths: Array, weights: Array) -> Array:
        """Interpolate a quantity of the contact states at the pressures of paths, and average it over the paths.

        The mean fluid pressure is first subtracted from the nominal pressures.

        Parameters
        ----------
        values : array (states,)
            Quantity in each contact state.
        paths : array (steps, paths), Pa
            Nominal pressures.
        weights : array (paths,)
            Weight of each path in the average; the sum of the weights is 1.

        Returns
        -------
        array (steps,)
            Averaged quantity at each load step.
        """
        # the contact states are then the load steps themselves, and nothing has to be interpolated
        if self.cells.steps == self.scene.steps:
            return values
        contact_pressures = np.maximum(paths - mean_relief(self.scene), 0.0)
        curves = CellCurves(self.cells.steps, values)
        return curves.k_on_paths(contact_pressures, self.scene.steps) @ weights

    def patch_state(self, open_leakage: Array) -> PatchState:
        """Return the contact states of the patch at each load step, under the mean contact pressure of this step.

        The mean contact pressure is the nominal pressure minus the mean fluid pressure.

        open_leakage : leakage of a uniform gap that is equal to the mean gap of the state, array (steps,), m²/s.
        """
        steps = self.scene.steps
        contact_pressures = np.maximum(steps.pressures - mean_relief(self.scene), 0.0)
        return PatchState.of(steps, self.cells, contact_pressures, open_leakage)


def mean_relief(scene: Scene) -> float:
    """Return by how much the mean fluid pressure reduces the contact pressure [Pa]; 0 if the fluid does not act."""
    fluid = scene.acting_fluid
    return 0.0 if fluid is None else float(fluid.relief([fluid.mean])[0])


def supply_cells(
    scene: Scene, cut: Cut, tiles: SealTiles, fractions: Array, mapper: Mapper
) -> CellSupply:
    """Solve the cells of a surface for the tiles of a seal.

    The cells are solved at the load steps of the scene if they stay in order or if all tiles have the pressure of the
    load steps. Otherwise they are solved at tabulated pressures.

    fractions : pressure of each tile, as a fraction of the nominal pressure, array (steps, tiles).
    """
    if tiles.in_order:
        return _supply_in_order(scene, cut, tiles, mapper)
    steps = scene.steps
    path_fractions, path_of_tile = distinct_paths(fractions)
    paths = steps.pressures[:, None] * path_fractions  # nominal pressures (step, path)
    fluid = TileFluid.of(scene)
    contact_paths = fluid.effective_pressures(paths)  # contact pressures (step, relief and path)
    has_single_path = contact_paths.shape[1] == 1
    if has_single_path and np.array_equal(contact_paths[:, 0], steps.pressures):
        # all tiles have the pressure of the load steps, so that nothing is interpolated
        cells = solve_cells_at_pressures(scene, cut, steps, mapper)
        k = cells.corrected_k.reshape(*cells.k.shape[:3], 1, -1)
    else:
        tabulated_steps = choose_tabulated_pressures(contact_paths, steps, scene.law.is_elastic)
        cells = solve_cells_at_pressures(scene, cut, tabulated_steps, mapper)
        k_on_contact_paths = interpolate_along_paths(cells, contact_paths, steps)
        k = fluid.select_matching_reliefs(k_on_contact_paths)
    return CellSupply(scene, tiles, cells, k, fluid, path_of_tile, paths, scene.separated_steps)


def _supply_in_order(scene: Scene, cut: Cut, tiles: SealTiles, mapper: Mapper) -> CellSupply:
    """Solve the cells at the load steps of the scene, for a seal whose tiles all have the nominal pressure."""
    # spiral grooves belong to the seal, not to its cells; a rectangular layout has no spiral
    without_spiral = scene
    if scene.flow.spiral is not None:
        without_spiral = replace(scene, layout=RectangularLayout())
    cells = cut_into_cells(without_spiral, cut, mapper).cells
    assert cells is not None
    k = cells.k.reshape(*cells.k.shape[:3], 1, -1)  # a single path
    fluid = TileFluid(tuple(scene.flow.drop.pressures))
    path_of_tile = np.zeros(tiles.count, np.int64)
    paths = scene.steps.pressures[:, None]
    return CellSupply(scene, tiles, cells, k, fluid, path_of_tile, paths, cells.unsolved)
