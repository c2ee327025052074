"""Support the import of femseal: load names on first use (PEP 562), and choose a cache folder for compiled loops."""

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
from typing import Any


def lazy(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the functions `__getattr__` and `__dir__` of a package whose names are loaded on first use.

    The package has two kinds of names: its modules, and the names that its `__init__.py` imports under `TYPE_CHECKING`.
    No imported name may be the name of a module. Otherwise the module would replace the imported object, because Python
    stores each loaded module in the package under its name.

    The package lazy_loader is not used in place of this function. `import femseal` takes about as long with it (16 ms
    instead of 15 ms), but it reads the names from a second file of each package, `__init__.pyi`, and it rejects names
    that are imported from another package, such as `femseal.studies.Scene`.
    """
    module = sys.modules[package]

    @cache
    def sources() -> dict[str, str]:
        """Map each name of the package to the relative name of the module that defines it."""
        tree = ast.parse(module.__spec__.loader.get_source(package))  # type: ignore[union-attr]
        source_of = {info.name: f".{info.name}" for info in iter_modules(module.__path__)}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                source = "." * node.level + (node.module or "")
                for alias in node.names:
                    source_of[alias.asname or alias.name] = source
        return source_of

    def load(name: str) -> Any:
        """Import a name, and store it in the package, so that it is only loaded once."""
        source = sources().get(name)
        if source is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        imported = import_module(source, package)
        is_module = source == f".{name}"
        value = imported if is_module else getattr(imported, name)
        setattr(module, name, value)
        return value

    def names() -> list[str]:
        """Return all names of the package, including those that are not loaded yet."""
        return sorted({*vars(module), *sources()})

    return load, names


def choose_cache_folder(package: Path) -> None:
    """Choose a folder in which Numba caches compiled loops, unless the user has set NUMBA_CACHE_DIR.

    The name of the folder contains the time at which femseal was installed. The cache of an earlier version could refer
    to classes that no longer exist, which would make the import fail. If neither the package folder nor the user's
    cache folder is writable, as in read-only containers, a temporary folder is used. In this case, each run compiles
    the loops once for all of its processes.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    candidates = [package / "__pycache__"]
    with suppress(RuntimeError):  # the user has no home folder
        candidates.append(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"))
    parent = next(filter(_can_write, candidates), None)
    if parent is None:
        folder = mkdtemp(prefix="femseal-")
        atexit.register(rmtree, folder, ignore_errors=True)
    else:
        installed = (package / "__init__.py").stat().st_mtime_ns
        folder = str(parent / f"femseal-compiled-{installed}")
    os.environ["NUMBA_CACHE_DIR"] = folder
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = folder


def _can_write(folder: Path) -> bool:
    """Return whether files can be created in a folder, or whether a missing folder itself can be created."""
    # find the first parent that exists
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK | os.X_OK)
