"""The loads of a case in words: the steps, the forces that they come from, and the map of the pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.quantities import to_text
from ..results.selections import solved_steps
from ..results.tables import INTERPOLATED

if TYPE_CHECKING:
    import xarray


def load_sentences(data: xarray.Dataset, case: dict[str, Any]) -> list[str]:
    """The load steps, and the map of the pressure over the seal if there is one."""
    given = case.get("load", {})
    maps = given.get("map") or []
    return [_steps(data, given), *([_map(data, maps)] if maps else [])]


def _steps(data: xarray.Dataset, given: dict[str, Any]) -> str:
    pressure, peaks = data["nominal_pressure"].values, data["unloaded_from"].values
    up = pressure[np.isnan(peaks)]
    ends = " to ".join(to_text(float(p), "Pa") for p in dict.fromkeys((up.min(), up.max())))
    text = f"It is loaded in {up.size} {'step' if up.size == 1 else 'steps'}, {ends}"
    if isinstance(highest := (given.get("loading") or [0.0])[-1], str):  # pressures are numbers
        force, unit = highest.split()
        text += f" (a force of {to_text(float(force), unit)} at most)"
    if tops := [to_text(float(p), "Pa") for p in np.unique(peaks[~np.isnan(peaks)])]:
        down = to_text(float(pressure[~np.isnan(peaks)].min()), "Pa")
        text += f", and unloaded from {' and '.join(tops)} down to {down}"
    text += "."
    if (solved := solved_steps(data)).size < pressure.size:
        tolerance = f"{100 * given['interpolate']:.3g} %" if "interpolate" in given else "a tolerance"
        text += (
            f" {solved.size} of the {pressure.size} steps are solved; the others, marked {INTERPOLATED}, have no "
            f"fields, and their leakage is interpolated within {tolerance}."
        )
    return text


def _map(data: xarray.Dataset, maps: list[dict[str, Any]]) -> str:
    """Kinds of the maps, and the range of pressures at the highest load."""
    kinds = " and ".join(dict.fromkeys(_kind(one) for one in maps))
    changing = ", which changes with the load" if len(maps) > 1 else ""
    text = f"The contact pressure over the seal follows {kinds}{changing}"
    if "drawn_window_pressure" in data:
        s = int(data["nominal_pressure"].values.argmax())
        pressure = data["drawn_window_pressure"].values[s]
        ends = (to_text(float(p), "Pa", 3) for p in (np.nanmin(pressure), np.nanmax(pressure)))
        text += f": {' to '.join(ends)} at {data['name'].values[s]}"
    return text + "."


def _kind(one: dict[str, Any]) -> str:
    if one.get("kind") == "field":
        return f"the field in {one.get('path', 'a file')}"
    if one.get("kind") == "angle":
        periods = int(one.get("repeat", 1))
        return "a table around it" + (f", repeated {periods} times" if periods > 1 else "")
    return "a profile from inlet to outlet" if one.get("kind") == "profile" else "one value everywhere"
