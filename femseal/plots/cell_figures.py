"""Draw the permeability of cells against their mean gap and their contact pressure.

The colour of a point indicates the load, and its marker the branch of the load cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags, Indices, InputError, Pair
from ..flow.law import cubic_law
from ..results.load_steps import branches, force_scale
from ..results.results import Results
from .drawing import LINES, Sheet, add_grid, figure_of, label_decades
from .style import GREY, sequential_colours, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Cells whose permeability is more than this many decades below the highest permeability are not drawn.
_PERMEABILITY_DECADES = 6
#: Factor by which the permeability axis extends beyond the values at both ends.
_PERMEABILITY_MARGIN = 1.5
#: Height of the axes of each panel, and height of the space for the colours of the loads above the panels [inch].
_AXES_HEIGHT, _LOADS_HEIGHT = 2.3, 0.62
#: If a state has more points than this, they are drawn as pixels in vector pictures, so that the files stay small.
_MOST_VECTOR_POINTS = 2000
#: Width of the label of a load that is upright [inch].
_LABEL_WIDTH = 0.115
#: The axis of pressures is linear below this fraction of the lowest load, so that it begins at 0.
_LINEAR_FRACTION = 0.2
#: Markers and line styles of the branches: the loading, and the unloadings from the highest peak on.
_MARKERS = "os^Dv"
_LINE_STYLES = ("-", "--", ":", "-.")
#: Medians are drawn for the loading and at most this number of unloadings.
_MOST_MEDIANS = 3


@dataclass(frozen=True)
class _CellValues:
    """Hold the values of all cells in every contact state of a run.

    Attributes
    ----------
    permeability : permeability along x1, the direction of the leakage, (states, cells) [m³].
    mean_gap : mean gap of each cell, (states, cells) [m].
    pressure : mean contact pressure of each cell, (states, cells) [Pa].
    nominal_pressure : nominal pressure of each state, (states,) [Pa].
    peaks : nominal pressure from which each state is unloaded, NaN on loading, (states,) [Pa].
    """

    permeability: Array
    mean_gap: Array
    pressure: Array
    nominal_pressure: Array
    peaks: Array

    @property
    def branches(self) -> list[tuple[str, Indices]]:
        """Name and state indices of each branch. An unloading begins with the state at its peak."""
        return branches(self.nominal_pressure, self.peaks)

    @property
    def loads(self) -> Array:
        """All different nominal pressures of the states, in increasing order [Pa]."""
        return np.unique(self.nominal_pressure)

    @property
    def colours(self) -> list[Any]:
        """A colour for each of the `loads`."""
        return sequential_colours(len(self.loads))


@styled
def cells_figure(results: Results) -> Figure:
    """Draw the permeability of the cells towards the outlet against their mean gap and their contact pressure.

    Sealed cells are left out, and so are cells whose permeability is less than a millionth of the highest one. The line
    in the first panel is the permeability h̄³/12 of parallel plates, which cells with wide gaps approach. The lines in
    the second panel are the medians of the open cells at each load. For a stochastic run, the cells are those from
    which the realisations choose; for a two-scale run, they are the cells of the surface at each load.

    Parameters
    ----------
    results : Results
        Results of a two-scale or stochastic run.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        The results contain no cells.
    """
    cells = _cell_values(results)
    panel_height = _AXES_HEIGHT + LINES.top + LINES.bottom
    sheet = Sheet([panel_height] * 2, head=_LOADS_HEIGHT)
    gap_axes = sheet.panel(0, LINES)
    gap_axes.set_xlabel(r"mean gap $\bar h$ of the cell [µm]")
    _draw_cells(gap_axes, cells, cells.mean_gap * 1e6, with_parallel_plates=True)
    pressure_axes = sheet.panel(1, LINES)
    pressure_axes.set_xlabel("mean contact pressure of the cell [MPa]")
    _draw_cells(pressure_axes, cells, cells.pressure / 1e6, with_parallel_plates=False)
    _add_load_bar(gap_axes, cells, results)
    return sheet.figure


def _add_load_bar(axes: Axes, cells: _CellValues, results: Results) -> None:
    """Draw a bar above the axes with the colour of each load, and labels of the loads as far as there is room."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    force = force_scale(results.dataset)
    name, scale = "nominal pressure [MPa]", 1e-6
    if force is not None:
        name, scale = f"force [{force.unit}]", force.per_pascal
    count = len(cells.loads)
    norm = BoundaryNorm(np.arange(count + 1) - 0.5, count)
    figure = figure_of(axes)
    width, height = axes.get_position().size * figure.get_size_inches()
    bar_axes = axes.inset_axes((0.0, 1 + (LINES.top + 0.02) / height, 1.0, 0.075 / height))
    bar = figure.colorbar(
        ScalarMappable(norm, ListedColormap(cells.colours)), cax=bar_axes, orientation="horizontal"
    )
    # every first, second, third, … load is labelled, beginning with the highest
    every = int(np.ceil(count * _LABEL_WIDTH / width))
    labelled = np.arange(count)[::-every][::-1]
    labels = [f"{scale * load:.4g}" for load in cells.loads[labelled]]
    bar.set_ticks(labelled, labels=labels)
    bar_axes.minorticks_off()
    bar_axes.xaxis.set_ticks_position("top")
    bar_axes.xaxis.set_label_position("top")
    is_crowded = max(map(len, labels)) * 0.07 > width * every / count
    bar_axes.tick_params(labelrotation=90 if is_crowded else 0)
    bar.set_label(name)


