"""Draw the streamlines of the flow through the tiles of a seal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Number of points at which the flow is interpolated along the longer side of a panel, and smallest number along the
#: shorter side.
_MOST_POINTS, _FEWEST_POINTS = 160, 24
#: Width of streamlines where the flow is largest and where it vanishes [points].
_WIDEST, _NARROWEST = 1.0, 0.25
#: Density of the grid on which the path is followed. Its steps are at most a cell of it, a small part of a narrow ring.
_PATH_DENSITY = 6
#: Shortest streamline that is drawn, as a fraction of the panel. A narrow ring has short ones.
_SHORTEST = 0.01
#: Colour and width [points] of the path through the largest flow.
_PATH_COLOUR, _PATH_WIDTH = "#E6007E", 1.4


@dataclass(frozen=True)
class _FlowGrid:
    """Hold the flow of the tiles, interpolated at the points of a regular grid over a panel.

    Attributes
    ----------
    x, y : coordinates of the columns and rows.
    flux : components of the flow, (rows, columns, 2); NaN outside the seal.
    """

    x: Array
    y: Array
    flux: Array

    @property
    def magnitude(self) -> Array:
        """Magnitude of the flow, (rows, columns)."""
        return np.hypot(self.flux[..., 0], self.flux[..., 1])


def _interpolated(axes: Axes, corners: Array, flux: Array) -> _FlowGrid:
    """Interpolate the flow of the tiles, (tiles, 2), at the points of a grid over the limits of the axes.

    The flow at a point is the mean of the flow in the four nearest tiles, weighted by the inverse square of their
    distance. At points outside of all tiles it is NaN.
    """
    from scipy.spatial import cKDTree

    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    panel_width, panel_height = axes.get_position().size * axes.figure.get_size_inches()
    relative_sides = np.array([panel_width, panel_height]) / max(panel_width, panel_height)
    counts = np.maximum(np.round(_MOST_POINTS * relative_sides).astype(int), _FEWEST_POINTS)
    x = np.linspace(left, right, counts[0])
    y = np.linspace(bottom, top, counts[1])
    points = np.stack(np.meshgrid(x, y), axis=-1)  # (row, column, axis)
    centres = corners.mean(axis=1)
    half_size = np.ptp(corners, axis=1).max(axis=0) / 2
    # distances are measured in half sides of a tile, because the two sides may differ
    distance, nearest = cKDTree(centres / half_size).query(points / half_size, k=4)
    weights = 1 / np.maximum(distance, 0.3) ** 2
    interpolated = (weights[..., None] * flux[nearest % len(flux)]).sum(axis=2)
    interpolated /= weights.sum(axis=2)[..., None]
    interpolated[distance[..., 0] > 2**0.5 * 1.05] = np.nan
    return _FlowGrid(x, y, interpolated)


def draw_streamlines(axes: Axes, corners: Array, flux: Array, colour: str) -> None:
    """Draw the streamlines of the flow over a map of the seal. The lines are wider where the flow is larger.

    Parameters
    ----------
    axes : Axes
        Axes to draw into, whose limits must have been set.
    corners : array (tiles, corners, 2)
        Corners of the tiles.
    flux : array (tiles, 2)
        Flow per unit width in each tile, as components along the axes.
    colour : str
        Colour of the lines.
    """
    grid = _interpolated(axes, corners, flux)
    magnitude = np.nan_to_num(grid.magnitude)
    if not magnitude.max() > 0:
        return
    widths = _NARROWEST + (_WIDEST - _NARROWEST) * np.sqrt(magnitude / magnitude.max())
    axes.streamplot(
        grid.x,
        grid.y,
        *np.moveaxis(grid.flux, -1, 0),
        color=colour,
        linewidth=widths,
        density=_density(axes),
        minlength=_SHORTEST,
        arrowsize=0.5,
        arrowstyle="->",
    )
    _restore_limits(axes, grid)


def draw_main_path(axes: Axes, corners: Array, flux: Array, start: Array) -> None:
    """Draw the streamline through the point `start`, (2,), from the inlet to the outlet as a thick line."""
    grid = _interpolated(axes, corners, flux)
    is_inside = grid.x[0] <= start[0] <= grid.x[-1] and grid.y[0] <= start[1] <= grid.y[-1]
    if not is_inside:
        return
    streams = axes.streamplot(
        grid.x,
        grid.y,
        *np.moveaxis(grid.flux, -1, 0),
        start_points=start[None],
        color=_PATH_COLOUR,
        linewidth=_PATH_WIDTH,
        minlength=_SHORTEST,
        density=_PATH_DENSITY,
        arrowsize=0.7,
        zorder=3,
    )
    streams.lines.set_label("path")
    _restore_limits(axes, grid)


def _density(axes: Axes) -> tuple[float, float]:
    """Return densities of streamlines along both axes at which the distance between lines is about the same."""
    width, height = axes.get_position().size * axes.figure.get_size_inches()
    return max(0.35 * width, 0.3), max(0.35 * height, 0.3)


def _restore_limits(axes: Axes, grid: _FlowGrid) -> None:
    """Restore the limits of the axes, because `streamplot` changes them."""
    axes.set(xlim=(grid.x[0], grid.x[-1]), ylim=(grid.y[0], grid.y[-1]))
