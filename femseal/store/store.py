"""Store the results of stages in a folder.

The key of a result is a digest of three things: the function of the stage, its input, and the package versions. Each
process appends its results to a separate file, so that several processes can share a folder without locks. A record in
a file consists of its size, its key, a checksum and the packed data. If the process is killed while a record is being
written, only this record is lost. Records contain nothing but plain data. A manipulated file can therefore contain
wrong results, but reading the file cannot run code or access other folders.

Existing libraries are less suitable. An HDF5 file becomes unreadable if the process is killed while writing. SQLite is
limited to records of 1 GB. joblib reads pickles, which can run code.
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
from .digests import NoDigest, digest
from .plain_data import packed, unpacked

log = logging.getLogger("femseal.store")
#: Suffix of the files with results.
SUFFIX = ".results"
#: Layout of the header of a record: size of the whole record [byte], key, checksum of key and data.
_HEAD = Struct("<Q16s16s")

Item = tuple[Any, ...]


class _Record(NamedTuple):
    """Where a record is stored: the file, the position of the first byte, and the size [byte]."""

    path: Path
    start: int
    size: int


class _Pending(NamedTuple):
    """An item whose result has not been yielded yet.

    key : key of the result.
    item : the item if its result is in the store; None if the mapper computes the result of the item.
    """

    key: bytes
    item: Item | None


class Store:
    """Store the results of stages in a folder.

    If the store is used as a context manager, its files are closed at the end of the `with` block.

    Parameters
    ----------
    folder : folder of the results, which is created when the first result is written.
    required : whether an error is raised if a result cannot be written. With False, a warning is logged instead, and no
        further results are written.
    """

    def __init__(self, folder: Path, *, required: bool = True) -> None:
        self.folder = folder
        self._required = required
        self._records: dict[bytes, _Record] = {}
        #: Number of bytes of each file that have been indexed.
        self._indexed: dict[Path, int] = {}
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
        """Return the number of results found in the folder or written to it so far."""
        return len(self._records)

    def look(self) -> None:
        """Search the folder for results that other processes have written."""
        with suppress(OSError):
            paths = self.folder.glob(f"*{SUFFIX}")
            # newer files are indexed after older files, because a newer result with the same key replaces a damaged
            # result
            for path in sorted(paths, key=lambda path: path.lstat().st_mtime_ns):
                self._index(path)

    def keys(self, stage: Stage) -> Callable[[Item], bytes]:
        """Return a function that computes the key of an item of a stage.

        If no digest can be computed for an item, the key of the item is empty.

        Raises
        ------
        NoDigest : no digest can be computed for the function of the stage.
        """
        return partial(_key, digest((numerical_versions(), stage.key or stage.function)))

    def over(self, mapper: Mapper) -> Mapper:
        """Return a mapper that reads stored results, and uses `mapper` to compute the others, which it then stores."""
        return partial(self._map, mapper)

    def _map(self, mapper: Mapper, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
        """Yield the results of a stage in the order of its items.

        Only items without a stored result are passed to `mapper`. A mapper may request many items before it yields its
        first result. To yield all results in order, the method keeps all requested items in the queue `pending`.
        """
        try:
            key_of = self.keys(stage)
        except NoDigest:
            yield from mapper(stage, *iterables)
            return
        # requested items whose results have not been yielded yet, in their order
        pending: deque[_Pending] = deque()
        # the generator fills `pending` whenever the mapper requests an item
        items = self._items_to_compute(zip(*iterables, strict=False), key_of, pending)
        # the mapper takes one iterable for each argument of the stage
        copies = tee(items, len(iterables))
        arguments = [map(itemgetter(n), copy) for n, copy in enumerate(copies)]
        for result in mapper(stage, *arguments):
            # before the computed item, the queue may contain items with stored results
            yield from self._stored_results(stage, pending)
            computed = pending.popleft()
            self._write(computed.key, result)
            yield result
        # items with stored results after the last computed item
        yield from self._stored_results(stage, pending)

    def _items_to_compute(
        self, items: Iterable[Item], key_of: Callable[[Item], bytes], pending: deque[_Pending]
    ) -> Iterator[Item]:
        """Yield the items without a stored result, whose results must be computed.

        items : all items of the stage.
        key_of : function that returns the key of an item.
        pending : queue to which every item is appended, with or without a stored result.
        """
        submitted: set[bytes] = set()  # keys of the results that are being computed
        for item in items:
            key = key_of(item)
            if key in self._records or key in submitted:
                # the result is stored, or will be stored before its turn comes
                pending.append(_Pending(key, item))
                continue
            pending.append(_Pending(key, None))
            if key:
                submitted.add(key)
            yield item

    def _stored_results(self, stage: Stage, pending: deque[_Pending]) -> Iterator[Any]:
        """Remove the items with stored results from the front of the queue, and yield the stored results."""
        while pending and pending[0].item is not None:
            stored = pending.popleft()
            yield self._read(stored.key, stage, stored.item or ())

    def _index(self, path: Path) -> None:
        """Index the records that were added to a file since the last call. Skip an incomplete record at the end."""
        start = self._indexed.get(path, 0)
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
        self._indexed[path] = start

    def _read(self, key: bytes, stage: Stage, item: Item) -> Any:
        """Read a stored result. If the stored result is damaged, compute the item again."""
        if key in self._records:
            try:
                return self._stored_data(key)
            except (OSError, ValueError) as error:
                record = self._records.pop(key)
                text = "%s: a result is damaged (%s); it is computed again (%s)"
                log.warning(text, record.path, error, stage.name)
        result = stage.function(*item)
        self._write(key, result)
        return result

    def _stored_data(self, key: bytes) -> Any:
        """Read the data of a record; raise ValueError if the checksum is wrong."""
        record = self._records[key]
        file = self._opened(record.path)
        file.seek(record.start)
        content = memoryview(file.read(record.size))
        header, data = content[: _HEAD.size], content[_HEAD.size :]
        if header != _head(key, data):
            raise ValueError("checksum")
        return unpacked(data)

    def _write(self, key: bytes, result: Any) -> None:
        """Write a result to the file of this process.

        Results without a key, and results that are not plain data, are not written.

        Raises
        ------
        NotKept : the result cannot be written. All earlier results remain in the folder.
        """
        if not key or self._is_full:
            return
        try:
            data = packed(result)
        except TypeError:
            return
        try:
            self._records[key] = self._append(_head(key, data), data)
        except OSError as error:
            self._is_full = True
            if self._required:
                raise self._not_kept(error) from error
            log.warning("results are not kept any more: %s", error)

    def _append(self, *parts: bytes) -> _Record:
        """Append a record to the results file of this process. If an error occurs, the file is left as it was."""
        if self._file is None:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._file = self._files.enter_context(self._path.open("xb", buffering=0))
        file = self._file
        start = file.tell()
        try:
            for part in parts:
                # an unbuffered file may write fewer bytes than requested
                remaining = memoryview(part)
                while remaining:
                    n_written = file.write(remaining)
                    remaining = remaining[n_written:]
        except OSError:
            file.truncate(start)
            raise
        self._indexed[self._path] = file.tell()
        return _Record(self._path, start, file.tell() - start)

    def _not_kept(self, error: OSError) -> NotKept:
        """Make the error for a result that could not be written, with a message on how to continue."""
        is_full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        remedy = "make room" if is_full else "fix the cause"
        return NotKept(
            f"store: a result could not be written ({error}). Earlier results are kept in '{self.folder}' "
            f"({len(self)} of them): {remedy}, then continue the run with --resume."
        )


def _key(stage_digest: str, item: Item) -> bytes:
    """Compute the key of an item of a stage; the key is empty if no digest can be computed for the item."""
    with suppress(NoDigest):
        return bytes.fromhex(digest((stage_digest, item)))
    return b""


def _head(key: bytes, data: bytes | memoryview) -> bytes:
    """Return the header of a record: the size of the record, its key, and a checksum of key and data."""
    checksum = hashlib.blake2b(key, digest_size=16)
    checksum.update(data)
    return _HEAD.pack(_HEAD.size + len(data), key, checksum.digest())
