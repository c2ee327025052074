"""Draw the permeability of cells against their mean gap and their contact pressure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags, InputError
from ..flow.law import cubic_law
from ..results.results import Results
from .drawing import GREY, LEGEND_LINE, LINES, Sheet, branch_styles, label_decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Cells are drawn if their permeability is at most this number of decades below the highest one.
_PERMEABILITY_DECADES = 6
#: Factor by which the scale of permeabilities extends beyond the values.
_PERMEABILITY_MARGIN = 1.5


@dataclass(frozen=True)
class _CellValues:
    """Values of all cells in every contact state of a run.

    Attributes
    ----------
    permeability : permeability in direction x1, towards the outlet, (states, cells) [m³].
    mean_gap : mean gap of each cell, (states, cells) [m].
    pressure : mean contact pressure of each cell, (states, cells) [Pa].
    is_loading : True for the states on loading, (states,).
    """

    permeability: Array
    mean_gap: Array
    pressure: Array
    is_loading: Flags


def cells_figure(results: Results) -> Figure:
    """Draw the permeability of the cells towards the outlet against their mean gap and their contact pressure.

    Sealed cells are left out, and so are cells whose permeability is less than a millionth of the highest one. The line
    in the first panel is h̄³/12, the permeability of parallel plates. The cells of a stochastic run are those from which
    its realisations are composed; the cells of a two-scale run are those of the surface at each load.

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
    legend_height = LEGEND_LINE * 3
    sheet = Sheet([3.6 + legend_height] * 2, head=0.35)
    sheet.head("each point: a cell of the surface at one load")
    margins = replace(LINES, top=0.1, bottom=LINES.bottom + legend_height)
    gap_axes = sheet.panel(0, margins)
    gap_axes.set_xlabel("mean gap of the cell [µm]")
    _draw_cells(gap_axes, cells, cells.mean_gap * 1e6, with_parallel_plates=True)
    pressure_axes = sheet.panel(1, margins)
    pressure_axes.set_xlabel("mean contact pressure of the cell [MPa]")
    _draw_cells(pressure_axes, cells, cells.pressure / 1e6, with_parallel_plates=False)
    return sheet.figure


def _cell_values(results: Results) -> _CellValues:
    """Collect the values of all cells of a run; raise an InputError if the run has no cells."""
    data = results.dataset
    if "state_k1" in data:
        prefix = "state"
        peaks = data["state_unloaded_from"].values
    elif "cell_k1" in data:
        prefix = "cell"
        peaks = data["unloaded_from"].values
    else:
        expected = "results of a two-scale or stochastic run"
        raise InputError("cells figure", "results without cells", expected)

    def by_state(name: str) -> Array:
        values = data[f"{prefix}_{name}"].values  # (state, row, column)
        return np.asarray(values.reshape(len(values), -1))  # (state, cell)

    return _CellValues(by_state("k1"), by_state("mean_gap"), by_state("pressure"), np.isnan(peaks))


def _draw_cells(axes: Axes, cells: _CellValues, x: Array, *, with_parallel_plates: bool) -> None:
    """Draw a point for each open cell in each state, coloured by loading and unloading, and a legend.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    cells : _CellValues
        Permeability of the cells, and branch of each state.
    x : array (states, cells)
        Position of each point along the horizontal axis.
    with_parallel_plates : bool
        True if `x` is the mean gap [µm]. The permeability of parallel plates is drawn too, and cells whose mean gap is
        zero are left out.
    """
    axes.set_ylabel("permeability towards the outlet [m³]")
    axes.grid(alpha=0.25, lw=0.6)
    k = cells.permeability
    with np.errstate(invalid="ignore"):
        is_drawn = k > np.nanmax(k, initial=0.0) * 10.0**-_PERMEABILITY_DECADES
        if with_parallel_plates:
            is_drawn &= x > 0
    if not is_drawn.any():
        style: Any = {"xycoords": "axes fraction", "ha": "center", "color": GREY}
        axes.annotate("every cell is sealed", (0.5, 0.5), **style)
        return
    loading_style, unloading_style = branch_styles(2)
    branch_states = (
        ("loading", cells.is_loading, loading_style),
        ("unloading", ~cells.is_loading, unloading_style),
    )
    for name, states, style in branch_states:
        if not states.any():
            continue
        is_point = is_drawn[states]
        label = name if is_point.any() else f"{name}, all sealed"
        style |= {"ls": "", "ms": 4, "mew": 0, "alpha": 0.55, "rasterized": True}
        axes.plot(x[states][is_point], k[states][is_point], label=label, **style)
    lowest = k[is_drawn].min()
    highest = k[is_drawn].max()
    if with_parallel_plates:
        gap_um = np.geomspace(x[is_drawn].min() / 1.1, x[is_drawn].max() * 1.1, 50)
        plates = cubic_law(gap_um * 1e-6)
        axes.plot(gap_um, plates, color="black", lw=1.4, label="parallel plates, h̄³/12")
        axes.set(xscale="log", xlim=(gap_um[0], gap_um[-1]))
        highest = max(highest, plates[-1])
        label_decades(axes.xaxis)
    axes.set(yscale="log", ylim=(lowest / _PERMEABILITY_MARGIN, highest * _PERMEABILITY_MARGIN))
    label_decades(axes.yaxis)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize=8.5, frameon=False)
