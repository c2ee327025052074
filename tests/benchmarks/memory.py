"""Measure time and peak memory of generating, conditioning and contact of large surfaces.

    python tests/benchmarks/memory.py --sizes 2048 4096
    python tests/benchmarks/memory.py --records memory.jsonl --write

Each step is measured on a surface of its own, in a process of its own on one core. The surface is self-affine
with a roll-off of an eighth of its side. The generated surfaces have 8 or 2 pixels per shortest wave. The maps that
are conditioned have 8 pixels per shortest wave and white noise of 1 % of their rms height. Either they are periodic;
or they are cropped from a larger map, so that they are not periodic; or they are cropped, 0.1 % of their points are
spikes, and 0.1 % are undefined. Conditioning keeps the number of points, except in "conditioning, finer", where
it doubles the number of points per side, and the size is that of the final map. The contact is free along x1, at
a tenth of the hardness. The times are CPU times. The memory is the peak memory beyond the memory before, which
contains the map that is conditioned, or the gap.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from common import main, table, timed

PIXEL = 1e-6
#: Contact modulus and hardness [Pa].
MODULUS, HARDNESS = 115e9, 2.3e9
#: Fraction of the points that are spikes, and fraction that are undefined.
DEFECTS = 1e-3
STEPS = {
    "coarse": "generating, 8 pixels per wave",
    "fine": "generating, 2 pixels per wave",
    "periodic": "conditioning, periodic",
    "cropped": "conditioning, cropped",
    "spikes": "conditioning, cropped, spikes",
    "finer": "conditioning, finer",
    "contact": "contact",
}


def surface(n, pixels_per_wave=8):
    """Generate a surface of n² points."""
    from femseal import self_affine

    side = n * PIXEL
    waves = {"roll_off": side / 8, "cut_off": pixels_per_wave * PIXEL}
    return self_affine((n, n), (side, side), hurst=0.8, rms_slope=0.1, rng=1, **waves)


def measured_map(step, n):
    """Return the map of n² points that is conditioned."""
    from femseal import Topography

    larger = n if step in ("periodic", "finer") else n + 16
    face = surface(larger)
    rng = np.random.default_rng(2)
    heights = np.array(face.heights[:n, :n])
    sigma = face.rms_height
    for row in heights:
        row += 0.01 * sigma * rng.standard_normal(n)
    if step == "spikes":
        count = round(DEFECTS * n * n)
        heights.ravel()[rng.integers(n * n, size=count)] += 5 * sigma
        heights.ravel()[rng.integers(n * n, size=count)] = np.nan
    heights.flags.writeable = False  # a map copies an array only if it is writeable
    return Topography(heights, (PIXEL, PIXEL), periodic=larger == n)


def prepared(step, n):
    """Return a function without arguments that does the step on n² points."""
    from femseal import HalfSpace, condition, solve_contact

    if step in ("coarse", "fine"):
        return partial(surface, n, 8 if step == "coarse" else 2)
    if step == "contact":
        gap = surface(n).gap()
        body = HalfSpace(gap.shape, (PIXEL, PIXEL), MODULUS, ("free", "periodic"))
        load = {"pressure": 0.1 * HARDNESS, "hardness": HARDNESS}
        return partial(solve_contact, gap, body, rtol=1e-5, threads=1, **load)
    if step == "finer":
        return partial(condition, measured_map(step, n // 2), shape=(n, n))
    return partial(condition, measured_map(step, n), shape=(n, n))


def measure(task):
    """Return the record of a step on n² points, measured in this process."""
    prepared(task["step"], 1024)()  # all loops are compiled by then
    _, record = timed(prepared(task["step"], task["n"]))
    return record


def series(sizes, _repeats):
    """Yield a series of tasks for each step."""
    for step in STEPS:
        yield [{"step": step, "n": n, "size": n**2} for n in sizes]


def report(records):
    """Write the table of all records."""
    head = ["step", "points", "time [s]", "peak memory [GB]", "bytes per point"]
    cells = []
    for r in records:
        memory = [f"{r['bytes'] / 1e9:.3g}", f"{r['bytes'] / r['size']:.0f}"]
        cells.append([STEPS[r["step"]], f"{r['n']}²", f"{r['seconds']:.3g}", *memory])
    return table(head, cells)


if __name__ == "__main__":
    main(__file__, "Memory of a surface", (), (4096, 8192), series, measure, report, 900.0)
