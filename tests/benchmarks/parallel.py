"""Windows computed by two processes and by a Dask cluster of two, against one process.

Contact of n² windows along a cycle of ten steps, each window with its own gaps, as the studies send them. Efficiency is
the processor time of one process over that of all processes of the map, which load by others changes little; after it
the elapsed time of one process over that of two, halved. Processes have been started before. The overhead is the time of
an item that computes nothing. What the network carries is the size of the arguments and results for each second that one
core computes. Every process has one thread. `--write` puts the table beside this file and into the README.
"""

from __future__ import annotations

import argparse
import json
import pickle
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import ROOT, call, machine, replace_between, rows

HERE = Path(__file__).parent
BACKENDS = {
    "one process": {"workers": 1},
    "joblib": {"workers": 2},
    "Dask": {"workers": 2, "scheduler": "local"},
}
MAPS = tuple(BACKENDS)[1:]
EMPTY = 20_000


def windows(n, count):
    """The task of a study and its arguments."""
    from femseal import HalfSpace, self_affine
    from femseal.contact import load_programme
    from femseal.studies.windows import _respond

    steps = load_programme((5e7, 1e8, 2e8, 4e8, 6e8, 9e8), (9e8,), (4e8, 2e8, 1e8, 5e7))
    face = self_affine((n * 4, n * 4), (n * 4e-6, n * 4e-6), hurst=0.8, rms_slope=0.2, roll_off=n * 2e-6, rng=1)
    half_space = HalfSpace((n, n), face.spacing, 115e9, ("mirror", "mirror"))
    task = partial(_respond, steps=steps, half_space=half_space, hardness=4e9, rigid_at_zero=True, rtol=1e-5)
    rng = np.random.default_rng(1)
    places = rng.integers(n * 3, size=(count, 2))
    cut = [face.heights.max() - face.heights[i : i + n, j : j + n] for i, j in places]
    raw_gaps = [np.full((len(steps), n, n), g.mean(), np.float32) for g in cut]
    return task, raw_gaps, [g - g.mean() for g in cut], [np.array([s.pressure for s in steps])] * count


def processor_seconds():
    """Of this process and its workers."""
    import psutil

    own = psutil.Process()
    return sum(sum(process.cpu_times()[:2]) for process in (own, *own.children(recursive=True)))


def study(task):
    """Times of a map after its processes are warm."""
    from femseal.parallel import ordered_map

    with ordered_map(**BACKENDS[task["backend"]]) as mapping:
        if task["n"] == 0:
            list(mapping(abs, range(200)))
            start = time.perf_counter()
            list(mapping(abs, range(EMPTY)))
            return {**task, "seconds": time.perf_counter() - start}
        function, *arguments = windows(task["n"], task["count"])
        list(mapping(function, *(a[:100] for a in arguments)))
        start, before = time.perf_counter(), processor_seconds()
        results = list(mapping(function, *arguments))
        seconds, used = time.perf_counter() - start, processor_seconds() - before
    size = sum(len(pickle.dumps(part, 5)) for part in (*(a[0] for a in arguments), results[0]))
    return {**task, "seconds": seconds, "processor": used, "bytes": size * task["count"]}


def table(records):
    def least(n, backend, key):
        return min(r[key] for r in records if (r["n"], r["backend"]) == (n, backend))

    cells = []
    for n in sorted({r["n"] for r in records} - {0}):
        own = [r for r in records if r["n"] == n]
        seconds, processor = (least(n, "one process", key) for key in ("seconds", "processor"))
        cells.append([
            f"{n}²", f"{1e3 * processor / own[0]['count']:.3g}",
            *(f"{processor / least(n, b, 'processor'):.2f}, {seconds / (2 * least(n, b, 'seconds')):.2f}" for b in MAPS),
            f"{own[0]['bytes'] / processor / 1e6:.3g}",
        ])  # fmt: skip
    overhead = ", ".join(f"{b} {1e3 * least(0, b, 'seconds') / EMPTY:.2g} ms" for b in MAPS)
    head = ["window", "one window [ms]", "efficiency, of time: joblib", "Dask", "network for each core [MB/s]"]
    return f"{rows(head, cells)}\n\nOverhead for each item: {overhead}."


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, nargs="+", default=[32, 64, 128], help="of a side of a window")
    parser.add_argument("--megapixels", type=float, default=8.0, help="of all windows and steps together")
    parser.add_argument("--repeat", type=int, default=3, help="the best of so many counts")
    parser.add_argument("--write", action="store_true", help="write the table")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(study(json.loads(options.worker))))
        return
    records = []
    for _ in range(options.repeat):
        for n in (0, *options.points):
            for backend in BACKENDS:
                count = EMPTY if n == 0 else max(16, round(options.megapixels * 1e6 / (10 * n * n)))
                records.append(
                    call(__file__, ["--worker", json.dumps({"n": n, "count": count, "backend": backend})], 1)
                )
                print(json.dumps(records[-1]), file=sys.stderr, flush=True)
    packages = {name: name for name in ("joblib", "distributed")}
    text = f"{machine(packages)}. Best of {options.repeat}.\n\n{table(records)}"
    print(text)
    if options.write:
        report = f"# Parallel maps\n\nWritten by `parallel.py`.\n\n{text}\n"
        (HERE / "parallel.md").write_text(report, encoding="utf-8")
        replace_between(ROOT / "README.md", "parallel benchmark", f"\n{text}\n")


if __name__ == "__main__":
    main()
