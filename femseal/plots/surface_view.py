"""Show the heights of a surface in three dimensions, in a window of pyvista or as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import AnyPath, Array, InputError, Pair, validate
from ..results.results import Results
from ..topography import Topography
from .map_panels import reduced
from .maps import sides
from .view import (
    add_scale_bar,
    ends_of_bounds,
    mark_ends,
    round_length,
    show_or_write,
    window_settings,
)

if TYPE_CHECKING:
    import pyvista

#: Height of the surface in the window, as a fraction of its longer side, unless the exaggeration is given.
_RELATIVE_HEIGHT = 0.12
#: Direction from the surface to the camera: x1 points to the right.
_CAMERA = (-0.35, -1.0, 0.9)
#: Size of the window [pixel].
_WINDOW = 1100, 800


def view_surface(
    surface: Topography | Results,
    *,
    exaggeration: float | None = None,
    picture: AnyPath | None = None,
) -> pyvista.Plotter:
    """Show the heights of a surface in three dimensions.

    The leakage flows along x1, from the inlet to the outlet. Lengths are in µm. The heights are exaggerated, because
    roughness is much smaller than the sides of the surface.

    Parameters
    ----------
    surface : Topography or Results
        Surface without undefined points; or results of a run, whose surface is shown.
    exaggeration : float, optional
        Factor by which the heights are multiplied, for example 1 for true proportions. By default, the factor is chosen
        so that the range of the heights appears as about an eighth of the longer side of the surface.
    picture : path, optional
        Picture file (.png). If `picture` is given, the view is written to this file, and no window is opened.

    Returns
    -------
    pyvista.Plotter
        The closed window.

    Raises
    ------
    InputError
        The picture cannot be written, the machine has no display, or the surface has undefined points.
    """
    is_off_screen = window_settings(picture)
    mesh, factor = surface_mesh(*_heights_and_sides(surface), exaggeration)
    import pyvista

    plotter = pyvista.Plotter(off_screen=is_off_screen, window_size=_WINDOW)
    plotter.set_background("white")
    plotter.add_mesh(
        mesh,
        scalars="height [µm]",
        cmap="viridis",
        smooth_shading=True,
        scalar_bar_args={
            "title": "height [µm]",
            "color": "black",
            "fmt": "%.3g",
            "vertical": True,
            "position_x": 0.88,
            "position_y": 0.25,
        },
    )
    plotter.add_text(f"heights × {factor:g}", font_size=11, color="black", position="upper_left")
    mark_ends(plotter, ends_of_bounds(mesh.bounds))
    add_scale_bar(plotter, mesh.bounds)
    plotter.view_vector(_CAMERA, viewup=(0, 0, 1))
    show_or_write(plotter, picture)
    return plotter


def surface_mesh(heights: Array, size: Pair, exaggeration: float | None) -> tuple[Any, float]:
    """Make a surface mesh in µm with exaggerated heights; return the mesh and the factor of exaggeration.

    heights : heights of the surface (n1, n2) [m].
    size : sides of the surface along x1 and x2 [m].
    exaggeration : factor by which the heights are multiplied; if None, the function chooses a factor.
    """
    import pyvista

    heights = 1e6 * reduced(heights)
    if not np.isfinite(heights).all():
        expected = "a surface without undefined points, see fs.condition"
        raise InputError("surface", "undefined points", expected)
    spacing = [1e6 * side / n for side, n in zip(size, heights.shape, strict=True)]
    height = float(np.ptp(heights))
    if exaggeration is not None:
        factor = validate.number("exaggeration", exaggeration)
    else:
        factor = round_length(_RELATIVE_HEIGHT * 1e6 * max(size) / height) if height else 1.0
    x, y = ((np.arange(n) + 0.5) * step for n, step in zip(heights.shape, spacing, strict=True))
    grid = pyvista.StructuredGrid(*np.meshgrid(x, y, indexing="ij"), factor * heights)
    grid.point_data["height [µm]"] = heights.ravel(order="F")
    return grid, factor


def _heights_and_sides(surface: Topography | Results) -> tuple[Array, Pair]:
    """Return the heights of a surface (n1, n2) [m], and its sides along x1 and x2 [m]."""
    if isinstance(surface, Topography):
        return surface.heights, surface.size
    data = surface.dataset
    return data["face_height"].values.astype(float), sides(data)
