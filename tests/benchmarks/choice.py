"""Compare rules that choose between multigrid and elimination, on networks with different conductances.

    python tests/benchmarks/choice.py --sizes 64
    python tests/benchmarks/choice.py --records choice.jsonl --write

"Rule" is the choice of femseal by the number of nodes and the roughness of the conductances. "Multigrid first" always
tries multigrid, and changes to elimination after 120 iterations, as the rule does. "Elimination first" always takes
elimination. The networks are square grids, and slender grids through whose narrow side the fluid flows; all are
periodic along x2. The three ways are timed in turn on one thread, after all functions have been compiled, and the
shortest CPU time of each one counts.
"""

from __future__ import annotations

import time

import numpy as np

from common import main, table
from flow import contact_gap, cut_gap

#: What `choice._suits_multigrid` returns; None leaves the rule of femseal in place.
WAYS = {"rule": None, "multigrid first": True, "elimination first": False}
#: (σ of ln c, fraction of closed links) of independent links.
LINKS = {
    "links, σ = 0.5": (0.5, 0.0),
    "links, σ = 1.5": (1.5, 0.0),
    "links, σ = 3": (3.0, 0.0),
    "links, σ = 1, 30 % closed": (1.0, 0.3),
}
#: Fraction of the surface that a plane cuts off.
CUTS = {"cut, 5 % closed": 0.05, "cut, 35 % closed": 0.35}
SOLVED = "solved contact"
#: Rows of slender grids.
ROWS = 16
SEEDS = 3


def network(kind, n, slender, seed):
    """Return a network of n² nodes."""
    from femseal.flow import Stencil
    from femseal.flow.cell import cell_stencil

    if kind in LINKS:
        sigma, closed = LINKS[kind]
        rows, columns = (ROWS, n**2 // ROWS) if slender else (n, n)
        rng = np.random.default_rng(seed)
        links = [np.exp(sigma * rng.standard_normal((m, columns))) for m in (rows, rows - 1)]
        for c in links:
            c[rng.random(c.shape) < closed] = 0.0
        return Stencil.network(*links, ring=True)
    gap = contact_gap(n) if kind == SOLVED else cut_gap(n, CUTS[kind])
    return cell_stencil(np.roll(gap, seed * n // SEEDS, axis=0), (1.0, 1.0), "periodic")


def measure(task):
    """Return the shortest CPU time [s] of each way for each network of a kind, and the solvers that the rule chose."""
    from femseal.flow import solve_flow
    from femseal.flow.solvers import choice

    rule = choice._suits_multigrid
    networks = [network(task["kind"], task["n"], task["slender"], seed) for seed in range(SEEDS)]
    times = np.full((len(networks), len(WAYS)), np.inf)
    solvers = set()
    for repetition in range(1 + task["repeats"]):
        for i, stencil in enumerate(networks):
            # in turn, each way is the first, which finds other data in the caches
            for j in np.roll(range(len(WAYS)), repetition):
                suits = list(WAYS.values())[j]
                choice._suits_multigrid = rule if suits is None else lambda *_, s=suits: s
                start = time.process_time()
                flow = solve_flow(stencil)
                seconds = time.process_time() - start
                if suits is None:
                    solvers.add(flow.solver)
                if repetition > 0:  # the first solutions load compiled functions
                    times[i, j] = min(times[i, j], seconds)
    return {"seconds": float(times.sum()), "times": times.tolist(), "solvers": sorted(solvers)}


def series(sizes, repeats):
    """Yield a series of tasks over the sizes for each kind of network, square or slender."""
    for slender in (False, True):
        for kind in LINKS if slender else (*LINKS, *CUTS, SOLVED):
            task = {"kind": kind, "slender": slender}
            yield [
                # small networks are solved more often, because their times vary more
                task | {"n": n, "size": n**2, "repeats": repeats * max(1, (128 // n) ** 2)}
                for n in sizes
            ]


def report(records):
    """Write the times of the ways as multiples of the time of the faster solver, for each kind and over all networks."""
    cells, everything = [], []
    for record in records:
        times = np.array(record["times"])
        ratios = times / times[:, 1:].min(axis=1, keepdims=True)
        everything.append(ratios)
        n = record["n"]
        grid = f"{ROWS} × {n**2 // ROWS}" if record["slender"] else f"{n} × {n}"
        milliseconds = f"{1e3 * np.median(times[:, 1:].min(axis=1)):.3g}"
        medians = [f"{r:.2f}" for r in np.median(ratios, axis=0)]
        chosen = " or ".join(record["solvers"])
        cells.append([record["kind"], grid, milliseconds, chosen, *medians])
    ratios = np.concatenate(everything)
    summary = [
        [name, *(f"{x:.2f}" for x in (np.exp(np.log(r).mean()), np.quantile(r, 0.9), r.max()))]
        for name, r in zip(WAYS, ratios.T, strict=True)
    ]
    return f"""The time of each way is divided by the time of the faster one of "multigrid first" and "elimination first". The table
gives the median of {SEEDS} networks; "closed" is the fraction of the links or of the surface.

{table(["network", "grid", "faster [ms]", "solver of the rule", *WAYS], cells)}

Over all {len(ratios)} networks:

{table(["way", "geometric mean", "exceeded by one of ten", "largest"], summary)}"""


if __name__ == "__main__":
    main(__file__, "Rules of choice", (), (64, 256), series, measure, report)
