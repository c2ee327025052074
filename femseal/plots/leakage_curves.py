"""Leakage against nominal pressure over a load cycle, of a study or of a whole run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from ..base import Array
from ..base.leak_rates import leakage_unit
from ..results.results import Results
from ..results.selections import Steps, branches, force_scale, pressures_and_peaks
from ..results.tables import leakage_of
from ..studies import FaceResult, StochasticResult
from .drawing import GREY, LEGEND_LINE, LINES, Sheet, branch_styles, decades, legend_below, load_axis, one_panel, shows

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Factor by which the scale reaches beyond the leakages for the ends of their bands of error.
_BARS_BEYOND = 10.0
#: Least distance of ln(leakage) of mean and median of the realisations at some step at which both are drawn.
_APART = 0.05
#: Distance of the bars of two branches at one load [points].
_BAR_SHIFT = 4.0
#: Height of a name beside the axis, as a part of the axis.
_NAME_HEIGHT = 0.04
#: Studies drawn as single markers beside the main curve.
_SINGLE = (("two-scale", "D", 7), ("deterministic", "x", 5))


@dataclass(frozen=True)
class LeakageCurves:
    """Leakages per length of seal over a cycle [m²/s] that are drawn together.

    pressure, peaks : of the steps [Pa], see `branches`. leakage, title : the main curve and its name.
    band : lower and upper quantile of the realisations, which `quantiles` names.
    error : lower and upper end of the band of error. mean : thin and dotted. others : single markers, by method.
    notes : added to the axis. limits : of leakage classes, by their name.
    scale : the leakage that is 1 on the axis, and the axis's name with its unit; a readable unit for all curves that
    are drawn together, unless all of them ask for the same. force : see `force_scale`.
    """

    pressure: Array
    peaks: Array
    leakage: Array
    title: str
    band: tuple[Array, Array] | None = None
    error: tuple[Array, Array] | None = None
    quantiles: tuple[float, float] = (0.05, 0.95)
    mean: Array | None = None
    others: dict[str, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    scale: tuple[float, str] | None = None
    limits: dict[str, float] = field(default_factory=dict)
    force: tuple[str, float] | None = None

    @property
    def drawn(self) -> list[Array]:
        """All leakages that are drawn."""
        return [self.leakage, *(self.band or ()), *([] if self.mean is None else [self.mean]), *self.others.values()]


def leakage_panel(axes: Axes, *several: LeakageCurves) -> list[Any]:
    """Size of the leakage against nominal pressure, log scale; steps without leakage stand in a strip below.

    Returns the handles of its legend.
    """
    scale = several[0].scale
    if scale is None or any(curves.scale != scale for curves in several):
        size, unit = leakage_unit(np.concatenate([curves.leakage for curves in several]))
        scale = size, f"leakage per length of seal [{unit}]"
    factor, label = scale
    parts = [(curves, name, steps) for curves in several for name, steps in branches(curves.pressure, curves.peaks)]
    drawn = np.concatenate([values for curves in several for values in curves.drawn])
    floor, lanes = leakage_axis(axes, np.concatenate([np.abs(drawn), _near_ends(drawn, several)]) / factor, len(parts))
    handles: dict[int, list[Any]] = {id(curves): [] for curves in several}
    for n, ((curves, name, steps), style, lane) in enumerate(zip(parts, branch_styles(len(parts)), lanes, strict=True)):
        handles[id(curves)].append(_branch(axes, curves, name, steps, style, factor, floor, lane))
        if curves.error is not None:
            _error_bars(axes, curves, steps, style[0], factor, floor, lane, (n - (len(parts) - 1) / 2) * _BAR_SHIFT)
    axes.set_xlabel("nominal pressure [MPa]")
    notes = dict.fromkeys(note for curves in several for note in curves.notes)
    axes.set_ylabel("\n".join([label, *([", ".join(notes)] if notes else [])]))
    load_axis(axes, np.concatenate([curves.pressure for curves in several]) / 1e6)
    axes.grid(alpha=0.25, lw=0.6)
    if len(several) == 1:
        limit_lines(axes, {name: limit / factor for name, limit in several[0].limits.items()})
        if force := several[0].force:
            _force_axis(axes, *force)
    if len(several) > 1:
        for curves in several:
            for handle in handles[id(curves)]:
                handle.set_label(f"{curves.title}, {handle.get_label()}")
    return [*(handle for curves in several for handle in handles[id(curves)]), *_other_handles(several)]


def _force_axis(axes: Axes, unit: str, factor: float) -> None:
    """A second axis above, with the forces at the nominal pressures that have labels."""
    above = axes.twiny()
    above.set(xscale=axes.get_xscale(), xlim=axes.get_xlim())
    above.set_xlabel(f"force [{unit}]")
    low, high = axes.get_xlim()
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    above.set_xticks(ticks, labels=[f"{factor * 1e6 * tick:.3g}" for tick in ticks])
    above.set_xticks([], minor=True)


def _near_ends(drawn: Array, several: Sequence[LeakageCurves]) -> Array:
    """Ends of the bands of error for the scale, no further than `_BARS_BEYOND` from what is drawn besides."""
    sizes = np.abs(drawn[np.isfinite(drawn) & (drawn != 0)])
    ends = np.concatenate([np.empty(0), *(end for curves in several for end in curves.error or ())])
    ends = np.abs(ends[np.isfinite(ends) & (ends != 0)])
    return np.clip(ends, sizes.min() / _BARS_BEYOND, sizes.max() * _BARS_BEYOND) if sizes.size else ends[:0]


def leakage_range(curves: LeakageCurves, factor: float) -> tuple[float, float]:
    """Ends of a logarithmic scale [`factor`] that holds the curves, and the near parts of their bands of error."""
    drawn = np.concatenate(curves.drawn)
    sizes = np.concatenate([np.abs(drawn), _near_ends(drawn, [curves])])
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)] / factor
    low, high = (float(sizes.min()), float(sizes.max())) if sizes.size else (0.1, 10.0)
    return low / 1.3, high * 1.3


def limit_lines(axes: Axes, limits: dict[str, float]) -> None:
    """A line for each limit within the scale of a logarithmic axis, named at its right end; names do not overlap."""
    low, high = axes.get_ylim()
    free = np.inf
    named: dict[float, list[str]] = {}
    for name, limit in limits.items():
        named.setdefault(float(f"{limit:.9g}"), []).append(name)
    for limit, names in sorted(named.items(), reverse=True):
        if not low < limit < high:
            continue
        axes.axhline(limit, color=GREY, lw=0.9, ls=(0, (4, 2)), zorder=1)
        place = np.log(limit / low) / np.log(high / low)
        if free - place > _NAME_HEIGHT:
            axes.annotate(
                f" {', '.join(names)}", (1, limit), xycoords=("axes fraction", "data"), va="center", fontsize=8.5
            )
            free = place


def _branch(
    axes: Axes, curves: LeakageCurves, name: str, steps: Steps, style: Any, factor: float, floor: float, lane: float
) -> Any:
    """Draw one branch; returns its main line."""
    colour, line, marker = style
    x, y = curves.pressure[steps] / 1e6, np.abs(curves.leakage[steps]) / factor
    if curves.band is not None:
        low, high = (end[steps] / factor for end in curves.band)
        leakage_band(axes, x, low, high, floor, colour, 0.2)
    if curves.mean is not None:
        mean = np.abs(curves.mean[steps]) / factor
        axes.plot(x, np.where(mean > 0, mean, np.nan), color=colour, ls=":", lw=1.1)
    main = leakage_line(axes, x, y, lane, color=colour, ls=line, lw=1.8, marker=marker, ms=4.5, label=name)
    for method, symbol, size in _SINGLE:
        if method in curves.others:
            single = np.abs(curves.others[method][steps]) / factor
            at = np.where(single == 0, lane, single)
            axes.plot(x, at, color=colour, ls="", marker=symbol, ms=size, mew=1.2, mfc="none")
    return main


def _error_bars(
    axes: Axes, curves: LeakageCurves, steps: Steps, colour: Any, factor: float, floor: float, lane: float, shift: float
) -> None:
    """Bars over the band of error, beside those of other branches; one that may be sealed reaches into the strip below.

    One that goes on beyond the scale, or has no end, has no mark at the edge. shift : to the right [points].
    """
    from matplotlib.transforms import ScaledTranslation

    assert curves.error is not None
    low, high = (np.abs(end[steps]) / factor for end in curves.error)
    known = np.isfinite(low) & ~np.isnan(high) & (high > 0)
    x, low, high, top = curves.pressure[steps][known] / 1e6, low[known], high[known], axes.get_ylim()[1]
    feet, heads = np.where(low > 0, np.maximum(low, floor), lane), np.minimum(high, top)
    beside = axes.transData + ScaledTranslation(shift / 72, 0, axes.get_figure(root=True).dpi_scale_trans)  # type: ignore[union-attr]
    axes.vlines(x, feet, heads, color=colour, lw=1.0, alpha=0.8, transform=beside)
    for end, ends in ((feet, (low == 0) | (low >= floor)), (heads, high <= top)):
        axes.plot(x[ends], end[ends], color=colour, ls="", marker="_", ms=6, mew=1.0, alpha=0.8, transform=beside)


def leakage_axis(axes: Axes, values: Array, count: int) -> tuple[float, list[float]]:
    """Log scale over the values > 0, and below it a strip for those that are 0.

    Returns the end of the scale, and the places of `count` branches in the strip.
    """
    axes.set_yscale("log")
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (float(positive.min()), float(positive.max())) if positive.size else (0.1, 10.0)
    low = max(low, high * 1e-15)
    span = max(np.log10(high / low), 0.5)
    floor, top = low * 10 ** (-0.05 * span), high * 10 ** (0.06 * span)
    if not np.any(values == 0):
        axes.set_ylim(floor, top)
        decades(axes.yaxis)
        return floor, [floor] * count
    height = (0.05 + 0.04 * count) * span
    lanes = [float(floor * 10 ** (-height * (n + 0.5) / count)) for n in range(count)]
    bottom = floor * 10**-height
    axes.set_ylim(bottom, top)
    axes.set_yticks([t for t in axes.get_yticks() if floor <= t <= top])
    axes.set_yticks([t for t in axes.get_yticks(minor=True) if floor <= t <= top], minor=True)
    decades(axes.yaxis)
    axes.axhspan(bottom, floor, color="#E4E4E4", lw=0, zorder=0)
    middle = float(np.sqrt(floor * bottom))
    axes.annotate(" sealed", (1, middle), xycoords=("axes fraction", "data"), ha="left", va="center", fontsize=9)
    return floor, lanes


def leakage_line(axes: Axes, x: Array, y: Array, lane: float, **look: Any) -> Any:
    """Draw leakages y >= 0; markers of steps without leakage stand at `lane` of the strip below. Returns the line."""
    (line,) = axes.plot(x, np.where(y > 0, y, np.nan), **look)
    axes.plot(x[y == 0], np.full(np.sum(y == 0), lane), **look | {"ls": "", "label": None})
    return line


def leakage_band(axes: Axes, x: Array, low: Array, high: Array, floor: float, colour: Any, alpha: float) -> None:
    """Shade a band of leakages of any direction down to the end of the scale."""
    below, above = (np.maximum(np.abs(end), floor) for end in (low, high))
    axes.fill_between(x, below, above, color=colour, lw=0, alpha=alpha)


def _other_handles(several: Sequence[LeakageCurves]) -> list[Any]:
    """Legend handles common to all branches: bands, mean, single markers."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    low, high = (100 * q for q in several[0].quantiles)
    if any(curves.band is not None for curves in several):
        label = f"redraws of the\nmeasured patch, {low:g} – {high:g} %"
        handles.append(Patch(color=GREY, alpha=0.35, lw=0, label=label))
    if any(curves.mean is not None for curves in several):
        handles.append(Line2D([], [], color=GREY, ls=":", lw=1.1, label="mean of realisations"))
    if any(curves.error is not None for curves in several):
        handles.append(Line2D([], [], color=GREY, ls="", marker="|", ms=9, mew=1.0, label="95 % band of error"))
    for name, symbol, size in _SINGLE:
        if any(name in curves.others for curves in several):
            handles.append(Line2D([], [], color=GREY, ls="", marker=symbol, ms=size, mew=1.2, mfc="none", label=name))
    return handles


