"""Studies on two processes and on a Dask cluster of two, against one process.

    python tests/benchmarks/parallel.py --write

Two scales on self-affine faces along a cycle of twenty load steps, and a library of windows with seals drawn from it.
Efficiency is the elapsed time of one process over that of two, halved: of the whole study, and of its parts that are
divided. Processes are started, and have computed something small, before. The overhead is the time of an item that
computes nothing. Every process has one thread. `--write` puts the table beside this file,
where the documentation takes it from.
"""

from __future__ import annotations

import argparse
import json
import sys
import time

import scales
from common import call, machine, rows, save_report

BACKENDS = {
    "one process": {"workers": 1},
    "joblib": {"workers": 2},
    "Dask": {"workers": 2, "scheduler": "local"},
}
MAPS = tuple(BACKENDS)[1:]
#: Points of a face and of its windows; 0: a library.
STUDIES = ((512, 32), (1024, 64), (2048, 64), (0, 64))
EMPTY = 20_000


def scene_of(n):
    """The self-affine face of n × n points of the study of two scales."""
    return scales.scene_of({"kind": "self-affine", "n": n, "seed": 1})


def study(n, window, mapping):
    """Two scales of a face; without points a library of windows and seals drawn from it."""
    from femseal import Sampling, stochastic, two_scale

    if n:
        two_scale(scene_of(n), (n // window,) * 2, mapper=mapping)
    else:
        drawn = {"length": 400 * window * 1e-6, "breadth": 40 * window * 1e-6, "pressure": "uniform", "seed": 1}
        stochastic(
            scene_of(512), (512 // window,) * 2, Sampling(**drawn, library_cells=200, realisations=50), mapper=mapping
        )


def timed(mapping, seconds):
    """The same map, adding up what its stages take."""

    def watched(stage, *iterables):
        start = time.perf_counter()
        for item in mapping(stage, *iterables):
            seconds[stage.name] = seconds.get(stage.name, 0.0) + time.perf_counter() - start
            yield item
            start = time.perf_counter()

    return watched


def measure(task):
    """Elapsed times of a study and of its parts."""
    from femseal.base.stage import Stage
    from femseal.execution.mappers import ordered_map

    with ordered_map(**BACKENDS[task["backend"]]) as mapping:
        if task["study"] is None:
            nothing = Stage("nothing", abs)
            list(mapping(nothing, range(200)))
            start = time.perf_counter()
            list(mapping(nothing, range(EMPTY)))
            return {**task, "seconds": {"": time.perf_counter() - start}}
        n, window = task["study"]
        study(min(n, 256), 32, mapping)
        seconds = {}
        start = time.perf_counter()
        study(n, window, timed(mapping, seconds))
        return {**task, "seconds": {**seconds, "": time.perf_counter() - start}}


def table(records):
    def least(study, backend, part):
        found = (r["seconds"][part] for r in records if (r["study"], r["backend"]) == (study, backend))
        return min(found)

    cells = []
    for n, window in STUDIES:
        chosen = [n, window]
        own = [r for r in records if r["study"] == chosen]
        if not own:
            continue
        name = (
            f"two scales, {n}², windows of {window}²" if n else f"200 windows of {window}², 50 seals of 40 × 400 links"
        )
        for part in ("", *filter(None, own[0]["seconds"])):
            one = least(chosen, "one process", part)
            efficiencies = (f"{one / (2 * least(chosen, b, part)):.2f}" for b in MAPS)
            cells.append(["" if part else name, part or "all", f"{one:.3g}", *efficiencies])
    overhead = ", ".join(f"{b} {1e3 * least(None, b, '') / EMPTY:.2g} ms" for b in MAPS)
    head = ["study", "part", "one process [s]", "efficiency of two: joblib", "Dask"]
    return f"{rows(head, cells)}\n\nOverhead for each item: {overhead}."


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3, help="the best of so many counts")
    parser.add_argument("--write", action="store_true", help="write the table")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(json.loads(options.worker))))
        return
    records = []
    for _ in range(options.repeat):
        for which in (None, *STUDIES):
            for backend in BACKENDS:
                records.append(call(__file__, ["--worker", json.dumps({"study": which, "backend": backend})], 1))
                print(json.dumps(records[-1]), file=sys.stderr, flush=True)
    packages = {name: name for name in ("joblib", "distributed")}
    text = f"{machine(packages)}. Best of {options.repeat}.\n\n{table(records)}"
    print(text)
    if options.write:
        save_report(__file__, "Parallel maps", text)


if __name__ == "__main__":
    main()
