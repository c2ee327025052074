"""Multigrid against elimination on networks of links of many kinds, and which of them is chosen.

    python tests/benchmarks/choice.py --seed 0 --sides 24 64 128 256 --write

Times are CPU times of one thread, the lowest of several, of the whole solution of a square network. Its links are drawn
one by one, log-normal, and some of them closed; or those of a gap of waves down to so many pixels, cut by a plane or
the exponential of the waves.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from math import inf, isfinite

import numpy as np
from common import machine, rows, save_report


def noise(side, deviation, closed, rng):
    """Links that are drawn one by one."""
    from femseal.flow import Stencil

    links = [np.exp(deviation * rng.standard_normal(shape)) for shape in ((side + 1, side), (side, side - 1))]
    return Stencil.network(*(np.where(rng.random(c.shape) < closed, 0.0, c) for c in links), ring=False)


def waves(side, shortest, closed, rng, exponent=0.0):
    """Links of a gap of waves: what a plane leaves of them, or their exponential."""
    from femseal.flow.edge_flow import cell_stencil
    from femseal.flow.grid import Grid

    q = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side))
    size = np.where((q > 0) & (q <= 1 / shortest), np.maximum(q, 4 / side) ** -1.8, 0.0)
    h = np.fft.ifft2(np.fft.fft2(rng.standard_normal((side, side))) * size).real
    h = np.exp(exponent * h / h.std()) if exponent else np.maximum(h - np.quantile(h, closed), 0.0)
    return cell_stencil(h / h.max(), Grid.of_pixel_centres(h.shape, (1.0, 1.0), "mirror"))


def scenes(side: int, seed: int) -> Iterator[tuple[str, object]]:
    """Name and stencil of each network of a size."""
    for deviation in (0.3, 0.7, 1.2, 2.0, 3.0):
        for closed in (0.0, 0.2, 0.35):
            links = noise(side, deviation, closed, np.random.default_rng(seed))
            yield f"links drawn, deviation {deviation} of the logarithm, {closed:.0%} closed", links
    for shortest in (2, 4, 8):
        for closed in (0.05, 0.25, 0.4):
            links = waves(side, shortest, closed, np.random.default_rng(seed))
            yield f"waves from {shortest} pixels, {closed:.0%} in contact", links
    for exponent in (1.0, 2.5):
        links = waves(side, 4, 0.0, np.random.default_rng(seed), exponent)
        yield f"exponential of waves from 4 pixels, deviation {exponent}", links


def taken(solve: Callable[[], object], repeats: int) -> tuple[float, object]:
    """Lowest CPU time [s] and the flow; no time if the solver fails."""
    from femseal import NotConverged

    best, flow = inf, None
    for _ in range(repeats):
        start = time.process_time()
        try:
            flow = solve()
        except NotConverged:
            return inf, None
        best = min(best, time.process_time() - start)
    return best, flow


def main() -> None:
    """Time both solvers and the choice on every network."""
    from femseal.flow import solve_flow

    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sides", type=int, nargs="+", default=[24, 64, 128, 256])
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    for solver in ("multigrid", "elimination", "auto"):  # compiled before it is timed
        solve_flow(noise(16, 1.0, 0.0, np.random.default_rng(0)), solver=solver)
    cells, shares = [], []
    for side in options.sides:
        for name, links in scenes(side, options.seed):
            times, flows = {}, {}
            for solver in ("multigrid", "elimination", "auto"):
                times[solver], flows[solver] = taken(
                    lambda links=links, solver=solver: solve_flow(links, solver=solver), 9 if side < 100 else 3
                )
            if not flows["auto"].percolates:
                continue
            shares.append(times["auto"] / min(times["multigrid"], times["elimination"]))
            iterations = flows["multigrid"].iterations if flows["multigrid"] else "fails"
            numbers = [f"{1e3 * t:.3g}" if isfinite(t) else "–" for t in times.values()]
            cells.append([name, f"{side}²", str(iterations), *numbers, flows["auto"].solver, f"{shares[-1]:.2f}"])
    text = (
        f"{machine({})}; seed {options.seed}. Milliseconds; the last column is the choice in shares of the faster one: "
        f"{np.mean(shares):.3f} by the mean of {len(shares)} networks, {np.quantile(shares, 0.9):.2f} for the worst tenth, "
        f"{max(shares):.2f} at most; more than 1.3 on {sum(s > 1.3 for s in shares)}.\n\n"
    )
    head = ["network", "nodes", "iterations", "multigrid", "elimination", "choice", "chosen", "of the faster"]
    text += rows(head, cells)
    print(text)
    if options.write:
        save_report(__file__, "Choice of the solver", text)


if __name__ == "__main__":
    main()
