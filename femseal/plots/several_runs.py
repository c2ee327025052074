"""Several runs in one picture: leakage against load, and against the key that was varied."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array
from ..results.results import branches_in
from ..results.run_comparison import RunComparison
from .drawing import (
    LEGEND_LINE,
    LINES,
    MARKERS,
    Sheet,
    branch_styles,
    legend_below,
    load_axis,
    shows,
)
from .leakage_curves import (
    leakage_axis,
    leakage_band,
    leakage_bars,
    leakage_line,
    with_near_ends,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..loads import LoadStep

#: Shaded areas of more runs hide each other: they have bars side by side, at loads that differ by this part.
_MOST_SHADED, _BESIDE = 3, 0.012
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@shows(RunComparison)
def comparison_figure(comparison: RunComparison) -> Figure:
    """Leakage of several runs against nominal pressure, log scale, a colour for each run.

    Loading is solid, unloading thin and dashed with open markers; steps without leakage stand in a strip below. The
    95 % intervals on loading are shaded, of more than three runs bars; without error budgets the quantiles of the
    realisations. Of a sweep, a panel above shows the leakage at the highest load at which all leak, with its
    intervals, against the key that has most values.
    """
    counts = [len({*values}) for values in zip(*comparison.settings, strict=True)]
    varied = comparison.common_steps and max(counts, default=0) > 1
    key = int(np.argmax(counts)) if varied else None
    below = 0.6 + LEGEND_LINE * (len(comparison.labels) + 1.5)
    sheet = Sheet([*([] if key is None else [4.0]), 3.8 + below])
    margins = replace(LINES, top=0.15, bottom=below)
    handles, title = _load_panel(sheet.panel(len(sheet.heights) - 1, margins), comparison)
    legend_below(sheet.figure, handles, 1, length=3, title=title)
    if key is not None:
        _key_panel(sheet.panel(0, LINES), comparison, key)
    return sheet.figure


def _bands(comparison: RunComparison) -> tuple[list[tuple[Array, Array] | None], str]:
    """Ends of what is drawn around the leakage of each run, None of a run without, and what it is."""
    runs = range(len(comparison.runs))
    intervals = [comparison.interval(n) for n in runs]
    if any(interval is not None for interval in intervals):
        return intervals, "95 % interval on loading"
    bands = [comparison.band(n) for n in runs]
    known = any(band is not None for band in bands)
    return bands, "redraws of the measured patch on loading" if known else ""


def _load_panel(axes: Axes, comparison: RunComparison) -> tuple[list[Any], str]:
    """Leakage against nominal pressure; returns the handles of the legend and its title, which says what is drawn."""
    from matplotlib import colormaps

    count = len(comparison.runs)
    leakages = [np.abs(comparison.leakage(n)) for n in range(count)]
    bands, name = _bands(comparison)
    ends = [np.abs(end) for band in bands if band is not None for end in band]
    drawn = np.concatenate(leakages)
    leakage_axis(axes, with_near_ends(drawn, np.concatenate(ends or [drawn[:0]])))
    is_shaded = count <= _MOST_SHADED
    handles: list[Any] = []
    loads = [run.dataset["nominal_pressure"].values / 1e6 for run in comparison.runs]
    # from dark to bright
    colours = colormaps["viridis"](np.linspace(0, 0.92, count))
    for n, colour in enumerate(colours):
        (_, up), *unloadings = branches_in(comparison.runs[n].dataset)
        look: dict[str, Any] = {"color": colour, "marker": MARKERS[n % len(MARKERS)], "ms": 4.5}
        solid = look | {"lw": 1.8, "label": comparison.labels[n]}
        dashed = look | {"ls": "--", "lw": 1.0, "mfc": "white"}
        handles.append(leakage_line(axes, loads[n][up], leakages[n][up], **solid))
        for _, down in unloadings:
            leakage_line(axes, loads[n][down], leakages[n][down], **dashed)
        if (band := bands[n]) is None:
            continue
        low, high = (end[up] for end in band)
        if is_shaded:
            leakage_band(axes, loads[n][up], low, high, colour)
        else:
            beside = 1 + _BESIDE * (n - (count - 1) / 2)
            leakage_bars(axes, loads[n][up] * beside, low, high, colour)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=comparison.label)
    load_axis(axes, np.concatenate(loads))
    axes.grid(alpha=0.25, lw=0.6)
    unloaded = any(run.steps.unload_from for run in comparison.runs)
    notes = ["dashed: unloading"] * unloaded
    if name:
        notes.append(f"{'shaded' if is_shaded else 'bars'}: {name}")
    return handles, "; ".join(notes)


def _key_panel(axes: Axes, comparison: RunComparison, key: int) -> None:
    """Leakage at one load against the values of a key: a line for each choice of the other keys."""
    # the highest load on loading at which all leak
    common = comparison.common_steps
    loading = (step for step in common if step.unloaded_from is None)
    leaking = [step for step in loading if (_sizes(comparison, step) > 0).all()]
    step = leaking[-1] if leaking else common[0]
    texts = list(dict.fromkeys(values[key] for values in comparison.settings))
    places = _places(texts)
    others: dict[str, list[int]] = {}
    for n, values in enumerate(comparison.settings):
        others.setdefault(", ".join(values[:key] + values[key + 1 :]), []).append(n)
    sizes = _sizes(comparison, step)
    low, high = _ends(comparison, step)
    leakage_axis(axes, with_near_ends(sizes, np.r_[low, high]))
    first, last = min(places), max(places)
    is_log = first > 0 and last > 10 * first
    looks = branch_styles(len(others))
    for line, ((name, runs), look) in enumerate(zip(others.items(), looks, strict=True)):
        at = np.array([places[texts.index(comparison.settings[run][key])] for run in runs])
        order = np.argsort(at)
        leakage_line(axes, at[order], sizes[runs][order], label=name, **look)
        beside = _BESIDE * (line - (len(others) - 1) / 2)
        x = at * (last / first) ** beside if is_log else at + (last - first) * beside
        known = np.isfinite(high[runs])
        leakage_bars(axes, x[known], low[runs][known], high[runs][known], look["color"])
    title = step.name
    if np.isfinite(high).any():
        title += "; bars: 95 % interval"
    axes.set(xlabel=comparison.keys[key], ylabel=comparison.label, title=title)
    if is_log:
        axes.set_xscale("log")
    axes.set_xticks(places, labels=texts)
    axes.set_xticks([], minor=True)
    axes.margins(x=0.08)
    axes.grid(alpha=0.25, lw=0.6)
    if len(others) > 1:
        title = ", ".join(comparison.keys[:key] + comparison.keys[key + 1 :])
        axes.legend(fontsize=8, framealpha=0.9, title=title, title_fontsize=8)


def _sizes(comparison: RunComparison, step: LoadStep) -> Array:
    """Size of the leakage of every run at a step (runs,)."""
    runs = enumerate(comparison.runs)
    return np.abs([comparison.leakage(n)[run.steps.index(step)] for n, run in runs])


def _ends(comparison: RunComparison, step: LoadStep) -> tuple[Array, Array]:
    """Sizes of both ends of the interval of every run at a step (runs,), NaN without one."""
    found = np.full((2, len(comparison.runs)), np.nan)
    for n, run in enumerate(comparison.runs):
        interval = comparison.interval(n)
        if interval is not None:
            s = run.steps.index(step)
            found[:, n] = [abs(end[s]) for end in interval]
    return found[0], found[1]


def _places(texts: list[str]) -> list[float]:
    """Places of values on an axis: numbers of one unit as they are, others side by side."""
    found = [match.groups() for match in map(_NUMBER.fullmatch, texts) if match]
    if len(found) < len(texts) or len({unit for _, unit in found}) > 1:
        return [float(n) for n in range(len(texts))]
    return [float(number) for number, _ in found]
