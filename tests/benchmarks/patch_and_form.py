"""A patch of a face and the coarse form of the whole, against the deterministic leakage of the whole face.

    python patch_and_form.py solve ROWS.csv FIRST LAST           # synthetic faces of seeds from FIRST up to LAST
    python patch_and_form.py solve ROWS.csv MAP …                # measured faces
    python patch_and_form.py calibrate ROWS.csv …                # their part of femseal/studies/drawn_seals.csv
    python patch_and_form.py report ROWS.csv …                   # writes patch_and_form.md of rows of other seeds

A whole face is cut: a quarter or a sixteenth of its area is the patch, less a plane. The form of the whole is its mean
heights over 4 × 4 or 8 × 8 squares. Seals as large as the whole are drawn from the patch, without the form and with it.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import machine, rows, save_report
from drawn_seals import distance, read, write

import femseal as fs
from femseal.budget import error_budget, longer_waves_part, patch_form_part
from femseal.face.patch_form import form_effect
from femseal.loads import LoadProgramme
from femseal.seal.form import MeasuredForm
from femseal.studies import drawn_error
from femseal.studies.longer_waves import longer_waves
from femseal.topography import representative

MODULUS, PIXEL, POINTS = 115e9, 1e-6, 192
KINDS = ("roll-off within", "roll-off beyond", "turned, wavy", "bumps", "lobes")
#: Loads in fractions of the hardness, which is so many times E* and the slope; unloading from the highest.
LOADS, STOPS, HARDNESS = (0.03, 0.1, 0.2, 0.32), (0.15, 0.05), 0.15
#: Leakage over that of the first load below which a truth does not count.
LEAST = 1e-2


def face_of(kind, seed):
    """A whole face of a kind; its patch is half as long and broad."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    size = (POINTS * PIXEL, POINTS * PIXEL)
    x = (np.arange(POINTS) + 0.5) / POINTS
    slope, hurst = np.exp(rng.uniform(np.log(0.05), np.log(0.3))), rng.uniform(0.5, 1.0)
    rough = {"hurst": hurst, "cut_off": 8 * PIXEL, "rng": rng}
    if kind == "turned, wavy":
        made = fs.turned((POINTS, POINTS), size, pitch=24 * PIXEL, depth=0.6e-6, feed_error=0.05, depth_error=0.2,
                         roughness=0.1e-6, roughness_roll_off=24 * PIXEL, cut_off=8 * PIXEL, rng=rng)  # fmt: skip
        waves = fs.self_affine((POINTS, POINTS), size, rms_slope=1.0, hurst=1.0, cut_off=96 * PIXEL, rng=rng)
        heights = made.heights + waves.heights * (0.5 * made.rms_height / waves.rms_height)
        return fs.Topography(heights, made.spacing, (False, False))
    longest = rng.uniform(24, 48) if kind != "roll-off beyond" else rng.uniform(120, 192)
    base = fs.self_affine((POINTS, POINTS), size, rms_slope=slope, roll_off=longest * PIXEL, **rough)
    heights = base.heights
    if kind == "bumps":
        for a, b in rng.uniform(0, POINTS, (40, 2)):
            distance = np.hypot(*np.meshgrid(*((np.abs(np.arange(POINTS) - c)) for c in (a, b)), indexing="ij"))
            heights = heights + 1.5 * base.rms_height * np.exp(-0.5 * (distance / rng.uniform(8, 16)) ** 2)
    if kind == "lobes":
        high = rng.uniform(1, 4) * base.rms_height
        heights = heights + high * (np.cos(2 * np.pi * (x[None, :] + rng.random())) + 0.5 * np.cos(np.pi * x[:, None]))
    return fs.Topography(heights, base.spacing, (False, False))


def measured(path):
    """A measured face on as many points."""
    return fs.condition(fs.read_topography(path), shape=(POINTS, POINTS))[0]


def scene_of(surface, hardness):
    """A face under the loads, dry; the whole ends at inlet and outlet and goes on along x2 as its mirror image."""
    return fs.Scene(
        surface=fs.Topography(surface.heights, surface.spacing, (False, False)),
        modulus=MODULUS,
        hardness=hardness,
        fluid=fs.Liquid(1e-3),
        inlet_pressure=1e6,
        outlet_pressure=0.0,
        loading=tuple(hardness * f for f in LOADS),
        unload_from=(hardness * LOADS[-1],),
        unloading=tuple(hardness * f for f in STOPS),
        boundary=("free", "mirror"),
        fluid_pressure="ignored",
    )


def form_of(surface, count):
    """Mean heights of the whole over count × count squares."""
    n = POINTS // count
    heights = surface.heights.reshape(count, n, count, n).mean(axis=(1, 3))
    middles = ((np.arange(count) + 0.5) * n * d for d in surface.spacing)
    points = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    return MeasuredForm.of(points, heights.ravel())


