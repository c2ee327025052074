"""Count how often the interval of the error budget contains the true leakage, on random scenes.

    python tests/benchmarks/budget_coverage.py --scenes 1 --long 0
    python tests/benchmarks/budget_coverage.py --records solutions --write

The scenes were not used to develop or to calibrate the error budget. The true leakage is the deterministic
leakage on twice the points per side. For a filtered surface, the true leakage is that of the unfiltered surface
on a grid that resolves all its waves. For stochastic seals, the true leakage is that of a surface as long as
the seal; the seals are simulated from a square patch of this surface. The interval is the interval of
`femseal.error_budget` with the coarser solutions that a run computes.

Errors of one scene at several loads are similar. For the binomial confidence interval (Clopper & Pearson,
1934), one load of each scene is therefore chosen at random among the loads that leak more than 1e-3 of the
first load.
"""

from __future__ import annotations

import argparse
import pickle
import warnings
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from common import machine, print_report, table
from drawn_scenes import FINER, HELD_OUT, KINDS, PIXEL, Drawn
from femseal import Sampling, Topography, deterministic, error_budget, stochastic
from femseal.budget import CoarserSolution, effective_pressure_part

#: Length of the long faces in breadths, and realisations of the seals drawn from one breadth.
LENGTH, REALISATIONS = 4, 24
#: Kinds of long faces: a breadth of a ground one holds too little of its lay to draw seals from.
LONG_KINDS = tuple(kind for kind in KINDS if kind not in ("ground", "filtered"))
#: Leakage over that of the first load above which errors are counted by themselves.
FLOOR = 1e-3


def coarser(scene, surface, leakage):
    """Solve a scene on another surface, and return the solution together with the leakage on the original surface."""
    coarser_leakage = deterministic(replace(scene, surface=surface)).leakage
    return CoarserSolution(surface.shape, coarser_leakage, leakage, surface.rms_slope)


