"""What the benchmarks share: processes of their own, the machine, tables, the report beside a script."""

from __future__ import annotations

import ctypes
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


def call(script: str, arguments: list[str], threads: int) -> Any:
    """A script again, in a process of its own with that many threads; its last line of output as JSON."""
    environment = os.environ | {"OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}
    done = subprocess.run(
        [sys.executable, script, *arguments], env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def machine(packages: dict[str, str]) -> str:
    """Date, processor and versions; packages by the name to print."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.split(":")[1].strip() for line in lines if "model name" in line), "unknown processor")
    import femseal

    versions = [f"femseal {femseal.__version__}"]
    for label, package in packages.items():
        try:
            versions.append(f"{label} {version(package)}")
        except PackageNotFoundError:
            versions.append(f"no {label}")
    processor = f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return f"{date.today()}, {processor}, {', '.join(versions)}"


def save_report(script: str, title: str, text: str) -> None:
    """Write the report beside a script, by which the page of the documentation about it is made."""
    path = Path(script)
    report = f"# {title}\n\nWritten by `{path.name}`.\n\n{text}\n"
    path.with_suffix(".md").write_text(report, encoding="utf-8")


def rows(head: list[str], cells: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *cells]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def kept(task: dict[str, Any], names: Iterable[str], path: Path | None, compute: Callable[[], dict[str, Any]]) -> Any:
    """The record with the task's values of these names from a file of records, else computed, printed and appended."""
    known = [json.loads(line) for line in path.read_text().splitlines()] if path and path.exists() else []
    names = list(names)
    for record in known:
        if all(record[name] == task[name] for name in names):
            return record
    record = compute()
    if path:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
    print(json.dumps(record), file=sys.stderr, flush=True)
    return record


def resident(name: str) -> int:
    """Resident memory of this process, "VmRSS", or its peak since the last `forget_peak`, "VmHWM" [byte]."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def forget_peak() -> None:
    """Count the peak of memory from now on, without freed memory, which would hide what is taken again."""
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
