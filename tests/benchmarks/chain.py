"""Compare whole studies by femseal with scripts that use other programs, for the same surface, loads and pixels.

    python tests/benchmarks/chain.py --sizes 64
    python tests/benchmarks/chain.py --records chain.jsonl --write

A self-affine surface is loaded to 0.3 H and unloaded; it is periodic along both axes. Its Hurst exponent is
0.8, its longest wave is a quarter of the side, its shortest wave is 8 pixels long, its rms slope is 0.25, and H
= 0.14 E* h′. In the scripts, Tamaas or ContactMechanics solves the contact, and scikit-fem with pyamg or
PARDISO solves the flow.

The error of a study is exp(rms ln(Q/Q_ref)) − 1 over the loads that leak more than 1e-3 of the first load. The
reference Q_ref is the Richardson extrapolation of femseal's solutions on two and four times the pixels per
side; the surface is sampled anew on each grid. The time of femseal at the error of a script is interpolated
between its times on half, the same and twice the pixels per side. Each study runs in a process of its own with
one thread, after all functions have been compiled. All times are CPU times.
"""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from common import failures, main, table, timed
from flow import sampled, waves
from peers import CONTACTS, PlainFlow, gaps_of_cycle, present

MODULUS, PIXEL, SLOPE = 115e9, 1e-6, 0.25
HARDNESS = 0.14 * MODULUS * SLOPE
#: Nominal pressures as fractions of the hardness, the peak, the stops on the way down.
LOADING, PEAKS, UNLOADING = (0.02, 0.05, 0.1, 0.2, 0.3), (0.3,), (0.15, 0.05, 0.01)
VISCOSITY, DROP = 1e-3, 1e7
#: Of 0.1 to 1e-5, the loosest that changes the leakage of a face of 256² by a quarter of its error.
TOLERANCES = {
    "Tamaas": 1e-3,
    "ContactMechanics": 1e-4,
    "ContactMechanics from bearing area": 1e-4,
}
FLOWS = ("pyamg", "PARDISO")


def heights(n, pixels, shift):
    """Sample the surface whose shortest wave is 8 of n pixels long on pixels² points [m].

    The first point lies `shift` spacings from the origin.
    """
    c = waves(n)
    k = np.arange(c.shape[0]) - c.shape[0] // 2
    slope = np.sqrt(np.sum(np.abs(c) ** 2 * (k[:, None] ** 2 + k**2))) * 2 * np.pi / (n * PIXEL)
    return sampled(c, pixels, shift) * SLOPE / slope


def loads(fractions):
    """Convert fractions of the hardness into nominal pressures [Pa]."""
    return tuple(HARDNESS * fraction for fraction in fractions)


def femseal_study(n, pixels, rtol):
    """Compute the permeability [m³] in all contact states by femseal."""
    from femseal import Liquid, Scene, Topography, deterministic

    scene = Scene(
        surface=Topography(heights(n, pixels, 0.5), (n * PIXEL / pixels,) * 2),
        modulus=MODULUS,
        hardness=HARDNESS,
        fluid=Liquid(viscosity=VISCOSITY, density=1000.0),
        inlet_pressure=DROP,
        outlet_pressure=0.0,
        loading=loads(LOADING),
        unload_from=loads(PEAKS),
        unloading=loads(UNLOADING),
        boundary=("periodic", "periodic"),
        rtol=rtol,
    )
    return deterministic(scene).leakage * VISCOSITY * n * PIXEL / DROP


def script_study(contact, n):
    """Compute the permeability by a script for each flow solver, and the CPU time of each part [s]."""
    z, cycle = heights(n, n, 0.0), (loads(LOADING), loads(PEAKS), loads(UNLOADING))
    start = time.process_time()
    solve = CONTACTS[contact](z.shape, PIXEL, MODULUS, HARDNESS)
    gaps = gaps_of_cycle(solve, z.max() - z, *cycle, TOLERANCES[contact])
    k, parts = {}, {"contact": time.process_time() - start}
    for flow in present(FLOWS):
        start = time.process_time()
        permeability = PlainFlow(z.shape, flow)
        k[flow] = [permeability(gap) for gap in gaps]
        parts[flow] = time.process_time() - start
    return k, parts


