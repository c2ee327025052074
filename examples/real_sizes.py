"""Does the plateau on unloading persist at the size of a real seal? Leakage against size, unloading and hardness.

    python examples/real_sizes.py OUT [--realisations 6] [--windows 96]

Seals of 50 µm windows drawn from one library for each hardness: self-affine roughness (Hurst 0.8), every window under
the nominal pressure. The table says, for each size and peak, the leakage per length at the peak, its scatter between
seals, and which share of the load may be lost before leakage doubles. OUT gets real_sizes.csv and a picture.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

import femseal as fs
from femseal.studies import Sampling, Scene

PIXEL, WINDOW = 50e-6 / 48, 48
MODULUS, SLOPE = 115e9, 0.2
#: Nominal pressures in shares of the hardness.
LOADING = (0.01, 0.03, 0.06, 0.1, 0.15, 0.2)
PEAKS = (0.06, 0.1, 0.15, 0.2)
UNLOADING = (0.17, 0.13, 0.1, 0.075, 0.05, 0.03, 0.015, 0.007)
#: H/(E*·rms slope), and sizes (x1, x2) [m] of the seals.
PLASTICITY = (0.05, 0.1, 0.3)
SIZES = (
    (0.5e-3, 1e-3),
    (0.5e-3, 1e-2),
    (0.5e-3, 0.1),
    (0.5e-3, 1.0),
    (2e-3, 1e-2),
    (2e-3, 0.1),
    (5e-3, 0.1),
    (20e-3, 1e-2),
)


def scene(plasticity: float) -> Scene:
    """A face of 4 × 4 windows and its cycle."""
    size = (4 * WINDOW * PIXEL, 4 * WINDOW * PIXEL)
    face = fs.self_affine(
        (4 * WINDOW, 4 * WINDOW), size, hurst=0.8, rms_slope=SLOPE, roll_off=25e-6, cut_off=8 * PIXEL, rng=1
    )
    hardness = plasticity * MODULUS * SLOPE
    return Scene(
        surface=face,
        modulus=MODULUS,
        hardness=hardness,
        fluid=fs.Liquid(viscosity=1e-3, density=1000.0),
        inlet_pressure=1e7,
        outlet_pressure=0.0,
        loading=tuple(hardness * p for p in LOADING),
        unload_from=tuple(hardness * p for p in PEAKS),
        unloading=tuple(hardness * p for p in UNLOADING),
    )


def doubling_share(pressure: np.ndarray, leakage: np.ndarray) -> float:
    """Share of the peak load lost when the leakage has doubled; steps from the peak down; NaN if it never does.

    >>> doubling_share(np.array([4.0, 2.0, 1.0]), np.array([1.0, 2.0, 8.0]))
    0.5
    """
    if not leakage[0] > 0 or not (leakage >= 2 * leakage[0]).any():
        return float("nan")
    at = np.interp(np.log(2 * leakage[0]), np.log(leakage), pressure)
    return float(1 - at / pressure[0])


def study(plasticity=PLASTICITY, sizes=SIZES, realisations=6, windows=96, mapper=map):
    """Rows of the table, one for each hardness, size and peak."""
    rows = []
    for ratio in plasticity:
        base = Sampling(sizes[0][1], realisations, windows, seed=1, pressure="uniform", breadth=sizes[0][0])
        case = scene(ratio)
        for breadth, length in sizes:
            result = fs.stochastic(case, (4, 4), replace(base, breadth=breadth, length=length), mapper=mapper)
            median = result.quantile(0.5)
            for peak in sorted({s.unloaded_from for s in case.steps} - {None}):
                top = next(n for n, s in enumerate(case.steps) if s.unloaded_from is None and s.pressure == peak)
                way = [top] + [n for n, s in enumerate(case.steps) if s.unloaded_from == peak]
                rows.append({
                    "H/(E* slope)": ratio,
                    "breadth_mm": breadth * 1e3,
                    "length_mm": length * 1e3,
                    "peak/H": round(peak / case.hardness, 4),
                    "leakage_m2_per_s": float(median[top]),
                    "spread_ln": float(result.realisation_spread[top]),
                    "library_error_ln": float(result.library_error[top]),
                    "load_lost_when_doubled": doubling_share(
                        np.array([case.steps[n].pressure for n in way]), median[way]
                    ),
                    "growth_at_half_load": float(np.exp(np.interp(
                        -peak / 2, [-case.steps[n].pressure for n in way], np.log(np.maximum(median[way], 1e-300))
                    )) / median[top]) if median[top] > 0 else float("nan"),
                })  # fmt: skip
    return rows


def draw(rows, path):
    """Share of load that may be lost against length, a panel for each hardness."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    ratios = sorted({r["H/(E* slope)"] for r in rows})
    figure, axes = plt.subplots(1, len(ratios), figsize=(3.4 * len(ratios), 3.8), sharey=True, layout="constrained")
    for ax, ratio in zip(np.atleast_1d(axes), ratios, strict=True):
        peaks = sorted({r["peak/H"] for r in rows})
        for peak, marker in zip(peaks, "osD^v<>", strict=False):
            chosen = [r for r in rows if r["H/(E* slope)"] == ratio and r["peak/H"] == peak]
            for breadth, line in zip(sorted({r["breadth_mm"] for r in chosen}), ("-", "--", ":", "-."), strict=False):
                some = sorted((r for r in chosen if r["breadth_mm"] == breadth), key=lambda r: r["length_mm"])
                ax.plot([r["length_mm"] for r in some], [100 * r["load_lost_when_doubled"] for r in some],
                        line, marker=marker, color=plt.cm.viridis(peaks.index(peak) / len(peaks)),
                        label=f"peak {peak:g} H, {breadth:g} mm broad")  # fmt: skip
        never = (
            ""
            if any(r["load_lost_when_doubled"] > 0 for r in rows if r["H/(E* slope)"] == ratio)
            else ": never doubles"
        )
        lengths = [r["length_mm"] for r in rows]
        ax.set(xscale="log", xlabel="length of the seal [mm]", title=f"H/(E* h′) = {ratio:g}{never}", ylim=(0, 100),
               xlim=(min(lengths) / 1.5, 1.5 * max(lengths)))  # fmt: skip
        ax.grid(alpha=0.3)
    np.atleast_1d(axes)[0].set_ylabel("load lost when leakage has doubled [%]")
    handles, names = np.atleast_1d(axes)[0].get_legend_handles_labels()
    figure.legend(handles, names, fontsize=7, loc="outside lower center", ncols=4)
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--realisations", type=int, default=6)
    parser.add_argument("--windows", type=int, default=96)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = study(realisations=options.realisations, windows=options.windows)
    with (options.out / "real_sizes.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, options.out / "real_sizes.png")


if __name__ == "__main__":
    main()
