"""What a run was computed on, and the memory it took: told with the results, never used by them; what is free."""

from __future__ import annotations

import os
import platform
import sys
from contextlib import suppress
from pathlib import Path


def machine() -> dict[str, str | int]:
    """Processor, cores, memory [byte] and system; what the system does not tell is left out."""
    found: dict[str, str | int] = {"processor": _processor(), "system": f"{platform.system()} {platform.release()}"}
    if cores := os.cpu_count():
        found["cores"] = cores
    with suppress(AttributeError, ValueError, OSError):  # not on Windows
        found["memory_bytes"] = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return found


def peak_memory() -> int | None:
    """Largest memory of this process so far [byte]; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # on Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def free_memory() -> float:
    """Memory that is free on this machine [byte]; 4 GB where that cannot be told."""
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError, AttributeError):
        return 4e9


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()
