"""Results of stages in a folder, each found by a digest of its stage's function, its input and the versions in use.

Every process appends to a file of its own, whose records are a key, a checksum and packed data. A kill loses the record
that it interrupts, and nothing else. Records hold data alone: a folder that somebody has changed can give wrong
results, but runs no code and reaches no other folder.

Packed data are a text in JSON with the structure; bytes and the numbers of arrays follow it as they are in memory. A
value may be None, a number, a text, bytes, an array of numbers, or a tuple, list, dictionary or dataclass of femseal
with such values.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import math
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import fields, is_dataclass
from functools import cache, partial
from itertools import tee
from operator import itemgetter
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO, Literal
from uuid import uuid4

import numpy as np

from ..base import (
    Mapper,
    NotKept,
    Stage,
    counted,
    numerical_versions,
)
from ..base.files import opened_plain
from .code import CodeDescription, Unnamed

log = logging.getLogger("femseal.store")
#: Suffix of the files with results.
SUFFIX = ".results"
#: Size of a record [byte], its key, and a checksum of key and data, which follow.
_HEAD = Struct("<Q16s16s")
#: Kinds of the numbers in arrays: truth values, whole numbers, real and complex numbers.
_NUMBERS = "biufc"
#: Bytes of the length of the text, which comes first.
_LENGTH = 8
_PACKAGE = __name__.partition(".")[0]
#: Errors of damaged bytes, besides ValueError.
_DAMAGES = (TypeError, LookupError, AttributeError, RecursionError, OverflowError, MemoryError)


def digest(value: Any) -> str:
    """Digest of plain data, contents of files and code, and of what is made of them.

    Code of users is told apart by what it does, see `femseal.store.code`.

    Raises Unnamed: something else, such as an object of C code, or a file that cannot be read.
    """
    state, size = hashlib.blake2b(digest_size=16), 0
    code = CodeDescription()

    def added(data: bytes) -> int:
        nonlocal size
        state.update(data)
        size += len(data)
        return size

    def named(part: Any) -> Any:
        if isinstance(part, Path):
            return "file", _digest_of_file(part)
        return code(part)

    try:
        state.update(json.dumps(described(value, added, named)).encode())
    except RecursionError:
        raise Unnamed("an object that holds itself") from None
    return state.hexdigest()


def _digest_of_file(path: Path) -> bytes:
    """SHA-256 of the content of a file. Raises Unnamed: it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise Unnamed(str(error)) from None


