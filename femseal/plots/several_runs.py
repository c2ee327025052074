"""Draw the leakage of several runs in one picture: against load, and against a key of the case that was varied."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array
from ..results.load_steps import branches_in
from ..results.run_comparison import RunComparison
from .drawing import LEGEND_LINE, LINES, LOADS, Sheet, add_grid, legend_below, set_load_axis, shows
from .leakage_panels import (
    leakage_band,
    leakage_bars,
    leakage_line,
    set_leakage_axis,
    with_near_ends,
)
from .style import MARKERS, branch_styles, sequential_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..loads import LoadStep

#: Largest number of runs whose intervals are drawn as shaded areas. The areas of more runs would hide each other, so
#: that bars are drawn instead.
_MOST_SHADED = 3
#: Relative distance by which bars at the same position are moved apart.
_BAR_DISTANCE = 0.012
#: Height of the axes [inch].
_AXES_HEIGHT = 2.2
#: A number, and the unit behind it.
_NUMBER_WITH_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@shows(RunComparison)
def comparison_figure(comparison: RunComparison) -> Figure:
    """Draw the leakage of several runs against nominal pressure, with a colour for each run.

    The loading curves are solid lines; the unloading curves are dashed lines with open markers. Loads without leakage
    are marked in a strip at the bottom of the axes. The 95 % intervals on loading are shaded areas, or bars if there
    are more than three runs. If no run has an error budget, the scatter between realisations is drawn instead of the
    intervals.

    The picture of a sweep has a second panel with the leakages at a single load, the highest load at which all runs
    leak. The horizontal axis of this panel shows the key that takes the most values.

    Parameters
    ----------
    comparison : RunComparison
        Runs to draw.

    Returns
    -------
    Figure
    """
    key = _most_varied_key(comparison)
    legend_height = LEGEND_LINE * (len(comparison.labels) + 1.1)
    margins = replace(LOADS, bottom=LOADS.bottom + legend_height)
    load_height = _AXES_HEIGHT + margins.bottom + margins.top
    key_margins = replace(LINES, top=0.25)
    key_height = _AXES_HEIGHT + key_margins.bottom + key_margins.top
    sheet = Sheet([load_height] if key is None else [key_height, load_height])
    last_row = len(sheet.heights) - 1
    handles, legend_title = _draw_over_load(sheet.panel(last_row, margins), comparison)
    legend_below(sheet.figure, handles, 1, length=3, title=legend_title)
    if key is not None:
        _draw_over_key(sheet.panel(0, key_margins), comparison, key)
    return sheet.figure


def _most_varied_key(comparison: RunComparison) -> int | None:
    """Return the index of the key that takes the most different values.

    Returns None if all runs have the same values of all keys, or if the runs have no common load.
    """
    counts = [len(set(values)) for values in zip(*comparison.settings, strict=True)]
    if not comparison.common_steps or max(counts, default=0) < 2:
        return None
    return int(np.argmax(counts))


@dataclass(frozen=True)
class _Bands:
    """95 % intervals of the leakages of several runs, or the scatter between realisations.

    Attributes
    ----------
    ends : for each run, the lower and the upper end of the interval as two arrays (steps,); None for a run without an
        interval.
    name : text of the legend for the intervals; "" if no run has an interval.
    """

    ends: list[tuple[Array, Array] | None]
    name: str


def _bands(comparison: RunComparison) -> _Bands:
    """Return the 95 % intervals of the runs, or the scatter between realisations if no run has an interval."""
    runs = range(len(comparison.runs))
    intervals = [comparison.interval(n) for n in runs]
    if any(interval is not None for interval in intervals):
        return _Bands(intervals, "95 % interval on loading")
    scatters = [comparison.band(n) for n in runs]
    if any(scatter is not None for scatter in scatters):
        return _Bands(scatters, "scatter between seals on loading")
    return _Bands(scatters, "")


def _draw_over_load(axes: Axes, comparison: RunComparison) -> tuple[list[Any], str]:
    """Draw leakage against nominal pressure, and return the handles and the title of the legend."""
    count = len(comparison.runs)
    leakages = [np.abs(comparison.leakage(n)) for n in range(count)]
    loads = [run.dataset["nominal_pressure"].values / 1e6 for run in comparison.runs]  # MPa
    bands = _bands(comparison)
    ends = [np.empty(0)]
    for band in bands.ends:
        if band is not None:
            low, high = band
            ends += [np.abs(low), np.abs(high)]
    set_leakage_axis(axes, with_near_ends(np.concatenate(leakages), np.concatenate(ends)))
    is_shaded = count <= _MOST_SHADED
    handles: list[Any] = []
    for n, colour in enumerate(sequential_colours(count)):
        loading_branch, *unloadings = branches_in(comparison.runs[n].dataset)
        _name, loading = loading_branch
        style: dict[str, Any] = {"color": colour, "marker": MARKERS[n % len(MARKERS)]}
        solid = style | {"label": comparison.labels[n]}
        handles.append(leakage_line(axes, loads[n][loading], leakages[n][loading], **solid))
        dashed = style | {"ls": "--", "lw": 0.8, "mfc": "white"}
        for _name, unloading in unloadings:
            leakage_line(axes, loads[n][unloading], leakages[n][unloading], **dashed)
        band = bands.ends[n]
        if band is None:
            continue
        low, high = band
        if is_shaded:
            leakage_band(axes, loads[n][loading], low[loading], high[loading], colour)
        else:
            # the bars of the runs are side by side, centred at the load
            position = 1 + _BAR_DISTANCE * (n - (count - 1) / 2)
            bar_loads = loads[n][loading] * position
            leakage_bars(axes, bar_loads, low[loading], high[loading], colour)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=comparison.label)
    set_load_axis(axes, np.concatenate(loads))
    add_grid(axes)
    notes = []
    if any(run.steps.unload_from for run in comparison.runs):
        notes.append("dashed: unloading")
    if bands.name:
        notes.append(f"{'shaded' if is_shaded else 'bars'}: {bands.name}")
    return handles, "; ".join(notes)


def _draw_over_key(axes: Axes, comparison: RunComparison, key: int) -> None:
    """Draw the leakage at one load against the values of a key.

    Runs in which all other keys have the same values are joined by a line.
    """
    step = _highest_leaking_step(comparison)
    leakages, low, high = comparison.at(step)
    set_leakage_axis(axes, with_near_ends(leakages, np.concatenate([low, high])))
    texts = list(dict.fromkeys(values[key] for values in comparison.settings))
    positions = _axis_positions(texts)
    first, last = min(positions), max(positions)
    is_log = first > 0 and last > 10 * first
    runs_by_line = _runs_by_other_keys(comparison, key)
    styles = branch_styles(len(runs_by_line))
    for n, ((name, runs), style) in enumerate(zip(runs_by_line.items(), styles, strict=True)):
        x = np.array([positions[texts.index(comparison.settings[run][key])] for run in runs])
        order = np.argsort(x)
        leakage_line(axes, x[order], leakages[runs][order], label=name, **style)
        # the bars of the lines are side by side; the shift is a fraction of the length of the axis
        shift = _BAR_DISTANCE * (n - (len(runs_by_line) - 1) / 2)
        bar_x = x + (last - first) * shift
        if is_log:
            bar_x = x * (last / first) ** shift
        has_interval = np.isfinite(high[runs])
        bar_low, bar_high = low[runs][has_interval], high[runs][has_interval]
        leakage_bars(axes, bar_x[has_interval], bar_low, bar_high, style["color"])
    title = step.name
    if np.isfinite(high).any():
        title += "; bars: 95 % interval"
    axes.set(xlabel=comparison.keys[key], ylabel=comparison.label, title=title)
    if is_log:
        axes.set_xscale("log")
    axes.set_xticks(positions, labels=texts)
    axes.set_xticks([], minor=True)
    axes.margins(x=0.08)
    add_grid(axes)
    if len(runs_by_line) > 1:
        legend_title = ", ".join(_without(comparison.keys, key))
        axes.legend(title=legend_title, loc="upper center")


def _highest_leaking_step(comparison: RunComparison) -> LoadStep:
    """Return the loading step with the highest load at which all runs leak.

    If there is no load at which all runs leak, the first load step common to all runs is returned.
    """
    loading = [step for step in comparison.common_steps if step.unloaded_from is None]
    leaking = [step for step in loading if (comparison.at(step)[0] > 0).all()]
    return leaking[-1] if leaking else comparison.common_steps[0]


def _runs_by_other_keys(comparison: RunComparison, key: int) -> dict[str, list[int]]:
    """Group the indices of the runs by the values of all keys except `key`."""
    groups: dict[str, list[int]] = {}
    for n, values in enumerate(comparison.settings):
        name = ", ".join(_without(values, key))
        groups.setdefault(name, []).append(n)
    return groups


def _without(texts: tuple[str, ...], index: int) -> tuple[str, ...]:
    """Return the texts without the text at position `index`."""
    return texts[:index] + texts[index + 1 :]


def _axis_positions(texts: list[str]) -> list[float]:
    """Choose the position of each value of a key on the horizontal axis.

    If all values are numbers with the same unit, the positions are these numbers. If there are other values, the
    positions are 0, 1, 2, …

    texts : values of the key as texts.
    """
    matches = [_NUMBER_WITH_UNIT.fullmatch(text) for text in texts]
    numbers = [float(match[1]) for match in matches if match]
    units = {match[2] for match in matches if match}
    if len(numbers) < len(texts) or len(units) > 1:
        return [float(n) for n in range(len(texts))]
    return numbers
