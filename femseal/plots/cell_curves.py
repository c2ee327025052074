"""Curves of a library: permeability of cells along the load cycle, and leakage of drawn seals against their length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError
from ..flow.law import cubic_law
from ..results import tables
from ..results.run_data import RunData
from ..results.selections import Steps, branches, solved_steps
from ..results.tables import leakage_of
from .drawing import GREY, LINES, STYLES, Sheet, decades, legend_below, load_axis, panel_title
from .leakage_curves import leakage_axis, leakage_band, leakage_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def cells_figure(results: RunData, count: int = 4) -> Figure:
    """Permeability of cells along the cycle: against nominal pressure, their mean gap, and their contact pressure.

    First: `count` cells along the loading and one unloading, over all cells; no line = closed. The unloading is that
    from the highest peak after which at least a fifth of the cells are open under pressure. Others: loading, unloading,
    and k = h̄³/12 of parallel plates. Cells are those of the library, else the windows.

    Raises InputError: results without cells.
    """
    cells = cells_of(results)
    sheet = Sheet([4.0] * 3)
    margins = replace(LINES, left=1.0, bottom=0.65, top=0.55)
    cell_curves_panel(sheet.panel(0, 0, margins), cells, count)
    gap_panel(sheet.panel(1, 0, margins), cells)
    pressure_panel(sheet.panel(2, 0, margins), cells)
    for axes in sheet.figure.axes:
        axes.tick_params(labelsize=_LETTERS)
        for text in (axes.xaxis.label, axes.yaxis.label, axes.title):
            text.set_fontsize(_LETTERS + 1)
    return sheet.figure


@dataclass(frozen=True)
class Cells:
    """Cells along a cycle, of the library or else the windows: pressure, k, mean gap, each (cells, steps).

    nominal, peaks : nominal pressure of each step, and the one it is unloaded from, NaN on loading [Pa].
    origin : a text on the cells, after their number. columns : of windows in a row, 0 for a library.
    """

    nominal: Array
    peaks: Array
    pressure: Array
    k: Array
    mean_gap: Array
    origin: str
    columns: int = 0

    def name(self, cell: int) -> str:
        """The cell as `Results.cell` and `Results.library_cell` take it."""
        return f"piece {divmod(cell, self.columns)}" if self.columns else f"library window {cell}"

    @property
    def limits(self) -> tuple[float, float]:
        """Range of k that is shown [m³], at most twelve decades; NaN where every cell is closed."""
        positive = self.k[np.isfinite(self.k) & (self.k > 0)]
        if positive.size == 0:
            return np.nan, np.nan
        return max(float(positive.min()) / 3, float(positive.max()) * 1e-12), float(positive.max()) * 3


def cells_of(results: RunData) -> Cells:
    """The cells of a run.

    Raises InputError: results without cells.
    """
    data = results.dataset.isel(step=solved_steps(results.dataset))
    if "library_k" in data:
        prefix, origin, columns = "library_", " of the library", 0
        arrays = [data[f"library_{n}"].values for n in ("pressure", "k", "mean_gap")]
    elif "k1" in data:
        prefix, origin, columns = "", "", data.sizes["cell2"]
        names = "window_pressure", "k1", "window_mean_gap"
        arrays = [data[name].values.reshape(data.sizes["step"], -1).T for name in names]
    else:
        raise InputError("cells figure", "results without cells", "those of a two-scale or a stochastic study")
    nominal, peaks = (data[f"{prefix}{name}"].values for name in ("nominal_pressure", "unloaded_from"))
    return Cells(nominal, peaks, arrays[0], arrays[1], arrays[2], origin, columns)


#: Size of letters [points] of a figure that is legible in a column of 85 mm, where it is .62 times as large.
_LETTERS = 11
#: Points of many cells.
_CLOUD: dict[str, Any] = {"ls": "", "rasterized": True, "mew": 0}


def cell_curves_panel(axes: Axes, cells: Cells, count: int = 4) -> None:
    """`count` cells along the loading and one unloading, over all cells; no line = closed."""
    nominal, k = cells.nominal / 1e6, cells.k
    axes.set(xlabel="nominal pressure [MPa]", ylabel="permeability k along x1 [m³]")
    axes.grid(alpha=0.25, lw=0.6)
    for steps, marker in ((np.isnan(cells.peaks), "o"), (~np.isnan(cells.peaks), "s")):
        shown = k[:, steps] > 0
        x = np.broadcast_to(nominal[steps], shown.shape)[shown]
        axes.plot(x, k[:, steps][shown], color="#BBBBBB", alpha=0.5, ms=2.5, marker=marker, **_CLOUD)
    parts = branches(cells.nominal, cells.peaks)
    up, down, name = _example_path(parts, (k > 0) & (cells.pressure > 0))
    for cell, (colour, line, _) in zip(_examples(k, cells.pressure, up, down, count), STYLES[1:], strict=False):
        for steps, width, size in ((up, 1.0, 2.5), (down, 2.4, 3.5)) if name else ((up, 2.4, 3.5),):
            y = np.where(k[cell, steps] > 0, k[cell, steps], np.nan)
            label = cells.name(int(cell)) if width > 2 else None
            axes.plot(nominal[steps], y, color=colour, ls=line, lw=width, marker="o", ms=size, label=label)
    panel_title(axes, f"thin: loading{name};\nno line: closed" if name else "no line: closed")
    load_axis(axes, nominal)
    if not _log_permeability(axes, cells):
        return
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=_LETTERS - 1, loc="best", framealpha=0.9, handlelength=4)


def gap_panel(axes: Axes, cells: Cells) -> None:
    """Permeability against mean gap, loading and unloading, with k = h̄³/12 of parallel plates."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set(xlabel="mean gap of the window [µm]", ylabel="permeability k along x1 [m³]")
    axes.grid(alpha=0.25, lw=0.6)
    _branch_clouds(axes, cells, cells.mean_gap * 1e6)
    if not _log_permeability(axes, cells):
        return
    low, high = cells.limits
    with np.errstate(invalid="ignore"):
        h = cells.mean_gap[(cells.k >= low) & (cells.mean_gap > 0)] * 1e6
    plates = np.geomspace(h.min() / 1.3, h.max() * 1.3, 50)
    axes.set_xscale("log")
    axes.plot(plates, cubic_law(plates * 1e-6), color="black", lw=1.4, label="parallel plates, h̄³/12")
    axes.set_xlim(plates[0], plates[-1])
    axes.set_ylim(low, max(high, 3 * cubic_law(plates[-1] * 1e-6)))
    decades(axes.yaxis)
    if plates[-1] < 1e3 * plates[0]:
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
    else:
        decades(axes.xaxis)
    axes.xaxis.set_minor_formatter(NullFormatter())
    _opaque_legend(axes, "upper left")


