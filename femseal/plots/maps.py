"""Maps of the face: its fields in blocks, and where the pressure drops; of a drawn seal in its plane.

The drawn seal is the realisation nearest to the median. Also single solutions: a contact, a load cycle, the flow in a
cell, the leakage of a seal.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags, InputError, Pair
from ..base.leak_units import leakage_unit
from ..contact import Contact, LoadCycle, LoadState
from ..flow import Permeability
from ..results.results import Results, branches, load_names
from ..results.variables import pressures_and_peaks
from ..seal import Leakage
from .drawing import (
    CLOSED,
    GREY,
    MAP,
    POCKET,
    STYLES,
    Sheet,
    branch_styles,
    colour_bar,
    lying,
    map_height,
    map_panel,
    map_row,
    name_sides,
    new_figure,
    on_decades,
    panel_title,
    root_of,
    shows,
    with_closed,
)
from .heights import height_panel

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Flows shown in colour: so many decades below the largest.
_DECADES = 4
#: Side of the detail in breadths of the seal, and largest ratio of the sides of a seal that keeps its proportions.
_DETAIL, _LONGEST = 2.5, 8.0


def default_step(data: xarray.Dataset) -> int:
    """The step of the highest load at which the face leaks, or else the drawn seals; the first step if none does."""
    leaking = np.flatnonzero(np.nan_to_num(face_leakage(data)))
    return int(leaking[np.argmax(data["nominal_pressure"].values[leaking])]) if leaking.size else 0


def seal_figure(results: Results, step: int | None = None) -> Figure:
    """Maps of the face at one step: contact pressure, gap and fluid pressure in blocks, and the fall of the pressure.

    Without fields over the face: of the drawn seal that is nearest to the median.

    step : index of the load step; the highest load that still leaks unless given.

    Raises InputError: results without fields over the face, or no such step.
    """
    data = results.dataset
    if "face_gap" not in data and "drawn_corners" not in data:
        expected = "those of a two-scale or a deterministic study, or with a drawn seal"
        raise InputError("seal figure", "results without maps", expected)
    s = default_step(data) if step is None else step
    if not 0 <= s < data.sizes["step"]:
        raise InputError("step", step, f"0 to {data.sizes['step'] - 1}")
    if "face_gap" not in data:
        return drawn_figure(data, s)
    size = sides(data)
    row = map_row(lying(size))
    sheet = Sheet([row, row, row, 2.4], head=0.35)
    contact, gap, fluid = (
        data[f"face_{name}"].values[s] for name in ("contact_pressure", "gap", "fluid_pressure")
    )
    _contact_panel(sheet.panel(0, MAP), contact, size, "\n")
    _gap_panel(sheet.panel(1, MAP), gap, size, "gap [µm]\ngrey: contact")
    flows = "" if face_leakage(data)[s] != 0 else ", no flow"
    title = f"fluid pressure [MPa]{flows}\nwhite: contact, pockets"
    map_panel(sheet.panel(2, MAP), fluid / 1e6, size, with_closed("cividis", POCKET), title)
    drop_panel(sheet.panel(3, MAP), data, drop_steps(data, s))
    sheet.head(f"{load_names(data)[s]}; inlet at x1 = 0")
    return sheet.figure


def drop_steps(data: xarray.Dataset, last: int) -> list[int]:
    """Loading steps that leak: the first, the middle one, and that of the maps last."""
    loading = np.flatnonzero(np.isnan(data["unloaded_from"].values))
    leaking = loading[np.nan_to_num(face_leakage(data)[loading]) != 0]
    chosen = [leaking[n] for n in (0, leaking.size // 2) if leaking.size]
    return list(dict.fromkeys([*chosen, last]))


def place_figure(data: xarray.Dataset) -> Figure:
    """Heights of the measured place that leaks most, and its gap at the highest load that leaks where it is known."""
    size = sides(data, "place")
    gaps = "place_gap" in data
    sheet = Sheet([map_row(lying(size))] * (1 + gaps))
    heights, s = data["place_height"], default_step(data)
    title = f"place {heights.attrs['place']}: height [µm]"
    height_panel(sheet.panel(0, MAP), heights.values * 1e6, size, title)
    if gaps:
        title = f"gap [µm] at {load_names(data)[s]}; grey: contact"
        _gap_panel(sheet.panel(1, MAP), data["place_gap"].values[s], size, title)
    return sheet.figure


def sides(data: xarray.Dataset, of: str = "face") -> Pair:
    """Sides of the face [mm], or of a measured place, by the coordinates of its blocks."""
    one, two = (float(data[f"{of}{n}"][[0, -1]].sum()) * 1e3 for n in (1, 2))
    return one, two


def face_leakage(data: xarray.Dataset) -> Array:
    """Leakage at every step of the face, by its own pixels, else by blocks, else of the drawn seals."""
    names = ("leakage_two_scale", "leakage_deterministic", "leakage_blocks", "leakage_median")
    return np.asarray(data[next(name for name in names if name in data)].values)


def _contact_panel(axes: Axes, pressure: Array, size: Pair, joint: str) -> None:
    """Map of a contact pressure [Pa]; `joint` before what is grey."""
    shown = np.where(pressure > 0, pressure, np.nan) / 1e6
    title = f"contact pressure [MPa]{joint}grey: no contact"
    map_panel(axes, shown, size, with_closed("viridis"), title)


def _gap_panel(axes: Axes, gap: Array, size: Pair, title: str) -> None:
    """Map of a gap [m]."""
    map_panel(axes, np.where(gap > 0, gap, np.nan) * 1e6, size, with_closed("magma"), title, vmin=0)


def drop_panel(axes: Axes, data: xarray.Dataset, steps: Sequence[int]) -> None:
    """Fluid pressure along the leakage, mean over the seal's length, and its range at the last step."""
    pressure = np.ma.masked_invalid(data["face_fluid_pressure"].values.astype(float)) / 1e6
    x1, p = data["block1"].values, pressure[steps[-1]]
    means = {s: pressure[s].mean(axis=1) for s in steps}
    _lines_over_x1(axes, data, x1, means, "fluid pressure [MPa]")
    ends = p.min(axis=1), p.max(axis=1)
    axes.fill_between(x1 * 1e3, *ends, color=GREY, alpha=0.15, lw=0, label="lowest to highest")
    axes.legend(fontsize=8, framealpha=0.9)


