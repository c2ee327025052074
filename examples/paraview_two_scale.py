"""Draw two scales in ParaView: the pressure drop of the cells, and the contact pressure on all pixels.

To use the script as a macro (Macros > Import new macro), open `vtk/cells.pvd` of a results folder, select it,
and run the macro. To use it without a window, give the folder, the picture and the load step:

    xvfb-run -a pvpython examples/paraview_two_scale.py results/turned_seal view.png 8

It was tried with ParaView 5.11. The time is the index of the load step. Cells without flow are grey.
"""

import os
import sys

import paraview.simple as pv

PALETTES = "Magma (matplotlib)", "Inferno (matplotlib)"
GREY = [0.69, 0.69, 0.69]


def opened(folder):
    """Open the files of the cells and of the fields on all pixels."""
    paths = [os.path.join(folder, *name) for name in (("vtk", "cells.pvd"), ("fields.pvd",))]
    missing = [path for path in paths if not os.path.isfile(path)]
    if missing:
        need = 'a results folder of a two-scale study; [output] paraview = "vtu" (the default) writes vtk/cells.pvd'
        raise SystemExit(
            f"paraview_two_scale.py: there is no {' and no '.join(missing)}: give {need}"
        )
    return [pv.PVDReader(FileName=path) for path in paths]


def coloured(source, array, title, palette, view, time):
    """Show a source coloured by one of its arrays, with a colour bar for the range of values at this time."""
    source.UpdatePipeline(time)
    shown = pv.Show(source, view)
    shown.SetRepresentationType("Surface")
    pv.ColorBy(shown, array)
    shown.RescaleTransferFunctionToDataRange(False, True)
    shown.SetScalarBarVisibility(view, True)
    shown.Ambient, shown.Diffuse = 1.0, 0.0
    colours = pv.GetColorTransferFunction(array[1])
    colours.ApplyPreset(palette, True)
    colours.NanColor = GREY
    bar = pv.GetScalarBar(colours, view)
    bar.Title, bar.ComponentTitle = title, ""
    bar.Orientation, bar.WindowLocation = "Horizontal", "Lower Center"
    bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]


def look(view, bounds, time):
    """Point the camera at the surface from above, with x1 to the right."""
    x1, x2 = bounds[1], bounds[3]
    view.ViewTime = time
    view.UseColorPaletteForBackground, view.Background = 0, [1.0, 1.0, 1.0]
    view.OrientationAxesVisibility = 0
    view.InteractionMode = "2D"
    pv.Render(view)  # on the first rendering, ParaView moves the camera itself
    view.CameraParallelProjection = 1
    view.CameraFocalPoint = [x1 / 2, x2 / 2, 0]
    view.CameraPosition = [x1 / 2, x2 / 2, x2]
    view.CameraViewUp = [0, 1, 0]
    view.CameraParallelScale = 0.8 * max(x2, x1 / 2)
    pv.Render(view)


def draw(folder, time):
    """Make a layout with both views, and return it."""
    seal, contact = opened(folder)
    pv.GetAnimationScene().UpdateAnimationUsingDataTimeSteps()
    pv.GetAnimationScene().AnimationTime = time
    seal.UpdatePipeline(time)
    bounds = seal.GetDataInformation().GetBounds()
    layout = pv.CreateLayout(name="two scales")
    upper, lower = pv.CreateRenderView(), pv.CreateRenderView()
    pv.AssignViewToLayout(view=upper, layout=layout, hint=0)
    layout.SplitVertical(0, 0.5)
    pv.AssignViewToLayout(view=lower, layout=layout, hint=2)
    coloured(
        seal, ("CELLS", "drop_fraction"), "fraction of the pressure drop", PALETTES[0], upper, time
    )
    load = pv.PythonAnnotation(Input=seal)
    load.ArrayAssociation = "Field Data"
    load.Expression = "'%g MPa' % nominal_pressure_MPa[0]"
    pv.Show(load, upper).Color = [0.0, 0.0, 0.0]
    coloured(
        contact,
        ("CELLS", "contact_pressure_MPa"),
        "contact pressure [MPa]",
        PALETTES[1],
        lower,
        time,
    )
    for view in (upper, lower):
        look(view, bounds, time)
    return layout


def selected_folder():
    """Return the results folder of the file that is open in ParaView."""
    name = pv.GetActiveSource().FileName
    return os.path.dirname(os.path.dirname(name if isinstance(name, str) else name[0]))


if len(sys.argv) == 4:
    layout = draw(sys.argv[1], float(sys.argv[3]))
    layout.SetSize(1000, 1100)
    pv.SaveScreenshot(sys.argv[2], layout, ImageResolution=[1000, 1100])
else:
    draw(selected_folder(), pv.GetAnimationScene().AnimationTime)
