"""Curves: leakage against load, of a study or of a whole run; permeability of pieces against gap and pressure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags, Indices, InputError
from ..base.leak_units import leakage_unit
from ..flow.law import cubic_law
from ..results.results import METHODS, Results, branches, force_scale
from ..results.tables import class_unit, kind_of, leakage_of
from ..results.variables import pressures_and_peaks
from ..results.verdict import LeakageCurve, deciding_fluid
from ..studies import BlocksResult, FaceResult, StochasticResult
from .drawing import (
    GREY,
    LEGEND_LINE,
    LINES,
    Sheet,
    branch_styles,
    decades,
    legend_below,
    load_axis,
    root_of,
    shows,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Decades of permeability below the largest one that are shown, and factor of the scale beyond what is shown.
_DECADES, _MARGIN = 6, 1.5
#: Factor by which the scale reaches beyond the leakages for the ends of their bands.
_BEYOND = 10.0
#: Height of a name beside the axis, and of the strip of sealed loads, as parts of the axis.
_NAME_HEIGHT, _STRIP = 0.042, 0.08
#: Studies drawn as single markers beside the main curve.
_SINGLE = {"two-scale": ("D", 7), "deterministic": ("x", 5), "blocks": ("s", 6)}
#: The interval of an error budget.
_INTERVAL = "95 % interval"
#: The unit in axes of the user, which several results share.
_COMMON = (1.0, "leakage per length of seal [m²/s]")


@dataclass(frozen=True)
class LeakageCurves:
    """Leakages per length of seal over a cycle [m²/s] that are drawn together.

    pressure, peaks : of the steps [Pa], see `branches`. leakage, title : the main curve and its name.
    band : lower and upper end of what `band_name` says. others : single markers, by method.
    limits : of leakage classes, by their name. scale : the leakage that is 1 on the axis, and the axis's name with
    its unit. force : see `force_scale`.
    """

    pressure: Array
    peaks: Array
    leakage: Array
    title: str
    band: tuple[Array, Array] | None = None
    band_name: str = ""
    others: dict[str, Array] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    scale: tuple[float, str] = _COMMON
    force: tuple[str, float] | None = None

    @property
    def branches(self) -> list[tuple[str, Indices]]:
        """Names, with the forces of the case, and steps of the loading and of each unloading."""
        loading, *unloadings = branches(self.pressure, self.peaks)
        if self.force is not None:
            unit, factor = self.force
            unloadings = [
                (f"unloading from {factor * self.pressure[steps[0]]:.4g} {unit}", steps)
                for _, steps in unloadings
            ]
        return [loading, *unloadings]

    @property
    def load_scale(self) -> tuple[str, float]:
        """Name of the axis of loads, and the load on it at a nominal pressure of 1 Pa."""
        if self.force is None:
            return "nominal pressure [MPa]", 1e-6
        unit, factor = self.force
        return f"force [{unit}]", factor

    @property
    def range(self) -> Array:
        """Sizes of all leakages [m²/s], and the ends of their band that are not far from them."""
        drawn = np.abs(np.concatenate([self.leakage, *self.others.values()]))
        return with_near_ends(drawn, np.abs(np.concatenate(self.band or (drawn[:0],))))


def with_near_ends(drawn: Array, ends: Array) -> Array:
    """Sizes that are drawn, and the ends of their intervals as far as these are not far from them."""
    sizes = drawn[np.isfinite(drawn) & (drawn > 0)]
    if not sizes.size:
        return np.r_[drawn, ends]
    known = ends[np.isfinite(ends) & (ends > 0)]
    return np.r_[drawn, np.clip(known, sizes.min() / _BEYOND, sizes.max() * _BEYOND)]


def leakage_panel(axes: Axes, curves: LeakageCurves, label: str = "") -> list[Any]:
    """Size of the leakage against load, log scale; loads without leakage stand in a strip below.

    What is in the axes already stays, and the axes hold both. label : before the names of the branches.

    Returns the handles of its legend.
    """
    from matplotlib.patches import Patch

    before = len(axes.get_legend_handles_labels()[0])
    factor, name = curves.scale
    load_name, load_factor = curves.load_scale
    parts = curves.branches
    inside = [line.get_ydata() for line in axes.lines if line.get_transform() == axes.transData]
    leakage_axis(axes, np.concatenate([curves.range / factor, *inside]))
    handles: list[Any] = []
    for n, (branch, steps) in enumerate(parts, start=before):
        look = branch_styles(n + 1)[n]
        x = load_factor * curves.pressure[steps]
        if curves.band is not None:
            low, high = (end[steps] / factor for end in curves.band)
            leakage_band(axes, x, low, high, look["color"])
        y = np.abs(curves.leakage[steps]) / factor
        handles.append(leakage_line(axes, x, y, label=f"{label}{branch}", **look))
    for method, leakage in curves.others.items():
        marker, size = _SINGLE[method]
        look = {"color": GREY, "ls": "", "marker": marker, "ms": size, "mfc": "none"}
        x, y = load_factor * curves.pressure, np.abs(leakage) / factor
        handles.append(leakage_line(axes, x, y, label=method, **look))
    axes.set(xlabel=load_name, ylabel=name)
    loads = [line.get_xdata() for line in axes.lines if line.get_label() != "_limit"]
    load_axis(axes, np.concatenate(loads))
    axes.grid(alpha=0.25, lw=0.6)
    limit_lines(axes, {name: limit / factor for name, limit in curves.limits.items()})
    if curves.band is not None:
        handles.append(Patch(color=GREY, alpha=0.3, lw=0, label=curves.band_name))
    return handles


def limit_lines(axes: Axes, limits: dict[str, float]) -> None:
    """A line for each limit within the scale of a logarithmic axis, with names beside it that share a line of text."""
    low, high = axes.get_ylim()
    named: dict[int, list[str]] = {}
    for name, limit in limits.items():
        if low < limit < high:
            axes.axhline(limit, color=GREY, lw=0.8, ls=(0, (4, 2)), zorder=1, label="_limit")
            place = np.log(limit / low) / np.log(high / low)
            named.setdefault(round(place / _NAME_HEIGHT), []).append(name)
    for lane, names in named.items():
        at = (1.01, lane * _NAME_HEIGHT)
        axes.annotate(", ".join(names), at, xycoords="axes fraction", va="center", fontsize=8)


def leakage_axis(axes: Axes, values: Array) -> None:
    """Log scale over the values > 0, and below it a strip for those that are 0."""
    from matplotlib.patches import Rectangle

    axes.set_yscale("log")
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (positive.min(), positive.max()) if positive.size else (0.1, 10.0)
    low = max(low, high * 1e-15)
    span = max(np.log10(high / low), 0.5)
    strip = _STRIP if np.any(values == 0) else 0.0
    axes.set_ylim(low * 10 ** (-span * (0.05 + strip)), high * 10 ** (0.06 * span))
    decades(axes.yaxis)
    if strip:
        # axhspan would take its ends in units of the leakage
        axes.add_patch(
            Rectangle((0, 0), 1, strip, transform=axes.transAxes, color="#E4E4E4", lw=0, zorder=0)
        )
        look: Any = {"xycoords": "axes fraction", "ha": "center", "va": "center"}
        axes.annotate("sealed", (0.5, strip / 2), color=GREY, fontsize=8, **look)


def leakage_line(axes: Axes, x: Array, y: Array, **look: Any) -> Any:
    """Draw leakages y >= 0; those of 0 are markers in the strip below. Returns the line."""
    (line,) = axes.plot(x, np.where(y > 0, y, np.nan), **look)
    sealed = x[y == 0]
    below = look | {"ls": "", "label": None}
    at = np.full(sealed.size, _STRIP / 2)
    axes.plot(sealed, at, transform=axes.get_xaxis_transform(), **below)
    return line


def leakage_band(axes: Axes, x: Array, low: Array, high: Array, colour: Any) -> None:
    """Shade a band of leakages of any direction, as far as the scale reaches; at a single load it is a bar."""
    bottom, top = axes.get_ylim()
    low, high = (np.clip(np.abs(end), bottom, top) for end in (low, high))
    if len(x) > 1:
        axes.fill_between(x, low, high, color=colour, lw=0, alpha=0.14)
    else:
        axes.vlines(x, low, high, color=colour, lw=5, alpha=0.25)


def leakage_bars(axes: Axes, x: Array, low: Array, high: Array, colour: Any) -> None:
    """Draw intervals of leakages of any direction as thin bars, as far as the scale reaches."""
    bottom, top = axes.get_ylim()
    low, high = (np.clip(np.abs(end), bottom, top) for end in (low, high))
    axes.vlines(x, low, high, color=colour, lw=1.4, alpha=0.75)


def _curves_figure(curves: LeakageCurves, ax: Axes | None, label: str | None) -> Figure:
    """The curves in a figure of their own, or beside what is in the given axes."""
    if ax is None:
        handles = len(curves.branches) + len(curves.others) + (curves.band is not None)
        below = LEGEND_LINE * (ceil(handles / 2) + 1.5)
        sheet = Sheet([4.0 + below])
        margins = replace(LINES, right=1.2 if curves.limits else 0.25, top=0.15, bottom=0.6 + below)
        axes = sheet.panel(0, margins)
        legend_below(sheet.figure, leakage_panel(axes, curves), title=label or curves.title)
        return sheet.figure
    # several results share the axes, and one unit
    common = replace(curves, scale=_COMMON, force=None, limits={})
    leakage_panel(ax, common, f"{label or curves.title}, ")
    ax.legend(framealpha=0.9, edgecolor="none", fontsize=7.5, handlelength=3.4)
    return root_of(ax)


@shows(FaceResult)
@shows(BlocksResult)
def study_figure(
    study: FaceResult | BlocksResult, ax: Axes | None = None, label: str | None = None
) -> Figure:
    """Leakage of a face against nominal pressure; `label` names it in the legend."""
    steps = pressures_and_peaks(study.steps)
    curves = LeakageCurves(*steps, study.leakage, study.method, scale=_readable(study.leakage))
    return _curves_figure(curves, ax, label)


@shows(StochasticResult)
def realisations_figure(
    study: StochasticResult, ax: Axes | None = None, label: str | None = None
) -> Figure:
    """Median of the leakage against nominal pressure, with the band from 5 to 95 % where there are enough seals."""
    ends, median = (0.05, 0.95), study.quantile(0.5)
    curves = LeakageCurves(
        *pressures_and_peaks(study.steps),
        median,
        "median of the drawn seals",
        band=None if study.too_few(*ends) else (study.quantile(ends[0]), study.quantile(ends[1])),
        band_name=_redraws(*ends),
        scale=_readable(median),
    )
    return _curves_figure(curves, ax, label)


@shows(Results)
def leakage_figure(results: Results, ax: Axes | None = None, label: str | None = None) -> Figure:
    """Size of the leakage against load, in the forces of the case if it has any; sealed loads stand in a strip below.

    Shaded: the 95 % interval, or without one the redraws of the measured patch.
    `label` names the run in the legend; several runs are drawn together into one `ax`, over nominal pressure.
    """
    return _curves_figure(leakage_curves(results), ax, label)


def leakage_curves(results: Results) -> LeakageCurves:
    """All leakages of a run, as they are drawn."""
    data, budget = results.dataset, results.budget
    band, band_name = None, _INTERVAL
    if budget is not None:
        band = budget.lower, budget.upper
    elif "leakage_lower" in data:
        low, high = data["leakage_lower"], data["leakage_upper"]
        band = low.values, high.values
        band_name = _redraws(low.attrs["quantile"], high.attrs["quantile"])
    others = {
        method: data[name].values
        for method, name in METHODS
        if name in data and method not in ("median", results.method)
    }
    limits = {}
    if "leak_class" in data.coords and "test_leakage" not in data:  # of the fluid that is drawn
        limits = dict(zip(data["leak_class"].values, data["class_limit"].values, strict=True))
    return LeakageCurves(
        pressure=data["nominal_pressure"].values,
        peaks=data["unloaded_from"].values,
        leakage=results.leakage.values,
        title=_title(results),
        band=band,
        band_name=band_name,
        others=others,
        limits=limits,
        scale=_scale(results),
        force=force_scale(data),
    )


def leak_test_figure(results: Results) -> Figure:
    """Size of the leakage of the test fluid against load with its interval, and the limits of the classes.

    Raises InputError: results without a test fluid.
    """
    data = results.dataset
    if "test_leakage" not in data:
        raise InputError(
            "leak test figure", "results without a test fluid", "those of a case with it"
        )
    curve, unit, basis = LeakageCurve.of_results(results), class_unit(results), results.class_basis
    is_known = ~results.has_failed
    name = f"{kind_of(unit)} [{unit.name}]\ntest with {deciding_fluid(results)}"
    limits = {}
    if "leak_class" in data.coords:
        limits = dict(zip(data["leak_class"].values, data["class_limit"].values, strict=True))
    curves = LeakageCurves(
        pressure=data["nominal_pressure"].values,
        peaks=data["unloaded_from"].values,
        leakage=np.where(is_known, results.class_leakage[0], np.nan),
        title=_title(results),
        band=(curve.lower, np.where(is_known, curve.upper, np.nan)) if curve.has_interval else None,
        band_name=_INTERVAL,
        limits=limits,
        scale=(basis.factor(unit), name),
        force=force_scale(data),
    )
    return _curves_figure(curves, None, None)


def _title(results: Results) -> str:
    return "median of the drawn seals" if results.method == "median" else results.method


def _redraws(low: float, high: float) -> str:
    return f"redraws of the\nmeasured patch, {100 * low:g} – {100 * high:g} %"


def _readable(leakage: Array) -> tuple[float, str]:
    factor, unit = leakage_unit(leakage)
    return factor, f"leakage per length of seal [{unit}]"


def _scale(results: Results) -> tuple[float, str]:
    """The unit of the run, and the name of the axis, which says of what state a gas is and which way it flows."""
    unit, factor = results.leak_scale
    attrs = results.dataset.attrs
    notes = {
        "gas at 101 325 Pa": results.leak_basis.is_gas and unit.kind == "volume",
        "from outlet to inlet": attrs["outlet_pressure_Pa"] > attrs["inlet_pressure_Pa"],
    }
    name = f"{leakage_of(results).rstrip(',')} [{unit.name}]"
    return factor, f"{name}\n{', '.join(text for text, holds in notes.items() if holds)}".rstrip()


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
            "pieces figure", "results without pieces", "those of two scales or drawn seals"
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
    axes.set(yscale="log", ylim=(low / _MARGIN, high * _MARGIN))
    decades(axes.yaxis)
    return True
