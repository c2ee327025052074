"""Draw the parts that all pictures have in common: figures, line styles and axes of loads.

Every picture fits the width of a phone screen, so that its letters can be read there. Pictures can also be read without
colours, because colours differ in lightness, and the branches of a load cycle differ in line style and marker.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial, singledispatch
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, InputError, number_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Factor by which the load axis extends beyond the lowest and the highest load.
_LOAD_MARGIN = 1.1
#: Smallest distance between two labels of loads, as a fraction of the axis.
_LABEL_DISTANCE = 0.12
#: If the ratio of the ends of a logarithmic axis is smaller than this, the ticks at 2 and 5 are labelled as well.
_FEW_DECADES = 100.0
#: Exponents of the powers of ten that are written as plain numbers.
_PLAIN_EXPONENTS = range(-2, 4)

#: Line styles. The first one is for loading, the others are for unloadings. The colours are from the palette of Okabe
#: and Ito, which colour-blind readers can tell apart.
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
#: Width of every picture [inch]; at this width the smallest letters can be read on a phone.
PAGE = 5.4
#: Pixels per inch.
DPI = 200
#: Height of a line of a legend below the panels [inch].
LEGEND_LINE = 0.19


@dataclass(frozen=True)
class Margins:
    """Space around the axes of a panel [inch]."""

    left: float
    right: float
    bottom: float
    top: float


#: Margins of a panel with lines.
LINES = Margins(0.95, 0.2, 0.55, 0.4)
#: Margins of a map with a colour bar.
MAP = Margins(0.6, 0.62, 0.45, 0.38)
#: Margins of a map of heights, whose colour bar has a name.
HEIGHTS = Margins(0.6, 0.9, 0.45, 0.38)


class Sheet:
    """Figure whose panels are stacked at fixed positions.

    The automatic layout of matplotlib would draw every figure twice.

    Parameters
    ----------
    heights : sequence of float
        Heights of the panels from top to bottom [inch].
    head : float
        Height of the space for a title above the panels [inch].
    """

    def __init__(self, heights: Sequence[float], head: float = 0.0) -> None:
        from matplotlib.figure import Figure

        self.heights = heights
        self.height = sum(heights) + head
        self.figure = Figure(figsize=(PAGE, self.height), dpi=DPI)

    def panel(self, row: int, margins: Margins) -> Axes:
        """Add the axes of the panel in a row, counted from the top."""
        below = sum(self.heights[row + 1 :])
        width = PAGE - margins.left - margins.right
        height = max(self.heights[row] - margins.bottom - margins.top, 0.1)
        left_bottom_width_height = (
            margins.left / PAGE,
            (below + margins.bottom) / self.height,
            width / PAGE,
            height / self.height,
        )
        return self.figure.add_axes(left_bottom_width_height)

    def head(self, text: str) -> None:
        """Write a title above all panels."""
        self.figure.suptitle(text, fontsize=10, y=1 - 0.1 / self.height, va="top")


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of the given size [inch] that is not shown in a window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=DPI)


def png(figure: Figure) -> bytes:
    """Render a figure as PNG.

    The figure is laid out and drawn once, whereas `Figure.savefig` would draw it twice.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    stream = io.BytesIO()
    FigureCanvasAgg(figure).print_png(stream)
    return stream.getvalue()


def figure_of(axes: Axes) -> Figure:
    """Get the figure that contains the axes."""
    return axes.get_figure(root=True)  # type: ignore[return-value]


def branch_styles(count: int) -> list[dict[str, Any]]:
    """List the line styles of `count` branches: the loading and `count` − 1 unloadings.

    If there are many unloadings, their styles repeat. None of them has the style of the loading.
    """
    style_count = len(STYLES) - 1  # for unloadings
    style_numbers = [0, *(1 + n % style_count for n in range(count - 1))]
    return [
        STYLES[number] | {"marker": MARKERS[number], "lw": 1.8, "ms": 4.5}
        for number in style_numbers[:count]
    ]


def set_panel_title(axes: Axes, title: str) -> None:
    """Set the title of a panel at a fixed height.

    By default, matplotlib searches for a free height, which requires a second layout.
    """
    axes.set_title(title, fontsize=9.5, y=1.0, pad=6)


def legend_below(
    figure: Figure,
    handles: Sequence[Any],
    columns: int = 2,
    length: float = 3.4,
    title: str | None = None,
) -> None:
    """Draw one legend below all panels.

    Parameters
    ----------
    figure : Figure
        Figure to draw into.
    handles : sequence of artists
        Artists that the legend lists.
    columns : int
        Number of columns of the legend.
    length : float
        Length of the line samples, in multiples of the font size.
    title : str, optional
        Title of the legend.
    """
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


# --- axes -------------------------------------------------------------------------------------------------


