"""How near the forecast of `femseal check` comes to runs: time and memory, over measured faces and methods.

    python tests/benchmarks/forecast.py FILE ... --records forecast.jsonl --write

Each run is `fs.run` of a case into a results folder, with one worker, in a process of its own that also starts up: its
CPU time, which a shared machine does not stretch, and its peak memory are those of the process and its children.
`--scale 0.5` takes half the points a side. `--records` keeps what is computed and goes on from there; the forecast is
made anew each time. `--write` puts the table beside this file.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from common import kept, machine, rows, save_report

from femseal.preparation.preparation import prepare

METHODS = ("deterministic", "two-scale", "stochastic")
LOADS = {
    "loading": ["5 MPa", "10 MPa", "20 MPa", "40 MPa", "80 MPa"],
    "unload_from": ["80 MPa"],
    "unloading": ["40 MPa", "20 MPa", "5 MPa"],
}


def case_of(task):
    """The case of a run."""
    from femseal.case.case import parse_case

    data = {
        "title": Path(task["file"]).name,
        "method": task["method"],
        "face": {"kind": "file", "path": task["file"]},
        "material": {"young": "210 GPa", "yield_stress": "1 GPa"},
        "load": LOADS,
        "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa", "outlet_pressure": "0.1 MPa"},
    }
    if "points" in task:
        data["surface"] = {"points": task["points"]}
    elif task["scale"] != 1:
        shape = prepare(parse_case({**data, "method": "deterministic"})).scene.surface.shape
        data["surface"] = {"points": [max(64, round(n * task["scale"])) for n in shape]}
    if task["method"] != "deterministic":
        data["cells"] = {"count": task["cells"]}
    if task["method"] == "stochastic":
        data["stochastic"] = {"length": "20 mm", "realisations": 20}
    return parse_case(data)


def measure(task):
    """CPU time [s] and peak memory [byte] of a run in a process of its own."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    points = case_of(task).surface.points  # which the run is not to find again
    done = subprocess.run(
        [sys.executable, __file__, "--task", json.dumps(task | ({"points": points} if points else {}))],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return task | json.loads(done.stdout.splitlines()[-1])


def run(task):
    """The run itself."""
    import femseal
    from femseal.runs.pilot import pace

    speed = pace()
    with tempfile.TemporaryDirectory() as folder:
        results = femseal.run(case_of(task), folder, workers=1)
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    seconds = sum(u.ru_utime + u.ru_stime for u in usage)
    return {
        "pace": speed,
        "seconds": seconds,
        "memory": 1024 * max(u.ru_maxrss for u in usage),
        "points": list(results.scene.surface.shape),
        "timings": json.loads(results.dataset.attrs["timings"]),
        "contact": [float(c) for c in results.dataset["contact_fraction"].values]
        if "contact_fraction" in results.dataset
        else [],
    }


def tasks(files, scales):
    for file in files:
        for scale in scales:
            for method in METHODS:
                yield {
                    "file": str(Path(file).resolve()),
                    "scale": scale,
                    "method": method,
                    "cells": [6, 8],
                }


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("files", nargs="*")
    parser.add_argument("--scale", type=float, nargs="+", default=[0.5])
    parser.add_argument("--records", type=Path)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--task", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.task:
        print(json.dumps(run(options.task)))
        return
    from femseal.runs.forecast import forecast
    from femseal.runs.pilot import pace

    cells, ratios = [], {"time": [], "memory": []}
    for task in tasks(options.files, options.scale):
        found = kept(task, task, options.records, lambda task=task: measure(task))
        case = case_of(task)
        expected = forecast(case, prepare(case))
        # as fast as the machine was then
        seconds = expected.seconds() * found["pace"] / pace()
        pairs = ((seconds, found["seconds"]), (expected.memory, found["memory"]))
        for name, (said, true) in zip(ratios, pairs, strict=True):
            ratios[name].append(said / true)
        points = " × ".join(map(str, found["points"]))
        cells.append(
            [Path(task["file"]).name, points, task["method"]]
            + [
                f"{scale * x:.{digits}f}"
                for pair, scale, digits in zip(pairs, (1, 1e-9), (0, 2), strict=True)
                for x in pair
            ]
            + [f"{a / b:.2f}" for a, b in pairs]
        )
    head = ["face", "points", "route", "expected [s]", "CPU time [s]", "expected [GB]", "peak [GB]", "time", "memory"]
    summary = "; ".join(f"{name}: median {median(r):.2f}, {min(r):.2f} to {max(r):.2f}" for name, r in ratios.items())
    text = f"{machine({})}\n\n{rows(head, cells)}\n\nExpected over measured, {summary}."
    print(text)
    if options.write:
        save_report(__file__, "Forecast of time and memory", text)


if __name__ == "__main__":
    main()
