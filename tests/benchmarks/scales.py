"""How wrong two scales are: leakage over a load cycle against the deterministic solution of the same surface.

    python tests/benchmarks/scales.py --points 512 --seeds 5 --write

Surfaces: turned across the flow with ridges on and off the window's faces, turned along the flow, self-affine; contact free
along x1 and periodic along x2. Factors are exp(rms ln(Q/Q_det)) over the loads with Q_det above 1e-3 of the first: of
the method as it is, and of the flow solved on its stitched gap, so that contact and flow can be told apart. Times are of
one process with one thread. `--write` puts the table beside this file and into the README.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from common import ROOT, call, machine, replace_between, rows

HERE = Path(__file__).parent
MODULUS, PIXEL = 115e9, 1e-6
#: Nominal pressures in shares of the hardness, the one to unload from, and the stops on the way down.
LOADING = (0.004, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.3, 0.4)
PEAKS, UNLOADING = (0.11, 0.3), (0.22, 0.16, 0.07, 0.03, 0.01, 0.003)


def face(kind, n, seed):
    """A surface of n × n points."""
    from femseal import Topography, self_affine, turned

    size = (n * PIXEL, n * PIXEL)
    if kind == "self-affine":
        return self_affine((n, n), size, hurst=0.8, rms_slope=0.25, roll_off=size[0] / 4, cut_off=8 * PIXEL, rng=seed)
    marks = 7.0 if kind == "turned, 7 marks" else 8.0
    z = turned(
        (n, n),
        size,
        pitch=size[0] / marks,
        depth=5e-6 * n / 512,
        roughness=0.7e-6 * n / 512,
        roughness_roll_off=size[0] / 16,
        cut_off=8 * PIXEL,
        rng=seed,
    )
    return Topography(np.ascontiguousarray(z.heights.T), z.spacing) if kind == "turned along" else z


KINDS = ("turned, 8 marks", "turned, 7 marks", "turned along", "self-affine")


def study(task):
    from femseal import Liquid, Scene, deterministic, two_scale
    from femseal.accuracy import closing_load, leakage_factor
    from femseal.flow import cell_permeability
    from femseal.seal import RectangularSeal

    kind, n, seed, windows = task["kind"], task["n"], task["seed"], task["windows"]
    surface = face(kind, n, seed)
    hardness = 0.14 * MODULUS * 0.25 if kind == "self-affine" else 4e9
    scene = Scene(
        surface=surface,
        modulus=MODULUS,
        hardness=hardness,
        fluid=Liquid(viscosity=1e-3, density=1000.0),
        inlet_pressure=1e7,
        outlet_pressure=0.0,
        loading=tuple(hardness * p for p in LOADING),
        unload_from=tuple(hardness * p for p in PEAKS),
        unloading=tuple(hardness * p for p in UNLOADING),
    )
    start = time.perf_counter()
    exact = deterministic(scene)
    middle = time.perf_counter()
    two = two_scale(scene, (windows, windows))
    end = time.perf_counter()
    seal = RectangularSeal(surface.size, (1, 1))
    resolved = np.array([
        scene.leakage(seal, cell_permeability(np.asarray(g, float), surface.spacing, sides="periodic").value).per_length
        for g in two.gap
    ])  # fmt: skip
    record = {
        "kind": kind,
        "n": n,
        "windows": windows,
        "seed": seed,
        "deterministic": middle - start,
        "two-scale": end - middle,
    }
    for name, leakage in (("links", two.leakage), ("resolved", resolved)):
        for branch in ("loading", "unloading"):
            factor = leakage_factor(leakage, exact.leakage, exact.steps, branch)
            record[f"{name} {branch}"], record[f"{name} {branch} closed"] = factor.value, factor.closed
    record["closing"] = [closing_load(q, exact.steps) / hardness for q in (exact.leakage, two.leakage)]
    area = two.contact_fraction.mean(axis=(1, 2)) / exact.contact_fraction
    record["area"] = float(np.exp(np.sqrt(np.mean(np.log(area) ** 2))))
    record["ratios"] = (two.leakage / np.where(exact.leakage > 0, exact.leakage, np.nan)).tolist()
    return record


def table(records):
    head = ["surface", "points, windows", "seeds", "links: loading", "unloading", "flow on the stitched gap: loading", "unloading",
            "area", "closing load p̄/H, deterministic: two scales", "time [s], deterministic: two scales"]  # fmt: skip
    cells = []
    for key in sorted({(r["kind"], r["n"], r["windows"]) for r in records}, key=lambda k: (KINDS.index(k[0]), k[1:])):
        chosen = [r for r in records if (r["kind"], r["n"], r["windows"]) == key]

        def spread(name, chosen=chosen):
            values = [r[name] for r in chosen]
            lost = sum(r.get(f"{name} closed", 0) for r in chosen)
            text = f"{np.nanmedian(values):.3g} ({np.nanmin(values):.3g}–{np.nanmax(values):.3g})"
            return text + (f", {lost} loads closed" if lost else "")

        closings = ", ".join(f"{a:.3g}:{b:.3g}" for a, b in (r["closing"] for r in chosen)).replace("inf", "–")
        times = [np.median([r[name] for r in chosen]) for name in ("deterministic", "two-scale")]
        names = ("links loading", "links unloading", "resolved loading", "resolved unloading", "area")
        cells.append([key[0], f"{key[1]}², {key[2]}²", str(len(chosen)), *(spread(name) for name in names), closings,
                      f"{times[0]:.3g}:{times[1]:.3g}"])  # fmt: skip
    return rows(head, cells)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, nargs="+", default=[512])
    parser.add_argument("--windows", type=int, default=16, help="along a side")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--write", action="store_true", help="write the table")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(study(json.loads(options.worker))))
        return
    records = []
    for n in options.points:
        for kind in options.kinds:
            for seed in range(1, options.seeds + 1):
                task = {"kind": kind, "n": n, "seed": seed, "windows": options.windows}
                records.append(call(__file__, ["--worker", json.dumps(task)], 1))
                print(json.dumps(records[-1]), file=sys.stderr, flush=True)
    text = f"{machine({})}. Median over the seeds (lowest–highest).\n\n{table(records)}"
    print(text)
    if options.write:
        (HERE / "scales.md").write_text(f"# Two scales\n\nWritten by `scales.py`.\n\n{text}\n", encoding="utf-8")
        replace_between(ROOT / "README.md", "scales benchmark", f"\n{text}\n")


if __name__ == "__main__":
    main()
