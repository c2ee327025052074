"""Provide what the benchmark scripts share: a command line, processes, times, memory, tables and reports.

A benchmark is divided into tasks. A script passes three functions to `main`: one lists the tasks, one measures
a task, and one writes the report from the records of all tasks.
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
    """Run the tasks of a benchmark script from its command line, and print the report.

    Parameters
    ----------
    script : str
        Path of the script.
    title : str
        Title of the report.
    packages : tuple of str
        Packages whose versions the report states.
    sizes : tuple of int
        Default of the option `--sizes`.
    series : callable
        Takes the sizes and the number of repetitions, and yields series of tasks. A series is a list of tasks of growing
        size. A task is a dictionary that JSON can store; its key "size" states how large the problem is.
    measure : callable
        Takes a task, and returns the record of its measurement.
    report : callable
        Takes all records, and returns the text of the report.
    patience : float
        Longest expected time of a task [s]. A series ends before the first task that is expected to take longer.
    """
    doc = sys.modules["__main__"].__doc__ or title
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=sizes)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--records", type=Path, help="file in which records are stored")
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(json.loads(options.worker))))
        return
    records: list[dict[str, Any]] = []
    for tasks in series(sorted(options.sizes), options.repeats):
        last = None
        for task in tasks:
            growth = task["size"] / last["size"] if last else 0.0
            if last and growth > 1 and 1.2 * growth * last["seconds"] > patience:
                break
            last = run_task(script, task, options.records)
            records.append(last)
    print_report(script, title, f"{machine(packages)}.\n\n{report(records)}", options.write)


def run_task(script: str, task: dict[str, Any], path: Path | None) -> dict[str, Any]:
    """Return the record of a task, from the file of records if it is there, or from a new process."""
    stored = path.read_text(encoding="utf-8").splitlines() if path and path.exists() else []
    for record in map(json.loads, stored):
        if task.items() <= record.items():
            return record
    threads = str(task.get("threads", 1))
    command = [sys.executable, script, "--worker", json.dumps(task)]
    environment = os.environ | {"OMP_NUM_THREADS": threads, "NUMBA_NUM_THREADS": threads}
    process = subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    record = task | json.loads(process.stdout.splitlines()[-1])
    line = json.dumps(record)
    print(line, file=sys.stderr, flush=True)
    if path:
        with path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
    return record


def timed(solve: Callable[[], Any], repeats: int = 1) -> tuple[Any, dict[str, Any]]:
    """Call a function several times; return its last result, the median CPU time [s] and the added peak memory [byte].

    If the function raises an error, the result is None, and the record contains the reason under the key
    "failure".
    """
    ctypes.CDLL(None).malloc_trim(0)  # freed memory would hide what is taken again
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    before, times, result, failed = resident("VmRSS"), [], None, {}
    while len(times) < repeats and sum(times) < ENOUGH and not failed:
        start = time.process_time()
        try:
            result = solve()
        except Exception as reason:
            failed = {"failure": f"{type(reason).__name__}: {reason}"[:100]}
        times.append(time.process_time() - start)
    memory = resident("VmHWM") - before
    return result, failed | {"seconds": float(np.median(times)), "bytes": memory}


def resident(name: str) -> int:
    """Return the resident memory of this process [byte]: the present value ("VmRSS") or the peak value ("VmHWM")."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def machine(packages: Iterable[str] = ()) -> str:
    """Return a line with the date, the processor, and the versions of Python, femseal and the given packages."""
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
    """Print a report. With `write`, also write it beside the script, where the documentation includes it."""
    print(text)
    if write:
        path = Path(script)
        report = f"# {title}\n\nWritten by `{path.name}`.\n\n{text}\n"
        path.with_suffix(".md").write_text(report, encoding="utf-8")


def table(head: list[str], cells: Iterable[Iterable[Any]]) -> str:
    """Write a Markdown table."""
    lines = [head, ["---"] * len(head), *cells]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def ratio(record: dict[str, Any] | None, femseal_record: dict[str, Any]) -> str:
    """Return the time of another program as a multiple of the time of femseal, or "–" if it was not run."""
    if record is None:
        return "–"
    return (
        "failed" if "failure" in record else f"{record['seconds'] / femseal_record['seconds']:.3g}×"
    )


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
    """Read the rows of several CSV files into one list."""
    rows = []
    for path in paths:
        with open(path, newline="", encoding="utf-8") as file:
            rows += list(csv.DictReader(file))
    return rows


def write_rows(path: str | Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write rows to a CSV file, each row as soon as it has been computed."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = None
        for row in rows:
            if writer is None:
                writer = csv.DictWriter(file, list(row), lineterminator="\n")
                writer.writeheader()
            writer.writerow(row)
            file.flush()


def interval_cells(rows: list[dict[str, str]], with_interval: bool = True) -> list[str]:
    """Return table cells on leakages relative to the true leakage, and on their intervals.

    The cells are the number of loads, quantiles of the ratio, the coverage and the median half-width of the
    intervals.

    Without `with_interval`, the last two cells are empty.
    """
    names = ("leakage", "truth", "lower", "upper")
    q, truth, lower, upper = (np.array([float(row[name]) for row in rows]) for name in names)
    ratios = [f"{r:.2f}" for r in np.quantile(q / truth, [0.05, 0.25, 0.5, 0.75, 0.95])]
    if not with_interval:
        return [str(len(rows)), *ratios, "", ""]
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.nanmedian(np.maximum(upper / q, q / lower))
    coverage = np.mean((lower <= truth) & (truth <= upper))
    return [str(len(rows)), *ratios, f"{coverage:.0%}", f"{width:.2g}"]


#: The heads of `interval_cells`.
INTERVAL_HEAD = [
    "loads",
    "5 %",
    "25 %",
    "50 %",
    "75 %",
    "95 %",
    "contained in the interval",
    "half-width",
]
