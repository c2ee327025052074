"""Arrays: their types, and those that processes share or that lie on disk where they are large.

A large array is a file of plain numbers, mapped into memory: one state after the other, each written and read as a
whole or by pieces. It needs no library and no packing, views of it are arrays as any, and processes open it by its
name. The file has no name in its folder, so that it is gone with the run, also when that is killed: what a resumed run
begins from are the results in its `store`, where each state is as soon as it is solved.
"""

import math
import mmap
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .machine import free_memory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
#: Real numbers in single precision, and in any.
Singles = NDArray[np.float32]
Floats = NDArray[np.floating]
#: Of a file or a folder.
AnyPath = str | os.PathLike[str]
#: Along x1 and x2: points, lengths, whether a map repeats itself.
Shape = tuple[int, int]
Pair = tuple[float, float]
Periodic = tuple[bool, bool]
#: Along x1 and x2, or the same along both.
Lengths = float | Pair


def reals(values: ArrayLike) -> Array:
    """Values as an array of real numbers."""
    return np.asarray(values, dtype=np.float64)


#: File descriptors of the shared arrays, for each active `sharing`.
_shared: list[list[int]] = []
#: Folder of large arrays, and the memory that a run may take [byte], for each active `storing`.
_stores: list[tuple[Path | None, float]] = []
#: Part of the memory that a run may take above which an array lies on disk.
PART_OF_MEMORY = 1 / 16


@contextmanager
def sharing() -> Iterator[None]:
    """Context in which arrays made by `shared_empty` are shared between processes."""
    _shared.append([])
    try:
        yield
    finally:
        for descriptor in _shared.pop():
            os.close(descriptor)


@contextmanager
def storing(folder: Path | None, memory: float | None = None) -> Iterator[None]:
    """Context in which large arrays made by `shared_empty` lie in a folder; None for that of temporary files.

    memory : that the run may take [byte]; what is free unless less is given.
    """
    _stores.append((folder, math.inf if memory is None else memory))
    try:
        yield
    finally:
        _stores.pop()


def lies_on_disk(size: float) -> bool:
    """Whether `shared_empty` puts an array of so many bytes on disk."""
    return size > PART_OF_MEMORY * min(free_memory(), _stores[-1][1] if _stores else math.inf)


def shared_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """An array of undefined values, as `numpy.empty` gives it; a mapped file where it is large, see `storing`.

    Within `sharing` on Linux, views of it are sent to processes and come back by reference: what a process writes is
    written here. Memory and file are given back with the last view, also when the run is killed.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    on_disk = lies_on_disk(size)
    if not size or not (on_disk or _shared) or (_shared and not hasattr(os, "memfd_create")):
        return np.empty(shape, dtype)
    with suppress(OSError):  # this system has no such files, or no room for more of them
        if not on_disk:
            descriptor = os.memfd_create("femseal")
            _shared[-1].append(descriptor)
            os.ftruncate(descriptor, size)
        else:
            with tempfile.TemporaryFile(dir=_stores[-1][0] if _stores else None) as file:
                # a page of a mapped file for which a disk has no room would end the process
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, size)
                else:
                    os.ftruncate(file.fileno(), size)
                if not _shared:
                    return np.memmap(file, dtype, "r+", shape=shape)
                descriptor = os.dup(file.fileno())
                _shared[-1].append(descriptor)
        # joblib passes views of mapped files by the name of the file
        return np.memmap(f"/proc/{os.getpid()}/fd/{descriptor}", dtype, "r+", shape=shape)
    return np.empty(shape, dtype)


def give_back(array: NDArray[Any]) -> None:
    """Give back the memory of an array that lies in a file: what is in it stays there, and is read again when used."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def one_at_a_time(states: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """The arrays of all states, of which one that lies in a file takes memory while it is used."""
    for state in states:
        yield state
        give_back(states)
