"""Compare seals that are simulated from a patch, with and without the coarse form, with the whole surface.

    python patch_and_form.py solve ROWS.csv FIRST LAST      # surfaces of seeds from FIRST to LAST − 1
    python patch_and_form.py solve ROWS.csv MAP …           # measured surfaces
    python patch_and_form.py solve ROWS.csv … blocks        # only by blocks
    python patch_and_form.py calibrate ROWS.csv …           # femseal/studies/interval_calibration.csv
    python patch_and_form.py report ROWS.csv …              # patch_and_form.md, for other seeds

The patch is a quarter of the area of a whole surface, with its mean plane subtracted. The form consists of the
mean heights of the whole surface over 4 × 4 or 8 × 8 squares. Seals as large as the whole surface are simulated
from the patch, without the form and with the form.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

import femseal as fs
from common import INTERVAL_HEAD, interval_cells, table
from femseal.budget import error_budget, longer_waves_part, patch_form_part
from femseal.budget.longer_waves import longer_waves
from femseal.checks import solve_form_effect
from femseal.seal import MeasuredForm
from femseal.topography import representative
from stochastic_seals import commands, state_rows

MODULUS, PIXEL, POINTS = 115e9, 1e-6, 192
KINDS = ("roll-off within", "roll-off beyond", "turned, wavy", "bumps", "lobes")
#: Loads as fractions of the hardness, stops below the highest, hardness over E* and slope.
LOADS, STOPS, HARDNESS = (0.03, 0.1, 0.2, 0.32), (0.15, 0.05), 0.15
#: Decades of the truth below that of the first load from which on it does not count.
LEAST = 2.0
#: Inlet pressure over the lowest load where the fluid acts.
CARRIED = 0.5
#: Kinds of the calibration set, by what is known of the whole.
_CALIBRATED = {"form": "with form", "blocks": "by blocks"}
WAYS = (
    "patch",
    "seal",
    "form 4 × 4",
    "form 8 × 8",
    "blocks 2 × 2",
    "blocks 3 × 3",
    "blocks, fluid acts",
)


def face_of(kind, seed):
    """Generate a whole surface of a kind; its patch is half as long and half as wide."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    shape, size = (POINTS, POINTS), (POINTS * PIXEL, POINTS * PIXEL)
    x = (np.arange(POINTS) + 0.5) / POINTS
    slope, hurst = np.exp(rng.uniform(np.log(0.05), np.log(0.3))), rng.uniform(0.5, 1.0)
    cut = {"cut_off": 8 * PIXEL, "rng": rng}
    if kind == "turned, wavy":
        rough = {"roughness": 0.1e-6, "roughness_roll_off": 24 * PIXEL}
        errors = {"feed_error": 0.05, "depth_error": 0.2}
        made = fs.turned(shape, size, pitch=24 * PIXEL, depth=0.6e-6, **errors, **rough, **cut)
        long = {"rms_slope": 1.0, "hurst": 1.0, "cut_off": 96 * PIXEL, "rng": rng}
        waves = fs.self_affine(shape, size, **long)
        heights = made.heights + waves.heights * (0.5 * made.rms_height / waves.rms_height)
        return fs.Topography(heights, made.spacing, (False, False))
    longest = rng.uniform(24, 48) if kind != "roll-off beyond" else rng.uniform(120, 192)
    spectrum = {"rms_slope": slope, "roll_off": longest * PIXEL, "hurst": hurst}
    base = fs.self_affine(shape, size, **spectrum, **cut)
    heights, i = base.heights, np.arange(POINTS)
    if kind == "bumps":
        for a, b in rng.uniform(0, POINTS, (40, 2)):
            squared = (i[:, None] - a) ** 2 + (i - b) ** 2
            bump = np.exp(-0.5 * squared / rng.uniform(8, 16) ** 2)
            heights = heights + 1.5 * base.rms_height * bump
    if kind == "lobes":
        high = rng.uniform(1, 4) * base.rms_height
        along = np.cos(2 * np.pi * (x + rng.random()))
        heights = heights + high * (along + 0.5 * np.cos(np.pi * x[:, None]))
    return fs.Topography(heights, base.spacing, (False, False))


def measured(path):
    """Read a measured surface, and interpolate it on POINTS² points."""
    return fs.condition(fs.read_topography(path), shape=(POINTS, POINTS))[0]


