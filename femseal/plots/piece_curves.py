"""Permeability of the pieces of a face against their mean gap and their contact pressure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, Flags, InputError
from ..flow.law import cubic_law
from ..results.results import Results
from .drawing import GREY, LEGEND_LINE, LINES, Sheet, branch_styles, decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Decades of permeability below the largest one that are shown, and factor of the scale beyond what is shown.
_DECADES, _BEYOND = 6, 1.5


def pieces_figure(results: Results) -> Figure:
    """Permeability of pieces along x1 against their mean gap and their pressure, on loading and on unloading.

    Closed pieces, and those a million times less permeable than the most permeable one, are not drawn.
    The line in the first panel is h̄³/12, of parallel plates. Pieces are those that seals draw from,
    or else those of two scales.

    Raises InputError: results without pieces.
    """
    k, mean_gap, pressure, loading = _pieces(results)
    below = LEGEND_LINE * 3
    sheet = Sheet([3.6 + below] * 2, head=0.35)
    sheet.head("each point: a piece of the face at one load")
    quantities = (
        (mean_gap * 1e6, "mean gap between the faces of the piece [µm]"),
        (pressure / 1e6, "mean contact pressure of the piece [MPa]"),
    )
    for row, (x, label) in enumerate(quantities):
        axes = sheet.panel(row, replace(LINES, top=0.1, bottom=LINES.bottom + below))
        axes.set(xlabel=label, ylabel="permeability towards the outlet [m³]")
        axes.grid(alpha=0.25, lw=0.6)
        if _clouds(axes, k, x, loading, plates=row == 0):
            axes.legend(
                loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize=8.5, frameon=False
            )
    return sheet.figure


def _pieces(results: Results) -> tuple[Array, Array, Array, Flags]:
    """Permeability along x1 [m³], mean gap [m] and pressure [Pa] of pieces (states, pieces), and which load (states,).

    Raises InputError: results without pieces.
    """
    data = results.dataset
    kind = next((kind for kind in ("state", "piece") if f"{kind}_k1" in data), None)
    if kind is None:
        raise InputError(
            "pieces figure", "results without pieces", "those of a two-scale or a stochastic study"
        )
    fields = (data[f"{kind}_{name}"].values for name in ("k1", "mean_gap", "pressure"))
    k, gap, pressure = (values.reshape(len(values), -1) for values in fields)
    peaks = data["state_unloaded_from" if kind == "state" else "unloaded_from"].values
    return k, gap, pressure, np.isnan(peaks)


def _clouds(axes: Axes, k: Array, x: Array, loading: Flags, *, plates: bool) -> bool:
    """A point for each open piece in each state, in two colours, and the line of parallel plates over a gap [µm].

    Returns whether a piece is open.
    """
    with np.errstate(invalid="ignore"):
        shown = (k > np.nanmax(k, initial=0.0) * 10.0**-_DECADES) & ((x > 0) | (not plates))
    if not shown.any():
        axes.annotate(
            "every piece is closed", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY
        )
        return False
    branches = (("loading", loading), ("unloading", ~loading))
    for (name, states), look in zip(branches, branch_styles(2), strict=True):
        if states.any():
            seen = shown[states]
            look |= {"ls": "", "ms": 4, "mew": 0, "alpha": 0.55, "rasterized": True}
            label = f"{name}{', all closed' * (not seen.any())}"
            axes.plot(x[states][seen], k[states][seen], label=label, **look)
    low, high = k[shown].min(), k[shown].max()
    if plates:
        h = np.geomspace(x[shown].min() / 1.1, x[shown].max() * 1.1, 50)
        axes.plot(h, cubic_law(h * 1e-6), color="black", lw=1.4, label="parallel plates, h̄³/12")
        axes.set(xscale="log", xlim=(h[0], h[-1]))
        high = max(high, cubic_law(h[-1] * 1e-6))
        decades(axes.xaxis)
    axes.set(yscale="log", ylim=(low / _BEYOND, high * _BEYOND))
    decades(axes.yaxis)
    return True
