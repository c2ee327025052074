"""Several runs in one picture: leakage against load, and against the key that was varied."""

from __future__ import annotations

import re
from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from ..results.run_comparison import RunComparison
from ..results.selections import branches
from .drawing import GREY, LEGEND_LINE, LINES, STYLES, Sheet, legend_below, load_axis, shows
from .leakage_curves import leakage_axis, leakage_band, leakage_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..loads import LoadStep

#: Bands of more runs hide each other.
_MOST_BANDS = 3
#: Rows of markers in the strip of steps without leakage; more runs share them.
_MOST_LANES = 4
#: Most lines against a key, of loads or of the other keys.
_MOST_LINES = 6
#: Letters of a line of the legend that fit into half a panel.
_LEGEND_LETTERS = 34
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@shows(RunComparison)
def comparison_figure(comparison: RunComparison) -> Figure:
    """Leakage of several runs against nominal pressure, log scale, a colour for each run.

    Loading is solid, unloading thin and dashed with open markers; steps without leakage stand in a strip below. Bands
    between the quantiles of the realisations are drawn for up to three runs. Of a sweep, a panel above shows the
    leakage at some loads against the key that has most values.
    """
    key = _drawn_key(comparison)
    columns = 2 if max(map(len, comparison.labels)) <= _LEGEND_LETTERS else 1
    below = 0.6 + LEGEND_LINE * (ceil((len(comparison.labels) + 2) / columns) + 0.5)
    sheet = Sheet([*([] if key is None else [4.0]), 3.8 + below])
    margins = replace(LINES, top=0.15, bottom=below)
    handles = _load_panel(sheet.panel(len(sheet.heights) - 1, margins), comparison)
    legend_below(sheet.figure, handles, columns, length=3)
    if key is not None:
        _key_panel(sheet.panel(0, LINES), comparison, key)
    return sheet.figure


def run_styles(count: int) -> list[tuple[Any, str]]:
    """Colour and marker of each run: the usual ones, or, of more than those, colours from dark to bright."""
    from matplotlib import colormaps

    markers = [marker for _, _, marker in STYLES]
    if count <= len(STYLES):
        return [(colour, marker) for colour, _, marker in STYLES[:count]]
    return [
        (colormaps["viridis"](0.92 * n / (count - 1)), markers[n % len(markers)])
        for n in range(count)
    ]


