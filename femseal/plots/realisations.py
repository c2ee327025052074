"""Draw the realisation whose leakage is nearest to the median, in the plane of the seal."""

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

#: Number of decades below the largest flow that the colour scale of the flow covers.
_FLOW_DECADES = 4
#: Side of the detail around the largest flow, as a multiple of the width of the seal.
_DETAIL_SIDE = 2.5
#: A seal is drawn to scale up to this ratio of length to width.
_LONGEST_TO_SCALE = 8.0


@dataclass(frozen=True)
class _TileValues:
    """Values of the tiles of a seal that are drawn as a map.

    Attributes
    ----------
    title : name of the quantity, with its unit.
    values : value of each tile, (tiles,), NaN where there is none.
    colours : name of the colour map.
    undefined : explanation of tiles without a value.
    decades : largest number of decades of a logarithmic colour scale; 0 for a linear scale.
    """

    title: str
    values: Array
    colours: str
    undefined: str = "failed"
    decades: int = 0


def realisation_figure(data: xarray.Dataset, step: int) -> Figure:
    """Draw the fluid pressure in the realisation nearest to the median, and the flow around its maximum.

    The contact pressure of the tiles is drawn too if the load has a pressure map or the seal has a form. For a seal
    with a form, the form and the distance between the mean planes are drawn as well. A long seal is not drawn to scale.
    A seal whose picture would be high and narrow is turned on its side.

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
    flow = np.nan_to_num(np.hypot(*data["drawn_flux"].values[step].T))  # magnitude (tiles,)
    centre_of_largest_flow = corners[np.argmax(flow)].mean(axis=0)
    detail_low, detail_high = _detail(data, corners, centre_of_largest_flow)
    shows_whole_seal = np.array_equal([detail_low, detail_high], [low, high])
    # lower left corner, upper right corner and values of each panel
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
    """Return the lower left and upper right corner of the detail, both (axis,) [mm].

    The detail is a square around the point `centre`, moved so that it lies within the seal, and limited to the seal.
    """
    low = corners.min(axis=(0, 1))
    high = corners.max(axis=(0, 1))
    side = _DETAIL_SIDE * data.attrs["seal_size_m"][0] * 1e3
    start = np.maximum(low, np.minimum(centre - side / 2, high - side))
    return start, np.minimum(start + side, high)


def _flow_values(flow: Array, shows_whole_seal: bool) -> _TileValues:
    """Prepare the map of the flow per unit width, (tiles,) [m²/s]."""
    factor, unit = leakage_unit(flow.max()) if flow.max() > 0 else (1.0, "m²/s")
    title = f"flow per width [{unit}]"
    if not shows_whole_seal:
        title += " around its largest value"
    return _TileValues(title, flow / factor, "magma", decades=_FLOW_DECADES)


def _whole_seal_values(data: xarray.Dataset, step: int) -> list[_TileValues]:
    """Return the values whose maps show the whole seal."""
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
    """Draw some of the tiles of a seal, with a colour scale that covers the values of all tiles.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    corners : array (drawn tiles, corners, 2)
        Corners of the tiles that are drawn [mm].
    tile_values : _TileValues
        Values of all tiles.
    is_drawn : array of bool (tiles,)
        True for the tiles that are drawn.
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
