"""Common parts of all pictures: figures, styles, axes of loads, maps; and which function draws which class.

Every picture is as broad as a page of a phone, so that its letters are legible there. Colours differ in lightness too,
and branches also in line and marker, so that pictures can be read without colour.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial, singledispatch
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, InputError, Pair, number_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Ratio by which the axis of loads reaches beyond them.
_MARGIN = 1.1
#: Least distance of two labels of loads as a fraction of the axis.
_LABEL = 0.12
#: Ratio of the ends of an axis below which 2 and 5 have labels.
_SHORT = 100.0
#: Powers of ten that are written as numbers.
_PLAIN = range(-2, 4)


def load_axis(axes: Axes, loads: Array) -> None:
    """Scale and ticks of the x axis: all loads, those with a label that have room for it, from both ends inwards.

    The scale of several loads is logarithmic, with a load of 0 left of the others.
    """
    loads = np.unique(loads[np.isfinite(loads) & (loads >= 0)])
    if not loads.size or not loads[-1] > 0:
        return
    positive = loads[loads > 0]
    # before the scale, which would look for ends itself and warn where a single load has a value
    ends = positive[0] / _MARGIN, positive[-1] * _MARGIN
    if loads.size == 1:
        axes.set_xlim(0, ends[1])
    elif loads[0] > 0:
        axes.set_xlim(ends)
        axes.set_xscale("log")
    else:
        axes.set_xlim(-positive[0] / 5, ends[1])
        axes.set_xscale("symlog", linthresh=positive[0], linscale=0.4)
    to_axes = axes.transScale + axes.transLimits
    places = to_axes.transform([(load, 1.0) for load in loads])[:, 0]
    labels = [""] * loads.size
    for n in sorted(range(loads.size), key=lambda n: (min(n, loads.size - 1 - n), -n)):
        if all(abs(places[n] - places[k]) > _LABEL for k, text in enumerate(labels) if text):
            labels[n] = f"{loads[n]:.4g}"
    axes.set_xticks(loads, labels=labels)
    axes.set_xticks([], minor=True)


def decades(axis: Axis) -> None:
    """Label a logarithmic axis by numbers as people write them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    written = FuncFormatter(lambda value, _: number_text(value, plain=_PLAIN))
    axis.set_major_formatter(written)
    axis.set_minor_formatter(NullFormatter())
    if high / low < _SHORT:
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(written)


#: Loading first, then unloadings: lines in colours that the colour-blind tell apart (Okabe & Ito), and markers.
STYLES: tuple[dict[str, Any], ...] = (
    {"color": "#D55E00", "ls": "-"},
    {"color": "#0072B2", "ls": "--"},
    {"color": "#009E73", "ls": "-."},
    {"color": "#CC79A7", "ls": ":"},
    {"color": "#56B4E9", "ls": (0, (5, 1, 1, 1, 1, 1))},
    {"color": "#000000", "ls": (0, (8, 2))},
)
MARKERS = "os^DvP"
GREY = "#666666"
#: Colour of places without a value on a map: contact, closed pieces.
CLOSED = "#B0B0B0"
#: Colour of pockets, apart from all colours of the map of fluid pressure, in whose middle is grey.
POCKET = "#FFFFFF"
#: Width of every picture [inch], whose smallest letters are legible on a phone, and its pixels for an inch.
PAGE, DPI = 5.4, 200
#: Ratio of the sides from which on a map lies.
_HIGH = 1.2


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] with automatic layout, without a window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=DPI)


