"""Draw the permeability of cells against their mean gap and their contact pressure.

The colour of a point indicates the load, and its marker the branch of the load cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags, Indices, InputError, Pair
from ..flow.law import cubic_law
from ..results.load_steps import branches, load_format
from ..results.results import Results
from .drawing import LINES, Sheet, add_grid, label_decades, panel_size, write_in_the_middle
from .map_panels import add_colour_bar
from .style import GREY, LINE_STYLES, MARKERS, sequential_colours, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Cells whose permeability is more than this many decades below the highest permeability are not drawn.
_PERMEABILITY_DECADES = 6
#: Factor by which the permeability axis extends below the lowest and above the highest permeability.
_PERMEABILITY_MARGIN = 1.5
#: Height of the axes of each panel, and height of the space for the colours of the loads above the panels [inch].
_AXES_HEIGHT, _LOADS_HEIGHT = 2.3, 0.62
#: If a state has more points than this, they are drawn as pixels in vector pictures, so that the files stay small.
_MOST_VECTOR_POINTS = 2000
#: Width of an upright label of a load [inch].
_LABEL_WIDTH = 0.115
#: Distance of the bar with the colours of the loads from the panel [inch].
_LOAD_BAR_DISTANCE = 0.02
#: Width of a character in the labels of the bar with the colours of the loads [inch].
_CHARACTER_WIDTH = 0.07
#: The axis of pressures is linear below this fraction of the lowest load, so that it begins at 0.
_LINEAR_FRACTION = 0.2
#: Medians are drawn for the loading and at most this number of unloadings.
_MOST_MEDIANS = 3


@dataclass(frozen=True)
class _CellValues:
    """Values of all cells in every contact state of a run.

    Attributes
    ----------
    permeability : permeability along x1, the direction of the leakage, (states, cells) [m³].
    mean_gap : mean gap of each cell, (states, cells) [m].
    pressure : mean contact pressure of each cell, (states, cells) [Pa].
    nominal_pressure : nominal pressure of each state, (states,) [Pa].
    peaks : for each state of an unloading, the nominal pressure from which the seal is unloaded, (states,) [Pa]; NaN on
        loading.
    """

    permeability: Array
    mean_gap: Array
    pressure: Array
    nominal_pressure: Array
    peaks: Array

    @property
    def branches(self) -> list[tuple[str, Indices]]:
        """Name and state indices of each branch of the load cycle.

        The first state of an unloading branch is the state at the peak load.
        """
        return branches(self.nominal_pressure, self.peaks)

    @property
    def loads(self) -> Array:
        """Nominal pressures of all states, without repetition and in increasing order [Pa]."""
        return np.unique(self.nominal_pressure)

    @property
    def colours(self) -> list[Any]:
        """A colour for each of the `loads`."""
        return sequential_colours(len(self.loads))


@styled
def cells_figure(results: Results) -> Figure:
    """Draw the permeability of the cells towards the outlet against their mean gap and their contact pressure.

    Sealed cells are left out, as are cells whose permeability is less than a millionth of the highest. The
    line in the first panel is the permeability h̄³/12 of parallel plates with the gap h̄. The permeability of cells
    with wide gaps approaches the permeability of parallel plates. The lines in the second panel are the median
    permeabilities of the open cells at each load. For a stochastic run, the picture shows all cells that a realisation
    can contain. For a two-scale run, the picture shows the cells of the surface at each load.

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
    _draw_over_gap(gap_axes, cells)
    _draw_over_contact_pressure(sheet.panel(1, LINES), cells)
    _add_load_bar(gap_axes, cells, results)
    return sheet.figure


