"""How often the error budget holds the truth, on scenes drawn at random that neither budget nor calibration has seen.

    python tests/benchmarks/budget_coverage.py --records solutions --write

The truth is the deterministic leakage on twice the points a side; of filtered faces on the grid that resolves all waves,
with the waves that the filter had removed; of drawn seals that of a face as long as the seal, of which the seals have seen
one breadth. The band is that of `femseal.error_budget` with the coarser solutions that a run takes. One load of each scene is
drawn, of those that leak more than 1e-3 of the first: errors of one scene at several loads are alike, so the binomial
interval (Clopper & Pearson, 1934) is that of these. `--write` puts the tables and the picture beside this file.
"""

from __future__ import annotations

import argparse
import pickle
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import machine, rows, save_report
from drawn_scenes import FINER, HELD_OUT, KINDS, PIXEL, Drawn

#: Length of the long faces in breadths, and realisations of the seals drawn from one breadth.
LENGTH, REALISATIONS = 4, 24
#: Kinds of long faces: a breadth of a ground one holds too little of its lay to draw seals from.
LONG_KINDS = tuple(kind for kind in KINDS if kind not in ("ground", "filtered"))
#: Leakage over that of the first load above which errors are counted by themselves.
FLOOR = 1e-3


def coarser(scene, surface, leakage, solve):
    """The solution of a scene on another surface at the steps that a run takes, beside its own leakage."""
    from femseal.budget import CoarserSolution
    from femseal.refinement.coarser import at_some_steps

    some = at_some_steps(scene, leakage)
    found = solve(replace(some, surface=surface)).leakage
    own = leakage[[scene.steps.index(step) for step in some.steps]]
    return CoarserSolution(surface.shape, some.steps, found, own)


