"""Arrays that the processes of a parallel map read and write by reference."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: File descriptors of the shared arrays, for each active `sharing`.
_shared: list[list[int]] = []


@contextmanager
def sharing() -> Iterator[None]:
    """Context in which arrays made by `shared_empty` are shared between processes."""
    _shared.append([])
    try:
        yield
    finally:
        for descriptor in _shared.pop():
            os.close(descriptor)


def shared_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """An array of undefined values, as `numpy.empty` gives it.

    Within `sharing` on Linux, views of it are sent to processes and come back by reference: what a process writes is
    written here. The memory is given back with the last view, also when the run is killed.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if not _shared or not size or not hasattr(os, "memfd_create"):
        return np.empty(shape, dtype)
    try:
        descriptor = os.memfd_create("femseal")
        _shared[-1].append(descriptor)
        os.ftruncate(descriptor, size)
        # joblib passes views of mapped files by the name of the file
        return np.memmap(f"/proc/{os.getpid()}/fd/{descriptor}", dtype, "r+", shape=shape)
    except OSError:  # this system has no such files, or allows no more of them
        return np.empty(shape, dtype)
