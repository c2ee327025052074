"""Permeability of a cell on equal terms: time, memory, failures, and error against refinement.

    python tests/benchmarks/flow.py --sizes 256
    python tests/benchmarks/flow.py --records flow.jsonl --write

Gaps are self-affine (Hurst 0.8, shortest wave 8 pixels, longest a quarter of the cell), cut by a
plane at a given fraction of contact, or those of an elastic-plastic contact; pressure drops along
x1, x2 is periodic. Peers: bilinear elements by scikit-fem and pyamg, and reynoldsflow with its
default solver and with PARDISO. One thread each, in a process of their own, compilation before; a
gap of pixels in, one number out. The error is that against Richardson's limit of femseal's two
finest solutions of a cell of 128² pixels, whose order is two.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from common import failures, main, ratio, table, timed
from peers import PlainFlow, present, reynoldsflow

FRACTIONS = (0.05, 0.2, 0.35, 0.42)
#: Pixels of the cell whose error is followed over its refinements.
BASE, REFINEMENTS = 128, (1, 2, 4, 8, 16)
PROGRAMS = {
    "femseal": (),
    "femseal, pyamg": ("pyamg",),
    "scikit-fem + pyamg": ("pyamg",),
    "reynoldsflow": ("reynoldsflow",),
    "reynoldsflow, PARDISO": ("reynoldsflow", "PARDISO"),
}


def waves(n, seed=1):
    """Fourier coefficients of a self-affine surface whose shortest wave has 8 of n pixels."""
    rng = np.random.default_rng(seed)
    most = n // 8
    k = np.arange(-most, most + 1)
    q = np.hypot(k[:, None], k[None, :])
    size = np.where(q <= 4, 1.0, (np.maximum(q, 1) / 4) ** -1.8) * ((q > 0) & (q <= most))
    c = size * (rng.standard_normal(q.shape) + 1j * rng.standard_normal(q.shape))
    return c + np.conj(c[::-1, ::-1])


def sampled(c, n, shift):
    """The surface at n × n points, the first at `shift` spacings from the origin."""
    most = c.shape[0] // 2
    k = np.arange(-most, most + 1)
    turn = np.exp(2j * np.pi * k * shift / n)
    full = np.zeros((n, n), complex)
    full[np.ix_(k % n, k % n)] = c * turn[:, None] * turn
    return np.fft.ifft2(full).real * n * n


def cut_gap(n, fraction, refinement=1, shift=0.5):
    """Gap of a cell of n pixels a side and their refinement, 1 µm rms before the cut."""
    c = waves(n)
    z = sampled(c, 4 * n, 0.0)
    level = np.quantile(z, 1 - fraction)
    return np.maximum(level - sampled(c, refinement * n, shift), 0.0) * 1e-6 / z.std()


def contact_gap(n):
    """Gap of a real contact with an eighth of the points touching, about; pixels of 1 µm."""
    from femseal import HalfSpace, Topography, solve_contact

    z = sampled(waves(n), n, 0.5)
    z *= 0.1 / Topography(z, (1e-6, 1e-6)).rms_slope
    body = HalfSpace((n, n), (1e-6, 1e-6), 115e9)
    return solve_contact(z, body, pressure=0.5e9, hardness=4e9, rtol=1e-4).gap


def solved(solver, gap):
    """Permeability, and iterations where they are told."""
    from femseal import cell_permeability

    if solver == "scikit-fem + pyamg":
        return PlainFlow(gap.shape)(gap), 0
    if solver.startswith("reynoldsflow"):
        return reynoldsflow(gap, "pardiso" if solver.endswith("PARDISO") else "auto")[0], 0
    how = {"solver": "amg"} if solver.endswith("pyamg") else {}
    k = cell_permeability(gap, (1.0, 1.0), sides="periodic", **how)
    return k.value, k.iterations


def measure(task):
    """Record of one solver on one gap."""
    solver, n, contact = task["solver"], task["n"], task["contact"]
    shift = 0.0 if solver.startswith("scikit-fem") else 0.5  # nodes or centres of pixels
    solved(solver, cut_gap(64, 0.2, shift=shift))  # compiled
    cut = contact != "solved"
    gap = cut_gap(n, contact, task["refinement"], shift) if cut else contact_gap(n)
    found, record = timed(partial(solved, solver, gap), task["repeats"])
    return record if found is None else record | {"k": found[0], "iterations": found[1]}


def series(sizes, repeats):
    """One series over sizes for each solver and contact, and one over refinements."""
    for solver, needs in PROGRAMS.items():
        if len(present(needs)) < len(needs):
            continue
        for contact in (*FRACTIONS, "solved"):
            task = {"solver": solver, "contact": contact, "repeats": repeats}
            yield [task | {"n": n, "refinement": 1, "size": n**2} for n in sizes]
            finest = 2 * max(sizes) // BASE  # that of femseal; others end before it
            refined = [r for r in REFINEMENTS if r < finest or (solver, r) == ("femseal", finest)]
            if contact in FRACTIONS[:3]:
                for r in refined:
                    yield [task | {"n": BASE, "refinement": r, "size": (r * BASE) ** 2}]


def speed_table(records):
    """Times of all solvers over sizes, and the memory of femseal."""
    head = ["n", "contact fraction", "femseal [ms] (iterations)", *list(PROGRAMS)[1:]]
    found = {}
    for r in records:
        if r["refinement"] == 1:
            found.setdefault((r["n"], str(r["contact"])), {})[r["solver"]] = r
    cells = []
    for (n, contact), of in sorted(found.items()):
        own = of["femseal"]
        how = (own["iterations"] or "direct") if own["k"] else "closed"
        line = [n, contact, f"{1e3 * own['seconds']:.3g} ({how})"]
        line += [ratio(of.get(name), own) for name in list(PROGRAMS)[1:]]
        cells.append([*line, f"{own['bytes'] / 1e6:.0f}"])
    return table([*head, "memory of femseal [MB]"], cells)


def error_table(records):
    """Errors of all solvers over refinements."""
    found = {(r["solver"], r["contact"], r["refinement"]): r for r in records if r["n"] == BASE}
    finest = max(r for _, _, r in found)
    cells = []
    for contact in FRACTIONS[:3]:
        half, fine = (found["femseal", contact, r]["k"] for r in (finest // 2, finest))
        limit = fine + (fine - half) / 3
        for refinement in (r for r in REFINEMENTS if r < finest):
            line = [contact, 8 * refinement]
            for solver in PROGRAMS:
                r = found.get((solver, contact, refinement), {})
                told = "k" in r and f"{abs(r['k'] / limit - 1):.1e}, {r['seconds']:.3g}"
                line.append(told or "–")
            cells.append(line)
    head = ["contact fraction", "pixels per shortest wave"]
    return table(head + [f"{name}: error, time [s]" for name in PROGRAMS], cells)


def report(records):
    """Both tables."""
    return f"""The table shows CPU times. The times of the other programs are given as multiples of the time of femseal. "–" means that a run would
have taken too long. The gaps are cut by a plane at the given contact fraction; "solved" is the gap of a solved contact.

{speed_table(records)}

{failures(records, "solver", "n", "contact")}

The next table shows the relative error of the permeability of a cell of {BASE}² pixels with 8 pixels per
shortest wave, and of its refinements. The reference is the value that Richardson extrapolation gives from the two finest
solutions of femseal.

{error_table(records)}"""


if __name__ == "__main__":
    packages = ("scikit-fem", "pyamg", "reynoldsflow", "pypardiso")
    sizes = (64, 128, 256, 512, 1024)
    main(__file__, "Flow solvers", packages, sizes, series, measure, report)
