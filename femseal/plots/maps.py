"""Draw maps of a surface at one load, and of the solution of a single contact, cell flow or seal flow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, InputError, Pair
from ..contact import Contact, LoadCycle, LoadState
from ..flow import Permeability
from ..results.load_steps import branches, load_names, pressures_and_peaks
from ..results.pixel_fields import stored_steps
from ..results.results import Results
from ..seal import Leakage
from .drawing import LOADS, MAP, Sheet, add_grid, figure_of, set_load_axis, shows
from .heights import draw_heights
from .map_panels import (
    CLOSED_COLOUR,
    POCKET_COLOUR,
    add_key,
    add_shade,
    colours_with_closed,
    draw_map,
    map_dpi,
    map_row_height,
    reduced,
    to_image,
)
from .pressure_lines import (
    draw_fluid_pressure_lines,
    leaking_steps,
    pressure_margins,
    pressure_panel_height,
    surface_leakage,
)
from .realisations import realisation_figure
from .style import branch_styles, styled

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Largest number of pixels of a field that is averaged for a map. A larger field would take too much memory.
_LARGEST_FIELD = 4096 * 4096
#: Colour of the flow in maps of the fluid pressure.
_FLOW = "#D7191C"


# --- the surface at one load ------------------------------------------------------------------------------


def default_step(data: xarray.Dataset) -> int:
    """Return the index of the load step that pictures show by default: the highest load at which the seal leaks.

    If the results contain a realisation, the function chooses the highest load at which fluid also flows through its
    tiles. The tiles may be closed at higher loads, at which the surface leaks only along a path that winds through
    several cells, each of which is closed if it is solved on its own. If the seal leaks at no load, the index is 0.
    """
    leaks = np.nan_to_num(surface_leakage(data)) != 0  # (step,)
    if "drawn_flux" in data:
        tiles_leak = np.any(np.nan_to_num(data["drawn_flux"].values) != 0, axis=(1, 2))  # (step,)
        if np.any(leaks & tiles_leak):
            leaks &= tiles_leak
    leaking = np.flatnonzero(leaks)
    if not leaking.size:
        return 0
    return int(leaking[np.argmax(data["nominal_pressure"].values[leaking])])


@styled
def seal_figure(results: Results, step: int | None = None) -> Figure:
    """Draw contact pressure, gap and fluid pressure of the surface at one load, and the fluid pressure along x1.

    If the fields over the pixels are in memory or in the folder of the results, the maps show every pixel, up to 1024
    along each side. If the fields over the pixels are not available, the maps show means over blocks of pixels. The map
    of the fluid pressure also shows the flow. If the results have no fields over the surface, the realisation whose
    leakage is nearest to the median is drawn instead.

    Parameters
    ----------
    results : Results
        Results of a run.
    step : int, optional
        Index of the load step; by default the step with the highest load at which the seal leaks.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        The results contain no maps, or have no load step with this index.
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
    contact_pressure, gap, fluid_pressure = surface_fields(results, step)
    size = sides(data)
    row_height = map_row_height(size)
    line_margins = pressure_margins(len(leaking_steps(data)), with_range=True)
    sheet = Sheet(
        [row_height] * 3 + [pressure_panel_height(line_margins)],
        head=0.22,
        dpi=map_dpi(gap.shape),
    )
    _draw_contact_pressure(sheet.panel(0, MAP), contact_pressure, size)
    _draw_gap(sheet.panel(1, MAP), gap, size)
    _draw_fluid_pressure_and_flow(sheet.panel(2, MAP), fluid_pressure, gap, size)
    draw_fluid_pressure_lines(sheet.panel(3, line_margins), data, step)
    name = load_names(data)[step]
    sheet.head(name if surface_leakage(data)[step] != 0 else f"{name}: no flow")
    return sheet.figure


def surface_fields(results: Results, step: int) -> list[Array]:
    """Return the contact pressure [Pa], the gap [m] and the fluid pressure [Pa] of the surface at a load step.

    The three fields are arrays of the same shape (n1, n2). If the fields over the pixels are in memory or in the folder
    of the results, the arrays contain a value for each pixel. Fields with more pixels than a picture can show are
    averaged. If the fields over the pixels are not available, the arrays contain the means over blocks of pixels from
    the dataset.
    """
    names = ("contact_pressure", "gap", "fluid_pressure")
    if step in stored_steps(results):
        first = results.pixels(names[0], step).values
        if first.size <= _LARGEST_FIELD:
            others = (results.pixels(name, step).values for name in names[1:])
            return [reduced(first), *map(reduced, others)]
    return [results.dataset[f"face_{name}"].values[step].astype(float) for name in names]


@styled
def surface_figure(data: xarray.Dataset) -> Figure:
    """Draw the heights of the surface for which contact and flow were solved."""
    size = sides(data)
    heights = data["face_height"].values
    sheet = Sheet([map_row_height(size)], dpi=map_dpi(heights.shape))
    draw_heights(sheet.panel(0, MAP), heights * 1e6, size)
    return sheet.figure


