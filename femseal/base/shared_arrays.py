"""Provide arrays that are shared between processes or stored on disk.

A large array, such as the gaps of all contact states, is stored in a file of plain numbers that is mapped into memory.
Such a file requires no further library. Views of the array behave like any other array, and other processes can open
the file by its name. The file has no folder entry and therefore disappears with the run, even if the run is killed. A
resumed run does not need the file: it reads the contact states from its `store`.
"""

from __future__ import annotations

import math
import mmap
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .machine import free_memory

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: File descriptors of the arrays that the innermost `with` block of `sharing` shares; None outside such a block.
_shared: ContextVar[list[int] | None] = ContextVar("shared", default=None)
#: Folder of large arrays and memory limit [byte] of the innermost `with` block of `storing`.
_store: ContextVar[tuple[Path | None, float]] = ContextVar("store", default=(None, math.inf))
#: An array lies on disk if it takes more than this fraction of the memory that a run may use.
PART_OF_MEMORY = 1 / 16


@contextmanager
def sharing() -> Iterator[None]:
    """Make arrays accessible to other processes if `shared_empty` creates them inside the `with` block."""
    previous = _shared.get()
    descriptors: list[int] = []
    _shared.set(descriptors)
    try:
        yield
    finally:
        _shared.set(previous)
        for descriptor in descriptors:
            os.close(descriptor)


@contextmanager
def storing(folder: Path | None, memory: float | None = None) -> Iterator[None]:
    """Inside the `with` block, let `shared_empty` store large arrays in files of a folder.

    folder : folder for the files; None for the system's temporary folder.
    memory : upper limit of the memory that the run may use [byte]; None for no limit besides the free memory.
    """
    previous = _store.get()
    _store.set((folder, math.inf if memory is None else memory))
    try:
        yield
    finally:
        _store.set(previous)


def lies_on_disk(size: float) -> bool:
    """Return whether `shared_empty` stores an array of the given size [byte] on disk."""
    _, limit = _store.get()
    return size > PART_OF_MEMORY * min(free_memory(), limit)


def shared_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Create an array without initial values, like `numpy.empty`; a large array is stored in a file, see `storing`.

    Inside a `with` block of `sharing`, on Linux, other processes receive a view of the array rather than a copy. Values
    that another process writes then appear in this process. When the last view is deleted, the memory and the file of
    the array are released, even if the run is killed.
    """
    import numpy as np  # imported here, so that commands that need no arrays start faster

    size = math.prod(shape) * np.dtype(dtype).itemsize
    on_disk = lies_on_disk(size)
    descriptors = _shared.get()
    is_shared = descriptors is not None
    needs_file = on_disk or is_shared
    cannot_share = is_shared and not hasattr(os, "memfd_create")  # systems other than Linux
    if size == 0 or cannot_share or not needs_file:
        return np.empty(shape, dtype)
    try:
        with _unnamed_file(on_disk) as file:
            _reserve(file, size, on_disk)
            if descriptors is None:
                return np.memmap(file, dtype, "r+", shape=shape)
            descriptor = os.dup(file.fileno())
            descriptors.append(descriptor)
        # joblib only sends the name of the file instead of its content, so the file must be mapped by a name
        return np.memmap(f"/proc/{os.getpid()}/fd/{descriptor}", dtype, "r+", shape=shape)
    except OSError:
        # the system does not support such files, or has no space for another one
        return np.empty(shape, dtype)


def _unnamed_file(on_disk: bool) -> Any:
    """Open a temporary file without a folder entry, either in memory or on disk in the folder of `storing`."""
    if not on_disk:
        return open(os.memfd_create("femseal"), "r+b")
    folder, _ = _store.get()
    return tempfile.TemporaryFile(dir=folder)


def _reserve(file: Any, size: int, on_disk: bool) -> None:
    """Extend an empty file to a given size [byte]; raise OSError if there is not enough space on the disk."""
    if on_disk and hasattr(os, "posix_fallocate"):
        # if the space were not reserved, writing to the array on a full disk would kill the process
        os.posix_fallocate(file.fileno(), 0, size)
    else:
        os.ftruncate(file.fileno(), size)


def give_back(array: NDArray[Any]) -> None:
    """Release the memory of an array that is stored in a file. The next access reads the array from the file again."""
    mapped = getattr(array, "_mmap", None)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def one_at_a_time(states: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield the array of each state, and then release its memory if the states are stored in a file."""
    for state in states:
        yield state
        give_back(states)
