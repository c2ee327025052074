"""Read the mesh of a seal with its named boundaries, and fields of contact pressure, from files.

The mesh is read by meshio. The name of a boundary is the name of a cell set (Abaqus and others) or of a physical group
(gmsh). A facet of the mesh belongs to a named boundary if the file contains a line element between the two vertices of
the facet. Pressure fields and vector fields are read from mesh files such as .vtu. Pressure fields can also be read
from text files with columns.
"""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Iterable
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..base import Array, Indices, InputError, free_memory, shortened, to_si
from ..base.machine import within_free_memory
from ..flow.problem import LINEAR
from .pressure_map import PressureField

if TYPE_CHECKING:
    from skfem import Mesh

#: Mesh class of scikit-fem for each type of cells in files.
_KINDS = {"triangle": "MeshTri1", "quad": "MeshQuad1"}
_SECOND_ORDER = ("triangle6", "quad8", "quad9")
#: Names of cell data that contain the number of the boundary of each line, for example in a .vtu file written by
#: meshio.
_TAGS = ("gmsh:physical", "medit:ref", "boundary")
#: Smallest ratio of the memory needed for reading a mesh to the size of its file.
_READING_FACTOR = 4
#: Suffix of gmsh files, and advice for files without the necessary physical groups.
_GMSH = ".msh"
_PHYSICAL_SURFACE = (
    "in gmsh, put the surface into a physical group too, because gmsh only writes elements in physical groups: "
    'Physical Surface("seal") = {1}; or gmsh.model.addPhysicalGroup(2, [1], name="seal")'
)
_SAVE_GROUPS = (
    "a gmsh file with its physical groups: in gmsh, switch 'Save all elements' off (Mesh.SaveAll = 0), because this "
    "option omits the physical groups; put the surface into a physical group too, and save again"
)
#: Advice on how to give names to the boundaries of a mesh.
NAME_BOUNDARIES = (
    'name the boundaries: in gmsh by physical groups of curves, Physical Curve("inlet") = {1, 2}, and a physical group '
    "of the surface, with Mesh.SaveAll = 0; in other programs by sets of line elements"
)


def read_mesh(path: str | PathLike[str], unit: float = 1.0) -> Mesh:
    """Read a mesh of linear triangles or quadrilaterals with named boundaries.

    The elements of the mesh have the same order as in the file. Nodes that belong to no element are omitted. An unnamed
    physical group takes its number as its name. In a .vtu file, the cell data "gmsh:physical" or "boundary" contain the
    number of the boundary to which each line belongs. In a .vtu file, the name of a boundary is its number.

    Parameters
    ----------
    path : str or PathLike
        File in a format that meshio can read.
    unit : float
        Unit of the coordinates in the file, as a length [m].

    Returns
    -------
    Mesh
        scikit-fem mesh with its `boundaries`, in metres.

    Raises
    ------
    InputError
        The file does not exist or cannot be read; or its elements are of several types, of second order, or not in a
        plane of constant z.
    """
    import skfem

    file = Path(fspath(path))
    data = read_data(file)
    kind = _kind_of_cells(file, data)
    _check_groups(file, data)
    cells = data.cells_dict[kind]
    points = _plane_points_of(file, data, cells, 1e-9) * unit
    # keep only the nodes of elements, and renumber them
    kept_nodes, renumbered = np.unique(cells, return_inverse=True)
    elements = renumbered.reshape(cells.shape)
    mesh_class = getattr(skfem, _KINDS[kind])
    mesh = mesh_class(np.ascontiguousarray(points[kept_nodes].T), np.ascontiguousarray(elements.T))
    # index of the vertex of the mesh for each node of the file, −1 if the node was omitted
    vertex = np.full(len(points), -1)
    vertex[kept_nodes] = np.arange(kept_nodes.size)
    boundaries = {}
    for name, lines in _named_lines(data).items():
        facets = _facets_with_ends(mesh, vertex[lines])
        if facets.size:
            boundaries[name] = facets
    return mesh.with_boundaries(boundaries)