def _cell_values(results: Results) -> _CellValues:
    """Collect the values of all cells of a run; raise an InputError if the run has no cells."""
    data = results.dataset
    if "state_k1" in data:
        prefix = "state"
        peaks = data["state_unloaded_from"].values
        nominal_pressure = data["state_nominal_pressure"].values
    elif "cell_k1" in data:
        prefix = "cell"
        peaks = data["unloaded_from"].values
        nominal_pressure = data["nominal_pressure"].values
    else:
        expected = "results of a two-scale or stochastic run"
        raise InputError("cells figure", "results without cells", expected)

    def by_state(name: str) -> Array:
        """Return a variable of all cells as an array (state, cell)."""
        values = data[f"{prefix}_{name}"].values  # (state, row, column)
        return np.asarray(values.reshape(len(values), -1))

    return _CellValues(
        permeability=by_state("k1"),
        mean_gap=by_state("mean_gap"),
        pressure=by_state("pressure"),
        nominal_pressure=nominal_pressure,
        peaks=peaks,
    )


def _draw_cells(axes: Axes, cells: _CellValues, x: Array, *, with_parallel_plates: bool) -> None:
    """Draw a point for each open cell in each state, and a legend of the branches.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    cells : _CellValues
        Permeability of the cells, load and branch of each state.
    x : array (states, cells)
        Position of each point along the horizontal axis.
    with_parallel_plates : bool
        Whether `x` is the mean gap [µm] or the contact pressure [MPa]. With the gap, the permeability of parallel
        plates is drawn too, and cells whose mean gap is zero are left out. With the pressure, the medians at each load
        are drawn.
    """
    axes.set_ylabel("permeability $k_1$ towards the outlet [m³]")
    add_grid(axes)
    k = cells.permeability
    with np.errstate(invalid="ignore"):
        is_drawn = k > np.nanmax(k, initial=0.0) * 10.0**-_PERMEABILITY_DECADES
        if with_parallel_plates:
            is_drawn &= x > 0
    if not is_drawn.any():
        style: Any = {"xycoords": "axes fraction", "ha": "center", "color": GREY}
        axes.annotate("every cell is sealed", (0.5, 0.5), **style)
        return
    handles = _draw_points(axes, cells, x, is_drawn)
    highest = k[is_drawn].max()
    if with_parallel_plates:
        handles += _draw_parallel_plates(axes, (x[is_drawn].min(), x[is_drawn].max()))
        highest = max(highest, handles[-1].get_ydata()[-1])
    else:
        # the first panel explains the points
        handles = _draw_medians(axes, cells, is_drawn) or handles
        lowest_load = cells.loads[cells.loads > 0].min() / 1e6
        axes.set_xscale("symlog", linthresh=_LINEAR_FRACTION * lowest_load, linscale=0.5)
        axes.set_xlim(0, x[is_drawn].max() * 1.2)
        _label_pressures(axes)
    lowest = k[is_drawn].min()
    axes.set(yscale="log", ylim=(lowest / _PERMEABILITY_MARGIN, highest * _PERMEABILITY_MARGIN))
    label_decades(axes.yaxis)
    axes.legend(handles=handles, loc="lower right" if with_parallel_plates else "lower left")


