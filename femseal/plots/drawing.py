"""Draw what all pictures have in common: figures with panels, legends, load axes and length axes.

The module `style` defines fonts, sizes and colours. The panels of a picture are placed one below the other, so that the
picture can also be read on a phone. Pictures can be read without colours, because the colours differ in lightness, and
the branches of a load cycle differ in line style and marker.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, singledispatch
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, InputError, number_text
from .style import DPI, GREY, PAGE, png, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Factor by which the load axis extends beyond the lowest and beyond the highest load.
_LOAD_MARGIN = 1.1
#: Width of a digit in the labels of loads, smallest space between two labels, and height of a label, in font sizes.
_DIGIT, _SPACE, _LABEL_HEIGHT = 0.65, 0.5, 1.2
#: If the ratio of the ends of a logarithmic axis is smaller than this, the ticks at 2 and 5 are labelled as well.
_FEW_DECADES = 100.0
#: Exponents of the powers of ten that are written as plain numbers.
_PLAIN_EXPONENTS = range(-2, 4)
#: Width of a picture in a notebook [inch].
_NOTEBOOK_WIDTH = 5.0
#: Height of a line of a legend below the panels [inch].
LEGEND_LINE = 0.155


@dataclass(frozen=True)
class Margins:
    """Widths of the margins around the axes of a panel [inch]."""

    left: float
    right: float
    bottom: float
    top: float


#: Margins of a panel with lines.
LINES = Margins(0.58, 0.1, 0.42, 0.12)
#: Margins of a panel with a load axis, whose labels may be upright.
LOADS = Margins(0.58, 0.1, 0.54, 0.12)
#: Margins of a map with a colour bar above it.
MAP = Margins(0.5, 0.12, 0.4, 0.52)


class Sheet:
    """Make a figure whose panels are placed one below the other at fixed positions.

    If the figure has several panels, they are labelled (a), (b), … The automatic layout of matplotlib is not used,
    because it draws every figure twice.

    Parameters
    ----------
    heights : sequence of float
        Heights of the panels from top to bottom [inch].
    head : float
        Height of the space for a title above the panels [inch].
    dpi : float
        Pixels per inch.
    """

    def __init__(self, heights: Sequence[float], head: float = 0.0, dpi: float = DPI) -> None:
        from matplotlib.figure import Figure

        self.heights = heights
        self.height = sum(heights) + head
        self.figure = Figure(figsize=(PAGE, self.height), dpi=dpi)

    def panel(self, row: int, margins: Margins) -> Axes:
        """Add the axes of panel number `row`, counted from 0 at the top."""
        below = sum(self.heights[row + 1 :])
        width = PAGE - margins.left - margins.right
        height = max(self.heights[row] - margins.bottom - margins.top, 0.1)
        left_bottom_width_height = (
            margins.left / PAGE,
            (below + margins.bottom) / self.height,
            width / PAGE,
            height / self.height,
        )
        if len(self.heights) > 1:
            top = (below + self.heights[row] - 0.03) / self.height
            letter = f"({'abcdefghijklmnop'[row]})"
            self.figure.text(0.05 / PAGE, top, letter, va="top", weight="bold")
        return self.figure.add_axes(left_bottom_width_height)

    def head(self, text: str) -> None:
        """Write a title above all panels."""
        self.figure.suptitle(text, y=1 - 0.06 / self.height, va="top")


def figure_of(axes: Axes) -> Figure:
    """Return the figure to which the axes belong."""
    return axes.get_figure(root=True)  # type: ignore[return-value]


def panel_size(axes: Axes) -> Array:
    """Return the width and the height of the axes [inch]."""
    return np.asarray(axes.get_position().size * figure_of(axes).get_size_inches())


def legend_below(
    figure: Figure,
    handles: Sequence[Any],
    columns: int = 2,
    length: float = 2.8,
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
        handlelength=length,
        columnspacing=1.2,
        handletextpad=0.6,
    )


# --- axes -------------------------------------------------------------------------------------------------


def length_unit(longest: float) -> tuple[float, str]:
    """Choose a length unit that suits the longest side [m] of a map or a profile; return the unit in m, and its name.

    >>> length_unit(3e-4), length_unit(0.02)
    ((1e-06, 'µm'), (0.001, 'mm'))
    """
    if longest < 0.999e-3:
        return 1e-6, "µm"
    return 1e-3, "mm"


def add_grid(axes: Axes) -> None:
    """Add grid lines to the axes, behind all lines and points."""
    axes.grid(visible=True)
    axes.set_axisbelow(True)


def write_in_the_middle(axes: Axes, text: str) -> None:
    """Write a text in the middle of a panel that shows nothing else."""
    axes.annotate(text, (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY)


def set_load_axis(axes: Axes, loads: Array) -> None:
    """Set the scale of the x axis, and put a tick with a label at every load.

    The axis is logarithmic if several loads are given. A load of 0 is placed to the left of the logarithmic part of the
    axis. If labels would touch each other, all labels are turned by 90°, and labels of nearly equal loads are moved
    apart.

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
    # The limits are set before the scale. Otherwise matplotlib determines limits for the new scale, and warns if only
    # one load has a value.
    if loads.size == 1:
        axes.set_xlim(0, highest * _LOAD_MARGIN)
    elif loads[0] > 0:
        axes.set_xlim(lowest / _LOAD_MARGIN, highest * _LOAD_MARGIN)
        axes.set_xscale("log")
    else:
        axes.set_xlim(-lowest / 5, highest * _LOAD_MARGIN)
        axes.set_xscale("symlog", linthresh=lowest, linscale=0.4)
    axes.set_xticks(loads, labels=[f"{load:.4g}" for load in loads])
    axes.set_xticks([], minor=True)
    _place_load_labels(axes, loads)


