"""Fields over all pixels of the face, such as gap, contact and fluid pressure: read, written, exported.

They are an image for each load step. They are large, so they are not part of `results.nc`: `fields.pvd` and the images
in the folder `fields` hold them once, in single precision and compressed, for `Results.pixels` as for ParaView. Every
field that a study declares over pixels is one of them. `export_field` writes one for other programs, with the size of
its pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import AnyPath, Indices, InputError, Pair, Shape, replacing, to_text, writing
from ..base.fields import PIXEL, READABLE, Field, fields_of
from ..base.machine import give_back
from . import vtk_files
from .results import piece as checked_piece

if TYPE_CHECKING:
    import xarray

    from .results import Results

NAME = "fields"
#: What results without fields would need: drawn seals have none.
WITH_FIELDS = 'a run with "deterministic" or "two-scale" as method or in `compare`, with fields = true in [output]'
FIELDS = ("gap", "contact_pressure", "fluid_pressure")
#: By which a window may lie beyond a face, over its size: ends are texts.
_ROUNDING = 1e-6
_BYTES = np.dtype(np.float32).itemsize


def _in_memory(run: Results) -> list[tuple[Field, Any]]:
    """Fields over all pixels (steps, n1, n2) of a study in memory."""
    study = run.two_scale or run.deterministic
    return [pair for pair in fields_of(study) if pair[0].place == PIXEL] if study else []


def plan_fields(run: Results, limit: float) -> tuple[Indices, list[str]]:
    """Steps whose fields together are not larger than `limit` [byte] before compression, and a text on the others.

    Where not all of them fit: evenly over the programme, with the highest load.
    """
    each = sum(_BYTES * values[0].size for _, values in _in_memory(run))
    if not each:
        return np.arange(0), []
    count = run.dataset.sizes["step"]
    fitting = int(min(limit // each, count))
    # the middles of equal parts of the programme
    chosen = ((np.arange(fitting) + 0.5) * count / max(fitting, 1)).astype(int)
    if fitting and run.peak not in chosen:
        chosen[np.argmin(np.abs(chosen - run.peak))] = run.peak
    missing = np.setdiff1d(np.arange(count), chosen)
    sizes = f"{to_text(each * count, 'B', 3)} of all steps are above the limit of {to_text(limit, 'B', 3)}"
    text = f"fields over all pixels at steps {', '.join(map(str, missing))}: {sizes} (fields_limit)"
    return np.sort(chosen), [text] if missing.size else []


def write_fields(run: Results, chosen: Indices, folder: Path) -> list[Path]:
    """Write the fields of the studies in memory at some steps."""
    assert run.scene is not None
    spacing, loads = run.scene.surface.spacing, vtk_files.loads_of(run.dataset)

    def pixels(step: int) -> Iterator[tuple[str, NDArray[np.float32]]]:
        for made, values in _in_memory(run):
            yield made.array_name, values[step] * np.float32(made.scale)
            give_back(values)

    def at(step: int) -> Any:
        image = vtk_files.image(spacing, (0.0, 0.0), pixels(step))
        return vtk_files.with_load(image, loads[step])

    return vtk_files.write_series(NAME, at, chosen.tolist(), folder)


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
    in_memory = {made.name: (made, values) for made, values in _in_memory(run)}
    if name in in_memory and run.scene is not None:
        made, values = in_memory[name]
        values, spacing = values[step], run.scene.surface.spacing
    elif (found := _from_folder(run, name, step)) is not None:
        made, values, spacing = found
    else:
        at_hand = stored_steps(run)
        expected = f"one of {', '.join(map(str, at_hand))}" if at_hand else WITH_FIELDS
        raise InputError("step", f"{step}, which has no {name.replace('_', ' ')}", expected)
    coordinates = {
        x: (x, (np.arange(n) + 0.5) * d, {"units": "m", "long_name": f"{x} of pixel centres"})
        for x, n, d in zip(("x1", "x2"), values.shape, spacing, strict=True)
    }
    labels = {"units": made.unit, "long_name": f"{made.long_name}, {data['name'].values[step]}"}
    face = xarray.DataArray(values, coordinates, ("x1", "x2"), name, labels)
    if piece is not None:
        i, j = checked_piece(data, *piece)
        n1, n2 = face.sizes["x1"] // data.sizes["piece1"], face.sizes["x2"] // data.sizes["piece2"]
        face = face[i * n1 : (i + 1) * n1, j * n2 : (j + 1) * n2]
    return face.astype(np.float64, copy=False)


def stored_steps(run: Results) -> list[int]:
    """Steps whose fields are in memory, or else in the results folder."""
    if _in_memory(run):
        return list(range(run.dataset.sizes["step"]))
    return [] if run.folder is None else list(vtk_files.stored_images(run.folder, NAME))


def _from_folder(run: Results, name: str, step: int) -> tuple[Field, Any, Pair] | None:
    """A field over all pixels at a step from the folder, where arrays have their unit in their names, and the pixel."""
    path = None if run.folder is None else vtk_files.stored_images(run.folder, NAME).get(step)
    if path is None:
        return None
    text = name.replace("_", " ")
    fields = (Field(name, unit, text, PIXEL) for unit in READABLE)
    known = {made.array_name: made for made in fields}
    array, image = vtk_files.read_image(path, known)
    if array is None:
        return None
    shape = tuple(count - 1 for count in image.dimensions[:2])
    values = np.asarray(image.cell_data[array].reshape(shape, order="F"), np.float64)
    return known[array], values / known[array].scale, tuple(image.spacing[:2])


def export_field(
    run: Results,
    path: AnyPath,
    *,
    field: str = "gap",
    step: int | None = None,
    piece: Shape | None = None,
    window: tuple[float, float, float, float] | None = None,
) -> list[Path]:
    """Write the gap, the contact or the fluid pressure over the pixels of the face in SI, in the suffix's format.

    An .npz has the arrays `gap` (n1, n2) [m], or a pressure by the name of its field [Pa], `spacing` [m], `origin`
    [m] of its first corner, `step`, `name` and `nominal_pressure` [Pa]; `read_topography` and NumPy read it. A .vti is
    for ParaView.

    Parameters
    ----------
    path : the file; the number of the step is put before the suffix where there are several.
    field : "gap", "contact_pressure", or "fluid_pressure" of a resolved flow, NaN where none flows.
    step : index of the load step; None is all that are stored.
    piece : row and column of a piece of the study; the whole face unless given.
    window : instead, a part of the face, x1 from and to, x2 from and to [m]: the pixels whose centres lie between.

    Returns
    -------
    Paths of the files.

    Raises
    ------
    InputError : another field or format, no such step or window, results without fields, or a file that cannot
        be written.
    """
    path = Path(path)
    if field not in FIELDS:
        raise InputError("field", repr(field), f"one of {', '.join(FIELDS)}")
    write = _FORMATS.get(path.suffix.lower())
    if write is None:
        expected = "a file .npz, from which NumPy and other programs make .tif and .x3p, or .vti"
        raise InputError("output", f"'{path.name}'", expected)
    if window is not None and (
        piece is not None or not (window[0] < window[1] and window[2] < window[3])
    ):
        raise InputError("window", window, "x1 and x2 from and to [m], rising; no piece")
    steps = stored_steps(run) if step is None else [step]
    if not steps:
        raise InputError("results", f"no {field} over all pixels", WITH_FIELDS)
    written = []
    for s in steps:
        values = read_pixels(run, field, s, piece)
        if window is not None:
            values = _in_window(values, window)
        target = path if step is not None else path.with_stem(f"{path.stem}_{s:04d}")
        with writing("output", target), replacing(target) as temporary:
            write(temporary, values, run, s)
        written.append(target)
    return written


def _in_window(
    values: xarray.DataArray, window: tuple[float, float, float, float]
) -> xarray.DataArray:
    """The part of a field whose pixels have their centres in a window.

    Raises InputError: a window that is not in the face, or without the centre of a pixel.
    """
    pixel, _ = _frame(values)
    sides = np.multiply(values.shape, pixel)
    part = values.sel(x1=slice(*window[:2]), x2=slice(*window[2:]))
    low, high = np.reshape(window, (2, 2)).T / sides
    if not part.size or (low < -_ROUNDING).any() or (high > 1 + _ROUNDING).any():
        face = f"x1 from 0 to {sides[0]:.9g} m, x2 from 0 to {sides[1]:.9g} m"
        expected = f"a part of the face, {face}, with the centre of a pixel of {pixel[0]:.3g} m × {pixel[1]:.3g} m"
        raise InputError("window", window, expected)
    return part


def _frame(values: xarray.DataArray) -> tuple[Pair, Pair]:
    """Pixel and first corner [m] of a field."""
    pixel, corner = [], []
    for name in ("x1", "x2"):
        x = values[name].values.tolist()
        pixel.append((x[-1] - x[0]) / (len(x) - 1) if len(x) > 1 else 2 * x[0])
        corner.append(x[0] - pixel[-1] / 2)
    return (pixel[0], pixel[1]), (corner[0], corner[1])


def _write_npz(path: Path, values: xarray.DataArray, run: Results, step: int) -> None:
    """Write an archive of NumPy with the field, its pixel and corner, and the load."""
    pixel, corner = _frame(values)
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
    made = Field.of(values)
    image = vtk_files.image(*_frame(values), [(made.array_name, values.values * made.scale)])
    vtk_files.with_load(image, vtk_files.loads_of(run.dataset)[step])
    path.write_bytes(vtk_files.as_xml(image))


_FORMATS: dict[str, Callable[[Path, xarray.DataArray, Results, int], None]] = {
    ".npz": _write_npz,
    ".vti": _write_vti,
}
