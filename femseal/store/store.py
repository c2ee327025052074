"""Results of stages in a folder. The key of a result is a digest of function, input and versions.

Each process appends its results to a file of its own, so that several processes can share a folder without locks. A
record consists of its size, its key, a checksum and the packed data. If the process is killed while it writes a
record, that record is lost and all others remain readable. Records contain plain data only: whoever changes a file can
falsify results, but cannot run code or reach other folders.

No library does this: an HDF5 file becomes unreadable if the process is killed while it writes, a record of SQLite is
at most 1 GB, and joblib reads pickles.
"""

from __future__ import annotations

import errno
import hashlib
import logging
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from functools import cache, partial
from itertools import tee
from operator import itemgetter
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO, NamedTuple
from uuid import uuid4

from ..base import Mapper, NotKept, Stage, numerical_versions
from ..base.files import opened_plain
from .code import NoDigest
from .digests import digest
from .plain_data import packed, unpacked

log = logging.getLogger("femseal.store")
#: Suffix of the files with results.
SUFFIX = ".results"
#: Head of a record: size of the whole record [byte], key, checksum of key and data.
_HEAD = Struct("<Q16s16s")

Item = tuple[Any, ...]


class _Record(NamedTuple):
    """Place of a record: its file, first byte and size [byte]."""

    path: Path
    start: int
    size: int


class _Pending(NamedTuple):
    """An item whose result has not been returned yet; `item` is None while the mapper computes it."""

    key: bytes
    item: Item | None


class Store:
    """Results of stages in a folder; a context manager that closes its files.

    Parameters
    ----------
    folder : created when the first result is written.
    required : whether a result that cannot be written is an error; otherwise the store stops writing.
    """

    def __init__(self, folder: Path, *, required: bool = True) -> None:
        self.folder = folder
        self._required = required
        self._records: dict[bytes, _Record] = {}
        #: First byte of each file that has not been indexed yet.
        self._ends: dict[Path, int] = {}
        self._files = ExitStack()
        self._opened = cache(lambda path: self._files.enter_context(opened_plain(path)))
        self._path = folder / f"{uuid4().hex}{SUFFIX}"
        self._file: BinaryIO | None = None
        self._is_full = False
        self.look()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *details: object) -> None:
        self._files.close()

    def __len__(self) -> int:
        """Return the number of results that have been found in the folder so far."""
        return len(self._records)

    def look(self) -> None:
        """Look for results that other processes have written."""
        with suppress(OSError):
            paths = self.folder.glob(f"*{SUFFIX}")
            # newer files come later, as they contain replacements of damaged results
            for path in sorted(paths, key=lambda path: path.lstat().st_mtime_ns):
                self._index(path)

    def keys(self, stage: Stage) -> Callable[[Item], bytes]:
        """Return the function that gives the key of an item of a stage, empty for an item without a digest.

        Raises
        ------
        NoDigest : the function of the stage has no digest.
        """
        return partial(_key, digest((numerical_versions(), stage.key or stage.function)))

    def over(self, mapper: Mapper) -> Mapper:
        """Return a mapper that reads the results in the folder, and computes and writes all others once."""

        def map_stage(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            try:
                key_of = self.keys(stage)
            except NoDigest:
                yield from mapper(stage, *iterables)
                return
            pending: deque[_Pending] = deque()
            submitted: set[bytes] = set()

            def items_to_compute() -> Iterator[Item]:
                for item in zip(*iterables, strict=False):
                    key = key_of(item)
                    if key in self._records or key in submitted:
                        pending.append(_Pending(key, item))
                        continue
                    pending.append(_Pending(key, None))
                    if key:
                        submitted.add(key)
                    yield item

            # the mapper takes an iterable for each argument
            copies = tee(items_to_compute(), len(iterables))
            arguments = [map(itemgetter(n), items) for n, items in enumerate(copies)]
            for result in mapper(stage, *arguments):
                while (stored_item := pending[0].item) is not None:
                    yield self._read(pending.popleft().key, stage, stored_item)
                self._keep(pending.popleft().key, result)
                yield result
            while pending:
                key, item = pending.popleft()
                yield self._read(key, stage, item or ())

        return map_stage

    def _index(self, path: Path) -> None:
        """Index the records that were added to a file since it was last read; the last one may be incomplete."""
        start = self._ends.get(path, 0)
        end = path.lstat().st_size
        if start + _HEAD.size > end:
            return
        with suppress(OSError), opened_plain(path) as file:
            while start + _HEAD.size <= end:
                file.seek(start)
                size, key, _ = _HEAD.unpack(file.read(_HEAD.size))
                if start + size > end or size < _HEAD.size:
                    break
                self._records[key] = _Record(path, start, size)
                start += size
        self._ends[path] = start

    def _read(self, key: bytes, stage: Stage, item: Item) -> Any:
        """Read a result; a result that cannot be read is computed again."""
        if key in self._records:
            try:
                return self._data(key)
            except (OSError, ValueError) as error:
                record = self._records.pop(key)
                text = "%s: a result is damaged (%s); it is computed again (%s)"
                log.warning(text, record.path, error, stage.name)
        result = stage.function(*item)
        self._keep(key, result)
        return result

    def _data(self, key: bytes) -> Any:
        """Read the data of a record; ValueError if its checksum is wrong."""
        record = self._records[key]
        file = self._opened(record.path)
        file.seek(record.start)
        content = memoryview(file.read(record.size))
        head, data = content[: _HEAD.size], content[_HEAD.size :]
        if head != _head(key, data):
            raise ValueError("checksum")
        return unpacked(data)

    def _keep(self, key: bytes, result: Any) -> None:
        """Write a result if it has a key and is plain data.

        Raises
        ------
        NotKept : it cannot be written; results that were written before remain.
        """
        if not key or self._is_full:
            return
        try:
            data = packed(result)
        except TypeError:
            return
        try:
            self._records[key] = self._appended(_head(key, data), data)
        except OSError as error:
            self._is_full = True
            if self._required:
                raise self._not_kept(error) from error
            log.warning("results are not kept any more: %s", error)

    def _appended(self, *parts: bytes) -> _Record:
        """Append a record to the file of this process, whole or not at all."""
        if self._file is None:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._file = self._files.enter_context(self._path.open("xb", buffering=0))
        file = self._file
        start = file.tell()
        try:
            for part in parts:
                left = memoryview(part)
                while left:
                    written = file.write(left)
                    left = left[written:]
        except OSError:
            file.truncate(start)
            raise
        self._ends[self._path] = file.tell()
        return _Record(self._path, start, file.tell() - start)

    def _not_kept(self, error: OSError) -> NotKept:
        """Return the error that says how to go on after a result could not be written."""
        is_full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        remedy = "make room" if is_full else "fix the cause"
        return NotKept(
            f"store: a result could not be written ({error}). Earlier results are kept in '{self.folder}' "
            f"({len(self)} of them): {remedy}, then continue the run with --resume."
        )


def _key(stage_digest: str, item: Item) -> bytes:
    """Return the key of an item of a stage, empty without a digest."""
    with suppress(NoDigest):
        return bytes.fromhex(digest((stage_digest, item)))
    return b""


def _head(key: bytes, data: bytes | memoryview) -> bytes:
    """Return the head of a record."""
    checksum = hashlib.blake2b(key, digest_size=16)
    checksum.update(data)
    return _HEAD.pack(_HEAD.size + len(data), key, checksum.digest())