def _place_load_labels(axes: Axes, loads: Array) -> None:
    """Rotate and move the labels of the loads, so that they do not touch each other.

    loads : loads of the ticks, in increasing order.
    """
    from matplotlib.transforms import ScaledTranslation

    width = panel_size(axes)[0]
    to_axes_fraction = axes.transScale + axes.transLimits
    positions = width * to_axes_fraction.transform([(load, 1.0) for load in loads])[:, 0]
    font_size = axes.xaxis.get_major_ticks()[0].label1.get_fontsize() / 72  # inch
    widths = _DIGIT * font_size * np.array([len(f"{load:.4g}") for load in loads])
    needed = (widths[1:] + widths[:-1]) / 2 + _SPACE * font_size
    is_upright = bool((np.diff(positions) < needed).any())
    axes.tick_params(axis="x", labelrotation=90 if is_upright else 0)
    moved = positions
    if is_upright:
        height = _LABEL_HEIGHT * font_size
        # If there is no room for all labels, only every second, third, … load is labelled, beginning with the highest.
        # The row of labels may be 10 % longer than the axis.
        every = int(np.ceil(height * loads.size / (1.1 * width)))
        texts = [f"{load:.4g}" if n % every == 0 else "" for n, load in enumerate(loads[::-1])]
        axes.set_xticklabels(texts[::-1])
        moved = spread(positions, height / every)
    for tick, shift in zip(axes.xaxis.get_major_ticks(), moved - positions, strict=True):
        pad = tick.get_pad() + tick.get_tick_padding()
        transform, _, _ = axes.get_xaxis_text1_transform(pad)
        tick.label1.set_transform(
            transform + ScaledTranslation(shift, 0, figure_of(axes).dpi_scale_trans)
        )


def spread(positions: Array, distance: float) -> Array:
    """Move increasing positions apart, so that neighbouring positions have at least a given distance.

    The sum of the squares of the shifts is minimised. The new positions are far enough apart if position − n · distance
    does not decrease with n. Isotonic regression finds the nearest values that do not decrease.

    >>> spread(np.array([0.0, 2.0, 2.2, 5.0]), 1.0)
    array([0. , 1.6, 2.6, 5. ])
    """
    from scipy.optimize import isotonic_regression

    offsets = distance * np.arange(len(positions))
    return np.asarray(isotonic_regression(positions - offsets).x + offsets)


def label_decades(axis: Axis) -> None:
    """Label a logarithmic axis: write short numbers as plain numbers, and all other numbers as powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    formatter = FuncFormatter(lambda value, _: number_text(value, plain=_PLAIN_EXPONENTS))
    axis.set_major_formatter(formatter)
    axis.set_minor_formatter(NullFormatter())
    if high / low < _FEW_DECADES:
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(formatter)


# --- the picture of a result ------------------------------------------------------------------------------


def shown(figure: Figure) -> Figure:
    """Register a figure with pyplot, so that `pyplot.show()` shows it and a notebook shows it only once."""
    from matplotlib import pyplot

    # pyplot only registers figures that it has created; this "class" makes it use the existing figure as the new one
    pyplot.figure(FigureClass=lambda **_: figure)  # type: ignore[arg-type]
    if "inline" in pyplot.get_backend():
        figure._ipython_display_ = partial(_show_in_notebook, figure)  # type: ignore[attr-defined]
    return figure


def _show_in_notebook(figure: Figure) -> None:
    """Display a figure below the notebook cell that returns the figure.

    The figure is closed in pyplot, which would otherwise show the figure a second time.
    """
    from IPython.display import display
    from matplotlib import pyplot

    pyplot.close(figure)
    # browsers assume 96 pixels per inch; the picture has more pixels, so that it stays sharp when it is enlarged
    width = {"width": round(_NOTEBOOK_WIDTH * 96 / PAGE * figure.get_figwidth())}
    display({"image/png": png(figure)}, metadata={"image/png": width}, raw=True)


@singledispatch
def _draw(result: Any) -> Figure:
    """Raise an InputError, because no drawing function is registered for the class of `result`."""
    raise InputError("plot", f"a {type(result).__name__}", "a result that has a picture")


def shows(result_class: type) -> Callable[[Callable[..., Figure]], Callable[..., Figure]]:
    """Return a decorator that registers a drawing function for a class of results.

    The method `plot()` of the class calls the registered function in the style of femseal. The first argument of the
    function must be the result. Any further arguments of the function become options of `plot()`.
    """

    def register(draw: Callable[..., Figure]) -> Callable[..., Figure]:
        """Register the function `draw` for `result_class`; return a function that draws in the style of femseal."""
        draw_in_style = styled(draw)
        _draw.register(result_class, draw_in_style)
        return draw_in_style

    return register


def picture(result: Any, **options: Any) -> Figure:
    """Draw the picture of a result.

    Parameters
    ----------
    result : object
        Result of a class that has a picture.
    **options
        Options of the drawing function for the class of `result`, such as `ax`.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        No drawing function is registered for the class of `result`, or this function does not accept one of the
        options. For example, a picture of several panels has no option `ax`.
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