#: Curves and artists drawn into given axes; the next curves are drawn together with them.
_SHARED: WeakKeyDictionary[Axes, tuple[list[LeakageCurves], list[Any]]] = WeakKeyDictionary()


def _curves_figure(curves: LeakageCurves, ax: Axes | None, label: str | None) -> Figure:
    """The curves in a figure of their own, or together with those drawn into the same axes before."""
    curves = curves if label is None else replace(curves, title=label)
    if ax is None:
        further = (curves.band, curves.mean, curves.error)
        entries = len(branches(curves.pressure, curves.peaks)) + len(curves.others)
        entries += sum(one is not None for one in further)
        below = LEGEND_LINE * (ceil(entries / 2) + 1)
        low, high = leakage_range(curves, 1.0)
        named = any(low / 2 < limit < 2 * high for limit in curves.limits.values())
        sheet, right = Sheet([4.2 + below]), 1.1 if named else 0.65
        margins = replace(LINES, left=1.0, right=right, top=0.55 if curves.force else 0.15, bottom=0.7 + below)
        legend_below(sheet.figure, leakage_panel(sheet.panel(0, 0, margins), curves), title=curves.title)
        return sheet.figure
    several, artists = _SHARED.setdefault(ax, ([], []))
    for artist in artists:
        artist.remove()
    several.append(curves)
    before = set(ax.get_children())
    handles = leakage_panel(ax, *several)
    artists[:] = [artist for artist in ax.get_children() if artist not in before]
    title = curves.title if len(several) == 1 else None
    ax.legend(handles=handles, framealpha=0.9, edgecolor="none", fontsize=7.5, handlelength=3.4, title=title)
    return one_panel(ax, 0, 0)[0]


