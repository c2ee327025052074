"""Write and read the netCDF file `results.nc` of a run."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import xarray

from ..base import AnyPath, InputError, free_memory, made_folder, shortened, write_bytes
from ..seal.layouts import AnnularLayout, MeshLayout, RectangularLayout
from .best_leakage import best_study, solved_studies
from .results import Results

FILE_NAME = "results.nc"
_EXPECTED = "a file that femseal wrote"
#: Attributes that store JSON, and the Python type of each attribute after parsing.
_JSON_ATTRIBUTES: dict[str, type] = {
    "case": dict,
    "surface": dict,
    "timings": dict,
    "warnings": list,
    "failures": list,
    "versions": dict,
    "machine": dict,
}


def save(results: Results, folder: AnyPath) -> Path:
    """Write `results.nc` into a folder.

    Parameters
    ----------
    results : Results
        Results whose dataset is written.
    folder : str or path
        Folder of the file, which is created if needed. If writing fails, an existing `results.nc` remains intact.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        The folder cannot be created.
    """
    from xarray.backends import H5NetCDFStore

    folder = made_folder(folder)
    data = results.dataset
    compressed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {}
    for name, variable in data.data_vars.items():
        if variable.ndim and variable.dtype.kind in "fiu":
            encoding[name] = dict(compressed)
    for name, coordinate in data.coords.items():
        if coordinate.dtype.kind == "f":
            encoding[name] = {"_FillValue": None}
    # The file is built in memory, because HDF5 terminates the process when the disk is full. `to_netcdf` is not used,
    # because it acquires a distributed lock if there is a Dask client.
    content = io.BytesIO()
    store = H5NetCDFStore.open(content, mode="w", lock=False)
    try:
        data.dump_to_store(store, encoding=encoding)
    finally:
        store.close()
    return write_bytes(folder / FILE_NAME, content.getbuffer())


def open_results(folder: AnyPath) -> Results:
    """Read the results of a finished run.

    Parameters
    ----------
    folder : str or path
        Folder with the file `results.nc`.

    Returns
    -------
    Results
        Results with the dataset. Fields over the pixels are read from the folder when they are needed.

    Raises
    ------
    InputError
        The file `results.nc` does not exist, cannot be read, or was written by another program.

    Examples
    --------
    >>> results = open_results("results/seal")  # doctest: +SKIP
    >>> results.unloading(from_="300 MPa").leakage_total, results.failures  # doctest: +SKIP
    """
    folder = Path(folder)
    path = folder / FILE_NAME
    if not path.is_file():
        reason = f"no {FILE_NAME} in it" if folder.is_dir() else "no such folder"
        expected = f"a folder with the {FILE_NAME} of a finished run"
        raise InputError("results folder", f"{folder} ({reason})", expected)
    data = _read(path)
    try:
        _check_attributes(data)
        results = Results(_with_all_attributes(data), folder)
        results.table()
    except Exception as error:
        # variables of a wrong type, shape or dimension can cause any kind of error
        raise inconsistent(path, error) from None
    return results


def inconsistent(path: Path, error: Exception) -> InputError:
    """Make the error for a results file that can be read, but whose contents are inconsistent."""
    reason = f"{type(error).__name__}: {shortened(error, 80)}"
    return InputError("results file", f"{path} ({reason})", _EXPECTED)


def _read(path: Path) -> xarray.Dataset:
    """Read the dataset of a file, and raise an InputError unless femseal wrote it."""
    try:
        _check_safety(path)
        with xarray.open_dataset(path, engine="h5netcdf", phony_dims="access") as data:
            data.load()
    except InputError:
        raise
    except Exception as error:  # a damaged file can cause any error in the libraries
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError("results file", f"{path} ({reason})", "a readable netCDF file") from None
    has_leakage = bool(solved_studies(data))
    if not has_leakage or not str(data.attrs.get("source", "")).startswith("femseal"):
        raise InputError("results file", f"{path}, written by another program", _EXPECTED)
    return _with_present_names(data)


def _with_present_names(data: xarray.Dataset) -> xarray.Dataset:
    """Rename variables and dimensions from earlier versions of femseal to their present names."""
    names = {}
    for name in map(str, (*data.variables, *data.dims)):
        present = name.replace("piece", "cell").replace("places", "patches")
        present = re.sub(r"place(?=_|$|\d)", "patch", present)
        if present != name:
            names[name] = present
    return data.rename(names)


def _with_all_attributes(data: xarray.Dataset) -> xarray.Dataset:
    """Add the attributes that earlier versions of femseal did not store."""
    if "seal_kind" in data.attrs:
        return data
    kind = RectangularLayout.kind
    if best_study(data).has_realisations:
        case = json.loads(data.attrs["case"])
        kind = (case.get("seal") or {}).get("kind") or _kind_in_text(data.attrs.get("seal", ""))
    return data.assign_attrs(seal_kind=kind)


def _kind_in_text(seal: str) -> str:
    """Return the kind of a seal from its description, such as "a strip, lay x1".

    Files that an earlier version wrote from Python, without a case, state the kind nowhere else. As no new files of
    this kind are written, nothing depends on how the present version words its descriptions.
    """
    if not seal or seal.startswith("a strip"):
        return RectangularLayout.kind
    return AnnularLayout.kind if seal.startswith("a ring") else MeshLayout.kind


def _check_attributes(data: xarray.Dataset) -> None:
    """Raise an error if an attribute is missing, is not JSON, or has the wrong type."""
    for name, kind in _JSON_ATTRIBUTES.items():
        if not isinstance(json.loads(data.attrs[name]), kind):
            raise TypeError(f"the attribute '{name}' must be a JSON {kind.__name__}")


def _check_safety(path: Path) -> None:
    """Raise an InputError if a file refers to other files, or needs more memory than is free.

    HDF5 files can contain links to other files. Links are not followed: results received from someone else could link
    to any file on the reader's computer.
    """
    import h5py

    size = 0  # size of all variables without compression [byte]
    with h5py.File(path, "r") as file:
        for name in file:
            link = file.get(name, getlink=True)
            # only a hard link belongs to this file; soft and external links are not followed
            item = file[name] if isinstance(link, h5py.HardLink) else None
            if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
                given = f"{path}, whose '{name}' is not held in the file itself"
                raise InputError("results file", given, _EXPECTED)
            size += item.size * item.dtype.itemsize if item.size else 0
    free = free_memory()
    if size > free:
        given = f"{path}, which unpacks to {size / 1e9:.3g} GB"
        expected = f"what fits into the {free / 1e9:.3g} GB of free memory"
        raise InputError("results file", given, expected)
