"""Results of stages that several runs have in common, kept in a folder and told apart by all that goes into them.

An item is found again if its stage does the same with the same numbers: the contact of a face is solved once for all
fluids, and a library of windows once for all lengths of seal, without a list of what depends on what. The folder is
read by the program that wrote it, not passed on.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import NotKept
from ..base.provenance import numerical_versions
from ..base.stage import Mapper, Stage
from .plain_data import packed, unpacked

log = logging.getLogger("femseal.execution.shared_stages")


class Unnamed(TypeError):
    """A value has no digest."""


@dataclass(frozen=True)
class _Place:
    """Bytes of a result in a file."""

    path: Path
    start: int
    size: int

    def read(self) -> Any:
        try:
            with self.path.open("rb") as file:
                file.seek(self.start)
                return unpacked(file.read(self.size))
        except (OSError, ValueError) as error:
            text = f"shared results: '{self.path}' cannot be read ({error}); remove '{self.path.parent}', then --resume"
            raise NotKept(text) from error


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
            kept = self._kept(base)
            waiting: deque[_Place | str] = deque()

            def missing() -> Iterator[tuple[Any, ...]]:
                for item in zip(*iterables, strict=False):
                    key = _item_key(item)
                    waiting.append(kept.get(key, key))
                    if key not in kept:
                        yield item

            writer = _Writer(self._folder, base)
            computed = iter(mapper(replace(stage, function=partial(_spread, stage.function)), missing()))
            try:
                for result in computed:
                    while isinstance(place := waiting.popleft(), _Place):
                        yield place.read()
                    writer.keep(place, result)
                    yield result
                while waiting:
                    place = waiting.popleft()
                    assert isinstance(place, _Place)
                    yield place.read()
            finally:
                writer.close()

        return mapping

    def _kept(self, base: str) -> dict[str, _Place]:
        found: dict[str, _Place] = {}
        for index in sorted(self._folder.glob(f"{base}-*.json")):
            with suppress(OSError, ValueError):
                entries = json.loads(index.read_text(encoding="utf-8"))
                found |= {key: _Place(index.with_suffix(".data"), *place) for key, place in entries.items()}
        return found


def _spread(function: Callable[..., Any], item: tuple[Any, ...]) -> Any:
    return function(*item)


def _item_key(item: tuple[Any, ...]) -> str:
    """Digest of an item; "" for one that has none, which is never found."""
    try:
        return digest(item)
    except Unnamed:
        return ""


class _Writer:
    """Writes results behind each other into a file, and at the end the index that makes them found."""

    def __init__(self, folder: Path, base: str) -> None:
        self._folder, self._base = folder, base
        self._file: Any = None
        self._index: dict[str, tuple[int, int]] = {}
        self._full = False

    def keep(self, key: str, result: Any) -> None:
        """Write a result, unless it is no plain data or the disk is full: then it is only not shared."""
        if not key or self._full:
            return
        try:
            content = packed(result)
            if self._file is None:
                self._folder.mkdir(parents=True, exist_ok=True)
                handle, self._name = tempfile.mkstemp(prefix=f"{self._base}-", suffix=".data", dir=self._folder)
                self._file = os.fdopen(handle, "wb")
            start = self._file.tell()
            self._file.write(content)
            self._index[key] = (start, len(content))
        except TypeError:
            return
        except OSError as error:
            self._full = True
            log.warning("results are not shared with other runs any more: %s", error)

    def close(self) -> None:
        """Write the index."""
        if self._file is None:
            return
        try:
            self._file.close()
            if not self._full:
                Path(self._name).with_suffix(".json").write_text(json.dumps(self._index), encoding="utf-8")
        except OSError as error:
            log.warning("results are not shared with other runs: %s", error)


def digest(value: Any) -> str:
    """Digest of numbers, texts, arrays, functions of modules, and of what is made of them.

    Raises
    ------
    Unnamed : something else, such as a function inside a function.
    """
    state = hashlib.blake2b(digest_size=16)
    _feed(state, value)
    return state.hexdigest()


def _feed(state: Any, value: Any) -> None:
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
