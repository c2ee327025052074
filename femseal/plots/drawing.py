"""Common parts of all pictures: figures, styles, maps with their colour bar.

Figures are made without pyplot, so no display or backend is touched. Colours differ in lightness too, and branches also
in line and marker, so that pictures can be read without colour.
"""

from __future__ import annotations

import io
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
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
#: Colour of places without a value on a map: contact, closed windows, pockets.
CLOSED = "#B0B0B0"


#: Margin of a figure that is cropped to its contents [inch].
_CUT = 0.04
#: Pixels of a notebook for an inch of a figure.
_NOTEBOOK_PIXELS = 80


def new_figure(width: float, height: float, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """An empty figure [inch] with automatic layout, without a window; a notebook displays it.

    Layout takes as long as drawing: `layout` None skips it for a single panel that is cropped to its contents.
    """
    return _figure_class()(figsize=(width, height), layout=layout, dpi=150)


@cache
def _figure_class() -> type[Figure]:
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """A figure that notebooks show without pyplot."""

        def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
            width, height = (round(_NOTEBOOK_PIXELS * float(side)) for side in self.get_size_inches())
            return png(self), {"width": width, "height": height}

    return NotebookFigure


def png(figure: Figure) -> bytes:
    """The figure as PNG, laid out and drawn once; `savefig` would draw it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    stream = io.BytesIO()
    FigureCanvasAgg(figure).print_png(stream)
    return stream.getvalue()


def svg(figure: Figure) -> bytes:
    """The figure as SVG, drawn once, cropped to its contents if it has no layout; equal figures give equal text."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    stream, metadata = io.BytesIO(), {"Date": None, "Creator": None}
    with rc_context({"svg.hashsalt": "femseal"}):
        if figure.get_layout_engine() is None:
            box = figure.get_tightbbox(FigureCanvasAgg(figure).get_renderer()).padded(_CUT)
            figure.savefig(stream, format="svg", bbox_inches=box, metadata=metadata)
        else:
            FigureCanvasSVG(figure).print_svg(stream, metadata=metadata)
    return stream.getvalue()


def one_panel(ax: Axes | None, width: float, height: float) -> tuple[Figure, Axes]:
    """The given axes and their figure, or those of a new figure [inch]."""
    if ax is None:
        figure = new_figure(width, height)
        return figure, figure.add_subplot()
    return ax.get_figure(root=True), ax  # type: ignore[return-value]


def branch_styles(count: int) -> list[tuple[str, Any, str]]:
    """Style of the loading and of each unloading; the styles of unloadings repeat, that of the loading is unique."""
    return [STYLES[n] if n == 0 else STYLES[1 + (n - 1) % (len(STYLES) - 1)] for n in range(count)]


def map_panel(
    axes: Axes, values: Array, size: tuple[float, float], colours: Any, title: str, unit: str = "mm", **scale: Any
) -> None:
    """Map of values (n1, n2) over a face of the given size [`unit`], x1 upwards, with its colour bar."""
    image = axes.imshow(
        values, origin="lower", extent=(0.0, size[1], 0.0, size[0]), cmap=colours, interpolation="nearest", **scale
    )
    colour_bar(axes, image)
    axes.set_title(title, fontsize=9.5)
    axes.set(xlabel=f"x2 along the seal [{unit}]", ylabel=f"x1 [{unit}]", aspect="equal")


def colour_bar(axes: Axes, image: Any, **options: Any) -> Any:
    """A bar as high as the map."""
    bar = axes.get_figure().colorbar(image, cax=axes.inset_axes((1.02, 0, 0.03, 1)), **options)  # type: ignore[union-attr]
    bar.ax.tick_params(which="both", labelsize=8)
    axes.tick_params(labelsize=8)
    return bar


def with_closed(name: str) -> Any:
    """A colour map that shows undefined points and those below its range in grey."""
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=CLOSED, under=CLOSED)


def map_height(size: tuple[float, float], width: float) -> float:
    """Height [inch] of a map of the given sides in a panel of a width, within what can be read."""
    return float(np.clip(width * size[0] / size[1], 0.4, 1.25 * width))