def measure(task):
    """Run a study after a small one that compiles all functions, and return its record."""
    if "contact" in task:
        script_study(task["contact"], 64)
        result, record = timed(partial(script_study, task["contact"], task["n"]))
        return record if result is None else record | {"k": result[0], "parts": result[1]}
    femseal_study(64, 64, 1e-6)
    run = partial(femseal_study, task["n"], task["pixels"], task["rtol"])
    result, record = timed(run, task["repeats"])
    return record | {"k": result.tolist()}


def series(sizes, repeats):
    """Yield the tasks of each size: studies by femseal on half to four times the pixels, and the scripts."""
    for n in sizes:
        for times, rtol in ((0.5, 1e-5), (1, 1e-5), (2, 1e-5), (2, 1e-6), (4, 1e-6)):
            pixels = round(times * n)
            task = {"n": n, "pixels": pixels, "rtol": rtol, "size": pixels**2}
            yield [task | {"repeats": repeats if rtol == 1e-5 else 1}]
        for contact in present(TOLERANCES):
            yield [{"n": n, "contact": contact, "size": n**2}]


def error(k, exact):
    """Compute exp(rms ln(k/k_ref)) − 1 over the states that leak more than 1e-3 of the first state."""
    k, chosen = np.array(k), exact > 1e-3 * exact[0]
    with np.errstate(divide="ignore"):
        return float(np.expm1(np.sqrt(np.mean(np.log(k[chosen] / exact[chosen]) ** 2))))


def seconds_at(wanted, curve):
    """Interpolate the time of femseal at an error, from pairs (seconds, error); NaN below the smallest error."""
    seconds, errors = np.array(sorted(curve)).T
    errors = np.minimum.accumulate(errors)
    if wanted < errors[-1]:
        return np.nan
    between = np.interp(np.log(wanted), np.log(errors[::-1]), np.log(seconds[::-1]))
    return float(np.exp(between))


def shown(contact):
    """Return the name of a contact solver for the report."""
    return contact.replace("from bearing area", "(bearing-area start)")


def report(records):
    """Write a table with a row for each size, contact solver and flow solver."""
    head = ["pixels", "femseal [s]", "error", "script: contact, flow"]
    head += [
        "contact + flow [s]",
        "error",
        "ratio, same pixels",
        "ratio, same error",
    ]
    cells = []
    for n in dict.fromkeys(r["n"] for r in records):
        records_of_size = [r for r in records if r["n"] == n]
        femseal_records = {(r["pixels"], r["rtol"]): r for r in records_of_size if "pixels" in r}
        half, fine = (np.array(femseal_records[times * n, 1e-6]["k"]) for times in (2, 4))
        exact = fine + (fine - half) / 3
        curve = [
            (r["seconds"], error(r["k"], exact))
            for (_, rtol), r in femseal_records.items()
            if rtol > 1e-6
        ]
        same = femseal_records[n, 1e-5]
        left = [f"{n}²", f"{same['seconds']:.3g}", f"{error(same['k'], exact):.2%}"]
        for r in (r for r in records_of_size if "parts" in r):
            for flow, k in r["k"].items():
                contact, off = r["parts"]["contact"], error(k, exact)
                whole = contact + r["parts"][flow]
                line = [f"{shown(r['contact'])}, {flow}", f"{contact:.3g} + {r['parts'][flow]:.3g}"]
                line.append(f"{off:.2%}")
                line += [f"{whole / s:.3g}×" for s in (same["seconds"], seconds_at(off, curve))]
                cells.append([*left, *line])
    tolerances = ", ".join(f"{shown(name)} {tolerance:g}" for name, tolerance in TOLERANCES.items())
    return f"""{table(head, cells)}

Tolerances of the contact solvers: {tolerances}.

{failures(records, "contact", "n")}"""


if __name__ == "__main__":
    packages = ("tamaas", "ContactMechanics", "scikit-fem", "pyamg", "pypardiso")
    main(__file__, "Whole studies", packages, (512, 1024), series, measure, report)
