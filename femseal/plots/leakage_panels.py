"""Draw leakages against load: curves, 95 % intervals, limits of leakage classes, and loads without leakage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Indices
from ..results.load_steps import AS_PRESSURES, LoadFormat, branches
from .drawing import add_grid, label_decades, set_load_axis
from .style import GREY, branch_styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..studies import Study

#: The ends of 95 % intervals can extend the leakage axis beyond the leakages by at most this factor.
_FARTHEST_END = 10.0
#: The limits of leakage classes can extend the scale beyond leakages and intervals by at most this factor.
_FARTHEST_LIMIT = 30.0
#: Height of the name of a leakage class beside the axis, as a fraction of the axis.
_NAME_HEIGHT = 0.05
#: Height of the strip for sealed loads at the bottom of the axis, as a fraction of the axis.
_STRIP = 0.12
#: Heights of the markers and of the word "sealed" in the strip for sealed loads, as fractions of the strip.
_MARKER_IN_STRIP, _NAME_IN_STRIP = 0.28, 0.7
#: Largest and smallest number of decades that the leakage axis covers, without its margins.
_MOST_DECADES, _FEWEST_DECADES = 15, 0.5
#: Margins of the leakage axis below and above the values, as fractions of the decades that they cover.
_BOTTOM_MARGIN, _TOP_MARGIN = 0.05, 0.06
#: Opacity of the shaded areas of intervals.
_BAND_OPACITY = 0.16
#: Unit [m²/s] and name of a leakage axis on which several results are drawn.
COMMON_SCALE = (1.0, "leakage per length of seal [m²/s]")


@dataclass(frozen=True)
class LeakageCurves:
    """Leakages per seal length drawn in one panel, against the loads of a load cycle.

    Parameters
    ----------
    pressure : array (steps,)
        Nominal pressure of each load step [Pa].
    peaks : array (steps,)
        For each step of an unloading, the nominal pressure from which the seal is unloaded [Pa]; NaN on loading.
    leakage : array (steps,)
        Leakage of the main curve [m²/s].
    title : str
        Name of the main curve.
    band : pair of arrays (steps,), optional
        Leakage at the lower and at the upper edge of the shaded area around the main curve [m²/s].
    band_name : str
        Name of the shaded area in the legend.
    other_studies : list of (Study, array (steps,))
        Other studies with their leakages [m²/s], which are drawn as markers without lines.
    limits : dict of float
        Limits of leakage classes [m²/s], keyed by class name.
    scale : pair (float, str)
        Unit of the leakage axis [m²/s], and the name of the axis, which includes the name of the unit.
    loads : LoadFormat
        How the loads are written: as forces, or by default as nominal pressures.
    """

    pressure: Array
    peaks: Array
    leakage: Array
    title: str
    band: tuple[Array, Array] | None = None
    band_name: str = ""
    other_studies: list[tuple[Study, Array]] = field(default_factory=list)
    limits: dict[str, float] = field(default_factory=dict)
    scale: tuple[float, str] = COMMON_SCALE
    loads: LoadFormat = AS_PRESSURES

    @property
    def branches(self) -> list[tuple[str, Indices]]:
        """Name and step indices of each branch of the load cycle: the loading, and each unloading.

        The name of an unloading branch contains the peak load, for example "unloading from 300 MPa".
        """
        return branches(self.pressure, self.peaks, self.loads)

    @property
    def range(self) -> Array:
        """Absolute values of leakages, interval ends and class limits [m²/s] that the leakage axis must show."""
        other_leakages = [leakage for _, leakage in self.other_studies]
        leakages = np.abs(np.concatenate([self.leakage, *other_leakages]))
        ends = np.abs(np.concatenate(self.band)) if self.band is not None else np.empty(0)
        covered = with_near_ends(leakages, ends)
        positive = covered[np.isfinite(covered) & (covered > 0)]
        if not positive.size:
            return covered
        limits = np.array(list(self.limits.values()))
        is_near = (limits > positive.min() / _FARTHEST_LIMIT) & (
            limits < positive.max() * _FARTHEST_LIMIT
        )
        return np.concatenate([covered, limits[is_near]])


def with_near_ends(leakages: Array, ends: Array) -> Array:
    """Return all values that a leakage axis must show: the leakages, and the ends of their 95 % intervals.

    The ends of the intervals are limited to the range from a tenth of the lowest leakage to ten times the highest
    leakage. Without this limit, a very wide interval would stretch the axis until the curves became unreadable.

    Parameters
    ----------
    leakages : array (any length,)
        Absolute values of the leakages.
    ends : array (any length,)
        Absolute values of the lower and upper ends of the intervals, in the unit of `leakages`. Values that are unknown
        (NaN), infinite or 0 are left out.
    """
    positive = leakages[np.isfinite(leakages) & (leakages > 0)]
    if not positive.size:
        return np.concatenate([leakages, ends])
    known_ends = ends[np.isfinite(ends) & (ends > 0)]
    lowest = positive.min() / _FARTHEST_END
    highest = positive.max() * _FARTHEST_END
    return np.concatenate([leakages, np.clip(known_ends, lowest, highest)])


def leakage_panel(axes: Axes, curves: LeakageCurves, label: str = "") -> list[Any]:
    """Draw the absolute value of the leakage against load on a logarithmic scale.

    Loads without leakage are marked in a strip at the bottom of the axes. If the axes already contain curves, the
    leakage axis is extended so that the earlier curves remain visible.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    curves : LeakageCurves
        Leakages to draw.
    label : str
        Text that is written before the name of each branch in the legend.

    Returns
    -------
    list of artists
        Handles for a legend.
    """
    factor, leakage_name = curves.scale
    load_name, load_factor = curves.loads.axis
    load = load_factor * curves.pressure
    present_handles, _labels = axes.get_legend_handles_labels()
    present_leakages = [
        line.get_ydata() for line in axes.lines if line.get_transform() == axes.transData
    ]
    set_leakage_axis(axes, np.concatenate([curves.range / factor, *present_leakages]))
    handles: list[Any] = []
    # the style of each new branch follows that of the last branch that is already in the axes
    n_present = len(present_handles)
    new_styles = branch_styles(n_present + len(curves.branches))[n_present:]
    for (branch, steps), style in zip(curves.branches, new_styles, strict=True):
        if curves.band is not None:
            low, high = (end[steps] / factor for end in curves.band)
            leakage_band(axes, load[steps], low, high, style["color"])
        magnitude = np.abs(curves.leakage[steps]) / factor
        line = leakage_line(axes, load[steps], magnitude, label=f"{label}{branch}", **style)
        handles.append(line)
    for study, leakage in curves.other_studies:
        marker, size = study.marker
        style = {"color": GREY, "ls": "", "marker": marker, "ms": size, "mfc": "none"}
        magnitude = np.abs(leakage) / factor
        handles.append(leakage_line(axes, load, magnitude, label=study.label, **style))
    # a name such as "leakage of 0.3 m of seal, …" is longer than the axis and is broken after the comma
    axes.set(xlabel=load_name, ylabel=leakage_name.replace(", ", ",\n", 1))
    # `limit_lines` gives the label "_limit" to its lines, whose x data are not loads
    all_loads = [line.get_xdata() for line in axes.lines if line.get_label() != "_limit"]
    set_load_axis(axes, np.concatenate(all_loads))
    add_grid(axes)
    limit_lines(axes, {name: limit / factor for name, limit in curves.limits.items()})
    if curves.band is not None:
        colours = [style["color"] for style in new_styles]
        handles.append(band_handle(colours, curves.band_name))
    return handles


class BandHandle(tuple[Any, ...]):
    """Text of a legend entry, and a coloured patch for each shaded area that it explains."""

    label: str

    def get_label(self) -> str:
        """Return the text of the legend entry. Matplotlib calls this method."""
        return self.label


def band_handle(colours: Sequence[Any], label: str) -> BandHandle:
    """Return a legend entry for the shaded areas of some branches. It shows their colours side by side."""
    from matplotlib.legend import Legend
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.patches import Patch

    Legend.update_default_handler_map({BandHandle: HandlerTuple(ndivide=None, pad=0)})
    handle = BandHandle(Patch(color=colour, lw=0, alpha=_BAND_OPACITY) for colour in colours)
    handle.label = label
    return handle


def set_leakage_axis(axes: Axes, values: Array) -> None:
    """Set up the y axis as a logarithmic leakage axis.

    If some values are 0, a strip for sealed loads is added at the bottom of the axes.

    Parameters
    ----------
    axes : Axes
        Axes whose y axis is set up.
    values : array (any length,)
        Absolute values of leakages, in the unit of the axis; NaN is ignored.
    """
    from matplotlib.patches import Rectangle

    axes.set_yscale("log")
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (positive.min(), positive.max()) if positive.size else (0.1, 10.0)
    low = max(low, high * 10.0**-_MOST_DECADES)
    decades = max(np.log10(high / low), _FEWEST_DECADES)
    strip = _STRIP if np.any(values == 0) else 0.0
    # the axis extends beyond the values, by a fraction of the decades that they cover
    bottom = low * 10 ** (-decades * (_BOTTOM_MARGIN + strip))
    top = high * 10 ** (decades * _TOP_MARGIN)
    axes.set_ylim(bottom, top)
    label_decades(axes.yaxis)
    if not strip:
        return
    # a patch instead of `axhspan`, which would change the limits of the axis
    axes.add_patch(
        Rectangle((0, 0), 1, strip, transform=axes.transAxes, color="#E4E4E4", lw=0, zorder=0)
    )
    style: Any = {"xycoords": "axes fraction", "ha": "center", "va": "center"}
    # above the markers of `leakage_line`, which may be anywhere along the strip
    axes.annotate("sealed", (0.5, _NAME_IN_STRIP * strip), color=GREY, fontsize=7, **style)


def leakage_line(axes: Axes, load: Array, leakage: Array, **style: Any) -> Any:
    """Draw leakages >= 0 against load as a line. A leakage of 0 is drawn as a marker in the strip for sealed loads.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    load, leakage : array (steps,)
        Load and leakage, in the units of the axes.
    **style
        Style of the line and the markers, as keyword arguments for `Axes.plot`.

    Returns
    -------
    Line2D
        Line through the positive leakages.
    """
    (line,) = axes.plot(load, np.where(leakage > 0, leakage, np.nan), **style)
    sealed_loads = load[leakage == 0]
    # heights of the markers, as fractions of the height of the axes
    heights = np.full(sealed_loads.size, _MARKER_IN_STRIP * _STRIP)
    marker_style = style | {"ls": "", "label": None}
    axes.plot(sealed_loads, heights, transform=axes.get_xaxis_transform(), **marker_style)
    return line


def leakage_band(axes: Axes, load: Array, low: Array, high: Array, colour: Any) -> None:
    """Shade the area between two leakage curves `low` and `high`, (steps,), within the range of the y axis.

    For a single load, a vertical bar is drawn instead of an area.
    """
    low, high = _within_scale(axes, low, high)
    if len(load) > 1:
        axes.fill_between(load, low, high, color=colour, lw=0, alpha=_BAND_OPACITY)
    else:
        axes.vlines(load, low, high, color=colour, lw=4, alpha=0.25)


def leakage_bars(axes: Axes, load: Array, low: Array, high: Array, colour: Any) -> None:
    """Draw an interval of the leakage from `low` to `high` at each load, (steps,), as a thin vertical bar.

    The bars are limited to the range of the y axis.
    """
    low, high = _within_scale(axes, low, high)
    axes.vlines(load, low, high, color=colour, lw=0.9, alpha=0.75)


def _within_scale(axes: Axes, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the absolute values of the lower and upper ends of intervals, limited to the range of the y axis."""
    bottom, top = axes.get_ylim()
    return np.clip(np.abs(low), bottom, top), np.clip(np.abs(high), bottom, top)


