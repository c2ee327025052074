"""Open the fields of a run in a window of pyvista, with inlet, outlet and a scale bar.

Lengths in the window are in µm. The direction of the leakage, x1, points to the right, and x2 points upwards.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..base import AnyPath, Array, InputError, to_text
from ..results.load_steps import load_names
from ..results.pixel_fields import pixel_and_corner, stored_steps
from ..results.results import Results
from ..results.vtk_files import image
from ..seal.layouts import RectangularLayout
from .maps import default_step

if TYPE_CHECKING:
    import pyvista


class _ShownField(NamedTuple):
    """Describe a field that the window can show.

    Attributes
    ----------
    tiles : name of the dataset variable with a value for each tile of a realisation; "" if no such variable exists.
    heading : heading of the panel, with the unit of the shown values.
    unit : unit of the shown values, in SI units.
    colours : name of the colour map.
    """

    tiles: str
    heading: str
    unit: float
    colours: str


#: Fields by their names, in the order of the panels.
SHOWN_FIELDS = {
    "contact_pressure": _ShownField(
        "drawn_contact_pressure", "contact pressure [MPa]", 1e6, "inferno"
    ),
    "gap": _ShownField("", "gap [µm]", 1e-6, "viridis"),
    "fluid_pressure": _ShownField("drawn_fluid_pressure", "fluid pressure [MPa]", 1e6, "cividis"),
}
#: Largest length of the scale bar, as a fraction of the longer side of the field.
_BAR = 0.25
#: Width of a panel, and height of the window [pixel].
_PANEL_SIZE = 560, 760


def view_run(
    results: Results,
    *,
    step: int | None = None,
    field: str | None = None,
    seal: bool = False,
    picture: AnyPath | None = None,
) -> pyvista.Plotter:
    """Show the fields of a run at one load step, side by side.

    Parameters
    ----------
    results : Results
        Results with fields over the pixels, or with a realisation of the seal.
    step : int, optional
        Index of the load step; by default the step with the highest load at which the seal leaks.
    field : str, optional
        Name of a field in `SHOWN_FIELDS`; by default all fields are shown.
    seal : bool
        Whether to show the tiles of the realisation whose leakage is nearest to the median, instead of the pixels of
        the surface.
    picture : path, optional
        Picture file (.png). If `picture` is given, the view is written to this file, and no window is opened.

    Returns
    -------
    pyvista.Plotter
        The closed window.

    Raises
    ------
    InputError
        The field is unknown, the results have no data for the field or the load step, or the picture cannot be written.
    """
    data = results.dataset
    if field is not None and field not in SHOWN_FIELDS:
        raise InputError("field", f"'{field}'", f"one of {', '.join(SHOWN_FIELDS)}")
    number = default_step(data) if step is None else step
    if not 0 <= number < data.sizes["step"]:
        raise InputError("step", number, f"a number from 0 to {data.sizes['step'] - 1}")
    is_off_screen = window_settings(picture)
    names = [field] if field is not None else list(SHOWN_FIELDS)
    meshes = seal_meshes(results, number, names) if seal else surface_meshes(results, number, names)
    ends = ends_of_seal(results) if seal else None
    plotter = _window(meshes, load_names(data)[number], ends, off_screen=is_off_screen)
    show_or_write(plotter, picture)
    return plotter


def window_settings(picture: AnyPath | None) -> bool:
    """Check that a window can be opened, or that a picture can be rendered.

    Returns True if a picture is requested, so that the view is rendered off screen.

    Raises
    ------
    InputError
        The picture is not a .png file, or no picture is requested and the machine has no display.
    """
    if picture is not None and Path(picture).suffix.lower() != ".png":
        raise InputError("output", f"'{picture}'", "a file .png")
    has_display = sys.platform != "linux" or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if picture is None and not has_display:
        raise InputError("display", "none", "a display for the window, or a picture: -o view.png")
    if not has_display:
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    return picture is not None


def show_or_write(plotter: pyvista.Plotter, picture: AnyPath | None) -> None:
    """Open a window with the view, or write the view to a picture file, and then close the plotter."""
    if picture is None:
        plotter.show()
    else:
        plotter.screenshot(str(picture))
    plotter.close()


def surface_meshes(results: Results, step: int, names: list[str]) -> dict[str, Any]:
    """Make a pyvista image of each field over the pixels of the surface, with lengths in µm."""
    stored = stored_steps(results)
    if step not in stored:
        expected = "a run with output.fields = true, or --seal for a realisation of the seal"
        if stored:
            expected = f"one of the steps {', '.join(map(str, stored))}"
        raise InputError("step", f"{step}, for which no pixel fields are stored", expected)
    meshes = {}
    for name in names:
        values = results.pixels(name, step)
        (d1, d2), _corner = pixel_and_corner(values)
        shown = SHOWN_FIELDS[name].heading, _shown_values(values.values, name)
        meshes[name] = image((1e6 * d1, 1e6 * d2), (0.0, 0.0), [shown])
    return meshes


def seal_meshes(results: Results, step: int, names: list[str]) -> dict[str, Any]:
    """Make, for each field, a pyvista mesh of the tiles of the realisation, with lengths in µm."""
    import pyvista

    data = results.dataset
    if "drawn_corners" not in data:
        raise InputError("seal", "results without a realisation", "a stochastic run")
    corners = 1e6 * data["drawn_corners"].values  # (tile, corner, axis) [µm]
    points = np.pad(corners.reshape(-1, 2), ((0, 0), (0, 1)))  # z = 0
    corner_numbers = np.arange(len(points)).reshape(corners.shape[:2])
    meshes = {}
    for name in names:
        shown = SHOWN_FIELDS[name]
        if shown.tiles not in data:
            continue
        mesh = pyvista.PolyData.from_regular_faces(points, corner_numbers)
        values = np.asarray(data[shown.tiles].values)
        mesh.cell_data[shown.heading] = _shown_values(values[step], name).ravel()
        meshes[name] = mesh
    if not meshes:
        raise InputError(
            "field",
            ", ".join(names),
            "contact_pressure or fluid_pressure of a realisation",
        )
    return meshes


def _shown_values(values: Array, name: str) -> Array:
    """Convert the values of a field to the unit in which the field is shown.

    A gap of 0 is replaced by NaN, because pixels without a value are drawn in the colour for contact.
    """
    shown = np.asarray(values, float) / SHOWN_FIELDS[name].unit
    return np.where(shown > 0, shown, np.nan) if name == "gap" else shown


def _window(
    meshes: dict[str, Any], load: str, ends: Array | None, off_screen: bool
) -> pyvista.Plotter:
    """Make a window with one panel per field; the panels are side by side and share a camera.

    load : name of the load step, which is written into the first panel.
    ends : positions of the labels "inlet" and "outlet", (2, 3) [µm]. By default, the label "inlet" is to the left of
        the mesh, and the label "outlet" to the right of the mesh.
    """
    import pyvista

    width, height = _PANEL_SIZE
    plotter = pyvista.Plotter(
        shape=(1, len(meshes)), off_screen=off_screen, window_size=(width * len(meshes), height)
    )
    for column, (name, mesh) in enumerate(meshes.items()):
        shown = SHOWN_FIELDS[name]
        plotter.subplot(0, column)
        plotter.set_background("white")
        bar = {"title": shown.heading, "color": "black", "fmt": "%.3g", "vertical": False}
        values = np.asarray(mesh.cell_data[shown.heading])
        if np.isfinite(values).any():
            plotter.add_mesh(
                mesh,
                scalars=shown.heading,
                cmap=shown.colours,
                nan_color="lightgrey",
                lighting=False,
                show_scalar_bar=True,
                scalar_bar_args=bar,
            )
        else:
            mesh.clear_data()
            plotter.add_mesh(mesh, color="lightgrey", lighting=False, show_scalar_bar=False)
        mark_ends(plotter, ends if ends is not None else ends_of_bounds(mesh.bounds))
        add_scale_bar(plotter, mesh.bounds)
        plotter.view_xy()
        plotter.enable_parallel_projection()
        plotter.camera.zoom(0.85)
    plotter.subplot(0, 0)
    plotter.add_text(load, font_size=11, color="black", position="upper_left")
    plotter.link_views()
    return plotter


def ends_of_bounds(bounds: Any) -> Array:
    """Return the positions of the labels "inlet", to the left of a mesh, and "outlet", to the right, (2, 3) [µm]."""
    x_low, x_high, y_low, y_high = bounds[:4]
    middle = (y_low + y_high) / 2
    offset = 0.06 * max(x_high - x_low, y_high - y_low)
    return np.array([[x_low - offset, middle, 0.0], [x_high + offset, middle, 0.0]])


def ends_of_seal(results: Results) -> Array | None:
    """Return the positions of the labels "inlet" and "outlet", (2, 3) [µm].

    The positions are the centres of the tiles with the highest and the lowest fluid pressure. If the fluid pressure is
    unknown, the function returns None. The function also returns None for a strip, whose inlet is on the left and whose
    outlet is on the right.
    """
    data = results.dataset
    is_strip = data.attrs.get("seal_kind") == RectangularLayout.kind
    if is_strip or "drawn_fluid_pressure" not in data:
        return None
    pressure = np.asarray(data["drawn_fluid_pressure"].values)  # (step, tile)
    known_steps = np.flatnonzero(np.isfinite(pressure).any(axis=1))
    if not known_steps.size:
        return None
    tile_pressure = pressure[known_steps[0]].ravel()
    highest_and_lowest = [int(np.nanargmax(tile_pressure)), int(np.nanargmin(tile_pressure))]
    centres = data["drawn_corners"].values.mean(axis=1)  # (tile, axis) [m]
    return np.pad(1e6 * centres[highest_and_lowest], ((0, 0), (0, 1)))  # z = 0


def mark_ends(plotter: pyvista.Plotter, ends: Array) -> None:
    """Write "inlet" and "outlet" at two positions (2, 3) [µm]."""
    _add_texts(plotter, ends, ["inlet", "outlet"])


def add_scale_bar(plotter: pyvista.Plotter, bounds: Any) -> None:
    """Draw a scale bar below the field. The length of the bar is a round number, which is written below the bar."""
    import pyvista

    x_low, x_high, y_low, y_high = bounds[:4]
    length = round_length(_BAR * max(x_high - x_low, y_high - y_low))
    below = y_low - 0.06 * (y_high - y_low)
    line = pyvista.Line((x_low, below, 0.0), (x_low + length, below, 0.0))
    plotter.add_mesh(line, color="black", line_width=4)
    middle = np.array([[x_low + length / 2, below - 0.04 * (y_high - y_low), 0.0]])
    _add_texts(plotter, middle, [to_text(length * 1e-6, "m", 3)])


def _add_texts(plotter: pyvista.Plotter, positions: Array, texts: list[str]) -> None:
    """Write texts at positions (n, 3) [µm], in front of everything else."""
    plotter.add_point_labels(
        positions,
        texts,
        font_size=14,
        text_color="black",
        shape=None,
        show_points=False,
        always_visible=True,
        justification_horizontal="center",
    )


def round_length(longest: float) -> float:
    """Return the largest number not above `longest` that is 1, 2 or 5 times a power of ten.

    >>> round_length(96.0), round_length(0.7), round_length(20.0)
    (50.0, 0.5, 20.0)
    """
    power = 10.0 ** np.floor(np.log10(longest))
    factor = max(factor for factor in (1, 2, 5) if factor * power <= longest * (1 + 1e-9))
    return float(factor * power)
