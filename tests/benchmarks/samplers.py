"""How well samplers reproduce windows: against their own library and against windows held out of it.

    python tests/benchmarks/samplers.py --windows 300 --write

Windows of a self-affine face (Hurst 0.8, H/(E*·rms slope) = 0.14) are followed along a ladder; the samplers draw from the
first half, the second is held out. Kolmogorov–Smirnov distance, difference of the closed share, and of the rank
correlations between all loads, on loading and unloading, each the largest over the loads; links whose history is not monotone;
and leakage of maps of drawn links in shares of that of maps of the held-out windows. The last line is the held-out half
against the first: what chance alone does to numbers this small.
"""

from __future__ import annotations

import argparse

import numpy as np
from common import machine, rows, save_report

MODULUS, SLOPE, PIXEL, WINDOW = 115e9, 0.25, 1e-6, 32
LINKS, MAPS, SHAPES = 20_000, 30, ((32, 32), (100, 10))


def library_table(windows):
    """Permeabilities (cells, steps) along x1 and x2, and the steps."""
    from femseal import self_affine
    from femseal.contact import HalfSpace
    from femseal.loads import LoadProgramme
    from femseal.scales import Ladder, WindowSource, build_ladder_library
    from femseal.studies.followed import LOADING_SHARES, PEAK_SHARES, STOPS

    n = 16 * WINDOW
    face = self_affine((n, n), (n * PIXEL,) * 2, hurst=0.8, rms_slope=SLOPE, roll_off=40e-6, cut_off=8 * PIXEL, rng=1)
    hardness = 0.14 * MODULUS * SLOPE
    half_space = HalfSpace((WINDOW, WINDOW), (PIXEL, PIXEL), MODULUS, ("mirror", "mirror"))
    ladder = Ladder(
        tuple(hardness * s for s in LOADING_SHARES[:13]), tuple(hardness * s for s in PEAK_SHARES[:5]), STOPS
    )
    source = WindowSource((-face.heights,), half_space, hardness, seed=1, rtol=1e-5)
    library = build_ladder_library(source, ladder, windows)
    shares = (0.02, 0.05, 0.09, 0.14, 0.18, 0.23, 0.28, 0.33)
    steps = LoadProgramme.of(
        [hardness * s for s in shares], [hardness * 0.33], [hardness * s for s in (0.2, 0.1, 0.03)]
    )
    paths = steps.pressures[:, None]
    return [library.along(paths, np.zeros_like(paths), steps, axis)[:, 0].T for axis in (0, 1)], steps


def distance(a, b):
    """Kolmogorov–Smirnov distance of two samples."""
    both = np.sort(np.concatenate([a, b]))
    return np.abs(
        np.searchsorted(np.sort(a), both, "right") / a.size - np.searchsorted(np.sort(b), both, "right") / b.size
    ).max()


def compare(drawn, reference, steps):
    """Largest distances over the steps, and the share of links that are not monotone."""
    from scipy.stats import spearmanr

    last = range(len(steps))
    correlation = spearmanr(drawn).statistic - spearmanr(reference).statistic
    loading = [n for n in last if steps[n].unloaded_from is None]
    down = [loading[-1], *(n for n in last if steps[n].unloaded_from is not None)]
    wrong = (np.diff(drawn[:, loading], axis=1) > 0).any(axis=1) | (np.diff(drawn[:, down], axis=1) < 0).any(axis=1)
    return {
        "KS": max(distance(drawn[:, n], reference[:, n]) for n in last),
        "closed share": float(np.abs((drawn == 0).mean(axis=0) - (reference == 0).mean(axis=0)).max()),
        "rank correlation": float(np.nanmax(np.abs(correlation))),
        "not monotone": float(wrong.mean()),
    }


def leakages(draw, steps):
    """Median leakage of maps of links at every step, for each shape: draw(axis, links, map) -> (links, steps)."""
    from femseal.seal import RectangularSeal

    out = []
    for n1, n2 in SHAPES:
        seal, found = RectangularSeal((n1 * 1e-4, n2 * 1e-4), (n1, n2)), []
        for m in range(MAPS):
            k1, k2 = draw(0, n1 * n2, m), draw(1, (n1 - 1) * n2, m)
            found.append([seal.flow((k1[:, s].reshape(n1, n2), k2[:, s].reshape(n1 - 1, n2))).conductance
                          for s in range(len(steps))])  # fmt: skip
        out.append(np.median(found, axis=0))
    return out


def main():
    from femseal.scales import SAMPLERS, LinkTable, draw_links

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--windows", type=int, default=300)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    k, steps = library_table(options.windows)
    half = options.windows // 2
    first, second = [x[:half] for x in k], [x[half:] for x in k]

    def sampled(sampler):
        def draw(axis, links, m):
            table = LinkTable(first[axis].T[:, None], np.zeros((1, links), int), steps)
            one = draw_links(table, sampler=sampler, seed=1, realisation=m, axis=axis)
            return np.stack([one(s)[0] for s in range(len(steps))], axis=1)

        return draw

    def of(cells):
        rng = np.random.default_rng(0)
        return lambda axis, links, m: cells[axis][rng.integers(len(cells[axis]), size=links)]

    truth = leakages(of(second), steps)
    cells = []
    for name, draw in [(s, sampled(s)) for s in SAMPLERS if s != "block"] + [("the first half itself", None)]:
        links = first[0] if draw is None else draw(0, LINKS, 0)
        own, other = compare(links, first[0], steps), compare(links, second[0], steps)
        maps = leakages(draw or of(first), steps)
        open_ = [(m > 0) & (t > 1e-3 * t[0]) for m, t in zip(maps, truth, strict=True)]
        factors = [
            np.exp(np.sqrt(np.mean(np.log(m[o] / t[o]) ** 2))) for m, t, o in zip(maps, truth, open_, strict=True)
        ]
        pairs = [f"{own[q]:.3f} / {other[q]:.3f}" for q in ("KS", "closed share", "rank correlation")]
        cells.append([name, *pairs, f"{own['not monotone']:.3f}", *(f"{f:.3g}" for f in factors)])
    shapes = [f"leakage {a} × {b}: factor" for a, b in SHAPES]
    text = (
        f"{machine({})}; {options.windows} windows of {WINDOW}² points. Against the library / the held-out windows.\n\n"
    )
    text += rows(["sampler", "KS", "closed share", "rank correlation", "not monotone", *shapes], cells)
    print(text)
    if options.write:
        save_report(__file__, "Samplers", text)


if __name__ == "__main__":
    main()
