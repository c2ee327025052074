"""Return the versions of femseal and of the packages that it uses.

Versions are read from the metadata of the installation, without importing the packages.
"""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .. import __version__

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