@styled
def patch_figure(data: xarray.Dataset) -> Figure:
    """Draw the heights of the measured patch that leaks most.

    If the results contain the gap of the patch, a second map shows the gap at the highest load at which the seal leaks.
    """
    size = sides(data, "patch")
    has_gaps = "patch_gap" in data
    heights = data["patch_height"]
    row_heights = [map_row_height(size)] * (2 if has_gaps else 1)
    title = f"patch {heights.attrs['patch']}"
    if has_gaps:
        title += f"; gap at {load_names(data)[default_step(data)]}"
    sheet = Sheet(row_heights, head=0.22, dpi=map_dpi(heights.shape))
    draw_heights(sheet.panel(0, MAP), heights.values * 1e6, size)
    if has_gaps:
        _draw_gap(sheet.panel(1, MAP), data["patch_gap"].values[default_step(data)], size)
    sheet.head(title)
    return sheet.figure


def sides(data: xarray.Dataset, part: str = "face") -> Pair:
    """Return the sides [m] of the surface ("face"), or of the patch that `patch_figure` draws ("patch").

    The dataset contains the coordinates of the centres of blocks of pixels, from which the sides are computed.
    """
    x1 = data[f"{part}1"].values
    x2 = data[f"{part}2"].values
    # the first centre is half a block from 0, and the last one half a block from the other end
    return float(x1[0] + x1[-1]), float(x2[0] + x2[-1])


def _draw_contact_pressure(axes: Axes, pressure: Array, size: Pair) -> None:
    """Draw a map of a contact pressure (n1, n2) [Pa] over a surface with the sides `size` [m]."""
    in_contact = np.where(pressure > 0, pressure, np.nan) / 1e6
    colours = colours_with_closed("viridis")
    key = {"no contact": CLOSED_COLOUR}
    draw_map(axes, in_contact, size, colours, "contact pressure [MPa]", key=key, vmin=0)


def _draw_gap(axes: Axes, gap: Array, size: Pair) -> None:
    """Draw a map of a gap (n1, n2) [m] over a surface with the sides `size` [m]."""
    open_gap = np.where(gap > 0, gap, np.nan) * 1e6
    colours = colours_with_closed("magma")
    draw_map(axes, open_gap, size, colours, "gap [µm]", key={"contact": CLOSED_COLOUR}, vmin=0)


def _draw_fluid_pressure_and_flow(axes: Axes, pressure: Array, gap: Array, size: Pair) -> None:
    """Draw a map of the fluid pressure (n1, n2) [Pa], and the flow over the map.

    The flow is drawn in red. The larger the flow at a pixel, the more opaque the red.
    """
    from matplotlib.colors import to_rgb

    colours = colours_with_closed("cividis", POCKET_COLOUR)
    draw_map(axes, pressure / 1e6, size, colours, "fluid pressure [MPa]")
    key = {"contact, pockets": POCKET_COLOUR}
    flow = relative_flow(gap, pressure, size)
    if flow.any():
        key["flow"] = _FLOW
        add_shade(axes, to_rgb(_FLOW), to_image(np.sqrt(flow), size))
    add_key(axes, key)


def relative_flow(gap: Array, pressure: Array, size: Pair) -> Array:
    """Compute the flow per unit width at each pixel, divided by its largest value.

    By the cubic law, the flow between two neighbouring pixels is proportional to h³ Δp/Δx. The value h³ is the harmonic
    mean over the two pixels. Along each axis, the flow at a pixel is the mean of the flow from the previous pixel and
    the flow to the next pixel.

    Parameters
    ----------
    gap : array (n1, n2)
        Gap in any unit; 0 in contact.
    pressure : array (n1, n2)
        Fluid pressure in any unit, NaN at points without a fluid pressure.
    size : pair of float
        Sides of the surface along x1 and x2, in any unit.

    Returns
    -------
    array (n1, n2)
        Magnitude of the flow divided by its largest value; 0 at all pixels if no fluid flows.
    """
    is_open = np.isfinite(pressure) & (gap > 0)
    conductivity = np.where(is_open, gap, 0.0) ** 3
    known = np.where(is_open, pressure, 0.0)
    squared = np.zeros(gap.shape)
    for axis, side in enumerate(size):
        of_next_pixel = np.roll(conductivity, -1, axis)
        total = conductivity + of_next_pixel
        # harmonic mean of both pixels, 0 if one of them is closed
        mean = np.divide(
            2 * conductivity * of_next_pixel, total, out=np.zeros_like(total), where=total > 0
        )
        to_next = mean * (known - np.roll(known, -1, axis)) * gap.shape[axis] / side
        from_previous = np.roll(to_next, 1, axis)
        if axis == 0:
            # x1 is not periodic: the first row has no previous row, and the last row has no next row
            to_next[-1] = from_previous[-1]
            from_previous[0] = to_next[0]
        squared += ((to_next + from_previous) / 2) ** 2
    flow = np.sqrt(squared)
    return np.asarray(flow / (flow.max() or 1.0))


