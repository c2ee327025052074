"""Compute the permeabilities of all cells at the pressures of the tiles of a seal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array, Indices, Mapper
from ..face.cell_flow import attempt
from ..face.curves import CellCurves
from ..face.cut import Cut
from ..flow.permeability_table import tabulate
from ..scene import Scene
from ..seal.layouts import RectangularLayout
from ..seal.tiles import SealTiles
from .cell_states import FaceCells, solve_cells_at_pressures
from .face_study import cut_into_cells
from .patch_state import PatchState
from .tabulated_pressures import choose_tabulated_pressures, interpolate_along_paths
from .tile_fluid import TileFluid
from .tile_pressure import distinct_paths

#: Estimated relative error at which the leakage of a realisation has converged, if permeabilities depend on the fluid
#: pressure. The true error was below 1e-3 up to a fluid pressure of 0.95 of the load.
REALISATION_RTOL = 3e-4


@dataclass(frozen=True, eq=False)
class CellSupply:
    """Permeabilities of all cells at the pressures of the tiles of a seal.

    In each realisation, every tile of the seal takes the permeability of a random cell. A pressure path is the sequence
    of the nominal pressures of a tile at all load steps. Tiles with equal nominal pressures share a pressure path.

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
        Fluid pressures at which the permeabilities of the cells are computed.
    path_of_tile : array of int (tiles,)
        Index of the pressure path of each tile.
    paths : array (steps, paths), Pa
        Nominal pressure of each pressure path at every load step.
    unsolved : tuple of (int, str)
        Index of each load step without a solution, and the reason.
    added_k : array (steps, tiles), m³, optional
        Increase of the permeability of each tile where the form deviation of the seal holds the surfaces apart, see
        `opening_permeability`; None for a seal without form deviation.
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
        """Indices of the load steps at which the permeabilities of all cells are known."""
        known = np.flatnonzero(np.isfinite(self.k).all(axis=(0, 1, 3, 4)))
        return np.setdiff1d(known, [s for s, _ in self.unsolved]).tolist()

    def choose_cells(self, seed: int, realisation: int) -> Indices:
        """Choose a random cell for every tile (tiles,).

        Calls with the same seed and the same number of the realisation always return the same cells.
        """
        stream = np.random.SeedSequence(seed, spawn_key=(realisation,))
        return self.tiles.choose_cells(self.cells.cut.shape, np.random.default_rng(stream))

    def solve_flow(self, cell_of_tile: Indices, step: int) -> tuple[Any, Any]:
        """Solve the flow through one realisation of the seal at a load step.

        cell_of_tile : index of the cell that each tile takes (tiles,).

        Returns the permeabilities of the elements of the seal, and the flow or the reason why the flow solver failed.
        """
        k = self.k[:, :, step, self.path_of_tile, cell_of_tile]  # (fluid pressure, axis, tile)
        if self.added_k is not None:
            k = k + self.added_k[step]
        element_k = list(self.tiles.permeability(k[:, 0], k[:, 1]))
        permeability = tabulate(self.fluid.pressures, element_k, self.fluid.piecewise)
        flow = attempt(self.scene.leakage, self.tiles.seal, permeability, REALISATION_RTOL)
        return permeability, flow

    def over_tiles(self, values: Array) -> Array:
        """Interpolate a quantity of the contact states at the pressure of each tile, and average over the tiles.

        The interpolation requires a quantity that decreases with increasing pressure, such as a permeability.

        values : the quantity in each contact state (states,).
        """
        tiles_of_path = np.bincount(self.path_of_tile, minlength=self.paths.shape[1])
        return self._interpolate(values, self.paths, tiles_of_path / self.path_of_tile.size)

    def at_nominal(self, values: Array) -> Array:
        """Interpolate a quantity of the contact states at the nominal pressures of the load steps.

        The interpolation requires a quantity that decreases with increasing pressure, such as a permeability.

        values : the quantity in each contact state (states,).
        """
        return self._interpolate(values, self.scene.steps.pressures[:, None], np.ones(1))

    def _interpolate(self, values: Array, paths: Array, weights: Array) -> Array:
        """Interpolate a quantity of the contact states along pressure paths, and average over the paths.

        The contact pressure at which the quantity is interpolated is the nominal pressure less the relief due to the
        mean fluid pressure, see `mean_relief`.

        Parameters
        ----------
        values : array (states,)
            The quantity in each contact state.
        paths : array (steps, paths), Pa
            Nominal pressures of the paths.
        weights : array (paths,)
            Weight of each pressure path in the average; the sum of the weights is 1.

        Returns
        -------
        array (steps,)
            Average of the interpolated quantity over the pressure paths, at each load step.
        """
        if self.cells.steps == self.scene.steps:
            # All tiles have the pressures of the load steps, at which the contact was solved, see `supply_cells`. The
            # quantity is known at every load step, and all paths have the same values.
            return values
        contact_pressures = np.maximum(paths - mean_relief(self.scene), 0.0)  # (step, path)
        # `CellCurves` is made for permeabilities, but interpolates any quantity that decreases with the pressure
        curves = CellCurves(self.cells.steps, values)
        values_on_paths = curves.k_on_paths(contact_pressures, self.scene.steps)  # (step, path)
        return values_on_paths @ weights

    @property
    def contact_pressures(self) -> Array:
        """Nominal pressures of the load steps less the relief due to the mean fluid pressure [Pa]."""
        return np.maximum(self.scene.steps.pressures - mean_relief(self.scene), 0.0)

    def patch_state(self, open_leakage: Array) -> PatchState:
        """Return the contact state of the patch at each load step, for the width of the 95 % interval.

        The contact states are taken at the nominal pressures less the relief due to the mean fluid pressure, see
        `mean_relief`.

        open_leakage : leakage of a uniform gap that is equal to the mean gap of the contact state (steps,) [m²/s].
        """
        return PatchState.of(self.scene.steps, self.cells, self.contact_pressures, open_leakage)


