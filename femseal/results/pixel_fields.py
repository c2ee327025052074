"""Read, write and export fields over all pixels of the surface, such as gap, contact pressure and fluid pressure.

Fields over all pixels are too large for `results.nc`. The folder `fields` contains a compressed image for each load
step. An image contains all fields that the studies declare over pixels, in single precision. The file `fields.pvd`
lists the images for ParaView. The method `Results.pixels` reads a field from an image, and `export_field` writes a
field to a file that other programs can read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import AnyPath, Indices, InputError, Pair, Shape, replacing, to_text, writing
from ..base.fields import PIXEL, READABLE, Field, fields_of
from ..base.shared_arrays import give_back
from ..studies.study_list import STUDIES, names_with
from . import vtk_files
from .results import checked_cell

if TYPE_CHECKING:
    import xarray

    from .results import Results

SERIES_NAME = "fields"
#: Text for error messages that says which runs store fields over the pixels.
WITH_FIELDS = (
    f"a run with {names_with('has_pixel_fields', quote=chr(34))} as method or in `compare`, "
    "with fields = true in [output]"
)
#: Fields that can be exported.
EXPORTED_FIELDS = ("gap", "contact_pressure", "fluid_pressure")
#: Rectangle of a surface: first and last x1, first and last x2 [m].
Window = tuple[float, float, float, float]

#: Fraction of the surface by which a window may exceed it. The ends of a window can be numbers rounded to text.
_ROUNDING = 1e-6
_BYTES_PER_VALUE = np.dtype(np.float32).itemsize


def _fields_in_memory(run: Results) -> list[tuple[Field, Any]]:
    """Return the declaration and the values (step, x1, x2) of each pixel field of a study in memory, if any."""
    studies = [study for study in STUDIES.values() if study.has_pixel_fields]
    results = [run.studies[study.key] for study in studies if study.key in run.studies]
    if not results:
        return []
    return [
        (field, values) for field, values in fields_of(results[-1]) if field.dimensions == PIXEL
    ]


# --- images of all fields ---------------------------------------------------------------------------------------


def plan_fields(run: Results, limit: float) -> tuple[Indices, list[str]]:
    """Choose the load steps whose pixel fields are written.

    If the fields of all steps together exceed `limit`, a subset of steps is chosen. It is spread evenly over the load
    programme and includes the step with the highest load.

    Parameters
    ----------
    run : results with a study in memory.
    limit : largest total size of the fields before compression [byte].

    Returns
    -------
    Indices of the chosen steps, and a list of sentences for the log. If steps are left out, the list contains one
    sentence that names them; otherwise it is empty.
    """
    size_of_step = sum(_BYTES_PER_VALUE * values[0].size for _, values in _fields_in_memory(run))
    if not size_of_step:
        return np.arange(0), []
    count = run.dataset.sizes["step"]
    fitting = int(min(limit // size_of_step, count))
    # divide the load programme into `fitting` equal parts, and choose the step in the middle of each part
    chosen = ((np.arange(fitting) + 0.5) * count / max(fitting, 1)).astype(int)
    if fitting and run.peak not in chosen:
        nearest = np.argmin(np.abs(chosen - run.peak))
        chosen[nearest] = run.peak
    missing = np.setdiff1d(np.arange(count), chosen)
    if not missing.size:
        return np.sort(chosen), []
    steps = ", ".join(map(str, missing))
    sizes = (
        f"{to_text(size_of_step * count, 'B', 3)} of all steps are above the limit of "
        f"{to_text(limit, 'B', 3)}"
    )
    return np.sort(chosen), [f"fields over all pixels at steps {steps}: {sizes} (fields_limit)"]


def write_fields(run: Results, steps: Indices, folder: Path) -> list[Path]:
    """Write the pixel fields of a study in memory for some load steps, and return the paths of all files."""
    assert run.scene is not None
    spacing = run.scene.surface.spacing
    loads = vtk_files.loads_of(run.dataset)

    def pixels(step: int) -> Iterator[tuple[str, NDArray[np.float32]]]:
        """Yield the name of the array and the values (x1, x2) of each field, in the unit of the array."""
        for field, values in _fields_in_memory(run):
            yield field.array_name, values[step] * np.float32(field.scale)
            give_back(values)

    def image_at(step: int) -> Any:
        image = vtk_files.image(spacing, (0.0, 0.0), pixels(step))
        return vtk_files.with_load(image, loads[step])

    return vtk_files.write_series(SERIES_NAME, image_at, steps.tolist(), folder)


def read_pixels(run: Results, name: str, step: int, cell: Shape | None = None) -> xarray.DataArray:
    """Return a pixel field at one load step, from memory or from the folder of the results.

    If several studies have solved the surface, the field is taken from the last one.

    Parameters
    ----------
    run : Results
        Results of a run.
    name : str
        Name of the field: "gap", "contact_pressure", "fluid_pressure", or another pixel field that a study
        computes.
    step : int
        Index of the load step.
    cell : (int, int), optional
        Row and column of a cell, to return the field over this cell only; by default the whole surface.

    Returns
    -------
    xarray.DataArray
        Values (x1, x2) in SI units, with the positions of the pixel centres [m] as coordinates.

    Raises
    ------
    InputError
        The step or the cell does not exist, or the field was not stored at this step. `stored_steps` lists the steps
        with fields.
    """
    data = run.dataset
    if step not in range(data.sizes["step"]):
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    values = _from_memory(run, name, step)
    if values is None:
        values = _from_folder(run, name, step)
    if values is None:
        stored = stored_steps(run)
        expected = f"one of {', '.join(map(str, stored))}" if stored else WITH_FIELDS
        raise InputError("step", f"{step}, which has no {name.replace('_', ' ')}", expected)
    values.attrs["long_name"] += f", {data['name'].values[step]}"
    if cell is not None:
        row, column = checked_cell(data, *cell)
        # pixels of a cell along x1 and x2
        n1 = values.sizes["x1"] // data.sizes["cell1"]
        n2 = values.sizes["x2"] // data.sizes["cell2"]
        values = values[row * n1 : (row + 1) * n1, column * n2 : (column + 1) * n2]
    return values.astype(np.float64, copy=False)


def stored_steps(run: Results) -> list[int]:
    """Return the indices of the steps whose pixel fields are in memory or in the results folder."""
    if _fields_in_memory(run):
        return list(range(run.dataset.sizes["step"]))
    return [] if run.folder is None else list(vtk_files.stored_images(run.folder, SERIES_NAME))


def _from_memory(run: Results, name: str, step: int) -> xarray.DataArray | None:
    """Return a field at a load step from a study in memory, or None if no such study has it."""
    if run.scene is None:
        return None
    for field, values in _fields_in_memory(run):
        if field.name == name:
            return _at_pixels(field, values[step], run.scene.surface.spacing)
    return None


def _from_folder(run: Results, name: str, step: int) -> xarray.DataArray | None:
    """Read a field at a load step from the results folder, or return None if the folder lacks the field."""
    images = {} if run.folder is None else vtk_files.stored_images(run.folder, SERIES_NAME)
    if step not in images:
        return None
    # The name of an array in the image consists of the name and the unit of the field. As the unit is not known here,
    # the names with all possible units are tried.
    candidates = [Field(name, unit, name.replace("_", " "), PIXEL) for unit in READABLE]
    by_array_name = {field.array_name: field for field in candidates}
    array, image = vtk_files.read_image(images[step], by_array_name)
    if array is None:
        return None
    field = by_array_name[array]
    # the dimensions of a VTK image count corners; along each side, there is one more corner than there are pixels
    shape = tuple(count - 1 for count in image.dimensions[:2])
    values = np.asarray(image.cell_data[array].reshape(shape, order="F"), np.float64)
    return _at_pixels(field, values / field.scale, image.spacing[:2])


def _at_pixels(field: Field, values: Any, spacing: Pair) -> xarray.DataArray:
    """Return the values (x1, x2) of a field in SI units, with the positions of the pixel centres as coordinates."""
    import xarray

    coordinates = {}
    for dim, count, width in zip(("x1", "x2"), values.shape, spacing, strict=True):
        centres = (np.arange(count) + 0.5) * width
        coordinates[dim] = (dim, centres, {"units": "m", "long_name": f"{dim} of pixel centres"})
    attrs = {"units": field.unit, "long_name": field.long_name}
    return xarray.DataArray(values, coordinates, ("x1", "x2"), field.name, attrs)


# --- one field for other programs -------------------------------------------------------------------------------


def export_field(
    run: Results,
    path: AnyPath,
    *,
    field: str = "gap",
    step: int | None = None,
    cell: Shape | None = None,
    window: Window | None = None,
) -> list[Path]:
    """Write the gap, the contact pressure or the fluid pressure over the pixels to files that other programs can read.

    The file is either an image for ParaView (.vti) or a NumPy archive (.npz), which `read_topography` also reads. The
    archive contains

    - the field under its name: `gap` [m], `contact_pressure` [Pa] or `fluid_pressure` [Pa], each (n1, n2);
    - `spacing`, the size of a pixel along x1 and x2 [m];
    - `origin`, the position of the first corner of the field [m];
    - `step`, `name` and `nominal_pressure` [Pa] of the load step.

    Parameters
    ----------
    run : Results
        Results of a run.
    path : str or path
        Path of the file, whose suffix determines the format. If `step` is not given, a file is written for each load
        step, and the index of the load step is added to the name of the file.
    field : str
        "gap", "contact_pressure" or "fluid_pressure". The fluid pressure is NaN where nothing flows.
    step : int, optional
        Index of the load step; by default all steps whose fields are stored.
    cell : (int, int), optional
        Row and column of a cell, to export the field over this cell only; by default the whole surface.
    window : (float, float, float, float), optional
        Rectangle of the surface to export, instead of a cell: first and last x1, first and last x2 [m]. A pixel is
        exported if its centre lies inside the rectangle.

    Returns
    -------
    list of Path
        Paths of the files.

    Raises
    ------
    InputError
        The field or the format is unknown, or the step, the cell or the window does not exist. InputError is also
        raised if the results have no pixel fields, or if a file cannot be written.
    """
    path = Path(path)
    if field not in EXPORTED_FIELDS:
        raise InputError("field", repr(field), f"one of {', '.join(EXPORTED_FIELDS)}")
    write = _FORMATS.get(path.suffix.lower())
    if write is None:
        expected = "a file .npz, from which NumPy and other programs make .tif and .x3p, or .vti"
        raise InputError("output", f"'{path.name}'", expected)
    if window is not None:
        is_rising = window[0] < window[1] and window[2] < window[3]
        if cell is not None or not is_rising:
            expected = "first and last x1, first and last x2 [m] in increasing order, and no `cell`"
            raise InputError("window", window, expected)
    steps = stored_steps(run) if step is None else [step]
    if not steps:
        raise InputError("results", f"results without the {field} over all pixels", WITH_FIELDS)
    targets = []
    for step_index in steps:
        values = read_pixels(run, field, step_index, cell)
        if window is not None:
            values = _in_window(values, window)
        target = path if step is not None else path.with_stem(f"{path.stem}_{step_index:04d}")
        with writing("output", target), replacing(target) as temporary:
            write(temporary, values, run, step_index)
        targets.append(target)
    return targets


def _in_window(values: xarray.DataArray, window: Window) -> xarray.DataArray:
    """Return the pixels of a field whose centres lie in a window.

    Raises
    ------
    InputError : the window exceeds the surface, or contains no pixel centre.
    """
    pixel, _corner = pixel_and_corner(values)
    sides = np.multiply(values.shape, pixel)
    part = values.sel(x1=slice(*window[:2]), x2=slice(*window[2:]))
    # first and last end of the window along (x1, x2), as fractions of the sides of the surface
    low, high = np.reshape(window, (2, 2)).T / sides
    is_inside = (low >= -_ROUNDING).all() and (high <= 1 + _ROUNDING).all()
    if not part.size or not is_inside:
        expected = (
            f"a part of the face, x1 from 0 to {sides[0]:.9g} m, x2 from 0 to {sides[1]:.9g} m, "
            f"with the centre of a pixel of {pixel[0]:.3g} m × {pixel[1]:.3g} m"
        )
        raise InputError("window", window, expected)
    return part


def pixel_and_corner(values: xarray.DataArray) -> tuple[Pair, Pair]:
    """Return the size of a pixel and the position of the first corner of a field, along x1 and x2 [m]."""
    pixel, corner = [], []
    for dim in ("x1", "x2"):
        centres = values[dim].values.tolist()
        if len(centres) > 1:
            width = (centres[-1] - centres[0]) / (len(centres) - 1)
        else:
            width = 2 * centres[0]  # a single pixel begins at 0
        pixel.append(width)
        corner.append(centres[0] - width / 2)
    return (pixel[0], pixel[1]), (corner[0], corner[1])


def _write_npz(path: Path, values: xarray.DataArray, run: Results, step: int) -> None:
    """Write a field to a NumPy archive, with its pixel size, its first corner and its load."""
    pixel, corner = pixel_and_corner(values)
    load = run.steps[step]
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **{str(values.name): values.values},
            step=step,
            name=load.name,
            nominal_pressure=load.pressure,
            spacing=pixel,
            origin=corner,
        )


def _write_vti(path: Path, values: xarray.DataArray, run: Results, step: int) -> None:
    """Write a field to an image for ParaView."""
    field = Field.from_variable(values)
    pixel, corner = pixel_and_corner(values)
    image = vtk_files.image(pixel, corner, [(field.array_name, values.values * field.scale)])
    vtk_files.with_load(image, vtk_files.loads_of(run.dataset)[step])
    path.write_bytes(vtk_files.as_xml(image))


#: Function that writes a field, by the suffix of the file.
_FORMATS: dict[str, Callable[[Path, xarray.DataArray, Results, int], None]] = {
    ".npz": _write_npz,
    ".vti": _write_vti,
}
