"""Picture of a calibration: measured leakages in the band of the posterior, and pairs of what was calibrated."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..plots.drawing import GREY, LEGEND_LINE, LINES, STYLES, Sheet, branch_styles, legend_below
from .posterior import PROBABILITY, UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Units of the axes, by those in SI, and what is 1 in them.
_SCALES = {"Pa": ("MPa", 1e6), "N": ("kN", 1e3), "N/m": ("N/mm", 1e3), "m": ("µm", 1e-6), "": ("", 1.0)}
#: Height of the axes [inch].
_HEIGHT = 3.6


def calibration_figure(found: Any) -> Figure:
    """Of a `Calibration`: leakage against load, log scale; then hardness against shortest wave and factor."""
    test = found.test
    peaks = sorted({s.unloaded_from for s in test.steps if s.unloaded_from is not None}, reverse=True)
    below = 0.75 + LEGEND_LINE * (len(peaks) + 2)
    sheet = Sheet([_HEIGHT + below], columns=3)
    margins = replace(LINES, left=1.0, bottom=below)
    axes = sheet.panel(0, 0, margins)
    unit, size = _SCALES[found.load_unit]
    handles = []
    for peak, (colour, _, marker) in zip([None, *peaks], branch_styles(1 + len(peaks)), strict=True):
        rows = [n for n, step in enumerate(test.steps) if step.unloaded_from == peak]
        rows.sort(key=lambda n: test.steps[n].pressure)
        if not rows:
            continue
        load = np.array([test.steps[n].pressure for n in rows]) / size
        low, median, high = np.where(found.curve > 0, found.curve, np.nan)[:, rows]
        axes.fill_between(load, np.nan_to_num(low), high, color=colour, alpha=0.25, lw=0)
        name = "loading" if peak is None else f"unloading from {peak / size:.4g} {unit}"
        handles += axes.plot(load, median, color=colour, label=f"{name}: calibrated, band of {100 * PROBABILITY:g} %")
        leaks = ~test.sealed[rows]
        values = test.leakage[rows]
        handles += axes.plot(load[leaks], values[leaks], marker, color=colour, mec="black", label=f"{name}: measured")
        if not leaks.all():
            label = f"{name}: sealed, or below this"
            handles += axes.plot(load[~leaks], values[~leaks], "v", color="white", mec=colour, ms=9, label=label)
    axes.set_yscale("log")
    axes.set_xlabel(f"{'nominal pressure' if found.load_unit == 'Pa' else 'load'} [{unit}]")
    axes.set_ylabel(f"leakage [{test.unit.name}]")
    axes.grid(alpha=0.25, lw=0.6)
    for column, name in enumerate(("shortest_wave", "factor"), start=1):
        _pair(sheet.panel(0, column, margins), found, "hardness", name)
    legend_below(sheet.figure, handles, columns=3)
    return sheet.figure


def _pair(axes: Axes, found: Any, across: str, up: str) -> None:
    """Samples of two quantities, with solved scenes where they have both, and the medians."""
    names = list(UNITS)
    (x, x_size), (y, y_size) = (_SCALES[UNITS[name]] for name in (across, up))
    samples = found.samples[:, [names.index(across), names.index(up)]] / (x_size, y_size)
    axes.plot(*samples.T, ".", color=STYLES[0][0], ms=1.5, alpha=0.3, zorder=1)
    if up == "shortest_wave":
        axes.plot(*(found.scenes / (x_size, y_size)).T, "+", color=GREY, ms=6, label="solved scenes")
        axes.legend(loc="upper right", fontsize=8.5, frameon=False)
    axes.plot(*np.median(samples, axis=0), "o", color="black", ms=6)
    axes.set_xlabel(f"{across} [{x}]")
    axes.set_ylabel(f"{up.replace('_', ' ')} [{y}]" if y else "factor between test and model")
    axes.set_title(f"correlation {found.correlation[names.index(across), names.index(up)]:+.2f}", fontsize=9)
    axes.grid(alpha=0.25, lw=0.6)
