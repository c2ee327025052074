"""Maps of a face from the means over blocks in a dataset: its heights, and the fields of a deterministic study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drawing import POCKET, map_panel, with_closed
from .height_map import height_panel

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


def face_size(data: xarray.Dataset) -> tuple[float, float]:
    """Sides of the face [m]."""
    sides = []
    for n in (1, 2):
        x = data[f"face{n}"].values
        sides.append(float(x[0] + x[-1]))
    return sides[0], sides[1]


def face_leakage(data: xarray.Dataset) -> Array:
    """Leakage at every step of the study whose maps these are: deterministic, else two scales."""
    name = "leakage_deterministic" if "leakage_deterministic" in data else "leakage_two_scale"
    return np.asarray(data[name].values)


def face_panel(axes: Axes, data: xarray.Dataset) -> None:
    """Heights of the face."""
    height_panel(axes, data["face_height"].values * 1e6, _size(data))
    axes.set_ylabel("x1, inlet at 0 [mm]")


def face_fluid_panel(axes: Axes, data: xarray.Dataset, s: int) -> None:
    """Fluid pressure at a step."""
    values = data["face_fluid_pressure"].values[s] / 1e6
    flows = "" if face_leakage(data)[s] != 0 else ", no flow"
    title = f"fluid pressure [MPa]{flows}; white: contact, pockets"
    map_panel(axes, values, _size(data), with_closed("cividis", POCKET), title)


def face_contact_panel(axes: Axes, data: xarray.Dataset, s: int) -> None:
    """Contact pressure at a step."""
    values = data["face_contact_pressure"].values[s] / 1e6
    title = "contact pressure [MPa]; grey: no contact"
    map_panel(axes, np.where(values > 0, values, np.nan), _size(data), with_closed("viridis"), title)


def face_gap_panel(axes: Axes, data: xarray.Dataset, s: int) -> None:
    """Gap at a step."""
    gap = data["face_gap"].values[s] * 1e6
    shown = np.where(gap > 0, gap, np.nan)
    map_panel(axes, shown, _size(data), with_closed("magma"), "gap [µm]; grey: contact", vmin=0)


def _size(data: xarray.Dataset) -> tuple[float, float]:
    l1, l2 = face_size(data)
    return l1 * 1e3, l2 * 1e3
