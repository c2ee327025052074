"""Files for ParaView: data sets of VTK in XML, which every version opens.

There is one file for each load step, and a file `.pvd` that puts them on the time axis. Time is the index of the load
step, because the same load occurs on loading and on unloading; the loads are field data.

pyvista writes the data, compressed: images as raw bytes, which take a quarter less space, and meshes in base64, because
meshio 5.3 confuses arrays of some files of raw bytes. The `.pvd` is written here, because pyvista does not write any.

Coordinates are x = x1, y = x2 in metres. Names of arrays contain the units and have no brackets. There are no arrays of
text, because meshio cannot read them.
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
from ..base.fields import CELL, CELL_STATE, PART, PART_FORM, PART_VECTOR, Field, Place
from ..topography import Surface

if TYPE_CHECKING:
    import xarray

    from .results import Results

#: Suffix of an image of pixels in a plane.
IMAGE = ".vti"
#: Corners of cells that are nearer than this fraction of the size of the mesh are merged to one point.
_MERGE_TOLERANCE = 1e-9
#: Level of compression; higher ones save a few per cent and take several times as long.
_COMPRESSION = 1

# --- data sets --------------------------------------------------------------------------------------------------


def loads_of(data: xarray.Dataset, dim: str = "step") -> Array:
    """Return nominal pressure and peak (step, 2) [Pa] of each load step, or of each state if dim is "state"."""
    prefix = "" if dim == "step" else f"{dim}_"
    pressures = data[f"{prefix}nominal_pressure"].values
    peaks = data[f"{prefix}unloaded_from"].values
    return np.stack([pressures, peaks], axis=1)


def with_load(mesh: Any, load: Array) -> Any:
    """Add nominal pressure and peak [Pa] to a data set, and return it; on loading the peak is NaN."""
    pressure, peak = load / 1e6
    mesh.field_data["nominal_pressure_MPa"] = np.array([pressure])
    mesh.field_data["unloaded_from_MPa"] = np.array([peak])
    return mesh


def image(spacing: Pair, origin: Pair, pixels: Iterable[tuple[str, NDArray[Any]]]) -> Any:
    """Return an image whose cells are the pixels of fields.

    Parameters
    ----------
    spacing : size of a pixel [m].
    origin : first corner [m].
    pixels : name and values (x1, x2) of each field; they are stored in single precision.
    """
    import pyvista

    data_set = pyvista.ImageData(spacing=(*spacing, 1.0), origin=(*origin, 0.0))
    for name, values in pixels:
        rows, columns = values.shape
        data_set.dimensions = (rows + 1, columns + 1, 1)
        # x1 runs fastest in VTK
        data_set.cell_data[name] = np.asarray(values, np.float32).ravel(order="F")
    return data_set


@dataclass(frozen=True)
class Cells:
    """Triangles or quadrilaterals in a plane, with data at all load steps.

    Attributes
    ----------
    name : of the files.
    corners : (cell, 3 or 4, 2) [m].
    loads : of the steps, see `loads_of`.
    data : arrays by name (step, cell) or (step, cell, 3).
    """

    name: str
    corners: Array
    loads: Array
    data: Mapping[str, NDArray[Any]]

    @cached_property
    def _mesh(self) -> Any:
        import pyvista

        count, corners_per_cell, _ = self.corners.shape
        kind = {3: pyvista.CellType.TRIANGLE, 4: pyvista.CellType.QUAD}[corners_per_cell]
        points = np.pad(self.corners.reshape(-1, 2), ((0, 0), (0, 1)))  # z = 0
        cells = np.arange(len(points)).reshape(count, corners_per_cell)
        mesh = pyvista.UnstructuredGrid({kind: cells}, points)
        tolerance = _MERGE_TOLERANCE * np.ptp(points)
        return mesh.clean(tolerance=tolerance, produce_merge_map=False)

    def at(self, step: int) -> Any:
        """Return the mesh with its data at a step."""
        mesh = self._mesh.copy(deep=False)
        for name, values in self.data.items():
            mesh.cell_data[name] = values[step]
        return with_load(mesh, self.loads[step])


def _heights(surface: Surface) -> Any:
    """Return the heights of the face at points, so that ParaView can warp the map."""
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
    """Write the data sets of several steps, and a file `.pvd` that lists them.

    Parameters
    ----------
    name : of the subfolder with the data sets, and of the `.pvd`.
    data_set_at : returns the data set of a step.
    steps : the steps.
    folder : of the `.pvd`.

    Returns
    -------
    Paths of all files. Each is written whole or not at all, the `.pvd` last.
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
    """Return the files of a series of images by their step."""
    paths = sorted((folder / name).glob(f"step_*{IMAGE}"))
    return {int(path.stem.removeprefix("step_")): path for path in paths}


