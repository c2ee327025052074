"""Draw the results of a run at two scales: the pressure drop of the cells, and the contact pressure on all pixels.

    python examples/two_scale_view.py results/turned_seal view.png

The script reads `vtk/cells.pvd` and `fields.pvd`. On a machine without a display, set
VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow (or vtkOSOpenGLRenderWindow). `paraview_two_scale.py` draws the
same view.
"""

import sys
from pathlib import Path

import numpy as np
import pyvista as pv

#: Colours of the pressure drop and of the contact pressure.
COLOURS = "magma", "inferno"


def read(path, step):
    """Read the mesh at a load step, with lengths in µm."""
    reader = pv.get_reader(path)
    reader.set_active_time_value(step)
    (mesh,) = reader.read()
    return mesh.scale(1e6, inplace=False)


def draw(folder, step):
    """Return a plotter with both views at a load step, with the inlet at the left and x1 to the right."""
    folder = Path(folder)
    seal, face = read(folder / "vtk" / "cells.pvd", step), read(folder / "fields.pvd", step)
    x1, x2 = seal.bounds[1], seal.bounds[3]
    stacked = x1 > x2
    plotter = pv.Plotter(
        shape=(2, 1) if stacked else (1, 2), off_screen=True, window_size=(1000, 1100)
    )
    seal["pressure drop [%]"] = 100 * seal["drop_fraction"]
    face["contact pressure [MPa]"] = face["contact_pressure_MPa"]
    for n, (mesh, name) in enumerate(
        ((seal, "pressure drop [%]"), (face, "contact pressure [MPa]"))
    ):
        plotter.subplot(*((n, 0) if stacked else (0, n)))
        plotter.set_background("white")
        bar = {
            "title": f"{name}\n",
            "color": "black",
            "position_x": 0.25,
            "position_y": 0.02,
            "width": 0.5,
            "fmt": "%.4g",
        }
        plotter.add_mesh(
            mesh,
            scalars=name,
            cmap=COLOURS[n],
            nan_color="grey",
            lighting=False,
            scalar_bar_args=bar,
            copy_mesh=True,
        )
        # the view from above, with x1 to the right
        centre = x1 / 2, x2 / 2
        plotter.camera_position = [(*centre, x1), (*centre, 0), (0, 1, 0)]
        plotter.enable_parallel_projection()
        width, height = plotter.renderer.GetSize()
        plotter.camera.parallel_scale = 0.7 * max(x2, x1 * height / width)
    plotter.subplot(0, 0)
    load, peak = (
        float(seal.field_data[name][0]) for name in ("nominal_pressure_MPa", "unloaded_from_MPa")
    )
    branch = "loading" if np.isnan(peak) else f"unloading from {peak:g} MPa"
    plotter.add_text(f"{load:g} MPa, {branch}", font_size=12, color="black")
    return plotter


def tightest_leaking_step(folder):
    """Return the load step with the highest load that still leaks."""
    import femseal as fs

    data = fs.open_results(folder).dataset
    leaking = np.flatnonzero(np.nan_to_num(data["leakage_two_scale"].values) != 0)
    return int(leaking[np.argmax(data["nominal_pressure"].values[leaking])]) if leaking.size else 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(
            "give two arguments: a results folder of the two-scale method, and the picture to write"
        )
    source, picture = sys.argv[1:]
    draw(source, tightest_leaking_step(source)).screenshot(picture)
