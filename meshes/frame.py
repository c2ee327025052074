"""Write frame.msh: the frame round a rectangular window, in quadrilaterals.

Boundaries "inside" and "outside"; lengths in mm; gmsh's format 4.1. To write the file again, install gmsh with `pip
install '.[mesh]'` and run: python meshes/frame.py
"""

from __future__ import annotations

from pathlib import Path

WINDOW, BREADTH = (24.0, 16.0), 4.0
ACROSS, ALONG = 5, 1.0


def area() -> float:
    """Area of the frame."""
    return (WINDOW[0] + 2 * BREADTH) * (WINDOW[1] + 2 * BREADTH) - WINDOW[0] * WINDOW[1]


def write(path: Path) -> None:
    """Mesh the four sides of the frame, which are mitred, with gmsh."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    geo, mesh = gmsh.model.geo, gmsh.model.geo.mesh
    corners = [
        [
            geo.addPoint(sx * (WINDOW[0] / 2 + b), sy * (WINDOW[1] / 2 + b), 0)
            for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        for b in (0.0, BREADTH)
    ]
    sides = [[geo.addLine(ring[n], ring[(n + 1) % 4]) for n in range(4)] for ring in corners]
    mitres = [geo.addLine(corners[0][n], corners[1][n]) for n in range(4)]
    surfaces = []
    for n in range(4):
        loop = geo.addCurveLoop([sides[0][n], mitres[(n + 1) % 4], -sides[1][n], -mitres[n]])
        surfaces.append(geo.addPlaneSurface([loop]))
        for ring in sides:
            mesh.setTransfiniteCurve(ring[n], round(WINDOW[n % 2] / ALONG) + 1)
        mesh.setTransfiniteCurve(mitres[n], ACROSS + 1)
        mesh.setTransfiniteSurface(surfaces[-1])
        mesh.setRecombine(2, surfaces[-1])
    geo.synchronize()
    for name, curves in (("inside", sides[0]), ("outside", sides[1])):
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    gmsh.model.addPhysicalGroup(2, surfaces, name="seal")
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(path))
    gmsh.finalize()


if __name__ == "__main__":
    path = Path(__file__).with_suffix(".msh")
    write(path)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
