"""Darcy flow over a whole seal: time, memory and error of the network of links against general sparse solvers.

    python tests/benchmarks/seal.py --cells 10000 100000 1000000 5000000 --write

Square seals, periodic along x2, of links drawn one by one: log-normal with a standard deviation σ of ln k, open or with
35 % of the links closed at random. Peers get the matrix of the open clusters, with assembly in their time: SuperLU by
scipy, MKL's PARDISO, and pyamg's smoothed aggregation with conjugate gradients as its manual has it. A peer's leakage is
wrong where it differs by more than 1 % from elimination's. Times are CPU times of one thread, in a process of its own,
compilation before. Open maps have a known answer: exp⟨ln k⟩ for a large seal, by duality (Dykhne 1971; Keller 1964).
`--write` puts the table beside this file, where the documentation takes it from.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import call, forget_peak, kept, machine, resident, rows, save_report

PACKAGES = {"pyamg": "pyamg", "scipy": "scipy", "pypardiso": "pypardiso"}
#: (σ, share of closed links)
MAPS = ((1.0, 0.0), (3.0, 0.0), (3.0, 0.35))
#: A solver is not run on sizes where the next smaller one says that it would take longer, or more memory.
PATIENCE, MEMORY = 90.0, 12e9
#: Maps over which the known answer is averaged, and their cells.
ANSWERS, ANSWER_CELLS = 8, 1_000_000


def links(cells, sigma, closed, seed=1):
    """Permeabilities along and across of a square seal."""
    n = round(cells**0.5)
    rng = np.random.default_rng(seed)
    k1, k2 = (np.exp(sigma * rng.standard_normal(shape)) for shape in ((n, n), (n - 1, n)))
    for k in (k1, k2):
        k[rng.random(k.shape) < closed] = 0.0
    return k1, k2


def femseal_solver(k1, k2):
    from femseal import RectangularSeal

    flow = RectangularSeal((1.0, 1.0), k1.shape).flow((k1, k2))
    return flow.conductance, flow.iterations


def elimination(k1, k2):
    from femseal.flow import Stencil, solve_flow

    return solve_flow(Stencil(k1, k2), solver="elimination").conductance, 0


def system(k1, k2):
    """Matrix, right-hand side and the potential's share in the leakage, of nodes that both ends reach."""
    import scipy.sparse as sp

    from femseal.flow.percolation import nodes_reached

    keep = nodes_reached(k1, k2) == 3
    k1, k2 = k1 * (keep[:-1] & keep[1:]), k2 * (keep & np.roll(keep, -1, axis=1))[1:-1]
    n1, n2 = k1.shape
    node = np.full((n1 + 1, n2), -1)
    node[1:-1][keep[1:-1]] = np.arange(np.count_nonzero(keep[1:-1]))
    tail = np.concatenate([node[1:-2].ravel(), node[1:-1].ravel()])
    head = np.concatenate([node[2:-1].ravel(), np.roll(node, -1, axis=1)[1:-1].ravel()])
    k = np.concatenate([k1[1:-1].ravel(), k2.ravel()])
    tail, head, k = tail[k > 0], head[k > 0], k[k > 0]
    m = int(node.max()) + 1
    ends = np.zeros((2, m))
    for end, row, link in ((0, node[1], k1[0]), (1, node[-2], k1[-1])):
        ends[end, row[link > 0]] = link[link > 0]
    diagonal = np.bincount(np.r_[tail, head], np.r_[k, k], m) + ends.sum(axis=0)
    here = np.arange(m)
    entries = np.r_[-k, -k, diagonal], (np.r_[tail, head, here], np.r_[head, tail, here])
    return sp.csc_matrix(sp.coo_matrix(entries, (m, m))), ends[0], ends[1]


