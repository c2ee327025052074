"""Maps in panels: their colours, their colour bar, and how they lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array
from .drawing import CLOSED, MAP, PAGE, Margins, decades, panel_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Ratio of the sides from which on a map lies.
_HIGH = 1.2


def map_row(size: tuple[float, float], margins: Margins = MAP) -> float:
    """Height [inch] of a row with a map of the given sides, to the right and upwards."""
    width = PAGE - margins.left - margins.right
    return map_height(size, width) + margins.bottom + margins.top


def map_panel(
    axes: Axes,
    values: Array,
    size: tuple[float, float],
    colours: Any,
    title: str,
    unit: str = "mm",
    *,
    upright: bool = False,
    **scale: Any,
) -> Any:
    """Map of values (n1, n2) over a face of the given size [`unit`]; returns its colour bar.

    x1 is to the right, and upwards on a face that is longer along x2, see `lying`; always to the right where `upright`.
    """
    across, up = size if upright else lying(size)
    turned = (across, up) != tuple(size)
    image = axes.imshow(
        values if turned else values.T,
        origin="lower",
        extent=(0.0, across, 0.0, up),
        cmap=colours,
        interpolation="nearest",
        **scale,
    )
    names = [f"x1, inlet at 0 [{unit}]", f"x2 along the seal [{unit}]"]
    name_sides(axes, names[::-1] if turned else names)
    axes.set(aspect="equal", xlim=(0.0, across), ylim=(0.0, up))
    panel_title(axes, title)
    return colour_bar(axes, image)


def name_sides(axes: Axes, names: Sequence[str]) -> None:
    """Names of the axes to the right and upwards, which a narrow map has room for."""
    axes.set_xlabel(names[0], fontsize=8.5)
    axes.set_ylabel(names[1], fontsize=8.5)


def lying(size: tuple[float, float]) -> tuple[float, float]:
    """Sides of a map to the right and upwards: one that would be high and narrow lies, as a panel is filled by it."""
    return (size[1], size[0]) if size[1] > _HIGH * size[0] else (size[0], size[1])


def colour_bar(axes: Axes, image: Any, **options: Any) -> Any:
    """A bar as high as the map, and as broad for narrow maps as for others."""
    figure = axes.get_figure(root=True)
    box, (low, high) = axes.get_position(), (axes.get_xlim(), axes.get_ylim())
    width, height = (float(side) for side in figure.get_size_inches())  # type: ignore[union-attr]
    across, upwards = box.width * width, box.height * height
    shown = across
    if axes.get_aspect() != "auto":
        shown = min(across, upwards * abs((low[1] - low[0]) / (high[1] - high[0])))
    place = (1 + 0.08 / shown, 0, 0.12 / shown, 1)
    bar = figure.colorbar(image, cax=axes.inset_axes(place), **options)  # type: ignore[union-attr]
    if bar.ax.get_yscale() == "log":
        decades(bar.ax.yaxis)
    bar.ax.tick_params(which="both", labelsize=8)
    axes.tick_params(labelsize=8)
    return bar


def flow_arrows(axes: Axes, *vectors: Any, **options: Any) -> None:
    """Arrows of a flow: places along x and y, and vectors in the units of the axes."""
    arrows = axes.quiver(
        *vectors, pivot="mid", angles="xy", scale_units="xy", scale=1.0, units="inches", headwidth=4, headlength=4,
        headaxislength=3.6, color="#D7191C", edgecolor="white", linewidth=0.5, **options,
    )  # fmt: skip
    arrows.set_in_layout(False)


def on_decades(values: Array, decades: int) -> tuple[Array, Any]:
    """Values >= 0 and their scale of so many decades at most; 0 lies below it, NaN stays."""
    from matplotlib.colors import LogNorm

    positive = values[np.isfinite(values) & (values > 0)]
    top = float(positive.max()) if positive.size else 1.0
    low = max(float(positive.min()), top * 10.0**-decades) if positive.size else 0.1
    low = low if low < 0.99 * top else top / 10  # ticks that differ can be read
    shown = np.where(values > 0, np.maximum(values, low), np.where(values == 0, low / 10, np.nan))
    return shown, LogNorm(low, top)


def with_closed(name: str, colour: str = CLOSED) -> Any:
    """A colour map that shows undefined points and those below its range in one colour, grey unless given."""
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=colour, under=colour)


def map_height(size: tuple[float, float], width: float) -> float:
    """Height [inch] of a map of sides to the right and upwards in a panel of a width, within what can be read."""
    return float(np.clip(width * size[1] / size[0], 0.7, width))
