"""Parts of a dataset of results: branches of the load cycle, solved steps, windows, cells of the library."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.quantities import to_si, to_text

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]
Steps = NDArray[np.int64]
#: Name of the variable that says which steps are interpolated.
INTERPOLATED = "interpolated"


def branch_text(unloaded_from: float | None) -> str:
    """Name of a branch: "loading", or "unloading from 900 MPa"; `unloaded_from` [Pa], NaN or None on loading."""
    if unloaded_from is None or np.isnan(unloaded_from):
        return "loading"
    return f"unloading from {to_text(unloaded_from, 'Pa')}"


def branches(pressure: Array, peaks: Array) -> list[tuple[str, Steps]]:
    """Name and steps of the loading and of each unloading, which begins at its peak on the loading.

    pressure, peaks : nominal pressure of each step, and the one it is unloaded from, NaN on loading [Pa].
    """
    loading = np.flatnonzero(np.isnan(peaks))
    found = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        start = loading[pressure[loading] == peak]
        found.append((branch_text(float(peak)), np.r_[start, np.flatnonzero(peaks == peak)]))
    return found


def branches_in(data: xarray.Dataset) -> list[tuple[str, Steps]]:
    """The branches of a dataset, see `branches`."""
    return branches(data["nominal_pressure"].values, data["unloaded_from"].values)


def pressures_and_peaks(steps: Sequence[Any]) -> tuple[Array, Array]:
    """Nominal pressures and peaks of load steps as `branches` takes them [Pa]."""
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    return np.array([s.pressure for s in steps], dtype=float), np.array(peaks, dtype=float)


def solved_steps(data: xarray.Dataset) -> Steps:
    """Steps of a dataset that were solved; the others are interpolated and have no fields."""
    return np.flatnonzero(data[INTERPOLATED].values == 0) if INTERPOLATED in data else np.arange(data.sizes["step"])


def loading(data: xarray.Dataset) -> xarray.Dataset:
    """All variables over the steps, on loading, over the nominal pressure."""
    return _over_pressure(data, branches_in(data)[0][1])


def unloading(data: xarray.Dataset, from_: float | str | None) -> xarray.Dataset:
    """The same on unloading from a peak, with which it begins; from the highest unless `from_` says which."""
    parts = branches_in(data)[1:]
    if not parts:
        raise InputError("from_", from_, "nothing: the cycle has no unloading")
    peaks = [float(data["nominal_pressure"][steps[0]]) for _, steps in parts]
    wanted = max(peaks) if from_ is None else to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
    for peak, (_, steps) in zip(peaks, parts, strict=True):
        if np.isclose(peak, wanted, rtol=1e-9, atol=0):
            return _over_pressure(data, steps)
    raise InputError("from_", from_, f"one of {', '.join(to_text(p, 'Pa') for p in sorted(peaks))}")


def _over_pressure(data: xarray.Dataset, steps: Steps) -> xarray.Dataset:
    names = [name for name, variable in data.data_vars.items() if "step" in variable.dims]
    return data[names].isel(step=steps).swap_dims(step="nominal_pressure")


def cell(data: xarray.Dataset, i: int, j: int) -> xarray.Dataset:
    """Curves of the window (i, j) over the steps."""
    i, j = window(data, i, j)
    names = [name for name, variable in data.data_vars.items() if variable.dims == ("step", "cell1", "cell2")]
    return data[names].isel(cell1=i, cell2=j)


def window(data: xarray.Dataset, i: int, j: int) -> tuple[int, int]:
    """Index of a window, checked."""
    if "window_pressure" not in data:
        raise InputError("cell", (i, j), "none: the results have no windows, which a two-scale study has")
    m1, m2 = data.sizes["cell1"], data.sizes["cell2"]
    if i not in range(m1) or j not in range(m2):
        raise InputError("cell", (i, j), f"0 to {m1 - 1} along x1 and 0 to {m2 - 1} along x2")
    return int(i), int(j)


def library_cell(data: xarray.Dataset, number: int) -> xarray.Dataset:
    """Curves of a cell of the library over the steps of the library."""
    if "library_k" not in data:
        raise InputError("cell", number, "none: the results have no library, which a stochastic study has")
    if number not in range(data.sizes["library_cell"]):
        raise InputError("cell", number, f"0 to {data.sizes['library_cell'] - 1}")
    names = [name for name, variable in data.data_vars.items() if "library_cell" in variable.dims]
    return data[names].isel(library_cell=number)
