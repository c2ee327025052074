"""The calibration set of the model errors: leakage by each method over the deterministic one, on scenes drawn at random.

    python tests/benchmarks/calibration.py --records calibration.jsonl --write

Of most kinds of face `--long` faces
of four breadths are solved in full and compared with seals drawn from one breadth. `--write` puts the set where the package reads it.
`--seeds pilot` takes other scenes, by which the forms of the difficulties were chosen.
"""

from __future__ import annotations

import argparse
import csv
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from common import kept
from drawn_scenes import CALIBRATION, KINDS, PILOT, PIXEL, Drawn

#: Length of the long faces in breadths, realisations and windows of the seals drawn from one breadth.
LENGTH, REALISATIONS, LIBRARY = 4, 24, 32
#: Kinds of long faces: a breadth of a ground one holds too little of its lay to draw seals from.
LONG_KINDS = tuple(kind for kind in KINDS if kind not in ("ground", "filtered"))
#: The first seeds of ladders, by which the form of the difficulty of "uniform" was chosen: they are left out.
LOOKED_AT = 5
#: Samplers and the pressures of their windows.
SAMPLERS = {
    "runs": ("runs", "place"),
    "block": ("block", "place"),
    "global": (None, "global"),
    "uniform": (None, "uniform"),
}
COLUMNS = ("method", "surface", "scene", "step", "log_ratio", "own", "decades", "scatter")


def log_ratio(leakage, truth):
    """ln(leakage/truth), inf where only the truth is sealed, 0 where both are."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((leakage == 0) & (truth == 0), 0.0, np.log(leakage / truth))


def rows_of(method, drawn, steps, leakage, truth, **features):
    """A row of the set for every step that leaks by the method; a sealed one has no distance."""
    from femseal.budget.conformal import decades

    every = {"log_ratio": log_ratio(leakage, truth), "decades": decades(leakage), **features}
    for s in range(len(steps)):
        row = {"method": method, "surface": drawn.kind, "scene": f"{drawn.kind} {drawn.seed}", "step": s}
        row |= {name: float(f"{values[s]:.4g}") for name, values in every.items()}
        if np.isfinite(leakage[s]) and np.isfinite(truth[s]) and (leakage[s] > 0 or truth[s] > 0):
            yield row


def piece_of(drawn):
    """The scene of the first breadth of a long face, whose ends along x2 do not meet."""
    from femseal import Topography

    scene = drawn.scene()
    heights = np.ascontiguousarray(scene.surface.heights[:, : drawn.points[0]])
    return replace(scene, surface=Topography(heights, scene.surface.spacing, (scene.surface.periodic[0], False)))


def drawn_from_a_piece(task):
    """Rows of seals drawn from one breadth of a long face, whose truth is the deterministic solution of all of it."""
    from femseal import FemsealError, Sampling, deterministic, stochastic
    from femseal.budget.estimates import scatter_of

    drawn = Drawn(task["kind"], task["seed"], LENGTH)
    truth, piece, (n, _) = deterministic(drawn.scene()).leakage, piece_of(drawn), drawn.points
    rows = []
    for method in task["methods"]:
        sampler, pressure = SAMPLERS[method]
        sampling = Sampling(LENGTH * n * PIXEL, REALISATIONS, LIBRARY, seed=1, sampler=sampler, pressure=pressure)
        try:
            seals = stochastic(piece, (drawn.cells[0],) * 2, sampling)
        except FemsealError:  # no window of the face bears the load
            continue
        # the long face is one realisation of the seals, and scatters as they do
        scatter = scatter_of(seals)
        rows += rows_of(
            method,
            drawn,
            piece.steps,
            seals.quantile(0.5),
            truth,
            own=1.96 * scatter,
            scatter=scatter,
        )
    return task | {"rows": rows}


def tasks_of(seeds, long, ladders):
    """Every scene to be solved, and what is done with it."""
    for seed in seeds[:long]:
        for kind in KINDS:
            for methods, wanted in (
                (["runs", "block"], range(long)),
                (["global", "uniform"], range(LOOKED_AT, ladders)),
            ):
                if seed - seeds[0] in wanted and kind in LONG_KINDS:
                    yield {"kind": kind, "seed": seed, "methods": methods}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--long", type=int, default=24, help="long faces of each kind")
    parser.add_argument(
        "--ladders", type=int, default=20, help="those of them up to which ladders of windows are compared"
    )
    parser.add_argument("--seeds", default="calibration", choices=("calibration", "pilot"))
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--write", action="store_true", help="put the set where the package reads it")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)  # logarithms of sealed steps
    seeds = CALIBRATION if options.seeds == "calibration" else PILOT
    rows = []
    for task in tasks_of(seeds, options.long, options.ladders):
        rows += kept(task, ("kind", "seed", "methods"), options.records, partial(drawn_from_a_piece, task))["rows"]
    rows.sort(key=lambda row: list(SAMPLERS).index(row["method"]))
    print({m: len({r["scene"] for r in rows if r["method"] == m}) for m in dict.fromkeys(r["method"] for r in rows)})
    if options.write:
        from femseal.budget.conformal import CALIBRATION as PATH

        with PATH.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
