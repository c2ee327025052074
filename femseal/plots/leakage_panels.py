"""Draw leakages against load into axes: curves, 95 % intervals, limits of leakage classes and sealed loads."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Indices
from ..results.load_steps import branches
from .drawing import GREY, branch_styles, label_decades, set_load_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Largest factor by which the ends of intervals extend the scale beyond the leakages.
_FARTHEST_END = 10.0
#: Height of the name of a leakage class beside the axis, as a fraction of the axis.
_NAME_HEIGHT = 0.042
#: Height of the strip for sealed loads at the bottom of the axis, as a fraction of the axis.
_STRIP = 0.08
#: Marker and size of the studies that are drawn as single points beside the main curve.
_STUDY_MARKERS = {"two-scale": ("D", 7), "deterministic": ("x", 5), "blocks": ("s", 6)}
#: Unit of axes that several results share [m²/s], and the name of the axis.
COMMON_SCALE = (1.0, "leakage per length of seal [m²/s]")


@dataclass(frozen=True)
class LeakageCurves:
    """Leakages per length of seal over a load cycle that are drawn together.

    Parameters
    ----------
    pressure : array (steps,)
        Nominal pressure of each load step [Pa].
    peaks : array (steps,)
        Nominal pressure from which the step is unloaded [Pa]; NaN on loading.
    leakage : array (steps,)
        The main curve [m²/s].
    title : str
        Name of the main curve.
    band : pair of arrays (steps,), optional
        Lower and upper end of the shaded area [m²/s].
    band_name : str
        What the shaded area is.
    other_methods : dict of arrays (steps,)
        Leakages of other methods [m²/s] by name, drawn as single markers.
    limits : dict of float
        Largest leakages of leakage classes [m²/s] by name.
    scale : pair (float, str)
        Leakage [m²/s] that is 1 on the axis, and the name of the axis with its unit.
    force : pair (str, float), optional
        Unit of the forces of the case, and the force in it at a nominal pressure of 1 Pa.
    """

    pressure: Array
    peaks: Array
    leakage: Array
    title: str
    band: tuple[Array, Array] | None = None
    band_name: str = ""
    other_methods: dict[str, Array] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    scale: tuple[float, str] = COMMON_SCALE
    force: tuple[str, float] | None = None

    @property
    def branches(self) -> list[tuple[str, Indices]]:
        """Name and step indices of the loading and of each unloading, with forces if the case has them."""
        loading, *unloadings = branches(self.pressure, self.peaks)
        if self.force is None:
            return [loading, *unloadings]
        unit, factor = self.force
        named_by_force = []
        for _, steps in unloadings:
            peak_force = factor * self.pressure[steps[0]]
            named_by_force.append((f"unloading from {peak_force:.4g} {unit}", steps))
        return [loading, *named_by_force]

    @property
    def load_scale(self) -> tuple[str, float]:
        """Name of the load axis, and the load on it at a nominal pressure of 1 Pa."""
        if self.force is None:
            return "nominal pressure [MPa]", 1e-6
        unit, factor = self.force
        return f"force [{unit}]", factor

    @property
    def range(self) -> Array:
        """Magnitudes [m²/s] that the leakage axis must show."""
        leakages = np.abs(np.concatenate([self.leakage, *self.other_methods.values()]))
        ends = np.abs(np.concatenate(self.band)) if self.band is not None else np.empty(0)
        return with_near_ends(leakages, ends)


def with_near_ends(leakages: Array, ends: Array) -> Array:
    """Append the ends of intervals to the leakages, moved to at most 10 times below or above them.

    Parameters
    ----------
    leakages, ends : array (any length,)
        Magnitudes in one unit. Ends may be unknown (NaN), infinite or 0; these are left out.
    """
    positive = leakages[np.isfinite(leakages) & (leakages > 0)]
    if not positive.size:
        return np.concatenate([leakages, ends])
    known_ends = ends[np.isfinite(ends) & (ends > 0)]
    lowest = positive.min() / _FARTHEST_END
    highest = positive.max() * _FARTHEST_END
    return np.concatenate([leakages, np.clip(known_ends, lowest, highest)])


def leakage_panel(axes: Axes, curves: LeakageCurves, label: str = "") -> list[Any]:
    """Draw the magnitude of the leakage against load on a logarithmic scale.

    Loads at which the seal is tight stand in a strip below the scale. If the axes contain curves already, they are
    kept and the scale covers both.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    curves : LeakageCurves
        What is drawn.
    label : str
        Text before the names of the branches in the legend.

    Returns
    -------
    list of artists
        Handles of the legend.
    """
    from matplotlib.patches import Patch

    factor, leakage_name = curves.scale
    load_name, load_factor = curves.load_scale
    load = load_factor * curves.pressure
    n_drawn = len(axes.get_legend_handles_labels()[0])
    drawn = [line.get_ydata() for line in axes.lines if line.get_transform() == axes.transData]
    set_leakage_axis(axes, np.concatenate([curves.range / factor, *drawn]))
    handles: list[Any] = []
    for n, (branch, steps) in enumerate(curves.branches, start=n_drawn):
        style = branch_styles(n + 1)[n]
        if curves.band is not None:
            low, high = (end[steps] / factor for end in curves.band)
            leakage_band(axes, load[steps], low, high, style["color"])
        magnitude = np.abs(curves.leakage[steps]) / factor
        line = leakage_line(axes, load[steps], magnitude, label=f"{label}{branch}", **style)
        handles.append(line)
    for method, leakage in curves.other_methods.items():
        marker, size = _STUDY_MARKERS[method]
        style = {"color": GREY, "ls": "", "marker": marker, "ms": size, "mfc": "none"}
        handles.append(leakage_line(axes, load, np.abs(leakage) / factor, label=method, **style))
    axes.set(xlabel=load_name, ylabel=leakage_name)
    all_loads = [line.get_xdata() for line in axes.lines if line.get_label() != "_limit"]
    set_load_axis(axes, np.concatenate(all_loads))
    axes.grid(alpha=0.25, lw=0.6)
    limit_lines(axes, {name: limit / factor for name, limit in curves.limits.items()})
    if curves.band is not None:
        handles.append(Patch(color=GREY, alpha=0.3, lw=0, label=curves.band_name))
    return handles


def set_leakage_axis(axes: Axes, values: Array) -> None:
    """Set a logarithmic leakage axis, with a strip below it if some of the values are 0.

    values : array of leakages >= 0 in the unit of the axis, or NaN.
    """
    from matplotlib.patches import Rectangle

    axes.set_yscale("log")
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (positive.min(), positive.max()) if positive.size else (0.1, 10.0)
    low = max(low, high * 1e-15)
    decades = max(np.log10(high / low), 0.5)
    strip = _STRIP if np.any(values == 0) else 0.0
    axes.set_ylim(low * 10 ** (-decades * (0.05 + strip)), high * 10 ** (0.06 * decades))
    label_decades(axes.yaxis)
    if not strip:
        return
    # axhspan would take the ends of the strip as leakages
    axes.add_patch(
        Rectangle((0, 0), 1, strip, transform=axes.transAxes, color="#E4E4E4", lw=0, zorder=0)
    )
    style: Any = {"xycoords": "axes fraction", "ha": "center", "va": "center"}
    axes.annotate("sealed", (0.5, strip / 2), color=GREY, fontsize=8, **style)


def leakage_line(axes: Axes, load: Array, leakage: Array, **style: Any) -> Any:
    """Draw a line of leakages >= 0; those that are 0 become markers in the strip below the scale.

    Returns
    -------
    Line2D
        The line of the leakages above 0.
    """
    (line,) = axes.plot(load, np.where(leakage > 0, leakage, np.nan), **style)
    sealed_loads = load[leakage == 0]
    heights = np.full(sealed_loads.size, _STRIP / 2)
    marker_style = style | {"ls": "", "label": None}
    axes.plot(sealed_loads, heights, transform=axes.get_xaxis_transform(), **marker_style)
    return line


def leakage_band(axes: Axes, load: Array, low: Array, high: Array, colour: Any) -> None:
    """Shade the area between two leakages within the scale; a single load gets a bar."""
    low, high = _within_scale(axes, low, high)
    if len(load) > 1:
        axes.fill_between(load, low, high, color=colour, lw=0, alpha=0.14)
    else:
        axes.vlines(load, low, high, color=colour, lw=5, alpha=0.25)


def leakage_bars(axes: Axes, load: Array, low: Array, high: Array, colour: Any) -> None:
    """Draw intervals of leakages within the scale as thin vertical bars."""
    low, high = _within_scale(axes, low, high)
    axes.vlines(load, low, high, color=colour, lw=1.4, alpha=0.75)


def _within_scale(axes: Axes, low: Array, high: Array) -> tuple[Array, Array]:
    """Limit the magnitudes of two leakages of either direction to the range of the y axis."""
    bottom, top = axes.get_ylim()
    return np.clip(np.abs(low), bottom, top), np.clip(np.abs(high), bottom, top)


def limit_lines(axes: Axes, limits: dict[str, float]) -> None:
    """Draw a line for every limit within the scale, with its name at the right.

    Names that would overlap are written in one line of text.

    limits : leakages in the unit of the axis by name.
    """
    low, high = axes.get_ylim()
    names_by_row: dict[int, list[str]] = {}
    for name, limit in limits.items():
        if not low < limit < high:
            continue
        axes.axhline(limit, color=GREY, lw=0.8, ls=(0, (4, 2)), zorder=1, label="_limit")
        height = np.log(limit / low) / np.log(high / low)
        row = round(height / _NAME_HEIGHT)
        names_by_row.setdefault(row, []).append(name)
    for row, names in names_by_row.items():
        position = (1.01, row * _NAME_HEIGHT)
        axes.annotate(", ".join(names), position, xycoords="axes fraction", va="center", fontsize=8)
