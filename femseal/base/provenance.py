"""Versions of femseal and its dependencies, from the metadata of the installation, without importing them."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .. import __version__

_REQUIRED = ("numpy", "scipy", "scikit-fem", "pyamg", "pyfftw", "numba", "meshio", "pyvista", "vtk", "pydantic",
             "pint", "typer", "rich", "xarray", "h5netcdf", "h5py", "joblib", "emcee", "filelock", "threadpoolctl",
             "matplotlib", "jinja2", "psutil", "x3pio", "sdfio", "pillow", "xlsxwriter")  # fmt: skip
_OPTIONAL = ("SurfaceTopography", "distributed", "gmsh")
#: Packages on which the bits of a result depend.
_NUMERICAL = ("numpy", "scipy", "numba", "llvmlite", "pyfftw", "pyamg", "scikit-fem")


def versions() -> dict[str, str]:
    """Version of femseal, Python and every package used; "–" for one that is not installed, optional ones left out."""
    found = {"femseal": __version__, "python": platform.python_version()}
    for name in (*_REQUIRED, *_OPTIONAL):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            if name in _REQUIRED:
                found[name] = "–"
    return found


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
    for name in _NUMERICAL:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found
