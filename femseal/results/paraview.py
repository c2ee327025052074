"""Files for ParaView: the pieces of the face at every load step or state, the drawn seal, and the heights.

Each piece is a quadrilateral. Coordinates are x = x1, y = x2 in metres. Names of arrays carry the units and have no
brackets. There are no arrays of texts, because meshio cannot read them.

Fields over all pixels of the face, such as gap, contact and fluid pressure, are an image for each load step. They are
large, so they are not part of `results.nc`: `fields.pvd` and the images in the folder `fields` hold them once, in
single precision and compressed, for `Results.pixels` as for ParaView. Every field that a study declares over pixels is
one of them.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import AnyPath, Indices, InputError, Mapper, Pair, Shape, Stage, made_folder, to_text
from ..base.fields import (
    PART,
    PART_FORM,
    PART_VECTOR,
    PIECE,
    PIECE_STATE,
    PIXEL,
    READABLE,
    Field,
    Place,
    fields_of,
)
from ..base.shared_array import give_back
from ..topography import Topography
from . import vtk_files
from .selections import piece as checked_piece
from .vtk_files import Cells, Heights, LoadSteps, View, write_series

if TYPE_CHECKING:
    import xarray

    from .results import Results

NAME = "fields"
#: What results without fields would need: drawn seals have none.
WITH_FIELDS = 'a run with "deterministic" or "two-scale" as method or in `compare`, with fields = true in [output]'
_BYTES = np.dtype(np.float32).itemsize


@dataclass(frozen=True)
class FieldPlan:
    """Steps of the fields that are written, and a text on those left out for their size; "" if there are none."""

    steps: Indices
    left_out: str = ""


def _in_memory(run: Results) -> Iterator[tuple[Field, Any]]:
    """Fields over all pixels (steps, n1, n2) of a study in memory."""
    if (study := run.two_scale or run.deterministic) is not None:
        yield from (pair for pair in fields_of(study) if pair[0].place == PIXEL)


def plan_fields(run: Results, limit: float) -> FieldPlan:
    """Steps whose fields together are not larger than `limit` [byte] before compression.

    Where not all of them fit: evenly over the programme, with the highest load.
    """
    each = sum(_BYTES * values[0].size for _, values in _in_memory(run))
    if not each:
        return FieldPlan(np.arange(0))
    count = run.dataset.sizes["step"]
    fitting = int(min(limit // each, count))
    # the middles of equal parts of the programme
    chosen = ((np.arange(fitting) + 0.5) * count / max(fitting, 1)).astype(int)
    if fitting and run.peak not in chosen:
        chosen[np.argmin(np.abs(chosen - run.peak))] = run.peak
    missing, left_out = np.setdiff1d(np.arange(count), chosen), ""
    if missing.size:
        sizes = f"{to_text(each * count, 'B', 3)} of all steps are above the limit of {to_text(limit, 'B', 3)}"
        numbers = ", ".join(map(str, missing))
        left_out = f"fields over all pixels at steps {numbers}: {sizes} (fields_limit)"
    return FieldPlan(np.sort(chosen), left_out)


def fields_size(shape: Shape, studies: Container[str]) -> int:
    """Size of one step of the fields of the named studies, before compression [byte]."""
    count = 3 * ("two_scale" in studies or "deterministic" in studies)
    return count * _BYTES * shape[0] * shape[1]


def write_fields(run: Results, plan: FieldPlan, folder: Path) -> list[Path]:
    """Write the fields of the studies in memory at the steps of a plan."""
    assert run.scene is not None
    cells = {
        made.array_name: _scaled(values, made.scale, plan.steps) for made, values in _in_memory(run)
    }
    surface, steps = run.scene.surface, vtk_files.LoadSteps.of(run.dataset, plan.steps)
    image = vtk_files.Image(NAME, surface.spacing, (0.0, 0.0), surface.shape, steps, cells)
    return vtk_files.write_series(image, folder)


def _scaled(values: Any, scale: float, steps: Indices) -> vtk_files.PixelValues:
    def at(n: int) -> NDArray[np.float32]:
        scaled = values[steps[n]] * np.float32(scale)
        give_back(values)
        return scaled

    return at


def read_pixels(run: Results, name: str, step: int, piece: Shape | None = None) -> xarray.DataArray:
    """A field over the pixels (x1, x2) at one step in SI, read from the folder where it is not in memory.

    Of the two-scale study where there is one, else of the deterministic.

    Parameters
    ----------
    name : "gap", "contact_pressure", "fluid_pressure", or another that a study has at the pixels.
    step : index of the load step.
    piece : its row and column; the whole face unless given.

    Raises
    ------
    InputError : no such step or piece, or a step without the field: `stored_steps` lists those that have fields.
    """
    import xarray

    data = run.dataset
    if step not in range(data.sizes["step"]):
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    found = _from_memory(run, name, step) or _from_folder(run, name, step)
    if found is None:
        at_hand = stored_steps(run)
        expected = f"one of {', '.join(map(str, at_hand))}" if at_hand else WITH_FIELDS
        raise InputError("step", f"{step}, which has no {name.replace('_', ' ')}", expected)
    made, values, spacing = found
    rows, columns = _pixels(data, piece, values.shape)
    values = np.asarray(values[rows, columns], np.float64)
    coordinates = {}
    for name_, pixels, d in zip(("x1", "x2"), (rows, columns), spacing, strict=True):
        labels = {"units": "m", "long_name": f"{name_} of pixel centres"}
        centres = (np.arange(pixels.start, pixels.stop) + 0.5) * d
        coordinates[name_] = (name_, centres, labels)
    labels = {"units": made.unit, "long_name": f"{made.long_name}, {data['name'].values[step]}"}
    return xarray.DataArray(values, coordinates, ("x1", "x2"), name, labels)


def stored_steps(run: Results) -> list[int]:
    """Steps whose fields are in memory, or else in the results folder."""
    if any(True for _ in _in_memory(run)):
        return list(range(run.dataset.sizes["step"]))
    return [] if run.folder is None else list(vtk_files.stored_images(run.folder, NAME))


def _from_memory(run: Results, name: str, step: int) -> tuple[Field, Any, Pair] | None:
    """A field in SI over all pixels at a step, and the pixel's size; None where there is none."""
    there = {made.name: (made, values) for made, values in _in_memory(run)}
    if name not in there or run.scene is None:
        return None
    made, values = there[name]
    return made, values[step], run.scene.surface.spacing


