"""What all pictures share: styles, maps with their colour bar, curves over a load cycle.

Figures are made without pyplot, so no display or backend is touched. Colours differ in lightness too, and branches also
in line and marker, so that pictures can be read without colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.quantities import leakage_unit, to_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Steps = NDArray[np.int64]
#: Loading first, then unloadings: colours that the colour-blind tell apart (Okabe & Ito), line style and marker.
STYLES: tuple[tuple[str, Any, str], ...] = (
    ("#D55E00", "-", "o"),
    ("#0072B2", "--", "s"),
    ("#009E73", "-.", "^"),
    ("#CC79A7", ":", "D"),
    ("#56B4E9", (0, (5, 1, 1, 1, 1, 1)), "v"),
    ("#000000", (0, (8, 2)), "P"),
)
GREY = "#666666"
#: What has no value of its own on a map: contact, closed windows, pockets.
CLOSED = "#B0B0B0"
#: Studies shown by single markers beside the main curve.
_SINGLE = (("two-scale", "D", 7), ("deterministic", "x", 5))


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inch] that lays itself out and belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", dpi=150)


def branch_text(unloaded_from: float | None) -> str:
    """Name of a branch: "loading", or "unloading from 900 MPa"; `unloaded_from` [Pa], NaN or None on loading."""
    if unloaded_from is None or np.isnan(unloaded_from):
        return "loading"
    return f"unloading from {to_text(unloaded_from, 'Pa')}"


def branches(pressure: Array, peaks: Array) -> list[tuple[str, Steps]]:
    """Name and steps of the loading and of each unloading, which begins at its peak on the loading.

    pressure, peaks : nominal pressure of each step, and the one it is unloaded from, NaN on loading [Pa].
    """
    loading = np.flatnonzero(np.isnan(peaks))
    found = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        start = loading[pressure[loading] == peak]
        found.append((branch_text(float(peak)), np.r_[start, np.flatnonzero(peaks == peak)]))
    return found


def branch_styles(count: int) -> list[tuple[str, Any, str]]:
    """Style of the loading and of each unloading; unloadings repeat theirs, the loading's is its own."""
    return [STYLES[n] if n == 0 else STYLES[1 + (n - 1) % (len(STYLES) - 1)] for n in range(count)]


def pressures_and_peaks(steps: Sequence[Any]) -> tuple[Array, Array]:
    """Nominal pressures and peaks of load steps as `branches` takes them [Pa]."""
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    return np.array([s.pressure for s in steps], dtype=float), np.array(peaks, dtype=float)


# --- maps ---


def map_panel(
    axes: Axes, values: Array, size: tuple[float, float], colours: Any, title: str, unit: str = "mm", **scale: Any
) -> None:
    """Map of values (n1, n2) over a face of the given size [`unit`], x1 upwards, with its colour bar."""
    image = axes.imshow(
        values, origin="lower", extent=(0.0, size[1], 0.0, size[0]), cmap=colours, interpolation="nearest", **scale
    )
    colour_bar(axes, image)
    axes.set_title(title, fontsize=9.5)
    axes.set(xlabel=f"x2 along the seal [{unit}]", ylabel=f"x1 [{unit}]", aspect="equal")


def colour_bar(axes: Axes, image: Any) -> None:
    """A bar as high as the map."""
    bar = axes.get_figure().colorbar(image, cax=axes.inset_axes((1.02, 0, 0.03, 1)))  # type: ignore[union-attr]
    bar.ax.tick_params(which="both", labelsize=8)
    axes.tick_params(labelsize=8)


def with_closed(name: str) -> Any:
    """A colour map that shows undefined points and those below its range in grey."""
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=CLOSED, under=CLOSED)


def map_height(size: tuple[float, float], width: float) -> float:
    """Height [inch] of a map of the given sides in a panel of a width, within what can be read."""
    return float(np.clip(width * size[0] / size[1], 0.4, 1.25 * width))


# --- curves over a load cycle ---


