"""Draw the realisation whose leakage is nearest to the median, in the plane of the seal."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..base import Array, Flags
from ..base.leak_units import leakage_unit
from ..results.load_steps import load_names
from ..seal.layouts import RectangularLayout
from .drawing import MAP, Sheet, length_unit
from .map_panels import (
    CLOSED_COLOUR,
    POCKET_COLOUR,
    add_colour_bar,
    add_key,
    clip_to_decades,
    is_turned,
    map_row_height,
)
from .streamlines import draw_streamlines
from .style import styled

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Number of decades of the colour scale of the flow, below the largest flow.
_FLOW_DECADES = 4
#: Side of the square region around the largest flow that the last map shows, in widths of the seal. The second value is
#: for seals with many rows of tiles. In the larger region, the tiles of such a seal would be too small to be seen.
_DETAIL_SIDE, _SMALL_DETAIL_SIDE = 2.5, 1.15
#: Smallest number of rows of tiles for the smaller detail.
_MANY_ROWS = 8
#: If a panel has more tiles than this, they are drawn as pixels in vector pictures, so that the files stay small.
_MOST_VECTOR_TILES = 5000
#: A seal is drawn to scale up to this ratio of length to width.
_LONGEST_TO_SCALE = 8.0


@dataclass(frozen=True)
class _TileValues:
    """Data for a map of the seal, with a value for each tile.

    Attributes
    ----------
    name : name of the quantity, with its unit.
    values : value of each tile, (tiles,); NaN for tiles without a value.
    colours : name of the colour map.
    undefined : text of the legend for tiles without a value.
    decades : largest number of decades of a logarithmic colour scale; 0 for a linear colour scale.
    streamlines : colour of the streamlines that are drawn over the map; "" if no streamlines are drawn.
    """

    name: str
    values: Array
    colours: str
    undefined: str = "failed"
    decades: int = 0
    streamlines: str = ""


class _Panel(NamedTuple):
    """A map of the whole seal or of a region of the seal.

    low : lower left corner of the region that the map shows, (2,) [m].
    high : upper right corner of this region, (2,) [m].
    values : data of the map.
    """

    low: Array
    high: Array
    values: _TileValues


@styled
def realisation_figure(data: xarray.Dataset, step: int) -> Figure:
    """Draw maps of the realisation whose leakage is nearest to the median.

    One map shows the fluid pressure of the whole seal. The last map shows the flow near the point with the largest
    flow. The maps of pressure and flow contain streamlines; a thick line marks the streamline through the point with
    the largest flow.

    If the load has a pressure map, or if the seal has a form deviation, a map of the contact pressure is added. If the
    seal has a form deviation, maps of the form deviation and of the distance between the mean planes of the faces are
    added as well. A long seal is not drawn to scale. If the picture of a seal would be tall and narrow, the picture is
    turned by 90°.

    Parameters
    ----------
    data : Dataset
        Dataset of a run with a realisation.
    step : int
        Index of the load step.

    Returns
    -------
    Figure
    """
    corners = data["drawn_corners"].values  # m, (tile, corner, axis)
    flux = np.nan_to_num(data["drawn_flux"].values[step])  # (tile, axis)
    size = tuple(np.ptp(corners, axis=(0, 1)).tolist())
    has_x2_horizontal = is_turned(size)
    if has_x2_horizontal:
        corners = corners[..., ::-1]
        flux = flux[..., ::-1]
    flow = np.hypot(*flux.T)  # (tile,)
    low = corners.min(axis=(0, 1))  # lower left corner of the seal
    high = corners.max(axis=(0, 1))  # upper right corner
    centre_of_largest_flow = corners[np.argmax(flow)].mean(axis=0)
    detail_low, detail_high = _detail(data, corners, centre_of_largest_flow)
    shows_whole_seal = np.array_equal([detail_low, detail_high], [low, high])
    panels = [_Panel(low, high, values) for values in _whole_seal_values(data, step)]
    panels.append(_Panel(detail_low, detail_high, _flow_values(flow, shows_whole_seal)))

    simulated_fraction = data["drawn_corners"].attrs["part"]
    row_heights = [map_row_height(tuple((panel.high - panel.low).tolist())) for panel in panels]
    sheet = Sheet(row_heights, head=0.36 if simulated_fraction == 1 else 0.5)
    for row, panel in enumerate(panels):
        axes = sheet.panel(row, MAP)
        unit, unit_name = _set_up_axes(axes, panel)
        x_name, y_name = _axis_names(data, unit_name, has_x2_horizontal)
        axes.set(xlabel=x_name, ylabel=y_name)
        # tiles that are at least partly inside the panel
        is_right_of_low = corners.max(axis=1) >= panel.low  # (tile, axis)
        is_left_of_high = corners.min(axis=1) <= panel.high
        is_inside = (is_right_of_low & is_left_of_high).all(axis=1)
        _draw_tiles(axes, corners[is_inside] / unit, panel.values, is_inside)
        if panel.values.streamlines and flow.max() > 0:
            start = centre_of_largest_flow / unit
            draw_streamlines(axes, corners / unit, flux, panel.values.streamlines, start)
    number = data["drawn_corners"].attrs["realisation"]
    title = f"{load_names(data)[step]}\nrealisation {number}, nearest to the median"
    if not flow.max() > 0:
        title += ": no flow through the tiles"
    if simulated_fraction < 1:
        title += f"\nsimulated: {100 * simulated_fraction:.2g} % of the length of the seal"
    sheet.head(title)
    return sheet.figure


def _set_up_axes(axes: Axes, panel: _Panel) -> tuple[float, str]:
    """Set the limits and aspect ratio of a panel's axes; return the length unit [m] and its name."""
    width, height = panel.high - panel.low
    unit, unit_name = length_unit(max(width, height))
    left, bottom = panel.low / unit
    right, top = panel.high / unit
    axes.set_aspect("equal" if width <= _LONGEST_TO_SCALE * height else "auto")
    axes.set(xlim=(left, right), ylim=(bottom, top))
    return unit, unit_name


