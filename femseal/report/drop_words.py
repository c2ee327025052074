"""Sentences of the report on where the pressure drops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base.quantities import to_text
from ..plots.maps import default_step, face_leakage, pressure_rows

if TYPE_CHECKING:
    from ..results.results import Results


def pressure_drop_sentences(results: Results) -> list[str]:
    """Place of the pressure drop at the step of the maps: its row, and the number of windows that carry most of it."""
    data = results.dataset
    if "k1" not in data:
        return [_steepest_tenth(results)]
    s = default_step(data)
    p, flux = data["fluid_pressure"].values[s], np.nan_to_num(data["flux1"].values[s])
    name, whole = str(data["name"].values[s]), float(data.attrs["inlet_pressure_Pa"] - data.attrs["outlet_pressure_Pa"])
    if not np.abs(flux).max() > 0 or whole == 0:
        return [f"At {name} nothing flows."]
    drops = -np.diff(np.ma.masked_invalid(p).mean(axis=1).filled(np.nan)) / whole
    row = int(np.nanargmax(drops))
    ends = (to_text(float(x), "m", 3) for x in data["node1"].values[row : row + 2])
    sentences = [f"At {name} {drops[row]:.0%} of the pressure drops between x1 = {' and '.join(ends)}."]
    power = np.sort(np.nan_to_num(np.abs(flux * np.diff(p, axis=0))).ravel())[::-1]
    half = int(np.searchsorted(np.cumsum(power), 0.5 * power.sum()) + 1)
    sentences.append(
        f"Half of the power that the flow loses along x1 is lost in {half} of {power.size} windows"
        + (": few constrictions hold the seal." if half <= 0.05 * power.size else ".")
    )
    return sentences


def _steepest_tenth(results: Results) -> str:
    """Where most of the pressure drops over the face: the tenth of its width with the largest drop."""
    data = results.dataset
    s = default_step(data)
    name = str(data["name"].values[s])
    if np.nan_to_num(face_leakage(data)[s]) == 0:
        return f"At {name} nothing flows."
    x1, pressure = pressure_rows(data, s)
    inlet, outlet = (float(data.attrs[f"{end}_pressure_Pa"]) for end in ("inlet", "outlet"))
    p = np.r_[inlet, pressure.mean(axis=1).filled(np.nan), outlet]
    edge = np.r_[0.0, x1, x1[0] + x1[-1]]
    starts = np.linspace(0, 0.9 * edge[-1], 91)
    known = np.isfinite(p)
    ends = (np.interp(place, edge[known], p[known]) for place in (starts, starts + 0.1 * edge[-1]))
    drops = np.subtract(*ends) / (inlet - outlet)
    first = float(starts[int(np.argmax(drops))])
    span = " and ".join(to_text(place, "m", 3) for place in (first, first + 0.1 * float(edge[-1])))
    return f"At {name} {drops.max():.0%} of the pressure drops over a tenth of the width, between x1 = {span}."
