"""Versions of everything that the bits of a result depend on."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "pyfftw", "pyamg", "scikit-fem")


@cache
def versions() -> dict[str, str]:
    """Name to version of femseal, Python, the kind of processor and the numerical packages.

    femseal's own has a digest of its source appended, so that edited code is another version.
    """
    from . import __version__

    source = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    found = {
        "femseal": f"{__version__}+{source.hexdigest()[:12]}",
        "python": platform.python_version(),
        "processor": platform.machine(),
    }
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found
