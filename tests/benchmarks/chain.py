"""Whole studies against the plain way: the same face, loads and pixels by other programs.

    python tests/benchmarks/chain.py --sizes 64
    python tests/benchmarks/chain.py --records chain.jsonl --write

A self-affine face (Hurst 0.8, longest wave a quarter of the face, shortest 8 pixels, rms slope
0.25, H = 0.14 E* h′), periodic along both axes, is loaded to 0.3 H and unloaded. The plain way
takes the contact by Tamaas or ContactMechanics and the flow by scikit-fem with pyamg or PARDISO.
Errors are exp(rms ln(Q/Q_ref)) − 1 over the loads that leak more than 1e-3 of the first; the
reference is Richardson's limit of femseal's solutions on two and four times the pixels a side,
from gaps sampled anew. Time to the same error is interpolated between femseal's on half, as many
and twice the pixels a side. Each run is a process of its own with one thread, compilation before;
times are CPU times.
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
    """Face whose shortest wave is 8 of n pixels, at pixels², the first at `shift` spacings [m]."""
    c = waves(n)
    k = np.arange(c.shape[0]) - c.shape[0] // 2
    slope = np.sqrt(np.sum(np.abs(c) ** 2 * (k[:, None] ** 2 + k**2))) * 2 * np.pi / (n * PIXEL)
    return sampled(c, pixels, shift) * SLOPE / slope


def loads(fractions):
    """Nominal pressures [Pa]."""
    return tuple(HARDNESS * fraction for fraction in fractions)


def own_study(n, pixels, rtol):
    """Permeability [m³] at all states by femseal."""
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


def plain_study(contact, n):
    """Permeability by each flow through a peer's contact, and the CPU time of each part [s]."""
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
    """Record of a study; a small one before compiles."""
    if "contact" in task:
        plain_study(task["contact"], 64)
        found, record = timed(partial(plain_study, task["contact"], task["n"]))
        return record if found is None else record | {"k": found[0], "parts": found[1]}
    own_study(64, 64, 1e-6)
    run = partial(own_study, task["n"], task["pixels"], task["rtol"])
    found, record = timed(run, task["repeats"])
    return record | {"k": found.tolist()}


def series(sizes, repeats):
    """Of each size the reference, studies on half to twice the pixels, and those of the peers."""
    for n in sizes:
        for times, rtol in ((0.5, 1e-5), (1, 1e-5), (2, 1e-5), (2, 1e-6), (4, 1e-6)):
            pixels = round(times * n)
            task = {"n": n, "pixels": pixels, "rtol": rtol, "size": pixels**2}
            yield [task | {"repeats": repeats if rtol == 1e-5 else 1}]
        for contact in present(TOLERANCES):
            yield [{"n": n, "contact": contact, "size": n**2}]


def error(k, exact):
    """exp(rms ln(k/k_ref)) − 1 over the states that leak more than 1e-3 of the first."""
    k, chosen = np.array(k), exact > 1e-3 * exact[0]
    with np.errstate(divide="ignore"):
        return float(np.expm1(np.sqrt(np.mean(np.log(k[chosen] / exact[chosen]) ** 2))))


def seconds_at(wanted, curve):
    """Time of femseal to a wanted error, between its (seconds, error); NaN beyond the finest."""
    seconds, errors = np.array(sorted(curve)).T
    errors = np.minimum.accumulate(errors)
    if wanted < errors[-1]:
        return np.nan
    between = np.interp(np.log(wanted), np.log(errors[::-1]), np.log(seconds[::-1]))
    return float(np.exp(between))


def shown(contact):
    """Name of a contact solver in the report."""
    return contact.replace("from bearing area", "(bearing-area start)")


def report(records):
    """A line for each size, contact and flow."""
    head = ["pixels", "femseal [s]", "error", "script: contact, flow"]
    head += [
        "contact + flow [s]",
        "error",
        "ratio, same pixels",
        "ratio, same error",
    ]
    cells = []
    for n in dict.fromkeys(r["n"] for r in records):
        of = [r for r in records if r["n"] == n]
        own = {(r["pixels"], r["rtol"]): r for r in of if "pixels" in r}
        half, fine = (np.array(own[times * n, 1e-6]["k"]) for times in (2, 4))
        exact = fine + (fine - half) / 3
        curve = [
            (r["seconds"], error(r["k"], exact)) for (_, rtol), r in own.items() if rtol > 1e-6
        ]
        same = own[n, 1e-5]
        left = [f"{n}²", f"{same['seconds']:.3g}", f"{error(same['k'], exact):.2%}"]
        for r in (r for r in of if "parts" in r):
            for flow, k in r["k"].items():
                contact, off = r["parts"]["contact"], error(k, exact)
                whole = contact + r["parts"][flow]
                line = [f"{shown(r['contact'])}, {flow}", f"{contact:.3g} + {r['parts'][flow]:.3g}"]
                line.append(f"{off:.2%}")
                line += [f"{whole / s:.3g}×" for s in (same["seconds"], seconds_at(off, curve))]
                cells.append([*left, *line])
    told = ", ".join(f"{shown(name)} {tolerance:g}" for name, tolerance in TOLERANCES.items())
    return f"""{table(head, cells)}

Tolerances of the contact solvers: {told}.

{failures(records, "contact", "n")}"""


if __name__ == "__main__":
    packages = ("tamaas", "ContactMechanics", "scikit-fem", "pyamg", "pypardiso")
    main(__file__, "Whole studies", packages, (512, 1024), series, measure, report)
