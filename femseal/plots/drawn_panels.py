"""Maps of a drawn seal in its plane: permeability and fluid pressure of the realisation nearest to the median."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .drawing import CLOSED, MAP, POCKET, Sheet, colour_bar, map_row

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
#: Permeabilities shown in colour: this many decades below the largest.
_DECADES = 10
#: Sides of the detail, and largest ratio of the sides of the seal that is shown as a whole, in breadths of the seal.
_DETAIL, _LONGEST = 1.5, 8.0
#: Most parts that are shown as a whole.
_MOST = 200_000


def drawn_figure(data: xarray.Dataset, s: int) -> Figure:
    """The whole seal and a detail of it, fluid pressure beside permeability; of long or fine ones the detail alone."""
    corners = data["drawn_corners"].values * 1e3
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    whole, breadth = high - low, float(data.attrs["seal_size_m"][0]) * 1e3
    views = [_detail(corners, breadth)]
    if whole.max() <= _LONGEST * whole.min() and len(corners) <= _MOST:
        views.insert(0, (low, high))
    heights = [map_row((float(top[1] - bottom[1]), float(top[0] - bottom[0]))) for bottom, top in views]
    sheet = Sheet(heights, columns=2, head=0.35)
    fields = (data["drawn_fluid_pressure"].values[s] / 1e6, data["drawn_permeability"].values[s])
    for row, (bottom, top) in enumerate(views):
        seen = ((corners.max(axis=1) >= bottom) & (corners.min(axis=1) <= top)).all(axis=1)
        for column, values in enumerate(fields):
            axes = sheet.panel(row, column, MAP)
            _panel(axes, corners[seen], values[seen], values, of_pressure=column == 0)
            axes.set(xlim=(bottom[0], top[0]), ylim=(bottom[1], top[1]))
    number = data["drawn_corners"].attrs["realisation"]
    title = f"{data['name'].values[s]}; realisation {number}, the nearest to the median"
    sheet.figure.suptitle(title, fontsize=11, y=1 - 0.1 / sheet.height, va="top")
    return sheet.figure


def _detail(corners: Array, breadth: float) -> tuple[Array, Array]:
    """Lower left and upper right corner of a square at the right end of the seal."""
    centres = corners.mean(axis=1)
    side = _DETAIL * breadth
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    place = centres[np.argmax(centres[:, 0])]
    start = np.maximum(low, np.minimum(np.array([high[0] - side, place[1] - side / 2]), high - side))
    return start, np.minimum(start + side, high)


def _panel(axes: Axes, corners: Array, values: Array, whole: Array, *, of_pressure: bool) -> None:
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import LogNorm, Normalize

    scale: dict[str, Any]
    if of_pressure:
        finite = whole[np.isfinite(whole)]
        ends = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        scale = {"cmap": colormaps["cividis"].with_extremes(bad=POCKET), "norm": Normalize(*ends)}
        title = "fluid pressure [MPa]" + ("; white: pockets" if np.isnan(whole).any() else "")
    else:
        positive = whole[np.isfinite(whole) & (whole > 0)]
        top = float(positive.max()) if positive.size else 1.0
        low = max(float(positive.min()), top * 10.0**-_DECADES) if positive.size else 0.1
        low = low if low < top else low / 10
        values = np.where(values > 0, np.maximum(values, low), np.where(values == 0, low / 10, np.nan))
        scale = {"cmap": colormaps["viridis"].with_extremes(under=CLOSED, bad=POCKET), "norm": LogNorm(low, top)}
        title = "permeability [m³]" + ("; grey: closed" if (whole == 0).any() else "")
    parts = PolyCollection(list(corners), array=np.ma.masked_invalid(values), rasterized=True, **scale)
    parts.set(edgecolor="face", linewidth=0.2)
    axes.add_collection(parts)
    colour_bar(axes, parts)
    axes.set_title(title, fontsize=9.5)
    axes.set(xlabel="x1 [mm]", ylabel="x2 [mm]", aspect="equal")
