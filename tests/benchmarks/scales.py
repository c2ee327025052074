"""How wrong two scales are: leakage over a load cycle against the deterministic solution of the same surface.

    python tests/benchmarks/scales.py --points 512 1024 --seeds 5 --records scales.jsonl --write

Surfaces: turned across the flow with ridges on and off the window's faces, turned along the flow, self-affine, and measured
files (`--measured FILE ...`, levelled, without waves shorter than 8 pixels); contact free along x1 and periodic along x2,
taken from the whole face or solved in each window (`--contact`).
Factors are exp(rms ln(Q/Q_det)) over the loads with Q_det above 1e-3 of the first: of links between windows, and of the
flow resolved on their stitched gap, so that contact and flow can be told apart. Every route runs in a process of its own
with one thread; times are its CPU time, memory is what its peak is above that of a small surface before. `--records` keeps what is computed and goes on from there.
`--write` puts the table beside this file, where the documentation takes it from.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import call, forget_peak, kept, machine, resident, rows, save_report

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


def scene_of(task):
    from femseal import Liquid, Scene, condition, read_topography

    if task["kind"] == "measured":
        whole = read_topography(task["file"])
        shape = tuple(n // task["windows"] * task["windows"] for n in whole.shape)
        surface, _ = condition(whole, shape=shape)
    else:
        surface = face(task["kind"], task["n"], task["seed"])
    hardness = 0.14 * MODULUS * surface.rms_slope if task["kind"] in ("self-affine", "measured") else 4e9
    return Scene(
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


def study(task):
    """One route over the cycle: leakage, contact share and mean gap at every step, CPU time and peak memory."""
    from femseal import deterministic, two_scale
    from femseal.studies.scene import resolved_flow

    scene = scene_of(task)
    warm = scene_of({"kind": "self-affine", "n": 64, "seed": 0})
    deterministic(warm), two_scale(warm, (2, 2))
    forget_peak()
    before = resident("VmRSS")
    start = time.process_time()
    if task["route"] == "deterministic":
        result = deterministic(scene)
        record = {"leakage": result.leakage, "area": result.contact_fraction, "gap": result.mean_gap}
    else:
        result = two_scale(scene, (task["windows"],) * 2, flow="links", contact=task["contact"])
        record = {"leakage": result.leakage, "area": result.contact_fraction.mean(axis=(1, 2)),
                  "gap": result.mean_gap.mean(axis=(1, 2))}  # fmt: skip
    record |= {"seconds": time.process_time() - start, "megabytes": (resident("VmHWM") - before) / 2**20}
    if task["route"] == "two-scale":
        spacing = scene.surface.spacing
        record["gap error"] = float(result.gap_error.max())
        record["resolved"] = scene.resolved_leakage(resolved_flow(g, spacing) for g in result.gap).leakage
        record["resolved seconds"] = time.process_time() - start
    return {name: np.asarray(value).tolist() for name, value in record.items()}


def compare(task, exact, two):
    """Factors of one surface."""
    from femseal.accuracy import closing_load, leakage_factor
    from femseal.loads import LoadProgramme

    steps = LoadProgramme.of(LOADING, PEAKS, UNLOADING)
    record = dict(task)
    for name, leakage in (("links", two["leakage"]), ("resolved", two["resolved"])):
        for branch in ("loading", "unloading"):
            factor = leakage_factor(leakage, exact["leakage"], steps, branch)
            record[f"{name} {branch}"], record[f"{name} {branch} closed"] = factor.value, factor.closed
    record["closing"] = [closing_load(r["leakage"], steps) for r in (exact, two)]
    for name in ("area", "gap"):
        ratio = np.array(two[name]) / np.array(exact[name])
        record[name] = float(np.exp(np.sqrt(np.mean(np.log(ratio) ** 2))))
    for name in ("seconds", "megabytes"):
        record[name] = [exact[name], two[name]]
    record |= {name: two[name] for name in ("resolved seconds", "gap error")}
    return record


def table(records):
    head = ["surface", "points, windows", "contact", "seeds", "links: loading", "unloading", "resolved: loading", "unloading", "area",
            "mean gap", "its estimated error", "closing load p̄/H, deterministic : two scales", "CPU time [s], deterministic : links : resolved",
            "memory [MB], deterministic : links"]  # fmt: skip
    cells, groups = [], {}
    for r in records:
        groups.setdefault((r["kind"], r["label"], r["windows"], r["contact"]), []).append(r)
    for (kind, label, windows, contact), chosen in groups.items():

        def spread(name, chosen=chosen):
            values = [r[name] for r in chosen]
            lost = sum(r.get(f"{name} closed", 0) for r in chosen)
            text = f"{np.nanmedian(values):.3g}"
            text += f" ({np.nanmin(values):.3g}–{np.nanmax(values):.3g})" if len(chosen) > 1 else ""
            return text + (f", {lost} loads closed" if lost else "")

        closings = ", ".join(f"{a:.3g}:{b:.3g}" for a, b in (r["closing"] for r in chosen)).replace("inf", "–")
        names = (
            "links loading",
            "links unloading",
            "resolved loading",
            "resolved unloading",
            "area",
            "gap",
            "gap error",
        )
        seconds, memory = (np.median([r[name] for r in chosen], axis=0) for name in ("seconds", "megabytes"))
        resolved = np.median([r["resolved seconds"] for r in chosen])
        cells.append([kind, f"{label}, {windows}²", contact, str(len(chosen)), *(spread(name) for name in names), closings,
                      f"{seconds[0]:.3g} : {seconds[1]:.3g} : {resolved:.3g}",
                      f"{memory[0]:.0f} : {memory[1]:.0f}"])  # fmt: skip
    return rows(head, cells)


def computed(task):
    """The record of a task, each route by a process of its own."""
    routes = [call(__file__, ["--worker", json.dumps(task | {"route": r})], 1) for r in ("deterministic", "two-scale")]
    return {name: value for name, value in compare(task, *routes).items() if name != "file"}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, nargs="*", default=[512])
    parser.add_argument(
        "--window", type=int, default=0, help="pixels along a side of a window [32 up to 512², else 64]"
    )
    parser.add_argument("--contact", nargs="+", default=["whole", "windows"], choices=["whole", "windows"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--measured", nargs="*", default=[], help="files of measured faces")
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--write", action="store_true", help="write the table of all records")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(study(json.loads(options.worker))))
        return
    tasks = [
        {
            "kind": kind,
            "label": f"{n}²",
            "n": n,
            "seed": seed,
            "windows": n // (options.window or (32 if n <= 512 else 64)),
            "contact": contact,
        }
        for n in options.points
        for kind in options.kinds
        for seed in range(1, options.seeds + 1)
        for contact in options.contact
    ]
    tasks += [
        {
            "kind": "measured",
            "label": Path(file).stem,
            "file": file,
            "n": 0,
            "seed": 0,
            "windows": 16,
            "contact": contact,
        }
        for file in options.measured
        for contact in options.contact
    ]
    names = ("kind", "label", "seed", "windows", "contact")
    records = [kept(task, names, options.records, partial(computed, task)) for task in tasks]
    if options.records:
        records = [json.loads(line) for line in options.records.read_text(encoding="utf-8").splitlines()]
        records.sort(key=lambda r: ([*KINDS, "measured"].index(r["kind"]), r["n"], r["label"], r["seed"]))
    text = f"{machine({})}. Median over the seeds (lowest–highest).\n\n{table(records)}"
    print(text)
    if options.write:
        save_report(__file__, "Two scales", text)


if __name__ == "__main__":
    main()
