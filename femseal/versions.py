"""Versions of femseal and of what it stands on, from the metadata of the installation: nothing is imported."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from . import __version__

_REQUIRED = ("numpy", "scipy", "scikit-fem", "pyamg", "pyfftw", "numba", "meshio", "pyvista", "vtk", "pydantic",
             "pint", "typer", "rich", "xarray", "h5netcdf", "h5py", "joblib", "matplotlib", "jinja2",
             "x3pio", "sdfio")  # fmt: skip
_OPTIONAL = ("SurfaceTopography", "distributed", "gmsh")


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
