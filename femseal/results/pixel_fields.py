"""Fields over all pixels of the face, such as gap, contact and fluid pressure: an image for each load step.

They are large, so they are not part of `results.nc`: `fields.pvd` and the images in the folder `fields` hold them once,
in single precision and compressed, for `Results.pixels` as for ParaView. Every field that a study declares over pixels
is one of them.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.fields import PIXEL, READABLE, Field, fields_of
from ..base.quantities import to_text
from ..base.shared_array import give_back
from . import vtk_files
from .selections import solved_steps, window

if TYPE_CHECKING:
    import xarray

    from .run_data import RunData

NAME = "fields"
#: What results without fields would need: drawn seals have none.
WITH_FIELDS = 'a run with "deterministic" or "two-scale" as method or in `compare`, with fields = true in [output]'
#: Default size above which steps are left out [byte], before compression.
LIMIT = 1e9
_BYTES = np.dtype(np.float32).itemsize
#: Endings of the names of fields: those of two scales come first.
_ENDINGS = ("", "_deterministic")


@dataclass(frozen=True)
class FieldPlan:
    """Steps of the fields that are written, and a text on those left out for their size; "" if there are none."""

    steps: NDArray[np.int64]
    left_out: str = ""


def _in_memory(run: RunData) -> Iterator[tuple[Field, Any]]:
    """Fields over all pixels (steps, n1, n2) of the studies in memory, at the steps that were solved."""
    for study in (run.two_scale, run.deterministic):
        if study is not None:
            yield from ((made, values) for made, values in fields_of(study) if made.place == PIXEL)


def plan_fields(run: RunData, limit: float) -> FieldPlan:
    """Steps whose fields together are not larger than `limit` [byte] before compression.

    Where not all of them fit: evenly over the programme, with the highest load.
    """
    each = sum(_BYTES * values[0].size for _, values in _in_memory(run))
    if not each:
        return FieldPlan(np.arange(0))
    solved = solved_steps(run.dataset)
    count = solved.size
    fitting = int(min(limit // each, count))
    if fitting == count:
        return FieldPlan(solved)
    # the middles of equal parts of the programme
    chosen = ((np.arange(fitting) + 0.5) * count / max(fitting, 1)).astype(int)
    highest = int(np.argmax(run.dataset["nominal_pressure"].values[solved]))
    if fitting and highest not in chosen:
        chosen[np.argmin(np.abs(chosen - highest))] = highest
    missing = np.setdiff1d(np.arange(count), chosen)
    numbers = ", ".join(str(n) for n in solved[missing])
    sizes = f"{to_text(each * count, 'B', 3)} of all steps are above the limit of {to_text(limit, 'B', 3)}"
    return FieldPlan(solved[np.sort(chosen)], f"fields over all pixels at steps {numbers}: {sizes} (fields_limit)")


def fields_size(shape: tuple[int, int], studies: Container[str], links: bool) -> int:
    """Size of one step of the fields of the named studies, before compression [byte].

    links : whether the flow of two scales goes through links, which have no fluid pressure at the pixels.
    """
    count = (2 if links else 3) * ("two_scale" in studies) + 3 * ("deterministic" in studies)
    return count * _BYTES * shape[0] * shape[1]


def write_fields(run: RunData, plan: FieldPlan, folder: Path) -> list[Path]:
    """Write the fields of the studies in memory at the steps of a plan."""
    assert run.scene is not None
    places = np.searchsorted(solved_steps(run.dataset), plan.steps)
    cells = {made.array_name: _scaled(values, made.scale, places) for made, values in _in_memory(run)}
    surface, steps = run.scene.surface, vtk_files.LoadSteps.of(run.dataset, plan.steps)
    image = vtk_files.Image(NAME, surface.spacing, (0.0, 0.0), surface.shape, steps, cells)
    return vtk_files.write_series(image, folder)


def _scaled(values: Any, scale: float, places: NDArray[np.int64]) -> vtk_files.PixelValues:
    def at(n: int) -> NDArray[np.float32]:
        scaled = values[places[n]] * np.float32(scale)
        give_back(values)
        return scaled

    return at


def read_pixels(run: RunData, name: str, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
    """A field over the pixels (x1, x2) at one step in SI, read from the folder where it is not in memory.

    Of the two-scale study where there is one, else of the deterministic.

    Parameters
    ----------
    name : "gap", "contact_pressure", "fluid_pressure", or another that a study has at the pixels.
    step : index of the load step.
    cell : window, between its rows of nodes; the whole face unless given.

    Raises
    ------
    InputError : no such step or window, or a step without the field: `stored_steps` lists those that have fields.
    """
    import xarray

    data = run.dataset
    if step not in range(data.sizes["step"]):
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    found = _from_memory(run, name, step) or _from_folder(run, name, step)
    if found is None:
        at_hand = stored_steps(run)
        if step in at_hand:  # the flow through links knows the pressure between windows alone
            expected = "another field; or a run with flow = 'resolved' in [cells], or \"deterministic\" in `compare`"
            raise InputError("field", f"no {name.replace('_', ' ')} at pixels of a flow through links", expected)
        expected = f"one of {', '.join(map(str, at_hand))}" if at_hand else WITH_FIELDS
        raise InputError("step", f"{step}, which has no {name.replace('_', ' ')}", expected)
    made, values, spacing = found
    rows, columns = _pixels(data, cell, values.shape, spacing)
    values = np.asarray(values[rows, columns], np.float64)
    coordinates = {}
    for n, (start, count, d) in enumerate(zip((rows.start, columns.start), values.shape, spacing, strict=True), 1):
        labels = {"units": "m", "long_name": f"x{n} of pixel centres"}
        coordinates[f"x{n}"] = (f"x{n}", (start + np.arange(count) + 0.5) * d, labels)
    labels = {"units": made.unit, "long_name": f"{made.long_name}, {data['name'].values[step]}"}
    return xarray.DataArray(values, coordinates, ("x1", "x2"), name, labels)


def stored_steps(run: RunData) -> list[int]:
    """Steps whose fields are in memory, or else in the results folder."""
    if any(True for _ in _in_memory(run)):
        return solved_steps(run.dataset).tolist()
    return [] if run.folder is None else list(vtk_files.stored_images(run.folder, NAME))


def _from_memory(run: RunData, name: str, step: int) -> tuple[Field, Any, tuple[float, float]] | None:
    """A field in SI over all pixels at a step, and the pixel's size; None where there is none."""
    places = np.flatnonzero(solved_steps(run.dataset) == step)
    there = {made.name: (made, values) for made, values in _in_memory(run)}
    for key in (name + ending for ending in _ENDINGS):
        if key in there and places.size and run.scene is not None:
            made, values = there[key]
            return made, values[int(places[0])], run.scene.surface.spacing
    return None


