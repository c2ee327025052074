"""Whether runs that ask for an accuracy reach it: against the deterministic solution on twice their points.

    python tests/benchmarks/wanted_accuracy.py --write

Every scene is a generated face of 96² to 160² points, whose shortest wave has 8 pixels, under loads from open to closing, with
hardness or elastic. The case says `accuracy` and nothing of how, but for the method of some, and at most two minutes. The truth is the deterministic
solution of the same face on twice the points a side of the face or of the run's last attempt, whichever are more, with contact
solved to 1e-8: faces are limited in their waves, so that all are the same face. The error is the largest distance of ln(leakage) from the truth at the loads at which the truth leaks more
than 1e-3 of its first leakage. A scene is met if the run says that it has reached the accuracy and the error is within it.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import Any

import numpy as np
from common import machine, rows, save_report

from femseal.preparation.preparation import prepare

#: Seeds of the scenes, of which no other test or benchmark knows.
SEEDS = range(917_001, 917_021)
LOADS = (40, 80, 150, 250, 400, 600, 850)
STOPS = (400, 150, 40)


def scene(seed: int) -> dict[str, Any]:
    """Case of a seed, without accuracy: kind of face, size, slope, hardness and method are drawn from it."""
    rng = np.random.default_rng(seed)
    n1, n2 = (int(n) for n in rng.choice([96, 128, 160], size=2))
    pixel = 1.0
    kind = ("self-affine", "turned", "rough turned", "self-affine, long waves")[seed % 4]
    size = [f"{n1 * pixel} um", f"{n2 * pixel} um"]
    if kind.startswith("self-affine"):
        face: dict[str, Any] = {
            "kind": "self-affine",
            "hurst": round(float(rng.uniform(0.5, 0.95)), 2),
            "rms_slope": round(float(rng.uniform(0.1, 0.3)), 3),
        }
        if kind == "self-affine":
            face["roll_off"] = "40 um"
    else:
        face = {
            "kind": "turned",
            "pitch": f"{n1 / rng.integers(3, 6)} um",
            "depth": f"{rng.uniform(0.3, 1.2):.3g} um",
            "feed_error": 0.03,
            "depth_error": 0.1,
            "roughness": f"{rng.uniform(0.5, 0.8) if kind == 'rough turned' else 0.2:.3g} um",
            "roughness_roll_off": "40 um",
        }
    material = {"young": "210 GPa"} | ({} if rng.random() < 0.25 else {"hardness": f"{rng.uniform(2, 6):.2g} GPa"})
    case: dict[str, Any] = {
        "title": kind,
        "seed": seed,
        "face": face | {"points": [n1, n2], "size": size},
        "material": material,
        "load": {
            "loading": [f"{p} MPa" for p in LOADS],
            "unload_from": [f"{LOADS[-1]} MPa"],
            "unloading": [f"{p} MPa" for p in STOPS],
        },
        "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "10 MPa"},
    }
    if rng.random() < 0.3:
        case |= {"method": "two-scale", "cells": {"count": [2, 2]}}
    return case


def tried(seed: int, accuracy: float) -> dict[str, Any]:
    """A run of a scene, and its truth."""
    import femseal as fs
    from femseal.case.case import parse_case

    case = parse_case(scene(seed) | {"accuracy": accuracy, "time_limit": "2 min"})
    start = time.process_time()
    results = fs.run(case, workers=1)
    seconds = time.process_time() - start
    run_scene, told = results.scene, results.attempts
    face = prepare(case).scene.surface
    fine = face.resample(tuple(2 * max(pair) for pair in zip(face.shape, run_scene.surface.shape, strict=True)))
    start = time.process_time()
    truth = fs.deterministic(replace(run_scene, surface=fine, rtol=1e-8)).leakage
    return {
        "seed": seed,
        "kind": case.title,
        "accuracy": accuracy,
        "method": results.method,
        "attempts": [(a["points"], a["half_width"], a["limit"]) for a in told["attempts"]],
        "half_width": told["half_width"],
        "reached": told["reached"],
        "limit": told["limit"],
        "why": told["why"],
        "error": error(results.leakage.values, truth),
        "seconds": seconds,
        "truth_seconds": time.process_time() - start,
    }


def error(leakage: np.ndarray, truth: np.ndarray) -> float:
    """Largest distance of ln(leakage) at the loads that truly leak more than 1e-3 of the first."""
    counts = truth > 1e-3 * truth[0]
    with np.errstate(divide="ignore"):
        return float(np.max(np.abs(np.log(leakage[counts] / truth[counts])), initial=0.0))


def is_met(found: dict[str, Any]) -> bool:
    """Whether the run says that it has reached its accuracy, and has."""
    return bool(found["reached"] and found["error"] <= np.log1p(found["accuracy"]))


def _share(width: float | None) -> str:
    return "unknown" if width is None else f"{100 * np.expm1(width):.2g} %"


def table(found: list[dict[str, Any]]) -> str:
    heads = ["seed", "face", "method", "points of the attempts", "says", "is", "limited by", "time [s]", "met"]
    lines = [
        [
            str(one["seed"]),
            one["kind"],
            one["method"],
            ", ".join(f"{p[0]}×{p[1]}" for p, _, _ in one["attempts"]),
            _share(one["half_width"]),
            _share(one["error"]),
            one["limit"],
            f"{one['seconds']:.2g}",
            "yes" if is_met(one) else "no",
        ]
        for one in found
    ]
    return rows(heads, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--accuracy", type=float, nargs="+", default=[0.1, 0.03])
    parser.add_argument("--scenes", type=int, default=len(SEEDS))
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    tried(SEEDS[0], 0.3)  # compiles
    text = [machine({}) + ", one process", ""]
    for accuracy in options.accuracy:
        found = []
        for seed in SEEDS[: options.scenes]:
            found.append(tried(seed, accuracy))
            print(found[-1], flush=True)
        met = sum(map(is_met, found))
        held = sum(one["error"] <= (np.inf if one["half_width"] is None else one["half_width"]) for one in found)
        ratio = np.median(
            [one["half_width"] / max(one["error"], 1e-9) for one in found if one["half_width"] is not None]
        )
        text += [
            f'`accuracy = "{100 * accuracy:g} %"`: met in {met} of {len(found)} scenes; the error is within what the run '
            f"says in {held}, which is {ratio:.2g} times the error in the median.",
            "",
            table(found),
            "",
        ]
    report = "\n".join(text)
    print(report)
    if options.write:
        save_report(__file__, "Wanted accuracy", report)


if __name__ == "__main__":
    main()
