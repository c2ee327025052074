"""Maps of a drawn seal in its plane, of the realisation nearest to the median: pressures, and where it leaks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags, Pair
from ..base.leak_rates import leakage_unit
from ..results.selections import load_names
from .drawing import (
    CLOSED,
    MAP,
    POCKET,
    Sheet,
    colour_bar,
    lying,
    map_row,
    name_sides,
    on_decades,
    panel_title,
)

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Flows shown in colour: so many decades below the largest.
_DECADES = 4
#: Side of the detail in breadths of the seal, and largest ratio of the sides of a seal that keeps its proportions.
_DETAIL, _LONGEST = 2.5, 8.0
#: Most parts that are shown as a whole.
_MOST = 200_000


@dataclass(frozen=True)
class _View:
    """A part of the plane, x to the right and y upwards: its lower left and its upper right corner [mm]."""

    low: Array
    high: Array

    @property
    def size(self) -> Pair:
        """Width and height [mm]."""
        width, height = self.high - self.low
        return float(width), float(height)

    def holds(self, seal: DrawnSeal) -> Flags:
        """Parts that lie in it, if only with a corner."""
        return np.asarray(((seal.high >= self.low) & (seal.low <= self.high)).all(axis=1))


class DrawnSeal:
    """Corners (parts, corners, 2) of the parts of a drawn seal, and the ends of each (parts, 2) [mm].

    strip : whether it is a straight seal; lies : a high one, with x2 to the right. detail : around the largest flow at
    a step. whole : the whole seal, or its detail where it is too fine.
    """

    def __init__(self, data: xarray.Dataset, s: int) -> None:
        self.corners = data["drawn_corners"].values * 1e3
        sides = np.ptp(self.corners, axis=(0, 1)).tolist()
        self.strip = str(data.attrs["seal"]).startswith("a strip")
        self.lies = lying(sides) != tuple(sides)
        if self.lies:
            self.corners = self.corners[..., ::-1]
        self.low, self.high = self.corners.min(axis=1), self.corners.max(axis=1)
        self.all = _View(self.low.min(axis=0), self.high.max(axis=0))
        self.detail = self._detail(data, s)
        self.whole = self.all if len(self.corners) <= _MOST else self.detail

    def _detail(self, data: xarray.Dataset, s: int) -> _View:
        """The surroundings of the largest flux."""
        side = _DETAIL * data.attrs["seal_size_m"][0] * 1e3
        flux = np.nan_to_num(np.hypot(*data["drawn_flux"].values[s].T))
        place = self.corners[np.argmax(flux)].mean(axis=0)
        start = np.maximum(self.all.low, np.minimum(place - side / 2, self.all.high - side))
        return _View(start, np.minimum(start + side, self.all.high))


def drawn_figure(data: xarray.Dataset, s: int) -> Figure:
    """Fluid pressure in the whole seal, and the flow around its largest.

    Where the load has a map, or the seal a form, also the contact pressure of the tiles, the form, and the gap that it
    leaves. A long seal is shown without its proportions.
    """
    seal, flux = DrawnSeal(data, s), data["drawn_flux"].values[s]
    panels = [(seal.whole, panel) for panel in _panels(data, s)]
    flow = np.nan_to_num(np.hypot(*flux.T))
    factor, unit = leakage_unit(flow.max()) if flow.max() > 0 else (1.0, "m²/s")
    around = "" if seal.detail.size == seal.all.size else " around the largest"
    title = f"flow per width [{unit}]{around}"
    panels.append((seal.detail, _Panel(title, flow / factor, "magma", _DECADES)))
    number, drawn = (data["drawn_corners"].attrs[name] for name in ("realisation", "part"))
    sheet = Sheet([map_row(view.size) for view, _ in panels], head=0.3 if drawn == 1 else 0.5)
    labels = (
        ["x1, inlet at 0 [mm]", "x2 along the seal [mm]"] if seal.strip else ["x [mm]", "y [mm]"]
    )
    for n, (view, panel) in enumerate(panels):
        axes = sheet.panel(n, MAP)
        width, height = view.size
        aspect: Any = "equal" if width <= _LONGEST * height else "auto"
        axes.set(xlim=(view.low[0], view.high[0]), ylim=(view.low[1], view.high[1]), aspect=aspect)
        name_sides(axes, labels[::-1] if seal.lies else labels)
        seen = view.holds(seal)
        panel.draw(axes, seal.corners[seen], seen)
    part = f"\n{100 * drawn:.2g} % of its length is shown, the rest is alike" if drawn < 1 else ""
    sheet.head(f"{load_names(data)[s]}; drawn seal {number}, the nearest to the median{part}")
    return sheet.figure


def _panels(data: xarray.Dataset, s: int) -> list[_Panel]:
    """What is shown of the whole seal."""
    found = []
    if _has_map(data):
        pressure = data["drawn_contact_pressure"].values[s] / 1e6
        found.append(_Panel("contact pressure [MPa]", pressure, "viridis"))
    fluid = data["drawn_fluid_pressure"].values[s] / 1e6
    found.append(_Panel("fluid pressure [MPa]", fluid, "cividis", bad="pockets"))
    if "drawn_form" in data:
        form, apart = data["drawn_form"].values * 1e6, data["drawn_separation"].values[s] * 1e6
        found.append(_Panel("form of the seal [µm]", form, "cividis"))
        found.append(_Panel("distance of mean planes [µm]", apart, "viridis"))
    return found


def _has_map(data: xarray.Dataset) -> bool:
    """Whether the contact pressure follows a map or a form of the seal, which the whole of it shows."""
    if "drawn_contact_pressure" not in data:
        return False
    given = json.loads(data.attrs.get("case", "{}")).get("load", {}).get("map")
    return "drawn_form" in data or bool(given)


@dataclass(frozen=True, eq=False)
class _Panel:
    """A map of values of the parts (parts,) on a linear scale, or on a logarithmic one of so many decades at most.

    bad : what parts without a value are.
    """

    title: str
    values: Array
    colours: str
    decades: int = 0
    bad: str = "failed"

    def draw(self, axes: Axes, corners: Array, seen: Flags) -> None:
        """Draw the parts that are seen, in the colours of all of them."""
        from matplotlib import colormaps
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import Normalize

        values, finite = self.values, self.values[np.isfinite(self.values)]
        notes = [f"white: {self.bad}"] if finite.size < values.size else []
        norm: Any
        if self.decades:
            values, norm = on_decades(values, self.decades)
            notes += ["grey: none"] if (finite == 0).any() else []
        else:
            norm = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0, 1)
        colours = colormaps[self.colours].with_extremes(under=CLOSED, bad=POCKET)
        each = np.ma.masked_invalid(values[seen])
        look: dict[str, Any] = {"cmap": colours, "norm": norm, "rasterized": True}
        look |= {"edgecolors": "face", "linewidths": 0.1}
        parts = PolyCollection(corners, array=each, **look)  # type: ignore[arg-type]
        axes.add_collection(parts, autolim=False)
        colour_bar(axes, parts)
        panel_title(axes, "; ".join([self.title, *notes]))
