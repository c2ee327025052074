"""Draw a realisation in the plane of the seal: the one whose leakage is nearest to the median."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags
from ..base.leak_units import leakage_unit
from ..results.load_steps import load_names
from .drawing import MAP, Sheet, label_axes, set_panel_title
from .map_panels import (
    CLOSED,
    POCKET,
    add_colour_bar,
    clip_to_decades,
    map_row_height,
    on_its_side,
)

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Decades below the largest flow that its map distinguishes.
_FLOW_DECADES = 4
#: Side of the detail around the largest flow, as a multiple of the breadth of the seal.
_DETAIL_SIDE = 2.5
#: Ratio of length to breadth up to which a seal is drawn to scale.
_LONGEST_TO_SCALE = 8.0


@dataclass(frozen=True)
class _TileValues:
    """Values of the tiles of a seal that are drawn as a map.

    title : what they are, with the unit. values : array (tiles,), NaN where unknown. colours : name of a colour map.
    undefined : what tiles without a value are. decades : largest number of decades of a logarithmic scale; 0 makes the
    scale linear.
    """

    title: str
    values: Array
    colours: str
    undefined: str = "failed"
    decades: int = 0


def realisation_figure(data: xarray.Dataset, step: int) -> Figure:
    """Draw the fluid pressure in the realisation nearest to the median, and the flow around its largest value.

    If the load has a map or the seal has a form, the contact pressure of the tiles, the form, and the distance between
    the mean planes are drawn too. A long seal is not drawn to scale, and a high one is turned on its side.

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
    corners = data["drawn_corners"].values * 1e3  # mm, (tile, corner, axis)
    size = tuple(np.ptp(corners, axis=(0, 1)).tolist())
    is_turned = on_its_side(size) != size
    if is_turned:
        corners = corners[..., ::-1]
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    flow = np.nan_to_num(np.hypot(*data["drawn_flux"].values[step].T))  # (tiles,)
    detail_low, detail_high = _detail(data, corners, corners[np.argmax(flow)].mean(axis=0))
    shows_whole_seal = np.array_equal([detail_low, detail_high], [low, high])
    panels = [(low, high, values) for values in _whole_seal_values(data, step)]
    panels.append((detail_low, detail_high, _flow_values(flow, shows_whole_seal)))

    names = ["x [mm]", "y [mm]"]
    if data.attrs["seal"].startswith("a strip"):
        names = ["x1, inlet at 0 [mm]", "x2 along the seal [mm]"]
    if is_turned:
        names.reverse()
    simulated_fraction = data["drawn_corners"].attrs["part"]
    row_heights = [map_row_height(tuple((end - start).tolist())) for start, end, _ in panels]
    sheet = Sheet(row_heights, head=0.3 if simulated_fraction == 1 else 0.5)
    for row, (start, end, values) in enumerate(panels):
        axes = sheet.panel(row, MAP)
        axes.set(xlim=(start[0], end[0]), ylim=(start[1], end[1]))
        width, height = end - start
        axes.set_aspect("equal" if width <= _LONGEST_TO_SCALE * height else "auto")
        label_axes(axes, names)
        # tiles that are at least partly inside the panel
        is_inside = ((corners.max(axis=1) >= start) & (corners.min(axis=1) <= end)).all(axis=1)
        _draw_tiles(axes, corners[is_inside], values, is_inside)
    number = data["drawn_corners"].attrs["realisation"]
    title = f"{load_names(data)[step]}; realisation {number}, the nearest to the median"
    if simulated_fraction < 1:
        title += f"\nsimulated: {100 * simulated_fraction:.2g} % of the length of the seal"
    sheet.head(title)
    return sheet.figure


def _detail(data: xarray.Dataset, corners: Array, centre: Array) -> tuple[Array, Array]:
    """Find the lower left and upper right corner of the detail around a point, within the seal [mm] (axis,)."""
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    side = _DETAIL_SIDE * data.attrs["seal_size_m"][0] * 1e3
    start = np.maximum(low, np.minimum(centre - side / 2, high - side))
    return start, np.minimum(start + side, high)


def _flow_values(flow: Array, shows_whole_seal: bool) -> _TileValues:
    """Prepare the map of the flow per width (tiles,) [m²/s]."""
    factor, unit = leakage_unit(flow.max()) if flow.max() > 0 else (1.0, "m²/s")
    title = f"flow per width [{unit}]"
    if not shows_whole_seal:
        title += " around its largest value"
    return _TileValues(title, flow / factor, "magma", decades=_FLOW_DECADES)


def _whole_seal_values(data: xarray.Dataset, step: int) -> list[_TileValues]:
    """List the values that are drawn over the whole seal."""
    maps = []
    has_form = "drawn_form" in data
    has_load_map = json.loads(data.attrs.get("case", "{}")).get("load", {}).get("map")
    if "drawn_contact_pressure" in data and (has_load_map or has_form):
        contact_pressure = data["drawn_contact_pressure"].values[step] / 1e6
        maps.append(_TileValues("contact pressure [MPa]", contact_pressure, "viridis"))
    fluid_pressure = data["drawn_fluid_pressure"].values[step] / 1e6
    maps.append(_TileValues("fluid pressure [MPa]", fluid_pressure, "cividis", "pockets"))
    if has_form:
        form = data["drawn_form"].values * 1e6
        maps.append(_TileValues("form of the seal [µm]", form, "cividis"))
        separation = data["drawn_separation"].values[step] * 1e6
        maps.append(_TileValues("distance of mean planes [µm]", separation, "viridis"))
    return maps


def _draw_tiles(axes: Axes, corners: Array, tile_values: _TileValues, is_drawn: Flags) -> None:
    """Draw some of the tiles of a seal, in colours whose scale covers all of them.

    Parameters
    ----------
    corners : array (drawn tiles, corners, 2)
        Corners of the tiles that are drawn [mm].
    tile_values : _TileValues
        Values of all tiles.
    is_drawn : array of bool (tiles,)
        Which tiles are drawn.
    """
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    values = tile_values.values
    finite = values[np.isfinite(values)]
    titles = [tile_values.title]
    if finite.size < values.size:
        titles.append(f"white: {tile_values.undefined}")
    scale: Any = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0, 1)
    if tile_values.decades:
        values, scale = clip_to_decades(values, tile_values.decades)
        if (finite == 0).any():
            titles.append("grey: none")
    tiles = PolyCollection(
        corners,  # type: ignore[arg-type]
        array=np.ma.masked_invalid(values[is_drawn]),
        cmap=colormaps[tile_values.colours].with_extremes(under=CLOSED, bad=POCKET),
        norm=scale,
        rasterized=True,
        edgecolors="face",
        linewidths=0.1,
    )
    axes.add_collection(tiles, autolim=False)
    add_colour_bar(axes, tiles)
    set_panel_title(axes, "; ".join(titles))
