"""The machine of a run, which results record but do not depend on, and its free memory."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil


def machine() -> dict[str, str | int]:
    """Processor, cores, memory [byte] and system; entries that the system does not know are left out."""
    found: dict[str, str | int] = {
        "processor": _processor(),
        "system": f"{platform.system()} {platform.release()}",
        "memory_bytes": total_memory(),
    }
    if cores := psutil.cpu_count():
        found["cores"] = cores
    return found


def total_memory() -> int:
    """Memory of this machine [byte]."""
    return int(psutil.virtual_memory().total)


def peak_memory() -> int:
    """Largest memory of this process so far [byte]."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def free_memory() -> float:
    """Memory that processes can get on this machine without swapping [byte]."""
    return float(psutil.virtual_memory().available)


@contextmanager
def within_free_memory() -> Iterator[None]:
    """Context in which asking for more memory than is free now raises MemoryError, where Linux would end the process.

    For reading files that may unpack to any size. On other systems it does nothing.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

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
    """Name of the processor, which Python knows on some systems only."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()
