"""Pictures of leakage and of cells. Figures are made without pyplot, so no display or backend is touched."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .tables import branch_text, leakage_unit

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .results import Results

Array = NDArray[np.float64]
Steps = NDArray[np.int64]
#: Loading first, then unloadings: colours that the colour-blind tell apart (Okabe & Ito), line style and marker.
STYLES = (
    ("#D55E00", "-", "o"),
    ("#0072B2", "--", "s"),
    ("#009E73", "-.", "^"),
    ("#CC79A7", ":", "D"),
    ("#56B4E9", (0, (5, 1, 1, 1, 1, 1)), "v"),
    ("#000000", (0, (8, 2)), "P"),
)
_GREY = "#666666"
#: Studies shown by single markers beside the realisations.
_SINGLE = (("two-scale", "D", 7), ("deterministic", "x", 5))


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] that lays itself out and belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=150)


def branches(data: xarray.Dataset, prefix: str = "") -> list[tuple[str, Steps]]:
    """Name and steps of the loading and of each unloading, which begins at its peak on the loading."""
    pressure, peaks = data[f"{prefix}nominal_pressure"].values, data[f"{prefix}unloaded_from"].values
    loading = np.flatnonzero(np.isnan(peaks))
    found = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        start = loading[pressure[loading] == peak]
        found.append((branch_text(float(peak)), np.r_[start, np.flatnonzero(peaks == peak)]))
    return found


def leakage_figure(results: Results) -> Figure:
    """Size of the leakage per length against nominal pressure, log scale; steps without leakage stand in a strip below.

    Band: between the quantiles of the realisations, mean thin and dotted, where there are realisations.
    """
    data = results.dataset
    figure = new_figure(7.4, 4.4)
    axes = figure.add_subplot()
    drawn = [n for n in ("leakage_median", "leakage_mean", "leakage_lower", "leakage_upper", "leakage_two_scale",
                         "leakage_deterministic") if n in data]  # fmt: skip
    factor, unit = leakage_unit(results.leakage)
    pressure = data["nominal_pressure"].values / 1e6
    parts = branches(data)
    floor, lanes = _log_axis(axes, np.abs(np.concatenate([data[n].values for n in drawn])) / factor, len(parts))
    for (name, steps), (colour, line, marker), lane in zip(parts, _styles(len(parts)), lanes, strict=True):
        x, y = pressure[steps], np.abs(results.leakage.values[steps]) / factor
        if "leakage_lower" in data:
            low, high = (np.abs(data[f"leakage_{end}"].values[steps]) / factor for end in ("lower", "upper"))
            axes.fill_between(x, np.maximum(low, floor), np.maximum(high, floor), color=colour, alpha=0.18, lw=0)
            mean = np.abs(data["leakage_mean"].values[steps]) / factor
            axes.plot(x, np.where(mean > 0, mean, np.nan), color=colour, ls=":", lw=1.1)
        axes.plot(x, np.where(y > 0, y, np.nan), color=colour, ls=line, lw=1.8, marker=marker, ms=4.5, label=name)
        axes.plot(x[y == 0], np.full(np.sum(y == 0), lane), color=colour, ls="", marker=marker, ms=4.5)
        for study, symbol, size in _SINGLE:
            if _variable(study) in data and study != results.method:
                single = np.abs(data[_variable(study)].values[steps]) / factor
                at = np.where(single == 0, lane, single)
                axes.plot(x, at, color=colour, ls="", marker=symbol, ms=size, mew=1.2, mfc="none")
    notes = ["gas at 101 325 Pa"] if "IdealGas" in str(data.attrs.get("fluid", "")) else []
    notes += ["from outlet to inlet"] if data.attrs["outlet_pressure_Pa"] > data.attrs["inlet_pressure_Pa"] else []
    axes.set_xlabel("nominal pressure [MPa]")
    axes.set_ylabel("\n".join([f"leakage per length of seal [{unit}]", *([", ".join(notes)] if notes else [])]))
    axes.set_xlim(0, pressure.max() * 1.03)
    axes.grid(alpha=0.25, lw=0.6)
    figure.legend(handles=_leakage_legend(axes, results), loc="outside right upper", frameon=False,
                  fontsize=8.5, handlelength=3.4)  # fmt: skip
    return figure


def _styles(count: int) -> list[Any]:
    return [STYLES[n] if n == 0 else STYLES[1 + (n - 1) % (len(STYLES) - 1)] for n in range(count)]


def _variable(method: str) -> str:
    return f"leakage_{method.replace('-', '_')}"


def _log_axis(axes: Axes, values: Array, count: int) -> tuple[float, list[float]]:
    """Log scale over the values > 0, and below it a strip for those that are 0.

    Returns the end of the scale, and the places of `count` branches in the strip.
    """
    axes.set_yscale("log")
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (float(positive.min()), float(positive.max())) if positive.size else (0.1, 10.0)
    low = max(low, high * 1e-15)
    decades = max(np.log10(high / low), 0.5)
    floor, top = low * 10 ** (-0.05 * decades), high * 10 ** (0.06 * decades)
    if not np.any(values == 0):
        axes.set_ylim(floor, top)
        return floor, [floor] * count
    height = (0.05 + 0.04 * count) * decades
    lanes = [float(floor * 10 ** (-height * (n + 0.5) / count)) for n in range(count)]
    bottom = floor * 10**-height
    axes.set_ylim(bottom, top)
    axes.set_yticks([t for t in axes.get_yticks() if floor <= t <= top])
    axes.set_yticks([t for t in axes.get_yticks(minor=True) if floor <= t <= top], minor=True)
    axes.axhspan(bottom, floor, color="#E4E4E4", lw=0, zorder=0)
    middle = float(np.sqrt(floor * bottom))
    axes.annotate(" sealed", (1, middle), xycoords=("axes fraction", "data"), ha="left", va="center", fontsize=9)
    return floor, lanes


def _leakage_legend(axes: Axes, results: Results) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles, _ = axes.get_legend_handles_labels()
    data = results.dataset
    title = "median of realisations" if results.method == "median" else results.method
    handles.insert(0, Line2D([], [], ls="", label=title))
    if "leakage_lower" in data:
        low, high = (100 * data[f"leakage_{end}"].attrs["quantile"] for end in ("lower", "upper"))
        handles.append(Patch(color=_GREY, alpha=0.3, lw=0, label=f"{low:g} – {high:g} % of realisations"))
        handles.append(Line2D([], [], color=_GREY, ls=":", lw=1.1, label="mean of realisations"))
    for name, symbol, size in _SINGLE:
        if _variable(name) in data and name != results.method:
            handles.append(Line2D([], [], color=_GREY, ls="", marker=symbol, ms=size, mew=1.2, mfc="none", label=name))
    return handles


def cells_figure(results: Results, count: int = 4) -> Figure:
    """Permeability of cells along the cycle: against nominal pressure, and against their mean gap.

    Left: `count` cells along the loading and one unloading, over all cells; no line = closed. The unloading is that
    from the highest peak after which at least a fifth of the cells are open under pressure. Right: loading, unloading,
    and k = h̄³/12 of parallel plates. Cells are those of the library, else the windows.

    Raises
    ------
    InputError : results without cells.
    """
    data = results.dataset
    prefix, pressure, k, gap = _cells(data)
    figure = new_figure(9.6, 4.3)
    left, right = figure.subplots(1, 2, sharey=True)
    nominal = data[f"{prefix}nominal_pressure"].values / 1e6
    loading = np.isnan(data[f"{prefix}unloaded_from"].values)
    two = (("loading", loading, STYLES[0][0], "o"), ("unloading", ~loading, STYLES[1][0], "s"))
    for name, steps, colour, marker in two:
        if not steps.any():
            continue
        shown = k[:, steps] > 0
        cloud: dict[str, Any] = {"ls": "", "marker": marker, "rasterized": True, "mew": 0}
        x = np.broadcast_to(nominal[steps], shown.shape)[shown]
        left.plot(x, k[:, steps][shown], color="#BBBBBB", alpha=0.5, ms=2.5, **cloud)
        right.plot(gap[:, steps][shown] * 1e6, k[:, steps][shown], color=colour, alpha=0.45, ms=3, label=name, **cloud)
    up, down, name = _example_path(branches(data, prefix), (k > 0) & (pressure > 0))
    for cell, (colour, line, _) in zip(_examples(k, pressure, up, down, count), STYLES[1:], strict=False):
        for steps, width, size in ((up, 1.0, 2.5), (down, 2.4, 3.5)):
            y = np.where(k[cell, steps] > 0, k[cell, steps], np.nan)
            label = f"cell {cell}" if width > 2 else None
            left.plot(nominal[steps], y, color=colour, ls=line, lw=width, marker="o", ms=size, label=label)
    _limits(left, right, k, gap)
    left.set(xlabel="nominal pressure [MPa]", ylabel="permeability k along x1 [m³]")
    right.set(xlabel="mean gap of the cell [µm]")
    left.set_title(f"(a) thin: loading{name}; no line: closed", fontsize=9.5)
    right.set_title("(b) all cells", fontsize=9.5)
    for axes in (left, right):
        axes.grid(alpha=0.25, lw=0.6)
    if left.get_legend_handles_labels()[0]:
        left.legend(fontsize=8, loc="best", framealpha=0.9, handlelength=4)
    legend = right.legend(fontsize=8, loc="upper left", framealpha=0.9)
    for handle in legend.legend_handles:
        if handle is not None:
            handle.set_alpha(1.0)
    return figure


def _cells(data: xarray.Dataset) -> tuple[str, Array, Array, Array]:
    """Prefix of the step names, then pressure, k and mean gap, each (cells, steps)."""
    if "library_k" in data:
        arrays = [data[f"library_{n}"].values for n in ("pressure", "k", "mean_gap")]
        return "library_", arrays[0], arrays[1], arrays[2]
    if "k1" in data:
        names = "window_pressure", "k1", "window_mean_gap"
        arrays = [data[name].values.reshape(data.sizes["step"], -1).T for name in names]
        return "", arrays[0], arrays[1], arrays[2]
    raise InputError.of("cells figure", "results without cells", "those of a two-scale or a stochastic study")


def _example_path(parts: list[tuple[str, Steps]], open_: NDArray[np.bool_]) -> tuple[Steps, Steps, str]:
    """Steps of the loading up to a peak, those of the unloading from there, and what to call the latter."""
    loading = parts[0][1]
    if len(parts) == 1:
        return loading, loading[:0], ""
    reopened = [bool(np.mean(open_[:, steps[1:]].any(axis=1)) >= 0.2) for _, steps in parts[1:]]
    name, down = parts[1 + reopened.index(True) if any(reopened) else -1]
    up = loading[: int(np.flatnonzero(loading == down[0])[0]) + 1]
    return up, down, f", thick: {name}"


def _examples(k: Array, pressure: Array, up: Steps, down: Steps, count: int) -> Steps:
    """Cells that stand for the scatter: evenly in the order of steps open along the path, then of k at the top."""
    path = np.r_[up, down[1:]]
    known = np.isfinite(k[:, path]).all(axis=1) & (pressure[:, up[-1]] > 0) & (k[:, up] > 0).any(axis=1)
    cells = np.flatnonzero(known)
    order = cells[np.lexsort((k[cells, up[-1]], (k[cells][:, path] > 0).sum(axis=1)))]
    places = np.unique(np.round(np.linspace(0.1, 0.95, count) * (order.size - 1)).astype(int))
    return order[places] if order.size else order


def _limits(left: Axes, right: Axes, k: Array, gap: Array) -> None:
    """Log scales over the cells, at most twelve decades, and the asymptote of parallel plates."""
    from matplotlib.ticker import LogLocator, NullFormatter

    positive = k[np.isfinite(k) & (k > 0)]
    if positive.size == 0:
        left.annotate("every cell is closed", (0.5, 0.5), xycoords="axes fraction", ha="center", color=_GREY)
        return
    low = max(float(positive.min()) / 3, float(positive.max()) * 1e-12)
    with np.errstate(invalid="ignore"):
        h = gap[(k >= low) & (gap > 0)] * 1e6
    left.set_yscale("log")
    right.set_xscale("log")
    plates = np.geomspace(h.min() / 1.3, h.max() * 1.3, 50)
    right.plot(plates, (plates * 1e-6) ** 3 / 12, color="black", lw=1.4, label="parallel plates, h̄³/12")
    right.set_xlim(plates[0], plates[-1])
    if plates[-1] < 1e3 * plates[0]:
        right.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        right.xaxis.set_major_formatter("{x:g}")
    right.xaxis.set_minor_formatter(NullFormatter())
    left.set_ylim(low, max(float(positive.max()), (plates[-1] * 1e-6) ** 3 / 12) * 3)
