"""Maps of the face: its fields in blocks, and where the pressure drops and how permeable it is in its pieces.

Also single solutions: a contact, a load cycle, the flow in a cell, the leakage of a seal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError
from ..contact import Contact, LoadCycle, LoadState
from ..flow import Permeability
from ..results.run_data import RunData
from ..results.selections import branches, load_names, pressures_and_peaks
from ..seal import Leakage
from .drawing import CLOSED, LINES, MAP, POCKET, STYLES, Sheet, branch_styles, new_figure, one_panel, shows
from .drawn_panels import drawn_figure
from .heights import height_panel
from .map_panels import lying, map_height, map_panel, map_row, on_decades, with_closed

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Permeabilities shown in colour: this many decades below the largest.
_DECADES = 10


def default_step(data: xarray.Dataset) -> int:
    """The step of the highest load at which the face leaks, or else the drawn seals; the first step if none does."""
    names = ("leakage_two_scale", "leakage_deterministic", "leakage_median")
    name = next(name for name in names if name in data)
    leaking = np.flatnonzero(np.nan_to_num(data[name].values))
    return int(leaking[np.argmax(data["nominal_pressure"].values[leaking])]) if leaking.size else 0


def has_maps(data: xarray.Dataset) -> bool:
    """Whether there are fields over the face."""
    return "face_gap" in data


def seal_figure(results: RunData, step: int | None = None) -> Figure:
    """Maps of the face at one step: fluid pressure, contact pressure and gap in blocks, and the fall of the pressure.

    Of a two-scale study also the fraction of the pressure drop in each piece, and their permeability. Without fields
    over the face: of the drawn seal that is nearest to the median.

    step : index of the load step; the highest load that still leaks unless given.

    Raises InputError: results without fields over the face, or no such step.
    """
    data = results.dataset
    if not has_maps(data) and "drawn_corners" not in data:
        expected = "those of a two-scale or a deterministic study, or with a drawn seal"
        raise InputError("seal figure", "results without maps", expected)
    s = default_step(data) if step is None else step
    if not 0 <= s < data.sizes["step"]:
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    if not has_maps(data):
        return drawn_figure(data, s)
    row = map_row(lying(face_size(data)))
    panels: list[Callable[..., None]] = [
        partial(_face_map, name=name) for name in ("fluid_pressure", "contact_pressure", "gap")
    ]
    panels += [fraction_panel, permeability_panel] if "piece_k1" in data else []
    heights = [row] * (len(panels) // 2) + [max(row, 2.9)]
    sheet = Sheet(heights, columns=2, head=0.35)
    for n, draw in enumerate(panels):
        draw(sheet.panel(*divmod(n, 2), MAP), data, s)
    drop_panel(sheet.panel(*divmod(len(panels), 2), LINES), data, [s])
    sheet.figure.suptitle(f"{data['name'].values[s]}; inlet at x1 = 0", fontsize=11, y=1 - 0.1 / sheet.height, va="top")
    return sheet.figure


def place_figure(data: xarray.Dataset) -> Figure:
    """Heights of the measured place that leaks most, and its gap at the highest load that leaks where it is known."""
    size = _sides(data, "place1", "place2")
    gaps = "place_gap" in data
    sheet = Sheet([map_row(lying(size))], columns=2 if gaps else 1)
    heights, s = data["place_height"], default_step(data)
    height_panel(sheet.panel(0, 0, MAP), heights.values * 1e6, size, f"place {heights.attrs['place']}: height [µm]")
    if gaps:
        title = f"gap [µm] at {data['name'].values[s]}; grey: contact"
        _gap_panel(sheet.panel(0, 1, MAP), data["place_gap"].values[s], size, title)
    return sheet.figure


def face_size(data: xarray.Dataset) -> tuple[float, float]:
    """Sides of the face [mm]."""
    return _sides(data, "face1", "face2")


def _sides(data: xarray.Dataset, *blocks: str) -> tuple[float, float]:
    """Sides [mm] of what blocks cover, by their two coordinates."""
    one, two = (float(data[name][0] + data[name][-1]) * 1e3 for name in blocks)
    return one, two


def face_leakage(data: xarray.Dataset) -> Array:
    """Leakage at every step of the study whose maps these are: deterministic, else two scales, else drawn seals."""
    names = ("leakage_deterministic", "leakage_two_scale", "leakage_median")
    return np.asarray(data[next(name for name in names if name in data)].values)


def _face_map(axes: Axes, data: xarray.Dataset, s: int, name: str) -> None:
    """Map of a field of the face in blocks at a step."""
    values, size = data[f"face_{name}"].values[s], face_size(data)
    positive = np.where(values > 0, values, np.nan)
    if name == "fluid_pressure":
        flows = "" if face_leakage(data)[s] != 0 else ", no flow"
        title = f"fluid pressure [MPa]{flows}; white: contact, pockets"
        map_panel(axes, values / 1e6, size, with_closed("cividis", POCKET), title)
    elif name == "contact_pressure":
        map_panel(axes, positive / 1e6, size, with_closed("viridis"), "contact pressure [MPa]; grey: no contact")
    else:
        _gap_panel(axes, values, size)


def _gap_panel(axes: Axes, gap: Array, size: tuple[float, float], title: str = "gap [µm]; grey: contact") -> None:
    """Map of a gap [m]."""
    map_panel(axes, np.where(gap > 0, gap, np.nan) * 1e6, size, with_closed("magma"), title, vmin=0)


def fraction_panel(axes: Axes, data: xarray.Dataset, s: int) -> None:
    """Fraction of the pressure drop in each piece at a step."""
    values = 100 * data["piece_drop_fraction"].values[s]
    title = "pressure drop in pieces [%]" + ("" if np.isfinite(values).any() else ", no flow")
    map_panel(axes, values, face_size(data), with_closed("magma", POCKET), title, vmin=0)


def drop_panel(axes: Axes, data: xarray.Dataset, steps: Sequence[int]) -> None:
    """Fluid pressure along the leakage, mean over the seal's length, and its range at the last step."""
    names = load_names(data)
    for s, (colour, line, marker) in zip(steps, STYLES, strict=False):
        x1, p = pressure_rows(data, s)
        points = marker if len(x1) < 40 else ""
        axes.plot(x1 * 1e3, p.mean(axis=1) / 1e6, color=colour, ls=line, marker=points, ms=4.5, label=names[s])
        if s == steps[-1]:
            low, high = p.min(axis=1) / 1e6, p.max(axis=1) / 1e6
            axes.fill_between(x1 * 1e3, low, high, color=colour, alpha=0.15, lw=0, label="lowest to highest there")
    axes.set(xlabel="x1, inlet at 0 [mm]", ylabel="fluid pressure [MPa]")
    axes.grid(alpha=0.25, lw=0.6)
    axes.legend(fontsize=8, framealpha=0.9)


