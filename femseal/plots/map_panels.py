"""Draw values over a rectangular face as colours, with a colour bar above the map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Pair
from ..results.variables import block_means
from .drawing import MAP, figure_of, label_decades, length_unit, panel_size
from .style import DPI, MOST_DPI, PAGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Colour of points without a value in most maps, such as points in contact or sealed cells.
CLOSED_COLOUR = "#B0B0B0"
#: Colour of pockets in maps of the fluid pressure. It is white because the middle of their colour scale is grey.
POCKET_COLOUR = "#FFFFFF"
#: Largest number of points of a map along each side. Maps of more points show means over blocks of points.
MOST_MAP_POINTS = 1024
#: Ratio of height to width above which a map is turned on its side.
_HIGHEST_UPRIGHT = 1.2
#: Distance of the colour bar from the map, and its height [inch].
_BAR_DISTANCE, _BAR_HEIGHT = 0.05, 0.075
#: Distance of the legend for points without a value from the map [inch].
_KEY_DISTANCE = 0.28
#: Width of a map [inch].
_MAP_WIDTH = PAGE - MAP.left - MAP.right
#: Smallest height of a map [inch].
LOWEST_MAP = 0.5


def draw_map(
    axes: Axes,
    values: Array,
    size: Pair,
    colours: Any,
    name: str,
    unit: str = "",
    *,
    key: Mapping[str, str] | None = None,
    **scale: Any,
) -> Any:
    """Draw values over a rectangular face as colours.

    If a face is much longer along x2 than along x1, the map is turned by 90°, see `is_turned`.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    values : array (n1, n2)
        Values along x1 and x2.
    size : pair of float
        Sides of the face along x1 and x2, in metres or, if `unit` is given, in this unit.
    colours : colormap or its name
        Colours of the values.
    name : str
        Name of the quantity with its unit, for the colour bar.
    unit : str
        Unit of length on the axes, such as "pixels"; by default a unit that suits sides in metres.
    key : mapping of str, optional
        Legend for points without a value: a colour for each explanatory text, for example "contact".
    **scale
        Range or norm of the colour scale, as keyword arguments for `Axes.imshow`.

    Returns
    -------
    Colorbar
    """
    if not unit:
        metres, unit = length_unit(max(size))
        size = size[0] / metres, size[1] / metres
    width, height = on_its_side(size)
    image = axes.imshow(
        to_image(values, size),
        origin="lower",
        extent=(0.0, width, 0.0, height),
        cmap=colours,
        interpolation=_interpolation(axes, values.shape),
        **scale,
    )
    names = [f"$x_1$, inlet at 0 [{unit}]", f"$x_2$ along the seal [{unit}]"]
    if is_turned(size):
        names.reverse()
    axes.set(xlabel=names[0], ylabel=names[1])
    # If a very long map were drawn to scale, it would be too low to be read. Such a map is stretched to `LOWEST_MAP`.
    # The tolerance of 5 % allows for rounding.
    panel_width, panel_height = panel_size(axes)
    is_to_scale = width / height < 1.05 * panel_width / panel_height
    aspect = "equal" if is_to_scale or panel_height > 1.05 * LOWEST_MAP else "auto"
    axes.set(aspect=aspect, xlim=(0.0, width), ylim=(0.0, height))
    bar = add_colour_bar(axes, image, name)
    if key:
        add_key(axes, key)
    return bar


def to_image(values: Array, size: Pair) -> Array:
    """Arrange values (n1, n2, …) for `imshow`, so that x1 is horizontal, or vertical if the map is turned by 90°."""
    return values if is_turned(size) else np.swapaxes(values, 0, 1)


def add_shade(axes: Axes, colour: Any, opacity: Array) -> None:
    """Draw a colour with a different opacity at each pixel over the map in the axes.

    colour : red, green and blue, (3,) or for each pixel (row, column, 3).
    opacity : opacity of the colour from 0 to 1, (row, column), as `to_image` returns it.
    """
    shade = np.zeros((*opacity.shape, 4), dtype=np.float32)  # red, green, blue, opacity
    shade[..., :3] = colour
    shade[..., 3] = opacity
    image = axes.images[0]
    extent, interpolation = image.get_extent(), image.get_interpolation()
    axes.imshow(shade, origin="lower", extent=extent, interpolation=interpolation)


def reduced(values: Array) -> Array:
    """Average a field (n1, n2) over blocks of points if it has more points than a picture can show."""
    if max(values.shape) <= MOST_MAP_POINTS:
        return values
    return block_means(values, MOST_MAP_POINTS).astype(float)


def _interpolation(axes: Axes, shape: tuple[int, ...]) -> str:
    """Return the argument `interpolation` of `imshow` for a map with `shape` pixels.

    A map with fewer pixels than the panel is not interpolated, so that each pixel keeps a single colour even when a
    vector picture is enlarged. If the map has more pixels than the panel, neighbouring pixels are averaged.
    """
    width, height = panel_size(axes) * figure_of(axes).dpi
    return "none" if max(shape) <= max(width, height) else "auto"


def map_dpi(shape: tuple[int, ...]) -> float:
    """Return a resolution between `DPI` and `MOST_DPI` [pixels per inch] for a map with `shape` pixels."""
    return float(np.clip(max(shape) / _MAP_WIDTH, DPI, MOST_DPI))


def is_turned(size: Pair) -> bool:
    """Return whether a map is turned by 90°, because it would be tall and narrow with x1 as its horizontal axis."""
    return bool(size[1] > _HIGHEST_UPRIGHT * size[0])


def on_its_side(size: Pair) -> Pair:
    """Return the width and the height of the map of a face with the sides `size` along x1 and x2."""
    return (size[1], size[0]) if is_turned(size) else (size[0], size[1])


def map_row_height(size: Pair) -> float:
    """Compute the height [inch] of a panel with a map, including the margins.

    The map fills the width of the panel. The height of the map is at least `LOWEST_MAP`, so that a long map can still
    be read, and at most the width of the map.

    size : sides of the face along x1 and x2, in any unit.
    """
    width, height = on_its_side(size)
    panel_height = float(np.clip(_MAP_WIDTH * height / width, LOWEST_MAP, _MAP_WIDTH))
    return panel_height + MAP.bottom + MAP.top


def add_colour_bar(
    axes: Axes, colours: Any, name: str, distance: float = _BAR_DISTANCE, loc: str = "left"
) -> Any:
    """Add a colour bar above a panel, as wide as the panel, with the name of the quantity.

    Parameters
    ----------
    axes : axes of the panel.
    colours : map or other artist with the colours.
    name : name of the quantity, with its unit.
    distance : distance of the bar from the panel [inch].
    loc : position of the name, "left" or "center".
    """
    height = panel_size(axes)[1]
    # left, bottom, width and height, as fractions of the axes
    position = (0.0, 1 + distance / height, 1.0, _BAR_HEIGHT / height)
    bar_axes = axes.inset_axes(position)
    bar = figure_of(axes).colorbar(colours, cax=bar_axes, orientation="horizontal")
    bar_axes.xaxis.set_ticks_position("top")
    bar_axes.xaxis.set_label_position("top")
    bar.set_label(name, loc=loc)
    if bar_axes.get_xscale() == "log":
        label_decades(bar_axes.xaxis)
    return bar


def add_key(axes: Axes, key: Mapping[str, str]) -> None:
    """Draw a legend above the map that explains the colours of points without a value.

    The legend is to the right of the name of the colour bar.

    key : colour for each text that explains such points, for example "contact".
    """
    from matplotlib.patches import Patch

    patches = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.4, label=text)
        for text, colour in key.items()
    ]
    axes.legend(
        handles=patches,
        loc="lower right",
        bbox_to_anchor=(1.0, 1 + _KEY_DISTANCE / panel_size(axes)[1]),
        ncols=len(patches),
        handlelength=0.8,
        handleheight=0.8,
        handletextpad=0.4,
        columnspacing=0.8,
        borderaxespad=0.0,
        borderpad=0.1,
    )


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
        Limited values. Positive values below the lower end of the colour scale are replaced by the lower end. Values of
        0 are replaced by a value below the scale, which is drawn in a special colour. NaN stays NaN.
    norm : LogNorm
        Colour scale.
    """
    from matplotlib.colors import LogNorm

    positive = values[np.isfinite(values) & (values > 0)]
    high = positive.max() if positive.size else 1.0
    low = max(positive.min(), high * 10.0**-decades) if positive.size else 0.1
    if low >= 0.99 * high:
        # on a narrower scale, the numbers at all ticks would be the same
        low = high / 10
    clipped = np.full(values.shape, np.nan)
    clipped[values > 0] = np.maximum(values[values > 0], low)
    clipped[values == 0] = low / 10
    return clipped, LogNorm(low, high)


def colours_with_closed(name: str, colour: str = CLOSED_COLOUR) -> Any:
    """Return a colour map of matplotlib with a special colour for undefined values and values below the colour scale.

    name : name of the colour map.
    colour : the special colour.
    """
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=colour, under=colour)
