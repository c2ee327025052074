"""What the benchmarks share: tasks in processes of their own, time, memory, tables, reports.

A script of tasks gives `main` its series of tasks, what one task measures and the report of all
records.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import femseal

#: Time after which a solution is not repeated [s].
ENOUGH = 5.0


def main(
    script: str,
    title: str,
    packages: tuple[str, ...],
    sizes: tuple[int, ...],
    series: Callable[[list[int], int], Iterable[list[dict[str, Any]]]],
    measure: Callable[[dict[str, Any]], dict[str, Any]],
    report: Callable[[list[dict[str, Any]]], str],
    patience: float = 60.0,
) -> None:
    """The command line of a script of tasks.

    series : of sizes and repeats, lists of tasks, dictionaries for JSON, with growing "size".
    measure : the record of a task. report : the text of all records.
    patience : a series ends where its last record says that a larger one would take longer [s].
    """
    doc = sys.modules["__main__"].__doc__ or title
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=sizes)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        print(json.dumps(measure(json.loads(given.worker))))
        return
    found: list[dict[str, Any]] = []
    for tasks in series(sorted(given.sizes), given.repeats):
        last = None
        for task in tasks:
            growth = task["size"] / last["size"] if last else 0.0
            if last and growth > 1 and 1.2 * growth * last["seconds"] > patience:
                break
            last = kept(script, task, given.records)
            found.append(last)
    print_report(script, title, f"{machine(packages)}.\n\n{report(found)}", given.write)


def kept(script: str, task: dict[str, Any], path: Path | None) -> dict[str, Any]:
    """The record of a task from a file of records, else of a process of its own."""
    known = path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []
    for record in map(json.loads, known):
        if task.items() <= record.items():
            return record
    threads = str(task.get("threads", 1))
    command = [sys.executable, script, "--worker", json.dumps(task)]
    environment = os.environ | {"OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    record = task | json.loads(done.stdout.splitlines()[-1])
    line = json.dumps(record)
    print(line, file=sys.stderr, flush=True)
    if path:
        with path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
    return record


def timed(solve: Callable[[], Any], repeats: int = 1) -> tuple[Any, dict[str, Any]]:
    """The last solution, and its median CPU time [s] and peak memory beyond that before [byte].

    Any failure of a program is a result: it is named in place of a solution, which is None.
    """
    ctypes.CDLL(None).malloc_trim(0)  # freed memory would hide what is taken again
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    before, times, found, failed = resident("VmRSS"), [], None, {}
    while len(times) < repeats and sum(times) < ENOUGH and not failed:
        start = time.process_time()
        try:
            found = solve()
        except Exception as reason:
            failed = {"failure": f"{type(reason).__name__}: {reason}"[:100]}
        times.append(time.process_time() - start)
    memory = resident("VmHWM") - before
    return found, failed | {"seconds": float(np.median(times)), "bytes": memory}


def resident(name: str) -> int:
    """Resident memory of this process, "VmRSS", or its peak, "VmHWM" [byte]."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def machine(packages: Iterable[str] = ()) -> str:
    """Date, processor and versions."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = (line.split(":")[1].strip() for line in lines if "model name" in line)
    versions = [f"femseal {femseal.__version__}"]
    for package in packages:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            versions.append(f"no {package}")
    processor = f"{next(models, 'unknown processor')}, {os.cpu_count()} cores"
    return f"{date.today()}, {processor}, Python {platform.python_version()}, {', '.join(versions)}"


def machine_and_time(packages: Iterable[str] = ()) -> str:
    """Describe the machine and the packages, and say how long this script has taken so far, for the head of a report."""
    minutes = time.process_time() / 60
    return f"{machine(packages)}. The script took {minutes:.1f} minutes on one core."


def print_report(script: str, title: str, text: str, write: bool) -> None:
    """Print a report, and write it beside the script, where the documentation takes it from."""
    print(text)
    if write:
        path = Path(script)
        report = f"# {title}\n\nWritten by `{path.name}`.\n\n{text}\n"
        path.with_suffix(".md").write_text(report, encoding="utf-8")


def table(head: list[str], cells: Iterable[Iterable[Any]]) -> str:
    """Write a Markdown table."""
    lines = [head, ["---"] * len(head), *cells]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def ratio(record: dict[str, Any] | None, own: dict[str, Any]) -> str:
    """Return the time of another program as a multiple of the time of femseal, or "–" if it was not run."""
    if record is None:
        return "–"
    return "failed" if "failure" in record else f"{record['seconds'] / own['seconds']:.3g}×"


def failures(records: Iterable[dict[str, Any]], *names: str) -> str:
    """List the runs that failed as Markdown, each with the values of its task and the reason."""
    lines = []
    for record in records:
        if "failure" not in record:
            continue
        values = []
        for name in names:
            value = record[name]
            if isinstance(value, float):
                values.append(f"{name} = {value:g}")
            elif isinstance(value, str):  # the name of the program
                values.append(value)
            else:
                values.append(f"{name} = {value}")
        lines.append(f"- {', '.join(values)}: {record['failure']}")
    if not lines:
        return "No run failed."
    return "\n".join(["These runs failed (quantities in SI units):", "", *lines])


def read_rows(paths: Iterable[str | Path]) -> list[dict[str, str]]:
    """The rows of CSV files."""
    found = []
    for path in paths:
        with open(path, newline="", encoding="utf-8") as file:
            found += list(csv.DictReader(file))
    return found


def write_rows(path: str | Path, rows: Iterable[dict[str, Any]]) -> None:
    """Rows to a CSV file, each as soon as it is there."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = None
        for row in rows:
            if writer is None:
                writer = csv.DictWriter(file, list(row), lineterminator="\n")
                writer.writeheader()
            writer.writerow(row)
            file.flush()


def band_cells(rows: list[dict[str, str]], banded: bool = True) -> list[str]:
    """Count of loads, quantiles of leakage over truth, how often the band holds, its half-width."""
    names = ("leakage", "truth", "lower", "upper")
    q, truth, lower, upper = (np.array([float(row[name]) for row in rows]) for name in names)
    ratios = [f"{r:.2f}" for r in np.quantile(q / truth, [0.05, 0.25, 0.5, 0.75, 0.95])]
    if not banded:
        return [str(len(rows)), *ratios, "", ""]
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.nanmedian(np.maximum(upper / q, q / lower))
    held = np.mean((lower <= truth) & (truth <= upper))
    return [str(len(rows)), *ratios, f"{held:.0%}", f"{width:.2g}"]


#: The heads of `band_cells`.
BAND_HEAD = [
    "loads",
    "5 %",
    "25 %",
    "50 %",
    "75 %",
    "95 %",
    "contained in the interval",
    "half-width",
]
