"""Compare contact solvers: the time to reach a residual that one independent function computes.

    python tests/benchmarks/contact.py --sizes 128
    python tests/benchmarks/contact.py --records contact.jsonl --write

The surfaces are self-affine and periodic, with a Hurst exponent of 0.8, a roll-off of an eighth of the side, a
shortest wave of 8 pixels, an rms slope of 0.2 and E* = 115 GPa. Each solver is run with smaller and smaller
values of its own tolerance until the residual is small enough. The report contains the CPU time of the last
run, as the median of its repetitions. FFT plans and compiled functions are prepared before.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from common import failures, main, ratio, table, timed
from peers import CONTACTS, present

MODULUS, HARDNESS, SPACING = 115e9, 4e9, 1e-6
#: Residuals, and nominal pressures of 0.0004, 0.0017 and 0.009 E*; without plasticity 0.035 E* too.
TARGETS, PRESSURES, HIGH = (1e-4, 2e-7, 1e-8), (50e6, 200e6, 1000e6), (4000e6,)
PROGRAMS = ("femseal", "ASPHER", "Tamaas", "ContactMechanics")
#: Solvers that know no hardness.
ELASTIC = ("ASPHER",)


def undeformed_gap(n):
    """Return the undeformed gap (n, n) [m] of the self-affine surface."""
    from femseal import self_affine

    side = n * SPACING
    waves = {"roll_off": side / 8, "cut_off": 8 * SPACING}
    face = self_affine((n, n), (side, side), hurst=0.8, rms_slope=0.2, rng=1, **waves)
    return face.heights.mean() - face.heights


def residual(pressure, gap0, hardness):
    """Compute the residual ‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ of a contact pressure p.

    Here v = Kp + h₁ is the gap before the approach δ, and c = πE*/4Δ is a scale with the pixel size Δ. The
    approach δ is the one for which clip(p − c(v − δ), 0, H) has the same mean pressure as p.
    """
    import scipy.fft
    from scipy.optimize import brentq

    n = gap0.shape[0]
    q1, q2 = scipy.fft.fftfreq(n, SPACING), scipy.fft.rfftfreq(n, SPACING)
    q = 2 * np.pi * np.hypot(q1[:, None], q2)
    q[0, 0] = np.inf
    v = scipy.fft.irfft2(scipy.fft.rfft2(pressure) * 2 / (MODULUS * q), s=gap0.shape) + gap0
    c = np.pi * MODULUS / (4 * SPACING)

    def moved(delta):
        """Return clip(p − c(v − δ), 0, H)."""
        return np.clip(pressure - c * (v - delta), 0, hardness)

    def missing(delta):
        """Return the difference between the sums of the clipped pressure and of the pressure."""
        return moved(delta).sum() - pressure.sum()

    reach = pressure.max() / c
    delta = brentq(missing, v.min() - reach, v.max() + 2 * reach, xtol=1e-30, rtol=1e-15)
    return float(np.linalg.norm(pressure - moved(delta)) / np.linalg.norm(pressure))


def solver_of(name, shape, hardness):
    """Return a function of undeformed gap, load and tolerance that gives the pressure and the number of FFT pairs.

    The number of FFT pairs is None for other programs.
    """
    from femseal import HalfSpace, solve_contact

    if name != "femseal":
        peer = CONTACTS[name](shape, SPACING, MODULUS, hardness)
        return lambda gap0, load, rtol: (peer(gap0, load, rtol)[0], None)
    body = HalfSpace(shape, (SPACING, SPACING), MODULUS)

    def solve(gap0, load, rtol):
        contact = solve_contact(gap0, body, pressure=load, hardness=hardness, rtol=rtol, threads=1)
        return contact.pressure, contact.fft_pairs

    return solve


def measure(task):
    """Return the record of one solver at one load, for the loosest of its tolerances that reaches the residual."""
    name, gap0 = task["solver"], undeformed_gap(task["n"])
    hardness = task["hardness"] or np.inf
    solve = solver_of(name, gap0.shape, hardness)
    solve(gap0, 200e6, 1e-1)  # plans, compilation
    tolerances = [task["target"]] if name == "femseal" else [10.0**-k for k in range(2, 16)]
    spent, record = 0.0, {}
    for tolerance in tolerances:
        run = partial(solve, gap0, task["pressure"], tolerance)
        result, record = timed(run, task["repeats"])
        spent += record["seconds"]
        if result is None:
            return record
        reached = residual(result[0], gap0, hardness)
        record |= {"pairs": result[1], "residual": reached}
        if reached <= task["target"] or spent > 60:
            break
    if record["residual"] > task["target"]:
        record["failure"] = f"residual {record['residual']:.0e}"
    return record


def series(sizes, repeats):
    """Yield one series of tasks over the sizes for each solver, hardness, pressure and residual.

    A hardness of None stands for an elastic contact, because JSON has no infinity.
    """
    for solver in ("femseal", *present(PROGRAMS[1:])):
        for hardness in (None,) if solver in ELASTIC else (HARDNESS, None):
            for pressure in PRESSURES if hardness else PRESSURES + HIGH:
                for target in TARGETS:
                    task = {"solver": solver, "hardness": hardness, "pressure": pressure}
                    task |= {"target": target, "repeats": repeats}
                    yield [task | {"n": n, "size": n**2} for n in sizes]


def report(records):
    """Write the table of all records, and the list of failures."""
    head = ["n", "H [GPa]", "p̄ [MPa]", "residual", "femseal [s] (FFT pairs)", *PROGRAMS[1:]]
    by_task = {}
    for r in records:
        key = r["n"], r["hardness"] or math.inf, r["pressure"], -r["target"]
        by_task.setdefault(key, {})[r["solver"]] = r
    cells = []
    for (n, hardness, pressure, target), by_solver in sorted(by_task.items()):
        femseal_record = by_solver["femseal"]
        bound = "∞" if hardness == math.inf else f"{hardness / 1e9:g}"
        line = [n, bound, f"{pressure / 1e6:g}", f"{-target:.0e}"]
        line.append(f"{femseal_record['seconds']:.3g} ({femseal_record['pairs']})")
        cells.append(
            [*line, *(ratio(by_solver.get(name), femseal_record) for name in PROGRAMS[1:])]
        )
    return f"""The CPU times of the other programs are given relative to femseal. "–" means that the solver was not run.

{table(head, cells)}

{failures(records, "solver", "n", "hardness", "pressure", "target")}"""


if __name__ == "__main__":
    packages = ("aspher", "tamaas", "ContactMechanics", "pyFFTW")
    sizes = (256, 512, 1024)
    main(__file__, "Contact solvers", packages, sizes, series, measure, report)
