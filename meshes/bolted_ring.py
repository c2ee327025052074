"""Write bolted_ring.msh: a full-face gasket with four bolt holes, in triangles.

Boundaries "bore", "rim" and "bolts"; lengths in mm; gmsh's format 4.1. To write the file again, install gmsh with `pip
install '.[mesh]'` and run: python meshes/bolted_ring.py
"""

from __future__ import annotations

from math import cos, pi, sin
from pathlib import Path

BORE, RIM = 10.0, 25.0
BOLTS, BOLT_CIRCLE, BOLT_HOLE = 4, 18.0, 2.75
SIZE = 2.0


def holes() -> list[tuple[float, float]]:
    """Centres of the bolt holes."""
    angles = [2 * pi * (n + 0.5) / BOLTS for n in range(BOLTS)]
    return [(BOLT_CIRCLE * cos(a), BOLT_CIRCLE * sin(a)) for a in angles]


def area() -> float:
    """Area of the gasket."""
    return pi * (RIM**2 - BORE**2 - BOLTS * BOLT_HOLE**2)


def write(path: Path) -> None:
    """Mesh the gasket with gmsh."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    discs = [occ.addDisk(0, 0, 0, BORE, BORE)]
    discs += [occ.addDisk(x, y, 0, BOLT_HOLE, BOLT_HOLE) for x, y in holes()]
    (surface,), _ = occ.cut([(2, occ.addDisk(0, 0, 0, RIM, RIM))], [(2, disc) for disc in discs])
    occ.synchronize()
    named: dict[str, list[int]] = {"bore": [], "rim": [], "bolts": []}
    for _, curve in gmsh.model.getBoundary([surface], oriented=False):
        x1, y1, _, x2, y2, _ = gmsh.model.getBoundingBox(1, curve)
        middle, radius = ((x1 + x2) / 2, (y1 + y2) / 2), (x2 - x1) / 2
        name = "bolts" if abs(middle[0]) > 1 else "rim" if radius > (BORE + RIM) / 2 else "bore"
        named[name].append(curve)
    for name, curves in named.items():
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    gmsh.model.addPhysicalGroup(2, [surface[1]], name="seal")
    gmsh.option.setNumber("Mesh.MeshSizeMax", SIZE)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 16)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.refine()  # new nodes lie on the circles
    gmsh.write(str(path))
    gmsh.finalize()


if __name__ == "__main__":
    path = Path(__file__).with_suffix(".msh")
    write(path)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
