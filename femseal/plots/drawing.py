"""Common parts of all pictures: figures, styles, axes of loads; and which function draws which class.

Every picture is as broad as a page of a phone, so that its letters are legible there. Colours differ in lightness too,
and branches also in line and marker, so that pictures can be read without colour.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial, singledispatch
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Ratio of loads up to which their axis is linear, and by which it reaches beyond them.
_NEAR, _MARGIN = 5.0, 1.1
#: Least distance of two labels of loads as a fraction of the axis.
_LABEL = 0.12
#: Ratios of the ends of an axis below which 2 and 5 have labels, and beyond which only powers of ten have ticks.
_SHORT, _FINE = 100.0, 1e5
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Powers of ten that are written as numbers.
_PLAIN = range(-2, 4)


def load_axis(axes: Axes, loads: Array, *, logarithmic: bool = False) -> None:
    """Scale and ticks of the x axis: all loads, those with a label that have room for it, from both ends inwards.

    The scale is logarithmic where loads differ by more than `_NEAR`, with a load of 0 left of the others.
    logarithmic : takes this one for any two loads or more.
    """
    loads = np.unique(loads[np.isfinite(loads) & (loads >= 0)])
    if not loads.size or not loads[-1] > 0:
        return
    positive = loads[loads > 0]
    # before the scale, which would look for ends itself and warn where a single load has a value
    ends = positive[0] / _MARGIN, positive[-1] * _MARGIN
    if loads.size == 1 or not (logarithmic or positive[-1] > _NEAR * positive[0]):
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
    """Label a logarithmic axis without the parser of formulas, which is slow."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_formatter(FuncFormatter(lambda value, _: number_text(value)))
    axis.set_minor_formatter(NullFormatter())
    if high / low < _SHORT:
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: number_text(value)))
    elif high / low > _FINE:
        axis.set_minor_locator(NullLocator())


def number_text(value: float) -> str:
    """A number of an axis as text.

    >>> number_text(1e-12), number_text(100.0), number_text(2e-5)
    ('10⁻¹²', '100', '2·10⁻⁵')
    """
    exponent = int(np.floor(np.log10(value) + 1e-9))
    if exponent in _PLAIN:
        return f"{value:.4g}"
    factor = f"{value / 10.0**exponent:.3g}·".removeprefix("1·")
    return f"{factor}10{str(exponent).translate(_SUPERSCRIPTS)}"


#: Loading first, then unloadings: colours that the colour-blind tell apart (Okabe & Ito), line style and marker.
STYLES: tuple[tuple[str, Any, str], ...] = (
    ("#D55E00", "-", "o"),
    ("#0072B2", "--", "s"),
    ("#009E73", "-.", "^"),
    ("#CC79A7", ":", "D"),
    ("#56B4E9", (0, (5, 1, 1, 1, 1, 1)), "v"),
    ("#000000", (0, (8, 2)), "P"),
)
GREY = "#666666"
#: Colour of places without a value on a map: contact, closed pieces.
CLOSED = "#B0B0B0"
#: Colour of pockets, apart from all colours of the map of fluid pressure, in whose middle is grey.
POCKET = "#FFFFFF"
#: Packing of PNG, 0 to 9: more gains a few per cent for twice the time.
_PACKING = 4
#: Width of every picture [inch], whose smallest letters are legible on a phone, and its pixels for an inch.
PAGE, DPI = 5.4, 200


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] with automatic layout, without a window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=DPI)


def png(figure: Figure) -> bytes:
    """The figure as PNG, laid out and drawn once; `savefig` would draw it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).print_png(stream := io.BytesIO())
    return stream.getvalue()


@dataclass(frozen=True, eq=False)
class Drawn:
    """Pixels (rows, columns, 3) of a figure, and the rows of its panels; each is packed when asked for."""

    pixels: NDArray[np.uint8]
    cuts: tuple[slice, ...] = ()

    @cached_property
    def whole(self) -> bytes:
        """The figure as PNG."""
        return _packed(self.pixels)

    @cached_property
    def panels(self) -> tuple[bytes, ...]:
        """Each of its panels as PNG; a figure without panels is one."""
        return (
            tuple(_packed(self.pixels[cut]) for cut in self.cuts)
            if len(self.cuts) > 1
            else (self.whole,)
        )


def drawn(figure: Figure) -> Drawn:
    """Draw a figure once, so that the panels of a sheet can be cut out of it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.array(np.asarray(canvas.buffer_rgba())[..., :3])
    panels = np.array(getattr(figure, "panels", ())).reshape(-1, 2) * DPI
    rows = (
        slice(round(len(pixels) - low - height), round(len(pixels) - low)) for low, height in panels
    )
    return Drawn(pixels, tuple(rows))


def _packed(pixels: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    Image.fromarray(np.ascontiguousarray(pixels)).save(
        stream := io.BytesIO(), "png", compress_level=_PACKING
    )
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
        # bottom and height [inch] of the panels, each of which can stand alone
        self.figure.panels = []  # type: ignore[attr-defined]

    def panel(self, row: int, margins: Margins) -> Axes:
        """Axes of a panel."""
        height, bottom = self.heights[row], sum(self.heights[row + 1 :])
        self.figure.panels.append((bottom, height))  # type: ignore[attr-defined]
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
    look: dict[str, Any] = {
        "frameon": False,
        "fontsize": 8.5,
        "title_fontsize": 8.5,
        "handlelength": length,
    }
    figure.legend(handles=handles, loc="lower center", ncols=columns, title=title, **look)


def one_panel(ax: Axes | None, width: float, height: float) -> tuple[Figure, Axes]:
    """The given axes and their figure, or those of a new figure [inch]."""
    if ax is None:
        figure = new_figure(width, height)
        return figure, figure.add_subplot()
    return ax.get_figure(root=True), ax  # type: ignore[return-value]


def branch_styles(count: int) -> list[tuple[str, Any, str]]:
    """Style of the loading and of each unloading; the styles of unloadings repeat, that of the loading is unique."""
    return [STYLES[n] if n == 0 else STYLES[1 + (n - 1) % (len(STYLES) - 1)] for n in range(count)]


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
    for name in options:
        if name not in expected:
            given = f"option '{name}' for the picture of a {type(result).__name__}"
            raise InputError(
                "plot",
                given,
                f"one of {', '.join(expected)}" if expected else "none: it has no options",
            )
    figure = draw(result, **options)
    return figure if options.get("ax") is not None else shown(figure)