# --- single solutions -------------------------------------------------------------------------------------


@shows(Contact)
def contact_figure(contact: Contact) -> Figure:
    """Draw maps of the contact pressure and the gap of a contact."""
    return _contact_sheet(contact).figure


def _contact_sheet(contact: Contact, head: float = 0.0) -> Sheet:
    """Draw maps of the contact pressure and the gap of a contact into a new figure.

    head : height of the space for a title [inch].
    """
    spacing = contact.half_space.spacing
    size = (contact.gap.shape[0] * spacing[0], contact.gap.shape[1] * spacing[1])
    row_height = map_row_height(size)
    sheet = Sheet([row_height] * 2, head=head, dpi=map_dpi(contact.gap.shape))
    _draw_contact_pressure(sheet.panel(0, MAP), contact.pressure, size)
    _draw_gap(sheet.panel(1, MAP), contact.gap, size)
    return sheet


@shows(LoadState)
def state_figure(state: LoadState) -> Figure:
    """Draw maps of the contact pressure and the gap at one step of a load cycle."""
    sheet = _contact_sheet(state.contact, head=0.22)
    sheet.head(state.name)
    return sheet.figure


@shows(LoadCycle)
def cycle_figure(cycle: LoadCycle) -> Figure:
    """Draw the fraction of points in contact and the mean gap against the nominal pressure."""
    margins = LOADS
    sheet = Sheet([1.8 + margins.bottom + margins.top] * 2)
    contact_percent = np.array([100 * state.contact.area_fraction for state in cycle])
    contact_axes = sheet.panel(0, margins)
    _draw_over_pressure(contact_axes, cycle, contact_percent, "fraction in contact [%]")
    contact_axes.legend(loc="best")
    mean_gap_um = np.array([state.contact.mean_gap * 1e6 for state in cycle])
    _draw_over_pressure(sheet.panel(1, margins), cycle, mean_gap_um, "mean gap [µm]")
    return sheet.figure


def _draw_over_pressure(axes: Axes, cycle: LoadCycle, values: Array, name: str) -> None:
    """Draw values of a load cycle (steps,) against the nominal pressure, with a line for each branch of the cycle."""
    pressure, peaks = pressures_and_peaks(cycle)
    cycle_branches = branches(pressure, peaks)
    styles = branch_styles(len(cycle_branches))
    for (branch, steps), style in zip(cycle_branches, styles, strict=True):
        axes.plot(pressure[steps] / 1e6, values[steps], label=branch, **style)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=name)
    set_load_axis(axes, pressure / 1e6)
    add_grid(axes)


@shows(Permeability)
def permeability_figure(permeability: Permeability, ax: Axes | None = None) -> Figure:
    """Draw the fluid pressure in a cell for a unit pressure drop."""
    name = "fluid pressure for a unit drop"
    key = {"contact, pockets": POCKET_COLOUR}
    return _draw_fluid_pressure(permeability.fluid_pressure, ax, name, "pixels", key)


@shows(Leakage)
def seal_leakage_figure(leakage: Leakage, ax: Axes | None = None) -> Figure:
    """Draw the fluid pressure at the nodes of a rectangular or annular seal.

    Raises
    ------
    InputError
        The leakage was computed on an unstructured mesh, whose nodes do not form rows.
    """
    if leakage.fluid_pressure.ndim != 2:
        given = f"the leakage of a mesh, with {leakage.fluid_pressure.size} nodes"
        raise InputError("plot", given, "the leakage of a rectangular or annular seal")
    pressure = leakage.fluid_pressure / 1e6
    key = {"pockets": POCKET_COLOUR}
    return _draw_fluid_pressure(pressure, ax, "fluid pressure [MPa]", "nodes", key)


def _draw_fluid_pressure(
    values: Array, ax: Axes | None, name: str, unit: str, key: dict[str, str]
) -> Figure:
    """Draw a map of a fluid pressure (n1, n2) into axes, by default into the axes of a new figure.

    unit : unit of the axes, "pixels" or "nodes".
    key : legend for points without a pressure: a colour for each text, such as "pockets".
    """
    n1, n2 = values.shape
    if ax is None:
        sheet = Sheet([map_row_height((n1, n2))], dpi=map_dpi(values.shape))
        ax = sheet.panel(0, MAP)
    has_undefined = bool(np.isnan(values).any())
    colours = colours_with_closed("cividis", POCKET_COLOUR)
    draw_map(ax, values, (n1, n2), colours, name, unit, key=key if has_undefined else None)
    return figure_of(ax)
