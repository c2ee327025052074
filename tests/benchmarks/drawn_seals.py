"""Drawn seals against whole faces: the calibration of their bands, and how these hold on scenes that nobody has seen.

    python drawn_seals.py solve ROWS.csv SHAPE FIRST LAST     # scenes of a shape, of seeds from FIRST up to LAST
    python drawn_seals.py calibrate ROWS.csv …                # makes femseal/studies/drawn_seals.csv of such rows
    python drawn_seals.py report ROWS.csv …                   # writes drawn_seals.md of rows of other seeds

A scene is a whole face, whose deterministic leakage is the truth, and a patch of it, from which seals are drawn. A
shape is "in-place": as broad as the patch and four times as long; "broad": twice and four times as broad; "ring" and
"mesh": as "broad", on a ring so large that it is straight, and on triangles.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import machine, rows, save_report
from drawn_scenes import Drawn

import femseal as fs
from femseal.budget import error_budget
from femseal.seal.layouts import AnnularLayout, MeshLayout
from femseal.studies import drawn_error
from femseal.studies.load_curves import first_known

SURFACES = ("self-affine", "turned", "ground", "bumps")
#: Length and breadth of the whole face in sides of the patch.
SIDES = {"in-place": ((4, 1),), "broad": ((4, 2), (8, 4)), "ring": ((4, 2),), "mesh": ((4, 2),)}
#: Decades of the leakage below that of the first load.
DECADES = ((-1.0, 1.0), (1.0, 2.0), (2.0, 3.0))
#: Inlet pressure of a fluid that acts, in parts of the lowest load.
ACTS = (0.1, 0.6)


def scene_of(surface, seed, length, breadth):
    """A whole face, and the patch of it, both under the same loads; every other scene has a fluid that acts."""
    drawn = Drawn(surface, seed, length, 0 if breadth == 1 else 96, breadth)
    rng = np.random.default_rng([seed, length, breadth])
    whole, n = drawn.scene(), drawn.numbers["points"]
    acts = seed % 2 == 1
    inlet = rng.uniform(*ACTS) * min(whole.steps.pressures) if acts else 1e7
    whole = replace(whole, fluid_pressure="acts" if acts else "ignored", inlet_pressure=inlet)
    heights = np.ascontiguousarray(whole.surface.heights[:n, :n])
    patch = fs.Topography(heights, whole.surface.spacing, (False, False)).detrend()
    return whole, replace(whole, surface=patch)


def mesh_of(size, side, folder):
    """A rectangle of triangles [m], with its inlet and outlet, as a file."""
    import meshio

    n1, n2 = (max(2, round(length / side)) for length in size)
    number = np.arange((n1 + 1) * (n2 + 1)).reshape(n1 + 1, n2 + 1)
    x1, x2 = np.meshgrid(np.linspace(0, size[0], n1 + 1), np.linspace(0, size[1], n2 + 1), indexing="ij")
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    lines = np.concatenate([np.stack([end[:-1], end[1:]], axis=-1) for end in (number[0], number[-1])])
    of_line = np.repeat([1, 2], n2)
    points = np.stack([x1.ravel(), x2.ravel(), np.zeros(x1.size)], axis=1)
    mesh = meshio.Mesh(
        points,
        [("line", lines), ("triangle", triangles)],
        cell_data={name: [of_line, np.full(len(triangles), 3)] for name in ("gmsh:physical", "gmsh:geometrical")},
        field_data={"inlet": np.array([1, 1]), "outlet": np.array([2, 1]), "seal": np.array([3, 2])},
    )
    path = Path(folder) / "rectangle.msh"
    mesh.write(path, file_format="gmsh22", binary=False)
    return path


def drawn_of(shape, patch, size, folder):
    """Seals of a shape, as large as the whole face."""
    if shape == "ring":
        ring = AnnularLayout(20 * size[0], 21 * size[0])
        return fs.stochastic(replace(patch, layout=ring), None, fs.Sampling(None, seed=1))
    if shape == "mesh":
        path = mesh_of(size, patch.surface.size[0] / 4, folder)
        layout = MeshLayout(path, "m", "inlet", "outlet", lay="x2")
        return fs.stochastic(replace(patch, layout=layout), None, fs.Sampling(None, seed=1))
    wide = None if shape == "in-place" else size[0]
    return fs.stochastic(patch, None, fs.Sampling(size[1], seed=1, breadth=wide))


def solved_rows(shape, seeds):
    """A row for each step of each scene."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            for length, breadth in SIDES[shape]:
                for surface in SURFACES:
                    try:
                        yield from _of_scene(shape, surface, seed, length, breadth, folder)
                    except fs.FemsealError as reason:
                        print(shape, surface, seed, reason, file=sys.stderr)


