"""Results of stages on disk: shards, files of packed items that are complete, with a checksum, or not there.

Shards hold data alone, see `plain_data`: a folder that somebody has changed can give wrong results, but runs no code
and reaches no other folder. Only the versions that wrote them read them back.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..base import free_memory, read_plain, replacing
from .plain_data import packed, unpacked

#: A shard is written when it has this number of items or bytes, or when this time has passed since the last one [s].
#: Those of fewer are merged while a stage goes on, so that a folder has few files however long it takes.
SHARD_ITEMS = 10_000
SHARD_BYTES = 128_000_000
SHARD_SECONDS = 10.0
#: Suffix of shards.
SUFFIX = ".shard"


def write_whole(path: Path, *data: bytes) -> None:
    """Write a file completely to disk before it gets its name."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(data)
        file.flush()
        os.fsync(file.fileno())


def write_shard(path: Path, header: tuple[Any, ...], items: list[bytes]) -> int:
    """Write packed items as a shard that begins with a header and its own name; its number of bytes.

    Raises OSError: the shard cannot be written.
    """
    content = packed(((*header, path.stem), items))
    write_whole(path, hashlib.sha256(content).digest(), content)
    return len(content)


def read_shard(path: Path, header: tuple[Any, ...]) -> list[bytes]:
    """The packed items of a shard that begins with a header and its own name; unpacking finds what is wrong in them.

    Raises OSError, ValueError: there is no such file, it is damaged, or it has another header.
    """
    data = memoryview(read_plain(path, free_memory()))
    size = hashlib.sha256().digest_size
    if hashlib.sha256(data[size:]).digest() != data[:size]:
        raise ValueError("checksum")
    try:
        found, items = unpacked(data[size:])
    except TypeError as error:
        raise ValueError(str(error)) from None
    if found != (*header, path.stem):
        raise ValueError("results of another stage")
    return list(items)


class ShardWriter:
    """Collects items, and writes them as shards.

    header : with which the shards begin.
    place : place(items) gives the path of a shard of the items up to the last one that was kept.
    merge : make one shard of several small ones, which nobody else may be reading.
    """

    def __init__(self, header: tuple[Any, ...], place: Callable[[int], Path], merge: bool = False) -> None:
        self._header, self._place, self._merge = header, place, merge
        self._items: list[bytes] = []
        self._size = 0
        # path, items and bytes of those that the next one may be merged with, in order
        self._before: list[tuple[Path, int, int]] = []
        self._since = time.monotonic()

    def __len__(self) -> int:
        """Number of items that are in no shard yet."""
        return len(self._items)

    def keep(self, item: Any) -> None:
        """Add an item, and write a shard if it is time.

        Raises TypeError: the item is no plain data.
        OSError : the shard cannot be written.
        """
        self._items.append(packed(item))
        self._size += len(self._items[-1])
        full = len(self._items) >= SHARD_ITEMS or self._size >= SHARD_BYTES
        if full or time.monotonic() - self._since >= SHARD_SECONDS:
            self.flush()

    def follow(self, path: Path, items: int) -> None:
        """Note a shard of the items before the next one, which may become a part of a larger one."""
        self._before.append((path, items, path.stat().st_size))

    def flush(self, last: bool = False) -> None:
        """Write the items as a shard; OSError where that fails.

        Where shards are merged, those before it become a part of it that have no more items, so that each item is
        written a few times at most; with the `last` items all that fit.
        """
        merged, older = self._merged(last)
        if not self._items and len(merged) < 2:
            return
        items, self._items, self._size = older + self._items, [], 0
        path = self._place(len(items))
        size = write_shard(path, self._header, items)
        self._before[len(self._before) - len(merged) :] = [(path, len(items), size)]
        for old in merged:
            old.unlink(missing_ok=True)
        self._since = time.monotonic()

    def _merged(self, last: bool) -> tuple[list[Path], list[bytes]]:
        """The shards before the items that become a part of theirs, and what is in them; none if one is damaged."""
        count, size, found = len(self._items), self._size, 0
        for _, items, content in reversed(self._before) if self._merge else ():
            if not (last or items <= count) or count + items > SHARD_ITEMS or size + content > SHARD_BYTES:
                break
            count, size, found = count + items, size + content, found + 1
        paths = [path for path, *_ in self._before[len(self._before) - found :]]
        try:
            return paths, [item for path in paths for item in read_shard(path, self._header)]
        except (OSError, ValueError):
            return [], []
