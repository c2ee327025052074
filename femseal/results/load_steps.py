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

from ..base import Array, Indices, InputError, counted, to_si, to_text
from ..loads import LOAD_UNITS, LoadProgramme, LoadStep

if TYPE_CHECKING:
    import xarray


class LoadFormat(NamedTuple):
    """Format nominal pressures as text, as pressures or as forces, depending on which of them the case gives.

    Attributes
    ----------
    unit : unit of force; "" if the case gives pressures.
    per_pascal : force in this unit for a nominal pressure of 1 Pa; not used if `unit` is empty.
    digits : number of significant digits.
    """

    unit: str = ""
    per_pascal: float = 0.0
    digits: int = 4

    def short(self, pressure: float) -> str:
        """Format a nominal pressure [Pa] as text, such as "40 MPa" or, if the case gives forces, "2 kN"."""
        if not self.unit:
            return to_text(pressure, "Pa", self.digits)
        return f"{self.per_pascal * pressure:.{self.digits}g} {self.unit}"

    def full(self, pressure: float) -> str:
        """Format a nominal pressure [Pa] as text, in which a force is followed by the pressure: "2 kN (40 MPa)"."""
        if not self.unit:
            return self.short(pressure)
        return f"{self.short(pressure)} ({to_text(pressure, 'Pa', self.digits)})"

    @property
    def axis(self) -> tuple[str, float]:
        """Name of a load axis, and the factor that converts a nominal pressure [Pa] to the unit of the axis."""
        if not self.unit:
            return "nominal pressure [MPa]", 1e-6
        return f"force [{self.unit}]", self.per_pascal


#: Format for loads as nominal pressures.
AS_PRESSURES = LoadFormat()


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


def branches(
    pressures: Array, peaks: Array, loads: LoadFormat = AS_PRESSURES
) -> list[tuple[str, Indices]]:
    """Divide a load cycle into its branches: the loading branch, and an unloading branch for each peak.

    Parameters
    ----------
    pressures : nominal pressure of each step [Pa].
    peaks : highest nominal pressure before unloading for each step [Pa], NaN on loading.
    loads : format of the peaks in the names of the branches.

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
        result.append((branch_text(peak, loads.short), np.concatenate([at_peak, unloading])))
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


def branch_text(peak: float | None, text: Callable[[float], str] = AS_PRESSURES.short) -> str:
    """Return the name of a branch: "loading", or for example "unloading from 900 MPa".

    Parameters
    ----------
    peak : highest nominal pressure before unloading [Pa]; None or NaN on loading.
    text : function that converts a nominal pressure [Pa] to text.
    """
    if peak is None or np.isnan(peak):
        return "loading"
    return f"unloading from {text(peak)}"


def given_loads(data: xarray.Dataset) -> tuple[str, list[float]]:
    """Return the SI unit of the loads in the case ("Pa", "N" or "N/m"), and a list of loads in this unit.

    The list contains the loads on loading and the peaks. Without a case, the unit is "Pa", and the list is empty.
    """
    # a stored case contains pressures as numbers, and forces as texts with a unit; all its loads have the same unit
    table = json.loads(data.attrs.get("case", "{}")).get("load", {})
    loads = [*(table.get("loading") or ()), *(table.get("unload_from") or ())]
    for unit in LOAD_UNITS:
        values = [_load_in(unit, load) for load in loads]
        if values and not np.isnan(values).any():
            return unit, values
    return "Pa", []


def _load_in(unit: str, load: float | str) -> float:
    """Return a load of a stored case in an SI unit, or NaN if the load has another unit."""
    if not isinstance(load, str):
        return float(load) if unit == "Pa" else np.nan
    try:
        return to_si(load, unit)
    except InputError:
        return np.nan


def load_format(data: xarray.Dataset, digits: int = 4) -> LoadFormat:
    """Return the format in which the loads of a run are written: as pressures, or as forces if the case gives forces.

    Parameters
    ----------
    data : dataset of a run.
    digits : number of significant digits.
    """
    si_unit, loads = given_loads(data)
    if si_unit == "Pa":
        return LoadFormat(digits=digits)
    highest_force = max(loads)  # [N] or [N/m]
    unit = "N"
    factor = 1.0  # number in `unit` that corresponds to a force of 1 N or 1 N/m
    if si_unit == "N/m":
        unit = "N/mm"
        factor = 1e-3
    elif highest_force >= 1e3:
        unit = "kN"
        factor = 1e-3
    # the highest force causes the highest nominal pressure
    highest_pressure = data["nominal_pressure"].values.max()
    return LoadFormat(unit, factor * highest_force / highest_pressure, digits)


def load_names(data: xarray.Dataset) -> list[str]:
    """Return a string for every step with its branch and its load, such as "unloading 40 MPa from 300 MPa"."""
    text = load_format(data).full
    pressures = data["nominal_pressure"].values
    peaks = data["unloaded_from"].values
    names = []
    for pressure, peak in zip(pressures, peaks, strict=True):
        if np.isnan(peak):
            names.append(f"loading {text(pressure)}")
        else:
            names.append(f"unloading {text(pressure)} from {text(peak)}")
    return names
