"""Coarse maps of the face for pictures: the heights, and the fields of a deterministic study, as means over blocks.

The fields over all pixels are too large for the dataset. The maps are part of it, so that a report needs nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray

    from ..studies import DeterministicResult, Scene, TwoScaleResult

Array = NDArray[np.float64]
#: Most blocks along a side, of the heights and of a field at every step.
HEIGHT_BLOCKS, FIELD_BLOCKS = 256, 128
#: Field of the study, its unit and meaning.
_FIELDS = (
    ("gap", "m", "gap, mean of each block, deterministic"),
    ("contact_pressure", "Pa", "contact pressure, mean of each block, deterministic"),
    ("fluid_pressure", "Pa", "fluid pressure, mean of the fluid of each block, NaN without any, deterministic"),
)


def add_heights(data: xarray.Dataset, scene: Scene) -> None:
    """Add the heights of the face in blocks."""
    surface = scene.surface
    _coordinates(data, ("face1", "face2"), surface.shape, surface.size, HEIGHT_BLOCKS)
    values = block_means(surface.heights, HEIGHT_BLOCKS)
    labels = {"units": "m", "long_name": "height of the face, mean of each block"}
    data["face_height"] = (("face1", "face2"), values, labels)


def add_fields(data: xarray.Dataset, scene: Scene, study: DeterministicResult | TwoScaleResult) -> None:
    """Add gap, contact pressure and fluid pressure of every step in blocks, of a study that resolves the flow."""
    by_windows = hasattr(study, "face_fluid_pressure")
    _coordinates(data, ("block1", "block2"), scene.surface.shape, scene.surface.size, FIELD_BLOCKS)
    for name, unit, text in _FIELDS:
        at_pixels = getattr(study, f"face_{name}" if by_windows and name == "fluid_pressure" else name)
        values = np.array([block_means(field, FIELD_BLOCKS) for field in at_pixels])
        text = text.replace("deterministic", "two-scale") if by_windows else text
        data[f"face_{name}"] = (("step", "block1", "block2"), values, {"units": unit, "long_name": text})


def _coordinates(
    data: xarray.Dataset, dims: tuple[str, str], shape: tuple[int, ...], size: tuple[float, float], most: int
) -> None:
    for n, (dim, count, length) in enumerate(zip(dims, shape, size, strict=True), start=1):
        blocks = min(count, most)
        labels = {"units": "m", "long_name": f"x{n} of block centres"}
        data.coords[dim] = (dim, (np.arange(blocks) + 0.5) * length / blocks, labels)


def block_means(values: NDArray[Any], most: int) -> NDArray[np.float32]:
    """Means of the values (n1, n2) over at most `most` blocks along each side, without NaN; NaN where all are.

    Where the sides are no multiples of the blocks, blocks differ by a pixel.
    """
    starts = [np.arange(min(n, most)) * n // min(n, most) for n in values.shape]

    def sums(of: NDArray[Any]) -> Array:
        return np.add.reduceat(np.add.reduceat(of, starts[0], axis=0, dtype=float), starts[1], axis=1)

    known = ~np.isnan(values)
    total, count = sums(np.where(known, values, 0.0)) if not known.all() else sums(values), sums(known)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0).astype(np.float32)