def _axis_names(data: xarray.Dataset, unit: str, has_x2_horizontal: bool) -> tuple[str, str]:
    """Return the names of the horizontal and the vertical axis."""
    names = f"$x$ [{unit}]", f"$y$ [{unit}]"
    if data.attrs["seal_kind"] == RectangularLayout.kind:
        names = f"$x_1$, inlet at 0 [{unit}]", f"$x_2$ along the seal [{unit}]"
    return names[::-1] if has_x2_horizontal else names


def _detail(data: xarray.Dataset, corners: Array, centre: Array) -> tuple[Array, Array]:
    """Return the lower left and the upper right corner of the region that the last map shows, two arrays (2,) [m].

    The region is a square around the point `centre`. A square that would extend beyond an edge of the seal is moved to
    end at the edge. If the seal is narrower than the square, the region is limited to the width of the seal.
    """
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    width = data.attrs["seal_size_m"][0]
    tile_side = np.median(np.ptp(corners, axis=1))
    has_many_rows = width > _MANY_ROWS * tile_side
    side = width * (_SMALL_DETAIL_SIDE if has_many_rows else _DETAIL_SIDE)
    if has_many_rows:
        # This square is hardly larger than the width of the seal. Its centre is the mean position of all tiles that are
        # closer to the point than this width, which lies between inlet and outlet.
        centres = corners.mean(axis=1)
        is_close = np.hypot(*(centres - centre).T) < width
        centre = centres[is_close].mean(axis=0)
    start = np.maximum(low, np.minimum(centre - side / 2, high - side))
    return start, np.minimum(start + side, high)


def _flow_values(flow: Array, shows_whole_seal: bool) -> _TileValues:
    """Return the data of the map of the flow, in a readable unit.

    flow : flow per unit width in each tile, (tiles,) [m²/s].
    """
    factor, unit = leakage_unit(flow.max()) if flow.max() > 0 else (1.0, "m²/s")
    name = f"flow per width [{unit}]"
    if not shows_whole_seal:
        name = f"flow per width, around the largest [{unit}]"
    return _TileValues(name, flow / factor, "magma", decades=_FLOW_DECADES, streamlines="#4FE3FF")


def _whole_seal_values(data: xarray.Dataset, step: int) -> list[_TileValues]:
    """Return the data for the maps of the whole seal: one map for each quantity."""
    maps = []
    has_form = "drawn_form" in data
    case = json.loads(data.attrs.get("case", "{}"))
    has_load_map = case.get("load", {}).get("map")
    if "drawn_contact_pressure" in data and (has_load_map or has_form):
        contact_pressure = data["drawn_contact_pressure"].values[step] / 1e6
        maps.append(_TileValues("contact pressure [MPa]", contact_pressure, "viridis"))
    fluid_pressure = data["drawn_fluid_pressure"].values[step] / 1e6
    maps.append(
        _TileValues(
            "fluid pressure [MPa]", fluid_pressure, "cividis", "pockets", streamlines="white"
        )
    )
    if has_form:
        form = data["drawn_form"].values * 1e6
        maps.append(_TileValues("form of the seal [µm]", form, "cividis"))
        separation = data["drawn_separation"].values[step] * 1e6
        maps.append(_TileValues("distance of mean planes [µm]", separation, "viridis"))
    return maps


def _draw_tiles(axes: Axes, corners: Array, tile_values: _TileValues, is_drawn: Flags) -> None:
    """Draw some tiles of a seal. The colour scale covers the values of all tiles, including tiles that are not drawn.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    corners : array (drawn tiles, corners, 2)
        Corners of the tiles that are drawn [mm].
    tile_values : _TileValues
        Values of all tiles.
    is_drawn : array of bool (tiles,)
        Whether each tile is drawn.
    """
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    values = tile_values.values
    finite = values[np.isfinite(values)]
    key = {}
    if finite.size < values.size:
        key[tile_values.undefined] = POCKET_COLOUR
    scale: Any = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0, 1)
    if tile_values.decades:
        values, scale = clip_to_decades(values, tile_values.decades)
        if (finite == 0).any():
            key["none"] = CLOSED_COLOUR
    tiles = PolyCollection(
        corners,  # type: ignore[arg-type]
        array=np.ma.masked_invalid(values[is_drawn]),
        cmap=colormaps[tile_values.colours].with_extremes(under=CLOSED_COLOUR, bad=POCKET_COLOUR),
        norm=scale,
        rasterized=len(corners) > _MOST_VECTOR_TILES,
        edgecolors="face",
        linewidths=0.1,
    )
    axes.add_collection(tiles, autolim=False)
    add_colour_bar(axes, tiles, tile_values.name)
    if key:
        add_key(axes, key)