def whole_face(drawn):
    """Solve a scene by the deterministic method, with all solutions that its error budget needs, and its true leakage."""
    scene, solutions = drawn.scene(), {}
    whole = deterministic(scene)
    half = tuple(n // 2 for n in drawn.points)
    solutions["coarse"] = [coarser(scene, scene.surface.resample(half), whole.leakage)]
    if drawn.kind == "filtered":
        smooth = scene.surface.low_pass(16 * PIXEL).resample(half)
        unfiltered = drawn.scene(FINER, filtered=False)
        solutions |= {
            "filtered": coarser(scene, smooth, whole.leakage),
            "kept_slope": scene.surface.rms_slope / unfiltered.surface.rms_slope,
        }
        truth = deterministic(unfiltered).leakage
    else:
        truth = deterministic(drawn.scene(2)).leakage
    return {
        "scene": scene,
        "studies": {"deterministic": whole},
        "truth": truth,
        "solutions": solutions,
    }


def strip(kind, seed):
    """Solve a scene of a kind and a seed by the deterministic method."""
    return whole_face(Drawn(kind, seed))


def cell_of(drawn):
    """Return the scene of a square patch at the beginning of a long surface; the patch is not periodic along x2."""
    scene = drawn.scene()
    heights = np.ascontiguousarray(scene.surface.heights[:, : drawn.points[0]])
    return replace(
        scene,
        surface=Topography(heights, scene.surface.spacing, (scene.surface.periodic[0], False)),
    )


def drawn_seals(kind, seed):
    """Simulate stochastic seals from a square patch of a long surface."""
    drawn = Drawn(kind, seed, LENGTH)
    truth = deterministic(drawn.scene(2)).leakage
    scene, (n, _) = cell_of(drawn), drawn.points
    sampling = Sampling(LENGTH * n * PIXEL, REALISATIONS, seed=1)
    seals = replace(stochastic(scene, None, sampling), median_seal=None)
    half = scene.surface.resample((n // 2, n // 2))
    coarse = coarser(scene, half, deterministic(scene).leakage)
    return {
        "scene": scene,
        "studies": {"drawn seals": seals},
        "truth": truth,
        "solutions": {"coarse": [coarse]},
    }


def solved(function, kind, seed, folder):
    """Return the result of a function for a scene, from a file in the folder if there is one."""
    path = folder and folder / f"{function.__name__} {kind} {seed}.pickle"
    if path and path.exists():
        return pickle.loads(path.read_bytes())
    result = function(kind, seed)
    if path:
        path.write_bytes(pickle.dumps(result))
        print(path.stem, flush=True)
    return result


def judged(kind, seed, result):
    """Yield a record for each load step of each study of a scene.

    A record contains the error, the half-width, and whether the interval contains the true leakage.
    """
    truth = result["truth"]
    for method, study in result["studies"].items():
        budget = error_budget(result["scene"], study, **result["solutions"])
        part = effective_pressure_part(result["scene"], study)  # a run includes this part
        if part is not None:
            budget = replace(budget, parts=(*budget.parts, part))
        q, lower, upper = budget.leakage, budget.lower, budget.upper
        with np.errstate(divide="ignore", invalid="ignore"):
            below, above = np.log(q / lower), np.log(upper / q)
        error = np.where((q == 0) & (truth == 0), 0.0, np.log(truth / q))
        is_contained = np.where(q == 0, truth <= upper, (error <= above) & (-error <= below))
        leaks = q > FLOOR * q[0]
        order = np.random.default_rng([KINDS.index(kind), seed]).permutation(len(q))
        picked = next((s for s in order if leaks[s]), None)
        for s in range(len(q)):
            if np.isfinite(q[s]) and np.isfinite(truth[s]):
                yield {
                    "method": method,
                    "kind": kind,
                    "seed": seed,
                    "error": abs(error[s]),
                    "width": (below[s] + above[s]) / 2,
                    "holds": bool(is_contained[s]),
                    "state": "sealed" if q[s] == 0 else "leaks" if leaks[s] else "near closing",
                    "picked": s == picked,
                }


HEAD = [
    "contained, one load per scene",
    "95 % confidence interval of this fraction",
    "contained, all loads",
]
HEAD += ["median error", "median half-width", "half-width / error"]


def line(states):
    """Return table cells for some load steps: counts, coverage, errors and half-widths.

    The counts are for one load of each scene, all other cells for all loads that leak.
    """
    leaks = [s for s in states if s["state"] == "leaks"]
    picked = [s["holds"] for s in states if s["picked"]]
    if not picked:
        return None
    contained = sum(picked)
    low, high = binomtest(contained, len(picked)).proportion_ci(0.95, "exact")
    error, width = (np.median([s[name] for s in leaks]) for name in ("error", "width"))
    counts = [f"{contained} of {len(picked)}", f"{low:.1%} … {high:.1%}"]
    counts.append(f"{np.mean([s['holds'] for s in leaks]):.1%}")
    return [*counts, f"{error:.2%}", f"{width:.2%}", f"{width / error:.1f}"]


def report(states):
    """Write tables by method and by kind of surface, and a table of the loads near closing and of the sealed loads."""
    methods = dict.fromkeys(s["method"] for s in states)
    cells, closing = [], []
    for method, kind in product(methods, ("all", *KINDS)):
        chosen = [s for s in states if s["method"] == method and kind in ("all", s["kind"])]
        if counts := line(chosen):
            cells.append([method, kind, *counts])
    for method, state in product(methods, ("near closing", "sealed")):
        chosen = [s["holds"] for s in states if (s["method"], s["state"]) == (method, state)]
        closing.append([method, state, f"{sum(chosen)} of {len(chosen)}"])
    beyond = "The next table covers sealed loads, and loads near closing, at which the leakage is below 1e-3 of its first value:"
    faces = table(["method", "kind of surface", *HEAD], cells)
    return f"{faces}\n\n{beyond}\n\n{table(['method', 'state', 'contained'], closing)}"


def tasks_of(scenes, long, seeds=HELD_OUT):
    """Yield the tasks: a function, a kind of surface and a seed."""
    for seed in seeds[: max(scenes, long)]:
        for kind in KINDS:
            if seed - seeds[0] < scenes:
                yield strip, kind, seed
            if seed - seeds[0] < long and kind in LONG_KINDS:
                yield drawn_seals, kind, seed


def main():
    """Solve the scenes or read their stored solutions, and print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=18, help="of each kind of face")
    parser.add_argument("--long", type=int, default=10, help="long faces of each kind")
    parser.add_argument("--records", type=Path, help="folder in which solutions are kept")
    parser.add_argument("--write", action="store_true", help="write the tables beside the script")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)  # logarithms of sealed steps
    if options.records:
        options.records.mkdir(exist_ok=True)
    tasks, states = list(tasks_of(options.scenes, options.long)), []
    for function, kind, seed in tasks:
        states += judged(kind, seed, solved(function, kind, seed, options.records))
    text = f"{machine()}; {len(tasks)} scenes.\n\n{report(states)}"
    print_report(__file__, "Coverage of the error budget", text, options.write)


if __name__ == "__main__":
    main()