def _kind_of_cells(file: Path, data: Any) -> str:
    """Return the kind of cells in a mesh file, a key of `_KINDS`; raise InputError for several or other kinds."""
    present = [kind for kind in (*_KINDS, *_SECOND_ORDER) if kind in data.cells_dict]
    if len(present) == 1 and present[0] in _KINDS:
        return present[0]
    found = " and ".join(present) or ", ".join(data.cells_dict) or "nothing"
    expected = f"a mesh with cells of one kind of {', '.join(_KINDS)}, {LINEAR}"
    if not present and file.suffix.lower() == _GMSH:
        expected = f"elements of the seal's area; {_PHYSICAL_SURFACE}"
    raise InputError("path", f"'{file}' with {found}", expected)


def _check_groups(file: Path, data: Any) -> None:
    """Raise InputError if a mesh file defines physical groups of lines, but no line belongs to a physical group."""
    groups = {
        str(name): tag for name, (tag, dimension) in data.field_data.items() if dimension == 1
    }
    if groups and not any(_has_tag(data, tag) for tag in groups.values()):
        given = f"'{file}', none of whose lines is in its physical groups {', '.join(groups)}"
        raise InputError("path", given, _SAVE_GROUPS)


def read_field(path: str | PathLike[str], name: str) -> tuple[Array, Array]:
    """Read a field that is given at the points or in the cells of a mesh file.

    Returns
    -------
    positions : array, (n, 2)
        Coordinates of the points or of the centres of the cells, in the unit of the file. The centre of a cell is the
        mean position of its nodes.
    values : array, (n,) or (n, components)
        Values of the field.

    Raises
    ------
    InputError
        The file does not exist, cannot be read, or does not contain a field with the name `name`.
    """
    file = Path(fspath(path))
    data = read_data(file)
    points = np.asarray(data.points, dtype=float)[:, :2]
    if name in data.point_data:
        return points, np.asarray(data.point_data[name], dtype=float)
    if name in data.cell_data:
        centres = [points[block.data].mean(axis=1) for block in data.cells]
        return np.vstack(centres), np.concatenate(data.cell_data[name]).astype(float)
    raise InputError(
        "field", f"'{name}' of '{file}'", f"one of the fields in the file: {_fields(data)}"
    )


def _fields(data: Any) -> str:
    """List the names of all fields in a mesh file, for a message."""
    return ", ".join(map(repr, (*data.point_data, *data.cell_data))) or "none"


def _plane_points_of(file: Path, data: Any, cells: Any, rtol: float) -> Array:
    """Return the points (n, 2) of a mesh file; raise InputError if the cells do not lie in a plane of constant z.

    cells : indices of the points at the corners of the cells. rtol : allowed variation of z, divided by the size of the
    mesh.
    """
    points = np.asarray(data.points, dtype=float)
    corners = points[np.ravel(cells)]
    if corners.shape[1] > 2 and np.ptp(corners[:, 2]) > rtol * np.ptp(corners, axis=0).max():
        raise InputError("path", f"'{file}' with varying z", "a plane mesh, z constant")
    return points[:, :2]


def _check_size(file: Path, factor: float, what: str) -> None:
    """Raise InputError if a file does not exist, or if `factor` times its size does not fit into the free memory.

    what : kind of file, for the message.
    """
    if not file.is_file():
        raise InputError("path", f"'{file}'", f"an existing {what}")
    size = file.stat().st_size
    free = free_memory()
    if factor * size > free:
        allowed = f"a {what} that can be read in the {free / 1e9:.3g} GB of free memory"
        raise InputError("path", f"'{file}' of {size / 1e9:.3g} GB", allowed)


