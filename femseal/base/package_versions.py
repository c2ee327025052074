"""Return the versions of femseal and of the packages that it uses.

Versions are read from the metadata of the installation, without importing the packages.
"""

from __future__ import annotations

import hashlib
import platform
import re
from functools import cache
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from .. import __version__

_OPTIONAL = ("SurfaceTopography", "distributed", "gmsh", "CoolProp")
#: Packages whose version can change the last bits of the results.
_NUMERICAL = ("numpy", "scipy", "numba", "llvmlite", "pyfftw", "pyamg", "scikit-fem", "CoolProp")


@cache
def versions() -> dict[str, str]:
    """Return the versions of femseal, Python and the packages that it uses.

    A required package that is not installed has the version "–". An optional package that is not installed is left out.
    If femseal itself is not installed, but its folder is on the path of Python, the required packages are unknown.
    """
    result = {"femseal": __version__, "python": platform.python_version()}
    result |= {name: _version(name) or "–" for name in _required_packages()}
    result |= {name: _version(name) for name in _OPTIONAL if _version(name)}
    return result


def _required_packages() -> list[str]:
    """Return the names of the packages that the metadata of femseal require, without those of its extras."""
    try:
        requirements = requires("femseal") or []
    except PackageNotFoundError:
        return []
    # a requirement begins with a name, as in 'numpy>=2.0' or 'gmsh>=4.12; extra == "mesh"'
    return [re.split(r"[^\w.-]", text)[0] for text in requirements if "extra ==" not in text]


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
