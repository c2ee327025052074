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

from ..base.files import read_plain, replacing
from ..base.machine import free_memory
from .plain_data import packed, unpacked

#: A shard is written when it has this number of items or bytes, or when this time has passed since the last one [s].
SHARD_ITEMS = 1000
SHARD_BYTES = 64_000_000
SHARD_SECONDS = 10.0
#: Suffix of shards.
SUFFIX = ".shard"


def write_whole(path: Path, data: bytes) -> None:
    """Write a file completely to disk before it gets its name."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def read_shard(path: Path, header: tuple[Any, ...]) -> list[bytes]:
    """The packed items of a shard that begins with a header, all of which can be unpacked.

    Raises
    ------
    OSError, ValueError : there is no such file, it is damaged, or it has another header.
    """
    data = read_plain(path, free_memory())
    size = hashlib.sha256().digest_size
    if hashlib.sha256(data[size:]).digest() != data[:size]:
        raise ValueError("checksum")
    try:
        found, items = unpacked(data[size:])
        for item in items:
            unpacked(item)
    except TypeError as error:
        raise ValueError(str(error)) from None
    if found != header:
        raise ValueError("results of another stage")
    return list(items)


class ShardWriter:
    """Collects items, and writes them as shards.

    Parameters
    ----------
    header : with which the shards begin.
    place : place(items) gives the path of a shard that is written now.
    """

    def __init__(self, header: tuple[Any, ...], place: Callable[[int], Path]) -> None:
        self._header, self._place = header, place
        self._items: list[bytes] = []
        self._size = 0
        self._since = time.monotonic()

    def __len__(self) -> int:
        """Number of items that are in no shard yet."""
        return len(self._items)

    def keep(self, item: Any) -> None:
        """Add an item, and write a shard if it is time.

        Raises
        ------
        TypeError : the item is no plain data.
        OSError : the shard cannot be written.
        """
        self._items.append(packed(item))
        self._size += len(self._items[-1])
        full = len(self._items) >= SHARD_ITEMS or self._size >= SHARD_BYTES
        if full or time.monotonic() - self._since >= SHARD_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the items as a shard; OSError where that fails."""
        if not self._items:
            return
        items, self._items, self._size = self._items, [], 0
        content = packed((self._header, items))
        write_whole(self._place(len(items)), hashlib.sha256(content).digest() + content)
        self._since = time.monotonic()