def _draw_points(axes: Axes, cells: _CellValues, x: Array, is_drawn: Flags) -> list[Any]:
    """Draw the points of all states, and return handles for a legend of the branches."""
    from matplotlib.lines import Line2D

    state_colours = np.array(cells.colours)[np.searchsorted(cells.loads, cells.nominal_pressure)]
    handles: list[Any] = []
    for number, (name, states) in enumerate(cells.branches):
        is_filled = number == 0  # on loading
        marker = _MARKERS[number % len(_MARKERS)]
        # an unloading begins with its peak, which has been drawn as a state of the loading
        states = states if is_filled else states[~np.isnan(cells.peaks[states])]
        for state in states:
            points = is_drawn[state]
            axes.plot(
                x[state][points],
                cells.permeability[state][points],
                ls="",
                marker=marker,
                ms=2.6,
                mew=0.0 if is_filled else 0.6,
                mfc=state_colours[state] if is_filled else "none",
                mec=state_colours[state],
                alpha=0.75,
                rasterized=points.size > _MOST_VECTOR_POINTS,
            )
        label = name if is_drawn[states].any() else f"{name}, all sealed"
        style: dict[str, Any] = {"color": GREY, "mfc": GREY if is_filled else "none"}
        handles.append(Line2D([], [], ls="", marker=marker, label=label, **style))
    return handles


def _draw_parallel_plates(axes: Axes, gaps_um: Pair) -> list[Any]:
    """Draw the permeability of parallel plates over a range of gaps [µm], to which the axis is set."""
    gap_um = np.geomspace(gaps_um[0] / 1.1, gaps_um[1] * 1.1, 50)
    plates = cubic_law(gap_um * 1e-6)
    label = r"parallel plates, $\bar h^3/12$"
    (line,) = axes.plot(gap_um, plates, color="black", lw=1.0, label=label)
    axes.set(xscale="log", xlim=(gap_um[0], gap_um[-1]))
    label_decades(axes.xaxis)
    return [line]


def _draw_medians(axes: Axes, cells: _CellValues, is_drawn: Flags) -> list[Any]:
    """Draw the median of the open cells at each load against the nominal pressure, with a line for each branch."""
    from matplotlib.patheffects import withStroke

    handles = []
    for number, (name, states) in enumerate(cells.branches[: 1 + _MOST_MEDIANS]):
        states = states[is_drawn[states].any(axis=1)]
        if states.size < 2:
            continue
        medians = [np.median(cells.permeability[state][is_drawn[state]]) for state in states]
        (line,) = axes.plot(
            cells.nominal_pressure[states] / 1e6,
            medians,
            color="black",
            lw=1.0,
            ls=_LINE_STYLES[number % len(_LINE_STYLES)],
            label=f"median, {name}",
            path_effects=[withStroke(linewidth=2.2, foreground="white")],
        )
        handles.append(line)
    return handles


def _label_pressures(axes: Axes) -> None:
    """Label the powers of ten on an axis of pressures that begins at 0."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    high = axes.get_xlim()[1]
    linear_end = axes.xaxis.get_transform().linthresh
    decades = 10.0 ** np.arange(np.ceil(np.log10(linear_end)), np.floor(np.log10(high)) + 1)
    axes.xaxis.set_major_locator(FixedLocator([0.0, *decades]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
