"""Compare the flow across a whole seal with general sparse solvers: time, memory and error.

    python tests/benchmarks/seal.py --sizes 10000 100000
    python tests/benchmarks/seal.py --records seal.jsonl --write

The seals are square networks of independent links, periodic along x2. The conductances k are log-normal with
the standard deviation σ of ln k; all links are open, or 35 % of the links are closed at random. The other
programs get the matrix of the open clusters, and their time includes its assembly: SuperLU of scipy, PARDISO of
MKL, and pyamg with conjugate gradients. A leakage that differs by more than 1 % from the leakage by elimination
counts as wrong. All times are CPU times of one thread in a process of its own, after all functions have been
compiled. Networks without closed links have a known leakage: for a large seal, the permeability is exp⟨ln k⟩,
by duality (Dykhne 1971; Keller 1964).
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
    """Generate the conductances of the links of a square seal, along x1 and along x2."""
    n = round(size**0.5)
    rng = np.random.default_rng(seed)
    k1, k2 = (np.exp(sigma * rng.standard_normal(shape)) for shape in ((n, n), (n - 1, n)))
    for k in (k1, k2):
        k[rng.random(k.shape) < closed] = 0.0
    return k1, k2


def solved(solver, k1, k2):
    """Return the conductance of a square seal, and the number of iterations if the solver states it (otherwise 0)."""
    from femseal.flow import Stencil, solve_flow

    if solver in PEERS:
        return network_permeability(k1, k2, solver), 0
    if solver == "elimination":
        return solve_flow(Stencil(k1, k2), solver=solver).conductance, 0
    flow = solve_flow(Stencil.network(k1, k2), rtol=1e-8)
    return flow.conductance, flow.iterations


def measure(task):
    """Return the record of one solver on one network, or the mean and the scatter of the known answer."""
    if task["solver"] == "known answer":
        networks = (links(ANSWER_SIZE, task["σ"], 0.0, seed) for seed in range(ANSWERS))
        result = [solved("femseal", *k)[0] for k in networks]
        return {"seconds": 0.0, "mean": np.mean(result), "spread": np.std(result)}
    for closed in (0.35, 0.0):
        solved(task["solver"], *links(1000, 1.0, closed))
    k = links(task["size"], task["σ"], task["closed"])
    result, record = timed(partial(solved, task["solver"], *k), task["repeats"])
    return record if result is None else record | {"leakage": result[0], "iterations": result[1]}


def series(sizes, repeats):
    """Yield a series of tasks for each solver and kind of network, and the tasks of the known answer."""
    for solver in (*OWN, *present(PEERS)):
        for sigma, closed in MAPS:
            task = {"solver": solver, "σ": sigma, "closed": closed, "repeats": repeats}
            yield [task | {"size": size} for size in sizes]
    yield [{"solver": "known answer", "σ": s, "size": ANSWER_SIZE} for s in (1.0, 2.0, 3.0)]


def report(records):
    """Write the table of all records, and the comparison with the known answer."""
    others = [*OWN[1:], *PEERS]
    head = ["links", "σ", "closed", "femseal [s] (iterations)", *others]
    head += ["memory of femseal [MB]", "memory of PARDISO [MB]"]
    known = [r for r in records if r["solver"] == "known answer"]
    maps = {}
    for r in records:
        if "closed" in r:
            maps.setdefault((r["size"], r["σ"], r["closed"]), {})[r["solver"]] = r
    cells = []
    for (size, sigma, closed), by_solver in sorted(maps.items()):
        femseal_record, exact = by_solver["femseal"], by_solver["elimination"]["leakage"]
        line = [f"{size:.0e}", f"{sigma:g}", f"{closed:g}"]
        line.append(f"{femseal_record['seconds']:.3g} ({femseal_record['iterations'] or 'direct'})")
        for r in map(by_solver.get, others):
            wrong = r and abs(r.get("leakage", exact) / exact - 1) > 0.01
            line.append(ratio(r, femseal_record) + (", wrong" if wrong else ""))
        memory = (by_solver.get(name) for name in ("femseal", "PARDISO"))
        cells.append([*line, *(f"{r['bytes'] / 1e6:.0f}" if r else "–" for r in memory)])
    answers = (f"{r['mean']:.4f} ± {r['spread']:.4f} for σ = {r['σ']:g}" for r in known)
    return f"""The table shows CPU times. The times of the other programs are divided by the time of femseal. "–" means that a run would
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