@shows(FaceResult)
def study_figure(study: FaceResult, ax: Axes | None = None, label: str | None = None) -> Figure:
    """Leakage of a face against nominal pressure; `label` names it in the legend."""
    return _curves_figure(LeakageCurves(*pressures_and_peaks(study.steps), study.leakage, study.method), ax, label)


@shows(StochasticResult)
def realisations_figure(study: StochasticResult, ax: Axes | None = None, label: str | None = None) -> Figure:
    """Median of the leakage against nominal pressure, with the band from 5 to 95 % where there are enough seals."""
    low, high = 0.05, 0.95
    curves = LeakageCurves(
        *pressures_and_peaks(study.steps),
        study.quantile(0.5),
        "median of realisations",
        band=None if study.too_few(low, high) else (study.quantile(low), study.quantile(high)),
        quantiles=(low, high),
        mean=_apart(study.mean, study.quantile(0.5)),
    )
    return _curves_figure(curves, ax, label)


@shows(Results)
def leakage_figure(results: Results, ax: Axes | None = None, label: str | None = None) -> Figure:
    """Size of the leakage per length against nominal pressure, log scale; steps without leakage stand in a strip below.

    Band: between the quantiles of the realisations; mean thin and dotted. Bars: the band of error. Forces of a case
    stand on a second axis above.
    `label` names the run in the legend; several runs are drawn together into one `ax`.
    """
    return _curves_figure(leakage_curves(results), ax, label)


