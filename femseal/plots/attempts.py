"""Time against error of the attempts at the accuracy that a case asks for."""

from __future__ import annotations

from math import expm1
from typing import TYPE_CHECKING, Any

from .drawing import GREY, LINES, STYLES, Sheet, decades

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest half-width of ln(leakage) that is drawn: beyond it nothing is known.
_MOST = 700.0


def attempts_figure(found: dict[str, Any]) -> Figure:
    """Error of each attempt over its time, log scales; the wanted accuracy is a dotted line.

    found : `Results.attempts`. An attempt whose error is 0 or has no end is left out.
    """
    sheet = Sheet([3.6])
    axes = sheet.panel(0, 0, LINES)
    axes.set(xscale="log", yscale="log", xlabel="time [s]", ylabel="error of the leakage [%]")
    times, errors = [], []
    for number, attempt in enumerate(found["attempts"], start=1):
        if 0 < (attempt["half_width"] or 0) < _MOST:
            times.append(attempt["with_coarse"])
            errors.append(100 * expm1(attempt["half_width"]))
            points = " × ".join(map(str, attempt["points"]))
            at = times[-1], errors[-1]
            axes.annotate(f"{number}: {points}", at, (0, 8), textcoords="offset points", ha="center")
    colour, _, marker = STYLES[0]
    axes.plot(times, errors, color=colour, ls="", marker=marker)
    axes.axhline(100 * found["wanted"], color=GREY, ls=":", label="wanted accuracy")
    axes.margins(0.25, 0.15)
    axes.grid(alpha=0.25, lw=0.6)
    axes.legend(frameon=False)
    decades(axes.xaxis)
    decades(axes.yaxis)
    return sheet.figure
