"""Read a field of contact pressure from a mesh file, such as .vtu, or from a text file with columns."""

from __future__ import annotations

from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..base import InputError, to_si
from ..base.text_columns import TEXT_SUFFIXES, read_columns
from .mesh_files import check_fits_memory, field_names, plane_points_of, read_data
from .pressure_map import PressureField

#: Corners of the triangles into which cells are divided; nodes on edges are ignored.
_TRIANGLES = {
    **dict.fromkeys(("triangle", "triangle6"), ((0, 1, 2),)),
    **dict.fromkeys(("quad", "quad8", "quad9"), ((0, 1, 2), (0, 2, 3))),
}
#: Smallest ratio of the memory needed for reading a field to the size of its file.
_MEMORY_FACTOR = 8


def read_pressure_field(
    path: str | PathLike[str], *, length_unit: str, pressure_unit: str, name: str = "pressure"
) -> PressureField:
    """Read a field of contact pressure in the plane of a seal from a file.

    Parameters
    ----------
    path : str or PathLike
        Either a mesh file that meshio can read, such as .vtu, or a text file, .csv or .txt. The mesh must consist of
        triangles or quadrilaterals in a plane of constant z. The pressure is stored as point data (linear in each cell)
        or cell data (constant in each cell) with the name `name`. The first line of a text file contains the names of
        its columns; the columns x, y and `name` are required. The columns are separated by commas, semicolons, tabs or
        blanks. The points of a text file are connected by triangles.
    length_unit, pressure_unit : str
        Units of the numbers in the file, such as "mm" and "MPa".
    name : str
        Name of the data or of the column with the pressure.

    Returns
    -------
    PressureField
        The pressure field, which is interpolated linearly on triangles.

    Raises
    ------
    InputError
        The file does not exist or cannot be read, data with the name `name` are missing, a number is not finite, or a
        pressure is negative.
    """
    file = Path(fspath(path))
    check_fits_memory(file, _MEMORY_FACTOR, "file with a field of pressure")
    length = to_si(f"1 {length_unit}", "m", "length_unit")
    unit = to_si(f"1 {pressure_unit}", "Pa", "pressure_unit")
    if file.suffix.lower() in TEXT_SUFFIXES:
        numbers = read_columns(file, ("x", "y", name))
        return PressureField.from_points(length * numbers[:, :2], unit * numbers[:, 2])
    field = _read_triangles(file, name)
    return PressureField.from_points(length * field.points, unit * field.values, field.triangles)


class _FieldOnTriangles(NamedTuple):
    """A field on triangles: points (n, 2), values at the points (n,), and corners of the triangles (t, 3)."""

    points: Any
    values: Any
    triangles: Any


def _read_triangles(file: Path, name: str) -> _FieldOnTriangles:
    """Read a field from a mesh file, and divide all cells of the mesh into triangles.

    Cell data are constant in each cell and differ between neighbouring cells. For cell data, each triangle has its own
    three points, all with the value of the cell.
    """
    data = read_data(file)
    # for each division of a block of cells into triangles: index of the block, and corners of one triangle per cell
    block_triangles = [
        (n_block, block.data[:, list(corners)])
        for n_block, block in enumerate(data.cells)
        for corners in _TRIANGLES.get(block.type, ())
    ]
    if not block_triangles:
        present = ", ".join(dict.fromkeys(block.type for block in data.cells)) or "nothing"
        expected = f"a mesh with cells of {', '.join(_TRIANGLES)}"
        raise InputError("path", f"'{file}' with {present}", expected)
    triangles = np.concatenate([corners for _, corners in block_triangles])
    points = plane_points_of(file, data, triangles, 1e-6)
    if name in data.point_data:
        # omit points that belong to no triangle, and renumber the others
        vertices, renumbered = np.unique(triangles, return_inverse=True)
        values = _numbers(data.point_data[name], file, name)
        return _FieldOnTriangles(
            points[vertices], values[vertices], renumbered.reshape(triangles.shape)
        )
    if name in data.cell_data:
        # one value for each triangle, in the order of `triangles`
        triangle_values = np.concatenate(
            [_numbers(data.cell_data[name][n_block], file, name) for n_block, _ in block_triangles]
        )
        separate_triangles = np.arange(triangles.size).reshape(-1, 3)
        return _FieldOnTriangles(
            points[triangles.ravel()], np.repeat(triangle_values, 3), separate_triangles
        )
    expected = f"the name of a point field or cell field in '{file}': {field_names(data)}"
    raise InputError("name", repr(name), expected)


def _numbers(values: Any, file: Path, name: str) -> Any:
    """Check that `values` contain one number for each point or cell, and return the numbers as an array."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.size != len(array):
        given = f"'{name}' in '{file}' with shape {array.shape}"
        raise InputError("name", given, "one number for each point or cell")
    return array.ravel().astype(float)