def leakage_curves(results: Results) -> LeakageCurves:
    """All leakages of a run, as they are drawn."""
    data = results.dataset
    quantiles = [data[n].attrs["quantile"] for n in ("leakage_lower", "leakage_upper") if n in data] or [0.05, 0.95]
    notes = ["gas at 101 325 Pa"] if results.leak_basis.is_gas else []
    notes += ["from outlet to inlet"] if data.attrs["outlet_pressure_Pa"] > data.attrs["inlet_pressure_Pa"] else []
    others = {"two-scale": "leakage_two_scale", "deterministic": "leakage_deterministic"}
    return LeakageCurves(
        pressure=data["nominal_pressure"].values,
        peaks=data["unloaded_from"].values,
        leakage=results.leakage.values,
        title="median of realisations" if results.method == "median" else results.method,
        band=_band(data),
        error=None if results.budget is None else (results.budget.lower, results.budget.upper),
        quantiles=(quantiles[0], quantiles[1]),
        mean=_apart(data["leakage_mean"].values, results.leakage.values) if "leakage_mean" in data else None,
        others={m: data[name].values for m, name in others.items() if name in data and m != results.method},
        notes=tuple(notes),
        scale=_scale(results) if data.attrs.get("leakage_unit") else None,
        limits=_limits(results),
        force=force_scale(data),
    )


def _apart(mean: Array, median: Array) -> Array | None:
    """The mean of the realisations where its line can be told from that of their median, else None."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(np.abs(np.log(mean / median)))
    return mean if ratio.max() > _APART else None


def _limits(results: Results) -> dict[str, float]:
    """Limits of leakage classes of the fluid that is drawn."""
    data = results.dataset
    if "leak_class" not in data.coords or "test_leakage" in data:
        return {}
    return {
        str(n): float(limit) for n, limit in zip(data["leak_class"].values, data["class_limit"].values, strict=True)
    }


def _scale(results: Results) -> tuple[float, str]:
    unit, factor = results.leak_scale
    return factor, f"{leakage_of(results).rstrip(',')} [{unit.name}]"


def _band(data: xarray.Dataset) -> tuple[Array, Array] | None:
    return (data["leakage_lower"].values, data["leakage_upper"].values) if "leakage_lower" in data else None
