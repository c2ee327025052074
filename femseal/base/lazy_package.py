"""Importing femseal: packages whose names are loaded when first used (PEP 562), and a folder for compiled loops."""

import ast
import atexit
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from shutil import rmtree
from tempfile import mkdtemp
from types import ModuleType
from typing import Any

#: Rooms that display results, by name; the package enters what imports them, so that no file of a room above does.
displays: dict[str, Callable[[], ModuleType]] = {}


def lazy(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package (PEP 562), for its `__init__`.

    They load what it imports under `TYPE_CHECKING`, and its modules, when first used. No name is that of a file too,
    which would stand in its place once it is loaded.
    """
    module = sys.modules[package]

    @cache
    def homes() -> dict[str, str]:
        """Name to the module it comes from, relative to the package."""
        tree = ast.parse(module.__spec__.loader.get_source(package))  # type: ignore[union-attr]
        found = {name.name: f".{name.name}" for name in iter_modules(module.__path__)}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                home = "." * node.level + (node.module or "")
                found |= {alias.asname or alias.name: home for alias in node.names}
        return found

    def load(name: str) -> Any:
        if (home := homes().get(name)) is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = import_module(home, package)
        value = found if home == f".{name}" else getattr(found, name)
        setattr(module, name, value)
        return value

    return load, lambda: sorted({*vars(module), *homes()})


def name_cache(package: Path) -> None:
    """Name a folder for compiled loops, unless NUMBA_CACHE_DIR does: of this installation only.

    What numba keeps of a former one may name classes that are gone, and ends the import. Where neither the package nor
    the user has a folder that can be written, as in containers that are read only, it is a temporary one: loops are
    compiled in every run, once for all its processes.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    places = [package / "__pycache__"]
    with suppress(RuntimeError):  # no home
        places.append(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"))
    place = next(filter(_can_write, places), None)
    if place is None:
        folder = mkdtemp(prefix="femseal-")
        atexit.register(rmtree, folder, ignore_errors=True)
    else:
        installed = (package / "__init__.py").stat().st_mtime_ns
        folder = str(place / f"femseal-compiled-{installed}")
    os.environ["NUMBA_CACHE_DIR"] = folder
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = folder


def _can_write(folder: Path) -> bool:
    """Whether files can be made in a folder, which may have to be made too."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK | os.X_OK)