def row_panel(axes: Axes, data: xarray.Dataset, steps: Sequence[int]) -> None:
    """Mean contact pressure of the rows of the face along the leakage: the band on which a seat touches."""
    names = load_names(data)
    for s, (colour, line, _) in zip(steps, STYLES, strict=False):
        x1 = data["row"].values * 1e3
        axes.plot(x1, data["row_pressure"].values[s] / 1e6, color=colour, ls=line, lw=1.2, label=names[s])
    highest = float(np.nanmax(data["row_pressure"].values[list(steps)])) / 1e6
    axes.set(xlabel="x1, inlet at 0 [mm]", ylabel="mean contact pressure of rows [MPa]")
    if highest > 0:
        axes.set_ylim(-0.03 * highest, 1.35 * highest)  # with room for the legend
    axes.grid(alpha=0.25, lw=0.6)
    axes.legend(fontsize=8, framealpha=0.9)


def pressure_rows(data: xarray.Dataset, s: int) -> tuple[Array, Any]:
    """x1 [m] and fluid pressure [Pa] (rows, columns) of the blocks of the face, masked where undefined."""
    return data["block1"].values, np.ma.masked_invalid(data["face_fluid_pressure"].values[s].astype(float))


def permeability_panel(axes: Axes, data: xarray.Dataset, s: int) -> None:
    """Permeability of the pieces along x1 at a step, log scale."""
    from matplotlib import colormaps

    k = data["piece_k1"].values[s]
    shown, scale = on_decades(k, _DECADES)
    label = "permeability of pieces along x1 [m³]; grey: closed" + ("; white: failed" if np.isnan(k).any() else "")
    colours = colormaps["viridis"].with_extremes(under=CLOSED)
    map_panel(axes, shown, face_size(data), colours, label, norm=scale)


