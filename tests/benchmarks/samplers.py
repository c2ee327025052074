"""How well samplers reproduce windows: against their own library and against windows held out of it.

    python tests/benchmarks/samplers.py --windows 300 --points 256 --write

Windows of a self-affine face (Hurst 0.8, H/(E*·rms slope) = 0.14) are followed along a ladder; the samplers draw from the
first half, the second is held out. Kolmogorov–Smirnov distance, difference of the closed share, and of the rank
correlations between all loads, on loading and unloading, each the largest over the loads; links whose history is not monotone;
and leakage of maps of drawn links in shares of that of maps of the held-out windows. The last line is the held-out half
against the first: what chance alone does to numbers this small.

Then seals against faces that are eight times as long as broad: each is solved as a whole, and cut into eight pieces. Seals
as long as the face are drawn from each piece alone, as if it was what had been measured. In shares of the leakage of the
long face: the mean over its pieces, the median over the faces; of the pieces themselves, solved alone and periodic along x2,
and of seals drawn from them. Behind it the standard deviation of ln(leakage) between pieces / the error of the library that
the seals tell.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from common import machine, rows, save_report

MODULUS, SLOPE, PIXEL, WINDOW = 115e9, 0.25, 1e-6, 32
LINKS, MAPS, SHAPES = 20_000, 30, ((32, 32), (100, 10))
#: Pieces of a long face, pixels of a window, and shares of the hardness at which each kind of face is loaded.
PIECES, WINDOW_PIXELS = 8, 32
LONG = {
    "milling arcs": (0.01, 0.04, 0.09, 0.15),
    "turned": (0.004, 0.02, 0.05, 0.09),
    "self-affine": (0.01, 0.04, 0.11, 0.2),
}


def library_table(windows):
    """Permeabilities (cells, steps) along x1 and x2, and the steps."""
    from femseal.library import Ladder, WindowSource, build_ladder_library
    from femseal.studies.ladder_windows import LOADING_FRACTIONS, STOPS

    from femseal import self_affine
    from femseal.contact import HalfSpace, PerfectlyPlastic
    from femseal.loads import LoadProgramme

    n = 16 * WINDOW
    face = self_affine((n, n), (n * PIXEL,) * 2, hurst=0.8, rms_slope=SLOPE, roll_off=40e-6, cut_off=8 * PIXEL, rng=1)
    hardness = 0.14 * MODULUS * SLOPE
    half_space = HalfSpace((WINDOW, WINDOW), (PIXEL, PIXEL), MODULUS, ("mirror", "mirror"))
    ladder = Ladder(
        tuple(hardness * s for s in LOADING_FRACTIONS[:13]),
        tuple(hardness * s for s in (0.02, 0.07, 0.16, 0.29, 0.46)),
        STOPS,
    )
    source = WindowSource((-face.heights,), half_space, PerfectlyPlastic(hardness), seed=1, rtol=1e-5)
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
            found.append(
                [
                    seal.flow((k1[:, s].reshape(n1, n2), k2[:, s].reshape(n1 - 1, n2))).conductance
                    for s in range(len(steps))
                ]
            )
        out.append(np.median(found, axis=0))
    return out


def long_scene(kind, n, seed):
    """A face of n × 8n pixels under load, with one unloading, whose form varies with n in proportion."""
    from femseal import Liquid, Scene, Topography, self_affine, turned

    shape = n, PIECES * n
    size = n * PIXEL, PIECES * n * PIXEL
    hardness, rough = 4e9, {"cut_off": 8 * PIXEL, "rng": seed}
    if kind == "turned":
        face = turned(
            shape,
            size,
            pitch=size[0] / 8,
            depth=5e-6 * n / 512,
            roughness=0.7e-6 * n / 512,
            roughness_roll_off=size[0] / 16,
            **rough,
        )
    elif kind == "self-affine":
        face = self_affine(shape, size, hurst=0.8, rms_slope=SLOPE, roll_off=size[0] / 4, **rough)
        hardness = 0.14 * MODULUS * SLOPE
    else:
        face = self_affine(shape, size, hurst=0.8, rms_height=0.35e-6, roll_off=size[0] / 4, **rough)
        x1, x2 = ((np.arange(count) + 0.5) * PIXEL for count in shape)
        along = x2 + np.sqrt((1.5 * size[0]) ** 2 - x1[:, None] ** 2)
        marks = 0.625e-6 * np.cos(2 * np.pi * along / (size[0] / 8))
        face = Topography(marks + face.heights, (PIXEL, PIXEL), (False, True))
    shares = LONG[kind]
    return Scene(
        surface=face,
        modulus=MODULUS,
        hardness=hardness,
        fluid=Liquid(1e-3),
        inlet_pressure=1e7,
        outlet_pressure=0.0,
        loading=tuple(hardness * s for s in shares),
        unload_from=(hardness * shares[2],),
        unloading=(hardness * shares[1] / 2,),
    )


def long_faces(n, seeds):
    """Rows of the table of long faces: one for each kind of face and step."""
    from femseal import Sampling, Topography, deterministic, stochastic

    found, cells = [], (n // WINDOW_PIXELS,) * 2
    for kind in LONG:
        routes = {name: [] for name in ("the pieces", "runs", "block")}
        errors, bounds, seconds, truths = {}, [], {}, []
        for seed in range(1, seeds + 1):
            scene = long_scene(kind, n, seed)
            truth = deterministic(scene).leakage
            truths.append(truth / truth[0])
            for first in range(0, PIECES * n, n):
                heights = np.ascontiguousarray(scene.surface.heights[:, first : first + n])
                piece = replace(scene, surface=Topography(heights, scene.surface.spacing, (False, False)))
                routes["the pieces"].append(deterministic(piece).leakage / truth)
                for name in ("runs", "block"):
                    sampling = Sampling(PIECES * n * PIXEL, 200, 1, seed=1, sampler=name)
                    begin = time.process_time()
                    seals = stochastic(piece, cells, sampling)
                    seconds.setdefault(name, []).append(time.process_time() - begin)
                    routes[name].append(seals.quantile(0.5) / truth)
                    errors.setdefault(name, []).append(seals.library_error)
                    if name == "runs":
                        ends = seals.leakage_neumann_cuts, seals.leakage_dirichlet_cuts
                        bounds.append([end.mean(axis=0) / truth for end in ends])
        low, high = np.mean(bounds, axis=0)
        for s, step in enumerate(scene.steps):
            line = [kind, step.name, f"{np.mean(truths, axis=0)[s]:.2g}"]
            for name, shares in routes.items():
                share = np.array(shares)[:, s]
                of_faces = np.median(share.reshape(seeds, PIECES).mean(axis=1))
                line.append(f"{of_faces:.3f}; {np.log(np.maximum(share, 1e-3)).std():.2f}")
                if name in errors:
                    line[-1] += f" / {np.sqrt(np.nanmean(np.array(errors[name])[:, s] ** 2)):.2f}"
            found.append([*line, f"{low[s]:.2f} … {high[s]:.2f}"])
        print(kind, {name: f"{np.median(values):.2f} s" for name, values in seconds.items()}, flush=True)
    return rows(["face", "step", "flow", "the pieces", "runs", "block", "closed … held cuts"], found)


def main():
    from femseal.library import SAMPLERS, LinkTable, draw_links

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--windows", type=int, default=300)
    parser.add_argument("--points", type=int, default=256, help="across the long faces; 0: without them")
    parser.add_argument("--seeds", type=int, default=5, help="long faces of each kind")
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
    if options.points:
        text += (
            f"\n\n{options.seeds} faces of each kind, of {options.points} × {PIECES * options.points} points, and seals of "
            "the same length drawn from each of their eight pieces.\n\n"
        )
        text += long_faces(options.points, options.seeds)
    print(text)
    if options.write:
        save_report(__file__, "Samplers", text)


if __name__ == "__main__":
    main()
