"""The machine of a run, its free memory, and the versions of all packages, which results record.

Versions come from the metadata of the installation, without importing the packages.
"""

import hashlib
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import psutil

from .. import __version__


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
