"""Results of stages that several runs have in common, kept in a folder and distinguished by all that goes into them.

An item is found again if its stage does the same with the same numbers: the contact of a face is solved once for all
fluids, and its pieces once for all lengths of seal, without a list of what depends on what. The folder is
read by the program that wrote it, not passed on.
"""

from __future__ import annotations

import hashlib
import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from ..base import Mapper, NotKept, Stage, numerical_versions
from .plain_data import unpacked
from .store import SUFFIX, ShardWriter, read_shard

log = logging.getLogger("femseal.execution.shared_stages")


class Unnamed(TypeError):
    """A value has no digest."""


class SharedStages:
    """Results of stages in a folder, which is made when something is kept."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def over(self, mapper: Mapper) -> Mapper:
        """The same mapper, but items that the folder has are read from it, and others are computed and kept."""

        def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            try:
                base = digest((numerical_versions(), stage.function))
            except Unnamed:
                yield from mapper(stage, *iterables)
                return
            kept = _Kept(self._folder, base)
            waiting: deque[tuple[str, bool]] = deque()

            def missing() -> Iterator[tuple[Any, ...]]:
                for item in zip(*iterables, strict=False):
                    key = _item_key(item)
                    waiting.append((key, key in kept.found))
                    if key not in kept.found:
                        yield item

            computed = iter(mapper(replace(stage, function=partial(_spread, stage.function)), missing()))
            try:
                for result in computed:
                    while waiting[0][1]:
                        yield kept.read(waiting.popleft()[0])
                    kept.keep(waiting.popleft()[0], result)
                    yield result
                while waiting:
                    yield kept.read(waiting.popleft()[0])
            finally:
                kept.close()

        return mapping


class _Kept:
    """Results of a stage by the digest of their items.

    found : shard and number of those that are in the folder.
    """

    def __init__(self, folder: Path, base: str) -> None:
        self._folder, self._base = folder, base
        self._writer = ShardWriter((base,), self._place)
        self._full = False
        self._open: tuple[Path | None, list[bytes]] = (None, [])
        self.found: dict[str, tuple[Path, int]] = {}
        for path in sorted(folder.glob(f"{base}-*{SUFFIX}")):
            with suppress(OSError, ValueError, TypeError):
                keys = (unpacked(pair)[0] for pair in read_shard(path, (base,)))
                self.found |= {str(key): (path, n) for n, key in enumerate(keys)}

    def read(self, key: str) -> Any:
        """The result of an item that is found."""
        path, number = self.found[key]
        try:
            if self._open[0] != path:
                self._open = path, read_shard(path, (self._base,))
            return unpacked(self._open[1][number])[1]
        except (OSError, ValueError, LookupError) as error:
            text = f"shared results: '{path}' cannot be read ({error}); remove '{path.parent}', then --resume"
            raise NotKept(text) from error

    def keep(self, key: str, result: Any) -> None:
        """Keep a result, unless it is no plain data or the disk is full: then it is only not shared."""
        if not key or self._full:
            return
        with suppress(TypeError):
            self._write(self._writer.keep, (key, result))

    def close(self) -> None:
        """Write what is left."""
        if not self._full:
            self._write(self._writer.flush)

    def _place(self, count: int) -> Path:
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._folder / f"{self._base}-{uuid4().hex}{SUFFIX}"

    def _write(self, write: Callable[..., None], *item: Any) -> None:
        try:
            write(*item)
        except OSError as error:
            self._full = True
            log.warning("results are not shared with other runs any more: %s", error)


def _spread(function: Callable[..., Any], item: tuple[Any, ...]) -> Any:
    return function(*item)


def _item_key(item: tuple[Any, ...]) -> str:
    """Digest of an item; "" for one that has none, which is never found."""
    try:
        return digest(item)
    except Unnamed:
        return ""


def digest(value: Any) -> str:
    """Digest of numbers, texts, arrays, functions of modules, and of what is made of them.

    Raises Unnamed: something else, such as a function inside a function.
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
        order = "F" if isinstance(value, np.ndarray) and value.flags.f_contiguous and value.ndim > 1 else "C"
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
    elif isinstance(value, partial):
        state.update(b"partial(")
        _feed(state, (value.func, value.args, value.keywords))
    elif is_dataclass(kind):
        state.update(f"{name}(".encode())
        for f in fields(value):
            _feed(state, getattr(value, f.name))
    elif callable(value) and "<" not in getattr(value, "__qualname__", "<") and _is_named(value):
        of = getattr(getattr(value, "__self__", None), "__qualname__", "")
        state.update(f"function:{value.__module__}.{value.__qualname__}{of};".encode())
    else:
        raise Unnamed(name)


def _is_named(function: Any) -> bool:
    """Whether a function is one of a module or of a class, and not of an object."""
    of = getattr(function, "__self__", None)
    return of is None or isinstance(of, type)