def _from_folder(run: RunData, name: str, step: int) -> tuple[Field, Any, tuple[float, float]] | None:
    """The same from the image in the folder, whose arrays have their unit in their names."""
    path = None if run.folder is None else vtk_files.stored_images(run.folder, NAME).get(step)
    if path is None:
        return None
    arrays = vtk_files.array_names(path)
    known = (
        Field(name + ending, unit, (name + ending).replace("_", " "), PIXEL, in_si=in_si)
        for ending in _ENDINGS
        for unit in READABLE
        for in_si in (False, True)
    )
    if (made := next((one for one in known if one.array_name in arrays), None)) is None:
        return None
    image = vtk_files.read_image(path, made.array_name)
    n1, n2 = (count - 1 for count in image.dimensions[:2])
    values = np.asarray(image.cell_data[made.array_name].reshape((n1, n2), order="F"), np.float64)
    return made, values / made.scale, tuple(image.spacing[:2])


def _pixels(
    data: xarray.Dataset, cell: tuple[int, int] | None, shape: tuple[int, ...], spacing: tuple[float, float]
) -> tuple[slice, slice]:
    """Pixels of a window along x1, between its rows of nodes, and along x2; all of them without a window."""
    if cell is None:
        return slice(0, shape[0]), slice(0, shape[1])
    i, j = window(data, *cell)
    first, last = (round(float(data["node1"][n]) / spacing[0]) for n in (i, i + 1))
    width = shape[1] // data.sizes["cell2"]
    return slice(first, last), slice(j * width, (j + 1) * width)
