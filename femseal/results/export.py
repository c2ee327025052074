"""Gap, contact and fluid pressure over the pixels of the face as files for other programs, with their pixel's size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import AnyPath, InputError, Pair, Shape, replacing, writing
from ..base.fields import Field
from . import vtk_files
from .paraview import WITH_FIELDS, read_pixels, stored_steps
from .results import Results
from .variables import block_means

if TYPE_CHECKING:
    import xarray

FIELDS = ("gap", "contact_pressure", "fluid_pressure")
#: Most pixels a side of an image for ParaView: larger ones are means over blocks.
MOST_PIXELS = 2048
#: By which a window may lie beyond a face, over its size: ends are texts.
_ROUNDING = 1e-6


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
    for ParaView, as means over blocks from 2048 pixels a side on; a `window` has all its pixels.

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
        raise InputError(
            "window", window, "x1 from and to, x2 from and to [m], rising, and no piece beside"
        )
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
    known: dict[str, Any] = {
        "step": step,
        "name": load.name,
        "nominal_pressure": load.pressure,
        "spacing": pixel,
        "origin": corner,
    }
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **{str(values.name): values.values}, **known)


def _write_vti(path: Path, values: xarray.DataArray, run: Results, step: int) -> None:
    """Write an image for ParaView, as means over blocks where there are too many pixels."""
    (d1, d2), corner = _frame(values)
    made = Field.of(values)
    blocks = values.values
    if max(values.shape) > MOST_PIXELS:
        blocks = block_means(blocks, MOST_PIXELS)
    (n1, n2), (m1, m2) = values.shape, blocks.shape
    steps = vtk_files.LoadSteps.of(run.dataset, np.array([step]))
    cells = {made.array_name: lambda _: blocks * made.scale}
    image = vtk_files.Image(
        str(values.name), (d1 * n1 / m1, d2 * n2 / m2), corner, (m1, m2), steps, cells
    )
    path.write_bytes(vtk_files.as_xml(image.at(0)))


_FORMATS: dict[str, Callable[[Path, xarray.DataArray, Results, int], None]] = {
    ".npz": _write_npz,
    ".vti": _write_vti,
}
