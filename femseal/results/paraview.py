"""Files for ParaView: the seal at every load step, a few windows seen closely, the drawn seal, and the heights.

The seal is a mesh of quadrilaterals, two to a window, so that both the nodes of the flow and the corners of the windows
are points of it. Coordinates are x = x1, y = x2 in metres. Names of arrays carry the units and have no brackets. There
are no arrays of texts, because meshio cannot read them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array
from ..base.errors import InputError
from ..base.fields import PART, PART_VECTOR, PIXEL, WINDOW, Field, fields_of
from ..base.files import made_folder
from ..topography import Topography
from .selections import solved_steps
from .vtk_files import Cells, Heights, Image, LoadSteps, View, write_hdf, write_series

if TYPE_CHECKING:
    import xarray

    from ..studies.link_flow import WindowPixels
    from .run_data import RunData

#: Formats: the series, which every ParaView opens; VTKHDF for ParaView 5.13 or later; both; or none.
FORMATS = ("vtu", "vtkhdf", "both", "none")
#: Places of the drawn seal nearer to each other than this fraction of it are one point of the mesh.
_ONE_POINT = 1e-9


def write_vtk(
    run: RunData, surface: Topography | None, folder: str | os.PathLike[str], file_format: str = "vtu"
) -> list[Path]:
    """Write the views of results; open the `.pvd` or the `.vtkhdf` files in ParaView.

    run : of a two-scale study: `seal`, the windows of the whole seal at every step, and `window_i_j`, every field at
    the pixels of single windows, see `studies.link_flow.window_pixels`; of a stochastic study: `drawn`, the seal
    nearest to the median at every step.
    surface : heights, for `surface` [µm]; None: not written.
    folder : made if needed. Each file is written whole or not at all, a `.pvd` after the files it names.
    file_format : "vtu" (series of `.vtu`, images of windows as `.vti`), "vtkhdf", "both" or "none".

    Returns paths of all files.

    Raises InputError: the folder cannot be made, or another format.
    """
    if file_format not in FORMATS:
        raise InputError("file_format", file_format, f"one of {', '.join(FORMATS)}")
    if file_format == "none":
        return []
    data = run.dataset.isel(step=solved_steps(run.dataset))
    views: list[View] = [seal_grid(data)] if "k1" in data else []
    views += [drawn_cells(data)] if "drawn_corners" in data else []
    views += [_window(window, LoadSteps.of(data)) for window in run.windows]
    views += [] if surface is None else [Heights(surface)]
    target = made_folder(folder)
    writers = [write for name, write in (("vtu", write_series), ("vtkhdf", write_hdf)) if file_format in (name, "both")]
    return [path for write in writers for view in views for path in write(view, target)]


def seal_grid(data: xarray.Dataset) -> Cells:
    """Windows of the whole seal: every field of windows, k2 and the flow, and fluid pressure and k2 at the points."""
    count, m2 = data.sizes["step"], data.sizes["cell2"]
    x, y = np.meshgrid(data["node1"].values, np.arange(2 * m2 + 1) * float(data["cell2"][0]), indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    pressure = at_points(data["fluid_pressure"].values).reshape(count, -1)
    point_data: dict[str, NDArray[Any]] = {Field.of(data["fluid_pressure"]).array_name: pressure}
    if "k2" in data:
        k2 = np.pad(data["k2"].values, ((0, 0), (1, 1), (0, 0)), constant_values=np.nan)
        # the link from column j to j + 1 lies at their common corner, half a window beyond the node
        at_corners = np.roll(at_points(k2)[..., :-1], 1, axis=-1)
        at_corners = np.concatenate([at_corners, at_corners[..., :1]], axis=-1)
        point_data[Field.of(data["k2"]).array_name] = at_corners.reshape(count, -1)
    cell_data: dict[str, NDArray[Any]] = {}
    for name, variable in data.data_vars.items():
        # the flux is one vector
        if variable.dims == WINDOW.dims and name != "flux1":
            made = Field.of(variable)
            cell_data[made.array_name] = np.repeat(variable.values * made.scale, 2, axis=2).reshape(count, -1)
    if "k2" in data:
        # of half windows: the mean of the links at their corners, of which the first and the last row have one
        rows = np.stack([k2[:, :-1], k2[:, 1:]])
        known = np.isfinite(rows)
        mean = np.where(known, rows, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
        mean[~known.any(axis=0)] = np.nan
        halves = np.stack([np.roll(mean, 1, axis=-1), mean], axis=-1)
        cell_data[Field.of(data["k2"]).array_name] = halves.reshape(count, -1)
    cell_data["flux_m2_per_s"] = _flux(data).reshape(count, -1, 3)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return Cells("seal", points, quads.reshape(-1, 4), LoadSteps.of(data), point_data, cell_data)


def at_points(nodes: Array) -> Array:
    """Values (…, rows, m2) at nodes, mid-windows, onto the points (…, rows, 2 m2 + 1); between nodes their mean."""
    points = np.empty((*nodes.shape[:-1], 2 * nodes.shape[-1] + 1))
    points[..., 1::2] = nodes
    points[..., 2::2] = (nodes + np.roll(nodes, -1, axis=-1)) / 2
    points[..., 0] = points[..., -1]
    return points


def _flux(data: xarray.Dataset) -> Array:
    """Flux (steps, m1, 2 m2, 3) of half windows: of their x1-link, and the mean of the x2-links at their corners."""
    flux = np.zeros((data.sizes["step"], data.sizes["cell1"], 2 * data.sizes["cell2"], 3))
    flux[..., 0] = np.repeat(data["flux1"].values, 2, axis=-1)
    if "flux2" in data:
        links = np.pad(data["flux2"].values, ((0, 0), (1, 1), (0, 0)))
        rows = (links[:, :-1] + links[:, 1:]) / 2
        flux[..., 1::2, 1] = rows
        flux[..., 0::2, 1] = np.roll(rows, 1, axis=-1)
    return flux


def drawn_cells(data: xarray.Dataset) -> Cells:
    """The drawn seal nearest to the median as triangles or quadrilaterals, with every field of its parts."""
    points, cells = _joined(data["drawn_corners"].values)
    cell_data = {}
    for variable in data.data_vars.values():
        if variable.dims in (PART.dims, PART_VECTOR.dims):
            made = Field.of(variable)
            values = variable.values * made.scale
            if variable.dims == PART_VECTOR.dims:
                values = np.pad(values, ((0, 0), (0, 0), (0, 1)))
            cell_data[made.array_name.removeprefix("drawn_")] = values
    return Cells("drawn", points, cells, LoadSteps.of(data), {}, cell_data)


def _joined(corners: Array) -> tuple[Array, NDArray[np.int64]]:
    """Points (n, 3) and the points of each part, from the corners of the parts, many of which are the same."""
    flat = corners.reshape(-1, 2)
    size = np.ptp(flat, axis=0).max() or 1.0
    _, first, number = np.unique(np.rint(flat / (_ONE_POINT * size)), axis=0, return_index=True, return_inverse=True)
    points = np.column_stack([flat[first], np.zeros(first.size)])
    return points, number.reshape(corners.shape[:2])


def _window(window: WindowPixels, steps: LoadSteps) -> Image:
    """A single window, with every field that it has at its pixels."""
    cells, (i, j) = {}, window.window
    for made, values in fields_of(window):
        if made.place == PIXEL:
            cells[made.array_name] = lambda n, values=values, scale=made.scale: values[n] * np.float32(scale)
    name = f"window_{i:03d}_{j:03d}"
    return Image(name, window.spacing, window.origin, window.gap.shape[1:], steps, cells)
