"""Draw maps of a surface at one load, and of the solution of a single contact, cell flow or seal flow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, InputError, Pair
from ..contact import Contact, LoadCycle, LoadState
from ..flow import Permeability
from ..results.load_steps import branches, load_names, pressures_and_peaks
from ..results.results import Results
from ..seal import Leakage
from .drawing import (
    GREY,
    MAP,
    STYLES,
    Sheet,
    branch_styles,
    figure_of,
    label_axes,
    new_figure,
    shows,
)
from .heights import draw_heights
from .map_panels import (
    POCKET,
    colours_with_closed,
    draw_map,
    map_height,
    map_row_height,
    on_its_side,
)
from .realisations import realisation_figure

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# --- the surface at one load ------------------------------------------------------------------------------


def default_step(data: xarray.Dataset) -> int:
    """Return the index of the step with the highest load that still leaks, 0 if no step leaks."""
    leaking = np.flatnonzero(np.nan_to_num(surface_leakage(data)))
    if not leaking.size:
        return 0
    return int(leaking[np.argmax(data["nominal_pressure"].values[leaking])])


def surface_leakage(data: xarray.Dataset) -> Array:
    """Return the leakage (steps,) [m²/s] of the surface, or that of the realisations if the surface was not solved."""
    names = ("leakage_two_scale", "leakage_deterministic", "leakage_blocks", "leakage_median")
    available = [name for name in names if name in data]
    return np.asarray(data[available[0]].values)


def seal_figure(results: Results, step: int | None = None) -> Figure:
    """Draw contact pressure, gap and fluid pressure of the surface at one load, and the fluid pressure along x1.

    The maps show means over blocks of pixels. If the results have no fields over the surface, the realisation nearest
    to the median is drawn instead.

    Parameters
    ----------
    results : Results
        Results of a run.
    step : int, optional
        Index of the load step; by default the step with the highest load that still leaks.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        The results contain no maps, or there is no such step.
    """
    data = results.dataset
    if "face_gap" not in data and "drawn_corners" not in data:
        expected = "results of a deterministic or two-scale study, or with a realisation"
        raise InputError("seal figure", "results without maps", expected)
    if step is None:
        step = default_step(data)
    if not 0 <= step < data.sizes["step"]:
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    if "face_gap" not in data:
        return realisation_figure(data, step)
    size = sides(data)
    row_height = map_row_height(on_its_side(size))
    sheet = Sheet([row_height, row_height, row_height, 2.4], head=0.35)
    contact_pressure = data["face_contact_pressure"].values[step]
    _draw_contact_pressure(sheet.panel(0, MAP), contact_pressure, size, "\n")
    gap = data["face_gap"].values[step]
    _draw_gap(sheet.panel(1, MAP), gap, size, "gap [µm]\ngrey: contact")
    title = "fluid pressure [MPa]"
    if surface_leakage(data)[step] == 0:
        title += ", no flow"
    title += "\nwhite: contact, pockets"
    fluid_pressure = data["face_fluid_pressure"].values[step] / 1e6
    colours = colours_with_closed("cividis", POCKET)
    draw_map(sheet.panel(2, MAP), fluid_pressure, size, colours, title)
    draw_pressure_drop(sheet.panel(3, MAP), data, representative_steps(data, step))
    sheet.head(f"{load_names(data)[step]}; inlet at x1 = 0")
    return sheet.figure


def representative_steps(data: xarray.Dataset, last: int) -> list[int]:
    """Return the first and the middle one of the loading steps that leak, followed by the step `last`."""
    loading = np.flatnonzero(np.isnan(data["unloaded_from"].values))
    leaking = loading[np.nan_to_num(surface_leakage(data)[loading]) != 0]
    steps = [leaking[0], leaking[leaking.size // 2]] if leaking.size else []
    return list(dict.fromkeys([*steps, last]))


def patch_figure(data: xarray.Dataset) -> Figure:
    """Draw the heights of the measured patch that leaks most, and if known its gap at the highest load that leaks."""
    size = sides(data, "patch")
    has_gaps = "patch_gap" in data
    sheet = Sheet([map_row_height(on_its_side(size))] * (2 if has_gaps else 1))
    heights = data["patch_height"]
    title = f"patch {heights.attrs['patch']}: height [µm]"
    draw_heights(sheet.panel(0, MAP), heights.values * 1e6, size, title)
    if has_gaps:
        step = default_step(data)
        title = f"gap [µm] at {load_names(data)[step]}; grey: contact"
        _draw_gap(sheet.panel(1, MAP), data["patch_gap"].values[step], size, title)
    return sheet.figure


def sides(data: xarray.Dataset, part: str = "face") -> Pair:
    """Return the sides [mm] of the surface ("face") or of the drawn patch ("patch"), from the centres of its blocks."""
    x1 = data[f"{part}1"].values
    x2 = data[f"{part}2"].values
    # the first and the last centre are half a block away from the ends
    return float(x1[0] + x1[-1]) * 1e3, float(x2[0] + x2[-1]) * 1e3


def _draw_contact_pressure(axes: Axes, pressure: Array, size: Pair, separator: str) -> None:
    """Draw a map of a contact pressure (n1, n2) [Pa]; `separator` is the text between the two parts of its title."""
    in_contact = np.where(pressure > 0, pressure, np.nan) / 1e6
    title = f"contact pressure [MPa]{separator}grey: no contact"
    draw_map(axes, in_contact, size, colours_with_closed("viridis"), title)


def _draw_gap(axes: Axes, gap: Array, size: Pair, title: str) -> None:
    """Draw a map of a gap (n1, n2) [m]."""
    open_gap = np.where(gap > 0, gap, np.nan) * 1e6
    draw_map(axes, open_gap, size, colours_with_closed("magma"), title, vmin=0)


def draw_pressure_drop(axes: Axes, data: xarray.Dataset, steps: Sequence[int]) -> None:
    """Draw the fluid pressure along x1, averaged over x2.

    A line is drawn for each of the steps; for the last one, the range between the lowest and the highest pressure is
    shaded as well.
    """
    values = data["face_fluid_pressure"].values.astype(float)  # (step, row, column)
    pressure = np.ma.masked_invalid(values) / 1e6  # MPa; there is none in contact and in pockets
    x1 = data["block1"].values
    means = {step: pressure[step].mean(axis=1) for step in steps}
    _draw_along_x1(axes, data, x1, means, "fluid pressure [MPa]")
    last = pressure[steps[-1]]
    lowest = last.min(axis=1)
    highest = last.max(axis=1)
    label = "lowest to highest"
    axes.fill_between(x1 * 1e3, lowest, highest, color=GREY, alpha=0.15, lw=0, label=label)
    axes.legend(fontsize=8, framealpha=0.9)


def draw_row_pressures(axes: Axes, data: xarray.Dataset, steps: Sequence[int]) -> None:
    """Draw the contact pressure against x1, averaged over x2, which shows the contact band of a seat."""
    pressures = {step: data["row_pressure"].values[step] / 1e6 for step in steps}
    name = "mean contact pressure of rows [MPa]"
    _draw_along_x1(axes, data, data["row"].values, pressures, name)
    axes.legend(fontsize=8, framealpha=0.9)


def _draw_along_x1(
    axes: Axes, data: xarray.Dataset, x1: Array, pressures: dict[int, Array], name: str
) -> None:
    """Draw a line of pressures [MPa] against x1 [m] for each step; `name` is the name of the pressure axis."""
    names = load_names(data)
    for (step, pressure), style in zip(pressures.items(), STYLES, strict=False):
        axes.plot(x1 * 1e3, pressure, lw=1.4, label=names[step], **style)
    label_axes(axes, ("x1, inlet at 0 [mm]", name))
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, lw=0.6)


# --- single solutions -------------------------------------------------------------------------------------


@shows(Contact)
def contact_figure(contact: Contact) -> Figure:
    """Draw maps of the contact pressure and the gap of a contact."""
    n1, n2 = contact.gap.shape
    d1, d2 = contact.half_space.spacing
    size = (n1 * d1 * 1e3, n2 * d2 * 1e3)
    figure = new_figure(11.0, map_height(on_its_side(size), 4.4) + 0.9)
    left, right = figure.subplots(1, 2)
    _draw_contact_pressure(left, contact.pressure, size, "; ")
    _draw_gap(right, contact.gap, size, "gap [µm]; grey: contact")
    return figure


@shows(LoadState)
def state_figure(state: LoadState) -> Figure:
    """Draw maps of the contact pressure and the gap at a step of a load cycle."""
    figure = contact_figure(state.contact)
    figure.suptitle(state.name, fontsize=11)
    return figure


@shows(LoadCycle)
def cycle_figure(cycle: LoadCycle) -> Figure:
    """Draw the fraction in contact and the mean gap against nominal pressure."""
    figure = new_figure(9.6, 4.0)
    contact_axes, gap_axes = figure.subplots(1, 2)
    contact_percent = np.array([100 * state.contact.area_fraction for state in cycle])
    _draw_over_pressure(contact_axes, cycle, contact_percent, "fraction in contact [%]")
    mean_gap_um = np.array([state.contact.mean_gap * 1e6 for state in cycle])
    _draw_over_pressure(gap_axes, cycle, mean_gap_um, "mean gap [µm]")
    contact_axes.legend(fontsize=8.5, frameon=False)
    return figure


def _draw_over_pressure(axes: Axes, cycle: LoadCycle, values: Array, name: str) -> None:
    """Draw values (steps,) against nominal pressure, with a line for each branch of a load cycle."""
    pressure, peaks = pressures_and_peaks(cycle)
    cycle_branches = branches(pressure, peaks)
    styles = branch_styles(len(cycle_branches))
    for (branch, steps), style in zip(cycle_branches, styles, strict=True):
        axes.plot(pressure[steps] / 1e6, values[steps], label=branch, **style)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=name)
    axes.grid(alpha=0.25, lw=0.6)


@shows(Permeability)
def permeability_figure(permeability: Permeability, ax: Axes | None = None) -> Figure:
    """Draw the fluid pressure in a cell for a unit pressure drop."""
    title = "fluid pressure for a unit drop; white: contact, pockets"
    return _draw_fluid_pressure(permeability.fluid_pressure, ax, title, "pixels")


@shows(Leakage)
def seal_leakage_figure(leakage: Leakage, ax: Axes | None = None) -> Figure:
    """Draw the fluid pressure at the nodes of a rectangular or annular seal.

    Raises
    ------
    InputError
        The seal is a mesh, whose nodes do not form rows.
    """
    if leakage.fluid_pressure.ndim != 2:
        given = f"the leakage of a mesh, with {leakage.fluid_pressure.size} nodes"
        raise InputError("plot", given, "the leakage of a rectangular or annular seal")
    title = "fluid pressure [MPa]; white: pockets"
    return _draw_fluid_pressure(leakage.fluid_pressure / 1e6, ax, title, "nodes")


def _draw_fluid_pressure(values: Array, ax: Axes | None, title: str, unit: str) -> Figure:
    """Draw a map of a fluid pressure (n1, n2) into axes, by default those of a new figure.

    The axes count pixels or nodes; `unit` says which.
    """
    n1, n2 = values.shape
    if ax is None:
        height = map_height(on_its_side((n1, n2)), 4.6) + 0.9
        ax = new_figure(6.2, height).add_subplot()
    draw_map(ax, values, (n1, n2), colours_with_closed("cividis", POCKET), title, unit)
    return figure_of(ax)
