"""Digests of numbers, texts, arrays, files, functions, and of what is made of them."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np


class Unnamed(TypeError):
    """A value has no digest."""


def digest(value: Any) -> str:
    """Digest of numbers, texts, arrays, contents of files, functions of modules, and of what is made of them.

    Raises Unnamed: something else, such as a function inside a function, or a file that cannot be read.
    """
    state = hashlib.blake2b(digest_size=16)
    _feed(state, value)
    return state.hexdigest()


def _feed(state: Any, value: Any) -> None:
    """Add a value to a digest, by its type and content."""
    kind = type(value)
    name = f"{kind.__module__}.{kind.__qualname__}"
    if value is None or kind in (bool, int, float, complex, str, bytes):
        state.update(f"{name}:{value!r};".encode())
    elif isinstance(value, (np.ndarray, np.generic)):
        if value.dtype.hasobject:
            raise Unnamed(name)
        array = np.ascontiguousarray(value)
        # sums over an array depend on its order in memory
        order = (
            "F"
            if isinstance(value, np.ndarray) and value.flags.f_contiguous and value.ndim > 1
            else "C"
        )
        state.update(f"array:{array.dtype.str}{np.shape(value)}{order};".encode())
        state.update(array.reshape(-1).view(np.uint8).data if array.size else b"")
    elif isinstance(value, (tuple, list)):
        state.update(f"{name}{len(value)}[".encode())
        for item in value:
            _feed(state, item)
    elif isinstance(value, dict):
        state.update(f"{name}{len(value)}{{".encode())
        for key, item in value.items():
            _feed(state, key)
            _feed(state, item)
    elif isinstance(value, Path):
        try:
            with value.open("rb") as file:
                state.update(b"file:" + hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            raise Unnamed(str(error)) from None
    elif isinstance(value, partial):
        state.update(b"partial(")
        _feed(state, (value.func, value.args, value.keywords))
    elif is_dataclass(kind):
        state.update(f"{name}(".encode())
        for f in fields(value):
            _feed(state, getattr(value, f.name))
    elif (
        callable(value) and "<" not in getattr(value, "__qualname__", "<") and _is_of_module(value)
    ):
        of = getattr(getattr(value, "__self__", None), "__qualname__", "")
        state.update(f"function:{value.__module__}.{value.__qualname__}{of};".encode())
    else:
        raise Unnamed(name)


def _is_of_module(function: Any) -> bool:
    """Whether a function is one of a module or of a class, and not of an object."""
    of = getattr(function, "__self__", None)
    return of is None or isinstance(of, type)
