"""Fields over all pixels of the face: gap, contact and fluid pressure, an image for each load step.

They are large, so they are not part of `results.nc`: `fields.pvd` and the images in the folder `fields` hold them once,
in single precision and compressed, for `Results.gap`, `Results.contact_pressure` and `Results.fluid_pressure` as for
ParaView.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.quantities import to_text
from . import series
from .interpolated import solved_steps
from .select import window
from .views import Field, Image, LoadSteps

if TYPE_CHECKING:
    import xarray

    from .results import Results

Array = NDArray[np.float64]
NAME = "fields"
#: Default size above which steps are left out [byte], before compression.
LIMIT = 1e9
#: Field, its study, its name in the file, the value of the file's unit in SI, unit and long name.
_FIELDS = (
    ("gap", "two_scale", "gap_um", 1e-6, "m", "gap"),
    ("contact_pressure", "two_scale", "contact_pressure_MPa", 1e6, "Pa", "contact pressure"),
    ("fluid_pressure", "two_scale", "fluid_pressure_Pa", 1.0, "Pa", "fluid pressure"),
    ("gap", "deterministic", "gap_deterministic_um", 1e-6, "m", "gap, deterministic"),
    (
        "contact_pressure",
        "deterministic",
        "contact_pressure_deterministic_MPa",
        1e6,
        "Pa",
        "contact pressure, deterministic",
    ),
    ("fluid_pressure", "deterministic", "fluid_pressure_deterministic_Pa", 1.0, "Pa", "fluid pressure, deterministic"),
)
#: The field of two scales that links do not have.
_RESOLVED_ONLY = ("fluid_pressure", "two_scale")
_BYTES = np.dtype(np.float32).itemsize


@dataclass(frozen=True)
class FieldPlan:
    """Steps of the fields that are written, and a text on those left out for their size; "" if there are none."""

    steps: NDArray[np.int64]
    left_out: str = ""


def plan_fields(results: Results, limit: float) -> FieldPlan:
    """Steps whose fields together are not larger than `limit` [byte] before compression.

    Where not all of them fit: evenly over the programme, with the highest load.
    """
    kept = [_array(results, study, field) for field, study, *_ in _FIELDS if _array(results, study, field) is not None]
    solved = solved_steps(results.dataset)
    count = solved.size
    if not kept:
        return FieldPlan(np.arange(0))
    each = sum(_BYTES * array[0].size for array in kept)
    fitting = int(min(limit // each, count))
    if fitting == count:
        return FieldPlan(solved)
    # the middles of equal parts of the programme
    chosen = ((np.arange(fitting) + 0.5) * count / max(fitting, 1)).astype(int)
    highest = int(np.argmax(results.dataset["nominal_pressure"].values[solved]))
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
    kept = [study for field, study, *_ in _FIELDS if not (links and (field, study) == _RESOLVED_ONLY)]
    return sum(_BYTES * shape[0] * shape[1] for study in kept if study in studies)


def write_fields(results: Results, plan: FieldPlan, folder: Path) -> list[Path]:
    """Write the fields of the studies in memory at the steps of a plan."""
    cells: dict[str, Field] = {}
    shape, spacing = (0, 0), (1.0, 1.0)
    for field, study, name, unit, *_ in _FIELDS:
        if (array := _array(results, study, field)) is not None:
            assert results.scene is not None
            shape, spacing = array.shape[1:], results.scene.surface.spacing
            cells[name] = _scaled(array, np.searchsorted(solved_steps(results.dataset), plan.steps), 1 / unit)
    steps = LoadSteps.of(results.dataset, plan.steps)
    return series.write(Image(NAME, spacing, (0.0, 0.0), shape, steps, cells), folder)


def _scaled(array: NDArray[Any], steps: NDArray[np.int64], factor: float) -> Field:
    return lambda n: array[steps[n]] * np.float32(factor)


def _array(results: Results, study: str, field: str) -> Any:
    # `fluid_pressure` of two scales is that of the nodes of links
    at_pixels = "face_fluid_pressure" if (field, study) == _RESOLVED_ONLY else field
    return getattr(getattr(results, study), at_pixels, None)


def read_field(results: Results, field: str, step: int, cell: tuple[int, int] | None) -> xarray.DataArray:
    """A field over the pixels of the face, or of a window, at one step, see `Results.gap`.

    It is taken from the two-scale study, or else from the deterministic one; from memory, or else from the folder.
    """
    import xarray

    data = results.dataset
    if step not in range(data.sizes["step"]):
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    for entry in _FIELDS:
        if entry[0] == field and (found := _at_step(results, entry, step, cell)) is not None:
            values, starts, spacing = found
            break
    else:
        at_hand = stored_steps(results)
        allowed = f"one of {', '.join(map(str, at_hand))}" if at_hand else f"a folder with {NAME}.pvd"
        raise InputError("step", f"{step}, which has no {field.replace('_', ' ')}", allowed)
    coordinates = {}
    for n, (start, count, d) in enumerate(zip(starts, values.shape, spacing, strict=True), start=1):
        labels = {"units": "m", "long_name": f"x{n} of pixel centres"}
        coordinates[f"x{n}"] = (f"x{n}", (start + np.arange(count) + 0.5) * d, labels)
    labels = {"units": entry[4], "long_name": f"{entry[5]}, {data['name'].values[step]}"}
    return xarray.DataArray(values, coordinates, ("x1", "x2"), field, labels)


def stored_steps(results: Results) -> list[int]:
    """Steps whose fields are in memory, or else in the results folder."""
    if any(_array(results, study, field) is not None for field, study, *_ in _FIELDS):
        return solved_steps(results.dataset).tolist()
    return [] if results.folder is None else list(series.stored(results.folder, NAME))


def _at_step(
    results: Results, entry: tuple[str, str, str, float, str, str], step: int, cell: tuple[int, int] | None
) -> tuple[Array, tuple[int, int], tuple[float, float]] | None:
    """Values in SI, the pixel with which they begin, and the pixel's size; None where there are none."""
    field, study, name, unit, *_ = entry
    if (array := _array(results, study, field)) is not None:
        assert results.scene is not None
        d1, d2 = results.scene.surface.spacing
        rows, columns = _pixels(results.dataset, cell, array.shape[1:], (d1, d2))
        solved = solved_steps(results.dataset)
        if step not in solved:
            return None
        values = array[int(np.searchsorted(solved, step)), rows, columns]
        return np.asarray(values, np.float64), (rows.start, columns.start), (d1, d2)
    path = None if results.folder is None else series.stored(results.folder, NAME).get(step)
    if path is None or (image := series.read_image(path, name)) is None:
        return None
    n1, n2 = (count - 1 for count in image.dimensions[:2])
    d1, d2 = image.spacing[:2]
    rows, columns = _pixels(results.dataset, cell, (n1, n2), (d1, d2))
    values = np.asarray(image.cell_data[name].reshape((n1, n2), order="F")[rows, columns], np.float64) * unit
    return values, (rows.start, columns.start), (d1, d2)


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
