"""The netCDF file of results, which any tool reads."""

import io
import json
from pathlib import Path
from typing import Any

from ..base import AnyPath, InputError, free_memory, made_folder, shortened, write_bytes
from .results import METHODS, Results

FILE_NAME = "results.nc"
_OURS = "a file that femseal wrote"
#: Attributes that hold JSON, and what each of them is.
_ATTRIBUTES: dict[str, type] = {
    "case": dict, "surface": dict, "timings": dict, "counts": dict, "warnings": list, "failures": list,
    "versions": dict, "machine": dict,
}  # fmt: skip


def save(results: Results, folder: AnyPath) -> Path:
    """Write `results.nc` into a folder, which is made if needed; an older file is replaced whole or not at all.

    Raises InputError: the folder cannot be made.
    """
    from xarray.backends import H5NetCDFStore

    folder = made_folder(folder)
    data = results.dataset
    packed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {
        name: dict(packed) for name, v in data.data_vars.items() if v.ndim and v.dtype.kind in "fiu"
    }
    encoding |= {
        name: {"_FillValue": None} for name, v in data.coords.items() if v.dtype.kind == "f"
    }
    # HDF5 ends the process where a disk is full; `to_netcdf` would take a lock from a Dask client where there is one
    content = io.BytesIO()
    store = H5NetCDFStore.open(content, mode="w", lock=False)
    try:
        data.dump_to_store(store, encoding=encoding)
    finally:
        store.close()
    return write_bytes(folder / FILE_NAME, content.getbuffer())


def _refuse_foreign(path: Path) -> None:
    """Results are data: a file that points to other files, or claims more than fits into memory, is not read."""
    import h5py

    size = 0
    with h5py.File(path, "r") as file:
        for name in file:
            held = isinstance(file.get(name, getlink=True), h5py.HardLink)
            item = file[name] if held else None
            if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
                given = f"{path}, whose '{name}' is not held in the file itself"
                raise InputError("results file", given, _OURS)
            size += item.size * item.dtype.itemsize if item.size else 0
    if size > (free := free_memory()):
        given = f"{path}, which unpacks to {size / 1e9:.3g} GB"
        raise InputError(
            "results file", given, f"what fits into the {free / 1e9:.3g} GB of free memory"
        )


def open_results(folder: AnyPath) -> Results:
    """Read the results in a folder into memory, without the studies' large fields.

    Raises InputError: no such folder, no `results.nc` in it, or not one that femseal wrote.

    Examples
    --------
    >>> results = open_results("results/seal")  # doctest: +SKIP
    >>> results.unloading(from_="300 MPa").leakage_total, results.failures  # doctest: +SKIP
    """
    path = Path(folder) / FILE_NAME
    if not path.is_file():
        lack = f"no {FILE_NAME} in it" if Path(folder).is_dir() else "no such folder"
        expected = f"a folder with the {FILE_NAME} of a finished run"
        raise InputError("results folder", f"{folder} ({lack})", expected)
    import xarray

    try:
        _refuse_foreign(path)
        with xarray.open_dataset(path, engine="h5netcdf", phony_dims="access") as data:
            data.load()
    except InputError:
        raise
    except Exception as error:  # libraries raise whatever a damaged file leads them to
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError("results file", f"{path} ({reason})", "a readable netCDF file") from None
    known = any(name in data for _, name in METHODS)
    if not known or not str(data.attrs.get("source", "")).startswith("femseal"):
        raise InputError("results file", f"{path}, written by another program", _OURS)
    results = Results(data, Path(folder))
    try:
        for name, kind in _ATTRIBUTES.items():
            if not isinstance(json.loads(data.attrs[name]), kind):
                raise TypeError(f"the attribute '{name}' is of another kind")
        results.table()
    except Exception as error:  # also a field of another kind, shape or place
        raise unfit(path, error) from None
    return results


def unfit(path: Path, error: Exception) -> InputError:
    """The error of results that can be read, but whose values do not go together."""
    reason = f"{type(error).__name__}: {shortened(error, 80)}"
    return InputError("results file", f"{path} ({reason})", _OURS)
