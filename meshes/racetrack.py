"""Write racetrack.msh: a band round two half circles and two straight sides, in triangles.

Boundaries "inside" and "outside"; lengths in mm; gmsh's format 2.2. To write the file again, install gmsh with `pip
install '.[mesh]'` and run: python meshes/racetrack.py
"""

from __future__ import annotations

from math import pi
from pathlib import Path

INNER_RADIUS, BREADTH, STRAIGHT = 8.0, 4.0, 20.0
SIZE = 1.0


def area() -> float:
    """Area of the band."""
    outer = INNER_RADIUS + BREADTH
    return pi * (outer**2 - INNER_RADIUS**2) + 2 * BREADTH * STRAIGHT


def write(path: Path) -> None:
    """Mesh the band with gmsh."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    geo = gmsh.model.geo
    left, right = (geo.addPoint(x, 0, 0) for x in (-STRAIGHT / 2, STRAIGHT / 2))
    loops, named = [], {}
    for name, radius in (("inside", INNER_RADIUS), ("outside", INNER_RADIUS + BREADTH)):
        corners = [
            geo.addPoint(x * STRAIGHT / 2, y * radius, 0, SIZE)
            for x, y in ((1, -1), (1, 1), (-1, 1), (-1, -1))
        ]
        ends = [geo.addPoint(x * (STRAIGHT / 2 + radius), 0, 0, SIZE) for x in (1, -1)]
        curves = [
            geo.addCircleArc(corners[0], right, ends[0]),
            geo.addCircleArc(ends[0], right, corners[1]),
            geo.addLine(corners[1], corners[2]),
            geo.addCircleArc(corners[2], left, ends[1]),
            geo.addCircleArc(ends[1], left, corners[3]),
            geo.addLine(corners[3], corners[0]),
        ]
        loops.append(geo.addCurveLoop(curves))
        named[name] = curves
    surface = geo.addPlaneSurface([loops[1], loops[0]])
    geo.synchronize()
    for name, curves in named.items():
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    gmsh.model.addPhysicalGroup(2, [surface], name="seal")
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(path))
    gmsh.finalize()


if __name__ == "__main__":
    path = Path(__file__).with_suffix(".msh")
    write(path)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
