"""Draw the streamlines of the flow through the tiles of a seal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, Flags
from .drawing import panel_size

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Number of points at which the flow is interpolated along the longer side of a panel, and smallest number along the
#: shorter side.
_MOST_POINTS, _FEWEST_POINTS = 160, 24
#: Number of nearby tiles for which it is tested whether they contain a given point of the grid.
_NEAREST_TILES = 12
#: Width of streamlines where the flow is largest and where it vanishes [points].
_WIDEST, _NARROWEST = 1.0, 0.25
#: Density of the grid on which the thick streamline is computed. The steps along the line are at most a cell of this
#: grid, so that they are short compared with the width of a narrow ring.
_PATH_DENSITY = 6
#: Shortest streamline that is drawn, as a fraction of the panel. The streamlines of a narrow ring are short.
_SHORTEST = 0.01
#: Colour and width [points] of the path through the largest flow.
_PATH_COLOUR, _PATH_WIDTH = "#E6007E", 1.4


#: Smallest distance from the centre of a tile that is used to compute weights, in half sides of a tile. The smallest
#: distance limits the weight of a single tile.
_LEAST_DISTANCE = 0.3
#: Streamlines per inch of the panel, and smallest value, in the unit of the argument `density` of `streamplot`.
_DENSITY_PER_INCH, _LEAST_DENSITY = 0.35, 0.3


@dataclass(frozen=True)
class _FlowGrid:
    """Flow of the tiles, interpolated at the points of a regular grid over a panel.

    Attributes
    ----------
    x : coordinates of the columns, (columns,).
    y : coordinates of the rows, (rows,).
    flux : components of the flow per unit width, (rows, columns, 2); NaN outside the seal.
    """

    x: Array
    y: Array
    flux: Array

    @property
    def magnitude(self) -> Array:
        """Magnitude of the flow, (rows, columns)."""
        return np.hypot(self.flux[..., 0], self.flux[..., 1])


def _interpolate_flow(axes: Axes, corners: Array, flux: Array) -> _FlowGrid:
    """Interpolate the flow of the tiles at the points of a regular grid that covers the axes.

    The flow at a point is the weighted mean of the flow in the four nearest tiles. The weight of a tile is the inverse
    square of the distance between the point and the centre of the tile. At points outside all tiles the flow is NaN,
    so that streamlines end at the edges of the seal. Because a narrow ring may be only a few grid steps wide, points
    that are less than one grid step away from a tile do not count as outside.

    Parameters
    ----------
    axes : Axes
        Axes whose limits have been set.
    corners : array (tiles, corners, 2)
        Corners of the tiles.
    flux : array (tiles, 2)
        Flow per unit width in each tile.
    """
    from scipy.spatial import cKDTree

    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    relative_sides = panel_size(axes) / panel_size(axes).max()
    counts = np.maximum(np.round(_MOST_POINTS * relative_sides).astype(int), _FEWEST_POINTS)
    x = np.linspace(left, right, counts[0])
    y = np.linspace(bottom, top, counts[1])
    points = np.stack(np.meshgrid(x, y), axis=-1)  # (row, column, axis)
    centres = corners.mean(axis=1)
    half_size = np.ptp(corners, axis=1).max(axis=0) / 2
    # Distances are measured in half sides of a tile, because the two sides may differ. Both arrays have the axes (row,
    # column, neighbour).
    count = max(min(_NEAREST_TILES, len(flux)), 4)
    distance, nearest = cKDTree(centres / half_size).query(points / half_size, k=count)
    # If there are fewer than four tiles, the missing neighbours have an infinite distance, and thus the weight 0. Their
    # index is len(flux), which becomes a valid index here.
    nearest %= len(flux)
    grid_step = max(x[1] - x[0], y[1] - y[0])
    is_outside = ~_lies_in_a_tile(points, corners[nearest], grid_step)
    distance, nearest = distance[..., :4], nearest[..., :4]
    weights = 1 / np.maximum(distance, _LEAST_DISTANCE) ** 2
    interpolated = (weights[..., None] * flux[nearest]).sum(axis=2)  # (row, column, axis)
    interpolated /= weights.sum(axis=2)[..., None]
    interpolated[is_outside] = np.nan
    return _FlowGrid(x, y, interpolated)


def _lies_in_a_tile(points: Array, corners: Array, tolerance: float) -> Flags:
    """Return whether each point lies in a tile or within the distance `tolerance` of one.

    For each point, only some tiles near the point are tested. A point lies in a convex tile if it is on the same side
    of all edges of the tile.

    Parameters
    ----------
    points : array (rows, columns, 2)
        Coordinates of the points.
    corners : array (rows, columns, tiles, corners, 2)
        Corners of the tiles near each point, in order around the tile.
    tolerance : float
        Largest distance from a tile at which a point still counts as inside.
    """
    edges = np.roll(corners, -1, axis=-2) - corners
    to_point = points[:, :, None, None] - corners
    cross = edges[..., 0] * to_point[..., 1] - edges[..., 1] * to_point[..., 0]
    margin = tolerance * np.hypot(edges[..., 0], edges[..., 1])
    is_inside = (cross >= -margin).all(axis=-1) | (cross <= margin).all(axis=-1)
    return np.asarray(is_inside.any(axis=-1))


def draw_streamlines(
    axes: Axes, corners: Array, flux: Array, colour: str, start: Array | None = None
) -> None:
    """Draw the streamlines of the flow over a map of the seal. Streamlines are thicker where the flow is stronger.

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
    start : array (2,), optional
        Point whose streamline is drawn as a thick line from the inlet to the outlet, if the point is in the panel.
    """
    grid = _interpolate_flow(axes, corners, flux)
    magnitude = np.nan_to_num(grid.magnitude)
    if not magnitude.max() > 0:
        return
    flow = grid.x, grid.y, grid.flux[..., 0], grid.flux[..., 1]
    widths = _NARROWEST + (_WIDEST - _NARROWEST) * np.sqrt(magnitude / magnitude.max())
    axes.streamplot(
        *flow,
        color=colour,
        linewidth=widths,
        density=_density(axes),
        minlength=_SHORTEST,
        arrowsize=0.5,
        arrowstyle="->",
    )
    low, high = (grid.x[0], grid.y[0]), (grid.x[-1], grid.y[-1])
    if start is not None and np.all(start >= low) and np.all(start <= high):
        streams = axes.streamplot(
            *flow,
            start_points=start[None],
            color=_PATH_COLOUR,
            linewidth=_PATH_WIDTH,
            minlength=_SHORTEST,
            density=_PATH_DENSITY,
            arrowsize=0.7,
            zorder=3,
        )
        streams.lines.set_label("path")
    # `streamplot` has changed the limits
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def _density(axes: Axes) -> tuple[float, float]:
    """Return the argument `density` of `streamplot`, which sets the number of streamlines along each axis.

    The density along each axis is proportional to the side of the panel. The distance between streamlines is therefore
    about the same along both axes.
    """
    along_x, along_y = np.maximum(_DENSITY_PER_INCH * panel_size(axes), _LEAST_DENSITY)
    return along_x, along_y
