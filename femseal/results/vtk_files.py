"""Write results to files for ParaView, in the XML formats of VTK, which every version of ParaView opens.

Each load step has a file, and a `.pvd` file lists the files of all load steps with their times. The index of the load
step serves as the time of a file, because the same load can occur both on loading and on unloading. The nominal
pressure of the load step is stored in each file as field data.

pyvista writes the data sets with compression. Images are written as raw bytes, which take a quarter less space than
base64 text. Meshes are written in base64, because meshio 5.3 mixes up the arrays in some files that contain raw bytes.
This module writes the `.pvd` files, because pyvista does not support this format.

The coordinates are x = x1 and y = x2 in metres. The name of an array contains its unit, without brackets. The files
contain no text arrays, because meshio cannot read text arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import AnyPath, Array, Mapper, Pair, Stage, made_folder, write_bytes, write_text
from ..base.fields import CELL, CELL_STATE, TILE, TILE_FORM, TILE_VECTOR, Dimensions, Field
from ..topography import Surface

if TYPE_CHECKING:
    import xarray

    from .results import Results

#: Suffix of an image of pixels in a plane.
IMAGE = ".vti"
#: Corners of cells are merged to one point if their distance is below this fraction of the size of the mesh.
_MERGE_TOLERANCE = 1e-9
#: Compression level. Higher levels save a few per cent of space and take several times as long.
_COMPRESSION = 1

# --- data sets --------------------------------------------------------------------------------------------------


def loads_of(data: xarray.Dataset, dim: str = "step") -> Array:
    """Return the nominal pressure of each step, and the load from which the seal is unloaded, (step, 2) [Pa].

    The load from which the seal is unloaded is NaN on loading. If `dim` is "state", the rows of the array stand for the
    contact states of the face instead of the load steps.
    """
    prefix = "" if dim == "step" else f"{dim}_"
    pressures = data[f"{prefix}nominal_pressure"].values
    peaks = data[f"{prefix}unloaded_from"].values
    return np.stack([pressures, peaks], axis=1)


def with_load(mesh: Any, load: Array) -> Any:
    """Add the nominal pressure of a load step to a data set as field data, and return the data set.

    load : row of the array that `loads_of` returns [Pa].
    """
    pressure, peak = load / 1e6
    mesh.field_data["nominal_pressure_MPa"] = np.array([pressure])
    mesh.field_data["unloaded_from_MPa"] = np.array([peak])
    return mesh


def image(spacing: Pair, origin: Pair, pixels: Iterable[tuple[str, NDArray[Any]]]) -> Any:
    """Make a VTK image whose cells are the pixels of one or more fields.

    Parameters
    ----------
    spacing : size of a pixel along x1 and x2 [m].
    origin : position of the first corner of the image [m].
    pixels : name and values (x1, x2) of each field. The values are stored in single precision.
    """
    import pyvista

    data_set = pyvista.ImageData(spacing=(*spacing, 1.0), origin=(*origin, 0.0))
    for name, values in pixels:
        rows, columns = values.shape
        data_set.dimensions = (rows + 1, columns + 1, 1)
        # VTK numbers the cells along x1 first
        data_set.cell_data[name] = np.asarray(values, np.float32).ravel(order="F")
    return data_set


@dataclass(frozen=True)
class Cells:
    """Triangles or quadrilaterals in a plane, with data at all load steps.

    Attributes
    ----------
    name : name of the files, see `write_series`.
    corners : positions of the corners of each cell, (cell, 3 or 4, 2) [m].
    loads : nominal pressure of each step, and load from which the seal is unloaded (step, 2) [Pa], see `loads_of`.
    data : arrays of the data by their names, (step, cell) for scalars and (step, cell, 3) for vectors.
    """

    name: str
    corners: Array
    loads: Array
    data: Mapping[str, NDArray[Any]]

    @cached_property
    def _mesh(self) -> Any:
        """Mesh of the cells, without data. Neighbouring cells of the mesh have common corners."""
        import pyvista

        cell_count, corners_per_cell, _dimensions = self.corners.shape
        cell_type = {3: pyvista.CellType.TRIANGLE, 4: pyvista.CellType.QUAD}[corners_per_cell]
        points = np.pad(self.corners.reshape(-1, 2), ((0, 0), (0, 1)))  # z = 0
        # at first, neighbouring cells have separate corners, which are then merged
        corner_numbers = np.arange(len(points)).reshape(cell_count, corners_per_cell)
        mesh = pyvista.UnstructuredGrid({cell_type: corner_numbers}, points)
        tolerance = _MERGE_TOLERANCE * np.ptp(points)
        return mesh.clean(tolerance=tolerance, produce_merge_map=False)

    def at(self, step: int) -> Any:
        """Return the mesh with the data at a load step."""
        mesh = self._mesh.copy(deep=False)
        for name, values in self.data.items():
            mesh.cell_data[name] = values[step]
        return with_load(mesh, self.loads[step])


def _heights(surface: Surface) -> Any:
    """Make a VTK image of the heights of the face, stored as point data so that ParaView can warp the image."""
    import pyvista

    d1, d2 = surface.spacing
    data_set = pyvista.ImageData(
        dimensions=(*surface.shape, 1), spacing=(d1, d2, 1.0), origin=(d1 / 2, d2 / 2, 0.0)
    )
    heights = (surface.heights * 1e6).astype(np.float32)
    data_set.point_data["height_um"] = heights.ravel(order="F")
    return data_set


# --- files ------------------------------------------------------------------------------------------------------


def write_series(
    name: str, data_set_at: Callable[[int], Any], steps: Iterable[int], folder: Path
) -> list[Path]:
    """Write one data set per load step, and a `.pvd` file that lists them.

    Parameters
    ----------
    name : name of the subfolder with the data sets, and of the `.pvd` file.
    data_set_at : function that returns the data set of a load step.
    steps : indices of the load steps.
    folder : folder of the `.pvd` file.

    Returns
    -------
    Paths of all files. The `.pvd` file is written last, so that it never lists files that do not exist.
    """
    subfolder = made_folder(folder / name)
    paths = {step: _save(data_set_at(step), subfolder / f"step_{step:04d}") for step in steps}
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    for step, path in paths.items():
        file = escape(f"{name}/{path.name}")
        lines.append(f'    <DataSet timestep="{step}" part="0" file="{file}"/>')
    lines += ["  </Collection>", "</VTKFile>", ""]
    return [*paths.values(), write_text(folder / f"{name}.pvd", "\n".join(lines))]


def stored_images(folder: Path, name: str) -> dict[int, Path]:
    """Return the paths of a series of images, by the index of the load step."""
    paths = sorted((folder / name).glob(f"step_*{IMAGE}"))
    return {int(path.stem.removeprefix("step_")): path for path in paths}


def read_image(path: Path, names: Iterable[str]) -> tuple[str | None, Any]:
    """Read an image and one of its arrays: the first array whose name is among `names`.

    Returns
    -------
    Name of the array, and the image. The name is None if the image has no array with a name among `names`.
    """
    import pyvista

    reader = pyvista.get_reader(path)
    array = next((name for name in names if name in reader.cell_array_names), None)
    reader.disable_all_cell_arrays()
    if array is not None:
        reader.enable_cell_array(array)
    return array, reader.read()


def _save(mesh: Any, stem: Path) -> Path:
    """Write a data set to a file with the suffix of its format, and return the path."""
    import pyvista

    suffix = IMAGE if isinstance(mesh, pyvista.ImageData) else ".vtu"
    return write_bytes(stem.with_suffix(suffix), as_xml(mesh))


def as_xml(mesh: Any) -> bytes:
    """Return the content of the XML file of a data set.

    The file is built in memory, because VTK crashes when the disk is full.
    """
    import pyvista

    is_image = isinstance(mesh, pyvista.ImageData)
    writer_class = pyvista.XMLImageDataWriter if is_image else pyvista.XMLUnstructuredGridWriter
    writer = writer_class("none", mesh).writer
    writer.SetDataModeToAppended()
    writer.SetCompressionLevel(_COMPRESSION)
    writer.SetEncodeAppendedData(not is_image)
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise OSError("VTK could not write a file")
    content = writer.GetOutputString()
    # VTK returns a string instead of bytes if the content happens to be valid text
    return content if isinstance(content, bytes) else content.encode()


# --- views of results -------------------------------------------------------------------------------------------


def write_vtk(
    run: Results, surface: Surface | None, folder: AnyPath, mapper: Mapper = map
) -> list[Path]:
    """Write the results to files for ParaView, with a `.pvd` file for each of the following views.

    - `cells`: cells of the face at every load step, for a two-scale study;
    - `states`: cells of the face in every contact state, for a stochastic study;
    - `drawn`: tiles of the realisation whose leakage is nearest to the median leakage, for a stochastic study;
    - `surface`: heights of the face [µm], in a single file without `.pvd`.

    Parameters
    ----------
    run : Results
        Results of a run.
    surface : Topography or None
        Surface whose heights are written; None to leave out the view `surface`.
    folder : str or path
        Folder of the files, which is created if needed.
    mapper : callable
        Function that applies a stage to its arguments, like the builtin `map`. If the mapper uses several processes, a
        worker process writes the files, so that VTK does not block the threads of the main process.

    Returns
    -------
    list of Path
        Paths of all files.

    Raises
    ------
    InputError
        The folder cannot be created.
    """
    data = run.dataset
    views = []
    if "cell_k1" in data:
        views.append(_cells_of_face("cells", data, CELL))
    if "state_k1" in data:
        views.append(_cells_of_face("states", data, CELL_STATE))
    if "drawn_corners" in data:
        views.append(_realisation(data))
    target = made_folder(folder)
    # the path is absolute because a process may work in another folder
    stage = Stage("files for ParaView", partial(_write_views, target.absolute()))
    (names,) = mapper(stage, [views], [surface])
    return [target / name for name in names]


def _write_views(folder: Path, views: list[Cells], surface: Surface | None) -> list[Path]:
    """Write views and the heights of a surface to a folder, and return the paths of the files in the folder."""
    paths: list[Path] = []
    for view in views:
        paths += write_series(view.name, view.at, range(len(view.loads)), folder)
    if surface is not None:
        paths.append(_save(_heights(surface), folder / "surface"))
    return [path.relative_to(folder) for path in paths]


def _cells_of_face(name: str, data: xarray.Dataset, dims: Dimensions) -> Cells:
    """Return the cells of the face, with all variables of a dataset that have the dimensions `dims`.

    Parameters
    ----------
    name : name of the view, "cells" or "states".
    data : dataset of a run.
    dims : names of three dimensions: load steps or contact states, rows of cells, and columns of cells.
    """
    load_dim, row_dim, column_dim = dims
    loads = loads_of(data, load_dim)
    row_edges = _edges(data[row_dim].values)
    column_edges = _edges(data[column_dim].values)
    x1, x2 = np.meshgrid(row_edges, column_edges, indexing="ij")  # (row + 1, column + 1)
    # x1 and x2 of the four corners of each cell, counter-clockwise, (row, column, corner)
    corners = [
        np.stack([x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]], axis=-1) for x in (x1, x2)
    ]
    corners_of_cells = np.stack(corners, axis=-1).reshape(-1, 4, 2)
    cell_data: dict[str, NDArray[Any]] = {}
    for variable in data.data_vars.values():
        if variable.dims == dims:
            field = Field.from_variable(variable)
            array = field.array_name.removeprefix("cell_").removeprefix("state_")
            cell_data[array] = (variable.values * field.scale).reshape(len(loads), -1)
    return Cells(name, corners_of_cells, loads, cell_data)


def _edges(centres: Array) -> list[float]:
    """Compute the edges of adjacent cells from the centres of the cells; the first edge is at 0."""
    edges = [0.0]
    for centre in centres:
        # a centre is midway between two edges
        edges.append(2 * centre - edges[-1])
    return edges


def _realisation(data: xarray.Dataset) -> Cells:
    """Return the tiles of the realisation whose leakage is closest to the median, with all their fields."""
    step_count = data.sizes["step"]
    cell_data = {}
    for variable in data.data_vars.values():
        if variable.dims not in (TILE, TILE_FORM, TILE_VECTOR):
            continue
        field = Field.from_variable(variable)
        values = variable.values * field.scale
        if variable.dims == TILE_FORM:
            # the form is the same at every step
            values = np.broadcast_to(values, (step_count, values.size))
        if variable.dims == TILE_VECTOR:
            # (step, tile, 2) -> (step, tile, 3), with a third component of 0
            values = np.pad(values, ((0, 0), (0, 0), (0, 1)))
        cell_data[field.array_name.removeprefix("drawn_")] = values
    return Cells("drawn", data["drawn_corners"].values, loads_of(data), cell_data)
