"""Permeability of a cell on equal terms: time, memory, failures, and error against a Richardson reference.

    python tests/benchmarks/flow.py --sizes 64 128 256 512 1024 2048 --write

Gaps are self-affine (Hurst 0.8, shortest wave 8 pixels, longest a quarter of the cell), cut by a plane at a given share
of contact, or those of an elastic-plastic contact; pressure drops along x1, x2 is periodic. Peers: Q1 elements with
Gauss points assembled by scikit-fem and solved by pyamg's smoothed aggregation with conjugate gradients, as a user
would write it, and reynoldsflow with its default solver and with PARDISO. One thread each, in a process of their own,
compilation before; a gap of pixels in, one number out. `--write` puts table and picture beside this file,
where the documentation takes them from.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import call, forget_peak, machine, resident, rows, save_report

HERE = Path(__file__).parent
PACKAGES = {
    "scikit-fem": "scikit-fem",
    "pyamg": "pyamg",
    "reynoldsflow": "reynoldsflow",
    "pypardiso": "pypardiso",
}
SHARES = (0.05, 0.2, 0.35, 0.42)
#: A solver is not run on sizes where the next smaller one says that it would take longer [s].
PATIENCE = 60.0
#: Size of the cell whose error is followed over refinements.
BASE = 128
ERROR_SHARES = (0.05, 0.2, 0.35)


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


def cut_gap(n, share, refinement=1, shift=0.5):
    """Gap of a cell of n pixels a side and their refinement, 1 µm rms before the cut."""
    c = waves(n)
    z = sampled(c, 4 * n, 0.0)
    level = np.quantile(z, 1 - share)
    return np.maximum(level - sampled(c, refinement * n, shift), 0.0) * 1e-6 / z.std()


def contact_gap(n):
    """Gap of a real contact with an eighth of the points touching, about."""
    from femseal import HalfSpace, solve_contact

    z = sampled(waves(n), n, 0.5)
    slope = np.sqrt(np.mean(np.diff(z, axis=0, append=z[:1]) ** 2 + np.diff(z, axis=1, append=z[:, :1]) ** 2))
    z *= 0.1e-6 / slope  # pixels of 1 µm
    return solve_contact(z, HalfSpace((n, n), (1e-6, 1e-6), 115e9), pressure=0.5e9, hardness=4e9, rtol=1e-4).gap


def femseal_solver(gap, **options):
    from femseal import cell_permeability

    k = cell_permeability(gap, (1.0, 1.0), sides="periodic", **options)
    return k.value, k.iterations


def skfem_solver(gap):
    """Q1 with the gap at nodes, those of the first row also closing the last; elements in contact left out."""
    import pyamg
    from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad, MeshQuad1DG, condense
    from skfem.helpers import dot, grad

    @BilinearForm
    def reynolds(p, q, w):
        return w.h**3 / 12 * dot(grad(p), grad(q))

    n = gap.shape[0]
    h = np.pad(gap, ((0, 1), (0, 1)), mode="wrap") / gap.max()
    flat = MeshQuad.init_tensor(np.arange(n + 1.0), np.arange(n + 1.0))
    nodal = h[flat.p[0].astype(int), flat.p[1].astype(int)]
    open_elements = np.flatnonzero((nodal[flat.t] > 0).any(axis=0))
    ring = MeshQuad1DG.periodic(
        flat, flat.nodes_satisfying(lambda x: x[1] == n), flat.nodes_satisfying(lambda x: x[1] == 0)
    )
    basis = Basis(ring, ElementQuad1(), elements=open_elements)
    coefficient = Basis(flat, ElementQuad1(), elements=open_elements).interpolate(nodal)
    matrix = reynolds.assemble(basis, h=coefficient)
    at = basis.doflocs[0]
    p = np.zeros(matrix.shape[0])
    p[at == 0] = 1.0
    held = np.unique(np.concatenate([np.flatnonzero((at == 0) | (at == n)), np.flatnonzero(matrix.diagonal() == 0)]))
    a, b, p, unknown = condense(matrix, np.zeros(matrix.shape[0]), x=p, D=held)
    residuals = []
    solver = pyamg.smoothed_aggregation_solver(a.tocsr())
    p[unknown] = solver.solve(b, tol=1e-8, accel="cg", maxiter=500, residuals=residuals)
    if residuals[-1] > 1e-8 * np.linalg.norm(b):
        raise RuntimeError("not converged")
    return float(p @ (matrix @ p)) * gap.max() ** 3, len(residuals) - 1


def reynoldsflow_solver(gap, solver="auto"):
    from reynoldsflow.transport import compute_total_flux, solve_fluid_problem

    top = gap.max()
    gaps, _, flux = solve_fluid_problem(gap / top, solver=solver)
    if flux is None:
        return 0.0, 0
    return abs(compute_total_flux(gaps, flux, gap.shape[0])[0]) * top**3 / 12, 0


def pardiso_solver(gap):
    return reynoldsflow_solver(gap, "pardiso")


SOLVERS = {
    "femseal": femseal_solver,
    "femseal, pyamg": partial(femseal_solver, solver="amg"),
    "scikit-fem + pyamg": skfem_solver,
    "reynoldsflow": reynoldsflow_solver,
    "reynoldsflow, PARDISO": pardiso_solver,
}


def measure(name, gap, repeats):
    """Record of one solver on one gap."""
    solve = SOLVERS[name]
    times, k, iterations = [], np.nan, 0
    while len(times) < repeats and (not times or sum(times) < 3.0):
        start = time.perf_counter()
        try:
            k, iterations = solve(gap)
        except Exception as error:  # any failure of a peer is a result
            return {"failure": f"{type(error).__name__}: {error}"[:100], "time": time.perf_counter() - start}
        times.append(time.perf_counter() - start)
    return {"time": float(np.median(times)), "k": k, "iterations": iterations}


def worker(task):
    """What one process does: {solver, n, repeats} → records of all gaps; with `refinements`, of the error study."""
    name, n, repeats = task["solver"], task["n"], task["repeats"]
    logging.getLogger("skfem").setLevel(logging.ERROR)
    shift = 0.0 if name == "scikit-fem + pyamg" else 0.5  # nodes or pixel centres
    measure(name, cut_gap(64, 0.2, shift=shift), 1)  # compiled
    records = []
    if "refinements" in task:
        for refinement in task["refinements"]:
            for share in ERROR_SHARES:
                gap = cut_gap(n, share, refinement, shift)
                records.append({"share": share, "refinement": refinement} | measure(name, gap, repeats))
            if max(r["time"] for r in records) > PATIENCE / 5:
                break
        return records
    gaps = {"contact": contact_gap(n)} | {share: cut_gap(n, share, shift=shift) for share in SHARES}
    for share in (*SHARES, "contact"):
        forget_peak()
        before = resident("VmRSS")
        record = measure(name, gaps[share], 1)
        memory = resident("VmHWM") - before
        if "failure" not in record and repeats > 1 and record["time"] < PATIENCE / 10:
            record = measure(name, gaps[share], repeats)
        records.append({"share": share, "memory": memory} | record)
    return records


def speed_table(records):
    others = [name for name in SOLVERS if name != "femseal"]
    head = ["n", "contact", "femseal [ms] (iterations)", *others, "memory of femseal [MB]", *others[:1]]
    cells = []
    for n in sorted({r["n"] for r in records}):
        for share in (*SHARES, "contact"):
            found = {r["solver"]: r for r in records if r["n"] == n and r["share"] == share}
            own = found["femseal"]
            iterations = own["iterations"] or "direct"
            line = [str(n), str(share), f"{1e3 * own['time']:.3g} ({iterations if own['k'] else 'closed'})"]
            for name in others:
                r = found.get(name)
                ratio = "–" if r is None else "failed" if "failure" in r else f"{r['time'] / own['time']:.3g}×"
                line.append(ratio)
            if share == SHARES[0]:
                line += [f"{found[name]['memory'] / 1e6:.0f}" if name in found else "–" for name in SOLVERS][:2]
            else:
                line += ["", ""]
            cells.append(line)
    return rows(head, cells)


def references(records):
    """Richardson's limit of the two finest solutions of femseal, whose order is two, for every share."""
    own = {(r["share"], r["refinement"]): r["k"] for r in records if r["solver"] == "femseal"}
    finest = max(refinement for _, refinement in own)
    return {s: own[s, finest] + (own[s, finest] - own[s, finest // 2]) / 3 for s in ERROR_SHARES}


def error_table(records, names):
    limit = references(records)
    head = ["contact", "pixels per shortest wave", *(f"{name}: error, time [s]" for name in names)]
    cells = []
    for share in ERROR_SHARES:
        for refinement in sorted({r["refinement"] for r in records})[:-1]:
            line = [str(share), str(8 * refinement)]
            for name in names:
                r = next(
                    (
                        r
                        for r in records
                        if r["solver"] == name and r["share"] == share and r["refinement"] == refinement
                    ),
                    None,
                )
                if r is None or "failure" in r:
                    line.append("–" if r is None else "failed")
                else:
                    line.append(f"{abs(r['k'] / limit[share] - 1):.1e}, {r['time']:.3g}")
            cells.append(line)
    return rows(head, cells)


def picture(records, names, path):
    import matplotlib.pyplot as plt

    limit = references(records)
    figure, axes = plt.subplots(1, len(ERROR_SHARES), figsize=(12, 4), sharey=True, layout="constrained")
    styles = dict(zip(names, ("C0o-", "C1s--", "C2^:", "C3v-.", "C4d--"), strict=True))
    for ax, share in zip(axes, ERROR_SHARES, strict=True):
        for name in names:
            points = [
                (r["time"], abs(r["k"] / limit[share] - 1))
                for r in records
                if r["solver"] == name
                and r["share"] == share
                and "k" in r
                and r["refinement"] < max(r["refinement"] for r in records)
            ]
            if points:
                ax.loglog(*zip(*points, strict=True), styles[name], label=name)
        ax.set(xlabel="time [s]", title=f"contact {share:g}, {BASE}² pixels and refinements")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("relative error of the permeability")
    axes[0].legend()
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 128, 256, 512, 1024])
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument(
        "--finest", type=int, default=16, help="finest refinement in the study of the error, a power of 2"
    )
    parser.add_argument("--write", action="store_true", help="write tables and picture")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(worker(json.loads(options.worker))))
        return
    records, errors = [], []
    for name in options.solvers:
        expected = 0.0
        for n in sorted(options.sizes):
            if expected > PATIENCE:
                break
            task = {"solver": name, "n": n, "repeats": options.repeats}
            new = call(__file__, ["--worker", json.dumps(task)], 1)
            expected = 5 * max(r["time"] for r in new)
            records += [{"solver": name, "n": n} | r for r in new]
            print(f"{name}, {n}² done", file=sys.stderr, flush=True)
    for name in options.solvers:
        steps = [2**k for k in range(options.finest.bit_length())]
        steps = steps if name == "femseal" else steps[:-1]
        task = {"solver": name, "n": BASE, "repeats": min(3, options.repeats), "refinements": steps}
        errors += [{"solver": name} | r for r in call(__file__, ["--worker", json.dumps(task)], 1)]
        print(f"{name}, refinements done", file=sys.stderr, flush=True)
    failures = sorted(
        {f"{r['solver']}, {r['n']}², contact {r['share']}: {r['failure']}" for r in records if "failure" in r}
    )
    text = f"""{machine(PACKAGES)}.
Times of the peers as multiples of femseal's; "–": would have taken more than {PATIENCE:g} s.

{speed_table(records)}

Failures: {"; ".join(failures) or "none"}.

Error of the permeability against Richardson's limit of refinements {options.finest // 2} and {options.finest} of femseal's scheme, a cell of {BASE}²
pixels with 8 pixels per shortest wave and its refinements:

{error_table(errors, SOLVERS)}"""
    print(text)
    if options.write:
        picture(errors, SOLVERS, HERE / "flow.png")
        save_report(__file__, "Flow solvers", f"{text}\n\n![error over time](flow.png)")


if __name__ == "__main__":
    main()
