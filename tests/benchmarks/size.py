"""Measure time and peak memory of contact and flow for larger and larger surfaces, also with reynoldsflow.

    python tests/benchmarks/size.py --sizes 512 1024
    python tests/benchmarks/size.py --records size.jsonl --write

The contact is that of self-affine surfaces with 8 pixels per shortest wave, free along x1, at a tenth of the
hardness. The gaps of the flow are such surfaces, cut by a plane at 20 % of their points, periodic along x2.
Each size runs in a process of its own on one core. The times are CPU times. The memory is the peak memory
beyond the memory before, per point and without the gap itself. reynoldsflow takes the gap as constant on each
pixel, so that its permeability differs.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from common import main, table, timed
from peers import present, reynoldsflow

PIXEL, CONTACT = 1e-6, 0.2
#: Contact modulus and hardness [Pa].
MODULUS, HARDNESS = 115e9, 2.3e9
OWN = ("contact", "resolved")
#: Names of the programs in the report.
SHOWN = {
    "contact": "contact, femseal",
    "resolved": "flow, femseal",
    "reynoldsflow": "flow, reynoldsflow",
}


def heights(n):
    """Generate the heights (n, n) [m] of a surface."""
    from femseal import self_affine

    side = n * PIXEL
    waves = {"roll_off": side / 8, "cut_off": 8 * PIXEL}
    face = self_affine((n, n), (side, side), hurst=0.8, rms_slope=0.1, rng=1, **waves)
    return np.array(face.heights)


def gap_of(program, n):
    """Return the undeformed gap (n, n) [m] of a contact, or the gap of a surface cut by a plane."""
    z = heights(n)
    level = z.max() if program == "contact" else np.quantile(z[::4, ::4], 1 - CONTACT)
    np.subtract(level, z, out=z)
    return np.maximum(z, 0, out=z)


def solved(program, gap):
    """Solve contact or flow; return contact fraction or permeability [m³], number of iterations and residual."""
    from femseal import HalfSpace, cell_permeability, solve_contact

    if program == "contact":
        body = HalfSpace(gap.shape, (PIXEL, PIXEL), MODULUS, ("free", "periodic"))
        load = {"pressure": 0.1 * HARDNESS, "hardness": HARDNESS}
        contact = solve_contact(gap, body, rtol=1e-5, threads=1, **load)
        return contact.area_fraction, contact.iterations, contact.residual
    if program == "resolved":
        flow = cell_permeability(gap, (PIXEL, PIXEL), sides="periodic")
        return flow.value, flow.iterations, flow.residual
    return reynoldsflow(gap)[0], None, None


def measure(task):
    """Return the record of a program on a gap of n² points, measured in this process."""
    program, n = task["program"], task["n"]
    for small in (128, 768 if program == "resolved" else 1024):  # all loops are compiled by then
        if n**2 < small**2:
            break
        solved(program, gap_of(program, small))
    result, record = timed(partial(solved, program, gap_of(program, n)), 3)
    return record | dict(zip(("value", "iterations", "residual"), result or (), strict=False))


def series(sizes, repeats):
    """Yield a series of tasks for each program."""
    for program in (*OWN, *present(["reynoldsflow"])):
        yield [{"program": program, "n": n, "size": n**2} for n in sizes]


def report(records):
    """Write the table of all records."""
    head = ["points", "program", "time [s]", "time per point [µs]", "peak memory [GB]"]
    head += ["bytes per point", "iterations", "residual", "permeability / that of femseal"]
    exact = {r["n"]: r["value"] for r in records if r["program"] == "resolved"}
    cells = []
    for r in records:
        seconds, size = r["seconds"], r["size"]
        line = [f"{r['n']}²", SHOWN[r["program"]], f"{seconds:.3g}", f"{1e6 * seconds / size:.2f}"]
        line += [f"{r['bytes'] / 1e9:.3g}", f"{r['bytes'] / size:.0f}", r.get("iterations") or ""]
        line += [f"{r['residual']:.1e}" if r.get("residual") else r.get("failure", "")]
        flow = r["program"] != "contact" and "value" in r
        cells.append([*line, f"{r['value'] / exact[r['n']]:.5f}" if flow else ""])
    return table(head, cells)


if __name__ == "__main__":
    sides = (512, 1024, 2048, 4096, 8192, 16384)
    main(__file__, "Size of the surface", ("reynoldsflow",), sides, series, measure, report, 600.0)
