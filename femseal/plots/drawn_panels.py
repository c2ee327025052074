"""Maps of a drawn seal in its plane, of the realisation nearest to the median: pressures, and where it leaks."""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags
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


class DrawnSeal:
    """Corners (parts, corners, 2) of the parts of a drawn seal, and the ends of each (parts, 2) [mm].

    strip : whether it is a straight seal; lies : a high one, with x2 to the right. detail : around the largest flow at
    a step. all : the seal. whole : the same, or its detail where it is too fine. Each is a lower left and an upper
    right corner.
    """

    def __init__(self, data: xarray.Dataset, s: int) -> None:
        self.corners = data["drawn_corners"].values * 1e3
        sides = np.ptp(self.corners, axis=(0, 1)).tolist()
        self.strip = data.attrs["seal"].startswith("a strip")
        self.lies = lying(sides) != tuple(sides)
        if self.lies:
            self.corners = self.corners[..., ::-1]
        self.low, self.high = self.corners.min(axis=1), self.corners.max(axis=1)
        low, high = self.all = self.low.min(axis=0), self.high.max(axis=0)
        side = _DETAIL * data.attrs["seal_size_m"][0] * 1e3
        flux = np.nan_to_num(np.hypot(*data["drawn_flux"].values[s].T))
        place = self.corners[np.argmax(flux)].mean(axis=0)
        start = np.maximum(low, np.minimum(place - side / 2, high - side))
        self.detail = start, np.minimum(start + side, high)
        self.whole = self.all if len(self.corners) <= _MOST else self.detail

    def seen(self, low: Array, high: Array) -> Flags:
        """Parts that lie between two corners, if only with a corner of theirs."""
        return ((self.high >= low) & (self.low <= high)).all(axis=1)  # type: ignore[no-any-return]


def drawn_figure(data: xarray.Dataset, s: int) -> Figure:
    """Fluid pressure in the whole seal, and the flow around its largest.

    Where the load has a map, or the seal a form, also the contact pressure of the tiles, the form, and the gap that it
    leaves. A long seal is shown without its proportions.
    """
    seal = DrawnSeal(data, s)
    panels = [(seal.whole, draw) for draw in _whole_panels(data, s)]
    flow = np.nan_to_num(np.hypot(*data["drawn_flux"].values[s].T))
    factor, unit = leakage_unit(flow.max()) if flow.max() > 0 else (1.0, "m²/s")
    around = "" if np.array_equal(seal.detail, seal.all) else " around the largest"
    title = f"flow per width [{unit}]{around}"
    panels.append((seal.detail, partial(_draw, title, flow / factor, "magma", decades=_DECADES)))
    number, drawn = (data["drawn_corners"].attrs[name] for name in ("realisation", "part"))
    sizes = [tuple((high - low).tolist()) for (low, high), _ in panels]
    sheet = Sheet([map_row(size) for size in sizes], head=0.3 if drawn == 1 else 0.5)
    names = (
        ["x1, inlet at 0 [mm]", "x2 along the seal [mm]"] if seal.strip else ["x [mm]", "y [mm]"]
    )
    for n, ((low, high), draw) in enumerate(panels):
        axes, (width, height) = sheet.panel(n, MAP), sizes[n]
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set_aspect("equal" if width <= _LONGEST * height else "auto")
        name_sides(axes, names[::-1] if seal.lies else names)
        seen = seal.seen(low, high)
        draw(axes, seal.corners[seen], seen)
    part = f"\n{100 * drawn:.2g} % of its length is shown, the rest is alike" if drawn < 1 else ""
    sheet.head(f"{load_names(data)[s]}; drawn seal {number}, the nearest to the median{part}")
    return sheet.figure


def _whole_panels(data: xarray.Dataset, s: int) -> list[partial[None]]:
    """What draws each map of the whole seal, see `_draw`: the contact pressure where it follows a map or a form."""
    found = []
    has_map = json.loads(data.attrs.get("case", "{}")).get("load", {}).get("map")
    if "drawn_contact_pressure" in data and (has_map or "drawn_form" in data):
        pressure = data["drawn_contact_pressure"].values[s] / 1e6
        found.append(partial(_draw, "contact pressure [MPa]", pressure, "viridis"))
    fluid = data["drawn_fluid_pressure"].values[s] / 1e6
    found.append(partial(_draw, "fluid pressure [MPa]", fluid, "cividis", bad="pockets"))
    if "drawn_form" in data:
        form, apart = data["drawn_form"].values * 1e6, data["drawn_separation"].values[s] * 1e6
        found.append(partial(_draw, "form of the seal [µm]", form, "cividis"))
        found.append(partial(_draw, "distance of mean planes [µm]", apart, "viridis"))
    return found


def _draw(
    title: str,
    values: Array,
    colours: str,
    axes: Axes,
    corners: Array,
    seen: Flags,
    *,
    decades: int = 0,
    bad: str = "failed",
) -> None:
    """Map of values of the parts (parts,), in the colours of all of them, of those that are seen.

    decades : of a logarithmic scale at most; 0: a linear one. bad : what parts without a value are.
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
    look: dict[str, Any] = {
        "norm": norm,
        "rasterized": True,
        "edgecolors": "face",
        "linewidths": 0.1,
    }
    look["cmap"] = colormaps[colours].with_extremes(under=CLOSED, bad=POCKET)
    parts = PolyCollection(corners, array=np.ma.masked_invalid(values[seen]), **look)  # type: ignore[arg-type]
    axes.add_collection(parts, autolim=False)
    colour_bar(axes, parts)
    panel_title(axes, "; ".join(notes))
