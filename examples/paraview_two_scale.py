"""The two-scale view in ParaView: where the pressure drops in the pieces, contact pressure over all pixels.

As a macro (Macros > Import new macro): open `vtk/pieces.pvd` of a results folder, select it, run the macro. Without a
window, the last argument being the load step:

    xvfb-run -a pvpython examples/paraview_two_scale.py results/turned_seal view.png 8

It was tried with ParaView 5.11. Time is the index of the load step. Where nothing flows, pieces are grey.
"""

import os
import sys

import paraview.simple as pv

PALETTES = "Magma (matplotlib)", "Inferno (matplotlib)"
GREY = [0.69, 0.69, 0.69]


def opened(folder):
    """The pieces of the face and the fields over all pixels."""
    paths = [os.path.join(folder, *name) for name in (("vtk", "pieces.pvd"), ("fields.pvd",))]
    missing = [path for path in paths if not os.path.isfile(path)]
    if missing:
        need = 'a results folder of a two-scale study; [output] paraview = "vtu" (the default) writes vtk/pieces.pvd'
        raise SystemExit(
            f"paraview_two_scale.py: there is no {' and no '.join(missing)}: give {need}"
        )
    return [pv.PVDReader(FileName=path) for path in paths]


def coloured(source, array, title, palette, view, time):
    """Show a source with a colour bar over the range at this time."""
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
    """From above, x1 to the right."""
    x1, x2 = bounds[1], bounds[3]
    view.ViewTime = time
    view.UseColorPaletteForBackground, view.Background = 0, [1.0, 1.0, 1.0]
    view.OrientationAxesVisibility = 0
    view.InteractionMode = "2D"
    pv.Render(view)  # the first time ParaView moves the camera itself
    view.CameraParallelProjection = 1
    view.CameraFocalPoint = [x1 / 2, x2 / 2, 0]
    view.CameraPosition = [x1 / 2, x2 / 2, x2]
    view.CameraViewUp = [0, 1, 0]
    view.CameraParallelScale = 0.8 * max(x2, x1 / 2)
    pv.Render(view)


def draw(folder, time):
    """A layout with both views; returns it."""
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
    """Results folder of the file that is open in ParaView."""
    name = pv.GetActiveSource().FileName
    return os.path.dirname(os.path.dirname(name if isinstance(name, str) else name[0]))


if len(sys.argv) == 4:
    layout = draw(sys.argv[1], float(sys.argv[3]))
    layout.SetSize(1000, 1100)
    pv.SaveScreenshot(sys.argv[2], layout, ImageResolution=[1000, 1100])
else:
    draw(selected_folder(), pv.GetAnimationScene().AnimationTime)
