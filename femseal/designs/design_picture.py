"""Picture of the design answer: leakage against nominal pressure, limits of the classes, Qmin and QSmin."""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.quantities import to_text
from ..plots.drawing import GREY, LEGEND_LINE, LINES, STYLES, Sheet, branch_styles, legend_below
from ..plots.leakage_curves import LeakageCurves, leakage_panel, limit_lines
from ..plots.scales_of_axes import decades
from ..results.selections import pressures_and_peaks
from .design_data import DesignData
from .requirements import ENDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Part of the width of the axes beyond which names would leave them.
_RIGHT = 0.86


def design_figure(answer: DesignData) -> Figure:
    """Leakage that a fraction of the seals does not exceed over nominal pressure: limits of classes, Qmin, QSmin."""
    unit, scale = answer.leak_scale
    seals = answer.seals
    many = seals.count > 1
    what = "leakage per length of seal" if unit.per_length else "leakage of the whole seal"
    curves = LeakageCurves(
        *pressures_and_peaks(seals.steps),
        leakage=seals.curve_of(answer.probability),
        title=f"leakage that {100 * answer.probability:.4g} % of the seals keep" if many else "leakage of the seal",
        band=(seals.curve_of(ENDS[0]), seals.curve_of(ENDS[1])) if many else None,
        quantiles=ENDS,
        scale=(scale, f"{what} [{unit.name}]"),
    )
    lines = ceil((len(seals.steps.unload_from) + 6) / 2)
    sheet = Sheet([4.4 + LEGEND_LINE * lines])
    margins = replace(LINES, left=1.0, right=1.1, top=0.2, bottom=0.7 + LEGEND_LINE * lines)
    axes = sheet.panel(0, 0, margins)
    handles = leakage_panel(axes, curves)
    _limits(axes, answer, scale)
    legend_below(sheet.figure, handles + _marks(axes, answer, scale))
    return sheet.figure


def _limits(axes: Axes, answer: DesignData, scale: float) -> None:
    """A line for each class within the axis, named at its right end; those beyond it are named at the edge."""
    low, high = axes.get_ylim()
    limits = [need.limit / scale for need in answer.requirements if need.limit > 0]
    known = [limit for limit in limits if limit < low]
    # room for limits up to three decades below the leakages
    if near := [limit for limit in known if limit > low * 1e-3]:
        axes.set_ylim(0.5 * min(near), high)
    axes.set_ylim(axes.get_ylim()[0], max(high, *(2 * x for x in limits if x < 1e3 * high), high))
    decades(axes.yaxis)
    low, high = axes.get_ylim()
    limit_lines(axes, {need.name: need.limit / scale for need in answer.requirements})
    below = [need.name for need in answer.requirements if 0 < need.limit / scale <= low]
    above = [need.name for need in answer.requirements if need.limit / scale >= high]
    for names, place, side in ((below, 0.0, "bottom"), (above, 1.0, "top")):
        if names:
            arrow = "↓" if side == "bottom" else "↑"
            text = "\n".join(f" {arrow} {name}" for name in names)
            axes.annotate(text, (1, place), xycoords="axes fraction", va=side, fontsize=8.5, color=GREY)


def _marks(axes: Axes, answer: DesignData, scale: float) -> list[Any]:
    """Qmin on the loading and QSmin on the unloadings, each with its uncertainty; returns handles of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke

    styles = branch_styles(1 + len(answer.seals.steps.unload_from))
    # branches are drawn from the highest peak
    colours = dict(zip(sorted(answer.seals.steps.unload_from, reverse=True), (s[0] for s in styles[1:]), strict=True))
    drawn = False
    for need in answer.requirements:
        marks = [(need.assembly, STYLES[0][0], "v")]
        marks += [(needed, colours[peak], "^") for peak, needed in need.service.items()]
        for needed, colour, marker in marks:
            if not needed.known or not need.limit > 0:
                continue
            drawn = True
            x, y = needed.value / 1e6, need.limit / scale
            if np.isfinite(needed.low):
                ends = [needed.bound(end) / 1e6 for end in (needed.low, needed.high)]
                axes.plot(ends, [y, y], color=colour, lw=3.5, alpha=0.45, solid_capstyle="butt", zorder=4)
            axes.plot([x], [y], color=colour, marker=marker, ms=9, mec="black", mew=0.9, ls="", zorder=5)
            # names at the right end of the axis stand to the left of their mark
            right = axes.transLimits.transform(axes.transScale.transform((x, y)))[0] > _RIGHT
            axes.annotate(
                to_text(needed.value, "Pa", 3),
                (x, y),
                xytext=(-4 if right else 4, 7 if marker == "v" else -15),
                textcoords="offset points",
                ha="right" if right else "left",
                fontsize=8,
                zorder=6,
                path_effects=[withStroke(linewidth=2.5, foreground="white")],
            )
    if not drawn:
        return []
    names = [("v", "Qmin, pressure in assembly")]
    names += [("^", "QSmin, pressure in service")] if answer.seals.steps.unload_from else []
    handles = [Line2D([], [], color="white", marker=m, ms=8, mec="black", ls="", label=text) for m, text in names]
    if answer.seals.count > 1:
        handles.append(Line2D([], [], color=GREY, lw=3.5, alpha=0.45, label="their uncertainty, 90 %"))
    return handles
