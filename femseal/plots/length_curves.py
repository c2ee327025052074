"""Leakage of drawn seals against their length."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..results import seal_lengths
from ..results.run_data import RunData
from ..results.tables import leakage_of
from .drawing import LINES, STYLES, Sheet, legend_below
from .leakage_curves import leakage_axis, leakage_band, leakage_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def lengths_figure(results: RunData) -> Figure:
    """Median and band of the leakage against the length of the seal, log scales, at a few load steps.

    The shaded band is that between the quantiles of the realisations, which narrows with the length; the lighter one
    has the error of the library besides, which does not.

    Raises
    ------
    InputError : results of one length.
    """
    data, curves = results.dataset, seal_lengths.length_curves(results)
    sheet = Sheet([5.0])
    axes = sheet.panel(0, 0, replace(LINES, left=1.0, right=0.65, top=0.2, bottom=1.0))
    lengths, steps = data["seal_length"].values, seal_lengths.length_steps(results)
    order = np.argsort(lengths)
    x = lengths[order] * 1e3
    scales = seal_lengths.length_scales(results)[:, None]
    values = {kind: np.abs(each / scales)[order] for kind, each in curves.items()}
    drawn = np.concatenate([v[:, steps].ravel() for v in values.values()])
    floor, lanes = leakage_axis(axes, drawn, len(steps))
    for s, (colour, line, marker), lane in zip(steps, STYLES, lanes, strict=False):
        for end, alpha in (("_together", 0.09), ("", 0.2)):
            if f"lower{end}" not in values:
                continue
            low, high = (values[f"{side}{end}"][:, s] for side in ("lower", "upper"))
            leakage_band(axes, x, low, high, floor, colour, alpha)
        y, name = values["median"][:, s], str(data["name"].values[s])
        leakage_line(axes, x, y, lane, color=colour, ls=line, lw=1.8, marker=marker, ms=4.5, label=name)
    axes.set_xscale("log")
    axes.set_xticks(x, labels=[f"{value:.3g}" for value in x])
    axes.set_xticks([], minor=True)
    what = leakage_of(results).split(",")[0] if not results.leak_unit.per_length else leakage_of(results)
    axes.set(xlabel="length of the seal [mm]", ylabel=f"{what} [{results.leak_unit.name}]")
    axes.grid(alpha=0.25, lw=0.6)
    legend_below(sheet.figure, axes.get_legend_handles_labels()[0])
    return sheet.figure
