"""Flow over a whole seal: time, memory and error of its links against general sparse solvers.

    python tests/benchmarks/seal.py --sizes 10000 100000
    python tests/benchmarks/seal.py --records seal.jsonl --write

Square seals, periodic along x2, of links drawn one by one: log-normal with a standard deviation σ
of ln k, open or with 35 % of the links closed at random. Peers get the matrix of the open
clusters, with assembly in their time: SuperLU by scipy, MKL's PARDISO, and pyamg with conjugate
gradients. A peer's leakage is wrong where it differs by more than 1 % from elimination's. Times
are CPU times of one thread, in a process of its own, compilation before. Open maps have a known
answer: exp⟨ln k⟩ for a large seal, by duality (Dykhne 1971; Keller 1964).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from common import failures, main, ratio, table, timed
from peers import network_permeability, present

#: (σ, fraction of closed links)
MAPS = ((1.0, 0.0), (3.0, 0.0), (3.0, 0.35))
OWN, PEERS = ("femseal", "elimination"), ("SuperLU", "PARDISO", "pyamg")
#: Maps over which the known answer is averaged, and their links.
ANSWERS, ANSWER_SIZE = 8, 1_000_000


def links(size, sigma, closed, seed=1):
    """Permeabilities along and across of a square seal."""
    n = round(size**0.5)
    rng = np.random.default_rng(seed)
    k1, k2 = (np.exp(sigma * rng.standard_normal(shape)) for shape in ((n, n), (n - 1, n)))
    for k in (k1, k2):
        k[rng.random(k.shape) < closed] = 0.0
    return k1, k2


def solved(solver, k1, k2):
    """Conductance of a square seal, and iterations where they are told."""
    from femseal.flow import Stencil, solve_flow

    if solver in PEERS:
        return network_permeability(k1, k2, solver), 0
    if solver == "elimination":
        return solve_flow(Stencil(k1, k2), solver=solver).conductance, 0
    flow = solve_flow(Stencil.network(k1, k2), rtol=1e-8)
    return flow.conductance, flow.iterations


def measure(task):
    """Record of one solver on one map, or the mean of the known answer."""
    if task["solver"] == "known answer":
        given = (links(ANSWER_SIZE, task["σ"], 0.0, seed) for seed in range(ANSWERS))
        found = [solved("femseal", *k)[0] for k in given]
        return {"seconds": 0.0, "mean": np.mean(found), "spread": np.std(found)}
    for closed in (0.35, 0.0):
        solved(task["solver"], *links(1000, 1.0, closed))
    k = links(task["size"], task["σ"], task["closed"])
    found, record = timed(partial(solved, task["solver"], *k), task["repeats"])
    return record if found is None else record | {"leakage": found[0], "iterations": found[1]}


def series(sizes, repeats):
    """One series for each solver and map, and the known answers."""
    for solver in (*OWN, *present(PEERS)):
        for sigma, closed in MAPS:
            task = {"solver": solver, "σ": sigma, "closed": closed, "repeats": repeats}
            yield [task | {"size": size} for size in sizes]
    yield [{"solver": "known answer", "σ": s, "size": ANSWER_SIZE} for s in (1.0, 2.0, 3.0)]


def report(records):
    """The table of all records, and the known answers."""
    others = [*OWN[1:], *PEERS]
    head = ["links", "σ", "closed", "femseal [s] (iterations)", *others]
    head += ["memory of femseal [MB]", "memory of PARDISO [MB]"]
    known = [r for r in records if r["solver"] == "known answer"]
    maps = {}
    for r in records:
        if "closed" in r:
            maps.setdefault((r["size"], r["σ"], r["closed"]), {})[r["solver"]] = r
    cells = []
    for (size, sigma, closed), found in sorted(maps.items()):
        own, exact = found["femseal"], found["elimination"]["leakage"]
        line = [f"{size:.0e}", f"{sigma:g}", f"{closed:g}"]
        line.append(f"{own['seconds']:.3g} ({own['iterations'] or 'direct'})")
        for r in map(found.get, others):
            wrong = r and abs(r.get("leakage", exact) / exact - 1) > 0.01
            line.append(ratio(r, own) + (", wrong" if wrong else ""))
        memory = (found.get(name) for name in ("femseal", "PARDISO"))
        cells.append([*line, *(f"{r['bytes'] / 1e6:.0f}" if r else "–" for r in memory)])
    answers = (f"{r['mean']:.4f} ± {r['spread']:.4f} for σ = {r['σ']:g}" for r in known)
    return f"""The table shows CPU times. The times of the other programs are given as multiples of the time of femseal. "–" means that a run would
have taken too long. σ is the standard deviation
of ln k, and "closed" the fraction of the links that are closed.

{table(head, cells)}

{failures(records, "solver", "size", "σ", "closed")}

The exact leakage of a large network without closed links is known. The leakage by femseal divided by the exact one, as mean
and standard deviation of {ANSWERS} networks of {ANSWER_SIZE:.0e} links, is {", ".join(answers)}."""


if __name__ == "__main__":
    packages = ("pyamg", "scipy", "pypardiso")
    sizes = (10_000, 100_000, 1_000_000)
    main(__file__, "Flow over a seal", packages, sizes, series, measure, report, 90.0)
