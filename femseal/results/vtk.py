"""Files for ParaView: the seal at every load step, a few windows seen closely, and the heights.

As VTKHDF, one file for all steps, or as a series of `.vtu` and `.vti` with a `.pvd` that puts them on the time axis.
Time is the index of the load step, since loads come back on unloading; the loads are field data. Arrays run x1 fastest
in a file, that is `ravel(order="F")` of an array (n1, n2).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ..base.errors import InputError
from ..base.files import made_folder, replacing, write_text
from ..topography import Topography
from . import vtkhdf
from .views import Grid, Image, LoadSteps, seal_grid, window_images

if TYPE_CHECKING:
    from .results import Results

#: What may be written: VTKHDF for ParaView 5.13 or later, the series for any, both, or none.
FORMATS = ("vtkhdf", "vtu", "both", "none")


def write_vtk(
    results: Results, surface: Topography | None, folder: str | os.PathLike[str], format: str = "vtkhdf"
) -> list[Path]:
    """Write what there is to see; open the `.vtkhdf` or the `.pvd` files in ParaView.

    Parameters
    ----------
    results : of a two-scale study: `seal`, the windows of the whole seal at every step; with the study's own fields in
        memory also `window_i_j`, gap, contact pressure and fluid pressure in the windows with the largest, median and
        smallest k1 > 0 at the highest load.
    surface : heights, for `surface` [µm]; None: not written.
    folder : made if needed. Each file is written whole or not at all, a `.pvd` after the files it names.
    format : "vtkhdf", "vtu" (a series, the images of windows as `.vti`), "both" or "none".

    Returns
    -------
    Paths of all files.

    Raises
    ------
    InputError : the folder cannot be made, or another format.
    """
    if format not in FORMATS:
        raise InputError.of("format", format, f"one of {', '.join(FORMATS)}")
    if format == "none":
        return []
    grids = [seal_grid(results.dataset)] if "k1" in results.dataset else []
    images = window_images(results)
    target = made_folder(folder)
    written = []
    if format in ("vtkhdf", "both"):
        written += [vtkhdf.write_grid(grid, target / f"{grid.name}{vtkhdf.SUFFIX}") for grid in grids]
        written += [vtkhdf.write_image(image, target / f"{image.name}{vtkhdf.SUFFIX}") for image in images]
        if surface is not None:
            path = target / f"surface{vtkhdf.SUFFIX}"
            written.append(vtkhdf.write_heights(surface.heights, surface.spacing, path))
    if format in ("vtu", "both"):
        for grid in grids:
            written += _write_series([_mesh(grid, n) for n in grid.steps.index], grid.steps, grid.name, ".vtu", target)
        for image in images:
            pixels = [_pixels(image, n) for n in range(len(image.steps.index))]
            written += _write_series(pixels, image.steps, image.name, ".vti", target)
        if surface is not None:
            written.append(_save(_heights(surface), target / "surface.vti"))
    return written


def _mesh(grid: Grid, step: int) -> Any:
    import meshio
    import pyvista

    mesh = meshio.Mesh(
        grid.points,
        [("quad", grid.quads)],
        point_data={name: values[step] for name, values in grid.point_data.items()},
        cell_data={name: [values[step]] for name, values in grid.cell_data.items()},
    )
    return pyvista.from_meshio(mesh)


def _pixels(image: Image, step: int) -> Any:
    import pyvista

    n1, n2 = image.shape
    grid = pyvista.ImageData(dimensions=(n1 + 1, n2 + 1, 1), spacing=(*image.spacing, 1.0), origin=(*image.origin, 0.0))
    for name, field in image.cells.items():
        grid.cell_data[name] = np.asarray(field(step), np.float32).ravel(order="F")
    return grid


def _heights(surface: Topography) -> Any:
    """Heights at points, so that the map can be warped at once."""
    import pyvista

    (n1, n2), (d1, d2) = surface.shape, surface.spacing
    grid = pyvista.ImageData(dimensions=(n1, n2, 1), spacing=(d1, d2, 1.0), origin=(d1 / 2, d2 / 2, 0.0))
    grid.point_data["height_um"] = (surface.heights * 1e6).astype(np.float32).ravel(order="F")
    return grid


def _write_series(grids: Sequence[Any], steps: LoadSteps, name: str, suffix: str, folder: Path) -> list[Path]:
    """One file for each step in the folder `name`, then the `.pvd` that puts them on the time axis."""
    subfolder = made_folder(folder / name)
    written = []
    for n, (step, grid) in enumerate(zip(steps.index, grids, strict=True)):
        for field, values in steps.fields.items():
            grid.field_data[field] = [values[n]]
        written.append(_save(grid, subfolder / f"step_{step:04d}{suffix}"))
    lines = [
        f'    <DataSet timestep="{step}" part="0" file={quoteattr(f"{name}/{path.name}")}/>'
        for step, path in zip(steps.index, written, strict=True)
    ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    text = "\n".join([*head, *lines, "  </Collection>", "</VTKFile>", ""])
    return [*written, write_text(folder / f"{name}.pvd", text)]


def _save(grid: Any, path: Path) -> Path:
    with replacing(path) as temporary:
        grid.save(temporary)
    return path