class Store:
    """Results of stages in a folder, which is made when the first is kept; a context that closes its files.

    required : a result that cannot be written is an error; otherwise results are not kept any more then.
    """

    def __init__(self, folder: Path, *, required: bool = True) -> None:
        self.folder, self._required = folder, required
        #: File of the record of each key, its start and its size [byte].
        self._found: dict[bytes, tuple[Path, int, int]] = {}
        self._ends: dict[Path, int] = {}
        self._files = ExitStack()
        self._opened = cache(lambda path: self._files.enter_context(opened_plain(path)))
        self._path = folder / f"{uuid4().hex}{SUFFIX}"
        self._own: BinaryIO | None = None
        self._full = False
        self.look()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *details: object) -> None:
        self._files.close()

    def __len__(self) -> int:
        """Number of results in the folder, as far as it was looked at."""
        return len(self._found)

    def look(self) -> None:
        """Look for results that other processes have added."""
        with suppress(OSError):
            # what was computed again, as it was damaged, is in a later file
            for path in sorted(
                self.folder.glob(f"*{SUFFIX}"), key=lambda path: path.lstat().st_mtime_ns
            ):
                self._index(path)

    def keys(self, stage: Stage) -> Callable[[tuple[Any, ...]], bytes]:
        """The function that gives the key of an item of a stage; it is empty where the item has no digest.

        Raises Unnamed: the stage has none.
        """
        return partial(_key, digest((numerical_versions(), stage.key or stage.function)))

    def over(self, mapper: Mapper) -> Mapper:
        """The same mapper, but results in the folder are read, and others are computed once and kept."""

        def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            try:
                key_of = self.keys(stage)
            except Unnamed:
                yield from mapper(stage, *iterables)
                return
            # keys of the items under way, each with its item where the result is there, or will be
            waiting: deque[tuple[bytes, tuple[Any, ...] | None]] = deque()
            asked: set[bytes] = set()

            def missing() -> Iterator[tuple[Any, ...]]:
                for item in zip(*iterables, strict=False):
                    key = key_of(item)
                    known = key in self._found or key in asked
                    waiting.append((key, item if known else None))
                    if not known:
                        asked.update([key] if key else [])
                        yield item

            arguments = tee(missing(), len(iterables))
            for result in mapper(
                stage, *(map(itemgetter(n), items) for n, items in enumerate(arguments))
            ):
                while (item := waiting[0][1]) is not None:
                    yield self._read(waiting.popleft()[0], stage, item)
                self._keep(waiting.popleft()[0], result)
                yield result
            while waiting:
                key, item = waiting.popleft()
                yield self._read(key, stage, item or ())

        return mapping

    def _index(self, path: Path) -> None:
        """Note the records that were added to a file; the last one may be incomplete."""
        at, end = self._ends.get(path, 0), path.lstat().st_size
        if at + _HEAD.size > end:
            return
        with suppress(OSError), opened_plain(path) as file:
            while at + _HEAD.size <= end:
                file.seek(at)
                size, key, _ = _HEAD.unpack(file.read(_HEAD.size))
                if at + size > end or size < _HEAD.size:
                    break
                self._found[key] = path, at, size
                at += size
        self._ends[path] = at

    def _read(self, key: bytes, stage: Stage, item: tuple[Any, ...]) -> Any:
        """A result that was kept; one that cannot be read is computed again."""
        if key in self._found:
            try:
                return self._data(key)
            except (OSError, ValueError) as error:
                text = "%s: a result is damaged (%s); it is computed again (%s)"
                log.warning(text, self._found.pop(key)[0], error, stage.name)
        result = stage.function(*item)
        self._keep(key, result)
        return result

    def _data(self, key: bytes) -> Any:
        path, start, size = self._found[key]
        file = self._opened(path)
        file.seek(start)
        found = memoryview(file.read(size))
        data = found[_HEAD.size :]
        if found[: _HEAD.size] != _head(key, data):
            raise ValueError("checksum")
        return unpacked(data)

    def _keep(self, key: bytes, result: Any) -> None:
        """Append a result to the file of this process, unless it is no plain data.

        Raises NotKept: it cannot be written; what was written before stays.
        """
        if not key or self._full:
            return
        try:
            data = packed(result)
        except TypeError:
            return
        try:
            start, end = self._appended(_head(key, data), data)
        except OSError as error:
            self._full = True
            if not self._required:
                log.warning("results are not kept any more: %s", error)
                return
            todo = "make room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that"
            raise NotKept(
                f"store: {error}; {counted(len(self), 'result')} are kept in '{self.folder}': {todo}, then a run with "
                "--resume goes on from there"
            ) from error
        self._found[key] = self._path, start, end - start

    def _appended(self, *parts: bytes) -> tuple[int, int]:
        """Append a record to the file of this process, whole or not at all."""
        if self._own is None:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._own = self._files.enter_context(self._path.open("xb", buffering=0))
        start = self._own.tell()
        try:
            for part in parts:
                left = memoryview(part)
                while left:
                    left = left[self._own.write(left) :]
        except OSError:
            self._own.truncate(start)
            raise
        end = self._ends[self._path] = self._own.tell()
        return start, end


def _key(base: str, item: tuple[Any, ...]) -> bytes:
    with suppress(Unnamed):
        return bytes.fromhex(digest((base, item)))
    return b""


def _head(key: bytes, data: bytes | memoryview) -> bytes:
    """What precedes the data of a record."""
    checksum = hashlib.blake2b(key, digest_size=16)
    checksum.update(data)
    return _HEAD.pack(_HEAD.size + len(data), key, checksum.digest())