@shows(Contact)
def contact_figure(contact: Contact) -> Figure:
    """Maps of contact pressure and gap; grey: no contact, contact."""
    l1, l2 = (n * d * 1e3 for n, d in zip(contact.gap.shape, contact.half_space.spacing, strict=True))
    figure = new_figure(11.0, map_height(lying((l1, l2)), 4.4) + 0.9)
    left, right = figure.subplots(1, 2)
    pressure, gap = (np.where(a > 0, a, np.nan) for a in (contact.pressure / 1e6, contact.gap * 1e6))
    map_panel(left, pressure, (l1, l2), with_closed("viridis"), "contact pressure [MPa]; grey: no contact")
    map_panel(right, gap, (l1, l2), with_closed("magma"), "gap [µm]; grey: contact")
    return figure


@shows(LoadState)
def state_figure(state: LoadState) -> Figure:
    """Maps of contact pressure and gap at a step of a cycle."""
    figure = contact_figure(state.contact)
    figure.suptitle(state.name, fontsize=11)
    return figure


@shows(LoadCycle)
def cycle_figure(cycle: LoadCycle) -> Figure:
    """Fraction in contact and mean gap against nominal pressure."""
    figure = new_figure(9.6, 4.0)
    left, right = figure.subplots(1, 2)
    _cycle_panel(left, cycle, np.array([100 * s.contact.area_fraction for s in cycle]), "fraction in contact [%]")
    _cycle_panel(right, cycle, np.array([s.contact.mean_gap * 1e6 for s in cycle]), "mean gap [µm]")
    left.legend(fontsize=8.5, frameon=False)
    return figure


def _cycle_panel(axes: Axes, steps: Sequence[Any], values: NDArray[np.float64], label: str) -> None:
    """Values at the steps of a cycle against nominal pressure, a curve for each branch."""
    pressure, peaks = pressures_and_peaks(steps)
    parts = branches(pressure, peaks)
    for (name, chosen), (colour, line, marker) in zip(parts, branch_styles(len(parts)), strict=True):
        axes.plot(pressure[chosen] / 1e6, values[chosen], color=colour, ls=line, marker=marker, ms=4.5, label=name)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=label)
    axes.grid(alpha=0.25, lw=0.6)


@shows(Permeability)
def permeability_figure(permeability: Permeability, ax: Axes | None = None) -> Figure:
    """Map of the fluid pressure in a cell for a unit drop."""
    n1, n2 = permeability.fluid_pressure.shape
    figure, axes = one_panel(ax, 6.0, map_height(lying((n1, n2)), 4.6) + 0.9)
    title = "fluid pressure for a unit drop; white: contact, pockets"
    map_panel(axes, permeability.fluid_pressure, (n1, n2), with_closed("cividis", POCKET), title, "pixels")
    return figure


@shows(Leakage)
def seal_leakage_figure(leakage: Leakage, ax: Axes | None = None) -> Figure:
    """Map of the fluid pressure at the nodes of a structured seal.

    Raises InputError: the leakage of a mesh, whose nodes have no rows.
    """
    if leakage.fluid_pressure.ndim != 2:
        given = f"the leakage of a mesh, with {leakage.fluid_pressure.size} nodes"
        raise InputError("plot", given, "that of a seal with rows of nodes, rectangular or annular")
    n1, n2 = leakage.fluid_pressure.shape
    figure, axes = one_panel(ax, 6.4, map_height(lying((n1, n2)), 4.8) + 0.9)
    title = "fluid pressure [MPa]; white: pockets"
    map_panel(axes, leakage.fluid_pressure / 1e6, (n1, n2), with_closed("cividis", POCKET), title, "nodes")
    return figure
