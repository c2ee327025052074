"""Two processes, a Dask cluster of two, and parts of a run, against one process.

    python tests/benchmarks/parallel.py --write

A library of windows with a few seals drawn from it, and eight places of a face along a cycle of load steps. One process and
two of the same study take turns, and the efficiency is the median of the elapsed time of one over that of two, halved: of
the whole study, and of its stages. What others do on the machine enters it, but not the processor time of two, the main
process and the workers, over that of one. Processes are started, and have computed something small, before. Every process
has one thread. Parts keep items that cost nothing, and solve the windows of a library in one folder one after the other;
times are processor times. `--write` puts the tables beside this file, where the documentation takes them from.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import scales
from common import call, kept, machine, rows, save_report

BACKENDS = {"joblib": {"workers": 2}, "Dask": {"workers": 2, "scheduler": "local"}}
STUDIES = ("2,000 windows of 16²", "8 places of 128²")
#: Windows that cost nothing, and of a library, each with numbers of parts.
EMPTY, EMPTY_PARTS = 100_000, (1, 16, 100)
WINDOWS, PARTS = 2000, (4,)


def study(name: str, mapping: Any, windows: int = 2000, points: int = 128) -> None:
    """A library with seals drawn from it, or several places each in contact by itself."""
    import femseal as fs

    task = {"kind": "self-affine", "n": 256, "seed": 1}
    if name == STUDIES[0]:
        drawn = {"length": 256e-6, "breadth": 256e-6, "pressure": "uniform", "seed": 1}
        scene = replace(scales.scene_of(task), loading=(6e7, 6e8, 2e9), unload_from=(), unloading=())
        fs.stochastic(scene, (16, 16), fs.Sampling(**drawn, library_cells=windows, realisations=8), mapper=mapping)
    else:
        faces = [scales.face("self-affine", points, seed) for seed in range(8)]
        scene = scales.scene_of(task)
        fs.deterministic(fs.Scene(faces, **{n: getattr(scene, n) for n in GIVEN}), mapper=mapping)


GIVEN = ("modulus", "hardness", "fluid", "inlet_pressure", "outlet_pressure", "loading", "unload_from", "unloading")


def used() -> float:
    """Processor time of this process and of those that it has started [s]."""
    import psutil

    own = psutil.Process()
    taken = 0.0
    for process in (own, *own.children(recursive=True)):
        with suppress(psutil.Error):
            times = process.cpu_times()
            taken += times.user + times.system
    return taken


def timed(mapping: Any, seconds: dict[str, float]) -> Any:
    """The same map, adding up what its stages take."""

    def watched(stage: Any, *iterables: Any) -> Any:
        start = time.perf_counter()
        for item in mapping(stage, *iterables):
            seconds[stage.name] = seconds.get(stage.name, 0.0) + time.perf_counter() - start
            yield item
            start = time.perf_counter()

    return watched


def against_one(name: str, backend: str, repeat: int) -> dict[str, Any]:
    """Elapsed times of a study and its stages, and processor times, by one process and by two in turns."""
    from femseal.execution.mappers import ordered_map

    found: dict[str, Any] = {"study": name, "backend": backend, "one": [], "two": []}
    with ExitStack() as stack:
        both = {"one": map, "two": stack.enter_context(ordered_map(**BACKENDS[backend]))}
        for mapping in both.values():
            study(name, mapping, 50, 64)
        for _ in range(repeat):
            for count, mapping in both.items():
                seconds: dict[str, float] = {}
                start, before = time.perf_counter(), used()
                study(name, timed(mapping, seconds))
                elapsed = {"": time.perf_counter() - start} | seconds
                found[count].append({"elapsed": elapsed, "processor": used() - before})
    return found


def nothing(n: int) -> dict[str, Any]:
    """What is kept of a small window."""
    return {"permeability": np.full(8, float(n)), "counts": (n, 1)}


def in_parts(parts: int, solve: Callable[[Any], Any], count: int) -> dict[str, Any]:
    """Processor times of one process without a folder, of parts one after the other, and of the run that gathers."""
    from femseal.base.errors import PartsMissing
    from femseal.execution.checkpoint import Checkpoint

    taken, start = [], time.process_time()
    solve(map)
    one = time.process_time() - start
    with TemporaryDirectory() as name:
        folder = Path(name)
        files = 0
        for part in (*((n, parts) for n in range(1, parts + 1)), None):
            start = time.process_time()
            with suppress(PartsMissing), Checkpoint(folder, {}, True, part) as checkpoint:
                solve(checkpoint.over(map))
            taken.append(time.process_time() - start)
            files = max(files, sum(1 for path in folder.rglob("*.shard")))
    return {"count": count, "one": one, "own": sum(taken[:-1]), "gather": taken[-1], "files": files}


def of_nothing(mapping: Any) -> None:
    from femseal.base.stage import Stage

    for _ in mapping(Stage("nothing", nothing), range(EMPTY)):
        pass


def measure(task: dict[str, Any]) -> dict[str, Any]:
    if "study" in task:
        return against_one(task["study"], task["backend"], task["repeat"])
    solve, count = (of_nothing, EMPTY) if task["empty"] else (partial(study, STUDIES[0], windows=WINDOWS), WINDOWS)
    study(STUDIES[0], map, 50)
    return {"turns": [in_parts(task["parts"], solve, count) for _ in range(task["repeat"])]}


def workers_table(records: list[dict[str, Any]]) -> str:
    cells = []
    for name in STUDIES:
        own = {r["backend"]: r for r in records if r.get("study") == name}
        for stage in next(iter(own.values()))["one"][0]["elapsed"]:
            ones = [run["elapsed"][stage] for r in own.values() for run in r["one"]]
            if stage and median(ones) < 0.5:
                continue
            line = ["" if stage else name, stage or "all", f"{median(ones):.3g}"]
            for backend in BACKENDS:
                pairs = zip(own[backend]["one"], own[backend]["two"], strict=True)
                line.append(f"{median(a['elapsed'][stage] / (2 * b['elapsed'][stage]) for a, b in pairs):.2f}")
            for backend in BACKENDS:
                pairs = zip(own[backend]["one"], own[backend]["two"], strict=True)
                more = median(b["processor"] / a["processor"] for a, b in pairs)
                line.append("" if stage else f"{more:.2f}")
            cells.append(line)
    head = ["study", "stage", "one process [s]", *(f"efficiency of two: {b}" for b in BACKENDS)]
    return rows([*head, *(f"processor time of two over one: {b}" for b in BACKENDS)], cells)


def parts_table(records: list[dict[str, Any]]) -> str:
    cells = []
    for record in (r for r in records if "parts" in r):
        turns = record["turns"]
        count, kind = turns[0]["count"], "that cost nothing" if record["empty"] else "of 16², and eight seals"
        times = [f"{median(t[name] for t in turns):.3g}" for name in ("one", "own", "gather")]
        more = median(t["own"] - t["one"] for t in turns)
        per_cent = "" if record["empty"] else f"{100 * median(t['own'] / t['one'] - 1 for t in turns):.1f} %"
        line = [f"{count:,} {kind}", str(record["parts"]), *times, f"{1e6 * more / count:.0f}", per_cent]
        cells.append([*line, f"{1000 * turns[0]['files'] / count:.2g}"])
    head = ["windows", "parts", "one process [s]", "all parts [s]", "run that gathers [s]", "more for a window [µs]"]
    return rows([*head, "in all", "most files for 1,000 windows"], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5, help="turns of one process and two")
    parser.add_argument("--records", type=Path, help="file of what is measured, to go on from there")
    parser.add_argument("--write", action="store_true", help="write the tables")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(json.loads(options.worker))))
        return
    tasks: list[dict[str, Any]] = [{"empty": True, "parts": parts} for parts in EMPTY_PARTS]
    tasks += [{"empty": False, "parts": parts} for parts in PARTS]
    tasks += [{"study": s, "backend": b} for s in STUDIES for b in BACKENDS]
    records = []
    for task in tasks:
        task["repeat"] = options.repeat
        compute = partial(call, __file__, ["--worker", json.dumps(task)], 1)
        record = kept({"task": task}, ["task"], options.records, lambda c=compute, t=task: {"task": t} | c())
        records.append(task | record)
    packages = {name: name for name in ("joblib", "distributed")}
    said = f"{machine(packages)}. Load of the machine at the end: {os.getloadavg()[1]:.1f}."
    head = f"{said}\n\n## Two workers\n\nMedians of {options.repeat} turns.\n\n{workers_table(records)}"
    text = f"{head}\n\n## Parts of a run\n\n{parts_table(records)}"
    print(text)
    if options.write:
        save_report(__file__, "Parallel maps", text)


if __name__ == "__main__":
    main()
