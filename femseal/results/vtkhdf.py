"""VTKHDF, VTK's format in HDF5: one file for all load steps, compressed, with a mesh that is stored once.

Time is the index of the load step, since loads come back on unloading; the loads are field data. Arrays of a plane
image are laid out (step, n2, n1): x1 runs fastest. Texts are in ASCII, the only kind that VTK's reader converts.
Format: VTKHDF 2.0, docs.vtk.org, "VTKHDF file format".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.files import replacing_hdf5
from .views import Grid, Image, LoadSteps

#: Suffix by which ParaView knows the files.
SUFFIX = ".vtkhdf"
_VERSION = (2, 0)
_QUAD = 9
#: Rows of an image are compressed together up to this size, so that a part can be read by itself.
_CHUNK_BYTES = 2**20
#: Level 1 of deflate: higher ones gain a few per cent at several times the time.
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def write_image(image: Image, path: Path) -> Path:
    """Write an image step by step; returns the path, whose file is whole or not there."""
    import h5py

    (n1, n2), count = image.shape, len(image.steps.index)
    chunk = (1, min(n2, max(1, _CHUNK_BYTES // (4 * n1))), n1)
    with replacing_hdf5(path) as target, h5py.File(target, "w") as file:
        root = _root(file, "ImageData")
        _plane(root, (n1, n2), image.spacing, image.origin)
        cells = root.create_group("CellData")
        for name, field in image.cells.items():
            values = cells.create_dataset(name, (count, n2, n1), np.float32, chunks=chunk, **_PACKED)
            for s in range(count):
                values[s] = field(s).T
        _write_steps(root, image.steps)
    return path


def write_heights(heights: NDArray[Any], spacing: tuple[float, float], path: Path) -> Path:
    """Write heights (n1, n2) [m] as `height_um` of points, so that the map can be warped at once."""
    import h5py

    n1, n2 = heights.shape
    with replacing_hdf5(path) as target, h5py.File(target, "w") as file:
        root = _root(file, "ImageData")
        _plane(root, (n1 - 1, n2 - 1), spacing, (spacing[0] / 2, spacing[1] / 2))
        values = (heights.T * 1e6).astype(np.float32)
        root.create_group("PointData").create_dataset("height_um", data=values, **_PACKED)
    return path


def write_grid(grid: Grid, path: Path) -> Path:
    """Write a mesh once and its data at all steps; returns the path, whose file is whole or not there."""
    import h5py

    count, points, quads = len(grid.steps.index), len(grid.points), len(grid.quads)
    with replacing_hdf5(path) as target, h5py.File(target, "w") as file:
        root = _root(file, "UnstructuredGrid")
        for name, size in (("Points", points), ("Cells", quads), ("ConnectivityIds", 4 * quads)):
            root.create_dataset(f"NumberOf{name}", data=np.array([size], np.int64))
        root.create_dataset("Points", data=grid.points, **_PACKED)
        root.create_dataset("Connectivity", data=grid.quads.ravel().astype(np.int64), **_PACKED)
        root.create_dataset("Offsets", data=np.arange(quads + 1, dtype=np.int64) * 4, **_PACKED)
        root.create_dataset("Types", data=np.full(quads, _QUAD, np.uint8))
        steps = _write_steps(root, grid.steps)
        # every step has the one and same part
        steps.create_dataset("NumberOfParts", data=np.ones(count, np.int64))
        for name in ("PartOffsets", "PointOffsets"):
            steps.create_dataset(name, data=np.zeros(count, np.int64))
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps.create_dataset(name, data=np.zeros((count, 1), np.int64))
        for kind, data in (("PointData", grid.point_data), ("CellData", grid.cell_data)):
            group, offsets = root.create_group(kind), steps.create_group(f"{kind}Offsets")
            for name, values in data.items():
                group.create_dataset(name, data=values.reshape(-1, *values.shape[2:]), **_PACKED)
                offsets.create_dataset(name, data=np.arange(count, dtype=np.int64) * values.shape[1])
    return path


def _root(file: Any, kind: str) -> Any:
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array(_VERSION, np.int64)
    root.attrs["Type"] = np.bytes_(kind)
    return root


def _plane(root: Any, pixels: tuple[int, int], spacing: tuple[float, float], origin: tuple[float, float]) -> None:
    root.attrs["WholeExtent"] = np.array([0, pixels[0], 0, pixels[1], 0, 0], np.int64)
    root.attrs["Origin"] = np.array([*origin, 0.0])
    root.attrs["Spacing"] = np.array([*spacing, 1.0])
    root.attrs["Direction"] = np.eye(3).ravel()


def _write_steps(root: Any, steps: LoadSteps) -> Any:
    """Group of the time axis, and the field data of every step."""
    import h5py

    count = len(steps.index)
    group = root.create_group("Steps")
    group.attrs["NSteps"] = count
    group.create_dataset("Values", data=steps.index.astype(np.float64))
    fields = root.create_group("FieldData")
    offsets, sizes = (group.create_group(f"FieldData{name}") for name in ("Offsets", "Sizes"))
    for name, values in steps.fields.items():
        kind = h5py.string_dtype("ascii") if isinstance(values[0], str) else np.float64
        fields.create_dataset(name, data=values, dtype=kind)
        offsets.create_dataset(name, data=np.arange(count, dtype=np.int64))
        # components and tuples
        sizes.create_dataset(name, data=np.ones((count, 2), np.int64))
    return group