def whole_face(drawn):
    """A scene by the deterministic method, with what its budget needs, and its truth."""
    from femseal import deterministic

    scene, solutions = drawn.scene(), {}
    whole = deterministic(scene)
    half = tuple(n // 2 for n in drawn.points)
    solutions["coarse"] = [coarser(scene, scene.surface.resample(half), whole.leakage, deterministic)]
    if drawn.kind == "filtered":
        smooth = scene.surface.low_pass(16 * PIXEL).resample(half)
        solutions |= {"filtered": coarser(scene, smooth, whole.leakage, deterministic), "octaves": np.log2(FINER)}
        truth = deterministic(drawn.scene(FINER, filtered=False)).leakage
    else:
        truth = deterministic(drawn.scene(2)).leakage
    return {"scene": scene, "studies": {"deterministic": whole}, "truth": truth, "solutions": solutions}


def strip(kind, seed):
    """A scene by the deterministic method."""
    found = whole_face(Drawn(kind, seed))
    # a budget needs no fields
    bare = {"gap": None, "contact_pressure": None, "fluid_pressure": None}
    return found | {"studies": {name: replace(study, **bare) for name, study in found["studies"].items()}}


def piece_of(drawn):
    """The scene of the first breadth of a long face, whose ends along x2 do not meet."""
    from femseal import Topography

    scene = drawn.scene()
    heights = np.ascontiguousarray(scene.surface.heights[:, : drawn.points[0]])
    return replace(scene, surface=Topography(heights, scene.surface.spacing, (scene.surface.periodic[0], False)))


def drawn_seals(kind, seed):
    """Seals drawn from one breadth of a long face."""
    from femseal import Sampling, deterministic, stochastic

    drawn = Drawn(kind, seed, LENGTH)
    truth = deterministic(drawn.scene(2)).leakage
    scene, (n, _) = piece_of(drawn), drawn.points
    sampling = Sampling(LENGTH * n * PIXEL, REALISATIONS, seed=1)
    seals = replace(stochastic(scene, None, sampling), median_seal=None)
    coarse = coarser(scene, scene.surface.resample((n // 2, n // 2)), deterministic(scene).leakage, deterministic)
    return {"scene": scene, "studies": {"drawn seals": seals}, "truth": truth, "solutions": {"coarse": [coarse]}}


def solved(function, kind, seed, folder):
    """What a function gives for a scene, from a file if there is one."""
    path = folder and folder / f"{function.__name__} {kind} {seed}.pickle"
    if path and path.exists():
        return pickle.loads(path.read_bytes())
    found = function(kind, seed)
    if path:
        path.write_bytes(pickle.dumps(found))
        print(path.stem, flush=True)
    return found


def judged(kind, seed, found):
    """Every step of every study of a scene: the error, the band, and whether it holds the truth."""
    from femseal import error_budget
    from femseal.budget import effective_pressure_part

    truth = found["truth"]
    for method, study in found["studies"].items():
        budget = error_budget(found["scene"], study, **found["solutions"])
        if (part := effective_pressure_part(found["scene"], study)) is not None:  # part of the band of a run
            budget = replace(budget, parts=(*budget.parts, part))
        q, lower, upper = budget.leakage, budget.lower, budget.upper
        with np.errstate(divide="ignore", invalid="ignore"):
            below, above = np.log(q / lower), np.log(upper / q)
        error = np.where((q == 0) & (truth == 0), 0.0, np.log(truth / q))
        holds = np.where(q == 0, truth <= upper, (error <= above) & (-error <= below))
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
                    "holds": bool(holds[s]),
                    "state": "sealed" if q[s] == 0 else "leaks" if leaks[s] else "near closing",
                    "picked": s == picked,
                    "limiting": budget.limiting(s),
                }


def interval(count, of):
    """95 % interval of a share, Clopper & Pearson."""
    from scipy.stats import binomtest

    low, high = binomtest(count, of).proportion_ci(0.95, "exact")
    return f"{low:.1%} … {high:.1%}"


def line(name, states):
    """A line of the table: count of the drawn loads, of all loads, errors and widths."""
    states = list(states)
    picked = [s for s in states if s["picked"]]
    leaks = [s for s in states if s["state"] == "leaks"]
    if not picked:
        return None
    held = sum(s["holds"] for s in picked)
    whole = {}
    for s in leaks:
        key = s["method"], s["kind"], s["seed"]
        whole[key] = whole.get(key, True) and s["holds"]
    error, width = (float(np.median([s[k] for s in leaks])) for k in ("error", "width"))
    worst = {}
    for s in leaks:
        key = s["method"], s["kind"], s["seed"]
        worst[key] = max(worst.get(key, s), s, key=lambda state: state["error"])
    at_worst = [float(np.median([s[k] for s in worst.values()])) for k in ("error", "width")]
    return [
        name,
        f"{held} of {len(picked)}",
        interval(held, len(picked)),
        f"{np.mean([s['holds'] for s in leaks]):.1%}",
        f"{np.mean(list(whole.values())):.0%}",
        f"{error:.2%}",
        f"{width:.2%}",
        f"{width / error:.1f}",
        f"{at_worst[1] / at_worst[0]:.1f}",
    ]


HEAD = [
    "",
    "held, one load of each scene",
    "95 % interval",
    "held, all loads",
    "scenes held at all loads",
    "median error",
    "median half-width",
    "ratio",
    "ratio at the largest error of each scene",
]


def tables(states):
    methods = list(dict.fromkeys(s["method"] for s in states))
    by_method = [line(m, (s for s in states if s["method"] == m)) for m in methods]
    parts = ["By method:\n\n" + rows(HEAD, [cells for cells in by_method if cells])]
    for method in methods:
        of = [s for s in states if s["method"] == method]
        cells = [line(kind, (s for s in of if s["kind"] == kind)) for kind in KINDS]
        parts.append(f"{method[0].upper()}{method[1:]}, by kind of face:\n\n" + rows(HEAD, [c for c in cells if c]))
    cells = []
    for method in methods:
        for state in ("near closing", "sealed"):
            of = [s for s in states if s["method"] == method and s["state"] == state]
            if of:
                held = sum(s["holds"] for s in of)
                cells.append([method, state, f"{held} of {len(of)}", f"{held / len(of):.1%}"])
    parts.append(
        "Loads that leak less than 1e-3 of the first, and sealed ones:\n\n" + rows(["", "", "held", "share"], cells)
    )
    return "\n\n".join(parts)


def picture(states, path):
    """Errors over half-widths: each point below the diagonal is held."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    methods = list(dict.fromkeys(s["method"] for s in states))
    figure, axes = plt.subplots(
        1, len(methods), figsize=(4 * len(methods), 4), layout="constrained", sharex=True, sharey=True
    )
    for ax, method in zip(np.atleast_1d(axes), methods, strict=True):
        for n, kind in enumerate(KINDS):
            of = [s for s in states if s["method"] == method and s["kind"] == kind and s["state"] == "leaks"]
            width, error = (np.clip([s[k] for s in of], 1e-5, 30.0) for k in ("width", "error"))
            ax.loglog(width, error, ".", color=f"C{n}", alpha=0.6, label=kind if len(of) else None)
        ax.plot([1e-5, 30], [1e-5, 30], "k", lw=1)
        ax.plot([1e-5, 30], [1e-5 / 3, 10], "k:", lw=1)
        ax.set(xlabel="half-width of the band of ln(leakage)", title=method, xlim=(1e-4, 30), ylim=(1e-5, 30))
    np.atleast_1d(axes)[0].set_ylabel("error of ln(leakage)")
    np.atleast_1d(axes)[0].legend(fontsize=8)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def tasks_of(scenes, long, seeds=HELD_OUT):
    for seed in seeds[: max(scenes, long)]:
        for kind in KINDS:
            if seed - seeds[0] < scenes:
                yield strip, kind, seed
            if seed - seeds[0] < long and kind in LONG_KINDS:
                yield drawn_seals, kind, seed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=18, help="of each kind of face")
    parser.add_argument("--long", type=int, default=10, help="long faces of each kind")
    parser.add_argument("--records", type=Path, help="folder in which solutions are kept")
    parser.add_argument("--write", action="store_true", help="write the tables and the picture")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)  # logarithms of sealed steps
    if options.records:
        options.records.mkdir(exist_ok=True)
    tasks = list(tasks_of(options.scenes, options.long))
    states = [
        s for function, kind, seed in tasks for s in judged(kind, seed, solved(function, kind, seed, options.records))
    ]
    text = f"{machine({})}; {len(tasks)} scenes.\n\n{tables(states)}"
    limits = {}
    for s in states:
        if s["picked"]:
            limits.setdefault(s["method"], []).append(s["limiting"])
    told = {m: {part: of.count(part) for part in dict.fromkeys(of)} for m, of in limits.items()}
    text += (
        "\n\nWidest part at the drawn loads: "
        + "; ".join(
            f"{m}: " + ", ".join(f"{part} {count}" for part, count in counts.items()) for m, counts in told.items()
        )
        + ".\n\n![Errors over half-widths](budget_coverage.png)"
    )
    print(text)
    if options.write:
        picture(states, Path(__file__).with_suffix(".png"))
        save_report(__file__, "Coverage of the error budget", text)


if __name__ == "__main__":
    main()
