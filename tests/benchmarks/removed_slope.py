"""Upper ends of leakages of faces that lost short waves, against the leakage with these waves.

`python tests/benchmarks/removed_slope.py [--write]` solves 96 faces of four kinds, on 384² points and on a half to a
quarter of them a side, at ten to fourteen loads, and counts the loads at which the whole face leaks more than the upper
end says. It takes about five minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import femseal as fs
from femseal.budget import CoarserSolution
from femseal.topography import Topography

POINTS, SIZE, MODULUS, SLOPE = 384, 3e-4, 2.3e11, 0.05
KINDS = ("self-affine", "two bands of waves", "with a lay", "turned")
PAGE = Path(__file__).with_suffix(".md")


def face(kind: str, seed: int) -> Topography:
    """A face of SLOPE, whose shortest wave has eight points."""
    rng, side = np.random.default_rng(seed), (SIZE, SIZE)
    hurst, roll_off = rng.choice([0.5, 0.65, 0.8, 0.95]), SIZE * rng.choice([0.12, 0.25, 0.5])
    shape = (POINTS, POINTS)
    if kind == "turned":
        made = fs.turned(
            shape,
            side,
            pitch=SIZE / 5,
            depth=1e-6,
            roughness=float(rng.choice([0.3e-6, 1e-6])),
            roughness_roll_off=SIZE / 8,
            rng=seed,
        )
        heights = made.heights
    elif kind == "two bands of waves":
        long = fs.self_affine(shape, side, hurst=0.9, rms_slope=1.0, roll_off=SIZE / 3, cut_off=SIZE / 12, rng=seed)
        short = fs.self_affine(shape, side, hurst=0.9, rms_slope=1.0, roll_off=SIZE / 20, rng=seed + 1000)
        heights = long.heights + rng.choice([0.5, 1, 2, 4, 8]) * short.heights
    else:
        heights = fs.self_affine(shape, side, hurst=hurst, rms_slope=1.0, roll_off=roll_off, rng=seed).heights
        if kind == "with a lay":
            q = np.abs(np.fft.fftfreq(POINTS)) * POINTS / 12
            q = q[None] if seed % 2 else q[:, None]
            along = np.fft.ifft2(np.fft.fft2(heights) * np.exp(-(q**2) / 2)).real
            heights = along / along.std() * heights.std() + 0.3 * heights
    made = Topography(heights, (SIZE / POINTS, SIZE / POINTS), periodic=(True, True))
    return Topography(heights * (SLOPE / made.rms_slope), made.spacing, periodic=(True, True))


def solved(surface: Topography, loads: np.ndarray, hardness: float) -> tuple[fs.Scene, fs.FaceResult]:
    """The deterministic solution of a face under these nominal pressures."""
    scene = fs.Scene(
        surface,
        MODULUS,
        hardness,
        fs.Liquid(1e-3),
        1e6,
        0.0,
        tuple(loads),
        rtol=1e-4,
        boundary=("periodic", "periodic"),
    )
    return scene, fs.deterministic(scene)


def count(seed: int) -> dict[str, np.ndarray] | None:
    """Leakage of a whole face, and that of it without its short waves with both upper ends; None for too few loads."""
    kind, coarsening, strength = KINDS[seed % 4], (2, 4, 3)[seed // 4 % 3], (np.inf, 0.35, 0.15)[seed // 8 % 3]
    whole, hardness, points = face(kind, seed), MODULUS * SLOPE * strength, (POINTS // coarsening,) * 2
    wave = 8 * SIZE / points[0]
    less, half = whole.low_pass(wave).resample(points), (points[0] // 2, points[1] // 2)
    kept = less.rms_slope / whole.rms_slope
    parts = np.array([0.05, 0.09, 0.15, 0.22, 0.3, 0.4, 0.55, 0.75, 1.0, 1.4]) * max(kept, 0.15)
    loads = 0.6 * MODULUS * SLOPE * np.unique([*parts, 0.3, 0.5, 0.7, 0.9])
    loads = loads[loads < 0.75 * hardness]
    if loads.size < 3:
        return None
    truth = solved(whole, loads, hardness)[1].leakage
    scene, study = solved(less, loads, hardness)
    coarse, smooth = (
        solved(one, loads, hardness) for one in (less.resample(half), less.low_pass(2 * wave).resample(half))
    )
    solutions = [CoarserSolution(half, one.steps, result.leakage) for one, result in (coarse, smooth)]
    given = {"coarse": solutions[:1], "filtered": solutions[1], "octaves": float(np.log2(coarsening))}
    without = fs.error_budget(scene, study, **given).upper
    return {
        "truth": truth,
        "leakage": study.leakage,
        "without": without,
        "with": fs.error_budget(scene, study, **given, kept_slope=kept).upper,
        "kept": np.full(loads.size, kept),
    }


def page(found: list[dict[str, np.ndarray]]) -> str:
    """The table of the counts."""
    every = {name: np.concatenate([one[name] for one in found]) for name in found[0]}
    groups = {
        "sealed without the short waves": every["leakage"] == 0,
        "open": every["leakage"] > 0,
        "less than 70 % of the slope kept": every["kept"] < 0.7,
        "all": np.full(every["kept"].size, True),
    }
    lines = ["| loads | number | above the upper end before | with the slope | no known end |", "| --- " * 5 + "|"]
    for name, chosen in groups.items():
        above = [int((every["truth"] > 1.0001 * every[end])[chosen].sum()) for end in ("without", "with")]
        unknown = int(np.isinf(every["with"])[chosen].sum())
        lines.append(f"| {name} | {int(chosen.sum())} | {above[0]} | {above[1]} | {unknown} |")
    opened = every["leakage"] > 0
    widths = [np.median(np.log(every[end][opened] / every["leakage"][opened])) for end in ("without", "with")]
    text = "ln of the upper end over the leakage is {:.2f} in the median of the open loads without the slope, {:.2f} with it."
    return "\n".join([f"# Removed waves of {len(found)} faces", "", *lines, "", text.format(*widths), ""])


if __name__ == "__main__":
    results = [one for seed in range(96) if (one := count(seed)) is not None]
    text = page(results)
    sys.stdout.write(text)
    if "--write" in sys.argv:
        PAGE.write_text(text, encoding="utf-8")
