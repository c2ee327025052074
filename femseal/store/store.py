"""Results of stages in a folder, each found by a digest of its stage's function, its input and the versions in use.

Every process appends to a file of its own, whose records are a key, a checksum and packed data. A kill loses the record
that it interrupts, and nothing else. Records hold data alone, see `plain_data`: a folder that somebody has changed can
give wrong results, but runs no code and reaches no other folder. A run that was ended has its store in the output
folder, with what its results depend on, so that it can be resumed.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from itertools import tee
from operator import itemgetter
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO
from uuid import uuid4

from ..base import (
    FemsealError,
    InputError,
    Mapper,
    NotKept,
    Stage,
    counted,
    numerical_versions,
    read_plain,
    replacing,
    shortened,
)
from ..base.files import opened_plain
from .plain_data import described, packed, unpacked

log = logging.getLogger("femseal.store")
#: Suffix of the files with results.
SUFFIX = ".results"
#: Size of a record [byte], its key, and a checksum of key and data, which follow.
_HEAD = Struct("<Q16s16s")
#: Subfolder of the output folder.
FOLDER = ".checkpoint"
MANIFEST = "manifest.json"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e8
#: Changed keys that a message names.
_MOST_CHANGES = 20


class Unnamed(TypeError):
    """A value has no digest."""


def digest(value: Any) -> str:
    """Digest of plain data, contents of files, functions of modules, and of what is made of them.

    Raises Unnamed: something else, such as a function inside a function, or a file that cannot be read.
    """
    state, size = hashlib.blake2b(digest_size=16), 0

    def added(data: bytes) -> int:
        nonlocal size
        state.update(data)
        size += len(data)
        return size

    state.update(json.dumps(described(value, added, _named)).encode())
    return state.hexdigest()


def _named(value: Any) -> Any:
    """What stands for a value that is no plain data in a digest."""
    name = getattr(value, "__qualname__", "<")
    of = getattr(value, "__self__", None)
    if isinstance(value, Path):
        try:
            with value.open("rb") as file:
                return "file", hashlib.file_digest(file, "sha256").digest()
        except OSError as error:
            raise Unnamed(str(error)) from None
    if isinstance(value, partial):
        return "partial", value.func, value.args, value.keywords
    if isinstance(value, tuple | list):
        return type(value).__qualname__, *value
    if is_dataclass(value) and not isinstance(value, type):
        kind = type(value)
        return kind.__module__, kind.__qualname__, *(getattr(value, f.name) for f in fields(value))
    # a function of a module or of a class, and not of an object
    if callable(value) and "<" not in name and (of is None or isinstance(of, type)):
        return "function", value.__module__, name, getattr(of, "__qualname__", "")
    raise Unnamed(type(value).__qualname__)


@dataclass(frozen=True)
class _Record:
    """Where the data of a result begin, and their size [byte]."""

    path: Path
    start: int
    size: int


class Store:
    """Results of stages in a folder, which is made when the first is kept; a context that closes its files.

    required : a result that cannot be written is an error; otherwise results are not kept any more then.
    """

    def __init__(self, folder: Path, *, required: bool = True) -> None:
        self.folder, self._required = folder, required
        self._found: dict[bytes, _Record] = {}
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

    def __contains__(self, key: bytes) -> bool:
        return key in self._found

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
                self._found[key] = _Record(path, at, size)
                at += size
        self._ends[path] = at

    def _read(self, key: bytes, stage: Stage, item: tuple[Any, ...]) -> Any:
        """A result that was kept; one that cannot be read is computed again."""
        record = self._found.get(key)
        if record is not None:
            try:
                return self._data(key, record)
            except (OSError, ValueError) as error:
                text = "%s: a result is damaged (%s); it is computed again (%s)"
                log.warning(text, record.path, error, stage.name)
                del self._found[key]
        result = stage.function(*item)
        self._keep(key, result)
        return result

    def _data(self, key: bytes, record: _Record) -> Any:
        file = self._opened(record.path)
        file.seek(record.start)
        found = memoryview(file.read(record.size))
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
            self._found[key] = self._appended(_head(key, data), data)
        except OSError as error:
            self._full = True
            if self._required:
                raise self._failure(error) from error
            log.warning("results are not kept any more: %s", error)

    def _appended(self, *parts: bytes) -> _Record:
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
        return _Record(self._path, start, end - start)

    def _failure(self, error: OSError) -> NotKept:
        """What to say of a store that cannot be written: what is kept, and what to do."""
        todo = "make room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that"
        return NotKept(
            f"store: {error}; {counted(len(self), 'result')} are kept in '{self.folder}': {todo}, then a run with "
            "--resume goes on from there"
        )


def _key(base: str, item: tuple[Any, ...]) -> bytes:
    with suppress(Unnamed):
        return bytes.fromhex(digest((base, item)))
    return b""


def _head(key: bytes, data: bytes | memoryview) -> bytes:
    """What precedes the data of a record."""
    checksum = hashlib.blake2b(key, digest_size=16)
    checksum.update(data)
    return _HEAD.pack(_HEAD.size + len(data), key, checksum.digest())


def resumable(output: Path, identity: dict[str, Any]) -> bool:
    """Check whether the output folder has the store of a run of this identity; nothing is written.

    output : the output folder.
    identity : everything on which the bits of the results depend, as nested plain data.

    Raises InputError: its manifest is unreadable or of another identity; every changed key is named with both
    values.
    """
    path = store_folder(output) / MANIFEST
    try:
        former = json.loads(read_plain(path, _LARGEST_MANIFEST).decode())
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError) as error:
        given = f"'{path}', which cannot be read ({error})"
        expected = f"an intact file; remove '{path.parent}' to start anew"
        raise InputError("resume", given, expected) from None
    old, new = _flat(former), _flat(_plain(identity))
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if changed:
        lines = [
            f"{shortened(key)}: was {shortened(old.get(key, 'not given'))}, is {shortened(new.get(key, 'not given'))}"
            for key in changed[:_MOST_CHANGES]
        ]
        if more := changed[_MOST_CHANGES:]:
            lines.append(counted(len(more), "more key"))
        expected = (
            f"that of the same case, files and versions; remove '{path.parent}' to start anew"
        )
        raise InputError(
            "resume", "an unfinished run of another case", "\n".join([expected, *lines])
        )
    return True


def refuse_unfinished(output: Path, name: str = FOLDER) -> None:
    """Raise InputError if the output folder has results of an unfinished run, in a folder of this name."""
    if any(store_folder(output, name).glob(f"*{SUFFIX}")):
        given = f"'{output}', which holds an unfinished run"
        expected = f"--resume to go on, or another folder; to start anew, remove '{output / name}'"
        raise InputError("output", given, expected)


def remove_run(output: Path) -> None:
    """Remove the store from the output folder, if there is one.

    Raises FemsealError: it could not be removed.
    """
    folder = store_folder(output)
    try:
        # without its manifest a run is never resumed, even if other files remain
        (folder / MANIFEST).unlink(missing_ok=True)
        if folder.exists():
            shutil.rmtree(folder)
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be removed ({error.strerror})") from error


def store_folder(output: Path, name: str = FOLDER) -> Path:
    """The folder of the store, which need not exist; one that lies elsewhere is not touched."""
    folder = output / name
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError("output", f"'{folder}', which is a link or a file", "a folder, or none")
    return folder


def begin_run(output: Path, identity: dict[str, Any]) -> None:
    """Write down what the results of a run in an output folder depend on.

    Raises FemsealError: the folder cannot be written.
    """
    folder = store_folder(output)
    text = json.dumps(_plain(identity), indent=1, ensure_ascii=False)
    try:
        folder.mkdir(exist_ok=True)
        with replacing(folder / MANIFEST) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be written ({error.strerror})") from error


def _plain(identity: dict[str, Any]) -> Any:
    """Data as JSON returns it, with lists in place of tuples."""
    return json.loads(json.dumps(identity))


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys; lists of plain values stay whole."""
    if isinstance(value, dict) or (
        isinstance(value, list) and any(isinstance(v, dict) for v in value)
    ):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return {
            k: v
            for name, part in pairs
            for k, v in _flat(part, f"{key}.{name}" if key else str(name)).items()
        }
    return {key: value}
