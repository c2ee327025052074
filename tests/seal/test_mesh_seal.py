"""Seals on meshes of files: boundaries, order of the elements, and files that are refused."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshLine, MeshQuad, MeshTri

from femseal.base import InputError
from femseal.seal import (
    MeshSeal,
)

RING = Path(__file__).parents[2] / "meshes" / "ring.msh"


def square(kind, **kwargs):
    """Unit square of 2 × 2 cells as a meshio mesh; lines of group 7 at x = 0 and group 8 at x = 1."""
    mesh = (MeshTri if kind == "triangle" else MeshQuad).init_tensor(*2 * [np.linspace(0, 1, 3)])
    points = np.c_[mesh.p.T, np.full(mesh.nvertices, 0.5)]
    left, right = (
        mesh.facets[:, mesh.facets_satisfying(lambda x, at=at: x[0] == at)].T for at in (0, 1)
    )
    tags = [np.full(2, 7), np.full(2, 8), np.full(mesh.nelements, 7)]
    cells = [("line", left), ("line", right), (kind, mesh.t.T)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    return meshio.Mesh(points, cells, **({"cell_data": data} | kwargs))


NAMES = {"left": np.array([7, 1]), "right": np.array([8, 1]), "body": np.array([7, 2])}


@pytest.mark.parametrize("kind", ["triangle", "quad"])
@pytest.mark.parametrize(("names", "ends"), [(NAMES, ("left", "right")), ({}, ("7", "8"))])
def test_boundaries_by_name_or_number(tmp_path, kind, names, ends):
    path = tmp_path / "square.msh"
    mesh = square(kind, field_data=names)
    mesh.points = np.vstack([mesh.points, [[9.0, 9.0, 0.5]]])  # a node that no element uses
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    seal = MeshSeal(path, *ends)
    assert len(seal.points) == 9
    flow = seal.flow(3.0)
    assert_allclose(flow.conductance, 3.0, rtol=1e-12)
    assert_allclose(flow.potential, 1 - seal.points[:, 0], atol=1e-12)
    assert_allclose([seal.length, seal.area], 1.0, rtol=1e-12)


@pytest.mark.parametrize("array", ["gmsh:physical", "boundary"])
def test_boundaries_in_a_vtu_go_by_their_number(tmp_path, array):
    tags = square("triangle").cell_data["gmsh:physical"]
    meshio.write(tmp_path / "square.vtu", square("triangle", cell_data={array: tags}))
    seal = MeshSeal(tmp_path / "square.vtu", "7", "8")
    assert_allclose(seal.flow(1.0).conductance, 1.0, rtol=1e-12)


def test_cell_sets_of_another_format(tmp_path):
    path, none, both = tmp_path / "square.inp", np.array([], int), np.array([0, 1])
    sets = {"in": [both, none, none], "out": [none, both, none]}
    meshio.write(path, square("quad", cell_sets=sets, cell_data={}))
    assert_allclose(MeshSeal(path, "in", "out").flow(1.0).conductance, 1.0, rtol=1e-12)


def test_elements_keep_the_order_of_the_file(tmp_path):
    mesh = square("triangle", field_data=NAMES)
    mesh.cells[2].data = mesh.cells[2].data[::-1]
    path = tmp_path / "square.msh"
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    seal = MeshSeal(path, "left", "right")
    triangles = mesh.points[mesh.cells[2].data][..., :2]
    assert_allclose(seal.points[seal.mesh.t.T].mean(axis=1), triangles.mean(axis=1))
    k = np.where(triangles.mean(axis=1)[:, 0] < 0.5, 1.0, 3.0)
    assert_allclose(seal.flow(k).conductance, 1.5, rtol=1e-12)


def test_gmsh_version_4(tmp_path):
    path = tmp_path / "square.msh"
    path.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        '$PhysicalNames\n3\n1 1 "west"\n1 2 "east"\n2 3 "seal"\n$EndPhysicalNames\n'
        "$Entities\n0 2 1 0\n"
        "1 0 0 0 0 1 0 1 1 0\n2 1 0 0 1 1 0 1 2 0\n1 0 0 0 1 1 0 1 3 0\n$EndEntities\n"
        "$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
        "$Elements\n3 4 1 4\n1 1 1 1\n1 4 1\n1 2 1 1\n2 2 3\n2 1 2 2\n3 1 2 3\n4 1 3 4\n$EndElements\n"
    )
    seal = MeshSeal(path, "west", "east")
    assert_allclose(seal.flow(2.0, bounds=True).lower, 2.0, rtol=1e-12)


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])


QUAD, TRIANGLES = ("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2], [4, 5, 2]])


RAISED = np.where(np.arange(18).reshape(6, 3) == 2, 1, CORNERS)


@pytest.mark.parametrize(
    ("file", "message"),
    [
        (None, r"^path: given '.*mesh\.msh', expected an existing mesh file"),
        ("not a mesh", r"mesh\.msh'.*, expected a mesh in a format that meshio reads"),
        ("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0", "in a format that meshio reads"),
        (
            meshio.Mesh(CORNERS, [("line", [[0, 1]])]),
            "with line, expected elements of the seal's area",
        ),
        (meshio.Mesh(CORNERS, [QUAD, TRIANGLES]), "with triangle and quad, expected a mesh with"),
        (meshio.Mesh(RAISED, [QUAD]), "with varying z, expected"),
        (
            meshio.Mesh(CORNERS, [QUAD]),
            "^inlet: given 'inlet', .*the mesh: none; name the boundaries: in gmsh by physical groups of curves",
        ),
    ],
)
def test_bad_mesh_files(tmp_path, file, message):
    path = tmp_path / "mesh.msh"
    if isinstance(file, str):
        path.write_text(file)
    elif file:
        meshio.write(path, file, file_format="gmsh22", binary=False)
    with pytest.raises(InputError, match=message) as error:
        MeshSeal(path, "inlet", "outlet")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("inlet", "outlet", "message"),
    [
        ("west", "outlet", "inlet: given 'west', expected the name of a boundary of the mesh: 'i"),
        ("inlet", "seal", "outlet: given 'seal', expected the name"),
        ("inlet", "inlet", "inlet and outlet: given boundaries that touch"),
    ],
)
def test_bad_boundaries(inlet, outlet, message):
    with pytest.raises(InputError, match="^" + message):
        MeshSeal(RING, inlet, outlet)


def test_bad_ready_meshes():
    with pytest.raises(InputError, match=r"^path: given a MeshLine1, expected a plane mesh"):
        MeshSeal(MeshLine(), "a", "b")
    ends = {"a": lambda x: x[0] == 0, "b": lambda x: x[0] == 3}
    x = np.array([[0, 1, 1, 0, 2, 3, 3, 2], [0, 0, 1, 1, 0, 0, 1, 1]], float)
    apart = MeshQuad(x, np.array([[0, 1, 2, 3], [4, 5, 6, 7]]).T)
    tangled = MeshQuad(x[:, :4] * [[3], [1]], np.array([[0, 1, 3, 2]]).T)
    points = np.array([[0, 3, 3, 1.5], [0, 0, 1, -1e-14]])
    flat = MeshTri(points, np.array([[0, 1, 2], [0, 3, 1]]).T)
    for mesh, message in (
        (apart, "inlet and outlet: given boundaries that the mesh does not connect"),
        (tangled, "path: given a mesh whose element 0 is degenerate or tangled"),
        (flat, "path: given a mesh whose element 1 is degenerate or tangled"),
    ):
        with pytest.raises(InputError, match="^" + message):
            MeshSeal(mesh.with_boundaries(ends), "a", "b")
