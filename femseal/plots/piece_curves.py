"""Permeability of the pieces of a face against their mean gap and their contact pressure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError
from ..flow.law import cubic_law
from ..results.run_data import RunData
from .drawing import GREY, LINES, STYLES, Sheet, decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Decades of permeability below the largest one that are shown, and factor of the scale beyond what is shown.
_DECADES, _BEYOND = 6, 1.5


def pieces_figure(results: RunData) -> Figure:
    """Permeability of pieces along x1 against their mean gap and their pressure, on loading and on unloading.

    Closed pieces, and those a million times less permeable than the most permeable one, are not drawn.
    The line in the first panel is h̄³/12, of parallel plates. Pieces are those that seals draw from, in every state of
    the face, or else those of two scales.

    Raises InputError: results without pieces.
    """
    pieces = pieces_of(results)
    sheet = Sheet([4.2], columns=2)
    margins = replace(LINES, left=0.95)
    for column, (x, label) in enumerate(
        (
            (pieces.mean_gap * 1e6, "mean gap of the piece [µm]"),
            (pieces.pressure / 1e6, "contact pressure of the piece [MPa]"),
        )
    ):
        axes = sheet.panel(0, column, margins)
        axes.set(xlabel=label, ylabel="permeability along x1 [m³]")
        axes.grid(alpha=0.25, lw=0.6)
        _clouds(axes, pieces, x, plates=column == 0)
    return sheet.figure


@dataclass(frozen=True)
class Pieces:
    """Permeability along x1 [m³], mean gap [m] and contact pressure [Pa] of pieces, each (states, pieces).

    loading : whether a state is on loading (states,). nominal : pressure of each state [Pa].
    """

    k: Array
    mean_gap: Array
    pressure: Array
    loading: NDArray[np.bool_]
    nominal: Array


def pieces_of(results: RunData) -> Pieces:
    """The pieces of a run.

    Raises InputError: results without pieces.
    """
    data = results.dataset
    kind = next((kind for kind in ("state", "piece") if f"{kind}_k1" in data), None)
    if kind is None:
        raise InputError("pieces figure", "results without pieces", "those of a two-scale or a stochastic study")
    k, gap, pressure = (data[f"{kind}_{name}"].values for name in ("k1", "mean_gap", "pressure"))
    k, gap, pressure = (values.reshape(len(values), -1) for values in (k, gap, pressure))
    prefix = "state_" if kind == "state" else ""
    loading = np.isnan(data[f"{prefix}unloaded_from"].values)
    return Pieces(k, gap, pressure, loading, data[f"{prefix}nominal_pressure"].values)


def _clouds(axes: Axes, pieces: Pieces, x: Array, *, plates: bool) -> None:
    """A point for each open piece in each state, in two colours, and the line of parallel plates over a gap [µm]."""
    k = pieces.k
    with np.errstate(invalid="ignore"):
        shown = (k > np.nanmax(k, initial=0.0) * 10.0**-_DECADES) & ((x > 0) | (not plates))
    if not shown.any():
        axes.annotate("every piece is closed", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY)
        return
    look: dict[str, Any] = {"ls": "", "mew": 0, "alpha": 0.55, "rasterized": True}
    for name, states, (colour, _, marker) in zip(
        ("loading", "unloading"), (pieces.loading, ~pieces.loading), STYLES, strict=False
    ):
        if states.any():
            seen = shown[states]
            axes.plot(x[states][seen], k[states][seen], color=colour, marker=marker, ms=4, label=name, **look)
    low, high = float(k[shown].min()), float(k[shown].max())
    if plates:
        h = np.geomspace(float(x[shown].min()) / 1.1, float(x[shown].max()) * 1.1, 50)
        axes.plot(h, cubic_law(h * 1e-6), color="black", lw=1.4, label="parallel plates, h̄³/12")
        axes.set(xscale="log", xlim=(h[0], h[-1]))
        high = max(high, float(cubic_law(h[-1] * 1e-6)))
        decades(axes.xaxis)
    axes.set(yscale="log", ylim=(low / _BEYOND, high * _BEYOND))
    decades(axes.yaxis)
    above = axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncols=3, frameon=False, fontsize=9)
    for handle in above.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