def mean_relief(scene: Scene) -> float:
    """Return by how much the mean fluid pressure reduces the contact pressure [Pa].

    The reduction is 0 if the case neglects the fluid pressure on the surfaces.
    """
    fluid = scene.acting_fluid
    return 0.0 if fluid is None else float(fluid.relief([fluid.absolute_mean])[0])


def supply_cells(
    scene: Scene, cut: Cut, tiles: SealTiles, fractions: Array, mapper: Mapper
) -> CellSupply:
    """Compute the permeabilities of the cells of a surface at the tile pressures of a seal.

    The contact is solved at the load steps of the scene in two cases: if the cells stay in order, or if every tile has
    the contact pressure of the load steps. In all other cases, the contact is solved at tabulated pressures, and the
    permeabilities are interpolated.

    fractions : pressure of each tile divided by the nominal pressure of the load step (steps, tiles).
    """
    steps = scene.steps
    if tiles.in_order:
        # all tiles have the nominal pressures of the load steps
        path_of_tile = np.zeros(tiles.count, np.int64)
        paths = steps.pressures[:, None]
        fluid = TileFluid(tuple(scene.flow.drop.pressures))
        cells = _solve_cells_in_order(scene, cut, mapper)
        # The correction factors are not needed, because the leakage of each realisation is corrected as a whole, see
        # `stochastic_study`.
        k = _on_single_path(cells.k)
        unsolved = cells.unsolved
    else:
        path_fractions, path_of_tile = distinct_paths(fractions)
        paths = steps.pressures[:, None] * path_fractions
        fluid = TileFluid.of(scene)
        cells, k = _solve_cells_at_random(scene, cut, fluid, paths, mapper)
        unsolved = scene.separated_steps
    return CellSupply(
        scene=scene,
        tiles=tiles,
        cells=cells,
        k=k,
        fluid=fluid,
        path_of_tile=path_of_tile,
        paths=paths,
        unsolved=unsolved,
    )


def _solve_cells_in_order(scene: Scene, cut: Cut, mapper: Mapper) -> FaceCells:
    """Solve the cells at the load steps, for a seal whose cells stay in order."""
    # spiral grooves belong to the seal, not to its cells; a rectangular layout has no spiral
    without_spiral = scene
    if scene.flow.spiral is not None:
        without_spiral = replace(scene, layout=RectangularLayout())
    cells = cut_into_cells(without_spiral, cut, mapper).cells
    assert cells is not None
    return cells


def _solve_cells_at_random(
    scene: Scene, cut: Cut, fluid: TileFluid, paths: Array, mapper: Mapper
) -> tuple[FaceCells, Array]:
    """Solve the cells of a seal whose tiles take random cells.

    paths : nominal pressures of the pressure paths (steps, paths) [Pa].

    Returns the cells, and their permeabilities on the paths, see `CellSupply.k`.
    """
    steps = scene.steps
    contact_paths = fluid.effective_pressures(paths)  # contact pressures (step, relief and path)
    has_single_path = contact_paths.shape[1] == 1
    if has_single_path and np.array_equal(contact_paths[:, 0], steps.pressures):
        # all tiles have the contact pressure of the load steps, so that nothing is interpolated
        cells = solve_cells_at_pressures(scene, cut, steps, mapper)
        return cells, _on_single_path(cells.corrected_k)
    tabulated_steps = choose_tabulated_pressures(contact_paths, steps, scene.law.is_elastic)
    cells = solve_cells_at_pressures(scene, cut, tabulated_steps, mapper)
    k_on_contact_paths = interpolate_along_paths(cells, contact_paths, steps)
    return cells, fluid.select_matching_reliefs(k_on_contact_paths)


def _on_single_path(k: Array) -> Array:
    """Return permeabilities at the load steps (fluid pressures, 2, steps, m1, m2) in the form of `CellSupply.k`."""
    return k.reshape(*k.shape[:3], 1, -1)
