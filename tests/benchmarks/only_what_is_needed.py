"""What is left out where a scene does not need it: the gain of each rule, the error that it brings, and its switch.

    FEMSEAL_SURFACES=… python tests/benchmarks/only_what_is_needed.py --records needed.jsonl --write

Times are CPU times of one thread. The first table has the rules; the second the error of ln(leakage) by the tolerances of
contact and of flow, on twelve scenes at three loads each: the leakage at the last is a hundredth of that at the first or less,
near closing. The reference has the contact to 1e-10 and the flow by elimination. `--records` keeps what is computed and
goes on from there.
"""

from __future__ import annotations

import argparse
import os
import time
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from common import kept, machine, rows, save_report

MODULUS, PIXEL = 115e9, 1e-6
#: Points a side of the faces.
POINTS = (192, 512)
CONTACT_RTOL = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
FLOW_RTOL = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
SCENES = ("self-affine, elastic", "self-affine, 0.14", "self-affine, 0.03", "turned", "turned along", "measured")
#: Loads in shares of that at which a hundredth of the leakage at the first is left.
LOADS = (0.15, 0.6, 1.0)


def surface_of(kind, n, seed=1):
    """A face of a kind, and the hardness."""
    from femseal import Topography, condition, read_topography, self_affine, turned

    size = (n * PIXEL,) * 2
    if kind.startswith("self-affine"):
        face = self_affine((n, n), size, hurst=0.8, rms_slope=0.2, roll_off=size[0] / 4, cut_off=8 * PIXEL, rng=seed)
        return face, np.inf if "elastic" in kind else float(kind.split()[-1]) * MODULUS * 0.2
    if kind == "measured":
        whole = read_topography(Path(os.environ["FEMSEAL_SURFACES"]) / "plu-1.plu")
        face, _ = condition(whole, shape=(n, n))
        return face, 0.14 * MODULUS * face.rms_slope
    face = turned(
        (n, n),
        size,
        pitch=size[0] / 7,
        depth=2e-6,
        roughness=0.3e-6,
        roughness_roll_off=size[0] / 8,
        cut_off=8 * PIXEL,
        rng=seed,
    )
    face = Topography(np.ascontiguousarray(face.heights.T), face.spacing) if kind == "turned along" else face
    return face, 4e9


def solved(face, hardness, pressure, rtol):
    """Gap of the face under a pressure, and the CPU time."""
    from femseal.contact import HalfSpace, solve_contact

    body = HalfSpace(face.shape, face.spacing, MODULUS, ("free", "periodic"))
    start = time.process_time()
    contact = solve_contact(face.heights.max() - face.heights, body, pressure=pressure, hardness=hardness, rtol=rtol)
    return contact.gap, time.process_time() - start


def permeability(gap, face, rtol, solver):
    from femseal.flow import cell_permeability

    start = time.process_time()
    k = cell_permeability(gap, face.spacing, sides="periodic", rtol=rtol, solver=solver).value
    return k, time.process_time() - start


def hundredth(face, hardness):
    """A pressure at which the permeability is a hundredth of that at a hundredth of it, or less, but not 0."""
    full = min(hardness, 0.5 * MODULUS * face.rms_slope)
    first, _ = permeability(solved(face, hardness, 0.005 * full, 1e-6)[0], face, 1e-6, "elimination")
    low, high = 0.005 * full, 0.98 * full
    for _ in range(9):
        middle = np.sqrt(low * high)
        k, _ = permeability(solved(face, hardness, middle, 1e-6)[0], face, 1e-6, "elimination")
        low, high = (middle, high) if k > 1e-2 * first else (low, middle)
        if 1e-4 * first < k <= 1e-2 * first:
            return middle
    return low


def tolerances_of(task):
    """Errors of ln k, and CPU times, for every tolerance (tolerances, loads), of one scene."""
    face, hardness = surface_of(task["scene"], task["points"])
    top = hundredth(face, hardness)
    found = {"contact": [], "flow": [], "leakage": []}
    solved(face, hardness, 0.1 * top, 1e-3)
    for share in LOADS:
        exact, _ = solved(face, hardness, share * top, 1e-10)
        k, direct = permeability(exact, face, 1e-8, "elimination")
        found["leakage"].append(k)
        along_contact, along_flow = [], []
        for rtol in CONTACT_RTOL:
            gap, seconds = solved(face, hardness, share * top, rtol)
            value, _ = permeability(gap, face, 1e-8, "elimination")
            along_contact.append((error(value, k), seconds))
        for rtol in FLOW_RTOL:
            try:
                value, seconds = permeability(exact, face, rtol, "multigrid")
                along_flow.append((error(value, k), seconds))
            except Exception:
                along_flow.append((float("nan"), direct))
        found["contact"].append(along_contact)
        found["flow"].append(along_flow)
    return found


def error(value, reference):
    """|ln(value / reference)|; inf where one of them alone is closed."""
    if value == reference:
        return 0.0
    return float(abs(np.log(value / reference))) if value > 0 and reference > 0 else float("inf")