def _load_panel(axes: Axes, comparison: RunComparison) -> list[Any]:
    """Leakage against nominal pressure; returns the handles of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    count = len(comparison.runs)
    leakages = [np.abs(comparison.leakage(n)) for n in range(count)]
    bands = [comparison.band(n) if count <= _MOST_BANDS else None for n in range(count)]
    ends = [np.abs(end) for band in bands if band is not None for end in band]
    leakage_axis(axes, np.concatenate([*leakages, *ends]), min(count, _MOST_LANES))
    handles: list[Any] = []
    unloads = False
    for n, (name, (colour, marker)) in enumerate(
        zip(comparison.labels, run_styles(count), strict=True)
    ):
        data = comparison.runs[n].dataset
        pressure = data["nominal_pressure"].values / 1e6
        for part, (_, steps) in enumerate(
            branches(data["nominal_pressure"].values, data["unloaded_from"].values)
        ):
            x, y = pressure[steps], leakages[n][steps]
            look: dict[str, Any] = {"color": colour, "marker": marker}
            look |= (
                {"ls": "-", "lw": 1.8, "ms": 4.5}
                if part == 0
                else {"ls": "--", "lw": 1.0, "ms": 4, "mfc": "white"}
            )
            leakage_line(axes, x, y, n % _MOST_LANES, **look)
            unloads |= part > 0
            if (band := bands[n]) is not None and part == 0:
                leakage_band(axes, x, band[0][steps], band[1][steps], colour)
        handles.append(Line2D([], [], color=colour, marker=marker, ms=4.5, lw=1.8, label=name))
    if unloads:
        handles.append(
            Line2D(
                [],
                [],
                color=GREY,
                ls="--",
                lw=1.0,
                marker="o",
                ms=4,
                mfc="white",
                label="unloading",
            )
        )
    if any(band is not None for band in bands):
        handles.append(Patch(color=GREY, alpha=0.3, lw=0, label="band of realisations on loading"))
    axes.set(xlabel="nominal pressure [MPa]", ylabel=comparison.label)
    load_axis(
        axes, np.concatenate([r.dataset["nominal_pressure"].values for r in comparison.runs]) / 1e6
    )
    axes.grid(alpha=0.25, lw=0.6)
    return handles


def _drawn_key(comparison: RunComparison) -> int | None:
    """The key of a sweep with most values, if the runs have loads in common; None without one."""
    counts = [
        len({values[k] for values in comparison.settings}) for k in range(len(comparison.keys))
    ]
    if not counts or max(counts) < 2 or not comparison.common_steps:
        return None
    return int(np.argmax(counts))


def _key_panel(axes: Axes, comparison: RunComparison, key: int) -> None:
    """Leakage against the values of a key: a line for each of some loads, or for each choice of the other keys."""
    texts = list(dict.fromkeys(values[key] for values in comparison.settings))
    places, unit = _places(texts)
    others: dict[tuple[str, ...], list[int]] = {}
    for n, values in enumerate(comparison.settings):
        others.setdefault(values[:key] + values[key + 1 :], []).append(n)
    steps = _shown_steps(comparison, 1 if len(others) > 1 else 3)
    lines: list[tuple[str, list[int], LoadStep]]
    if len(others) > 1:
        axes.set_title(steps[0].name, fontsize=9.5)
        lines = [(", ".join(values), runs, steps[0]) for values, runs in others.items()][
            :_MOST_LINES
        ]
    else:
        lines = [(step.name, runs, step) for step in steps for runs in others.values()]
    drawn = []
    for name, runs, step in lines:
        points = [(places[comparison.settings[n][key]], *_at(comparison, n, step)) for n in runs]
        drawn.append((name, np.array(sorted(points)).T))
    sizes = np.concatenate([lines_of[1:].ravel() for _, lines_of in drawn])
    leakage_axis(axes, sizes, len(drawn))
    for n, ((name, (x, y, low, high)), (colour, line, marker)) in enumerate(
        zip(drawn, STYLES, strict=False)
    ):
        if len(drawn) <= _MOST_BANDS:
            leakage_band(axes, x, low, high, colour)
        leakage_line(
            axes, x, y, n, color=colour, ls=line, lw=1.8, marker=marker, ms=4.5, label=name
        )
    name = comparison.keys[key]
    axes.set(xlabel=f"{name} [{unit}]" if unit else name, ylabel=comparison.label)
    _key_axis(axes, texts, places, unit)
    axes.grid(alpha=0.25, lw=0.6)
    varied = (
        ", ".join(comparison.keys[:key] + comparison.keys[key + 1 :]) if len(others) > 1 else None
    )
    axes.legend(fontsize=8, framealpha=0.9, title=varied, title_fontsize=8)


def _at(comparison: RunComparison, run: int, step: LoadStep) -> tuple[float, float, float]:
    """Size of the leakage at a step, and the ends of its band; NaN without one."""
    s = comparison.runs[run].steps.index(step)
    band = comparison.band(run)
    low, high = (np.nan, np.nan) if band is None else (abs(float(end[s])) for end in band)
    return abs(float(comparison.leakage(run)[s])), low, high


def _shown_steps(comparison: RunComparison, count: int) -> list[LoadStep]:
    """Common steps on loading at which most runs leak: the first, and up to the highest, spread evenly."""
    loading = [step for step in comparison.common_steps if step.unloaded_from is None] or [
        *comparison.common_steps
    ]
    leaking = [
        step
        for step in loading
        if all(_at(comparison, n, step)[0] > 0 for n in range(len(comparison.runs)))
    ]
    leaking = leaking or loading
    if count == 1:
        return [leaking[-1]]
    chosen = np.unique(np.linspace(0, len(leaking) - 1, count).round().astype(int))
    return [leaking[n] for n in chosen]


def _places(texts: list[str]) -> tuple[dict[str, float], str]:
    """Places of values on an axis and their unit: numbers of one unit as they are, others side by side."""
    found = [_NUMBER.fullmatch(text) for text in texts]
    units = {match[2] if match else None for match in found}
    if len(units) == 1 and None not in units:
        return {
            text: float(match[1]) for text, match in zip(texts, found, strict=True) if match
        }, str(*units)
    return {text: float(n) for n, text in enumerate(texts)}, ""


def _key_axis(axes: Axes, texts: list[str], places: dict[str, float], unit: str) -> None:
    """Values of a key as the labels of the axis, logarithmic where they span more than a decade."""
    values = np.array([places[text] for text in texts])
    numbers = all(_NUMBER.fullmatch(text) for text in texts)
    if numbers and values.min() > 0 and values.max() > 10 * values.min():
        axes.set_xscale("log")
    labels = [f"{places[text]:g}" for text in texts] if unit or numbers else texts
    if numbers and not unit and list(values) == list(range(len(texts))):  # numbers of several units
        labels = texts
    axes.set_xticks(values, labels=labels)
    axes.set_xticks([], minor=True)
    axes.margins(x=0.08)