def png(figure: Figure) -> bytes:
    """The figure as PNG, laid out and drawn once; `savefig` would draw it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).print_png(stream := io.BytesIO())
    return stream.getvalue()


@dataclass(frozen=True)
class Margins:
    """Space around the axes of a panel [inch]."""

    left: float
    right: float
    bottom: float
    top: float


#: Space for labels and title of lines, of a map with its colour bar, and of heights, whose bar has a name.
LINES, MAP, HEIGHTS = (
    Margins(0.95, 0.2, 0.55, 0.4),
    Margins(0.6, 0.62, 0.45, 0.38),
    Margins(0.6, 0.9, 0.45, 0.38),
)


class Sheet:
    """A figure of panels below each other, at fixed places: layouts that look for the places draw everything twice.

    heights : of the panels [inch], from the top.
    head : height of the space above them [inch].
    """

    def __init__(self, heights: Sequence[float], head: float = 0.0) -> None:
        from matplotlib.figure import Figure

        self.heights = heights
        self.height = sum(heights) + head
        self.figure = Figure(figsize=(PAGE, self.height), dpi=DPI)

    def panel(self, row: int, margins: Margins) -> Axes:
        """Axes of a panel."""
        height, bottom = self.heights[row], sum(self.heights[row + 1 :])
        box = (
            margins.left / PAGE,
            (bottom + margins.bottom) / self.height,
            (PAGE - margins.left - margins.right) / PAGE,
            max(height - margins.bottom - margins.top, 0.1) / self.height,
        )
        return self.figure.add_axes(box)

    def head(self, text: str) -> None:
        """A title above all panels."""
        self.figure.suptitle(text, fontsize=10, y=1 - 0.1 / self.height, va="top")


#: Height of a line of a legend below the panels [inch].
LEGEND_LINE = 0.19


def legend_below(
    figure: Figure,
    handles: Sequence[Any],
    columns: int = 2,
    length: float = 3.4,
    title: str | None = None,
) -> None:
    """Draw one legend below all panels; length : of its lines, in font sizes."""
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=columns,
        title=title,
        frameon=False,
        fontsize=8.5,
        title_fontsize=8.5,
        handlelength=length,
    )


def root_of(axes: Axes) -> Figure:
    """The figure that axes are in."""
    return axes.get_figure(root=True)  # type: ignore[return-value]


def branch_styles(count: int) -> list[dict[str, Any]]:
    """Look of the loading and of each unloading; the looks of unloadings repeat, that of the loading is unique."""
    numbers = (1 + (n - 1) % (len(STYLES) - 1) if n else 0 for n in range(count))
    return [STYLES[n] | {"marker": MARKERS[n], "lw": 1.8, "ms": 4.5} for n in numbers]


def panel_title(axes: Axes, title: str) -> None:
    """A title at a place of its own: one that is looked for costs a second layout."""
    axes.set_title(title, fontsize=9.5, y=1.0, pad=6)


def shown(figure: Figure) -> Figure:
    """The figure in the hands of pyplot: `pyplot.show()` opens it, and a notebook shows it once."""
    from matplotlib import pyplot

    # a window for a figure that is there already
    pyplot.figure(FigureClass=lambda **_: figure)  # type: ignore[arg-type]
    if "inline" in pyplot.get_backend():
        figure._ipython_display_ = partial(_show_in_notebook, figure)  # type: ignore[attr-defined]
    return figure


def _show_in_notebook(figure: Figure) -> None:
    """Show a figure that a cell ends with; pyplot lets go of it, as it would show it again after the cell."""
    from IPython.display import display
    from matplotlib import pyplot

    pyplot.close(figure)
    display({"image/png": png(figure)}, raw=True)


@singledispatch
def _draw(result: Any) -> Figure:
    raise InputError("plot", f"a {type(result).__name__}", "a result that has a picture")


#: Decorator that registers a function as the picture of a class; its other arguments are options of `plot()`.
shows = _draw.register


def picture(result: Any, **options: Any) -> Figure:
    """Draw the picture of a result.

    Raises InputError: a result without a picture, or an option that its picture does not have, such as `ax` where it
    has several panels.
    """
    draw = _draw.dispatch(type(result))
    expected = list(signature(draw).parameters)[1:]
    if unknown := [name for name in options if name not in expected]:
        given = f"option '{unknown[0]}' for the picture of a {type(result).__name__}"
        raise InputError("plot", given, f"one of: {', '.join(expected) or 'it has no options'}")
    figure = draw(result, **options)
    return figure if options.get("ax") is not None else shown(figure)


def map_row(size: Pair, margins: Margins = MAP) -> float:
    """Height [inch] of a row with a map of the given sides, to the right and upwards."""
    width = PAGE - margins.left - margins.right
    return map_height(size, width) + margins.bottom + margins.top


def map_panel(
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


def lying(size: Pair) -> Pair:
    """Sides of a map to the right and upwards: one that would be high and narrow lies, as a panel is filled by it."""
    return (size[1], size[0]) if size[1] > _HIGH * size[0] else (size[0], size[1])


def colour_bar(axes: Axes, image: Any) -> Any:
    """A bar as high as the map."""
    bar = root_of(axes).colorbar(image, cax=axes.inset_axes((1.02, 0, 0.03, 1)))
    if bar.ax.get_yscale() == "log":
        decades(bar.ax.yaxis)
    bar.ax.tick_params(which="both", labelsize=8)
    axes.tick_params(labelsize=8)
    return bar


def on_decades(values: Array, decades: int) -> tuple[Array, Any]:
    """Values >= 0 and their scale of so many decades at most; 0 lies below it, NaN stays."""
    from matplotlib.colors import LogNorm

    positive = values[np.isfinite(values) & (values > 0)]
    top = positive.max() if positive.size else 1.0
    low = max(positive.min(), top * 10.0**-decades) if positive.size else 0.1
    low = low if low < 0.99 * top else top / 10  # ticks that differ can be read
    shown = np.where(values > 0, np.maximum(values, low), np.where(values == 0, low / 10, np.nan))
    return shown, LogNorm(low, top)


def with_closed(name: str, colour: str = CLOSED) -> Any:
    """A colour map that shows undefined points and those below its range in one colour, grey unless given."""
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=colour, under=colour)


def map_height(size: Pair, width: float) -> float:
    """Height [inch] of a map of sides to the right and upwards in a panel of a width, within what can be read."""
    return float(np.clip(width * size[1] / size[0], 0.7, width))