def _from_folder(run: Results, name: str, step: int) -> tuple[Field, Any, Pair] | None:
    """The same from the image in the folder, whose arrays have their unit in their names."""
    path = None if run.folder is None else vtk_files.stored_images(run.folder, NAME).get(step)
    if path is None:
        return None
    known = {
        made.array_name: made
        for unit in READABLE
        if (made := Field(name, unit, name.replace("_", " "), PIXEL))
    }
    array, image = vtk_files.read_image(path, known)
    if array is None:
        return None
    shape = tuple(count - 1 for count in image.dimensions[:2])
    values = np.asarray(image.cell_data[array].reshape(shape, order="F"), np.float64)
    return known[array], values / known[array].scale, tuple(image.spacing[:2])


def _pixels(
    data: xarray.Dataset, piece: Shape | None, shape: tuple[int, ...]
) -> tuple[slice, slice]:
    """Pixels of a piece along x1 and x2; all of them without one."""
    if piece is None:
        return slice(0, shape[0]), slice(0, shape[1])
    i, j = checked_piece(data, *piece)
    n1, n2 = shape[0] // data.sizes["piece1"], shape[1] // data.sizes["piece2"]
    return slice(i * n1, (i + 1) * n1), slice(j * n2, (j + 1) * n2)


def write_vtk(
    run: Results, surface: Topography | None, folder: AnyPath, mapper: Mapper = map
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
    views: list[View] = [
        pieces_view(name, data, of, LoadSteps.of(data, dim=of.dims[0]))
        for name, of, field in (("pieces", PIECE, "piece_k1"), ("states", PIECE_STATE, "state_k1"))
        if field in data
    ]
    views += [drawn_cells(data)] if "drawn_corners" in data else []
    views += [] if surface is None else [Heights(surface)]
    target = made_folder(folder)
    # other processes may be at work in another folder
    stage = Stage("files for ParaView", partial(_written, target.absolute()))
    (names,) = mapper(stage, [views])
    return [target / name for name in names]


def _written(folder: Path, views: list[View]) -> list[Path]:
    """Write views into an absolute folder; returns paths relative to it."""
    return [path.relative_to(folder) for view in views for path in write_series(view, folder)]


def pieces_view(name: str, data: xarray.Dataset, place: Place, steps: LoadSteps) -> Cells:
    """Pieces of the face with every field of a place, at load steps or in states."""
    edges = []
    for dim in place.dims[1:]:
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
        if variable.dims == place.dims:
            made = Field.of(variable)
            named = made.array_name.removeprefix("piece_").removeprefix("state_")
            cell_data[named] = (variable.values * made.scale).reshape(len(steps.index), -1)
    return Cells(name, np.stack(corners, -1).reshape(-1, 4, 2), steps, cell_data)


def drawn_cells(data: xarray.Dataset) -> Cells:
    """The drawn seal nearest to the median as triangles or quadrilaterals, with every field of its parts."""
    cell_data = {}
    for variable in data.data_vars.values():
        if variable.dims in (PART.dims, PART_FORM.dims, PART_VECTOR.dims):
            made = Field.of(variable)
            values = variable.values * made.scale
            if variable.dims == PART_FORM.dims:
                values = np.broadcast_to(values, (data.sizes["step"], values.size))
            if variable.dims == PART_VECTOR.dims:
                values = np.pad(values, ((0, 0), (0, 0), (0, 1)))
            cell_data[made.array_name.removeprefix("drawn_")] = values
    return Cells("drawn", data["drawn_corners"].values, LoadSteps.of(data), cell_data)
