"""Files for ParaView: the seal at every load step, and a few windows seen closely.

The seal is a mesh of quadrilaterals, two to a window, so that both the nodes of the flow and the corners of the windows
are points of it. Coordinates are x = x1, y = x2 in metres. Time is the index of the load step, since loads come back on
unloading; the loads are field data. Arrays run x1 fastest in a file, that is `ravel(order="F")` of an array (n1, n2).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ..files import made_folder, replacing, write_text
from ..flow import cell_permeability
from ..topography import Topography

if TYPE_CHECKING:
    import xarray

    from ..studies import TwoScaleResult
    from .results import Results

Array = NDArray[np.float64]


def write_vtk(results: Results, surface: Topography | None, folder: str | os.PathLike[str]) -> list[Path]:
    """Write everything there is to see; open the `.pvd` files in ParaView.

    Parameters
    ----------
    results : of a two-scale study: `seal.pvd`, the windows of the whole seal at every step; with the study's own fields
        in memory also `window_i_j.pvd`, gap, contact pressure and fluid pressure for a unit drop in the windows with
        the largest, median and smallest k1 > 0 at the highest load. Of a deterministic study alone: `gap.pvd`.
    surface : heights, for `surface.vti` [µm]; None: not written.
    folder : made if needed. Each file is written whole or not at all, a `.pvd` after the files it names.

    Returns
    -------
    Paths of all files.

    Raises
    ------
    InputError : the folder cannot be made.
    """
    target = made_folder(folder)
    written = []
    if "k1" in results.dataset:
        written += _write_seal(results.dataset, target)
    if results.two_scale is not None:
        for i, j in chosen_windows(results.dataset):
            written += _write_window(results, results.two_scale, (i, j), target)
    elif results.deterministic is not None and "k1" not in results.dataset and surface is not None:
        images = [_image(surface.spacing, (0.0, 0.0), {"gap_um": gap * 1e6}) for gap in results.deterministic.gap]
        written += _write_series(results.dataset, images, "gap", ".vti", target)
    if surface is not None:
        # heights at points, so that the map can be warped at once
        (n1, n2), (d1, d2) = surface.shape, surface.spacing
        import pyvista

        grid = pyvista.ImageData(dimensions=(n1, n2, 1), spacing=(d1, d2, 1.0), origin=(d1 / 2, d2 / 2, 0.0))
        grid.point_data["height_um"] = (surface.heights * 1e6).astype(np.float32).ravel(order="F")
        written.append(_save(grid, target / "surface.vti"))
    return written


def chosen_windows(data: xarray.Dataset) -> list[tuple[int, int]]:
    """Windows with the largest, median and smallest k1 > 0 at the highest load at which any window is open."""
    k1, pressure = data["k1"].values, data["nominal_pressure"].values
    open_ = (np.nan_to_num(k1) > 0).any(axis=(1, 2))
    if not open_.any():
        return [(k1.shape[1] // 2, k1.shape[2] // 2)]
    step = int(np.argmax(np.where(open_, pressure, -1.0)))
    k = np.nan_to_num(k1[step]).ravel()
    order = np.flatnonzero(k > 0)[np.argsort(k[k > 0])]
    pick = dict.fromkeys(int(order[n]) for n in (-1, order.size // 2, 0))
    return [(n // k1.shape[2], n % k1.shape[2]) for n in pick]


def _write_seal(data: xarray.Dataset, folder: Path) -> list[Path]:
    import meshio
    import pyvista

    m2 = data.sizes["cell2"]
    x1, d2 = data["node1"].values, 2 * float(data["cell2"][0])
    x, y = np.meshgrid(x1, np.arange(2 * m2 + 1) * d2 / 2, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    grids = []
    for s in range(data.sizes["step"]):
        point_data = {"fluid_pressure_Pa": _at_points(data["fluid_pressure"].values[s])}
        if "k2" in data:
            k2 = np.pad(data["k2"].values[s], ((1, 1), (0, 0)), constant_values=np.nan)
            # the link from column j to j + 1 lies at their common corner, half a window beyond the node
            at_corners = np.roll(_at_points(k2)[:, :-1], 1, axis=1)
            point_data["k2_m3"] = np.concatenate([at_corners, at_corners[:, :1]], axis=1)
        cell_data = {
            "k1_m3": data["k1"].values[s],
            "contact_pressure_MPa": data["window_pressure"].values[s] / 1e6,
            "mean_gap_um": data["window_mean_gap"].values[s] * 1e6,
            "contact_share": data["window_contact_fraction"].values[s],
        }
        mesh = meshio.Mesh(
            points,
            [("quad", quads)],
            point_data={name: values.ravel() for name, values in point_data.items()},
            cell_data={name: [np.repeat(values, 2, axis=1).ravel()] for name, values in cell_data.items()}
            | {"flux_m2_per_s": [_flux(data, s).reshape(-1, 3)]},
        )
        grids.append(pyvista.from_meshio(mesh))
    return _write_series(data, grids, "seal", ".vtu", folder)


def _at_points(nodes: Array) -> Array:
    """Values (rows, m2) at nodes, mid-windows, onto the points (rows, 2 m2 + 1); between nodes their mean."""
    points = np.empty((nodes.shape[0], 2 * nodes.shape[1] + 1))
    points[:, 1::2] = nodes
    points[:, 2::2] = (nodes + np.roll(nodes, -1, axis=1)) / 2
    points[:, 0] = points[:, -1]
    return points


def _flux(data: xarray.Dataset, s: int) -> Array:
    """Flux (m1, 2 m2, 3) of half windows: of their x1-link, and the mean of the x2-links at their two corners."""
    flux = np.zeros((data.sizes["cell1"], 2 * data.sizes["cell2"], 3))
    flux[..., 0] = np.repeat(data["flux1"].values[s], 2, axis=1)
    if "flux2" in data:
        links = np.pad(data["flux2"].values[s], ((1, 1), (0, 0)))
        rows = (links[:-1] + links[1:]) / 2
        flux[:, 1::2, 1] = rows
        flux[:, 0::2, 1] = np.roll(rows, 1, axis=1)
    return flux


def _write_window(results: Results, study: TwoScaleResult, place: tuple[int, int], folder: Path) -> list[Path]:
    partition, (i, j) = study.partition, place
    (d1, d2), (w1, w2) = partition.spacing, partition.window
    images = []
    gaps, pressures = partition.cell(study.gap, i, j), partition.cell(study.contact_pressure, i, j)
    for gap, pressure in zip(gaps, pressures, strict=True):
        fields = {"gap_um": gap * 1e6, "contact_pressure_MPa": pressure / 1e6}
        # a window that failed has no gap
        known = bool(np.all(np.isfinite(gap)))
        fluid = cell_permeability(gap, partition.spacing).fluid_pressure if known else np.full(gap.shape, np.nan)
        images.append(_image((d1, d2), (i * w1 * d1, j * w2 * d2), fields | {"fluid_pressure_unit_drop": fluid}))
    return _write_series(results.dataset, images, f"window_{i:03d}_{j:03d}", ".vti", folder)


def _image(spacing: tuple[float, float], origin: tuple[float, float], fields: dict[str, Any]) -> Any:
    """Image of pixels: fields (n1, n2) as cell data."""
    import pyvista

    n1, n2 = next(iter(fields.values())).shape
    grid = pyvista.ImageData(dimensions=(n1 + 1, n2 + 1, 1), spacing=(*spacing, 1.0), origin=(*origin, 0.0))
    for name, values in fields.items():
        grid.cell_data[name] = np.asarray(values, np.float32).ravel(order="F")
    return grid


def _write_series(data: xarray.Dataset, grids: Sequence[Any], name: str, suffix: str, folder: Path) -> list[Path]:
    """One file for each step in the folder `name`, then the `.pvd` that puts them on the time axis."""
    subfolder = made_folder(folder / name)
    written = []
    for s, grid in enumerate(grids):
        grid.field_data["step_name"] = [str(data["name"].values[s])]
        grid.field_data["nominal_pressure_MPa"] = [float(data["nominal_pressure"][s]) / 1e6]
        grid.field_data["unloaded_from_MPa"] = [float(data["unloaded_from"][s]) / 1e6]
        written.append(_save(grid, subfolder / f"step_{s:04d}{suffix}"))
    lines = [
        f'    <DataSet timestep="{s}" part="0" file={quoteattr(f"{name}/{path.name}")}/>'
        for s, path in enumerate(written)
    ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    text = "\n".join([*head, *lines, "  </Collection>", "</VTKFile>", ""])
    return [*written, write_text(folder / f"{name}.pvd", text)]


def _save(grid: Any, path: Path) -> Path:
    with replacing(path) as temporary:
        grid.save(temporary)
    return path