@dataclass(frozen=True)
class LeakageCurves:
    """Leakages per length of seal over a cycle [m²/s] that are drawn together.

    pressure, peaks : of the steps [Pa], see `branches`. leakage, title : the main curve, and what it is.
    band, band_together : lower and upper ends over realisations, and over realisations with the error of the library.
    share : lower and upper quantile of the bands. mean : thin and dotted. others : single markers, by method.
    notes : added to the axis.
    """

    pressure: Array
    peaks: Array
    leakage: Array
    title: str
    band: tuple[Array, Array] | None = None
    band_together: tuple[Array, Array] | None = None
    share: tuple[float, float] = (0.05, 0.95)
    mean: Array | None = None
    others: dict[str, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def drawn(self) -> list[Array]:
        """Everything that is drawn."""
        ends = [end for band in (self.band, self.band_together) if band is not None for end in band]
        return [self.leakage, *ends, *([] if self.mean is None else [self.mean]), *self.others.values()]


def leakage_panel(axes: Axes, curves: LeakageCurves) -> list[Any]:
    """Size of the leakage against nominal pressure, log scale; steps without leakage stand in a strip below.

    Returns the handles of its legend.
    """
    factor, unit = leakage_unit(curves.leakage)
    pressure = curves.pressure / 1e6
    parts = branches(curves.pressure, curves.peaks)
    floor, lanes = _log_axis(axes, np.abs(np.concatenate(curves.drawn)) / factor, len(parts))
    for (name, steps), (colour, line, marker), lane in zip(parts, branch_styles(len(parts)), lanes, strict=True):
        x, y = pressure[steps], np.abs(curves.leakage[steps]) / factor
        for band, alpha in ((curves.band_together, 0.09), (curves.band, 0.2)):
            if band is not None:
                low, high = (np.maximum(np.abs(end[steps]) / factor, floor) for end in band)
                axes.fill_between(x, low, high, color=colour, lw=0, alpha=alpha)
        if curves.band_together is not None:
            for end in curves.band_together:
                edge = np.abs(end[steps]) / factor
                axes.plot(x, np.where(edge > 0, edge, np.nan), color=colour, ls=(0, (1, 3)), lw=0.8)
        if curves.mean is not None:
            mean = np.abs(curves.mean[steps]) / factor
            axes.plot(x, np.where(mean > 0, mean, np.nan), color=colour, ls=":", lw=1.1)
        axes.plot(x, np.where(y > 0, y, np.nan), color=colour, ls=line, lw=1.8, marker=marker, ms=4.5, label=name)
        axes.plot(x[y == 0], np.full(np.sum(y == 0), lane), color=colour, ls="", marker=marker, ms=4.5)
        for method, symbol, size in _SINGLE:
            if method in curves.others:
                single = np.abs(curves.others[method][steps]) / factor
                at = np.where(single == 0, lane, single)
                axes.plot(x, at, color=colour, ls="", marker=symbol, ms=size, mew=1.2, mfc="none")
    axes.set_xlabel("nominal pressure [MPa]")
    label = [f"leakage per length of seal [{unit}]", *([", ".join(curves.notes)] if curves.notes else [])]
    axes.set_ylabel("\n".join(label))
    axes.set_xlim(0, max(pressure.max(), 1e-300) * 1.03)
    axes.grid(alpha=0.25, lw=0.6)
    return _leakage_legend(axes, curves)


def leakage_curves_figure(curves: LeakageCurves) -> Figure:
    """Figure of `leakage_panel` with its legend at the side."""
    figure = new_figure(7.4, 4.4)
    handles = leakage_panel(figure.add_subplot(), curves)
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=8.5, handlelength=3.4)
    return figure


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


def _leakage_legend(axes: Axes, curves: LeakageCurves) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles, _ = axes.get_legend_handles_labels()
    handles.insert(0, Line2D([], [], ls="", label=curves.title))
    low, high = (100 * q for q in curves.share)
    if curves.band is not None:
        handles.append(Patch(color=GREY, alpha=0.35, lw=0, label=f"{low:g} – {high:g} % of realisations"))
    if curves.band_together is not None:
        handles.append(
            Patch(fc="#EFEFEF", ec=GREY, ls=(0, (1, 3)), lw=0.8, label="the same with the\nerror of the library")
        )
    if curves.mean is not None:
        handles.append(Line2D([], [], color=GREY, ls=":", lw=1.1, label="mean of realisations"))
    for name, symbol, size in _SINGLE:
        if name in curves.others:
            handles.append(Line2D([], [], color=GREY, ls="", marker=symbol, ms=size, mew=1.2, mfc="none", label=name))
    return handles


def cycle_panel(axes: Axes, steps: Sequence[Any], values: Array, label: str) -> None:
    """Values at the steps of a cycle against nominal pressure, a curve for each branch."""
    pressure, peaks = pressures_and_peaks(steps)
    parts = branches(pressure, peaks)
    for (name, chosen), (colour, line, marker) in zip(parts, branch_styles(len(parts)), strict=True):
        axes.plot(pressure[chosen] / 1e6, values[chosen], color=colour, ls=line, marker=marker, ms=4.5, label=name)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=label)
    axes.grid(alpha=0.25, lw=0.6)
