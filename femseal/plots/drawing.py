"""Common parts of all pictures: figures, styles, maps with their colour bar; and which function draws which class.

Figures are made without pyplot, so no display or backend is touched. Colours differ in lightness too, and branches also
in line and marker, so that pictures can be read without colour.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property, singledispatch
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Least distance of two labels of loads, as a fraction of the axis.
_APART = 0.09
#: Part of the axis between a load of 0 and the least one above it, in decades.
_ZERO_DECADES = 0.4
#: Ratio of the ends of an axis beyond which it has no ticks between the powers of ten.
_FINE = 1e5
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Powers of ten that are written as numbers.
_PLAIN = range(-2, 4)


def load_axis(axes: Axes, loads: Array, *, logarithmic: bool = False) -> None:
    """Scale of the x axis over loads: linear or logarithmic, whichever keeps the closest two further apart.

    A load of 0 stands left of the others on the logarithmic scale.
    logarithmic : takes this one for any two loads or more.
    """
    loads = np.unique(loads[np.isfinite(loads) & (loads >= 0)])
    if not loads.size or not loads[-1] > 0:
        return
    apart = _spread(places := _log_places(loads)) > _spread(np.unique(np.r_[0.0, loads]))
    if loads.size == 1 or not (logarithmic or apart):
        axes.set_xlim(0, loads[-1] * 1.03)
        return
    positive = loads[loads > 0]
    margin = 0.03 * (places[-1] - places[0])
    # before the scale, which would look for ends itself and warn where a single load has a value
    left = loads[0] / 10**margin if loads[0] > 0 else -positive[0] * margin / _ZERO_DECADES
    axes.set_xlim(left, loads[-1] * 10**margin)
    if loads[0] > 0:
        axes.set_xscale("log")
    else:
        axes.set_xscale("symlog", linthresh=positive[0], linscale=_ZERO_DECADES, subs=[])
    # from both ends inwards, so that the least and the highest load have a label
    kept: list[int] = []
    for n in sorted(range(loads.size), key=lambda n: (min(n, loads.size - 1 - n) > 0, -n)):
        if all(abs(places[n] - places[k]) >= _APART * (places[-1] - places[0]) for k in kept):
            kept.append(n)
    axes.set_xticks(loads[sorted(kept)], labels=[f"{loads[n]:.4g}" for n in sorted(kept)])
    axes.set_xticks(loads, labels=[""] * loads.size, minor=True)


def _log_places(loads: Array) -> Array:
    """Places of the loads on the logarithmic scale [decades]."""
    positive = np.log10(loads[loads > 0])
    return positive if loads[0] > 0 else np.r_[positive[0] - _ZERO_DECADES, positive]


def _spread(places: Array) -> float:
    """The least distance of two loads as a fraction of the axis; of a single load 0."""
    width = places[-1] - places[0]
    return float(np.diff(places).min() / width) if width > 0 else 0.0


def decades(axis: Axis) -> None:
    """Label the powers of ten of a logarithmic axis without the parser of formulas, which is slow."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_text(value)))
    powers = np.floor(np.log10(high)) - np.ceil(np.log10(low)) + 1
    if high / low < 30 or powers < 2:
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: _number_text(value)))
    else:
        axis.set_minor_formatter(NullFormatter())
        if high / low > _FINE:
            axis.set_minor_locator(NullLocator())


def power_text(value: float) -> str:
    """A power of ten as text.

    >>> power_text(1e-12), power_text(100.0)
    ('10⁻¹²', '100')
    """
    exponent = round(np.log10(value))
    return f"{value:g}" if exponent in _PLAIN else f"10{str(exponent).translate(_SUPERSCRIPTS)}"


def _number_text(value: float) -> str:
    exponent = int(np.floor(np.log10(value) + 1e-9))
    if exponent in _PLAIN:
        return f"{value:g}"
    return f"{value / 10.0**exponent:.0f}·10{str(exponent).translate(_SUPERSCRIPTS)}"


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
#: Pixels of a notebook for an inch of a figure.
_NOTEBOOK_PIXELS = 80


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] with automatic layout, without a window; a notebook displays it."""
    return _figure_class()(figsize=(width, height), layout="constrained", dpi=150)


@cache
def _figure_class() -> type[Figure]:
    """The class of figures that notebooks show; matplotlib is loaded when it is needed."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that notebooks show without pyplot.

        panels : left, bottom, width and height [inch] of the parts that can stand alone.
        """

        panels: tuple[tuple[float, float, float, float], ...] = ()

        def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
            _WAITING[:] = [figure for figure in _WAITING if figure is not self]
            width, height = (round(_NOTEBOOK_PIXELS * float(side)) for side in self.get_size_inches())
            return png(self), {"width": width, "height": height}

    return NotebookFigure


def png(figure: Figure) -> bytes:
    """The figure as PNG, laid out and drawn once; `savefig` would draw it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).print_png(stream := io.BytesIO())
    return stream.getvalue()