def read_data(file: Path) -> Any:
    """Read a mesh file by meshio, and suppress the text that meshio prints.

    If the file cannot be read or does not fit into memory, an InputError with the message of meshio is raised.
    """
    import meshio

    _check_size(file, _READING_FACTOR, "mesh file")
    silent = io.StringIO()
    try:
        # if meshio cannot read a file, it prints a message and ends the program by SystemExit
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
    """Return whether any line of a mesh belongs to the physical group with the number `tag`."""
    line_tags = data.cell_data_dict.get(_TAGS[0], {}).get("line", [])
    return bool(np.any(np.asarray(line_tags) == tag))


def _named_lines(data: Any) -> dict[str, Indices]:
    """Return the end nodes (m, 2) of the lines of each named boundary.

    If the file contains a cell set with the name of the boundary, the lines in this cell set are returned; if not, the
    lines with the number of the boundary are returned.
    """
    named = _lines_of_cell_sets(data)
    for name, lines in _numbered_lines(data).items():
        if not named.get(name):
            named[name] = [lines]
    return {name: np.vstack(parts) for name, parts in named.items() if parts}


def _lines_of_cell_sets(data: Any) -> dict[str, list[Indices]]:
    """Return the end nodes (m, 2) of the lines in each cell set, separately for each block of cells in the file."""
    lines_of_set = {}
    for name, members in data.cell_sets.items():
        if name.startswith("gmsh:"):  # internal sets of gmsh
            continue
        # a cell set lists the numbers of its cells in each block, or None for a block without such cells
        lines_of_set[name] = [
            block.data[np.asarray(numbers, int)]
            for block, numbers in zip(data.cells, members, strict=True)
            if block.type == "line" and numbers is not None
        ]
    return lines_of_set


def _numbered_lines(data: Any) -> dict[str, Indices]:
    """Return the end nodes (m, 2) of the lines with the number of each boundary, by the name of the boundary."""
    # names of the numbered boundaries; groups of surfaces are ignored, because a surface may have the same number as a
    # line
    names = {int(tag): name for name, (tag, dimension) in data.field_data.items() if dimension == 1}
    tag_keys = [key for key in _TAGS if key in data.cell_data]
    # number of the boundary of each line; empty if the file contains no numbers
    tags = data.cell_data_dict[tag_keys[0]].get("line", []) if tag_keys else []
    lines_of_boundary: dict[str, Indices] = {}
    for tag in np.unique(tags).tolist():
        name = names.get(tag, str(tag))
        lines_of_boundary.setdefault(name, data.cells_dict["line"][tags == tag])
    return lines_of_boundary


def _facets_with_ends(mesh: Mesh, ends: Indices) -> Indices:
    """Return the facets whose vertices form one of the given pairs (m, 2); pairs that form no facet are ignored."""
    n = mesh.nvertices
    # a pair of vertices is represented by a single number, which does not depend on the order of the two vertices
    facet_ends = np.sort(mesh.facets, axis=0)  # (2, facet), the smaller vertex number first
    facet_key = facet_ends[0].astype(np.int64) * n + facet_ends[1]
    # False for pairs with an omitted node, whose number is −1
    is_complete = (ends >= 0).all(axis=1)
    ends = np.sort(ends[is_complete], axis=1)
    wanted_key = ends[:, 0] * n + ends[:, 1]
    return np.flatnonzero(np.isin(facet_key, wanted_key))


#: Corners of the triangles into which cells are divided; nodes on edges are ignored.
_TRIANGLES = {
    **dict.fromkeys(("triangle", "triangle6"), ((0, 1, 2),)),
    **dict.fromkeys(("quad", "quad8", "quad9"), ((0, 1, 2), (0, 2, 3))),
}
TEXTS = (".csv", ".txt")
_DELIMITERS = ",;\t"
#: Smallest ratio of the memory needed for reading a field to the size of its file.
_FIELD_FACTOR = 8


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
    _check_size(file, _FIELD_FACTOR, "file with a field of pressure")
    length = to_si(f"1 {length_unit}", "m", "length_unit")
    unit = to_si(f"1 {pressure_unit}", "Pa", "pressure_unit")
    if file.suffix.lower() in TEXTS:
        numbers = read_columns(file, ("x", "y", name))
        return PressureField.from_points(length * numbers[:, :2], unit * numbers[:, 2])
    field = _read_triangles(file, name)
    return PressureField.from_points(length * field.points, unit * field.values, field.triangles)


