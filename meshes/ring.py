"""Write ring.msh: an annulus of radii 10 and 15 mm in quadrilaterals, boundaries "inlet" (inner) and
"outlet".

To write the file again, run: python meshes/ring.py
"""

from __future__ import annotations

from math import pi
from pathlib import Path

import meshio
import numpy as np
from skfem import MeshQuad

INNER_RADIUS = 10e-3
OUTER_RADIUS = 15e-3


def ring(n_r: int = 8, n_θ: int = 96) -> meshio.Mesh:
    """Annulus of n_r × n_θ quadrilaterals with physical groups for gmsh, coordinates in metres."""
    grid = MeshQuad.init_tensor(
        np.linspace(INNER_RADIUS, OUTER_RADIUS, n_r + 1), np.arange(n_θ + 1.0)
    )
    # join the last column of angles to the first
    node = np.unique(np.column_stack([grid.p[0], grid.p[1] % n_θ]), axis=0, return_inverse=True)
    (r, j), merged = node[0].T, node[1].ravel()
    θ = 2 * pi * j / n_θ
    points = np.column_stack([r * np.cos(θ), r * np.sin(θ), np.zeros(r.size)])
    quads = merged[grid.t.T]
    boundary = grid.facets[:, grid.boundary_facets()]
    lines = {
        radius: merged[boundary[:, (grid.p[0, boundary] == radius).all(axis=0)].T]
        for radius in (INNER_RADIUS, OUTER_RADIUS)
    }
    cells = [("line", lines[INNER_RADIUS]), ("line", lines[OUTER_RADIUS]), ("quad", quads)]
    tags = [np.full(len(block), tag) for tag, (_, block) in enumerate(cells, start=1)]
    return meshio.Mesh(
        points,
        cells,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array(tag) for name, tag in
                    {"inlet": (1, 1), "outlet": (2, 1), "seal": (3, 2)}.items()},
    )  # fmt: skip


if __name__ == "__main__":
    path = Path(__file__).with_suffix(".msh")
    meshio.write(path, ring(), file_format="gmsh22", binary=False)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