@dataclass(frozen=True, eq=False)
class Drawn:
    """Pixels (rows, columns, 3) of a figure, and the rows and columns of its panels; each is packed when asked for."""

    pixels: NDArray[np.uint8]
    cuts: tuple[tuple[slice, slice], ...] = ()

    @cached_property
    def whole(self) -> bytes:
        """The figure as PNG."""
        return _packed(self.pixels)

    @cached_property
    def panels(self) -> tuple[bytes, ...]:
        """Each of its panels as PNG; a figure without panels is one."""
        return tuple(_packed(self.pixels[cut]) for cut in self.cuts) if len(self.cuts) > 1 else (self.whole,)


def drawn(figure: Figure) -> Drawn:
    """Draw a figure once, so that its panels can be cut out of it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.array(np.asarray(canvas.buffer_rgba())[..., :3])
    n, dpi, boxes = len(pixels), figure.dpi, getattr(figure, "panels", ())
    rows = (slice(round(n - (bottom + height) * dpi), round(n - bottom * dpi)) for _, bottom, _, height in boxes)
    columns = (slice(round(left * dpi), round((left + width) * dpi)) for left, _, width, _ in boxes)
    return Drawn(pixels, tuple(zip(rows, columns, strict=True)))


def _packed(pixels: NDArray[np.uint8]) -> bytes:
    from PIL import Image

    Image.fromarray(np.ascontiguousarray(pixels)).save(stream := io.BytesIO(), "png", compress_level=_PACKING)
    return stream.getvalue()


@dataclass(frozen=True)
class Margins:
    """Space around the axes of a panel [inch]."""

    left: float
    right: float
    bottom: float
    top: float


#: Space for labels and title of lines, of a map with its colour bar, and of heights, whose bar has a name.
LINES, MAP, HEIGHTS = Margins(0.85, 0.2, 0.55, 0.4), Margins(0.75, 0.8, 0.5, 0.5), Margins(0.75, 1.0, 0.5, 0.5)
#: Width of a panel [inch] whose smallest letters are legible on a phone.
PANEL = 5.4


class Sheet:
    """A figure of rows of panels at fixed places: layouts that look for the places draw everything twice.

    heights : of the rows [inch], from the top.
    columns : panels in a row.
    head : height of the space above the rows [inch].
    """

    def __init__(self, heights: Sequence[float], columns: int = 1, head: float = 0.0) -> None:
        self._heights, self._head = heights, head
        self.height = sum(heights) + head
        self.figure = _figure_class()(figsize=(columns * PANEL, self.height), dpi=150)

    def panel(self, row: int, column: int, margins: Margins, part: tuple[int, int] = (0, 1)) -> Axes:
        """Axes of a panel, or of the n-th of m equal parts of it side by side, `part` = (n, m)."""
        width, height = PANEL / part[1], self._heights[row]
        left, bottom = column * PANEL + part[0] * width, self.height - self._head - sum(self._heights[: row + 1])
        if part[0] == 0:
            self.figure.panels += ((left, bottom, PANEL, height),)  # type: ignore[attr-defined]
        box = (
            left + margins.left,
            bottom + margins.bottom,
            max(width - margins.left - margins.right, 0.1),
            max(height - margins.bottom - margins.top, 0.1),
        )
        whole = (*self.figure.get_size_inches(), *self.figure.get_size_inches())
        return self.figure.add_axes([float(side / all_) for side, all_ in zip(box, whole, strict=True)])  # type: ignore[call-overload]


#: Height of a line of a legend below the panels [inch].
LEGEND_LINE = 0.19


def legend_below(
    figure: Figure, handles: Sequence[Any], columns: int = 2, length: float = 3.4, title: str | None = None
) -> None:
    """Draw one legend below all panels; length : of its lines, in font sizes."""
    look: dict[str, Any] = {"frameon": False, "fontsize": 8.5, "title_fontsize": 8.5, "handlelength": length}
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


#: Figures that the notebook shows at the end of the cell unless it has shown them.
_WAITING: list[Any] = []


def shown(figure: Figure) -> Figure:
    """The figure, which a notebook shows at the end of its cell, also where that ends with a semicolon."""
    notebook: Any = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if getattr(notebook, "kernel", None) is not None:
        if _show_waiting not in notebook.events.callbacks["post_execute"]:
            notebook.events.register("post_execute", _show_waiting)
        _WAITING.append(figure)
    return figure


def _show_waiting() -> None:
    from IPython.display import display

    while _WAITING:
        display(_WAITING.pop(0))


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
            raise InputError("plot", given, f"one of {', '.join(expected)}" if expected else "none: it has no options")
    figure = draw(result, **options)
    return figure if options.get("ax") is not None else shown(figure)