class TextRow(NamedTuple):
    """A line of a text file: its number in the file, its text, and the text in each column."""

    number: int
    line: str
    entries: list[str]


def text_rows(file: Path, what: str = "path") -> list[TextRow]:
    """Read the lines of a text file with columns, without empty lines and comments (#).

    The separator of the columns is the comma, the semicolon or the tab, whichever is most frequent in the first line.
    If the first line contains no comma, semicolon or tab, the columns are separated by blanks.

    Parameters
    ----------
    file : Path
        Text file in UTF-8.
    what : str
        Name of the input, for the message.

    Returns
    -------
    list of TextRow
        One row for each line.

    Raises
    ------
    InputError
        The file cannot be read or is empty.
    """
    try:
        with within_free_memory():
            text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, MemoryError) as error:
        raise InputError(what, f"'{file}' ({shortened(error)})", "a text with columns") from None
    all_lines = {n: line.strip() for n, line in enumerate(text.splitlines(), 1)}
    lines = {n: line for n, line in all_lines.items() if line and line[0] != "#"}
    if not lines:
        raise InputError(what, f"'{file}', which is empty", "a text with columns")
    first_line = next(iter(lines.values()))
    delimiter = max(_DELIMITERS, key=first_line.count)
    entries: Iterable[list[str]]
    if delimiter in first_line:
        entries = csv.reader(lines.values(), delimiter=delimiter)
    else:
        entries = map(str.split, lines.values())
    # the reader of .csv files may join lines inside quotes, so that there may be fewer entries than lines
    numbered_lines = zip(lines.items(), entries, strict=False)
    return [TextRow(number, line, row) for (number, line), row in numbered_lines]


def columns_of(file: Path) -> list[str]:
    """Return the names of the columns of a text file from its first line."""
    first_row = text_rows(file)[0]
    return [column.strip() for column in first_row.entries]


def read_columns(file: Path, wanted: tuple[str, ...]) -> Array:
    """Read the columns with the names `wanted` from a text file, and return an array (lines, columns).

    The first line of the file contains the names of the columns. Raises InputError if the file cannot be read, a column
    is missing or occurs twice, or an entry is not a number.
    """
    first_row, *rows = text_rows(file)
    names = [column.strip() for column in first_row.entries]
    missing = [column for column in wanted if names.count(column) != 1]
    if missing:
        given = f"'{file}' with the columns {', '.join(names)}"
        expected = f"one column each of {', '.join(wanted)}, named in the first line: {missing[0]}"
        raise InputError("path", given, expected)
    columns = [names.index(column) for column in wanted]
    numbers = []
    for row in rows:
        try:
            numbers.append([float(row.entries[column]) for column in columns])
        except (ValueError, IndexError):
            allowed = f"numbers with decimal points in the columns {', '.join(wanted)}"
            given = f"'{file}' with the line '{shortened(row.line, 60)}'"
            raise InputError("path", given, allowed) from None
    return np.reshape(numbers, (-1, len(wanted)))


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
    points = _plane_points_of(file, data, triangles, 1e-6)
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
    expected = f"the name of data of points or cells in '{file}': {_fields(data)}"
    raise InputError("name", repr(name), expected)


def _numbers(values: Any, file: Path, name: str) -> Any:
    """Check that `values` contain one number for each point or cell, and return the numbers as an array."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.size != len(array):
        given = f"'{name}' in '{file}' with shape {array.shape}"
        raise InputError("name", given, "one number for each point or cell")
    return array.ravel().astype(float)
