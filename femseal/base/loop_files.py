"""The folder where numba keeps compiled loops."""

from __future__ import annotations

import atexit
import os
import sys
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp


def find_place(package: Path) -> None:
    """Name a temporary folder for compiled loops where numba would find none and refuse to import them.

    Numba takes NUMBA_CACHE_DIR, the `__pycache__` beside each module, or a folder of the user. Where none can be
    written, as in containers that are read only, loops are compiled in every run, once for all its processes.
    """
    if os.environ.get("NUMBA_CACHE_DIR") or _can_write(package / "base" / "__pycache__") or _user_can_write():
        return
    folder = mkdtemp(prefix="femseal-")
    atexit.register(rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = folder
    if "numba" in sys.modules:
        sys.modules["numba"].config.reload_config()


def _user_can_write() -> bool:
    try:
        return _can_write(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"))
    except RuntimeError:  # no home
        return False


def _can_write(folder: Path) -> bool:
    """Whether files can be made in a folder, which may have to be made too."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK | os.X_OK)
