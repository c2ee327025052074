"""Packages whose names are loaded when they are first used, so that a case is read without the solvers (PEP 562)."""

from __future__ import annotations

import ast
import sys
from functools import cached_property
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Any


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