def read_image(path: Path, names: Iterable[str]) -> tuple[str | None, Any]:
    """Read one array of an image: the first of several names that it has.

    Returns
    -------
    The name, None if it has none of them, and the image.
    """
    import pyvista

    reader = pyvista.get_reader(path)
    array = next((name for name in names if name in reader.cell_array_names), None)
    reader.disable_all_cell_arrays()
    if array is not None:
        reader.enable_cell_array(array)
    return array, reader.read()


def _save(mesh: Any, stem: Path) -> Path:
    """Write a data set, whole or not at all."""
    import pyvista

    suffix = IMAGE if isinstance(mesh, pyvista.ImageData) else ".vtu"
    return write_bytes(stem.with_suffix(suffix), as_xml(mesh))


def as_xml(mesh: Any) -> bytes:
    """Return the content of the XML file of a data set.

    It is made in memory, because VTK crashes if a disk is full.
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
    # VTK returns text if the content happens to be valid text
    return content if isinstance(content, bytes) else content.encode()


# --- views of results -------------------------------------------------------------------------------------------


def write_vtk(
    run: Results, surface: Surface | None, folder: AnyPath, mapper: Mapper = map
) -> list[Path]:
    """Write views of results; open their `.pvd` in ParaView.

    A two-scale study has the view `cells`, the cells of the face at every load. A stochastic study has the views
    `states`, the cells in every contact state of the face, and `drawn`, the realisation nearest to the median.

    Parameters
    ----------
    run : Results
        The results.
    surface : Topography or None
        Heights for the view `surface` [µm], which is not written without them.
    folder : str or path
        Created if needed.
    mapper : callable
        Computes a stage, as the builtin `map` does. With processes, one of them writes the files, so that VTK does not
        block the threads of this process.

    Returns
    -------
    list of Path
        All files. Each is written whole or not at all, a `.pvd` after the files that it lists.

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
    """Write views and heights into an absolute folder; return paths relative to it."""
    paths: list[Path] = []
    for view in views:
        paths += write_series(view.name, view.at, range(len(view.loads)), folder)
    if surface is not None:
        paths.append(_save(_heights(surface), folder / "surface"))
    return [path.relative_to(folder) for path in paths]


def _cells_of_face(name: str, data: xarray.Dataset, dims: Place) -> Cells:
    """Return the cells of the face, with every field of these dimensions."""
    loads = loads_of(data, dims[0])
    x1, x2 = np.meshgrid(*(_edges(data[dim].values) for dim in dims[1:]), indexing="ij")
    corners = [
        np.stack([x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]], axis=-1) for x in (x1, x2)
    ]
    cell_data: dict[str, NDArray[Any]] = {}
    for variable in data.data_vars.values():
        if variable.dims == dims:
            field = Field.of(variable)
            array = field.array_name.removeprefix("cell_").removeprefix("state_")
            cell_data[array] = (variable.values * field.scale).reshape(len(loads), -1)
    return Cells(name, np.stack(corners, axis=-1).reshape(-1, 4, 2), loads, cell_data)


def _edges(centres: Array) -> list[float]:
    """Return the edges of cells beside each other, which begin at 0, from their centres."""
    edges = [0.0]
    for centre in centres:
        edges.append(2 * centre - edges[-1])
    return edges


def _realisation(data: xarray.Dataset) -> Cells:
    """Return the tiles of the realisation nearest to the median, with all their fields."""
    steps = data.sizes["step"]
    cell_data = {}
    for variable in data.data_vars.values():
        if variable.dims not in (PART, PART_FORM, PART_VECTOR):
            continue
        field = Field.of(variable)
        values = variable.values * field.scale
        if variable.dims == PART_FORM:  # the same at every step
            values = np.broadcast_to(values, (steps, values.size))
        if variable.dims == PART_VECTOR:
            values = np.pad(values, ((0, 0), (0, 0), (0, 1)))  # z = 0
        cell_data[field.array_name.removeprefix("drawn_")] = values
    return Cells("drawn", data["drawn_corners"].values, loads_of(data), cell_data)
