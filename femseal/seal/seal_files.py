"""A mesh of a seal from a file, with its named boundaries, and fields of contact pressure.

meshio reads the mesh; names come from cell sets (Abaqus and others) or from physical groups (gmsh). Facets are
matched by their two end vertices. A field is that of a mesh such as .vtu, or of points in a text with columns.
"""

from __future__ import annotations

import contextlib
import csv
import io
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Indices, InputError, free_memory, shortened, to_si
from ..base.machine import within_free_memory
from ..flow.problem import LINEAR
from .pressure_map import PressureField

if TYPE_CHECKING:
    from skfem import Mesh

#: Classes of scikit-fem for the cells of files.
_KINDS = {"triangle": "MeshTri1", "quad": "MeshQuad1"}
_SECOND_ORDER = ("triangle6", "quad8", "quad9")
#: Arrays of cells whose numbers name boundaries, such as those that meshio keeps in a .vtu.
_TAGS = ("gmsh:physical", "medit:ref", "boundary")
#: Memory that reading takes at least, in sizes of the file.
_READING_FACTOR = 4
#: Suffix of files of gmsh, and what is to be done there where its physical groups are not in them.
_GMSH = ".msh"
_PHYSICAL_SURFACE = (
    "in gmsh, which writes what is in physical groups alone, put the surface into one beside its boundaries: "
    'Physical Surface("seal") = {1}; or gmsh.model.addPhysicalGroup(2, [1], name="seal")'
)
_SAVE_GROUPS = (
    "a file of gmsh with its physical groups: switch 'Save all elements' off (Mesh.SaveAll = 0), which leaves them "
    "out, put the surface into a physical group too, and save again"
)
#: How a mesh gets names of its boundaries.
NAME_BOUNDARIES = (
    'name them: in gmsh by physical groups of curves, Physical Curve("inlet") = {1, 2}, beside one of the surface, '
    "with Mesh.SaveAll = 0; in other programs by sets of line elements"
)


def read_mesh(path: str | PathLike[str], unit: float = 1.0) -> Mesh:
    """Mesh of linear triangles or quadrilaterals with `boundaries` by name.

    path : a file that meshio reads.
    unit : of its coordinates [m].

    Elements keep the order of the file (blocks of one kind one after the other); nodes that no element uses
    are left out. A physical group without a name is called by its number, and so is one of lines in a .vtu, by the
    array "gmsh:physical" or "boundary" of its cells.

    Raises InputError: no such file, not readable, no cells, cells of several kinds or of the second order, or not in a
    plane of constant z.
    """
    import skfem

    file = Path(fspath(path))
    data = read_data(file)
    present = [kind for kind in (*_KINDS, *_SECOND_ORDER) if kind in data.cells_dict]
    if len(present) != 1 or present[0] in _SECOND_ORDER:
        found = " and ".join(present) or ", ".join(data.cells_dict) or "nothing"
        expected = f"a mesh with cells of one kind of {', '.join(_KINDS)}, {LINEAR}"
        if not present and file.suffix.lower() == _GMSH:
            expected = f"elements of the seal's area; {_PHYSICAL_SURFACE}"
        raise InputError("path", f"'{file}' with {found}", expected)
    kind = present[0]
    cells = data.cells_dict[kind]
    groups = {
        str(name): tag for name, (tag, dimension) in data.field_data.items() if dimension == 1
    }
    if groups and not any(_has_tag(data, tag) for tag in groups.values()):
        given = f"'{file}', none of whose lines is in its physical groups {', '.join(groups)}"
        raise InputError("path", given, _SAVE_GROUPS)
    points = _plane(file, data, cells, 1e-9) * unit
    used, renumbered = np.unique(cells, return_inverse=True)
    cells = renumbered.reshape(cells.shape)
    arrays = (np.ascontiguousarray(of.T) for of in (points[used], cells))
    mesh = getattr(skfem, _KINDS[kind])(*arrays)
    vertex = np.full(len(points), -1)
    vertex[used] = np.arange(used.size)
    boundaries = {
        name: facets
        for name, lines in _named_lines(data).items()
        if (facets := _facets_of(mesh, vertex[lines])).size
    }
    return mesh.with_boundaries(boundaries)


def read_field(path: str | PathLike[str], name: str) -> tuple[Array, Array]:
    """Places (n, 2) and values (n,) or (n, components) of a field at the points or the cells of a mesh file.

    Places are in the unit of the file; those of cells are the means of their nodes.

    Raises InputError: no such file, not readable, or no such field.
    """
    file = Path(fspath(path))
    data = read_data(file)
    points = np.asarray(data.points, dtype=float)[:, :2]
    if name in data.point_data:
        return points, np.asarray(data.point_data[name], dtype=float)
    if name in data.cell_data:
        centres = [points[block.data].mean(axis=1) for block in data.cells]
        return np.vstack(centres), np.concatenate(data.cell_data[name]).astype(float)
    raise InputError("field", f"'{name}' of '{file}'", f"one of its fields: {_fields(data)}")


