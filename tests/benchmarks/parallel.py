"""Two processes, a Dask cluster of two, and parts of a run, against one process.

    python tests/benchmarks/parallel.py --write

Eight places of a face along a cycle of load steps. One process and two of the same study take turns, and the efficiency is the median of the elapsed time of one over that of two, halved: of
the whole study, and of its stages. What others do on the machine enters it, but not the processor time of two, the main
process and the workers, over that of one. Processes are started, and have computed something small, before. Every process
has one thread. Parts keep items that cost nothing, in one folder one after the other, each in a process of its own; the second
is killed half way and run again. Parts of a run are those of the command: each draws its share of the seals, two at once; the third is killed half way and run again, and the first when it has nothing left to do. Their
times are processor times from the start of the processes to their end, and the bits are checked. `--write` puts the tables
beside this file, where the documentation takes them from.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from common import call, kept, machine, rows, save_report

BACKENDS = {"joblib": {"workers": 2}, "Dask": {"workers": 2, "scheduler": "local"}}
MODULUS, PIXEL = 115e9, 1e-6
#: Nominal pressures in shares of the hardness: loading, those to unload from, and the stops on the way down.
SHARES = (
    (0.004, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.3, 0.4),
    (0.11, 0.3),
    (0.22, 0.16, 0.07, 0.03, 0.01, 0.003),
)
STUDIES = ("8 places of 128²",)
#: Items that cost nothing, and parts of them; drawn seals unless another number is asked for, and parts of these.
EMPTY, EMPTY_PARTS = 100_000, (1, 16, 100)
SEALS, PARTS = 10_000, 16
#: Their case: strips of 8 × 64 tiles under a load.
CASE = """
method = "stochastic"
seed = 1
[face]
kind = "self-affine"
points = [256, 256]
size = ["256 um", "256 um"]
rms_slope = 0.25
roll_off = "64 um"
[material]
young = "210 GPa"
hardness = "4 GPa"
[load]
loading = ["12 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
[cells]
count = [4, 4]
[stochastic]
length = "4.096 mm"
breadth = "512 um"
realisations = {}
[output]
pictures = false
report = false
budget = false
paraview = "none"
"""
COMMAND = "from femseal.cli import main; main()"
#: How often a process is looked at that is to be killed half way [s].
LOOK_SECONDS = 1.0


def face(points: int, seed: int) -> Any:
    """A place of a self-affine face."""
    import femseal as fs

    size = (points * PIXEL, points * PIXEL)
    return fs.self_affine((points, points), size, hurst=0.8, rms_slope=0.25, roll_off=size[0] / 4, cut_off=8 * PIXEL, rng=seed)  # fmt: skip


def study(mapping: Any, points: int = 128) -> str:
    """Several places, each in contact by itself; a digest of the leakage."""
    import femseal as fs

    faces = [face(points, seed) for seed in range(8)]
    hardness = 0.14 * MODULUS * face(256, 1).rms_slope
    loading, peaks, stops = (tuple(hardness * share for share in shares) for shares in SHARES)
    given = {
        "loading": loading,
        "unload_from": peaks,
        "unloading": stops,
        "inlet_pressure": 1e7,
        "outlet_pressure": 0.0,
    }
    scene = fs.Scene(faces, MODULUS, hardness, fs.Liquid(1e-3), **given)
    found = fs.deterministic(scene, mapper=mapping).leakage
    return sha256(found.tobytes()).hexdigest()


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


def timed(mapping: Any, seconds: dict[str, float], clock: Callable[[], float] = time.perf_counter) -> Any:
    """The same map, adding up what its stages take."""

    def watched(stage: Any, *iterables: Any) -> Any:
        start = clock()
        for item in mapping(stage, *iterables):
            seconds[stage.name] = seconds.get(stage.name, 0.0) + clock() - start
            yield item
            start = clock()

    return watched


def against_one(name: str, backend: str, repeat: int) -> dict[str, Any]:
    """Elapsed times of a study and its stages, and processor times, by one process and by two in turns."""
    from femseal.execution.mappers import ordered_map

    found: dict[str, Any] = {"study": name, "backend": backend, "one": [], "two": []}
    with ExitStack() as stack:
        both = {"one": map, "two": stack.enter_context(ordered_map(**BACKENDS[backend]))}
        for mapping in both.values():
            study(mapping, 64)
        for _ in range(repeat):
            for count, mapping in both.items():
                seconds: dict[str, float] = {}
                start, before = time.perf_counter(), used()
                study(timed(mapping, seconds))
                elapsed = {"": time.perf_counter() - start} | seconds
                found[count].append({"elapsed": elapsed, "processor": used() - before})
    return found


def nothing(n: int) -> dict[str, Any]:
    """What is kept of an item."""
    return {"permeability": np.full(8, float(n)), "counts": (n, 1)}


def apart(work: Callable[[], Any]) -> dict[str, Any]:
    """What work gives in a process of its own, its processor time [s] and its peak of memory [MB]."""
    ends = os.pipe()
    if not (process := os.fork()):
        try:
            os.write(ends[1], json.dumps(work()).encode())
        finally:
            os._exit(0)
    taken = os.wait4(process, 0)[2]
    os.close(ends[1])
    with os.fdopen(ends[0]) as found:
        text = found.read()
    return {
        "found": json.loads(text) if text else None,
        "seconds": taken.ru_utime + taken.ru_stime,
        "peak": taken.ru_maxrss / 1024,
    }


def in_parts(parts: int) -> dict[str, Any]:
    """One process without a folder, parts one after the other, the second killed half way and run again, and the
    run that gathers: processor times, peaks of memory, most files, and whether the results are the same bits."""
    from femseal.base.errors import PartsMissing
    from femseal.execution.resuming import over_store
    from femseal.store.store import Store

    def keeping(part: tuple[int, int] | None, kill: bool) -> str | None:
        def watch(stage: str, done: int, total: int | None) -> None:
            if kill and total and 2 * done > total:
                os.kill(os.getpid(), signal.SIGKILL)

        with suppress(PartsMissing), Store(folder) as store:
            return of_nothing(over_store(map, store, folder, part, watch))
        return None

    one = apart(lambda: of_nothing(map))
    runs = [((n, parts), killed) for n in range(1, parts + 1) for killed in ((True, False) if n == 2 else (False,))]
    with TemporaryDirectory() as name:
        folder = Path(name)
        taken, files = [], 0
        for part, killed in [*runs, (None, False)]:
            taken.append(apart(partial(keeping, part, killed)))
            files = max(files, sum(1 for path in folder.rglob("*.results")))
    return summed(one, taken[:-1], taken[-1]) | {"files": files, "same": taken[-1]["found"] == one["found"]}


def summed(one: dict[str, Any], parts: list[dict[str, Any]], gather: dict[str, Any]) -> dict[str, Any]:
    """Processor times and peaks of memory of one process, the parts and the run that gathers."""
    return {
        "one": one["seconds"],
        "own": sum(run["seconds"] for run in parts),
        "gather": gather["seconds"],
        "peaks": [one["peak"], max(run["peak"] for run in parts), gather["peak"]],
    }


def commanded(case: Path, folder: Path, *options: str, after: float | None = None) -> dict[str, Any]:
    """The command in a process of its own: its processor time [s], peak of memory [MB] and exit code; it is killed
    after some of that time if that is given."""
    import psutil

    command = [sys.executable, "-c", COMMAND, "run", case, "-o", folder, "--workers", "1", "--quiet", *options]
    process = subprocess.Popen([*map(str, command)], stderr=subprocess.DEVNULL)
    while after is not None:
        time.sleep(LOOK_SECONDS)
        if psutil.Process(process.pid).cpu_times().user > after:
            process.kill()
            break
    _, code, taken = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(code)
    return {
        "seconds": taken.ru_utime + taken.ru_stime,
        "peak": taken.ru_maxrss / 1024,
        "code": process.returncode,
    }


def run_in_parts(seals: int, parts: int) -> dict[str, Any]:
    """The command by one process, and beside it by parts, two at once, with the run that gathers, as `in_parts`."""
    import femseal as fs

    with TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool, ThreadPoolExecutor(1) as beside:
        whole, folder, case = Path(name) / "whole", Path(name) / "parts", Path(name) / "case.toml"
        case.write_text(CASE.format(64))
        for option in (("--part", "1/1"), ("--resume",)):  # what is compiled once is in no time
            commanded(case, Path(name) / "small", *option)
        case.write_text(CASE.format(seals))
        alone = beside.submit(commanded, case, whole)
        first = commanded(case, folder, "--part", f"1/{parts}")
        taken, files = [first], 0

        def part(n: int) -> None:
            nonlocal files
            own = ("--part", f"{n}/{parts}")
            if n == 3:
                taken.append(commanded(case, folder, *own, after=first["seconds"] / 2))
            taken.append(commanded(case, folder, *own))
            files = max(files, sum(1 for _ in folder.rglob("*.results")))

        list(pool.map(part, range(2, parts + 1)))
        again = commanded(case, folder, "--part", f"1/{parts}")["seconds"]
        gather = commanded(case, folder, "--resume")
        one = alone.result()
        same = fs.open_results(folder).dataset.equals(fs.open_results(whole).dataset)
    codes = sorted(run["code"] for run in taken)
    assert (one["code"], gather["code"], *codes[:2]) == (0, 0, -signal.SIGKILL, 0 if parts == 1 else 3), codes
    return summed(one, taken, gather) | {"again": again, "files": files, "same": same}


def of_nothing(mapping: Any) -> str:
    from femseal.base.stage import Stage

    digest = sha256()
    for item in mapping(Stage("nothing", nothing), range(EMPTY)):
        digest.update(item["permeability"].tobytes())
    return digest.hexdigest()


def measure(task: dict[str, Any]) -> dict[str, Any]:
    if "study" in task:
        return against_one(task["study"], task["backend"], task["repeat"])
    if task["seals"]:
        return {"turns": [run_in_parts(task["seals"], task["parts"])]}
    return {"turns": [in_parts(task["parts"]) for _ in range(task["repeat"])]}


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
        count, kind = (
            record["seals"] or EMPTY,
            "drawn seals of 8 × 64 tiles" if record["seals"] else "that cost nothing",
        )
        assert all(t["same"] for t in turns)
        names = ("one", "own", "again", "gather")
        times = [f"{median(t[name] for t in turns):.3g}" if name in turns[0] else "" for name in names]
        more = median(t["own"] + t["gather"] - t["one"] for t in turns)
        per_cent = f"{100 * more / median(t['one'] for t in turns):.1f} %" if record["seals"] else ""
        line = [f"{count:,} {kind}", str(record["parts"]), *times, f"{1e6 * more / count:.0f}", per_cent]
        peaks = [median(t["peaks"][n] for t in turns) for n in range(3)]
        cells.append([*line, f"{1000 * turns[0]['files'] / count:.2g}", ", ".join(f"{peak:.0f}" for peak in peaks)])
    head = ["items", "parts", "one process [s]", "all parts [s]", "a part again [s]", "run that gathers [s]"]
    head += ["more for an item [µs]", "of one process", "most files for 1,000 items"]
    return rows([*head, "memory of one process, a part, the run that gathers [MB]"], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=5, help="turns of one process and two")
    parser.add_argument("--seals", type=int, default=SEALS, help="seals that parts draw")
    parser.add_argument("--records", type=Path, help="file of what is measured, to go on from there")
    parser.add_argument("--write", action="store_true", help="write the tables")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(json.loads(options.worker))))
        return
    tasks: list[dict[str, Any]] = [{"seals": 0, "parts": parts} for parts in EMPTY_PARTS]
    tasks.append({"seals": options.seals, "parts": PARTS})
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