def limits_width(limits: dict[str, float]) -> float:
    """Return the width [inch] of the space to the right of the axes for the names of leakage classes."""
    if not limits:
        return 0.0
    longest_name = max(map(len, limits))  # characters
    return 0.05 + 0.062 * longest_name


def limit_lines(axes: Axes, limits: dict[str, float]) -> None:
    """Draw a horizontal line for the limit of each leakage class, with the name of the class to the right of the axes.

    Limits outside the range of the y axis are left out. Names that would overlap are written as one text, separated by
    commas.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    limits : dict of float
        Limits in the unit of the y axis, keyed by leakage class.
    """
    low, high = axes.get_ylim()
    names_by_row: dict[int, list[str]] = {}
    for name, limit in limits.items():
        if not low < limit < high:
            continue
        axes.axhline(limit, color=GREY, lw=0.8, ls=(0, (4, 2)), zorder=1, label="_limit")
        height = np.log(limit / low) / np.log(high / low)  # as a fraction of the axis
        # names whose heights differ by less than the height of a name are in the same row
        row = round(height / _NAME_HEIGHT)
        names_by_row.setdefault(row, []).append(name)
    for row, names in names_by_row.items():
        position = (1.01, row * _NAME_HEIGHT)
        axes.annotate(", ".join(names), position, xycoords="axes fraction", va="center", fontsize=7)