def pressure_panel(axes: Axes, cells: Cells) -> None:
    """Permeability against the contact pressure of the cell, loading and unloading."""
    axes.set(xlabel="contact pressure of the window [MPa]", ylabel="permeability k along x1 [m³]")
    axes.grid(alpha=0.25, lw=0.6)
    _branch_clouds(axes, cells, cells.pressure / 1e6)
    if _log_permeability(axes, cells):
        axes.set_xlim(left=0)
        _opaque_legend(axes, "best")


def _branch_clouds(axes: Axes, cells: Cells, x: Array) -> None:
    loading = np.isnan(cells.peaks)
    two = (("loading", loading, STYLES[0][0], "o"), ("unloading", ~loading, STYLES[1][0], "s"))
    for name, steps, colour, marker in two:
        if steps.any():
            shown = cells.k[:, steps] > 0
            look: dict[str, Any] = {"color": colour, "marker": marker, "alpha": 0.45, "ms": 3}
            axes.plot(x[:, steps][shown], cells.k[:, steps][shown], label=name, **look, **_CLOUD)


def _log_permeability(axes: Axes, cells: Cells) -> bool:
    """Set a log scale of k over the cells, or write that every cell is closed."""
    low, high = cells.limits
    if np.isnan(low):
        axes.annotate("every cell is closed", (0.5, 0.5), xycoords="axes fraction", ha="center", color=GREY)
        return False
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    decades(axes.yaxis)
    return True


def _opaque_legend(axes: Axes, place: Any) -> None:
    for handle in axes.legend(fontsize=_LETTERS - 1, loc=place, framealpha=0.9).legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)


def _example_path(parts: list[tuple[str, Steps]], open_: NDArray[np.bool_]) -> tuple[Steps, Steps, str]:
    """Steps of the loading up to a peak, steps of the unloading from there, and the name of the unloading."""
    loading = parts[0][1]
    if len(parts) == 1:
        return loading, loading[:0], ""
    reopened = [bool(np.mean(open_[:, steps[1:]].any(axis=1)) >= 0.2) for _, steps in parts[1:]]
    name, down = parts[1 + reopened.index(True) if any(reopened) else -1]
    up = loading[: int(np.flatnonzero(loading == down[0])[0]) + 1]
    return up, down, f", thick: {name}"


def _examples(k: Array, pressure: Array, up: Steps, down: Steps, count: int) -> Steps:
    """Cells that represent the scatter: evenly spaced in the order of open steps, then of k at the top of the path."""
    path = np.r_[up, down[1:]]
    known = np.isfinite(k[:, path]).all(axis=1) & (pressure[:, up[-1]] > 0) & (k[:, up] > 0).any(axis=1)
    cells = np.flatnonzero(known)
    order = cells[np.lexsort((k[cells, up[-1]], (k[cells][:, path] > 0).sum(axis=1)))]
    places = np.unique(np.round(np.linspace(0.1, 0.95, count) * (order.size - 1)).astype(int))
    return order[places] if order.size else order


def lengths_figure(results: RunData) -> Figure:
    """Median and band of the leakage against the length of the seal, log scales, at a few load steps.

    The shaded band is that between the quantiles of the realisations, which narrows with the length; the lighter one
    has the error of the library besides, which does not.

    Raises InputError: results of one length.
    """
    data, curves = results.dataset, tables.length_curves(results)
    sheet = Sheet([5.0])
    axes = sheet.panel(0, 0, replace(LINES, left=1.0, right=0.65, top=0.2, bottom=1.0))
    lengths, steps = data["seal_length"].values, tables.length_steps(results)
    order = np.argsort(lengths)
    x = lengths[order] * 1e3
    scales = tables.length_scales(results)[:, None]
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
