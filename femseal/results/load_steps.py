"""Read the load steps of a dataset, and describe them in words.

A dataset has two variables that describe the load steps. The variable `nominal_pressure` is the nominal pressure of the
step. The variable `unloaded_from` is the highest nominal pressure before unloading, and NaN on loading. In the
functions of this module, the highest nominal pressure before unloading is called the peak.
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
    """Unit of the forces in a case, and the force in this unit for a nominal pressure of 1 Pa."""

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
    """Return the nominal pressure and the peak of each load step [Pa]; on loading, the peak is NaN."""
    pressures = [step.pressure for step in steps]
    peaks = [np.nan if step.unloaded_from is None else step.unloaded_from for step in steps]
    return np.array(pressures, dtype=float), np.array(peaks, dtype=float)


def branches(pressures: Array, peaks: Array) -> list[tuple[str, Indices]]:
    """Divide a load cycle into its branches: the loading branch, and an unloading branch for each peak.

    Parameters
    ----------
    pressures : nominal pressure of each step [Pa].
    peaks : highest nominal pressure before unloading for each step [Pa], NaN on loading.

    Returns
    -------
    Name and step indices of each branch: first the loading branch, then the unloading branches in descending order of
    their peaks. An unloading branch begins with the step on loading at which its peak is reached.
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
    """Describe a load programme in words, such as "5 steps: 3 loading, 2 unloading from 300 MPa"."""
    loading = len(steps.loading)
    text = f"{counted(len(steps), 'step')}: {loading} loading"
    if steps.unload_from:
        peaks = " and ".join(to_text(peak, "Pa", 3) for peak in steps.unload_from)
        text += f", {len(steps) - loading} unloading from {peaks}"
    return text


def _pressure_text(pressure: float) -> str:
    """Return a pressure as text with a unit."""
    return to_text(pressure, "Pa")


def branch_text(peak: float | None, text: Callable[[float], str] = _pressure_text) -> str:
    """Return the name of a branch: "loading", or for example "unloading from 900 MPa".

    Parameters
    ----------
    peak : highest nominal pressure before unloading [Pa]; None or NaN on loading.
    text : function that converts a nominal pressure [Pa] to text.
    """
    if peak is None or np.isnan(peak):
        return "loading"
    return f"unloading from {text(peak)}"


def force_scale(data: xarray.Dataset) -> ForceScale | None:
    """Return the scale that converts nominal pressures to forces, or None if the case gives its loads as pressures."""
    table = json.loads(data.attrs.get("case", "{}")).get("load", {})
    loads = [*(table.get("loading") or ()), *(table.get("unload_from") or ())]
    # A force is stored as text with its unit, such as "2000.0 N", and a pressure as a number. All loads of a case have
    # the same unit, N or N/m.
    words = [str(load).split() for load in loads]
    if not words or len(words[0]) < 2:
        return None
    highest_force = max(float(number) for number, _ in words)  # [N] or [N/m]
    si_unit = words[0][1]
    unit = "N"
    factor = 1.0  # value in `unit` of a force of 1 in SI
    if si_unit == "N/m":
        unit = "N/mm"
        factor = 1e-3
    elif highest_force >= 1e3:
        unit = "kN"
        factor = 1e-3
    # the highest force causes the highest nominal pressure
    highest_pressure = data["nominal_pressure"].values.max()
    return ForceScale(unit, factor * highest_force / highest_pressure)


def loads_as_given(data: xarray.Dataset, digits: int = 4) -> Callable[[float], str]:
    """Return a function that converts a nominal pressure [Pa] to text.

    If the case gives its loads as forces, the text begins with the force, for example "2 kN (40 MPa)".

    Parameters
    ----------
    data : dataset of a run.
    digits : number of significant digits.
    """
    scale = force_scale(data)

    def text(pressure: float) -> str:
        """Return a nominal pressure [Pa] as text, with the force if the case gives forces."""
        nominal = to_text(pressure, "Pa", digits)
        if scale is None:
            return nominal
        return f"{scale.per_pascal * pressure:.{digits}g} {scale.unit} ({nominal})"

    return text


def load_names(data: xarray.Dataset) -> list[str]:
    """Return a string for every step with its branch and its load, such as "unloading 40 MPa from 300 MPa"."""
    text = loads_as_given(data)
    pressures = data["nominal_pressure"].values
    peaks = data["unloaded_from"].values
    names = []
    for pressure, peak in zip(pressures, peaks, strict=True):
        if np.isnan(peak):
            names.append(f"loading {text(pressure)}")
        else:
            names.append(f"unloading {text(pressure)} from {text(peak)}")
    return names
