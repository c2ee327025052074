"""Provide data on the machine, package versions, and arrays that are shared between processes or stored on disk.

A large array, such as the gaps of all contact states, is stored in a file of plain numbers that is mapped into memory.
Such a file requires no further library. Views of the array behave like any other array, and other processes can open
the file by its name. The file has no folder entry and therefore disappears with the run, even if the run is killed. A
resumed run does not need the file: it reads the contact states from its `store`.

Versions are read from the metadata of the installation, without importing the packages.
"""

from __future__ import annotations

import hashlib
import math
import mmap
import os
import platform
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil

from .. import __version__

if TYPE_CHECKING:
    from numpy.typing import NDArray


def machine() -> dict[str, str | int]:
    """Return the name of the processor, the number of cores, the memory [byte] and the operating system, if known."""
    description: dict[str, str | int] = {
        "processor": _processor(),
        "system": f"{platform.system()} {platform.release()}",
        "memory_bytes": psutil.virtual_memory().total,
    }
    cores = psutil.cpu_count()
    if cores:
        description["cores"] = cores
    return description


def peak_memory() -> int:
    """Return the peak memory use of this process so far [byte]."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # in bytes on macOS, in KiB on Linux
    return peak if sys.platform == "darwin" else 1024 * peak


def free_memory() -> float:
    """Return the memory that is available to processes on this machine without swapping [byte]."""
    return float(psutil.virtual_memory().available)


#: Lock of the thread that limits the memory of the process; the thread may limit it again inside.
_limiting = threading.RLock()


@contextmanager
def within_free_memory() -> Iterator[None]:
    """Raise MemoryError if the code inside a `with` block requests more memory than is free at its beginning.

    Without a limit, Linux would kill a process that uses too much memory. The limit matters when compressed files of
    unknown uncompressed size are read. On operating systems other than Linux, memory is not limited.

    The limit is the limit of the address space of the whole process (RLIMIT_AS) until the block ends: requests of
    other threads, also in other libraries, fail as well, and processes that are started inside the block inherit it.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    # the limit holds for the whole process: of several threads, one at a time sets and removes it
    with _limiting:
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = psutil.Process().memory_info().vms + int(free_memory())
        if soft != resource.RLIM_INFINITY:
            limit = min(limit, soft)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


#: File descriptors of the arrays that the innermost `with` block of `sharing` shares; None outside such a block.
_shared: ContextVar[list[int] | None] = ContextVar("shared", default=None)
#: Folder of large arrays and memory limit [byte] of the innermost `with` block of `storing`.
_store: ContextVar[tuple[Path | None, float]] = ContextVar("store", default=(None, math.inf))
#: An array lies on disk if it takes more than this fraction of the memory that a run may use.
PART_OF_MEMORY = 1 / 16


@contextmanager
def sharing() -> Iterator[None]:
    """Make arrays accessible to other processes if `shared_empty` creates them inside the `with` block."""
    previous = _shared.get()
    descriptors: list[int] = []
    _shared.set(descriptors)
    try:
        yield
    finally:
        _shared.set(previous)
        for descriptor in descriptors:
            os.close(descriptor)


@contextmanager
def storing(folder: Path | None, memory: float | None = None) -> Iterator[None]:
    """Inside the `with` block, let `shared_empty` store large arrays in files of a folder.

    folder : folder for the files; None for the system's temporary folder.
    memory : upper limit of the memory that the run may use [byte]; None for no limit besides the free memory.
    """
    previous = _store.get()
    _store.set((folder, math.inf if memory is None else memory))
    try:
        yield
    finally:
        _store.set(previous)


def lies_on_disk(size: float) -> bool:
    """Return whether `shared_empty` stores an array of the given size [byte] on disk."""
    _, limit = _store.get()
    return size > PART_OF_MEMORY * min(free_memory(), limit)


def shared_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Create an array without initial values, like `numpy.empty`; a large array is stored in a file, see `storing`.

    Inside a `with` block of `sharing`, on Linux, other processes receive a view of the array rather than a copy. Values
    that another process writes then appear in this process. When the last view is deleted, the memory and the file of
    the array are released, even if the run is killed.
    """
    import numpy as np  # imported here, so that commands that only need versions start faster

    size = math.prod(shape) * np.dtype(dtype).itemsize
    on_disk = lies_on_disk(size)
    descriptors = _shared.get()
    is_shared = descriptors is not None
    needs_file = on_disk or is_shared
    cannot_share = is_shared and not hasattr(os, "memfd_create")  # other systems than Linux
    if size == 0 or cannot_share or not needs_file:
        return np.empty(shape, dtype)
    try:
        with _unnamed_file(on_disk) as file:
            _reserve(file, size, on_disk)
            if descriptors is None:
                return np.memmap(file, dtype, "r+", shape=shape)
            descriptor = os.dup(file.fileno())
            descriptors.append(descriptor)
        # joblib only sends the name of the file instead of its content, so the file must be mapped by a name
        return np.memmap(f"/proc/{os.getpid()}/fd/{descriptor}", dtype, "r+", shape=shape)
    except OSError:
        # the system does not have such files, or no space for another one
        return np.empty(shape, dtype)


def _unnamed_file(on_disk: bool) -> Any:
    """Open a temporary file without a folder entry, either in memory or on disk in the folder of `storing`."""
    if not on_disk:
        return open(os.memfd_create("femseal"), "r+b")
    folder, _ = _store.get()
    return tempfile.TemporaryFile(dir=folder)


def _reserve(file: Any, size: int, on_disk: bool) -> None:
    """Extend an empty file to a given size [byte]; raise OSError if there is not enough space on the disk."""
    if on_disk and hasattr(os, "posix_fallocate"):
        # if the space were not reserved, writing to the array on a full disk would kill the process
        os.posix_fallocate(file.fileno(), 0, size)
    else:
        os.ftruncate(file.fileno(), size)


def give_back(array: NDArray[Any]) -> None:
    """Release the memory of an array that is stored in a file. The next access reads the array from the file again."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def one_at_a_time(states: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield the array of each state, and then release its memory if the states are stored in a file."""
    for state in states:
        yield state
        give_back(states)


def _processor() -> str:
    """Return the name of the processor; on Linux it is read from /proc/cpuinfo."""
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
#: Packages on which the results depend, to the last bit.
_NUMERICAL = ("numpy", "scipy", "numba", "llvmlite", "pyfftw", "pyamg", "scikit-fem", "CoolProp")


@cache
def versions() -> dict[str, str]:
    """Return the versions of femseal, Python and the packages that it uses.

    A required package that is not installed has the version "–". An optional package that is not installed is left out.
    """
    result = {"femseal": __version__, "python": platform.python_version()}
    for name in (*_REQUIRED, *_OPTIONAL):
        package_version = _version(name)
        if package_version or name in _REQUIRED:
            result[name] = package_version or "–"
    return result


def _version(name: str) -> str:
    """Return the version of a package, "" if it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


@cache
def numerical_versions() -> dict[str, str]:
    """Return what affects the last bits of the results: the versions of numerical packages and the processor type.

    The version of femseal includes a digest of its source code, so that edited code counts as another version.
    """
    source = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        source.update(path.read_bytes())
    result = {
        "femseal": f"{__version__}+{source.hexdigest()[:12]}",
        "python": platform.python_version(),
        "processor": platform.machine(),
    }
    return result | {name: _version(name) or "none" for name in _NUMERICAL}