def _fields(data: Any) -> str:
    """Names of the fields of a mesh."""
    return ", ".join(map(repr, (*data.point_data, *data.cell_data))) or "none"


def _plane(file: Path, data: Any, cells: Any, rtol: float) -> Array:
    """Points (n, 2) of a mesh whose cells lie in a plane of constant z; else InputError."""
    points = np.asarray(data.points, dtype=float)
    used = points[np.ravel(cells)]
    if used.shape[1] > 2 and np.ptp(used[:, 2]) > rtol * np.ptp(used, axis=0).max():
        raise InputError("path", f"'{file}' with varying z", "a plane mesh, z constant")
    return points[:, :2]


def _check_size(file: Path, factor: float, what: str) -> None:
    """Raise InputError if a file is not there, or does not fit into memory."""
    if not file.is_file():
        raise InputError("path", f"'{file}'", f"an existing {what}")
    if factor * (length := file.stat().st_size) > (free := free_memory()):
        allowed = f"a {what} that can be read in the {free / 1e9:.3g} GB of free memory"
        raise InputError("path", f"'{file}' of {length / 1e9:.3g} GB", allowed)


def read_data(file: Path) -> Any:
    """Contents of a mesh file, in silence, if it is there and fits into memory; InputError with what meshio says."""
    import meshio

    _check_size(file, _READING_FACTOR, "mesh file")
    silent = io.StringIO()
    try:
        # a file meshio cannot read makes it print and exit
        with (
            contextlib.redirect_stdout(silent),
            contextlib.redirect_stderr(silent),
            within_free_memory(),
        ):
            return meshio.read(file)
    except (Exception, SystemExit) as error:
        said = "" if isinstance(error, SystemExit) else " ".join(str(error).split())
        known = meshio.extension_to_filetypes
        which = f": {' '.join(sorted(known))}; gmsh meshes .step"
        if file.suffix.lower() in known:
            which = ", not damaged"
        given = f"'{file}' ({said or 'unknown or damaged format'})"
        expected = f"a mesh in a format that meshio reads{which}"
        if "Incompatible cell data 'gmsh:physical'" in said:
            given, expected = f"'{file}', with elements that are in no physical group", _SAVE_GROUPS
        raise InputError("path", given, expected) from None


def _has_tag(data: Any, tag: int) -> bool:
    """Whether lines of a mesh carry the number of a physical group."""
    of_lines = data.cell_data_dict.get(_TAGS[0], {}).get("line", [])
    return bool(np.any(np.asarray(of_lines) == tag))


def _named_lines(data: Any) -> dict[str, Indices]:
    """End vertices (m, 2) of the line cells of every name."""
    named = {
        name: [
            block.data[np.asarray(chosen, int)]
            for block, chosen in zip(data.cells, members, strict=True)
            if block.type == "line" and chosen is not None
        ]
        for name, members in data.cell_sets.items()
        if not name.startswith("gmsh:")
    }
    # a tag counts within its dimension: a surface may have the number of a line
    names = {int(tag): name for name, (tag, dimension) in data.field_data.items() if dimension == 1}
    found: Any = next((data.cell_data_dict[key] for key in _TAGS if key in data.cell_data), {})
    tags = found.get("line", [])
    for tag in np.unique(tags).tolist():
        name = names.get(tag, str(tag))
        if not named.get(name):
            named[name] = [data.cells_dict["line"][tags == tag]]
    return {name: np.vstack(parts) for name, parts in named.items() if parts}


def _facets_of(mesh: Mesh, ends: Indices) -> Indices:
    """Facets of the mesh with the given end vertices; lines that are no facet are left out."""
    n = mesh.nvertices
    facets = np.sort(mesh.facets, axis=0)
    key = facets[0].astype(np.int64) * n + facets[1]
    ends = np.sort(ends[(ends >= 0).all(axis=1)], axis=1)
    return np.flatnonzero(np.isin(key, ends[:, 0] * n + ends[:, 1]))