def scene_of(surface, hardness):
    """Return the scene of a surface under the loads, without fluid pressure, mirrored along x2."""
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
    """Return the form that consists of the mean heights of the surface over count × count squares."""
    n = POINTS // count
    heights = surface.heights.reshape(count, n, count, n).mean(axis=(1, 3))
    middles = ((np.arange(count) + 0.5) * n * d for d in surface.spacing)
    points = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    return MeasuredForm.from_points(points, heights.ravel())


def solved_rows(name, kind, surface, corner, ways):
    """Yield a row for each load step and each method of a surface whose patch lies at a corner.

    A corner is (0 or 1, 0 or 1).
    """
    hardness = HARDNESS * MODULUS * surface.rms_slope
    truth = fs.deterministic(scene_of(surface, hardness)).leakage
    n = POINTS // 2
    a, b = (c * n for c in corner)
    cut = np.ascontiguousarray(surface.heights[a : a + n, b : b + n])
    patch = scene_of(fs.Topography(cut, surface.spacing, (False, False)).detrend(), hardness)
    breadth, length = surface.size
    for way in ways:
        scene, true, parts = patch, truth, ()
        if way == "patch":
            study = fs.deterministic(patch)
            # over the breadth of the whole
            study = replace(study, leakage=study.leakage * (n / POINTS))
        elif way.startswith("blocks"):
            scene, count = scene_of(surface, hardness), 3 if way.endswith("3") else 2
            if way.endswith("acts"):
                inlet = CARRIED * scene.loading[0]
                scene = replace(scene, inlet_pressure=inlet, fluid_pressure="acts")
                true = fs.deterministic(scene).leakage
            study = fs.by_blocks(scene, (count, count))
        else:
            form = form_of(surface, int(way[-1])) if way.startswith("form") else ()
            sampling = fs.Sampling(length, seed=1, breadth=breadth, form=form)
            study = fs.stochastic(patch, None, sampling)
            if way == "seal":
                parts = unknown_form(patch, study.quantile(0.5), surface.size)
        budget = error_budget(scene, study)
        budget = replace(budget, parts=(*budget.parts, *parts))
        same = {"kind": _CALIBRATED.get(way.replace(",", " ").split()[0], "without")}
        same |= {"surface": kind, "scene": f"form {name} {corner}", "patch": "first", "way": way}
        yield from state_rows(same, scene, study, budget, true)


def unknown_form(patch, q, size):
    """Return the parts of the error budget of a seal whose form is not known."""
    holds, steps = representative(patch.surface), patch.steps
    changes = longer_waves(patch, *size, holds, flatness=None, seed=1)
    effect = solve_form_effect(
        patch.surface, patch.modulus, patch.law, patch.loading, patch.boundary
    )
    parts = [patch_form_part(effect, steps, q, rises=holds.rises)]
    parts.append(None if changes is None else longer_waves_part(changes, False, steps, q))
    return filter(None, parts)


def every(arguments):
    """Yield the rows of synthetic surfaces of some seeds, or of measured surfaces in some files."""
    ways = WAYS
    if arguments[-1] == "blocks":
        *arguments, _ = arguments
        ways = [way for way in WAYS if way.startswith("blocks")]
    if arguments[0].isdecimal():
        for seed, kind in product(range(*map(int, arguments)), KINDS):
            corner = seed % 2, seed // 2 % 2
            yield from solved_rows(f"{kind} {seed}", kind, face_of(kind, seed), corner, ways)
        return
    for path, corner in product(arguments, ((0, 0), (1, 1))):
        yield from solved_rows(Path(path).name, "measured", measured(path), corner, ways)


def report(rows):
    """Tabulate quantiles of leakage / true leakage and intervals, by method, for synthetic and for measured surfaces."""
    lines = []
    for faces, way in product(("synthetic", "measured"), WAYS):
        chosen = [
            r
            for r in rows
            if r["way"] == way
            and (r["surface"] == "measured") == (faces == "measured")
            and float(r["decades"]) < LEAST
        ]
        if chosen:
            count = len({r["scene"] for r in chosen})
            cells = interval_cells(chosen, with_interval=way != "patch")
            lines.append([faces, way, count, *cells])
    text = "The columns from 5 % to 95 % are quantiles of the leakage divided by the true leakage. The half-width is given as a factor between the leakage and an end of its interval."
    return text + "\n\n" + table(["surfaces", "method", "number", *INTERVAL_HEAD], lines)


if __name__ == "__main__":
    title = "A patch, and the form of the whole seal"
    commands(__file__, title, every, ("with form", "by blocks"), report)
