"""Solve the flow over the cells of a surface, in their order on the surface, along either axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base import Array, Pair
from ..face.cell_flow import Failed, attempt
from ..face.cells import Cut
from ..flow.permeability_table import tabulate
from ..scene import Scene
from ..seal.leakage import Leakage
from ..seal.tiles import SealTiles, face_tiles


def cells_in_order(scene: Scene, size: Pair, k: Array, boundary: str) -> Leakage | Failed:
    """Solve the flow along the first axis through a grid of cells in their order on the surface.

    Parameters
    ----------
    scene : Scene
        The fluid and its pressures.
    size : (float, float), m
        Total size of the cells along the first and the second axis.
    k : array (fluid pressures, 2, m1, m2), m³
        Permeabilities of the cells along the first and the second axis.
    boundary : str
        Boundary condition along the second axis. "periodic" continues the grid of cells periodically; any other value
        closes the two sides of the grid to the flow.
    """
    if boundary != "periodic":
        # The mirror image makes the flow periodic. Nothing flows across the lines of symmetry, which are the sides.
        k = np.concatenate([k, k[..., ::-1]], axis=-1)
        size = size[0], 2 * size[1]
    tiles = face_tiles(size, k.shape[-2:])
    return flow_in_order(scene, tiles, k, tuple(scene.flow.drop.pressures))


def cells_permeability_along_x2(scene: Scene, cut: Cut, k: Array, boundary: str) -> float:
    """Compute the permeability along x2 of the grid of cells.

    The flow is solved separately for each measured patch.

    Parameters
    ----------
    scene : Scene
        The fluid and its pressures.
    cut : Cut
        Division of the surface into cells.
    k : array (fluid pressures, 2, m1, m2), m³
        Permeabilities of the cells along x1 and x2.
    boundary : str
        Boundary condition along x1 for the flow along x2, with the same values as for `cells_in_order`.

    Returns
    -------
    float, m³
        Mean permeability of the patches, weighted by their widths; NaN if the flow solver failed for a patch.
    """
    # Exchange the axes, because `cells_in_order` solves the flow along the first axis: x2 becomes the first axis.
    k_x2_first = k[:, ::-1].swapaxes(-1, -2)
    drops_times_k, widths = [], []
    for columns in cut.patch_columns:
        width = (cut.columns[columns.stop] - cut.columns[columns.start]) * cut.spacing[1]
        size = width, scene.surface.size[0]
        flow = cells_in_order(scene, size, k_x2_first[:, :, columns], boundary)
        # leakage per unit length = k · (drop of the pressure potential) / width
        drops_times_k.append(flow.per_length * width)
        widths.append(width)
    # unit leakage = 1 m³ · (drop of the pressure potential) / breadth of the surface
    potential_drop = scene.unit_leakage * scene.surface.size[0]
    if potential_drop == 0:
        return np.nan
    return float(np.average(drops_times_k, weights=widths)) / potential_drop


def flow_in_order(
    scene: Scene, tiles: SealTiles, k: Array, pressures: Sequence[float], piecewise: bool = False
) -> Leakage | Failed:
    """Solve the flow along x1 through tiles that have the same order as the cells on the surface.

    Parameters
    ----------
    scene : Scene
        The fluid and its pressures.
    tiles : SealTiles
        Tiles in the order of the cells, see `face_tiles`.
    k : array (fluid pressures, 2, m1, m2), m³
        Permeabilities of the cells along x1 and x2.
    pressures : sequence of float, Pa
        Fluid pressures at which the permeabilities are known.
    piecewise : bool
        How the permeabilities are interpolated between the fluid pressures, see `flow.PermeabilityTable`.
    """
    tile_k = k.reshape(len(k), 2, -1)  # (fluid pressure, axis, tile)
    element_k = tiles.permeability(tile_k[:, 0], tile_k[:, 1])
    return attempt(scene.leakage, tiles.seal, tabulate(pressures, list(element_k), piecewise))
