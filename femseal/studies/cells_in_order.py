"""Solve the flow over the cells of a surface, in their order on the surface, along either axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base import Array, Pair
from ..face.cell_flow import Failed, attempt
from ..face.cut import Cut
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
    length_x1 = scene.surface.size[0]
    # The leakage per unit length of a patch of the width w is k Δφ/w, where Δφ is the difference of the pressure
    # potential between inlet and outlet, divided by the reference density. `unit_leakage` is Δφ/length_x1 for k = 1 m³.
    potential_difference = scene.unit_leakage * length_x1
    products, widths = [], []  # k Δφ and w of each patch
    for columns in cut.patch_columns:
        point_count = cut.columns[columns.stop] - cut.columns[columns.start]
        width = point_count * cut.spacing[1]
        patch_k = k_x2_first[:, :, columns]
        flow = cells_in_order(scene, (width, length_x1), patch_k, boundary)
        products.append(flow.per_length * width)
        widths.append(width)
    if potential_difference == 0:
        return np.nan
    return float(np.average(products, weights=widths)) / potential_difference


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