#: Cells of a mesh that are taken, by their corners; quadrilaterals are cut in two.
_TRIANGLES = {
    **dict.fromkeys(("triangle", "triangle6"), ((0, 1, 2),)),
    **dict.fromkeys(("quad", "quad8", "quad9"), ((0, 1, 2), (0, 2, 3))),
}
TEXTS = (".csv", ".txt")
_DELIMITERS = ",;\t"
#: Memory that reading a field takes at least, in sizes of the file.
_FIELD_FACTOR = 8


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
    _check_size(file, _FIELD_FACTOR, "file with a field of pressure")
    length = to_si(f"1 {length_unit}", "m", "length_unit")
    unit = to_si(f"1 {pressure_unit}", "Pa", "pressure_unit")
    if file.suffix.lower() in TEXTS:
        numbers = read_columns(file, ("x", "y", name))
        return PressureField.of(length * numbers[:, :2], unit * numbers[:, 2])
    points, values, triangles = _of_mesh(file, name)
    return PressureField.of(length * points, unit * values, triangles)


def text_rows(file: Path, what: str = "path") -> list[tuple[int, str, list[str]]]:
    """Number, text and cells of the lines of a text but comments (#); between cells is what its first line has most of,
    commas, semicolons, tabs or blanks.

    Raises InputError: not readable, or empty.
    """
    try:
        with within_free_memory():
            text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, MemoryError) as error:
        raise InputError(what, f"'{file}' ({shortened(error)})", "a text with columns") from None
    lines = {n: line.strip() for n, line in enumerate(text.splitlines(), 1)}
    lines = {n: line for n, line in lines.items() if line and line[0] != "#"}
    if not lines:
        raise InputError(what, f"'{file}', which is empty", "a text with columns")
    first = next(iter(lines.values()))
    mark = max(_DELIMITERS, key=first.count)
    cells = (
        csv.reader(lines.values(), delimiter=mark)
        if mark in first
        else map(str.split, lines.values())
    )
    return [(*line, row) for line, row in zip(lines.items(), cells, strict=False)]


def columns_of(file: Path) -> list[str]:
    """Names of the columns of a text, by its first line."""
    return [column.strip() for column in text_rows(file)[0][2]]


def read_columns(file: Path, wanted: tuple[str, ...]) -> Array:
    """Numbers (n, columns) in the wanted columns of a text, whose first line names them.

    Raises InputError: not readable, a column that is missing or there twice, text in place of a number.
    """
    (_, _, head), *rows = text_rows(file)
    names = [column.strip() for column in head]
    if missing := [column for column in wanted if names.count(column) != 1]:
        given = f"'{file}' with the columns {', '.join(names)}"
        expected = f"one column each of {', '.join(wanted)}, named in the first line: {missing[0]}"
        raise InputError("path", given, expected)
    patches = [names.index(column) for column in wanted]
    numbers = []
    for _, line, row in rows:
        try:
            numbers.append([float(row[place]) for place in patches])
        except (ValueError, IndexError):
            allowed = f"numbers with decimal points in the columns {', '.join(wanted)}"
            given = f"'{file}' with the line '{shortened(line, 60)}'"
            raise InputError("path", given, allowed) from None
    return np.reshape(numbers, (-1, len(wanted)))


def _of_mesh(file: Path, name: str) -> tuple[Any, Any, Any]:
    """Points, values and triangles of a mesh; values of cells are at three points of their own for each triangle."""
    data = read_data(file)
    used = [
        (n, block.data[:, list(part)])
        for n, block in enumerate(data.cells)
        for part in _TRIANGLES.get(block.type, ())
    ]
    if not used:
        found = ", ".join(dict.fromkeys(block.type for block in data.cells)) or "nothing"
        expected = f"a mesh with cells of {', '.join(_TRIANGLES)}"
        raise InputError("path", f"'{file}' with {found}", expected)
    corners = np.concatenate([part for _, part in used])
    points = _plane(file, data, corners, 1e-6)
    if name in data.point_data:
        vertices, renumbered = np.unique(corners, return_inverse=True)
        values = _numbers(data.point_data[name], file, name)
        return points[vertices], values[vertices], renumbered.reshape(corners.shape)
    if name in data.cell_data:
        of_cells = [_numbers(data.cell_data[name][n], file, name) for n, _ in used]
        own = np.arange(corners.size).reshape(-1, 3)
        return points[corners.ravel()], np.repeat(np.concatenate(of_cells), 3), own
    expected = f"the name of data of points or cells in '{file}': {_fields(data)}"
    raise InputError("name", repr(name), expected)


def _numbers(values: Any, file: Path, name: str) -> Any:
    """An array as one number for each point or cell, else InputError."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.size != len(array):
        given = f"'{name}' in '{file}' with shape {array.shape}"
        raise InputError("name", given, "one number for each point or cell")
    return array.ravel().astype(float)
