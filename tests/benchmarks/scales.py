"""All routes of two scales beside each other: leakage over a load cycle against the deterministic solution of a face.

    FEMSEAL_SURFACES=… python tests/benchmarks/scales.py --size usual --records scales.jsonl --write

Routes: contact of the whole face or solved in each window, and for both the flow resolved on all pixels, through elements
and through links. Surfaces: turned across the flow, self-affine, and measured files (levelled, without waves shorter than
8 pixels) from the folder FEMSEAL_SURFACES; contact free along x1 and periodic along x2. Factors are exp(rms ln(Q/Q_det))
over the loads with Q_det above 1e-3 of the first.
The deterministic solution and each kind of contact run in processes of their own with one thread; times are CPU times,
those of a route its contact and its flow; memory is the peak above that of a small surface before, contact or flow,
whichever is more, with what the study keeps. From 1024² on the cycle has half the loads. `--records` keeps what is
computed and goes on from there. `--write` puts the table beside this file, where the documentation takes it from.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import call, forget_peak, kept, machine, resident, rows, save_report

MODULUS, PIXEL = 115e9, 1e-6
#: Nominal pressures in shares of the hardness, the one to unload from, and the stops on the way down.
LOADING = (0.004, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.3, 0.4)
PEAKS, UNLOADING = (0.11, 0.3), (0.22, 0.16, 0.07, 0.03, 0.01, 0.003)
#: The cycle of large faces.
SHORT = (0.004, 0.02, 0.07, 0.16, 0.3), (0.3,), (0.16, 0.03, 0.003)
#: Points a side of the generated faces, and whether measured ones are taken.
SIZES = {"small": ((256,), False), "usual": ((512, 1024, 2048), True), "large": ((512, 1024, 2048, 4096), True)}
MEASURED = ("metropro-1.dat", "mnt-1.mnt", "plu-1.plu", "surfalize_test_1.opd")
FLOWS = ("resolved", "elements", "links")


def cycle(task):
    """Loads of a task in shares of the hardness: loading, peaks, stops of unloading."""
    return SHORT if task["n"] >= 1024 else (LOADING, PEAKS, UNLOADING)


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


KINDS = ("turned, 7 marks", "self-affine")


def scene_of(task):
    from femseal import Liquid, Scene, condition, read_topography

    if task["kind"] == "measured":
        whole = read_topography(task["file"])
        shape = tuple(n // task["windows"] * task["windows"] for n in whole.shape)
        surface, _ = condition(whole, shape=shape)
    else:
        surface = face(task["kind"], task["n"], task["seed"])
    hardness = 0.14 * MODULUS * surface.rms_slope if task["kind"] in ("self-affine", "measured") else 4e9
    loading, peaks, stops = cycle(task)
    return Scene(
        surface=surface,
        modulus=MODULUS,
        hardness=hardness,
        fluid=Liquid(viscosity=1e-3, density=1000.0),
        inlet_pressure=1e7,
        outlet_pressure=0.0,
        loading=tuple(hardness * p for p in loading),
        unload_from=tuple(hardness * p for p in peaks),
        unloading=tuple(hardness * p for p in stops),
    )


def peak(before):
    """Peak memory since the last `forget_peak` above that of the start [MB]."""
    return (resident("VmHWM") - before) / 2**20


def study(task):
    """The deterministic solution, or one kind of contact with all flows: leakage, CPU time [s] and peak memory [MB]."""
    from femseal import deterministic, two_scale
    from femseal.studies.face_contact import solve_windows

    scene, cells = scene_of(task), (task["windows"],) * 2
    warm = scene_of({"kind": "self-affine", "n": 64, "seed": 0})
    deterministic(warm)
    for flow in FLOWS:
        two_scale(warm, (2, 2), flow=flow, contact="windows")
    forget_peak()
    before, start = resident("VmRSS"), time.process_time()
    if task["contact"] == "deterministic":
        result = deterministic(scene)
        found = {
            "deterministic": {
                "leakage": result.leakage.tolist(),
                "seconds": time.process_time() - start,
                "megabytes": peak(before),
            }
        }
        return found
    contact = solve_windows(scene, cells, task["contact"])
    seconds, megabytes = time.process_time() - start, peak(before)
    found = {"gap error": float(np.nanmax(contact.gap_error)), "warned": bool(contact.warnings)}
    for flow in FLOWS:
        forget_peak()
        start = time.process_time()
        result = two_scale(scene, cells, flow=flow, solved=contact)
        found[flow] = {
            "leakage": result.leakage.tolist(),
            "seconds": seconds + time.process_time() - start,
            "megabytes": max(megabytes, peak(before)),
        }
        del result
    return found


def compare(task, exact, contacts):
    """Factors of one surface: a record for each kind of contact."""
    from femseal.loads import LoadProgramme
    from femseal.studies.load_curves import closing_load, leakage_factor

    steps, true = LoadProgramme.of(*cycle(task)), exact["deterministic"]
    record = {name: value for name, value in task.items() if name != "file"}
    record["contacts"] = {}
    record["deterministic"] = [true["seconds"], true["megabytes"], closing_load(true["leakage"], steps)]
    for contact, found in contacts.items():
        record["contacts"][contact] = {"gap error": found["gap error"], "warned": found["warned"]}
        for flow in FLOWS:
            route = found[flow]
            factors = [leakage_factor(route["leakage"], true["leakage"], steps, b) for b in ("loading", "unloading")]
            record["contacts"][contact][flow] = {
                "factors": [f.value for f in factors],
                "closed": sum(f.closed for f in factors),
                "closing": closing_load(route["leakage"], steps),
                "seconds": route["seconds"],
                "megabytes": route["megabytes"],
            }
    return record


def table(records):
    head = [
        "surface",
        "contact",
        "estimated error of the gap",
        *(f"{flow}: loading, unloading" for flow in FLOWS),
        "closing load p̄/H, deterministic : " + " : ".join(FLOWS),
        "CPU time [s], deterministic : " + " : ".join(FLOWS),
        "memory [MB], deterministic : " + " : ".join(FLOWS),
    ]
    cells = []
    for r in records:
        for contact in ("whole", "windows"):
            found = r["contacts"][contact]
            factors = []
            for flow in FLOWS:
                lost = found[flow]["closed"]
                text = ", ".join(f"{f:.3g}" for f in found[flow]["factors"]).replace("nan", "–")
                factors.append(text + (f" ({lost} loads closed)" if lost else ""))
            seconds, memory, closing = (
                [r["deterministic"][k]] + [found[flow][name] for flow in FLOWS]
                for k, name in enumerate(("seconds", "megabytes", "closing"))
            )
            label = f"{r['kind']} {r['label']}" if r["kind"] != "measured" else r["label"]
            cells.append(
                [
                    f"{label}, {r['windows']}² windows",
                    contact,
                    f"{found['gap error']:.3g}" + (", warned" if found["warned"] else ""),
                    *factors,
                    " : ".join(f"{c:.3g}" for c in closing).replace("inf", "–"),
                    " : ".join(f"{s:.3g}" for s in seconds),
                    " : ".join(f"{m:.0f}" for m in memory),
                ]
            )
    return rows(head, cells)


def computed(task):
    """The record of a task, by three processes."""
    found = {
        contact: call(__file__, ["--worker", json.dumps(task | {"contact": contact})], 1)
        for contact in ("deterministic", "whole", "windows")
    }
    return compare(task, found.pop("deterministic"), found)


def tasks_of(size, seeds):
    """Generated faces of a size and the measured ones that there are; those that are not are named."""
    sides, measured = SIZES[size]
    for n in sides:
        for kind in KINDS:
            for seed in range(1, (seeds if n <= 512 else 1) + 1):
                yield {"kind": kind, "label": f"{n}²", "n": n, "seed": seed, "windows": n // (32 if n <= 512 else 64)}
    folder = Path(os.environ.get("FEMSEAL_SURFACES", "."))
    for name in MEASURED if measured else ():
        if (folder / name).exists():
            yield {
                "kind": "measured",
                "label": Path(name).stem,
                "n": 0,
                "seed": 0,
                "windows": 16,
                "file": str(folder / name),
            }
        else:
            print(f"{name} is not in FEMSEAL_SURFACES: left out", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", default="small", choices=SIZES)
    parser.add_argument("--seeds", type=int, default=1, help="seeds of the generated faces up to 512² points")
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--write", action="store_true", help="write the table")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(study(json.loads(options.worker))))
        return
    names = ("kind", "label", "seed", "windows")
    records = [
        kept(task, names, options.records, partial(computed, task)) for task in tasks_of(options.size, options.seeds)
    ]
    text = f"{machine({})}. Seconds: of the deterministic solution and of contact and flow of each route.\n\n{table(records)}"
    print(text)
    if options.write:
        save_report(__file__, "Two scales", text)


if __name__ == "__main__":
    main()
