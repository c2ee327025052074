"""Load steps of a dataset: their pressures and branches, and how texts name them.

A dataset has, for each load step, its nominal pressure and the peak from which it is unloaded, which is NaN on loading.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..base import Array, Indices, counted, to_text
from ..loads import LoadProgramme, LoadStep

if TYPE_CHECKING:
    import xarray


class ForceScale(NamedTuple):
    """Unit of the forces of a case, and the force in this unit at a nominal pressure of 1 Pa."""

    unit: str
    per_pascal: float


def load_programme(data: xarray.Dataset) -> LoadProgramme:
    """Return the load programme of a dataset."""
    pressures = data["nominal_pressure"].values.tolist()
    peaks = data["unloaded_from"].values.tolist()
    return LoadProgramme(
        LoadStep(pressure, None if np.isnan(peak) else peak)
        for pressure, peak in zip(pressures, peaks, strict=True)
    )


def pressures_and_peaks(steps: Sequence[LoadStep]) -> tuple[Array, Array]:
    """Return nominal pressures and peaks of load steps [Pa]; peaks are NaN on loading."""
    pressures = [step.pressure for step in steps]
    peaks = [np.nan if step.unloaded_from is None else step.unloaded_from for step in steps]
    return np.array(pressures, dtype=float), np.array(peaks, dtype=float)


def branches(pressures: Array, peaks: Array) -> list[tuple[str, Indices]]:
    """Return name and steps of the loading, and of the unloading from each peak, from the highest peak on.

    Parameters
    ----------
    pressures : nominal pressure of each step [Pa].
    peaks : peak from which each step is unloaded [Pa], NaN on loading.

    Returns
    -------
    The steps of an unloading begin with that of its peak, which belongs to the loading too.
    """
    loading = np.flatnonzero(np.isnan(peaks))
    result = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        at_peak = loading[pressures[loading] == peak]
        unloading = np.flatnonzero(peaks == peak)
        result.append((branch_text(peak), np.concatenate([at_peak, unloading])))
    return result


def branches_in(data: xarray.Dataset) -> list[tuple[str, Indices]]:
    """Return the branches of a dataset, see `branches`."""
    return branches(data["nominal_pressure"].values, data["unloaded_from"].values)


def cycle_text(steps: LoadProgramme) -> str:
    """Return how many steps a load programme has on loading, and how many on unloading from which peaks."""
    loading = len(steps.loading)
    text = f"{counted(len(steps), 'step')}: {loading} loading"
    if steps.unload_from:
        peaks = " and ".join(to_text(peak, "Pa", 3) for peak in steps.unload_from)
        text += f", {len(steps) - loading} unloading from {peaks}"
    return text


def _pressure_text(pressure: float) -> str:
    return to_text(pressure, "Pa")


def branch_text(peak: float | None, text: Callable[[float], str] = _pressure_text) -> str:
    """Return the name of a branch: "loading", or for example "unloading from 900 MPa".

    Parameters
    ----------
    peak : nominal pressure from which the seal is unloaded [Pa]; None or NaN on loading.
    text : converts a nominal pressure to text.
    """
    if peak is None or np.isnan(peak):
        return "loading"
    return f"unloading from {text(peak)}"


def force_scale(data: xarray.Dataset) -> ForceScale | None:
    """Return the scale of forces if the loads of the case are forces, None if they are pressures."""
    table = json.loads(data.attrs.get("case", "{}")).get("load", {})
    loads = [*(table.get("loading") or ()), *(table.get("unload_from") or ())]
    # a force is stored as text with its unit, a pressure as a number
    parts = [str(load).split() for load in loads]
    if not parts or len(parts[0]) < 2:
        return None
    highest = max(float(number) for number, _ in parts)
    unit, factor = "N", 1.0
    if parts[0][1] == "N/m":
        unit, factor = "N/mm", 1e-3
    elif highest >= 1e3:
        unit, factor = "kN", 1e-3
    return ForceScale(unit, factor * highest / data["nominal_pressure"].values.max())


def loads_as_given(data: xarray.Dataset, digits: int = 4) -> Callable[[float], str]:
    """Return a function that converts a nominal pressure [Pa] to text, with the force before it if the case has forces.

    Parameters
    ----------
    data : the dataset.
    digits : of the numbers.
    """
    scale = force_scale(data)

    def text(pressure: float) -> str:
        nominal = to_text(pressure, "Pa", digits)
        if scale is None:
            return nominal
        return f"{scale.per_pascal * pressure:.{digits}g} {scale.unit} ({nominal})"

    return text


def load_names(data: xarray.Dataset) -> list[str]:
    """Return branch and load of every step as text, see `loads_as_given`."""
    text = loads_as_given(data)
    names = []
    for pressure, peak in zip(
        data["nominal_pressure"].values, data["unloaded_from"].values, strict=True
    ):
        if np.isnan(peak):
            names.append(f"loading {text(pressure)}")
        else:
            names.append(f"unloading {text(pressure)} from {text(peak)}")
    return names
