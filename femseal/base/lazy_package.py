"""Importing femseal: packages whose names are loaded when first used (PEP 562), and a folder for compiled loops."""

import ast
import atexit
import gc
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from shutil import rmtree
from tempfile import mkdtemp
from types import ModuleType
from typing import Any

#: Rooms that display results, by name; the package enters what imports them, so that no file of a room above does.
displays: dict[str, Callable[[], ModuleType]] = {}


class LazyPackage(ModuleType):
    """A package that loads what its `__init__` imports under `TYPE_CHECKING`, and its modules, when first used."""

    @cached_property
    def _homes(self) -> dict[str, str]:
        """Name to the module it comes from, relative to the package."""
        tree = ast.parse(self.__spec__.loader.get_source(self.__name__))  # type: ignore[union-attr]
        imports = (node for part in tree.body if isinstance(part, ast.If) for node in part.body)
        return {
            alias.asname or alias.name: "." * node.level + (node.module or "")
            for node in imports
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }

    @cached_property
    def _modules(self) -> set[str]:
        """Names of its modules, without private ones."""
        return {module.name for module in iter_modules(self.__path__) if not module.name.startswith("_")}

    def __getattr__(self, name: str) -> Any:
        if name in self._homes:
            value = getattr(import_module(self._homes[name], self.__name__), name)
        elif not name.startswith("_") and name in self._modules:
            value = import_module(f".{name}", self.__name__)
        else:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: object) -> None:
        # a file may be called what the function in it is called; the package means the function
        if not (isinstance(value, ModuleType) and name in self._homes):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._homes, *self._modules})


def load_when_used(package: str) -> None:
    """Make a package lazy: to be called by its `__init__`."""
    sys.modules[package].__class__ = LazyPackage


@contextmanager
def loading() -> Iterator[None]:
    """Context of imports: hundreds of thousands of objects and no garbage, which is not looked for among them."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def find_place(package: Path) -> None:
    """Name a temporary folder for compiled loops where numba would find none and refuse to import them.

    Numba takes NUMBA_CACHE_DIR, the `__pycache__` beside each module, or a folder of the user. Where none can be
    written, as in containers that are read only, loops are compiled in every run, once for all its processes.
    """
    if os.environ.get("NUMBA_CACHE_DIR") or _can_write(package / "base/__pycache__") or _user_can_write():
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