def superlu(k1, k2):
    from scipy.sparse.linalg import splu

    a, b, out = system(k1, k2)
    options = {"SymmetricMode": True}
    return float(out @ splu(a, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(b)), 0


def pardiso(k1, k2):
    import pypardiso

    a, b, out = system(k1, k2)
    solver = pypardiso.PyPardisoSolver()
    x = pypardiso.spsolve(a.tocsr(), b, solver=solver)
    solver.free_memory(everything=True)
    return float(out @ x), 0


def pyamg_solver(k1, k2):
    import pyamg

    a, b, out = system(k1, k2)
    residuals = []
    x = pyamg.smoothed_aggregation_solver(a.tocsr()).solve(b, tol=1e-8, accel="cg", maxiter=500, residuals=residuals)
    if residuals[-1] > 1e-8 * np.linalg.norm(b):
        raise RuntimeError(f"not converged in 500 iterations, leakage {out @ x:.2g}")
    return float(out @ x), len(residuals) - 1


SOLVERS = {
    "femseal": femseal_solver,
    "elimination": elimination,
    "SuperLU": superlu,
    "PARDISO": pardiso,
    "pyamg": pyamg_solver,
}


def measure(task):
    """Record of one solver on one map."""
    if "answers" in task:
        given = (links(ANSWER_CELLS, task["sigma"], 0.0, seed) for seed in range(task["answers"]))
        return [femseal_solver(*k)[0] for k in given]
    solve = SOLVERS[task["solver"]]
    solve(*links(1000, 1.0, 0.35))
    solve(*links(1000, 1.0, 0.0))
    k = links(task["cells"], task["sigma"], task["closed"])
    forget_peak()
    before = resident("VmRSS")
    times = []
    while len(times) < task["repeats"] and (not times or sum(times) < 10.0):
        start = time.process_time()
        try:
            leakage, iterations = solve(*k)
        except Exception as error:  # any failure of a peer is a result
            record = {"failure": f"{type(error).__name__}: {error}"[:100]}
            return record | {"time": time.process_time() - start, "memory": resident("VmHWM") - before}
        times.append(time.process_time() - start)
    record = {"time": float(np.median(times)), "leakage": leakage, "iterations": iterations}
    return record | {"memory": resident("VmHWM") - before}


def table(records):
    peers = [name for name in SOLVERS if name != "femseal"]
    head = ["links", "σ", "closed", "femseal [s] (iterations)", *peers, "memory of femseal [MB]", "PARDISO"]
    cells = []
    for n in sorted({r["cells"] for r in records}):
        for sigma, closed in MAPS:
            found = {r["solver"]: r for r in records if (r["cells"], r["sigma"], r["closed"]) == (n, sigma, closed)}
            own, exact = found["femseal"], found["elimination"]["leakage"]
            line = [f"{n:.0e}", f"{sigma:g}", f"{closed:g}", f"{own['time']:.3g} ({own['iterations'] or 'direct'})"]
            for name in peers:
                r = found.get(name)
                if r is None:
                    line.append("–")
                elif "failure" in r:
                    line.append(f"failed after {r['time'] / own['time']:.2g}×")
                else:
                    wrong = abs(r["leakage"] / exact - 1) > 0.01
                    line.append(f"{r['time'] / own['time']:.3g}×{', wrong' if wrong else ''}")
            memory = (f"{found[name]['memory'] / 1e6:.0f}" if name in found else "–" for name in ("femseal", "PARDISO"))
            cells.append([*line, *memory])
    return rows(head, cells)


def computed(task):
    """The record of a task, by a process of its own."""
    return task | call(__file__, ["--worker", json.dumps(task)], 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--write", action="store_true", help="write the table")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(json.loads(options.worker))))
        return
    records = []
    for name in options.solvers:
        for sigma, closed in MAPS:
            seconds = size = 0.0
            for n in sorted(options.cells):
                own = name in ("femseal", "elimination")
                if not own and (seconds > PATIENCE or size > MEMORY):
                    break
                task = {"solver": name, "cells": n, "sigma": sigma, "closed": closed, "repeats": options.repeats}
                records.append(kept(task, task, options.records, partial(computed, task)))
                seconds, size = (15 * records[-1][name] for name in ("time", "memory"))
    known = []
    for sigma in (1.0, 2.0, 3.0):
        leakages = call(__file__, ["--worker", json.dumps({"sigma": sigma, "answers": ANSWERS})], 1)
        known.append(f"σ {sigma:g}: {np.mean(leakages):.4f} ± {np.std(leakages):.4f}")
    failures = sorted(
        {
            f"{r['solver']}, {r['cells']:.0e} links, σ {r['sigma']:g}, closed {r['closed']:g}: {r['failure']}"
            for r in records
            if "failure" in r
        }
    )
    text = f"""{machine(PACKAGES)}.
CPU times, those of the peers as multiples of femseal's; "–": would have taken more than {PATIENCE:g} s or {MEMORY / 1e9:g} GB.

{table(records)}

Failures: {"; ".join(failures) or "none"}.

Leakage over the known answer, open maps of {ANSWER_CELLS:.0e} links, mean and standard deviation of {ANSWERS}:
{", ".join(known)}."""
    print(text)
    if options.write:
        save_report(__file__, "Flow over a seal", text)


if __name__ == "__main__":
    main()