def set_load_axis(axes: Axes, loads: Array) -> None:
    """Set the scale of the x axis and put a tick at every load.

    The axis is logarithmic if there are several loads. A load of 0 is placed to the left of the logarithmic part. Ticks
    are labelled from both ends of the axis inwards as long as there is room.

    Parameters
    ----------
    axes : Axes
        Axes whose x axis is set.
    loads : array (any shape)
        Loads in the unit of the axis; NaN and negative values are ignored.
    """
    loads = np.unique(loads[np.isfinite(loads) & (loads >= 0)])
    if not loads.size or loads[-1] <= 0:
        return
    lowest = loads[loads > 0][0]
    highest = loads[-1]
    # limits are set before the scale, which would look for limits itself and warn if only one load has a value
    if loads.size == 1:
        axes.set_xlim(0, highest * _LOAD_MARGIN)
    elif loads[0] > 0:
        axes.set_xlim(lowest / _LOAD_MARGIN, highest * _LOAD_MARGIN)
        axes.set_xscale("log")
    else:
        axes.set_xlim(-lowest / 5, highest * _LOAD_MARGIN)
        axes.set_xscale("symlog", linthresh=lowest, linscale=0.4)
    axes.set_xticks(loads, labels=_load_labels(axes, loads))
    axes.set_xticks([], minor=True)


def _load_labels(axes: Axes, loads: Array) -> list[str]:
    """Return the labels of the ticks at rising loads, "" where there is no room for a label.

    The ends of the axis are labelled first, then the loads further inwards.
    """
    to_axes_fraction = axes.transScale + axes.transLimits
    positions = to_axes_fraction.transform([(load, 1.0) for load in loads])[:, 0]
    last = loads.size - 1

    def priority(index: int) -> tuple[int, int]:
        distance_from_nearer_end = min(index, last - index)
        return distance_from_nearer_end, -index  # the right end comes before the left one

    labelled: list[int] = []
    for index in sorted(range(loads.size), key=priority):
        distances = np.abs(positions[index] - positions[labelled])
        if (distances > _LABEL_DISTANCE).all():
            labelled.append(index)
    return [f"{load:.4g}" if index in labelled else "" for index, load in enumerate(loads)]


def label_decades(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers if they are short, and otherwise with powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    formatter = FuncFormatter(lambda value, _: number_text(value, plain=_PLAIN_EXPONENTS))
    axis.set_major_formatter(formatter)
    axis.set_minor_formatter(NullFormatter())
    if high / low < _FEW_DECADES:
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(formatter)


def label_axes(axes: Axes, names: Sequence[str]) -> None:
    """Name the x and the y axis, in a font small enough for a narrow map."""
    axes.set_xlabel(names[0], fontsize=8.5)
    axes.set_ylabel(names[1], fontsize=8.5)


# --- the picture of a result ------------------------------------------------------------------------------


def shown(figure: Figure) -> Figure:
    """Register a figure with pyplot, so that `pyplot.show()` opens it and a notebook shows it once."""
    from matplotlib import pyplot

    # pyplot only registers figures that it creates: the "class" of the new figure returns the existing one
    pyplot.figure(FigureClass=lambda **_: figure)  # type: ignore[arg-type]
    if "inline" in pyplot.get_backend():
        figure._ipython_display_ = partial(_show_in_notebook, figure)  # type: ignore[attr-defined]
    return figure


def _show_in_notebook(figure: Figure) -> None:
    """Show a figure that is the last value of a notebook cell, and close it so that pyplot does not show it again."""
    from IPython.display import display
    from matplotlib import pyplot

    pyplot.close(figure)
    display({"image/png": png(figure)}, raw=True)


@singledispatch
def _draw(result: Any) -> Figure:
    """Raise an InputError, because no function is registered that draws results of this class."""
    raise InputError("plot", f"a {type(result).__name__}", "a result that has a picture")


#: Decorator that registers a function which draws the picture of a class. The arguments of the function after the first
#: are the options of `plot()`.
shows = _draw.register


def picture(result: Any, **options: Any) -> Figure:
    """Draw the picture of a result.

    Parameters
    ----------
    result : object
        Result of a class that has a picture.
    **options
        Options of the function that draws this picture, such as `ax`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        The class has no picture, or its picture does not have one of the options. For example, a picture of several
        panels cannot be drawn into `ax`.
    """
    draw = _draw.dispatch(type(result))
    possible_options = list(signature(draw).parameters)[1:]  # the first parameter is the result
    unknown = [name for name in options if name not in possible_options]
    if unknown:
        given = f"option '{unknown[0]}' for the picture of a {type(result).__name__}"
        expected = f"one of: {', '.join(possible_options) or 'it has no options'}"
        raise InputError("plot", given, expected)
    figure = draw(result, **options)
    if options.get("ax") is not None:
        return figure  # the user has created it, and shows it
    return shown(figure)
