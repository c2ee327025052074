"""Fields of contact pressure from files: a mesh such as .vtu, or points in a text with columns."""

from __future__ import annotations

import csv
import io
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import InputError, shortened
from ..base.machine import free_memory, within_free_memory
from ..base.quantities import to_si
from .pressure_map import PressureField

#: Cells of a mesh that are taken, by their corners; quadrilaterals are cut in two.
_TRIANGLES = {
    "triangle": ((0, 1, 2),),
    "triangle6": ((0, 1, 2),),
    "quad": ((0, 1, 2), (0, 2, 3)),
    "quad8": ((0, 1, 2), (0, 2, 3)),
    "quad9": ((0, 1, 2), (0, 2, 3)),
}
_TEXTS = (".csv", ".txt")
_DELIMITERS = ",;\t"
#: Columns of a text with the coordinates.
_COORDINATES = ("x", "y")
#: Memory that reading takes at least, in sizes of the file.
_READING_FACTOR = 8


def read_pressure_field(
    path: str | PathLike[str], *, length_unit: str, pressure_unit: str, name: str = "pressure"
) -> PressureField:
    """Field of contact pressure in the plane of a seal, from a file.

    Parameters
    ----------
    path : a mesh of triangles or quadrilaterals that meshio reads, such as .vtu, in a plane of constant z, with `name`
        among its data of points (linear on the corners of cells) or of cells (constant on them); or a .csv or .txt with
        columns x, y and `name` under a line of these names, between commas, semicolons, tabs or blanks, whose points
        are joined by triangles.
    length_unit, pressure_unit : of the numbers in the file, such as "mm" and "MPa".

    Raises
    ------
    InputError : no such file, not readable, no such data, numbers that are not finite, or negative pressures.
    """
    file = Path(fspath(path))
    if not file.is_file():
        raise InputError("path", f"'{file}'", "an existing file with a field of pressure")
    if _READING_FACTOR * (size := file.stat().st_size) > (free := free_memory()):
        allowed = f"a file that can be read in the {free / 1e9:.3g} GB of free memory"
        raise InputError("path", f"'{file}' of {size / 1e9:.3g} GB", allowed)
    length, unit = to_si(f"1 {length_unit}", "m", "length_unit"), to_si(f"1 {pressure_unit}", "Pa", "pressure_unit")
    try:
        points, values, triangles = (_of_text if file.suffix.lower() in _TEXTS else _of_mesh)(file, name)
    except InputError as error:
        columns = f"; or a {' or '.join(_TEXTS)} with the columns x, y and {name}"
        more = "" if file.suffix.lower() in _TEXTS else columns
        raise InputError(error.what, error.given, f"{error.expected}{more}") from None
    return PressureField.of(length * points, unit * values, triangles)


def _of_text(file: Path, name: str) -> tuple[Any, Any, None]:
    """Points and values of a text with columns."""
    try:
        with within_free_memory():
            text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, MemoryError) as error:
        raise InputError("path", f"'{file}' ({shortened(error)})", "a text with columns") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise InputError("path", f"'{file}', which is empty", "a text with columns")
    delimiter = max(_DELIMITERS, key=lines[0].count)
    if delimiter in lines[0]:
        head, *rows = csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
    else:
        head, *rows = (line.split() for line in lines)
    names = [column.strip() for column in head]
    wanted = (*_COORDINATES, name)
    if missing := [column for column in wanted if names.count(column) != 1]:
        given = f"'{file}' with the columns {', '.join(names)}"
        raise InputError(
            "path", given, f"one column each of {', '.join(wanted)}, named in the first line: {missing[0]}"
        )
    places = [names.index(column) for column in wanted]
    numbers = np.empty((len(rows), 3))
    for n, row in enumerate(rows):
        try:
            numbers[n] = [float(row[place]) for place in places]
        except (ValueError, IndexError):
            allowed = f"numbers with decimal points in the columns {', '.join(wanted)}"
            raise InputError(
                "path", f"'{file}' with the line '{shortened(delimiter.join(row), 60)}'", allowed
            ) from None
    return numbers[:, :2], numbers[:, 2], None


def _of_mesh(file: Path, name: str) -> tuple[Any, Any, Any]:
    """Points, values and triangles of a mesh; values of cells are at three points of their own for each triangle."""
    from .mesh_file import read_data

    data = read_data(file)
    blocks = [n for n, block in enumerate(data.cells) if block.type in _TRIANGLES]
    if not blocks:
        found = ", ".join(dict.fromkeys(block.type for block in data.cells)) or "nothing"
        raise InputError("path", f"'{file}' with {found}", f"a mesh with cells of {', '.join(_TRIANGLES)}")
    corners = [
        np.concatenate([np.asarray(data.cells[n].data)[:, list(part)] for part in _TRIANGLES[data.cells[n].type]])
        for n in blocks
    ]
    points = np.asarray(data.points, float)
    used = np.unique(np.concatenate(corners))
    if points.shape[1] > 2 and np.ptp(points[used, 2]) > 1e-6 * np.ptp(points[used], axis=0).max():
        raise InputError("path", f"'{file}' with varying z", "a plane mesh, z constant")
    points = points[:, :2]
    if name in data.point_data:
        values = _numbers(data.point_data[name], file, name)
        triangles = np.searchsorted(used, np.concatenate(corners))
        return points[used], values[used], triangles
    if name in data.cell_data:
        parts = [len(_TRIANGLES[data.cells[n].type]) for n in blocks]
        values = np.concatenate(
            [np.tile(_numbers(data.cell_data[name][n], file, name), k) for n, k in zip(blocks, parts, strict=True)]
        )
        own = np.concatenate(corners)
        return points[own.ravel()], np.repeat(values, 3), np.arange(own.size).reshape(-1, 3)
    there = ", ".join(map(repr, (*data.point_data, *data.cell_data))) or "none"
    raise InputError("name", repr(name), f"the name of data of points or cells in '{file}': {there}")


def _numbers(values: Any, file: Path, name: str) -> Any:
    array = np.asarray(values)
    if array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise InputError("name", f"'{name}' in '{file}' with shape {array.shape}", "one number for each point or cell")
    return array.astype(float)
