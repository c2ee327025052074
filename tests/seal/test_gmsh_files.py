"""Files of gmsh that lack groups, or have them written as gmsh does not mean it, are answered with what to do there."""

import meshio
import numpy as np
import pytest
from skfem import MeshTri1

import femseal as fs

SQUARE = MeshTri1.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
ENDS = [
    SQUARE.facets[:, SQUARE.facets_satisfying(lambda x, end=end: x[0] == end)] for end in (0, 1)
]
NAMES = {"inlet": np.array([1, 1]), "outlet": np.array([2, 1]), "seal": np.array([3, 2])}


def write(path, *, surface=True, tags=(1, 2, 3), names=NAMES):
    """A square in the format 2.2, its lines and triangles with numbers of physical groups."""
    cells = [("line", ends.T) for ends in ENDS] + [("triangle", SQUARE.t.T)] * surface
    numbers = [np.full(len(block), tag) for (_, block), tag in zip(cells, tags, strict=False)]
    points = np.pad(SQUARE.p.T, ((0, 0), (0, 1)))
    data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
    mesh = meshio.Mesh(points, cells, cell_data=data, field_data=names)
    mesh.write(path, file_format="gmsh22", binary=False)


def refused(path, match):
    with pytest.raises(fs.InputError, match=match) as error:
        fs.MeshSeal(path, "inlet", "outlet", unit="mm")
    assert "\n" not in str(error.value)


def test_files_of_gmsh(tmp_path):
    path = tmp_path / "seal.msh"
    write(path)
    assert fs.MeshSeal(path, "inlet", "outlet", unit="mm").mesh.nelements == 32
    write(path, surface=False)
    refused(path, r"with line, expected elements of the seal's area; .* Physical Surface.\"seal\"")
    # "save all elements" writes the names of the groups, and 0 in place of their numbers
    write(path, tags=(0, 0, 0))
    refused(
        path, r"none of whose lines is in its physical groups inlet, outlet, .*Mesh.SaveAll = 0"
    )
    write(path, tags=(0, 0, 3), names={"seal": NAMES["seal"]})
    refused(
        path,
        "the name of a boundary of the mesh: '0'; name the boundaries: in gmsh by physical groups",
    )


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_save_all_of_gmsh_itself(tmp_path, version):
    gmsh = pytest.importorskip("gmsh")
    path = tmp_path / "seal.msh"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        plate = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.3)
        (_, first), (_, _), (_, last), (_, _) = gmsh.model.getBoundary([(2, plate)], oriented=False)
        gmsh.model.addPhysicalGroup(1, [first], name="inlet")
        gmsh.model.addPhysicalGroup(1, [last], name="outlet")
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
        refused(path, r"expected elements of the seal's area; in gmsh")
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.write(str(path))
        refused(path, r"switch 'Save all elements' off \(Mesh.SaveAll = 0\)")
        gmsh.option.setNumber("Mesh.SaveAll", 0)
        gmsh.model.addPhysicalGroup(2, [plate], name="seal")
        gmsh.write(str(path))
        assert fs.MeshSeal(path, "inlet", "outlet", unit="mm").length == pytest.approx(1e-3)
    finally:
        gmsh.finalize()
