"""Pictures of the report, each narrow enough for a phone, as data that the page carries itself."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..base.quantities import to_text
from ..plots.cell_curves import cell_curves_panel, cells_of, gap_panel, pressure_panel
from ..plots.drawing import map_height, new_figure, svg
from ..plots.leakage_curves import leakage_curves, leakage_panel
from ..plots.maps import contact_panel, default_step, drop_panel, fluid_panel, permeability_panel, seal_size
from ..results.tables import amount, leak_scale, leakage_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..results.results import Results

#: Width of a panel [inch] whose smallest letters are legible at 390 pixels.
_WIDTH, _HEIGHT = 5.4, 4.0


@dataclass(frozen=True)
class Picture:
    """A picture of the page: its data, its alternative text, and its caption."""

    uri: str
    alt: str
    caption: str


def leakage_picture(results: Results) -> Picture:
    """Leakage over load with its bands."""
    figure = new_figure(_WIDTH, 5.0)
    handles = leakage_panel(figure.add_subplot(), leakage_curves(results))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=8.5, handlelength=3.4)
    steps, leakage = results.steps, results.leakage.values
    unit, factor = leak_scale(results)
    peak = max(range(len(steps)), key=lambda s: steps[s].pressure)
    places = dict.fromkeys((0, peak, len(steps) - 1))
    texts = [f"{amount(leakage[s], factor)} at {steps[s].name}" for s in places]
    what = leakage_of(results).capitalize()
    alt = f"{what} in {unit.name} against nominal pressure: {', '.join(texts)}. See the table for all."
    caption = "Leakage against nominal pressure, one line and marker for each branch of the load cycle."
    if "leakage_lower_together" in results.dataset:
        caption += " Shaded: band of the realisations, and lighter that with the error of the finite library besides."
    return Picture(_uri(figure), alt, caption)


def cell_pictures(results: Results) -> list[Picture]:
    """Single cells over the cycle; permeability against mean gap, and against pressure."""
    cells = cells_of(results)
    shut = np.nanmean(cells.k[:, np.isnan(cells.peaks)][:, -1] == 0)
    count, top = len(cells.k), to_text(float(np.nanmax(cells.nominal)), "Pa")
    many = f"{count} {cells.origin}"
    panels: list[tuple[Callable[..., None], str, str]] = [
        (
            cell_curves_panel,
            f"Permeability of a few of {many} against nominal pressure; {shut:.0%} are closed at {top}.",
            f"Single cells over the cycle, in front of all {many}. At {top} {shut:.0%} of them are closed.",
        ),
        (
            gap_panel,
            f"Permeability of {many} against their mean gap, on loading and unloading, and that of parallel plates.",
            "Permeability against mean gap: wide cells follow the asymptote h̄³/12 of parallel plates, narrow ones fall "
            "below it and close.",
        ),
        (
            pressure_panel,
            f"Permeability of {many} against their contact pressure: loading in circles, unloading in squares.",
            "Permeability against contact pressure: unloading (squares) lies below loading (circles) because of the "
            "plastic deformation that the peak left.",
        ),
    ]
    return [_panel(partial(draw, cells=cells), alt, caption) for draw, alt, caption in panels]


def map_pictures(results: Results) -> tuple[str, list[Picture]]:
    """Name of the step of the maps, and maps of the windows there."""
    data = results.dataset
    s = default_step(data)
    height = map_height(seal_size(data), 4.4) + 0.95
    rows, columns = data.sizes["cell1"], data.sizes["cell2"]
    pressure, k = data["window_pressure"].values[s], data["k1"].values[s]
    fluid = data["fluid_pressure"].values[s]
    panels: list[tuple[Callable[..., None], str, str]] = [
        (
            fluid_panel,
            f"Map of the fluid pressure at {fluid.shape[0]} × {columns} nodes, {_range(fluid, 'Pa')}; arrows: flow.",
            "Fluid pressure at the nodes and the flow through the windows, from the inlet at x1 = 0.",
        ),
        (
            contact_panel,
            f"Map of the mean contact pressure of {rows} × {columns} windows, {_range(pressure, 'Pa')}.",
            "Contact pressure of the windows.",
        ),
        (
            permeability_panel,
            f"Map of the permeability of {rows} × {columns} windows, {_open_text(k)}.",
            f"Permeability of the windows along x1: {_open_text(k)}.",
        ),
    ]
    pictures = [_panel(partial(draw, data=data, s=s), alt, caption, height) for draw, alt, caption in panels]
    return str(data["name"].values[s]), pictures


def drop_picture(results: Results) -> Picture:
    """Fluid pressure along the leakage at the first load, half way, and at the highest that leaks."""
    data = results.dataset
    steps = drop_steps(data)
    names = [str(data["name"].values[s]) for s in steps]
    alt = f"Mean fluid pressure from inlet to outlet at {', '.join(names)}."
    caption = "Fluid pressure along the leakage, mean over the length of the seal; where it is steep the seal holds."
    return _panel(lambda axes: drop_panel(axes, data, steps), alt, caption)


def drop_steps(data: xarray.Dataset) -> list[int]:
    """Loading steps that leak: the first, the middle one, and that of the maps last."""
    last = default_step(data)
    loading = np.flatnonzero(np.isnan(data["unloaded_from"].values))
    leaking = loading[np.nan_to_num(data["leakage_two_scale"].values[loading]) != 0]
    return list(dict.fromkeys([*(int(leaking[n]) for n in (0, leaking.size // 2) if leaking.size), last]))


def _panel(draw: Callable[[Axes], None], alt: str, caption: str, height: float = _HEIGHT) -> Picture:
    figure = new_figure(_WIDTH, height, layout=None)
    draw(figure.add_axes((0.13, 0.13, 0.8, 0.8)))
    return Picture(_uri(figure), alt, caption)


def _uri(figure: Figure) -> str:
    """The figure as a data URI."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg(figure)).decode()


def _range(values: np.ndarray, unit: str) -> str:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "unknown"
    return f"{to_text(float(finite.min()), unit, 3)} to {to_text(float(finite.max()), unit, 3)}"


def _open_text(k: np.ndarray) -> str:
    positive = k[np.isfinite(k) & (k > 0)]
    if positive.size == 0:
        return "all closed"
    shut = f", {np.count_nonzero(k == 0)} of {k.size} closed" if (k == 0).any() else ""
    return f"{positive.min():.2g} to {positive.max():.2g} m³{shut}"
