"""Draw pressures against the distance from the inlet, with a line for each load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array
from ..results.best_leakage import solved_studies
from ..results.load_steps import branches_in, load_format
from ..results.results import Results
from .drawing import (
    LEGEND_LINE,
    LINES,
    Margins,
    Sheet,
    add_grid,
    figure_of,
    legend_below,
    length_unit,
)
from .style import GREY, LINE_STYLES, MARKERS, sequential_colours, styled

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height of the axes [inch].
_AXES_HEIGHT = 1.9


def surface_leakage(data: xarray.Dataset) -> Array:
    """Return the leakage of the surface at each load step (steps,) [m²/s].

    If no study has computed the flow through the surface, the median leakage of the realisations is returned instead.
    """
    studies = sorted(
        solved_studies(data),
        key=lambda study: (study.has_realisations, not study.solves_whole_surface),
    )
    return np.asarray(data[studies[0].leakage_variable].values)


def short_load_names(data: xarray.Dataset) -> list[str]:
    """Return a short name of every load step, such as "40 MPa", or "40 MPa (from 300 MPa)" for an unloading.

    The load has the unit of the case file, a unit of pressure or of force.
    """
    text = load_format(data).short
    names = []
    for pressure, peak in zip(
        data["nominal_pressure"].values, data["unloaded_from"].values, strict=True
    ):
        names.append(text(pressure) if np.isnan(peak) else f"{text(pressure)} (from {text(peak)})")
    return names


def leaking_steps(data: xarray.Dataset) -> list[int]:
    """Return the indices of the load steps at which the seal leaks; if it never leaks, the index of the first step."""
    leaking = np.flatnonzero(np.nan_to_num(surface_leakage(data)) != 0)
    return leaking.tolist() or [0]


def pressure_margins(line_count: int, with_range: bool) -> Margins:
    """Return the margins of a panel with a legend below its axes.

    line_count : number of lines that the legend lists.
    with_range : whether the legend also lists a shaded area.
    """
    lines = ceil((line_count + with_range) / 2)  # the legend has two columns
    return replace(LINES, bottom=LINES.bottom + LEGEND_LINE * (lines + 0.5))


def pressure_panel_height(margins: Margins) -> float:
    """Return the height [inch] of a panel that shows pressures."""
    return _AXES_HEIGHT + margins.bottom + margins.top


def draw_fluid_pressure_lines(axes: Axes, data: xarray.Dataset, shown_step: int) -> None:
    """Draw the fluid pressure along x1, averaged over x2, with a line for each load at which the seal leaks.

    For the load step `shown_step`, the range between the lowest and the highest fluid pressure over x2 is shaded.
    """
    values = data["face_fluid_pressure"].values.astype(float)  # (step, row, column)
    pressure = np.ma.masked_invalid(values) / 1e6  # MPa; there is none in contact and in pockets
    x1 = data["block1"].values
    means = {step: pressure[step].mean(axis=1) for step in leaking_steps(data)}
    handles = _draw_along_x1(axes, data, x1, means, "fluid pressure [MPa]")
    unit, _ = length_unit(x1[-1])
    shown = pressure[shown_step]
    label = f"all $x_2$, {short_load_names(data)[shown_step]}"
    style: dict[str, Any] = {"color": GREY, "alpha": 0.2, "lw": 0}
    handles.append(
        axes.fill_between(x1 / unit, shown.min(axis=1), shown.max(axis=1), label=label, **style)
    )
    legend_below(figure_of(axes), handles)


@styled
def seat_figure(data: xarray.Dataset) -> Figure:
    """Draw the contact pressure along x1, averaged over x2, at every load.

    The figure shows the contact width of a sealing edge (seat).
    """
    steps = range(data.sizes["step"])
    margins = pressure_margins(len(steps), with_range=False)
    sheet = Sheet([pressure_panel_height(margins)])
    axes = sheet.panel(0, margins)
    pressures = {step: data["row_pressure"].values[step] / 1e6 for step in steps}
    name = "mean pressure of rows [MPa]"
    handles = _draw_along_x1(axes, data, data["row"].values, pressures, name)
    legend_below(sheet.figure, handles)
    return sheet.figure


@styled
def pressure_figure(results: Results, step: int | None = None) -> Figure:
    """Draw the fluid pressure between inlet and outlet, averaged along the seal, for each load at which the seal leaks.

    Parameters
    ----------
    results : Results
        Results with maps of the surface.
    step : int, optional
        Index of the load step for which the range of fluid pressures along the seal is shaded; by default the last
        load step at which the seal leaks.

    Returns
    -------
    Figure
    """
    data = results.dataset
    steps = leaking_steps(data)
    margins = pressure_margins(len(steps), with_range=True)
    sheet = Sheet([pressure_panel_height(margins)])
    draw_fluid_pressure_lines(sheet.panel(0, margins), data, steps[-1] if step is None else step)
    return sheet.figure


def _draw_along_x1(
    axes: Axes, data: xarray.Dataset, x1: Array, pressures: Mapping[int, Array], name: str
) -> list[Any]:
    """Draw pressures [MPa] against x1 [m], with a line for each load step, and return the lines.

    The colour of a line indicates the load, from dark to bright. The line style indicates the branch of the load cycle.

    pressures : pressures along x1 [MPa], keyed by load step index.
    """
    names = short_load_names(data)
    unit, unit_name = length_unit(x1[-1])
    nominal = data["nominal_pressure"].values
    loads = np.unique(nominal[list(pressures)])
    colours = sequential_colours(len(loads))
    # The step from which the seal is unloaded belongs to two branches, the loading and an unloading. It is drawn as a
    # step of the loading, which is the first branch.
    branch_of_step: dict[int, int] = {}
    for branch, (_name, steps) in enumerate(branches_in(data)):
        for step in steps:
            branch_of_step.setdefault(int(step), branch)
    lines: list[Any] = []
    for step, pressure in pressures.items():
        branch = branch_of_step[step]
        (line,) = axes.plot(
            x1 / unit,
            pressure,
            color=colours[int(np.searchsorted(loads, nominal[step]))],
            ls=LINE_STYLES[branch % len(LINE_STYLES)],
            marker=MARKERS[branch % len(MARKERS)],
            # four markers on each line, at positions other than those on the neighbouring lines
            markevery=(0.1 + 0.03 * (len(lines) % 5), 0.25),
            label=names[step],
        )
        lines.append(line)
    axes.set(xlabel=f"$x_1$, inlet at 0 [{unit_name}]", ylabel=name, xlim=(0, None))
    add_grid(axes)
    return lines
