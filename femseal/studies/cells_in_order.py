"""Flow over the cells of a surface in their own order, along either axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base import Array, Pair
from ..face.cell_flow import Failed, attempt
from ..face.cells import Cut
from ..flow.permeability_table import tabulated
from ..scene import Scene
from ..seal.leakage import Leakage
from ..seal.tiles import SealTiles, face_tiles


def cells_in_order(scene: Scene, size: Pair, k: Array, boundary: str) -> Leakage | Failed:
    """Solve the flow along the first axis over cells in their own order.

    Parameters
    ----------
    scene : the fluid and its pressures.
    size : of all cells along both axes [m].
    k : (pressures, 2, m1, m2) [m³], along the first and the second axis.
    boundary : how the cells continue along the second axis; their sides are closed unless it is "periodic".
    """
    if boundary != "periodic":  # closed sides are those of the cells and their mirror image
        k = np.concatenate([k, k[..., ::-1]], axis=-1)
        size = size[0], 2 * size[1]
    tiles = face_tiles(size, k.shape[-2:])
    return flow_in_order(scene, tiles, k, tuple(scene.flow.drop.pressures))


def cells_permeability_along_x2(scene: Scene, cut: Cut, k: Array, boundary: str) -> float:
    """Solve the flow along x2 over the cells in their own order, those of each measured patch by themselves.

    Parameters
    ----------
    scene : the fluid and its pressures.
    cut : of the surface into cells.
    k : (pressures, 2, m1, m2) [m³], along x1 and x2.
    boundary : how the surface continues along x1.

    Returns the permeability [m³], the mean over the patches weighted with their widths; NaN where the flow failed.
    """
    turned = k[:, ::-1].swapaxes(-1, -2)  # x2 first, then x1
    values, widths = [], []
    for columns in cut.patch_columns:
        width = (cut.columns[columns.stop] - cut.columns[columns.start]) * cut.spacing[1]
        size = width, scene.surface.size[0]
        flow = cells_in_order(scene, size, turned[:, :, columns], boundary)
        values.append(flow.per_length * width)
        widths.append(width)
    drop = scene.unit_leakage * scene.surface.size[0]
    return float(np.average(values, weights=widths)) / drop if drop != 0 else np.nan


def flow_in_order(
    scene: Scene, tiles: SealTiles, k: Array, pressures: Sequence[float], piecewise: bool = False
) -> Leakage | Failed:
    """Flow through the cells of a face in their own order.

    tiles : of `face_tiles`. k : (pressures, 2, m1, m2) [m³] at pressures of the fluid [Pa].
    piecewise : see `flow.PermeabilityTable`.
    """
    of_tiles = k.reshape(len(k), 2, -1)
    values = tiles.permeability(of_tiles[:, 0], of_tiles[:, 1])
    return attempt(scene.leakage, tiles.seal, tabulated(pressures, list(values), piecewise))