def row_panel(axes: Axes, data: xarray.Dataset, steps: Sequence[int]) -> None:
    """Mean contact pressure of the rows of the face along the leakage: the band on which a seat touches."""
    rows = {s: data["row_pressure"].values[s] / 1e6 for s in steps}
    _lines_over_x1(axes, data, data["row"].values, rows, "mean contact pressure of rows [MPa]")
    axes.legend(fontsize=8, framealpha=0.9)


def _lines_over_x1(
    axes: Axes, data: xarray.Dataset, x1: Array, values: dict[int, Array], name: str
) -> None:
    """A line of pressures [MPa] for each step."""
    names = load_names(data)
    for (s, p), style in zip(values.items(), STYLES, strict=False):
        axes.plot(x1 * 1e3, p, lw=1.4, label=names[s], **style)
    name_sides(axes, ("x1, inlet at 0 [mm]", name))
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25, lw=0.6)


@shows(Contact)
def contact_figure(contact: Contact) -> Figure:
    """Maps of contact pressure and gap; grey: no contact, contact."""
    l1, l2 = (
        n * d * 1e3 for n, d in zip(contact.gap.shape, contact.half_space.spacing, strict=True)
    )
    figure = new_figure(11.0, map_height(lying((l1, l2)), 4.4) + 0.9)
    left, right = figure.subplots(1, 2)
    _contact_panel(left, contact.pressure, (l1, l2), "; ")
    _gap_panel(right, contact.gap, (l1, l2), "gap [µm]; grey: contact")
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
    panels = figure.subplots(1, 2)
    quantities = {
        "fraction in contact [%]": [100 * s.contact.area_fraction for s in cycle],
        "mean gap [µm]": [s.contact.mean_gap * 1e6 for s in cycle],
    }
    pressure, peaks = pressures_and_peaks(cycle)
    parts = branches(pressure, peaks)
    for axes, (label, values) in zip(panels, quantities.items(), strict=True):
        for (name, steps), look in zip(parts, branch_styles(len(parts)), strict=True):
            axes.plot(pressure[steps] / 1e6, np.array(values)[steps], label=name, **look)
        axes.set(xlabel="nominal pressure [MPa]", ylabel=label)
        axes.grid(alpha=0.25, lw=0.6)
    panels[0].legend(fontsize=8.5, frameon=False)
    return figure


@shows(Permeability)
def permeability_figure(permeability: Permeability, ax: Axes | None = None) -> Figure:
    """Map of the fluid pressure in a cell for a unit drop."""
    title = "fluid pressure for a unit drop; white: contact, pockets"
    return _pressure_figure(permeability.fluid_pressure, ax, title, "pixels")


@shows(Leakage)
def seal_leakage_figure(leakage: Leakage, ax: Axes | None = None) -> Figure:
    """Map of the fluid pressure at the nodes of a structured seal.

    Raises InputError: the leakage of a mesh, whose nodes have no rows.
    """
    if leakage.fluid_pressure.ndim != 2:
        given = f"the leakage of a mesh, with {leakage.fluid_pressure.size} nodes"
        raise InputError("plot", given, "that of a seal with rows of nodes, rectangular or annular")
    title = "fluid pressure [MPa]; white: pockets"
    return _pressure_figure(leakage.fluid_pressure / 1e6, ax, title, "nodes")


