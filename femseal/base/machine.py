"""The machine of a run: its memory, arrays that processes share or that lie on disk, and the versions of all packages.

A large array is a file of plain numbers, mapped into memory: one state after the other, each written and read as a
whole or by pieces. It needs no library and no packing, views of it are arrays as any, and processes open it by its
name. The file has no name in its folder, so that it is gone with the run, also when that is killed: what a resumed run
begins from are the results in its `store`, where each state is as soon as it is solved.

Versions come from the metadata of the installation, without importing the packages.
"""

from __future__ import annotations

import hashlib
import math
import mmap
import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil

from .. import __version__

if TYPE_CHECKING:
    from numpy.typing import NDArray


def machine() -> dict[str, str | int]:
    """Processor, cores, memory [byte] and system; entries that the system does not know are left out."""
    found: dict[str, str | int] = {
        "processor": _processor(),
        "system": f"{platform.system()} {platform.release()}",
        "memory_bytes": psutil.virtual_memory().total,
    }
    if cores := psutil.cpu_count():
        found["cores"] = cores
    return found


def peak_memory() -> int:
    """Largest memory of this process so far [byte]."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def free_memory() -> float:
    """Memory that processes can get on this machine without swapping [byte]."""
    return float(psutil.virtual_memory().available)


@contextmanager
def within_free_memory() -> Iterator[None]:
    """Context in which asking for more memory than is free now raises MemoryError, where Linux would end the process.

    For reading files that may unpack to any size. On other systems it does nothing.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = psutil.Process().memory_info().vms + int(free_memory())
    if soft != resource.RLIM_INFINITY:
        limit = min(limit, soft)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


#: File descriptors of the shared arrays, for each active `sharing`.
_shared: list[list[int]] = []
#: Folder of large arrays, and the memory that a run may take [byte], for each active `storing`.
_stores: list[tuple[Path | None, float]] = []
#: Part of the memory that a run may take above which an array lies on disk.
PART_OF_MEMORY = 1 / 16


@contextmanager
def sharing() -> Iterator[None]:
    """Context in which arrays made by `shared_empty` are shared between processes."""
    _shared.append([])
    try:
        yield
    finally:
        for descriptor in _shared.pop():
            os.close(descriptor)


@contextmanager
def storing(folder: Path | None, memory: float | None = None) -> Iterator[None]:
    """Context in which large arrays made by `shared_empty` lie in a folder; None for that of temporary files.

    memory : that the run may take [byte]; what is free unless less is given.
    """
    _stores.append((folder, math.inf if memory is None else memory))
    try:
        yield
    finally:
        _stores.pop()


def lies_on_disk(size: float) -> bool:
    """Whether `shared_empty` puts an array of so many bytes on disk."""
    return size > PART_OF_MEMORY * min(free_memory(), _stores[-1][1] if _stores else math.inf)


def shared_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """An array of undefined values, as `numpy.empty` gives it; a mapped file where it is large, see `storing`.

    Within `sharing` on Linux, views of it are sent to processes and come back by reference: what a process writes is
    written here. Memory and file are given back with the last view, also when the run is killed.
    """
    import numpy as np  # not loaded for a question of versions

    size = math.prod(shape) * np.dtype(dtype).itemsize
    on_disk = lies_on_disk(size)
    if not size or not (on_disk or _shared) or (_shared and not hasattr(os, "memfd_create")):
        return np.empty(shape, dtype)
    with suppress(OSError):  # this system has no such files, or no room for more of them
        folder = _stores[-1][0] if _stores else None
        with (
            tempfile.TemporaryFile(dir=folder)
            if on_disk
            else open(os.memfd_create("femseal"), "r+b")
        ) as file:
            # a page of a mapped file for which a disk has no room would end the process
            if on_disk and hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                os.ftruncate(file.fileno(), size)
            if not _shared:
                return np.memmap(file, dtype, "r+", shape=shape)
            descriptor = os.dup(file.fileno())
            _shared[-1].append(descriptor)
        # joblib passes views of mapped files by the name of the file
        return np.memmap(f"/proc/{os.getpid()}/fd/{descriptor}", dtype, "r+", shape=shape)
    return np.empty(shape, dtype)


def give_back(array: NDArray[Any]) -> None:
    """Give back the memory of an array that lies in a file: what is in it stays there, and is read again when used."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def one_at_a_time(states: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """The arrays of all states, of which one that lies in a file takes memory while it is used."""
    for state in states:
        yield state
        give_back(states)


def _processor() -> str:
    """Name of the processor, which Python knows on some systems only."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()


_REQUIRED = ("numpy", "scipy", "scikit-fem", "pyamg", "pyfftw", "numba", "meshio", "pyvista", "vtk", "pydantic",
             "pint", "typer", "rich", "xarray", "h5netcdf", "h5py", "joblib", "filelock", "threadpoolctl",
             "matplotlib", "jinja2", "psutil", "x3pio", "sdfio", "pillow", "xlsxwriter")  # fmt: skip
_OPTIONAL = ("SurfaceTopography", "distributed", "gmsh", "CoolProp")
#: Packages on which the bits of a result depend.
_NUMERICAL = ("numpy", "scipy", "numba", "llvmlite", "pyfftw", "pyamg", "scikit-fem", "CoolProp")


@cache
def versions() -> dict[str, str]:
    """Version of femseal, Python and every package used; "–" for one that is not installed, optional ones left out."""
    others = {name: _version(name) for name in (*_REQUIRED, *_OPTIONAL)}
    found = {name: number or "–" for name, number in others.items() if number or name in _REQUIRED}
    return {"femseal": __version__, "python": platform.python_version(), **found}


def _version(name: str) -> str:
    """Version of a package; "" of one that is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


@cache
def numerical_versions() -> dict[str, str]:
    """Versions of everything that the bits of a result depend on, with the kind of processor.

    femseal's own has a digest of its source appended, so that edited code is another version.
    """
    source = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        source.update(path.read_bytes())
    found = {
        "femseal": f"{__version__}+{source.hexdigest()[:12]}",
        "python": platform.python_version(),
        "processor": platform.machine(),
    }
    return found | {name: _version(name) or "none" for name in _NUMERICAL}
