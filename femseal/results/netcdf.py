"""The dataset of results as a netCDF file, which any tool that knows netCDF reads."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..base.errors import InputError
from ..base.files import made_folder, replacing_hdf5
from .results import METHODS, Results

FILE_NAME = "results.nc"


def save(results: Results, folder: str | os.PathLike[str]) -> Path:
    """Write `results.nc` into a folder, which is made if needed; an older file is replaced whole or not at all.

    Raises
    ------
    InputError : the folder cannot be made.
    """
    path = made_folder(folder) / FILE_NAME
    data = results.dataset
    packed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {
        name: dict(packed) for name, v in data.data_vars.items() if v.ndim and v.dtype.kind in "fiu"
    }
    encoding |= {name: {"_FillValue": None} for name, v in data.coords.items() if v.dtype.kind == "f"}
    with replacing_hdf5(path) as target:
        data.to_netcdf(target, engine="h5netcdf", encoding=encoding)
    return path


def open_results(folder: str | os.PathLike[str]) -> Results:
    """Read the results in a folder into memory, without the studies' large fields.

    Raises
    ------
    InputError : no such folder, no `results.nc` in it, or not one that femseal wrote.
    """
    import xarray

    path = Path(folder) / FILE_NAME
    if not path.is_file():
        given = f"{folder} (no such folder)" if not Path(folder).is_dir() else f"{folder} (no {FILE_NAME} in it)"
        raise InputError.of("results folder", given, f"a folder with the {FILE_NAME} of a finished run")
    try:
        with xarray.open_dataset(path, engine="h5netcdf") as data:
            data.load()
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError.of("results file", f"{path} ({reason})", "a readable netCDF file") from None
    if not str(data.attrs.get("source", "")).startswith("femseal") or not any(name in data for _, name in METHODS):
        raise InputError.of("results file", f"{path}, written by another program", "a file that femseal wrote")
    return Results(data, Path(folder))
