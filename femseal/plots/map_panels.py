"""Draw values over a rectangular face as colours, with a colour bar."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Pair
from .drawing import MAP, PAGE, Margins, figure_of, label_axes, label_decades, set_panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colour of points without a value in most maps, such as points in contact or sealed cells.
CLOSED = "#B0B0B0"
#: Colour of pockets in maps of the fluid pressure. It is white because the middle of their colour scale is grey.
POCKET = "#FFFFFF"
#: Ratio of height to width above which a map is turned on its side.
_HIGHEST_UPRIGHT = 1.2


def draw_map(
    axes: Axes,
    values: Array,
    size: Pair,
    colours: Any,
    title: str,
    unit: str = "mm",
    *,
    upright: bool = False,
    **scale: Any,
) -> Any:
    """Draw values over a rectangular face as colours.

    The map of a face that is much longer along x2 than along x1 is turned on its side, see `on_its_side`.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    values : array (n1, n2)
        Values along x1 and x2.
    size : pair of float
        Sides of the face along x1 and x2 in `unit`.
    colours : colormap or its name
        Colours of the values.
    title : str
        Title of the panel.
    unit : str
        Unit of length on the axes.
    upright : bool
        True keeps x1 horizontal even if the map is high and narrow.
    **scale
        Range or norm of the colours, with the names of the arguments of `Axes.imshow`.

    Returns
    -------
    Colorbar
    """
    width, height = size if upright else on_its_side(size)
    is_turned = (width, height) != tuple(size)
    image = axes.imshow(
        # imshow takes (vertical, horizontal); x1 is horizontal unless the map is turned
        values if is_turned else values.T,
        origin="lower",
        extent=(0.0, width, 0.0, height),
        cmap=colours,
        interpolation="nearest",
        **scale,
    )
    names = [f"x1, inlet at 0 [{unit}]", f"x2 along the seal [{unit}]"]
    if is_turned:
        names.reverse()
    label_axes(axes, names)
    axes.set(aspect="equal", xlim=(0.0, width), ylim=(0.0, height))
    set_panel_title(axes, title)
    return add_colour_bar(axes, image)


def on_its_side(size: Pair) -> Pair:
    """Return the width and height of a map with the sides (x1, x2); a high and narrow map is turned by 90°."""
    if size[1] > _HIGHEST_UPRIGHT * size[0]:
        return size[1], size[0]
    return size[0], size[1]


def map_height(size: Pair, width: float) -> float:
    """Compute the height [inch] of a map with sides (horizontal, vertical) in a panel of the given width [inch].

    The height is at least 0.7 inch, so that a long map can still be read, and at most the width.
    """
    return float(np.clip(width * size[1] / size[0], 0.7, width))


def map_row_height(size: Pair, margins: Margins = MAP) -> float:
    """Compute the height [inch] of a panel with a map of sides (horizontal, vertical), including its margins."""
    width = PAGE - margins.left - margins.right
    return map_height(size, width) + margins.bottom + margins.top


def add_colour_bar(axes: Axes, image: Any) -> Any:
    """Add a colour bar as high as the map."""
    bar = figure_of(axes).colorbar(image, cax=axes.inset_axes((1.02, 0, 0.03, 1)))
    if bar.ax.get_yscale() == "log":
        label_decades(bar.ax.yaxis)
    bar.ax.tick_params(which="both", labelsize=8)
    axes.tick_params(labelsize=8)
    return bar


def clip_to_decades(values: Array, decades: int) -> tuple[Array, Any]:
    """Limit values to the range of a logarithmic colour scale.

    Parameters
    ----------
    values : array (any shape)
        Values >= 0, or NaN.
    decades : int
        Largest number of decades that the scale covers below the highest value.

    Returns
    -------
    values : array
        Values for the scale. Positive values below the lower end of the scale are raised to this end. Values of 0 are
        replaced by a value below the scale, so that they get the colour for this range. NaN stays NaN.
    norm : LogNorm
        Colour scale.
    """
    from matplotlib.colors import LogNorm

    positive = values[np.isfinite(values) & (values > 0)]
    high = positive.max() if positive.size else 1.0
    low = max(positive.min(), high * 10.0**-decades) if positive.size else 0.1
    if low >= 0.99 * high:
        # on a narrower scale, all ticks would show the same number
        low = high / 10
    clipped = np.full(values.shape, np.nan)
    clipped[values > 0] = np.maximum(values[values > 0], low)
    clipped[values == 0] = low / 10
    return clipped, LogNorm(low, high)


def colours_with_closed(name: str, colour: str = CLOSED) -> Any:
    """Return a colour map of matplotlib in which `colour` marks undefined values and values below the range."""
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=colour, under=colour)