def _add_load_bar(axes: Axes, cells: _CellValues, results: Results) -> None:
    """Draw a colour bar for the loads above the axes. Labels that would overlap are left out."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap

    name, scale = load_format(results.dataset).axis
    count = len(cells.loads)
    # load n has the colours from n - 1/2 to n + 1/2
    norm = BoundaryNorm(np.arange(count + 1) - 0.5, count)
    colours = ScalarMappable(norm, ListedColormap(cells.colours))
    bar = add_colour_bar(axes, colours, name, LINES.top + _LOAD_BAR_DISTANCE, loc="center")
    width = panel_size(axes)[0]
    # every first, second, third, … load is labelled, beginning with the highest
    every = int(np.ceil(count * _LABEL_WIDTH / width))
    # indices of the labelled loads, in increasing order
    labelled = np.arange(count)[::-every][::-1]
    labels = [f"{scale * load:.4g}" for load in cells.loads[labelled]]
    bar.set_ticks(labelled, labels=labels)
    bar.ax.minorticks_off()
    longest_label = _CHARACTER_WIDTH * max(map(len, labels))  # inch
    is_crowded = longest_label > width * every / count
    bar.ax.tick_params(labelrotation=90 if is_crowded else 0)


def _cell_values(results: Results) -> _CellValues:
    """Collect the values of all cells of a run. Raise an InputError if the run has no cells."""
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
        """Return the values of a variable as an array (state, cell)."""
        values = data[f"{prefix}_{name}"].values  # (state, row, column)
        return np.asarray(values.reshape(len(values), -1))

    return _CellValues(
        permeability=by_state("k1"),
        mean_gap=by_state("mean_gap"),
        pressure=by_state("pressure"),
        nominal_pressure=nominal_pressure,
        peaks=peaks,
    )


def _draw_over_gap(axes: Axes, cells: _CellValues) -> None:
    """Draw the permeability of the cells against their mean gap, and the permeability of parallel plates as a line."""
    axes.set_xlabel(r"mean gap $\bar h$ of the cell [µm]")
    gap = cells.mean_gap * 1e6  # µm, (state, cell)
    with np.errstate(invalid="ignore"):
        is_drawn = _are_permeable(cells) & (gap > 0)
    _begin_panel(axes, is_drawn)
    if not is_drawn.any():
        return
    handles = _draw_points(axes, cells, gap, is_drawn)
    plates = _draw_parallel_plates(axes, (gap[is_drawn].min(), gap[is_drawn].max()))
    drawn_permeability = cells.permeability[is_drawn]
    highest = max(drawn_permeability.max(), plates.get_ydata()[-1])
    _set_permeability_axis(axes, drawn_permeability.min(), highest)
    axes.legend(handles=[*handles, plates], loc="lower right")


def _draw_over_contact_pressure(axes: Axes, cells: _CellValues) -> None:
    """Draw the permeability of the cells against their contact pressure, and the median permeability as lines."""
    axes.set_xlabel("mean contact pressure of the cell [MPa]")
    pressure = cells.pressure / 1e6  # MPa, (state, cell)
    is_drawn = _are_permeable(cells)
    _begin_panel(axes, is_drawn)
    if not is_drawn.any():
        return
    point_handles = _draw_points(axes, cells, pressure, is_drawn)
    median_handles = _draw_medians(axes, cells, is_drawn)
    lowest_load = cells.loads[cells.loads > 0].min() / 1e6
    axes.set_xscale("symlog", linthresh=_LINEAR_FRACTION * lowest_load, linscale=0.5)
    axes.set_xlim(0, pressure[is_drawn].max() * 1.2)
    _label_pressures(axes)
    drawn_permeability = cells.permeability[is_drawn]
    _set_permeability_axis(axes, drawn_permeability.min(), drawn_permeability.max())
    # the points need no legend here if there are medians, because the panel above explains them
    axes.legend(handles=median_handles or point_handles, loc="lower left")


def _are_permeable(cells: _CellValues) -> Flags:
    """Return whether the permeability of each cell is more than a millionth of the highest, (state, cell)."""
    k = cells.permeability
    with np.errstate(invalid="ignore"):
        return np.asarray(k > np.nanmax(k, initial=0.0) * 10.0**-_PERMEABILITY_DECADES)


def _begin_panel(axes: Axes, is_drawn: Flags) -> None:
    """Label the permeability axis, and draw the grid. If no cell is drawn, write that all cells are sealed."""
    axes.set_ylabel("permeability $k_1$ towards the outlet [m³]")
    add_grid(axes)
    if not is_drawn.any():
        write_in_the_middle(axes, "every cell is sealed")


def _set_permeability_axis(axes: Axes, lowest: float, highest: float) -> None:
    """Set the range of the logarithmic permeability axis."""
    axes.set(yscale="log", ylim=(lowest / _PERMEABILITY_MARGIN, highest * _PERMEABILITY_MARGIN))
    label_decades(axes.yaxis)


def _draw_points(axes: Axes, cells: _CellValues, x: Array, is_drawn: Flags) -> list[Any]:
    """Draw a point for each open cell in each contact state, and return handles for a legend of the branches.

    x : position of each point along the horizontal axis, (state, cell).
    """
    from matplotlib.lines import Line2D

    load_of_state = np.searchsorted(cells.loads, cells.nominal_pressure)  # index of the load
    state_colours = np.array(cells.colours)[load_of_state]
    handles: list[Any] = []
    for number, (name, states) in enumerate(cells.branches):
        is_filled = number == 0  # on loading
        marker = MARKERS[number % len(MARKERS)]
        # the first state of an unloading is also a state of the loading, and has already been drawn
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


def _draw_parallel_plates(axes: Axes, gaps_um: Pair) -> Any:
    """Draw the permeability of parallel plates against their gap, and limit the horizontal axis to `gaps_um` [µm]."""
    gap_um = np.geomspace(gaps_um[0] / 1.1, gaps_um[1] * 1.1, 50)
    plates = cubic_law(gap_um * 1e-6)
    label = r"parallel plates, $\bar h^3/12$"
    (line,) = axes.plot(gap_um, plates, color="black", lw=1.0, label=label)
    axes.set(xscale="log", xlim=(gap_um[0], gap_um[-1]))
    label_decades(axes.xaxis)
    return line


def _draw_medians(axes: Axes, cells: _CellValues, is_drawn: Flags) -> list[Any]:
    """Draw the median permeability of the open cells against the nominal pressure, with a line for each branch."""
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
            ls=LINE_STYLES[number % len(LINE_STYLES)],
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
