"""Compare solvers for the permeability of a cell: time, memory, failures, and error on finer and finer grids.

    python tests/benchmarks/flow.py --sizes 256
    python tests/benchmarks/flow.py --records flow.jsonl --write

The surfaces are self-affine with a Hurst exponent of 0.8, a shortest wave of 8 pixels and a longest wave of a
quarter of the cell. The gaps are cut by a plane at a given contact fraction, or come from an elastic-plastic
contact. The pressure falls along x1, and x2 is periodic. The other programs are scikit-fem with bilinear
elements and pyamg, and reynoldsflow with its default solver and with PARDISO. Each program runs on one thread
in a process of its own, after all functions have been compiled. The reference of the errors is the Richardson
extrapolation of femseal's two finest solutions of a cell of 128² pixels, with second order.
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
    """Return the Fourier coefficients of a self-affine surface whose shortest wave is 8 of n pixels long."""
    rng = np.random.default_rng(seed)
    most = n // 8
    k = np.arange(-most, most + 1)
    q = np.hypot(k[:, None], k[None, :])
    size = np.where(q <= 4, 1.0, (np.maximum(q, 1) / 4) ** -1.8) * ((q > 0) & (q <= most))
    c = size * (rng.standard_normal(q.shape) + 1j * rng.standard_normal(q.shape))
    return c + np.conj(c[::-1, ::-1])


def sampled(c, n, shift):
    """Sample the surface at n × n points; the first point lies `shift` spacings from the origin."""
    most = c.shape[0] // 2
    k = np.arange(-most, most + 1)
    turn = np.exp(2j * np.pi * k * shift / n)
    full = np.zeros((n, n), complex)
    full[np.ix_(k % n, k % n)] = c * turn[:, None] * turn
    return np.fft.ifft2(full).real * n * n


def cut_gap(n, fraction, refinement=1, shift=0.5):
    """Return the gap of a cell of n pixels per side, on a refined grid, cut by a plane at a contact fraction.

    The heights have an rms value of 1 µm before the cut.
    """
    c = waves(n)
    z = sampled(c, 4 * n, 0.0)
    level = np.quantile(z, 1 - fraction)
    return np.maximum(level - sampled(c, refinement * n, shift), 0.0) * 1e-6 / z.std()


def contact_gap(n):
    """Solve a contact with about an eighth of the points in contact, and return its gap [m]; the pixels are 1 µm long."""
    from femseal import HalfSpace, Topography, solve_contact

    z = sampled(waves(n), n, 0.5)
    z *= 0.1 / Topography(z, (1e-6, 1e-6)).rms_slope
    body = HalfSpace((n, n), (1e-6, 1e-6), 115e9)
    return solve_contact(z, body, pressure=0.5e9, hardness=4e9, rtol=1e-4).gap


def solved(solver, gap):
    """Return the permeability, and the number of iterations if the solver states it (otherwise 0)."""
    from femseal import cell_permeability

    if solver == "scikit-fem + pyamg":
        return PlainFlow(gap.shape)(gap), 0
    if solver.startswith("reynoldsflow"):
        return reynoldsflow(gap, "pardiso" if solver.endswith("PARDISO") else "auto")[0], 0
    how = {"solver": "amg"} if solver.endswith("pyamg") else {}
    k = cell_permeability(gap, (1.0, 1.0), sides="periodic", **how)
    return k.value, k.iterations


def measure(task):
    """Return the record of one solver on one gap."""
    solver, n, contact = task["solver"], task["n"], task["contact"]
    shift = 0.0 if solver.startswith("scikit-fem") else 0.5  # nodes or centres of pixels
    solved(solver, cut_gap(64, 0.2, shift=shift))  # compiled
    cut = contact != "solved"
    gap = cut_gap(n, contact, task["refinement"], shift) if cut else contact_gap(n)
    result, record = timed(partial(solved, solver, gap), task["repeats"])
    return record if result is None else record | {"k": result[0], "iterations": result[1]}


def series(sizes, repeats):
    """Yield a series of tasks over the sizes for each solver and contact fraction, and tasks on refined grids."""
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
    """Tabulate the times of all solvers over the sizes, and the memory of femseal."""
    head = ["n", "contact fraction", "femseal [ms] (iterations)", *list(PROGRAMS)[1:]]
    by_gap = {}
    for r in records:
        if r["refinement"] == 1:
            by_gap.setdefault((r["n"], str(r["contact"])), {})[r["solver"]] = r
    cells = []
    for (n, contact), by_solver in sorted(by_gap.items()):
        femseal_record = by_solver["femseal"]
        how = (femseal_record["iterations"] or "direct") if femseal_record["k"] else "closed"
        line = [n, contact, f"{1e3 * femseal_record['seconds']:.3g} ({how})"]
        line += [ratio(by_solver.get(name), femseal_record) for name in list(PROGRAMS)[1:]]
        cells.append([*line, f"{femseal_record['bytes'] / 1e6:.0f}"])
    return table([*head, "memory of femseal [MB]"], cells)


def error_table(records):
    """Tabulate the errors of all solvers over the refinements."""
    by_task = {(r["solver"], r["contact"], r["refinement"]): r for r in records if r["n"] == BASE}
    finest = max(r for _, _, r in by_task)
    cells = []
    for contact in FRACTIONS[:3]:
        half, fine = (by_task["femseal", contact, r]["k"] for r in (finest // 2, finest))
        limit = fine + (fine - half) / 3
        for refinement in (r for r in REFINEMENTS if r < finest):
            line = [contact, 8 * refinement]
            for solver in PROGRAMS:
                r = by_task.get((solver, contact, refinement), {})
                text = "k" in r and f"{abs(r['k'] / limit - 1):.1e}, {r['seconds']:.3g}"
                line.append(text or "–")
            cells.append(line)
    head = ["contact fraction", "pixels per shortest wave"]
    return table(head + [f"{name}: error, time [s]" for name in PROGRAMS], cells)


def report(records):
    """Write the table of times, the failures, and the table of errors."""
    return f"""The table shows CPU times. The times of the other programs are divided by the time of femseal. "–" means that a run would
have taken too long. A plane cuts off the surface, so that the given fraction of it is in contact;
"solved" means the gap of a solved contact problem.

{speed_table(records)}

{failures(records, "solver", "n", "contact")}

The next table shows the relative error of the permeability of a cell of {BASE}² pixels with 8 pixels per
shortest wave, and for finer grids on the same cell. The reference value is obtained by Richardson extrapolation from the two finest
solutions of femseal.

{error_table(records)}"""


if __name__ == "__main__":
    packages = ("scikit-fem", "pyamg", "reynoldsflow", "pypardiso")
    sizes = (64, 128, 256, 512, 1024)
    main(__file__, "Flow solvers", packages, sizes, series, measure, report)
