"""Meshes of tests as files of Gmsh."""

import meshio
import numpy as np


def write_gmsh(path, mesh, points=None, **ends):
    """A plane mesh of scikit-fem, its nodes elsewhere (n, 2) if given, with facets at its ends by their names."""
    kind = "triangle" if len(mesh.t) == 3 else "quad"
    cells, tags, names = [(kind, mesh.t.T)], [np.full(mesh.nelements, 9)], {"all": (9, 2)}
    for number, (name, facets) in enumerate(ends.items(), 1):
        cells.append(("line", mesh.facets[:, facets].T))
        tags.append(np.full(len(facets), number))
        names[name] = (number, 1)
    points = np.pad(mesh.p.T if points is None else points, ((0, 0), (0, 1)))
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    names = {name: np.array(tag) for name, tag in names.items()}
    file = meshio.Mesh(points, cells, cell_data=data, field_data=names)
    file.write(path, file_format="gmsh22", binary=False)
