"""Draw the leakage of a seal over the load, with the loads that its leakage classes need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.leak_units import LeakUnit
from ..plots.drawing import LEGEND_LINE, LOADS, Sheet, label_decades, legend_below
from ..plots.leakage_panels import LeakageCurves, leakage_panel, limit_lines, limits_width
from ..plots.style import GREY, branch_styles
from ..results.leakage_format import leakage_kind
from ..results.load_steps import LoadFormat, pressures_and_peaks
from ..results.needed_pressure import LoadText
from .requirements import ENDS, Requirement, Seals

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height of the axes of the picture [inch].
_AXES_HEIGHT = 2.5


def requirements_figure(
    seals: Seals,
    requirements: Sequence[Requirement],
    leak_scale: tuple[LeakUnit, float],
    loads: LoadFormat,
    load_text: LoadText,
) -> Figure:
    """Draw the leakage and its 95 % interval over the load, with the limits of the classes, Qmin and QSmin.

    Parameters
    ----------
    seals : Seals
        Leakages of the realisations.
    requirements : sequence of Requirement
        Qmin and QSmin of each class.
    leak_scale : (LeakUnit, float)
        Unit of the leakage axis, and its size as a leakage per length of seal [m²/s].
    loads : LoadFormat
        Format of the load axis and of the names of the branches.
    load_text : callable
        Function that formats the pressures [Pa] Qmin and QSmin.
    """
    unit, scale = leak_scale
    curve = seals.curve
    band, band_name = None, "95 % interval"
    if curve.has_interval:
        band = curve.lower, curve.upper
    elif seals.count > 1:
        low, high = ENDS
        band = seals.quantile_curve(low), seals.quantile_curve(high)
        band_name = f"{100 * low:g} – {100 * high:g} % of the seals"
    pressure, peaks = pressures_and_peaks(seals.steps)
    curves = LeakageCurves(
        pressure=pressure,
        peaks=peaks,
        leakage=np.where(np.isfinite(curve.leakage), curve.leakage, np.nan),
        title="",
        band=band,
        band_name=band_name,
        scale=(scale, f"{leakage_kind(unit)} [{unit.name}]"),
        loads=loads,
    )
    # besides the unloadings: loading, interval, Qmin, QSmin, the bar of their intervals, and a margin of one entry
    n_entries = len(seals.steps.unload_from) + 6
    legend_height = LEGEND_LINE * ceil(n_entries / 2)  # the legend has two columns
    limits = {need.name: need.limit / scale for need in requirements}
    margins = replace(
        LOADS,
        right=LOADS.right + limits_width(limits),
        bottom=LOADS.bottom + legend_height,
    )
    sheet = Sheet([_AXES_HEIGHT + margins.bottom + margins.top])
    axes = sheet.panel(0, margins)
    handles = leakage_panel(axes, curves)
    _extend_to_limits(axes, list(limits.values()))
    limit_lines(axes, limits)
    handles += _mark_needed_pressures(
        axes, seals.steps.unload_from, requirements, scale, loads, load_text
    )
    legend_below(sheet.figure, handles)
    return sheet.figure


def _extend_to_limits(axes: Axes, limits: list[float]) -> None:
    """Extend the leakage axis to class limits that lie less than three decades beyond its ends."""
    low, high = axes.get_ylim()
    near_limits = [limit for limit in limits if 1e-3 * low < limit < 1e3 * high]
    lowest = min([low, *(limit / 2 for limit in near_limits)])
    highest = max([high, *(2 * limit for limit in near_limits)])
    axes.set_ylim(lowest, highest)
    label_decades(axes.yaxis)


def _mark_needed_pressures(
    axes: Axes,
    unload_from: Sequence[float],
    requirements: Sequence[Requirement],
    scale: float,
    loads: LoadFormat,
    load_text: LoadText,
) -> list[Any]:
    """Mark Qmin on the loading curve and QSmin on the unloading curves, each with a bar for its 95 % interval.

    Parameters
    ----------
    axes : Axes
        Axes of leakage over load.
    unload_from : sequence of float
        Nominal pressures from which the seal is unloaded [Pa].
    requirements : sequence of Requirement
        Qmin and QSmin of each class.
    scale : float
        Leakage per length of seal [m²/s] that corresponds to 1 on the leakage axis.
    loads : LoadFormat
        Format of the load axis.
    load_text : callable
        Function that formats the marked pressures [Pa].

    Returns
    -------
    list of artists
        Lines that represent the marks in the legend.
    """
    from matplotlib.lines import Line2D

    _, load_factor = loads.axis  # load, in the unit of the axis, for a nominal pressure of 1 Pa
    # the branches are drawn in this order: loading, then unloading from the highest peak to the lowest
    peaks = sorted(unload_from, reverse=True)
    branches = [None, *peaks]
    styles = dict(zip(branches, branch_styles(len(branches)), strict=True))
    for need in requirements:
        if need.limit <= 0:
            continue
        leakage = need.limit / scale
        for peak, needed in [(None, need.assembly), *need.service.items()]:
            if not np.isfinite(needed.at):
                continue
            load = load_factor * needed.at
            colour = styles[peak]["color"]
            marker, text_offset = ("v", 5) if peak is None else ("^", -11)
            ends = [load_factor * needed.bound(end) for end in (needed.low, needed.value)]
            axes.plot(ends, [leakage] * 2, color=colour, lw=2.5, alpha=0.45, zorder=4)
            axes.plot(
                load, leakage, color=colour, marker=marker, ms=6, mec="black", mew=0.5, zorder=5
            )
            axes.annotate(
                load_text(needed.at),
                (load, leakage),
                (4, text_offset),
                textcoords="offset points",
                fontsize=7,
                zorder=6,
            )
    handles = [
        Line2D([], [], color="white", marker=marker, ms=6, mec="black", label=f"{name} as computed")
        for marker, name in (("v", "Qmin"), ("^", "QSmin"))
    ]
    bar = Line2D([], [], color=GREY, lw=2.5, alpha=0.45, label="its 95 % interval")
    return [*handles, bar]
