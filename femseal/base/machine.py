"""Describe the machine, and measure and limit the memory of this process."""

from __future__ import annotations

import platform
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil


def machine() -> dict[str, str | int]:
    """Return the name of the processor, the number of cores, the memory [byte] and the operating system, if known."""
    description: dict[str, str | int] = {
        "processor": _processor(),
        "system": f"{platform.system()} {platform.release()}",
        "memory_bytes": psutil.virtual_memory().total,
    }
    cores = psutil.cpu_count()
    if cores:
        description["cores"] = cores
    return description


def peak_memory() -> int:
    """Return the peak memory use of this process so far [byte]."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # in bytes on macOS, in KiB on Linux
    return peak if sys.platform == "darwin" else 1024 * peak


def free_memory() -> float:
    """Return the memory that is available to processes on this machine without swapping [byte]."""
    return float(psutil.virtual_memory().available)


#: Lock held by the thread that limits the memory of the process. The same thread can acquire it again in a nested
#: block.
_limiting = threading.RLock()


@contextmanager
def within_free_memory() -> Iterator[None]:
    """Raise MemoryError if the code inside a `with` block requests more memory than is free at its beginning.

    Without a limit, Linux would kill a process that uses too much memory. The limit matters when compressed files of
    unknown uncompressed size are read. On operating systems other than Linux, memory is not limited.

    Until the block ends, the limit applies to the address space of the whole process (RLIMIT_AS). Requests by other
    threads, including threads of other libraries, can therefore fail as well. Processes that are started inside the
    block inherit the limit.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    # the limit applies to the whole process, so only one thread at a time may set and remove it
    with _limiting:
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = psutil.Process().memory_info().vms + int(free_memory())
        if soft != resource.RLIM_INFINITY:
            limit = min(limit, soft)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _processor() -> str:
    """Return the name of the processor; on Linux it is read from /proc/cpuinfo."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()
