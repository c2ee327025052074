"""Drawn seals against whole faces: the calibration of their bands, and how they hold on scenes that nobody has seen.

    python drawn_seals.py calibrate FIRST LAST     # seeds; adds rows to the file in femseal/studies
    python drawn_seals.py evaluate FIRST LAST      # other seeds; writes drawn_seals.md

A scene is a whole face, whose deterministic leakage is the truth, and a patch of it, from which seals are drawn: as
broad as the face ("in place"), and two or four times as broad as the patch ("anywhere").
"""

from __future__ import annotations

import csv
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from drawn_scenes import Drawn

import femseal as fs
from femseal.studies import drawn_error
from femseal.studies.load_curves import first_known

KINDS = ("self-affine", "turned", "milling arcs", "ground", "bumps")
#: Length and breadth of the whole face in sides of the patch.
SHAPES = {"in place": ((4, 1),), "anywhere": ((4, 2), (8, 4))}
#: Decades of the leakage below that of the first load.
DECADES = ((-1.0, 1.0), (1.0, 2.0), (2.0, 3.0))
#: Inlet pressure of a fluid that acts, in parts of the lowest load.
ACTS = (0.1, 0.6)


def scene_of(kind, seed, length, breadth):
    """A whole face, and the patch of it, both under the same loads; every other scene has a fluid that acts."""
    side = 0 if breadth == 1 else 96
    drawn = Drawn(kind, seed, length, side, breadth)
    rng = np.random.default_rng([seed, length, breadth])
    whole, n = drawn.scene(), drawn.numbers["points"]
    acts = seed % 2 == 1
    inlet = rng.uniform(*ACTS) * min(whole.steps.pressures) if acts else 1e7
    whole = replace(whole, fluid_pressure="acts" if acts else "ignored", inlet_pressure=inlet)
    heights = np.ascontiguousarray(whole.surface.heights[:n, :n])
    patch = fs.Topography(heights, whole.surface.spacing, (False, False)).detrend()
    return whole, replace(whole, surface=patch)


def solved(kind, seed, length, breadth):
    """Leakage of the whole face, and the seals drawn from the patch."""
    whole, patch = scene_of(kind, seed, length, breadth)
    truth = fs.deterministic(whole).leakage
    size = whole.surface.size
    wide = size[0] if breadth > 1 else None
    drawn = fs.stochastic(patch, None, fs.Sampling(size[1], seed=1, breadth=wide))
    return whole, truth, drawn


def rows(kinds, seeds, shapes):
    """A row for each step of each scene that leaks."""
    for shape in shapes:
        for length, breadth in SHAPES[shape]:
            for seed in seeds:
                for kind in kinds:
                    start = time.perf_counter()
                    try:
                        whole, truth, drawn = solved(kind, seed, length, breadth)
                    except fs.FemsealError as reason:
                        print(shape, kind, seed, reason, file=sys.stderr)
                        continue
                    q = drawn.quantile(0.5)
                    if not truth[first_known(truth)] > 0:
                        continue
                    with np.errstate(divide="ignore", invalid="ignore"):
                        ratio = np.log(q / truth)
                    for s, step in enumerate(whole.steps):
                        if not np.isfinite(q[s]) or not np.isfinite(truth[s]) or truth[s] == q[s] == 0:
                            continue
                        yield {
                            "kind": shape,
                            "surface": kind,
                            "scene": f"{kind} {seed} {breadth}",
                            "step": s,
                            "log_ratio": f"{ratio[s]:.4g}",
                            "decades": f"{drawn_error.decades(q)[s]:.4g}",
                            "scatter": f"{drawn.scatter[s]:.4g}",
                            "branch": step.branch,
                            "fluid": whole.fluid_pressure,
                            "truth": f"{drawn_error.decades(truth)[s]:.4g}" if truth[s] > 0 else "",
                            "seals": len(drawn.leakage),
                            "seconds": f"{time.perf_counter() - start:.2f}",
                        }


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    command, first, last, target = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    shapes = sys.argv[5:] or list(SHAPES)
    with target.open("w", newline="") as file:
        writer = None
        for row in rows(KINDS, range(first, last), shapes):
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)
            file.flush()
