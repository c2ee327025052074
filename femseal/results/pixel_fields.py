"""Fields over all pixels of the surface, such as gap, contact and fluid pressure: read, written, exported.

They are too large for `results.nc`. Each load step has an image with all of them in the folder `fields`, in single
precision and compressed, and `fields.pvd` lists the images for ParaView; `Results.pixels` reads the same images. Every
field that a study declares over pixels is one of them. `export_field` writes one field for other programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import AnyPath, Indices, InputError, Pair, Shape, replacing, to_text, writing
from ..base.fields import PIXEL, READABLE, Field, fields_of
from ..base.machine import give_back
from . import vtk_files
from .results import checked_cell

if TYPE_CHECKING:
    import xarray

    from .results import Results

NAME = "fields"
#: What is expected in place of results without fields.
WITH_FIELDS = 'a run with "deterministic" or "two-scale" as method or in `compare`, with fields = true in [output]'
#: Fields that can be exported.
FIELDS = ("gap", "contact_pressure", "fluid_pressure")
#: Window of a field: x1 from and to, x2 from and to [m].
Window = tuple[float, float, float, float]

#: By how much a window may exceed the surface, over its size, because its ends were written as text.
_ROUNDING = 1e-6
_BYTES_PER_VALUE = np.dtype(np.float32).itemsize


class _PixelField(NamedTuple):
    """A field over the pixels at one step: its declaration, its values (x1, x2) in SI, and the pixel [m]."""

    declaration: Field
    values: Any
    spacing: Pair


def _fields_in_memory(run: Results) -> list[tuple[Field, Any]]:
    """Return the fields over all pixels of a study in memory, with their values (step, x1, x2)."""
    study = run.two_scale or run.deterministic
    if study is None:
        return []
    return [(field, values) for field, values in fields_of(study) if field.place == PIXEL]


# --- images of all fields ---------------------------------------------------------------------------------------


def plan_fields(run: Results, limit: float) -> tuple[Indices, list[str]]:
    """Choose the steps whose fields are written.

    If not all of them fit into the limit, the chosen steps are spread evenly over the load programme and contain that
    of the highest load.

    Parameters
    ----------
    run : the results.
    limit : largest size of all fields before compression [byte].

    Returns
    -------
    The steps, and a sentence on those that are left out, if any.
    """
    size_of_step = sum(_BYTES_PER_VALUE * values[0].size for _, values in _fields_in_memory(run))
    if not size_of_step:
        return np.arange(0), []
    count = run.dataset.sizes["step"]
    fitting = int(min(limit // size_of_step, count))
    # the middles of equal parts of the programme
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
    """Write the fields of the studies in memory at some steps, and return the paths of all files."""
    assert run.scene is not None
    spacing = run.scene.surface.spacing
    loads = vtk_files.loads_of(run.dataset)

    def pixels(step: int) -> Iterator[tuple[str, NDArray[np.float32]]]:
        for field, values in _fields_in_memory(run):
            yield field.array_name, values[step] * np.float32(field.scale)
            give_back(values)

    def image_at(step: int) -> Any:
        image = vtk_files.image(spacing, (0.0, 0.0), pixels(step))
        return vtk_files.with_load(image, loads[step])

    return vtk_files.write_series(NAME, image_at, steps.tolist(), folder)


def read_pixels(run: Results, name: str, step: int, cell: Shape | None = None) -> xarray.DataArray:
    """Return a field over the pixels at one step, from memory or from the folder of the results.

    It is that of the two-scale study if there is one, else of the deterministic study.

    Parameters
    ----------
    run : Results
        The results.
    name : str
        "gap", "contact_pressure", "fluid_pressure", or another field that the study has at the pixels.
    step : int
        Index of the load step.
    cell : (int, int), optional
        Row and column of a cell; the whole surface unless given.

    Returns
    -------
    xarray.DataArray
        Values (x1, x2) in SI, with coordinates [m].

    Raises
    ------
    InputError
        There is no such step or cell, or the step has no such field; `stored_steps` lists those that have fields.
    """
    import xarray

    data = run.dataset
    if step not in range(data.sizes["step"]):
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    field = _from_memory(run, name, step) or _from_folder(run, name, step)
    if field is None:
        stored = stored_steps(run)
        expected = f"one of {', '.join(map(str, stored))}" if stored else WITH_FIELDS
        raise InputError("step", f"{step}, which has no {name.replace('_', ' ')}", expected)
    coordinates = {}
    for dim, count, width in zip(("x1", "x2"), field.values.shape, field.spacing, strict=True):
        centres = (np.arange(count) + 0.5) * width
        coordinates[dim] = (dim, centres, {"units": "m", "long_name": f"{dim} of pixel centres"})
    declaration = field.declaration
    long_name = f"{declaration.long_name}, {data['name'].values[step]}"
    attrs = {"units": declaration.unit, "long_name": long_name}
    values = xarray.DataArray(field.values, coordinates, ("x1", "x2"), name, attrs)
    if cell is not None:
        i, j = checked_cell(data, *cell)
        n1 = values.sizes["x1"] // data.sizes["cell1"]
        n2 = values.sizes["x2"] // data.sizes["cell2"]
        values = values[i * n1 : (i + 1) * n1, j * n2 : (j + 1) * n2]
    return values.astype(np.float64, copy=False)


def stored_steps(run: Results) -> list[int]:
    """Return the steps whose fields over the pixels are in memory, or else in the folder of the results."""
    if _fields_in_memory(run):
        return list(range(run.dataset.sizes["step"]))
    return [] if run.folder is None else list(vtk_files.stored_images(run.folder, NAME))


def _from_memory(run: Results, name: str, step: int) -> _PixelField | None:
    """Return a field at a step of a study in memory."""
    if run.scene is None:
        return None
    for field, values in _fields_in_memory(run):
        if field.name == name:
            return _PixelField(field, values[step], run.scene.surface.spacing)
    return None


def _from_folder(run: Results, name: str, step: int) -> _PixelField | None:
    """Read a field at a step from the folder of the results."""
    images = {} if run.folder is None else vtk_files.stored_images(run.folder, NAME)
    if step not in images:
        return None
    # the name of an array contains its unit, which tells in which unit of SI the field is
    candidates = [Field(name, unit, name.replace("_", " "), PIXEL) for unit in READABLE]
    by_array_name = {field.array_name: field for field in candidates}
    array, image = vtk_files.read_image(images[step], by_array_name)
    if array is None:
        return None
    field = by_array_name[array]
    shape = tuple(count - 1 for count in image.dimensions[:2])
    values = np.asarray(image.cell_data[array].reshape(shape, order="F"), np.float64)
    return _PixelField(field, values / field.scale, tuple(image.spacing[:2]))


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
    """Write the gap, the contact pressure or the fluid pressure over the pixels for other programs.

    A file .npz has the arrays `gap` (n1, n2) [m], or a pressure by the name of its field [Pa], `spacing` [m], `origin`
    [m] of its first corner, `step`, `name` and `nominal_pressure` [Pa]; NumPy and `read_topography` read it. A file
    .vti is for ParaView.

    Parameters
    ----------
    run : Results
        The results.
    path : str or path
        The file, whose suffix chooses the format. If there are several steps, their numbers come before the suffix.
    field : str
        "gap", "contact_pressure" or "fluid_pressure"; the last one is NaN where nothing flows.
    step : int, optional
        Index of the load step; all that are stored unless given.
    cell : (int, int), optional
        Row and column of a cell; the whole surface unless given.
    window : (float, float, float, float), optional
        In place of a cell, a part of the surface: x1 from and to, x2 from and to [m]. It contains the pixels whose
        centres lie inside.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        The field or the format is unknown, there is no such step or window, the results have no fields, or a file
        cannot be written.
    """
    path = Path(path)
    if field not in FIELDS:
        raise InputError("field", repr(field), f"one of {', '.join(FIELDS)}")
    write = _FORMATS.get(path.suffix.lower())
    if write is None:
        expected = "a file .npz, from which NumPy and other programs make .tif and .x3p, or .vti"
        raise InputError("output", f"'{path.name}'", expected)
    if window is not None:
        is_rising = window[0] < window[1] and window[2] < window[3]
        if cell is not None or not is_rising:
            raise InputError("window", window, "x1 and x2 from and to [m], rising; no cell")
    steps = stored_steps(run) if step is None else [step]
    if not steps:
        raise InputError("results", f"no {field} over all pixels", WITH_FIELDS)
    written = []
    for number in steps:
        values = read_pixels(run, field, number, cell)
        if window is not None:
            values = _in_window(values, window)
        target = path if step is not None else path.with_stem(f"{path.stem}_{number:04d}")
        with writing("output", target), replacing(target) as temporary:
            write(temporary, values, run, number)
        written.append(target)
    return written


def _in_window(values: xarray.DataArray, window: Window) -> xarray.DataArray:
    """Return the pixels of a field whose centres lie in a window.

    Raises
    ------
    InputError : the window exceeds the surface, or contains no centre of a pixel.
    """
    pixel, _ = _pixel_and_corner(values)
    sides = np.multiply(values.shape, pixel)
    part = values.sel(x1=slice(*window[:2]), x2=slice(*window[2:]))
    low, high = np.reshape(window, (2, 2)).T / sides
    is_inside = (low >= -_ROUNDING).all() and (high <= 1 + _ROUNDING).all()
    if not part.size or not is_inside:
        expected = (
            f"a part of the face, x1 from 0 to {sides[0]:.9g} m, x2 from 0 to {sides[1]:.9g} m, "
            f"with the centre of a pixel of {pixel[0]:.3g} m × {pixel[1]:.3g} m"
        )
        raise InputError("window", window, expected)
    return part


def _pixel_and_corner(values: xarray.DataArray) -> tuple[Pair, Pair]:
    """Return the size of a pixel and the first corner of a field [m], along x1 and x2."""
    pixel, corner = [], []
    for dim in ("x1", "x2"):
        centres = values[dim].values.tolist()
        if len(centres) > 1:
            width = (centres[-1] - centres[0]) / (len(centres) - 1)
        else:
            width = 2 * centres[0]
        pixel.append(width)
        corner.append(centres[0] - width / 2)
    return (pixel[0], pixel[1]), (corner[0], corner[1])


def _write_npz(path: Path, values: xarray.DataArray, run: Results, step: int) -> None:
    """Write an archive of NumPy with the field, its pixel and corner, and the load."""
    pixel, corner = _pixel_and_corner(values)
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
    """Write an image for ParaView."""
    field = Field.of(values)
    pixel, corner = _pixel_and_corner(values)
    image = vtk_files.image(pixel, corner, [(field.array_name, values.values * field.scale)])
    vtk_files.with_load(image, vtk_files.loads_of(run.dataset)[step])
    path.write_bytes(vtk_files.as_xml(image))


_FORMATS: dict[str, Callable[[Path, xarray.DataArray, Results, int], None]] = {
    ".npz": _write_npz,
    ".vti": _write_vti,
}
