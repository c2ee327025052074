"""Read the mesh of a seal with its named boundaries, and fields that are given on a mesh, from files.

The mesh is read by meshio. The name of a boundary is the name of a cell set (Abaqus and others) or of a physical group
(gmsh). A facet of the mesh belongs to a named boundary if the file contains a line element between the two vertices of
the facet.
"""

from __future__ import annotations

import contextlib
import io
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Indices, InputError, free_memory
from ..base.machine import within_free_memory
from ..flow.problem import USE_LINEAR_ELEMENTS

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
    points = plane_points_of(file, data, cells, 1e-9) * unit
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
    """Return the kind of cells in a mesh file; raise InputError unless it is a single kind, and a key of `_KINDS`."""
    present = [kind for kind in (*_KINDS, *_SECOND_ORDER) if kind in data.cells_dict]
    if len(present) == 1 and present[0] in _KINDS:
        return present[0]
    found = " and ".join(present) or ", ".join(data.cells_dict) or "nothing"
    expected = f"a mesh with cells of one kind of {', '.join(_KINDS)}, {USE_LINEAR_ELEMENTS}"
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
        Coordinates of the points or of the cell centres, in the unit of the file. The centre of a cell is the
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
        "field", f"'{name}' of '{file}'", f"one of the fields in the file: {field_names(data)}"
    )


def field_names(data: Any) -> str:
    """List the names of all fields in a mesh file, for a message."""
    return ", ".join(map(repr, (*data.point_data, *data.cell_data))) or "none"


def plane_points_of(file: Path, data: Any, cells: Any, rtol: float) -> Array:
    """Return the points (n, 2) of a mesh file; raise InputError if the cells do not lie in a plane of constant z.

    cells : indices of the points at the corners of the cells.
    rtol : allowed variation of z, divided by the size of the mesh.
    """
    points = np.asarray(data.points, dtype=float)
    corners = points[np.ravel(cells)]
    if corners.shape[1] > 2 and np.ptp(corners[:, 2]) > rtol * np.ptp(corners, axis=0).max():
        raise InputError("path", f"'{file}' with varying z", "a plane mesh, z constant")
    return points[:, :2]


def check_fits_memory(file: Path, factor: float, what: str) -> None:
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

    check_fits_memory(file, _READING_FACTOR, "mesh file")
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
