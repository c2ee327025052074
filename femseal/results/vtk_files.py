"""Data as VTK has it, and its files in XML, which every ParaView opens.

Time is the index of the load step, since the same load occurs on loading and on unloading; the loads are field data.
There is one file for each load step, and a `.pvd` that puts them on the time axis. pyvista writes the data, compressed:
images as raw bytes, which take a quarter less space, meshes in base64, because meshio 5.3 mixes up the arrays of some
files of raw bytes. pyvista writes no `.pvd`, so its few lines are written here.

Each piece is a quadrilateral. Coordinates are x = x1, y = x2 in metres. Names of arrays carry the units and have no
brackets. There are no arrays of texts, because meshio cannot read them.
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
from ..base.fields import PART, PART_FORM, PART_VECTOR, PIECE, PIECE_STATE, Field, Place
from ..topography import Surface

if TYPE_CHECKING:
    import xarray

    from .results import Results

#: Ending of an image of pixels in a plane.
IMAGE = ".vti"
#: Corners nearer to each other than this fraction of its length are one point of it.
_ONE_POINT = 1e-9
#: Of deflate: higher levels gain a few per cent at several times the time.
_LEVEL = 1


def loads_of(data: xarray.Dataset, dim: str = "step") -> Array:
    """Loads of the steps of a dataset, or of the states of its face by `dim`, and the peaks before (steps, 2) [Pa]."""
    prefix = "" if dim == "step" else f"{dim}_"
    loads = (data[f"{prefix}{name}"].values for name in ("nominal_pressure", "unloaded_from"))
    return np.stack([*loads], axis=1)


def with_load(mesh: Any, load: Array) -> Any:
    """A data set with its load; on loading the peak is NaN."""
    for name, value in zip(("nominal_pressure_MPa", "unloaded_from_MPa"), load / 1e6, strict=True):
        mesh.field_data[name] = np.array([value])
    return mesh


def image(spacing: Pair, origin: Pair, pixels: Iterable[tuple[str, NDArray[Any]]]) -> Any:
    """Image data whose cells are the pixels of fields (n1, n2), in single precision; x1 runs fastest in VTK."""
    import pyvista

    made = pyvista.ImageData(spacing=(*spacing, 1.0), origin=(*origin, 0.0))
    for name, values in pixels:
        made.dimensions = (values.shape[0] + 1, values.shape[1] + 1, 1)
        made.cell_data[name] = np.asarray(values, np.float32).ravel(order="F")
    return made


@dataclass(frozen=True)
class Cells:
    """Triangles or quadrilaterals by their corners (cells, 3 or 4, 2), with `data` (steps, cells[, 3]) at all steps.

    loads : of the steps, see `loads_of`.
    """

    name: str
    corners: Array
    loads: Array
    data: Mapping[str, NDArray[Any]]

    @cached_property
    def _mesh(self) -> Any:
        import pyvista

        kind = {3: pyvista.CellType.TRIANGLE, 4: pyvista.CellType.QUAD}[self.corners.shape[1]]
        points = np.pad(self.corners.reshape(-1, 2), ((0, 0), (0, 1)))
        cells = np.arange(len(points)).reshape(self.corners.shape[:2])
        mesh = pyvista.UnstructuredGrid({kind: cells}, points)
        return mesh.clean(tolerance=_ONE_POINT * np.ptp(points), produce_merge_map=False)

    def at(self, step: int) -> Any:
        """The mesh, which all steps share, with its data."""
        mesh = self._mesh.copy(deep=False)
        for name, values in self.data.items():
            mesh.cell_data[name] = values[step]
        return with_load(mesh, self.loads[step])


def _heights(surface: Surface) -> Any:
    """Heights of the face as points, so that the map can be warped at once."""
    import pyvista

    d1, d2 = surface.spacing
    first = d1 / 2, d2 / 2, 0.0
    made = pyvista.ImageData(dimensions=(*surface.shape, 1), spacing=(d1, d2, 1.0), origin=first)
    made.point_data["height_um"] = (surface.heights * 1e6).astype(np.float32).ravel(order="F")
    return made


def write_series(
    name: str, at: Callable[[int], Any], steps: Iterable[int], folder: Path
) -> list[Path]:
    """Write the data sets of steps as XML: `name.pvd` after the files that it names in the folder `name`.

    Returns paths of all files, each of which is whole or not there.
    """
    subfolder = made_folder(folder / name)
    written = {step: _save(at(step), subfolder / f"step_{step:04d}") for step in steps}
    lines = [
        f'    <DataSet timestep="{step}" part="0" file="{escape(f"{name}/{path.name}")}"/>'
        for step, path in written.items()
    ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    text = "\n".join([*head, *lines, "  </Collection>", "</VTKFile>", ""])
    return [*written.values(), write_text(folder / f"{name}.pvd", text)]


def stored_images(folder: Path, name: str) -> dict[int, Path]:
    """Files of a series of images by their step."""
    return {
        int(path.stem.removeprefix("step_")): path
        for path in sorted((folder / name).glob(f"step_*{IMAGE}"))
    }


def read_image(path: Path, wanted: Iterable[str]) -> tuple[str | None, Any]:
    """An image with the first of the wanted arrays of cells that it has, and the name of that; None without one."""
    import pyvista

    reader = pyvista.get_reader(path)
    array = next((name for name in wanted if name in reader.cell_array_names), None)
    reader.disable_all_cell_arrays()
    if array is not None:
        reader.enable_cell_array(array)
    return array, reader.read()


def _save(mesh: Any, stem: Path) -> Path:
    """Write a data set of pyvista as XML, whole or not at all."""
    import pyvista

    path = stem.with_suffix(IMAGE if isinstance(mesh, pyvista.ImageData) else ".vtu")
    return write_bytes(path, as_xml(mesh))


def as_xml(mesh: Any) -> bytes:
    """The file of a data set of pyvista as XML."""
    import pyvista

    image = isinstance(mesh, pyvista.ImageData)
    # VTK crashes where a disk is full, so it writes into memory
    kind = pyvista.XMLImageDataWriter if image else pyvista.XMLUnstructuredGridWriter
    writer = kind("none", mesh).writer
    writer.SetDataModeToAppended()
    writer.SetCompressionLevel(_LEVEL)
    writer.SetEncodeAppendedData(not image)
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise OSError("VTK could not write a file")
    content = writer.GetOutputString()
    # VTK returns text instead of bytes where the content is valid text
    return content if isinstance(content, bytes) else content.encode()


def write_vtk(
    run: Results, surface: Surface | None, folder: AnyPath, mapper: Mapper = map
) -> list[Path]:
    """Write the views of results; open the `.pvd` files in ParaView.

    run : of a two-scale study: `pieces`, those of the face at every step; of a stochastic study: `states`, the pieces
    in every state of the face, and `drawn`, the seal nearest to the median at every step.
    surface : heights, for `surface` [µm]; None: not written.
    folder : made if needed. Each file is written whole or not at all, a `.pvd` after the files it names.
    mapper : such as over processes of this machine, one of which writes them: VTK lets no other thread work.

    Returns paths of all files.

    Raises InputError: the folder cannot be made.
    """
    data = run.dataset
    views = [
        _pieces(name, data, of)
        for name, of, field in (("pieces", PIECE, "piece_k1"), ("states", PIECE_STATE, "state_k1"))
        if field in data
    ]
    views += [_drawn(data)] if "drawn_corners" in data else []
    target = made_folder(folder)
    # other processes may be at work in another folder
    stage = Stage("files for ParaView", partial(_written, target.absolute()))
    (names,) = mapper(stage, [views], [surface])
    return [target / name for name in names]


def _written(folder: Path, views: list[Cells], surface: Surface | None) -> list[Path]:
    """Write views and heights into an absolute folder; returns paths relative to it."""
    written: list[Path] = []
    for view in views:
        written += write_series(view.name, view.at, range(len(view.loads)), folder)
    if surface is not None:
        written.append(_save(_heights(surface), folder / "surface"))
    return [path.relative_to(folder) for path in written]


def _pieces(name: str, data: xarray.Dataset, place: Place) -> Cells:
    """Pieces of the face with every field of a place, at load steps or in states."""
    loads = loads_of(data, place[0])
    edges = []
    for dim in place[1:]:
        ends = [0.0]
        for centre in data[dim].values:
            ends.append(2 * centre - ends[-1])
        edges.append(ends)
    corners = [
        np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], -1)
        for at in np.meshgrid(*edges, indexing="ij")
    ]
    cell_data: dict[str, NDArray[Any]] = {}
    for variable in data.data_vars.values():
        if variable.dims == place:
            made = Field.of(variable)
            named = made.array_name.removeprefix("piece_").removeprefix("state_")
            cell_data[named] = (variable.values * made.scale).reshape(len(loads), -1)
    return Cells(name, np.stack(corners, -1).reshape(-1, 4, 2), loads, cell_data)


def _drawn(data: xarray.Dataset) -> Cells:
    """The drawn seal nearest to the median as triangles or quadrilaterals, with every field of its parts."""
    cell_data = {}
    for variable in data.data_vars.values():
        if variable.dims in (PART, PART_FORM, PART_VECTOR):
            made = Field.of(variable)
            values = variable.values * made.scale
            if variable.dims == PART_FORM:
                values = np.broadcast_to(values, (data.sizes["step"], values.size))
            if variable.dims == PART_VECTOR:
                values = np.pad(values, ((0, 0), (0, 0), (0, 1)))
            cell_data[made.array_name.removeprefix("drawn_")] = values
    return Cells("drawn", data["drawn_corners"].values, loads_of(data), cell_data)