def solved_rows(name, kind, surface, corner):
    """A row for each step and way of a face whose patch lies at a corner (0 or 1 along both axes)."""
    hardness = HARDNESS * MODULUS * surface.rms_slope
    truth = fs.deterministic(scene_of(surface, hardness)).leakage
    n = POINTS // 2
    a, b = (c * n for c in corner)
    cut = np.ascontiguousarray(surface.heights[a : a + n, b : b + n])
    patch = scene_of(fs.Topography(cut, surface.spacing, (False, False)).detrend(), hardness)
    alone = fs.deterministic(patch).leakage
    for way in ("patch", "seal", "form 4 × 4", "form 8 × 8", "blocks 2 × 2"):
        start = time.perf_counter()
        lower = upper = np.full(len(truth), np.nan)
        q = alone * (n / POINTS)  # over the breadth of the whole
        if way == "blocks 2 × 2":
            q = fs.by_blocks(scene_of(surface, hardness), (2, 2)).leakage
        elif way != "patch":
            form = form_of(surface, int(way[-1])) if way.startswith("form") else ()
            breadth, length = surface.size
            drawn = fs.stochastic(patch, None, fs.Sampling(length, seed=1, breadth=breadth, form=form))
            q, budget = drawn.quantile(0.5), error_budget(patch, drawn)
            if way == "seal":
                budget = replace(budget, parts=(*budget.parts, *unknown_form(patch, q, surface.size)))
            lower, upper = budget.lower, budget.upper
        for s, step in enumerate(patch.steps):
            yield {
                "kind": kind,
                "face": f"{name} {corner}",
                "way": way,
                "step": s,
                "branch": step.branch,
                "leakage": f"{q[s] / truth[0]:.6g}",
                "truth": f"{truth[s] / truth[0]:.6g}",
                "lower": f"{lower[s] / truth[0]:.6g}",
                "upper": f"{upper[s] / truth[0]:.6g}",
                "seconds": f"{time.perf_counter() - start:.2f}",
            }


def unknown_form(patch, q, size):
    """Parts of the budget of a seal whose form is not known."""
    holds, steps = representative(patch.surface), patch.steps
    changes = longer_waves(patch, *size, holds, flatness=None, seed=1)
    effect = form_effect(patch.surface, patch.modulus, patch.law, patch.loading, patch.boundary)
    parts = [patch_form_part(effect, steps, q, rises=holds.rises)]
    parts.append(None if changes is None else longer_waves_part(changes, False, steps, q))
    return filter(None, parts)


def every(arguments):
    """Rows of faces: synthetic ones from a first to a last seed, or measured ones by their paths."""
    if arguments[0].isdecimal():
        first, last = map(int, arguments)
        for seed in range(first, last):
            for kind in KINDS:
                yield from solved_rows(f"{kind} {seed}", kind, face_of(kind, seed), (seed % 2, seed // 2 % 2))
        return
    for path in arguments:
        for corner in ((0, 0), (1, 1)):
            yield from solved_rows(Path(path).name, "measured", measured(path), corner)


def calibrated(table):
    """Rows of the calibration set of seals with a form; those of both forms of a face err together."""
    steps = LoadProgramme.of(LOADS, unload_from=(LOADS[-1],), unloading=STOPS)
    scenes = {}
    for row in table:
        if row["way"].startswith("form"):
            scenes.setdefault((row["face"], row["way"], row["kind"]), []).append(row)
    for (face, _, kind), found in scenes.items():
        q, truth = (np.array([float(row[name]) for row in found]) for name in ("leakage", "truth"))
        if not np.isfinite(q).all():
            continue
        hard, fallen = drawn_error.difficulty(steps, q), drawn_error.decades(q)
        for s in np.flatnonzero(q > 0):
            yield {
                "kind": "with form",
                "surface": kind,
                "scene": f"form {face}",
                "step": s,
                "log_ratio": f"{distance('with form', q[s], truth[s]):.4g}",
                "decades": f"{fallen[s]:.4g}",
                "difficulty": f"{hard[s]:.4g}",
            }


def report(table):
    """Quantiles of leakage over truth by way, of synthetic and of measured faces, and bands."""
    head = ["faces", "way", "faces", "loads", "5 %", "25 %", "50 %", "75 %", "95 %", "band holds", "half-width"]
    lines = []
    for measured_ones in (False, True):
        for way in dict.fromkeys(row["way"] for row in table):
            chosen = [r for r in table if r["way"] == way and (r["kind"] == "measured") == measured_ones]
            chosen = [r for r in chosen if float(r["truth"]) > LEAST and np.isfinite(float(r["leakage"]))]
            if not chosen:
                continue
            names = ("leakage", "truth", "lower", "upper")
            q, truth, lower, upper = (np.array([float(r[name]) for r in chosen]) for name in names)
            ratios = [f"{v:.2f}" for v in np.quantile(q / truth, [0.05, 0.25, 0.5, 0.75, 0.95])]
            held, width = "", ""
            if way in ("seal", "form 4 × 4", "form 8 × 8"):
                held = f"{np.mean((lower <= truth) & (truth <= upper)):.0%}"
                with np.errstate(divide="ignore", invalid="ignore"):
                    width = f"{np.nanmedian(np.maximum(upper / q, q / lower)):.2g}"
            faces = "measured" if measured_ones else "synthetic"
            count = str(len({r["face"] for r in chosen}))
            lines.append([faces, way, count, str(len(chosen)), *ratios, held, width])
    return rows(head, lines)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    command, *paths = sys.argv[1:]
    if command == "solve":
        write(paths[0], every(paths[1:]))
    elif command == "calibrate":
        others = [row for row in read([drawn_error.CALIBRATION]) if row["kind"] != "with form"]
        write(drawn_error.CALIBRATION, [*others, *calibrated(read(paths))])
    else:
        text = f"{machine({})}\n\n{report(read(paths))}"
        print(text)
        save_report(__file__, "A patch, and the form of the whole seal", text)
