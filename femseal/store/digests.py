"""Compute digests of plain data, of the content of files, and of functions and objects of known modules.

The code of Python, of femseal and of installed packages is known: a name and a version identify it. All other code,
such as a script of the user, has no digest, because it may change while its name stays the same. If a result depends on
such code, it is neither read from the store nor written to it.
"""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib.metadata import packages_distributions, version
from operator import attrgetter
from pathlib import Path
from types import MethodType
from typing import Any

from .plain_data import describe

_PACKAGE = __name__.partition(".")[0]
#: Folders of installed packages.
_INSTALLED = {"site-packages", "dist-packages"}


class NoDigest(TypeError):
    """Report that a value has no digest, because it cannot be described by plain data and names of known code."""


def digest(value: Any) -> str:
    """Compute a digest of a value; different values have different digests.

    Parameters
    ----------
    value : plain data (see `femseal.store.plain_data`), file paths, known functions, classes and dataclasses, or
    tuples, lists and dictionaries of such values. A path is represented by the content of the file.

    Returns
    -------
    The digest of 16 bytes as hexadecimal text.

    Raises
    ------
    NoDigest : a part of the value cannot be described, for example a function that is not in a known module, or the
    path of an unreadable file.

    Examples
    --------
    >>> digest((1, 2.0)) == digest((1, 2.0)), digest(1) == digest(1.0)
    (True, False)
    """
    state = hashlib.blake2b(digest_size=16)
    size = 0

    def append(data: bytes) -> int:
        """Add bytes to the digest, and return the position of the first added byte."""
        nonlocal size
        start = size
        state.update(data)
        size += len(data)
        return start

    try:
        description = describe(value, append, _describe_other)
    except RecursionError:
        raise NoDigest("an object that contains itself") from None
    state.update(json.dumps(description).encode())
    return state.hexdigest()


def is_known(module: str) -> bool:
    """Return whether the name and the version of a module identify its code.

    Modules of Python, of femseal and of installed packages are identified by name and version. Name and version do not
    identify a package installed in editable mode.
    """
    return _origin(module) is not None


def _origin(module: str) -> str | None:
    """Return the version of the package that installed a module, or None if no package did.

    The returned version is "" for modules of Python and femseal, because their versions are already part of every key
    in a store.
    """
    top = module.partition(".")[0]
    if top == _PACKAGE or top in sys.stdlib_module_names:
        return ""
    file = getattr(sys.modules.get(top), "__file__", None)
    if file is None or _INSTALLED.isdisjoint(Path(file).parts):
        return None
    return _installed_version(top)


@cache
def _installed_version(top: str) -> str | None:
    """Return the names and versions of the packages that contain a top-level module, or None if there are none."""
    names = packages_distributions().get(top, [])
    return ", ".join(f"{name} {version(name)}" for name in sorted(names)) or None


def _describe_other(value: Any) -> Any:
    """Describe a value that is not plain data by a tuple of values that still have to be described."""
    if isinstance(value, Path):
        return "file", _digest_of_file(value)
    if isinstance(value, partial):
        return "partial", value.func, value.args, value.keywords
    if isinstance(value, MethodType):
        return "method", value.__func__, value.__self__
    if isinstance(value, tuple):  # an object of a class that is derived from tuple
        return "items", type(value), *value
    if is_dataclass(value) and not isinstance(value, type):
        return "object", type(value), *(getattr(value, field.name) for field in fields(value))
    return _describe_name(value)


def _describe_name(value: Any) -> Any:
    """Describe a function or a class by the name under which its module defines it, and by its version."""
    module = getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", "")
    try:
        defined = attrgetter(name)(sys.modules[str(module)])
        origin = _origin(str(module))
    except (AttributeError, KeyError):  # such as a lambda, or an object of a class in C
        raise NoDigest(f"{type(value).__qualname__} {name}") from None
    if origin is None or getattr(defined, "__func__", defined) is not value:
        raise NoDigest(f"{type(value).__qualname__} {name}")
    return "named", module, name, origin


def _digest_of_file(path: Path) -> bytes:
    """Return the SHA-256 digest of the content of a file; raise NoDigest if the file cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise NoDigest(str(error)) from None