def packed(value: Any) -> bytes:
    """The bytes of a value.

    Raises TypeError: something in the value is not plain data.
    """
    content = bytearray()

    def kept(data: bytes) -> int:
        content.extend(data)
        return len(content) - len(data)

    text = json.dumps(described(value, kept)).encode()
    return b"".join([len(text).to_bytes(_LENGTH, "little"), text, content])


def described(
    value: Any, kept: Callable[[bytes], int], named: Callable[[Any], Any] | None = None
) -> Any:
    """A value as nested lists, numbers and texts; bytes of arrays go to `kept`, which returns a number for their place.

    named : gives what stands for a value that is no plain data.

    Raises TypeError: something is no plain data, and nothing stands for it.
    """
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind in (tuple, list):
        return [kind.__name__, *(described(v, kept, named) for v in value)]
    if kind is dict:
        return [
            "dict",
            *([described(k, kept, named), described(v, kept, named)] for k, v in value.items()),
        ]
    if kind is bytes:
        return ["bytes", len(value), kept(value)]
    if isinstance(value, np.generic) and value.dtype.kind in _NUMBERS:
        return ["number", value.dtype.str, kept(value.tobytes())]
    if isinstance(value, np.ndarray) and value.dtype.kind in _NUMBERS:
        # sums over an array depend on its order in memory
        order: Literal["C", "F"] = "F" if value.flags.fnc else "C"
        return ["array", value.dtype.str, list(value.shape), order, kept(value.tobytes(order))]
    if is_dataclass(kind) and kind.__module__.partition(".")[0] == _PACKAGE:
        values = (described(getattr(value, f.name), kept, named) for f in fields(kind))
        return [f"{kind.__module__}.{kind.__qualname__}", *values]
    if named is not None:
        return described(named(value), kept, named)
    raise TypeError(f"a {kind.__name__} is no plain data")


def unpacked(data: bytes | memoryview) -> Any:
    """The value of the bytes; arrays are copies. No constructor is called.

    Raises ValueError: the bytes are damaged, or of other classes than those in use.
    """
    try:
        length = int.from_bytes(data[:_LENGTH], "little")
        content = memoryview(data)[_LENGTH:]
        return _value(json.loads(bytes(content[:length])), content[length:])
    except _DAMAGES as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


def _value(tree: Any, content: memoryview) -> Any:
    """The value that `described` described."""
    if isinstance(tree, dict):
        raise ValueError("no description of a value")
    if not isinstance(tree, list):
        return tree
    kind, *parts = tree
    if kind == "bytes":
        size, start = parts
        return _array(content, "u1", (size,), "C", start).tobytes()
    if kind == "number":
        name, start = parts
        return _array(content, name, (), "C", start)[()]
    if kind == "array":
        return _array(content, *parts).copy("K")
    if kind == "dict":
        return {_value(key, content): _value(value, content) for key, value in parts}
    values = [_value(part, content) for part in parts]
    if kind in ("list", "tuple"):
        return values if kind == "list" else tuple(values)
    return _instance(kind, values)


def _array(content: memoryview, name: str, shape: Any, order: Any, start: int) -> Any:
    """An array of numbers that begin somewhere in the content; TypeError where that is too short."""
    numbers = np.dtype(name)
    if numbers.kind not in _NUMBERS or min((start, *shape)) < 0:
        raise ValueError(f"no array of numbers: {numbers}, {shape}, {start}")
    size = math.prod(shape) * numbers.itemsize
    return np.ndarray(shape, numbers, content[start : start + size] if size else None, order=order)


def _instance(name: str, values: list[Any]) -> Any:
    """A dataclass of femseal with these fields; only modules that are in use are looked at."""
    module, _, title = name.rpartition(".")
    kind = vars(sys.modules[module]).get(title) if module.partition(".")[0] == _PACKAGE else None
    if not (isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module):
        raise ValueError(f"'{name[:80]}' is no class of data")
    made = object.__new__(kind)
    vars(made).update(zip((field.name for field in fields(kind)), values, strict=True))
    return made
