"""Size: time and peak memory of contact and flow of ever larger faces, the flow also in reynoldsflow on the same gaps.

    python tests/benchmarks/size.py --largest 2048
    python tests/benchmarks/size.py --write

Contact is of self-affine faces with 8 pixels for the shortest wave, free along x1, at a tenth of the hardness. Gaps are such
faces cut by a plane at 20 % of their points, periodic along x2. Each size is a process of its own on one core; times are CPU times, memory is the peak above that before, for each
point, without the gap itself. reynoldsflow takes the gap constant on each pixel, so that its permeability differs.
Times on one and two threads are medians of wall times, one after the other in turn.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import call, forget_peak, kept, machine, resident, rows, save_report

#: Points a side, and those up to which programs go that do not go to all.
POINTS, OTHERS = (512, 1024, 2048, 4096, 8192, 16384), {"reynoldsflow": 1024}
PIXEL, CONTACT = 1e-6, 0.2
#: Points a side of contacts and flows on one and two threads, and how often.
THREADED, REPEATS = (2048, 4096), 5
#: Contact modulus and hardness [Pa].
MODULUS, HARDNESS = 115e9, 2.3e9


def face_heights(n):
    """Heights (n, n) [m] of a face."""
    from femseal import self_affine

    size = n * PIXEL
    face = self_affine((n, n), (size, size), hurst=0.8, rms_slope=0.1, roll_off=size / 8, cut_off=8 * PIXEL, rng=1)
    return np.array(face.heights)


def undeformed_gap(n):
    """Undeformed gap (n, n) [m] below a plane."""
    z = face_heights(n)
    return np.subtract(z.max(), z, out=z)


def cut_gap(n):
    """Gap (n, n) [m] of a face above a plane."""
    z = face_heights(n)
    np.subtract(np.quantile(z[::4, ::4], 1 - CONTACT), z, out=z)
    return np.maximum(z, 0, out=z)


def solved_contact(gap, threads):
    """The contact with an undeformed gap."""
    from femseal import HalfSpace, solve_contact

    body = HalfSpace(gap.shape, (PIXEL, PIXEL), MODULUS, ("free", "periodic"))
    return solve_contact(gap, body, pressure=0.1 * HARDNESS, hardness=HARDNESS, rtol=1e-5, threads=threads)


def contact(gap):
    """Fraction in contact, iterations and residual of the contact with an undeformed gap."""
    found = solved_contact(gap, 1)
    return found.area_fraction, found.iterations, found.residual


def resolved(gap):
    """Permeability [m³], iterations and residual of the flow resolved on all points."""
    from femseal import cell_permeability

    flow = cell_permeability(gap, (PIXEL, PIXEL), sides="periodic")
    return flow.value, flow.iterations, flow.residual


def reynoldsflow(gap):
    """Permeability [m³] by reynoldsflow."""
    from reynoldsflow.transport import compute_total_flux, solve_fluid_problem

    highest = gap.max()
    solved, _, flux = solve_fluid_problem(gap / highest)
    return abs(compute_total_flux(solved, flux, len(gap))[0]) * highest**3 / 12, 0, float("nan")


def resolved_pressure(gap, threads):
    """Fluid pressure of the flow resolved on all points."""
    from femseal import cell_permeability

    return cell_permeability(gap, (PIXEL, PIXEL), sides="periodic", threads=threads).fluid_pressure


def on_threads(shared, n):
    """Medians of the wall time [s] of n² points on one and two threads, and whether all bits are the same."""
    made, solve = SHARED[shared]
    solve(made(256), 1)
    gap, seconds, found = made(n), {1: [], 2: []}, {}
    solve(gap, 2)
    for _ in range(REPEATS):
        for threads in seconds:
            start = time.perf_counter()
            found[threads] = solve(gap, threads)
            seconds[threads].append(time.perf_counter() - start)
    one, two = (float(np.median(seconds[threads])) for threads in (1, 2))
    same = np.array_equal(found[1], found[2], equal_nan=True)
    return {"program": "threads", "shared": shared, "n": n, "one": one, "two": two, "same": bool(same)}


#: What threads share: the gap, and what is computed of it.
SHARED = {
    "contact": (undeformed_gap, lambda gap, threads: solved_contact(gap, threads).pressure),
    "resolved": (cut_gap, resolved_pressure),
}


#: Points a side from which a program has its loops of large faces; forced, or of 2^20 points.
WARM = {"contact": 1024, "resolved": 768}
PROGRAMS = {"contact": contact, "resolved": resolved, "reynoldsflow": reynoldsflow}


def measure(program, n, shared=""):
    """Record of a program on a gap of n² points, in this process; of threads, of what they share."""
    from femseal.flow import cell

    if program == "threads":
        return on_threads(shared, n)
    solve = PROGRAMS[program]
    made = undeformed_gap if program == "contact" else cut_gap
    largest = cell.SINGLE_NODES
    for small in (128, WARM.get(program, 256)):  # all loops are compiled by then
        cell.SINGLE_NODES = small**2 if n**2 >= largest else largest
        solve(made(small))
    cell.SINGLE_NODES = largest
    gap = made(n)
    forget_peak()
    before, start = resident("VmRSS"), time.process_time()
    value, iterations, residual = solve(gap)
    seconds = time.process_time() - start
    memory = resident("VmHWM") - before
    return {"program": program, "n": n, "seconds": seconds, "bytes": memory, "value": value,
            "iterations": iterations, "residual": residual}  # fmt: skip


def records(largest, path):
    """Records of all programs at all sizes that they go to."""
    found = []
    for program in PROGRAMS:
        for n in POINTS:
            if n <= min(largest, OTHERS.get(program, largest)):
                task = {"program": program, "n": n}
                compute = partial(call, __file__, ["--worker", json.dumps(task)], 1)
                found.append(kept(task, task, path, compute))
    return found


def thread_records(largest, path):
    """Records of contact and flow on threads."""
    tasks = [{"program": "threads", "shared": s, "n": n} for s in SHARED for n in THREADED if n <= largest]
    return [kept(t, t, path, partial(call, __file__, ["--worker", json.dumps(t)], 2)) for t in tasks]


def report(found, threaded):
    """Tables of all records."""
    of_points = {r["n"]: r for r in found if r["program"] == "resolved"}
    head = ["points", "program", "time [s]", "time a point [µs]", "peak memory [GB]", "bytes a point", "iterations",
            "residual", "permeability over that of all points"]  # fmt: skip
    cells = [[f"{r['n']}²", r["program"], f"{r['seconds']:.3g}", f"{1e6 * r['seconds'] / r['n'] ** 2:.2f}",
              f"{r['bytes'] / 1e9:.3g}", f"{r['bytes'] / r['n'] ** 2:.0f}", str(r["iterations"] or ""),
              "" if np.isnan(r["residual"]) else f"{r['residual']:.1e}",
              "" if r["program"] == "contact" else f"{r['value'] / of_points[r['n']]['value']:.5f}"]
             for r in found]  # fmt: skip
    columns = ["points", "program", "on one thread [s]", "on two [s]", "ratio", "same bits"]
    lines = [[f"{r['n']}²", r["shared"], f"{r['one']:.3g}", f"{r['two']:.3g}", f"{r['one'] / r['two']:.2f}", str(r["same"])]
             for r in threaded]  # fmt: skip
    tables = rows(head, cells), rows(columns, lines)
    return machine({"reynoldsflow": "reynoldsflow"}) + ".\n\n" + "\n\n".join(tables)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--largest", type=int, default=POINTS[-1])
    parser.add_argument("--records", type=Path, help="file of records, which is added to")
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        print(json.dumps(measure(**json.loads(given.worker))))
        return
    text = report(records(given.largest, given.records), thread_records(given.largest, given.records))
    print(text)
    if given.write:
        save_report(__file__, "Size of faces", text)


if __name__ == "__main__":
    main()
