"""Parts of a dataset of results: branches of the load cycle, pieces."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Indices, InputError, Shape, to_text

if TYPE_CHECKING:
    import xarray


def pressure_text(p: float) -> str:
    """A nominal pressure [Pa] as text."""
    return to_text(p, "Pa")


def branch_text(unloaded_from: float | None, text: Callable[[float], str] = pressure_text) -> str:
    """Name of a branch: "loading", or "unloading from 900 MPa"; `unloaded_from` [Pa], NaN or None on loading."""
    if unloaded_from is None or np.isnan(unloaded_from):
        return "loading"
    return f"unloading from {text(unloaded_from)}"


def force_scale(data: xarray.Dataset) -> tuple[str, float] | None:
    """Unit of the forces of a case for people, and the force in it at a nominal pressure of 1 Pa; None of pressures."""
    table = json.loads(data.attrs.get("case", "{}")).get("load", {})
    loads = [
        str(load).split() for key in ("loading", "unload_from") for load in table.get(key) or ()
    ]
    if not loads or len(loads[0]) < 2:
        return None
    highest = max(float(number) for number, _ in loads)
    unit, factor = "N", 1.0
    if loads[0][1] == "N/m":
        unit, factor = "N/mm", 1e-3
    elif highest >= 1e3:
        unit, factor = "kN", 1e-3
    return unit, factor * highest / data["nominal_pressure"].values.max()


def loads_as_given(data: xarray.Dataset, digits: int = 4) -> Callable[[float], str]:
    """Nominal pressures [Pa] as text for people; forces of a case stand before them."""
    force = force_scale(data)

    def text(p: float) -> str:
        nominal = to_text(p, "Pa", digits)
        return f"{force[1] * p:.{digits}g} {force[0]} ({nominal})" if force else nominal

    return text


def load_names(data: xarray.Dataset) -> list[str]:
    """Branch and load of every step for people, see `loads_as_given`."""
    text = loads_as_given(data)
    return [
        f"loading {text(p)}" if np.isnan(peak) else f"unloading {text(p)} from {text(peak)}"
        for p, peak in zip(
            data["nominal_pressure"].values, data["unloaded_from"].values, strict=True
        )
    ]


def branches(pressure: Array, peaks: Array) -> list[tuple[str, Indices]]:
    """Name and steps of the loading and of each unloading, which begins at its peak on the loading.

    pressure, peaks : nominal pressure of each step, and the one it is unloaded from, NaN on loading [Pa].
    """
    loading = np.flatnonzero(np.isnan(peaks))
    found = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        start = loading[pressure[loading] == peak]
        found.append((branch_text(peak), np.r_[start, np.flatnonzero(peaks == peak)]))
    return found


def branches_in(data: xarray.Dataset) -> list[tuple[str, Indices]]:
    """The branches of a dataset, see `branches`."""
    return branches(data["nominal_pressure"].values, data["unloaded_from"].values)


def pressures_and_peaks(steps: Sequence[Any]) -> tuple[Array, Array]:
    """Nominal pressures and peaks of load steps as `branches` takes them [Pa]."""
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    return np.array([s.pressure for s in steps], dtype=float), np.array(peaks, dtype=float)


def piece(
    data: xarray.Dataset, i: int, j: int, dims: tuple[str, str] = ("piece1", "piece2")
) -> Shape:
    """Index of a piece along two dimensions, checked."""
    if dims[0] not in data.dims:
        raise InputError(
            "piece",
            (i, j),
            "none: the results have no pieces of the kind that a two-scale study has",
        )
    m1, m2 = (data.sizes[dim] for dim in dims)
    if i not in range(m1) or j not in range(m2):
        raise InputError("piece", (i, j), f"0 to {m1 - 1} along x1 and 0 to {m2 - 1} along x2")
    return int(i), int(j)
