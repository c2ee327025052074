"""Contact solvers on equal terms: time to reach a residual that one independent function computes.

    python tests/benchmarks/contact.py --sizes 256 512 1024 --threads 1 2 --write

Surfaces are self-affine (Hurst 0.8, roll-off an eighth of the size, shortest wave 8 pixels, rms slope 0.2), periodic,
E* = 115 GPa. Each solver runs through its own tolerances until the residual is small enough; the time of that run,
median of the repeats, is what counts; plans and compilation are made before. `--sizes 128 --patience 10` takes a minute. `--write` puts table and
picture beside this file, where the documentation takes them from.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from common import call, forget_peak, machine, resident, rows, save_report

HERE = Path(__file__).parent
PACKAGES = {"Tamaas": "tamaas", "ContactMechanics": "ContactMechanics", "pyFFTW": "pyFFTW"}
MODULUS, HARDNESS = 115e9, 4e9
SPACING = 1e-6
TARGETS = (1e-4, 1e-8)
PRESSURES = (50e6, 200e6, 1000e6)


def surface(n):
    from femseal import self_affine

    size = n * SPACING
    face = self_affine((n, n), (size, size), hurst=0.8, rms_slope=0.2, roll_off=size / 8, cut_off=8 * SPACING, rng=1)
    return face.heights - face.heights.mean()


def residual(pressure, gap0, hardness):
    """‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ with v = Kp + h₁, c = πE*/4Δ and the δ that keeps the load."""
    import numpy as np
    import scipy.fft
    from scipy.optimize import brentq

    n = gap0.shape[0]
    q = 2 * np.pi * np.hypot(scipy.fft.fftfreq(n, SPACING)[:, None], scipy.fft.rfftfreq(n, SPACING)[None])
    q[0, 0] = np.inf
    v = scipy.fft.irfft2(scipy.fft.rfft2(pressure) * 2 / (MODULUS * q), s=gap0.shape) + gap0
    c = np.pi * MODULUS / (4 * SPACING)
    load = pressure.sum()

    def moved(delta):
        return np.clip(pressure - c * (v - delta), 0, hardness)

    reach = pressure.max() / c
    delta = brentq(lambda d: moved(d).sum() - load, v.min() - reach, v.max() + 2 * reach, xtol=1e-30, rtol=1e-15)
    return float(np.linalg.norm(pressure - moved(delta)) / np.linalg.norm(pressure))


def femseal_solver(heights, hardness, threads):
    import numpy as np

    from femseal import HalfSpace, solve_contact

    body = HalfSpace(heights.shape, (SPACING, SPACING), MODULUS)
    pairs = {}

    def solve(pressure, tolerance):
        contact = solve_contact(-heights, body, pressure=pressure, hardness=hardness, rtol=tolerance, threads=threads)
        pairs[pressure, tolerance] = contact.fft_pairs
        return contact.pressure

    solve(0.1 * min(HARDNESS, np.inf), 1e-1)  # plans
    return solve, TARGETS, pairs


def tamaas_solver(heights, hardness, threads):
    """In units of the size and the modulus: in SI units the solver with a hardness does not return."""
    import numpy as np
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    tamaas.initialize(threads)
    n = heights.shape[0]
    model = tamaas.Model(tamaas.model_type.basic_2d, [1.0, 1.0], [n, n])
    model.E, model.nu = 1.0, 0.0
    scaled = np.ascontiguousarray(heights) / (n * SPACING)

    def solve(pressure, tolerance):
        model.traction[:] = pressure / MODULUS
        model.displacement[:] = 0
        if np.isinf(hardness):
            solver = tamaas.PolonskyKeerRey(model, scaled, tolerance)
        else:
            solver = tamaas.KatoSaturated(model, scaled, tolerance, hardness / MODULUS)
        solver.max_iter = 20000
        solver.solve(pressure / MODULUS)
        return np.array(model.traction) * MODULUS

    solve(200e6, 1e-1)
    return solve, [10.0**-k for k in range(3, 17)], {}


def contactmechanics_solver(heights, hardness, threads):
    import numpy as np
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Optimization.ConstrainedConjugateGradients import constrained_conjugate_gradients
    from SurfaceTopography import Topography

    n = heights.shape[0]
    sizes = (n * SPACING, n * SPACING)
    substrate = PeriodicFFTElasticHalfSpace((n, n), MODULUS, sizes)
    face = Topography(np.array(heights), sizes)
    pixel = SPACING**2
    bound = {} if np.isinf(hardness) else {"hardness": hardness * pixel}
    depth = 4 * SPACING / (np.pi * MODULUS)  # of one unit of pressure

    def solve(pressure, tolerance):
        result = constrained_conjugate_gradients(
            substrate,
            face,
            external_force=pressure * sizes[0] * sizes[1],
            pentol=tolerance * 1e9 * depth,
            maxiter=10000,
            **bound,
        )
        return np.asarray(result.jac) / pixel

    return solve, [10.0**-k for k in range(2, 12)], {}


SOLVERS = {"femseal": femseal_solver, "tamaas": tamaas_solver, "ContactMechanics": contactmechanics_solver}


def measure(n, threads, repeats, only, patience):
    """One size: records of time and residual for every solver, hardness, pressure and tolerance."""
    import numpy as np

    heights = surface(n)
    records = []
    for hardness in (np.inf, HARDNESS):
        solvers = {}
        for name in only:
            solvers[name] = SOLVERS[name](heights, hardness, threads)
        for pressure in PRESSURES:
            for name, (solve, tolerances, pairs) in solvers.items():
                start = time.perf_counter()
                previous = np.inf
                for tolerance in tolerances:
                    times, reached = [], np.inf
                    while len(times) < repeats and (not times or sum(times) < 5.0):
                        begin = time.perf_counter()
                        field = solve(pressure, tolerance)
                        times.append(time.perf_counter() - begin)
                    reached = residual(field, -heights, hardness)
                    records.append(
                        {
                            "n": n,
                            "threads": threads,
                            "solver": name,
                            "hardness": hardness,
                            "pressure": pressure,
                            "time": float(np.median(times)),
                            "residual": reached,
                            "pairs": pairs.get((pressure, tolerance)),
                        }
                    )
                    slow = time.perf_counter() - start > patience
                    stuck = reached > 0.9 * previous and reached > TARGETS[0]
                    if reached <= TARGETS[-1] or slow or (stuck and len(records) > 3 and previous < np.inf):
                        break
                    previous = reached
    return records


def peak_memory(n):
    """Peak resident memory of one solution in fields of the grid, beyond what was there before."""
    import numpy as np

    heights = surface(n)
    # compiled code takes memory too, but once; large grids use single precision too
    solve, _, _ = femseal_solver(surface(512), np.inf, 1)
    forget_peak()
    before = resident("VmRSS")
    solve, _, _ = femseal_solver(heights, np.inf, 1)
    solve(200e6, 1e-4)
    return (resident("VmHWM") - before) / heights.nbytes


def first_below(records, target):
    """Fastest record that reaches a residual."""
    good = [r for r in records if r["residual"] <= target]
    return min(good, key=lambda r: r["time"]) if good else None


def table(records):
    head = ["n", "threads", "H [GPa]", "p̄ [MPa]", "residual", "femseal [s] (FFT pairs)", "Tamaas", "ContactMechanics"]
    lines = []
    keys = sorted({(r["threads"], r["n"], r["hardness"], r["pressure"]) for r in records})
    for threads, n, hardness, pressure in keys:
        chosen = [
            r
            for r in records
            if (r["threads"], r["n"], r["hardness"], r["pressure"]) == (threads, n, hardness, pressure)
        ]
        for target in TARGETS:
            best = {name: first_below([r for r in chosen if r["solver"] == name], target) for name in SOLVERS}
            own = best["femseal"]
            if own is None:
                continue
            cells = [f"{own['time']:.3g} ({own['pairs']})"]
            for name in list(SOLVERS)[1:]:
                tried = [r for r in chosen if r["solver"] == name]
                if best[name] is not None:
                    cells.append(f"{best[name]['time'] / own['time']:.3g}×")
                else:
                    cells.append(f"not reached ({min(r['residual'] for r in tried):.0e})" if tried else "–")
            bound = "∞" if hardness == float("inf") else f"{hardness / 1e9:g}"
            lines.append([str(n), str(threads), bound, f"{pressure / 1e6:g}", f"{target:.0e}", *cells])
    return rows(head, lines)


def picture(records, path):
    import matplotlib.pyplot as plt

    n = max(r["n"] for r in records if r["solver"] == "ContactMechanics")
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
    style = {"femseal": "C0o-", "tamaas": "C1s--", "ContactMechanics": "C2^:"}
    for ax, hardness in zip(axes, (float("inf"), HARDNESS), strict=True):
        for name in SOLVERS:
            chosen = [
                r
                for r in records
                if r["solver"] == name
                and r["hardness"] == hardness
                and r["n"] == n
                and r["pressure"] == 200e6
                and r["threads"] == 1
            ]
            if chosen:
                ax.loglog([r["time"] for r in chosen], [r["residual"] for r in chosen], style[name], label=name)
        bound = "elastic" if hardness == float("inf") else f"H = {hardness / 1e9:g} GPa"
        ax.set(xlabel="time [s]", title=f"{bound}, {n}², p̄ = 200 MPa, one thread")
        ax.grid(alpha=0.3)
        ax.legend()
    axes[0].set_ylabel("residual")
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[256, 512, 1024])
    parser.add_argument("--threads", type=int, nargs="+", default=[1])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--patience",
        type=float,
        default=60.0,
        help="no solver is run on sizes or at tolerances that would take longer [s]",
    )
    parser.add_argument("--memory", type=int, default=2048, help="size for the peak memory; 0 leaves it out")
    parser.add_argument("--write", action="store_true", help="write table and picture")
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=list(SOLVERS))
    parser.add_argument("--peak", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(*options.worker, options.repeats, options.solvers, options.patience)))
        return
    if options.peak:
        print(json.dumps(peak_memory(options.peak)))
        return
    records = []
    for threads in options.threads:
        solvers = list(options.solvers)
        for n in sorted(options.sizes):
            if not solvers:
                break
            arguments = [
                "--worker",
                str(n),
                str(threads),
                "--repeats",
                str(options.repeats),
                "--patience",
                str(options.patience),
                "--solvers",
                *solvers,
            ]
            new = call(__file__, arguments, threads)
            records += new
            slowest = {name: max(r["time"] for r in new if r["solver"] == name) for name in solvers}
            solvers = [name for name in solvers if 10 * slowest[name] < options.patience]
            print(f"{n}², {threads} thread(s) done", file=sys.stderr, flush=True)
    text = f"""{machine(PACKAGES)}.
Times of the peers as multiples of femseal's; not reached: the best residual within {options.patience:g} s.

{table(records)}"""
    if options.memory:
        text += f"\n\nPeak memory of a solution at {options.memory}²: {call(__file__, ['--peak', str(options.memory)], 1):.1f} fields."
    print(text)
    if options.write:
        picture(records, HERE / "contact.png")
        save_report(__file__, "Contact solvers", f"{text}\n\n![residual over time](contact.png)")


if __name__ == "__main__":
    main()