def _of_scene(shape, surface, seed, length, breadth, folder):
    start = time.perf_counter()
    whole, patch = scene_of(surface, seed, length, breadth)
    truth = fs.deterministic(whole).leakage
    if not np.nanmax(truth, initial=0.0) > 0:
        return
    drawn = drawn_of(shape, patch, whole.surface.size, folder)
    q = drawn.quantile(0.5)
    budget = error_budget(patch, drawn)
    first, hard = truth[first_known(truth)], drawn_error.difficulty(whole.steps, q)
    for s, step in enumerate(whole.steps):
        if np.isfinite(q[s]) and np.isfinite(truth[s]):
            yield {
                "kind": "in place" if drawn.tiles.in_place else "anywhere",
                "shape": shape,
                "surface": surface,
                "scene": f"{surface} {seed} {breadth}",
                "step": s,
                "leakage": f"{q[s] / first:.6g}",
                "truth": f"{truth[s] / first:.6g}",
                "lower": f"{budget.lower[s] / first:.6g}",
                "upper": f"{budget.upper[s] / first:.6g}",
                "decades": f"{drawn_error.decades(q)[s]:.4g}",
                "difficulty": f"{hard[s]:.4g}",
                "branch": step.branch,
                "fluid": whole.fluid_pressure,
                "seals": len(drawn.leakage),
                "seconds": f"{time.perf_counter() - start:.2f}",
            }


def read(paths):
    """The rows of files."""
    found = []
    for path in paths:
        with open(path, newline="") as file:
            found += list(csv.DictReader(file))
    return found


def write(path, table):
    """Rows to a file, each as soon as it is there."""
    with open(path, "w", newline="") as file:
        writer = None
        for row in table:
            if writer is None:
                writer = csv.DictWriter(file, list(row), lineterminator="\n")
                writer.writeheader()
            writer.writerow(row)
            file.flush()


def distance(kind, leakage, truth):
    """Distance of ln(leakage) to a truth that is not below the floor of the bands of a kind."""
    floor = 10.0 ** -drawn_error.FLOOR_DECADES[kind]
    return np.log(leakage / truth) if truth >= floor else np.log(max(leakage / floor, 1.0))


def calibrated(table):
    """Rows of the calibration set: distances of ln(leakage) to a truth that is not below the floor of the bands."""
    for row in table:
        leakage, truth = float(row["leakage"]), float(row["truth"])
        if leakage > 0:
            names = ("kind", "surface", "scene", "step")
            yield {name: row[name] for name in names} | {
                "log_ratio": f"{distance(row['kind'], leakage, truth):.4g}",
                "decades": row["decades"],
                "difficulty": row["difficulty"],
            }


def report(table):
    """Quantiles of leakage over truth, and bands, by shape and decades."""
    head = ["shape", "decades", "scenes", "loads", "5 %", "25 %", "50 %", "75 %", "95 %", "band holds", "half-width"]
    lines = []
    for shape in SIDES:
        of_shape = [row for row in table if row["shape"] == shape]
        for low, high in (*DECADES, (-1.0, 2.0)):
            chosen = [row for row in of_shape if low <= _decades(row["truth"]) < high]
            if not chosen:
                continue
            q, truth, lower, upper = (
                np.array([float(row[name]) for row in chosen]) for name in ("leakage", "truth", "lower", "upper")
            )
            ratios = (f"{r:.2f}" for r in np.quantile(q / truth, [0.05, 0.25, 0.5, 0.75, 0.95]))
            held = f"{np.mean((lower <= truth) & (truth <= upper)):.0%}"
            with np.errstate(divide="ignore", invalid="ignore"):
                width = np.nanmedian(np.maximum(upper / q, q / lower))
            scenes = str(len({row["scene"] for row in chosen}))
            decades = f"{max(low, 0):g} to {high:g}"
            lines.append([shape, decades, scenes, str(len(chosen)), *ratios, held, f"{width:.2g}"])
    return rows(head, lines)


def _decades(ratio):
    return -np.log10(float(ratio)) if float(ratio) > 0 else np.inf


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    command, *paths = sys.argv[1:]
    if command == "solve":
        target, shape, first, last = paths
        write(target, solved_rows(shape, range(int(first), int(last))))
    elif command == "calibrate":
        others = [row for row in read([drawn_error.CALIBRATION]) if row["kind"] == "with form"]
        write(drawn_error.CALIBRATION, [*calibrated(read(paths)), *others])
    else:
        text = (
            "Leakage of drawn seals over that of the whole face, at the loads at which this leaks so many decades less "
            "than at the first; fraction of these loads whose truth the 95 % band of the error budget holds, and the "
            "median half-width of the band as a factor. Every other scene has a fluid that acts.\n\n"
        )
        save_report(__file__, "Drawn seals against whole faces", text + report(read(paths)) + f"\n\n{machine({})}")