def tolerance_tables(records):
    """The table of errors and times by the tolerance: of contact, and of flow."""
    tables = []
    for part, tolerances in (("contact", CONTACT_RTOL), ("flow", FLOW_RTOL)):
        values = np.array([record["found"][part] for record in records])  # scenes, loads, tolerances, (error, time)
        cells = []
        for n, rtol in enumerate(tolerances):
            errors, seconds = values[:, :, n, 0], values[:, :, n, 1]
            cells.append(
                [
                    f"{rtol:.0e}",
                    *(f"{np.nanmax(errors[:, load]):.1e}" for load in range(len(LOADS))),
                    f"{np.nanmedian(errors):.1e}",
                    f"{np.median(seconds / values[:, :, tolerances.index(1e-5), 1]):.2f}",
                ]
            )
        head = [
            f"rtol of {part}",
            *(f"largest error at {share:g} of the load" for share in LOADS),
            "median error",
            "CPU time, of that with 1e-5",
        ]
        tables.append(rows(head, cells))
    return tables


# --- the rules ------------------------------------------------------------------------------------------------------

FACE = """
seed = 3
[face]
kind = "self-affine"
points = [{n}, {n}]
size = ["{n} um", "{n} um"]
rms_slope = 0.2
roll_off = "60 um"
[material]
young = "210 GPa"
{strength}
[load]
loading = {loading}
unload_from = {peaks}
unloading = {stops}
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
[cells]
count = [8, 8]
{cells}
[stochastic]
length = "4 mm"
realisations = 50
[output]
budget = {budget}
pictures = {files}
fields = {files}
paraview = "{paraview}"
"""
PLAIN = {
    "n": 256,
    "strength": 'hardness = "4 GPa"',
    "loading": [],
    "peaks": [],
    "stops": [],
    "cells": "",
    "budget": "false",
    "files": "false",
    "paraview": "none",
}
CYCLE = {
    "loading": ["50 MPa", "150 MPa", "300 MPa", "600 MPa"],
    "peaks": ["600 MPa"],
    "stops": ["300 MPa", "150 MPa", "50 MPa"],
}
#: Rule: method, keys of the case without it, keys with it, further keys of both; the switch, and what is compared.
RULES = {
    "nothing is drawn, no fields": (
        "two-scale",
        {"files": "true", "paraview": "vtu"},
        {},
        CYCLE,
        "`pictures`, `report`, `fields`, `paraview` in `[output]`",
    ),
    "equal load states once, deterministic": (
        "deterministic",
        {"stops": ["300.0000001 MPa", "150.0000001 MPa", "50.0000001 MPa"]},
        {},
        CYCLE | {"n": 512, "strength": ""},
        "none: the bits are the same",
    ),
    "equal load states once, two scales": (
        "two-scale",
        {"stops": ["300.0000001 MPa", "150.0000001 MPa", "50.0000001 MPa"]},
        {},
        CYCLE | {"strength": ""},
        "none: the bits are the same",
    ),
}
#: Pairs of runs, the median of which is told.
PAIRS = 3


def run_of(method, keys, folder):
    """CPU time of a run, its leakage, and the number of load steps that were solved."""
    import tomllib

    import femseal as fs
    from femseal.case.case import parse_case

    text = FACE.format(**PLAIN | keys).replace("seed = 3", f'seed = 3\nmethod = "{method}"')
    case = parse_case(tomllib.loads(text))
    start = time.process_time()
    results = fs.run(case, folder, workers=1)
    seconds = time.process_time() - start
    data = results.dataset
    steps = data.sizes["step"]
    return seconds, results.leakage.values.tolist(), len(np.unique(results.leakage.values)), steps


def rule_of(task):
    """Median CPU times without and with a rule, and the largest error of ln(leakage) that it brings."""
    method, without, with_it, both, _ = RULES[task["rule"]]
    times = []
    with TemporaryDirectory() as folder:
        for pair in range(PAIRS + 1):  # the first compiles
            before, after = (
                run_of(method, both | keys, Path(folder) / f"{pair}{side}")
                for side, keys in (("a", without), ("b", with_it))
            )
            times.append((before[0], after[0]))
    pairs = zip(before[1], after[1], strict=True)
    without, with_it = np.median(times[1:], axis=0)
    return {"without": without, "with": with_it, "error": max(error(q, r) for r, q in pairs), "solved": after[2:]}


def rules_table(records):
    cells = []
    for record in records:
        found = record["found"]
        solved, steps = found["solved"]
        cells.append(
            [
                record["rule"],
                RULES[record["rule"]][-1] if record["rule"] in RULES else "`budget` in `[output]`, `width`",
                f"{found['without']:.2f} s",
                f"{found['with']:.2f} s",
                f"{found['without'] / found['with']:.2f}",
                f"{found['error']:.1e}" if found["error"] else "0",
                f"{solved} of {steps}",
            ]
        )
    head = ["rule", "switch", "without", "with it", "gain", "largest error of ln(leakage)", "load steps solved"]
    return rows(head, cells)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()

    def found(task, solve):
        return kept(task, task, options.records, lambda: task | {"found": solve(task)})

    rules = [found({"rule": rule}, rule_of) for rule in RULES]
    measured = [
        found({"rule": "tolerances", "scene": scene, "points": points}, tolerances_of)
        for points, scene in product(POINTS, SCENES)
        if scene != "measured" or "FEMSEAL_SURFACES" in os.environ
    ]
    parts = [
        machine({"numpy": "numpy"}),
        "## Rules",
        rules_table(rules),
        "## Tolerances",
        *tolerance_tables(measured),
    ]
    text = "\n\n".join(parts)
    print(text)
    if options.write:
        save_report(__file__, "Only what is needed", text)


if __name__ == "__main__":
    main()
