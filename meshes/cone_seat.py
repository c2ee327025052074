"""Write cone_seat.msh: the seat of a cone of half angle 45°, unrolled into the plane, in quadrilaterals.

A cone of half angle α unrolls into a sector with the angle 2π sin α, whose radii are distances from the apex. The
boundaries are "small" and "large". The cut is closed, which changes nothing as long as the fluid flows along the
generators. Lengths are in mm, in gmsh's format 2.2. To write the file again, run: python meshes/cone_seat.py
"""

from __future__ import annotations

from math import pi, sin
from pathlib import Path

import meshio
import numpy as np
from skfem import MeshQuad

#: Radii of the seat about its axis, and half angle of the cone.
SMALL_RADIUS, LARGE_RADIUS, HALF_ANGLE = 5.0, 6.0, pi / 4


def area() -> float:
    """Return the area of the seat, which is a truncated cone."""
    return pi * (LARGE_RADIUS**2 - SMALL_RADIUS**2) / sin(HALF_ANGLE)


def unrolled(n_s: int = 6, n_φ: int = 120) -> meshio.Mesh:
    """Sector of n_s × n_φ quadrilaterals with physical groups for gmsh."""
    from_tip = np.array([SMALL_RADIUS, LARGE_RADIUS]) / sin(HALF_ANGLE)
    grid = MeshQuad.init_tensor(
        np.linspace(*from_tip, n_s + 1), np.linspace(0, 2 * pi * sin(HALF_ANGLE), n_φ + 1)
    )
    s, φ = grid.p
    facets = grid.facets[:, grid.boundary_facets()]
    lines = [facets[:, (s[facets] == end).all(axis=0)].T for end in from_tip]
    cells = [("line", lines[0]), ("line", lines[1]), ("quad", grid.t.T)]
    tags = [np.full(len(block), tag) for tag, (_, block) in enumerate(cells, start=1)]
    return meshio.Mesh(
        np.column_stack([s * np.cos(φ), s * np.sin(φ), np.zeros(s.size)]),
        cells,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"small": np.array((1, 1)), "large": np.array((2, 1)), "seal": np.array((3, 2))},
    )


def write(path: Path) -> None:
    """Write the sector."""
    meshio.write(path, unrolled(), file_format="gmsh22", binary=False)


if __name__ == "__main__":
    path = Path(__file__).with_suffix(".msh")
    write(path)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
