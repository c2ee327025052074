"""Define the style of all pictures: sizes, fonts, line widths and colours, and the formats of picture files.

A picture is as wide as a journal column, so that its text is legible in print, on a page and on a phone.
Colour-blind readers can distinguish the colours, which also differ in lightness.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from ..base import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Arguments = ParamSpec("Arguments")

#: Width of every picture [inch]: 85 mm, one column of a journal.
PAGE = 85 / 25.4
#: Pixels per inch of a picture; the second value is the largest, for a picture with a map of many pixels.
DPI = 300
MOST_DPI = 450
#: Parameters of matplotlib that differ from its defaults. Sizes of letters and widths of lines are in points.
PARAMETERS: dict[str, Any] = {
    # this font comes with matplotlib, so that pictures are the same on every machine
    "font.family": ["DejaVu Sans"],
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "figure.titlesize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.title_fontsize": 7,
    "legend.frameon": False,
    "legend.borderaxespad": 0.3,
    "axes.labelpad": 3,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.2,
    "lines.markeredgewidth": 0.7,
    "patch.linewidth": 0.6,
    "hatch.linewidth": 0.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "xtick.major.pad": 2.5,
    "ytick.major.pad": 2.5,
    "grid.linewidth": 0.4,
    "grid.alpha": 0.3,
    "savefig.dpi": "figure",
    "pdf.fonttype": 42,  # journals ask for fonts that can be embedded and searched
    "svg.hashsalt": "femseal",  # the same picture gives the same file
}
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
#: Line styles of the loading and of the unloadings in pictures whose colours show the load.
LINE_STYLES = ("-", "--", ":", "-.")
GREY = "#666666"
#: Part of the colour map "viridis" that is used for lines and points; brighter colours are hardly visible on white.
_LINE_COLOURS = (0.0, 0.88)


@contextmanager
def style() -> Iterator[None]:
    """Use the style of femseal's pictures inside a `with` block, and restore the user's style at its end."""
    from matplotlib import style as matplotlib_style

    with matplotlib_style.context(["default", PARAMETERS]):
        yield


def styled(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Make a function draw in the style of femseal, unless it draws into axes that the user passes as `ax`."""
    if hasattr(draw, "__wrapped__"):  # the function draws in this style already
        return draw

    @wraps(draw)
    def draw_in_style(*arguments: Arguments.args, **options: Arguments.kwargs) -> Figure:
        bound = signature(draw).bind(*arguments, **options)
        if bound.arguments.get("ax") is not None:
            return draw(*arguments, **options)
        with style():
            return draw(*arguments, **options)

    return draw_in_style


def branch_styles(count: int) -> list[dict[str, Any]]:
    """Return line styles for `count` branches of a load cycle: the loading and `count` − 1 unloadings.

    The first style is used only for the loading. The other styles are used for the unloadings, and repeat if the load
    cycle has more unloadings than styles.
    """
    style_count = len(STYLES) - 1  # for unloadings
    style_numbers = [0, *(1 + n % style_count for n in range(count - 1))]
    return [STYLES[number] | {"marker": MARKERS[number]} for number in style_numbers[:count]]


def sequential_colours(count: int) -> list[Any]:
    """Return colours from dark to bright for `count` ordered lines, such as lines for increasing loads."""
    import numpy as np
    from matplotlib import colormaps

    dark, bright = _LINE_COLOURS
    fractions = np.linspace(dark, bright, count) if count > 1 else np.array([dark])
    return list(colormaps["viridis"](fractions))


# --- formats of files -------------------------------------------------------------------------------------


def png(figure: Figure) -> bytes:
    """Render a figure as PNG.

    The figure is drawn only once, whereas `Figure.savefig` would draw the figure twice.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    stream = io.BytesIO()
    with style():
        FigureCanvasAgg(figure).print_png(stream)
    return stream.getvalue()


def rendered(figure: Figure, file_format: str) -> bytes:
    """Render a figure in a format.

    Parameters
    ----------
    figure : Figure
        The figure.
    file_format : {"png", "svg", "pdf"}
        Format of the picture. In vector formats, text and lines are not rasterised, and maps are drawn at full
        resolution.

    Returns
    -------
    bytes
        Content of the picture file. The file contains no date, so the same figure always gives an identical file.
    """
    from matplotlib.image import AxesImage

    if file_format == "png":
        return png(figure)
    for image in figure.findobj(AxesImage):
        image.set_interpolation("none")  # type: ignore[attr-defined]
    no_date = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}[file_format]
    stream = io.BytesIO()
    with style():
        figure.savefig(stream, format=file_format, metadata=no_date)
    return stream.getvalue()


def rendered_formats(figure: Figure, formats: Sequence[str]) -> dict[str, bytes]:
    """Render a figure in several formats, see `rendered`; return the content of the picture file for each format."""
    # PNG comes first, because rendering in the other formats changes the figure
    png_first = sorted(formats, key=lambda form: form != "png")
    return {form: rendered(figure, form) for form in png_first}


def write_figure(figure: Figure, folder: Path, stem: str, formats: Sequence[str]) -> list[Path]:
    """Write a figure to a file in each of several formats, and return the paths of the files.

    stem : name of the files without their suffix, which is the format.
    """
    contents = rendered_formats(figure, formats)
    return [write_bytes(folder / f"{stem}.{form}", contents[form]) for form in formats]
