"""Parts of a results dataset: a branch of the load cycle, a window, a cell of the library."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import InputError
from ..base.quantities import to_si, to_text
from .branches import branches

if TYPE_CHECKING:
    import xarray

_WINDOW = (
    "k1",
    "flux1",
    "window_pressure",
    "window_mean_gap",
    "window_contact_fraction",
    "window_plastic_fraction",
)


def loading(data: xarray.Dataset) -> xarray.Dataset:
    """All variables over the steps, on loading, over the nominal pressure."""
    return _over_pressure(data, _branches(data)[0][1])


def unloading(data: xarray.Dataset, from_: float | str | None) -> xarray.Dataset:
    """The same on unloading from a peak, with which it begins; from the highest unless `from_` says which."""
    parts = _branches(data)[1:]
    if not parts:
        raise InputError("from_", from_, "nothing: the cycle has no unloading")
    peaks = [float(data["nominal_pressure"][steps[0]]) for _, steps in parts]
    wanted = max(peaks) if from_ is None else to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
    for peak, (_, steps) in zip(peaks, parts, strict=True):
        if np.isclose(peak, wanted, rtol=1e-9, atol=0):
            return _over_pressure(data, steps)
    raise InputError("from_", from_, f"one of {', '.join(to_text(p, 'Pa') for p in sorted(peaks))}")


def _branches(data: xarray.Dataset) -> list[tuple[str, Any]]:
    return branches(data["nominal_pressure"].values, data["unloaded_from"].values)


def _over_pressure(data: xarray.Dataset, steps: np.ndarray) -> xarray.Dataset:
    names = [name for name, variable in data.data_vars.items() if "step" in variable.dims]
    return data[names].isel(step=steps).swap_dims(step="nominal_pressure")


def cell(data: xarray.Dataset, i: int, j: int) -> xarray.Dataset:
    """Curves of the window (i, j) over the steps."""
    i, j = window(data, i, j)
    return data[[name for name in _WINDOW if name in data]].isel(cell1=i, cell2=j)


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