def _pressure_figure(values: Array, ax: Axes | None, title: str, unit: str) -> Figure:
    """Map of a fluid pressure (n1, n2)."""
    n1, n2 = values.shape
    if ax is None:
        ax = new_figure(6.2, map_height(lying((n1, n2)), 4.6) + 0.9).add_subplot()
    map_panel(ax, values, (n1, n2), with_closed("cividis", POCKET), title, unit)
    return root_of(ax)


def drawn_figure(data: xarray.Dataset, s: int) -> Figure:
    """Fluid pressure in the whole seal, and the flow around its largest.

    Where the load has a map, or the seal a form, also the contact pressure of the tiles, the form, and the gap that it
    leaves. A long seal is shown without its proportions, a high one lies, with x2 to the right.
    """
    corners = data["drawn_corners"].values * 1e3
    size = tuple(np.ptp(corners, axis=(0, 1)).tolist())
    if lies := lying(size) != size:
        corners = corners[..., ::-1]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    flow = np.nan_to_num(np.hypot(*data["drawn_flux"].values[s].T))
    side = _DETAIL * data.attrs["seal_size_m"][0] * 1e3
    start = np.minimum(corners[np.argmax(flow)].mean(axis=0) - side / 2, high - side)
    start = np.maximum(low, start)
    end = np.minimum(start + side, high)
    factor, unit = leakage_unit(flow.max()) if flow.max() > 0 else (1.0, "m²/s")
    around = "" if np.array_equal([start, end], [low, high]) else " around the largest"
    panels: list[tuple[Any, ...]] = [(low, high, *panel) for panel in _whole_panels(data, s)]
    title = f"flow per width [{unit}]{around}"
    panels.append((start, end, title, flow / factor, "magma", "failed", _DECADES))
    number, drawn = (data["drawn_corners"].attrs[name] for name in ("realisation", "part"))
    sizes = [tuple((high - low).tolist()) for low, high, *_ in panels]
    sheet = Sheet([map_row(size) for size in sizes], head=0.3 if drawn == 1 else 0.5)
    names = ["x [mm]", "y [mm]"]
    if data.attrs["seal"].startswith("a strip"):
        names = ["x1, inlet at 0 [mm]", "x2 along the seal [mm]"]
    for n, (low, high, *panel) in enumerate(panels):
        axes, (width, height) = sheet.panel(n, MAP), sizes[n]
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_aspect("equal" if width <= _LONGEST * height else "auto")
        name_sides(axes, names[::-1] if lies else names)
        # parts that lie between the ends, if only with a corner of theirs
        seen = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
        _draw(axes, corners[seen], seen, *panel)
    part = f"\n{100 * drawn:.2g} % of its length is shown, the rest is alike" if drawn < 1 else ""
    sheet.head(f"{load_names(data)[s]}; drawn seal {number}, the nearest to the median{part}")
    return sheet.figure


def _whole_panels(data: xarray.Dataset, s: int) -> list[tuple[Any, ...]]:
    """Title, values and colours of each map of the whole seal, and what parts without a value are, see `_draw`."""
    fields = {
        name: data[f"drawn_{name}"].values
        for name in ("contact_pressure", "fluid_pressure", "form", "separation")
        if f"drawn_{name}" in data
    }
    found: list[tuple[Any, ...]] = []
    has_map = json.loads(data.attrs.get("case", "{}")).get("load", {}).get("map")
    if "contact_pressure" in fields and (has_map or "form" in fields):
        found.append(("contact pressure [MPa]", fields["contact_pressure"][s] / 1e6, "viridis"))
    found.append(("fluid pressure [MPa]", fields["fluid_pressure"][s] / 1e6, "cividis", "pockets"))
    if "form" in fields:
        found.append(("form of the seal [µm]", fields["form"] * 1e6, "cividis"))
        apart = fields["separation"][s] * 1e6
        found.append(("distance of mean planes [µm]", apart, "viridis"))
    return found


def _draw(
    axes: Axes,
    corners: Array,
    seen: Flags,
    title: str,
    values: Array,
    colours: str,
    bad: str = "failed",
    decades: int = 0,
) -> None:
    """Map of values of the parts (parts,), in the colours of all of them, of those that are seen.

    bad : what parts without a value are. decades : of a logarithmic scale at most; 0: a linear one.
    """
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    finite = values[np.isfinite(values)]
    notes = [title, *([f"white: {bad}"] if finite.size < values.size else [])]
    norm: Any = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0, 1)
    if decades:
        values, norm = on_decades(values, decades)
        notes += ["grey: none"] if (finite == 0).any() else []
    parts = PolyCollection(
        corners,  # type: ignore[arg-type]
        array=np.ma.masked_invalid(values[seen]),
        cmap=colormaps[colours].with_extremes(under=CLOSED, bad=POCKET),
        norm=norm,
        rasterized=True,
        edgecolors="face",
        linewidths=0.1,
    )
    axes.add_collection(parts, autolim=False)
    colour_bar(axes, parts)
    panel_title(axes, "; ".join(notes))
