"""Results at every load step from those of a part of them: the others are interpolated, and have no fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..studies.load_interpolation import at_all_steps

if TYPE_CHECKING:
    import xarray

    from ..loads import LoadProgramme

#: Name of the variable that tells which steps are interpolated.
NAME = "interpolated"
#: Dimensions beside the steps whose every entry is a number of its own; variables with others are fields.
_OF_NUMBERS = {"step", "realisation", "seal_length"}


def solved_steps(data: xarray.Dataset) -> NDArray[np.int64]:
    """Places of the steps of a dataset that were solved."""
    return np.flatnonzero(data[NAME].values == 0) if NAME in data else np.arange(data.sizes["step"])


def with_all_steps(data: xarray.Dataset, solved: NDArray[np.int64], steps: LoadProgramme) -> xarray.Dataset:
    """A dataset of all steps from one of the solved ones; fields are NaN at the others."""
    import xarray

    from .variables import step_coordinates

    others = {name: c for name, c in data.coords.items() if "step" not in c.dims}
    found = xarray.Dataset(coords=others | step_coordinates("step", "", steps))
    for name, variable in data.data_vars.items():
        if "step" not in variable.dims:
            found[name] = variable
            continue
        last = np.moveaxis(variable.values, variable.dims.index("step"), -1).astype(float)
        if set(variable.dims) <= _OF_NUMBERS:
            values = at_all_steps(last, solved, steps, logarithmic=variable.attrs["units"] == "m^2/s")
        else:
            values = np.full((*last.shape[:-1], len(steps)), np.nan, variable.dtype if _has_nan(variable) else float)
            values[..., solved] = last
        found[name] = (variable.dims, np.moveaxis(values, -1, variable.dims.index("step")), variable.attrs)
    flags = np.ones(len(steps), np.int8)
    flags[solved] = 0
    labels = {"units": "1", "long_name": "1 at load steps that are interpolated between solved ones, else 0"}
    found[NAME] = ("step", flags, labels)
    return found


def _has_nan(variable: Any) -> bool:
    return bool(variable.dtype.kind == "f")
