"""Test whether the findings of Pérez-Ràfols et al. (2018) hold at the size of a real seal.

    python examples/real_sizes.py OUT [--realisations 3]

1. The permeabilities of single cells scatter by orders of magnitude, and some cells close during loading.
2. Plotted against the mean gap, the permeability approaches h̄³/12. Plotted against the pressure, loading and unloading
   follow different curves.
3. On unloading, the leakage stays nearly constant at first. For each hardness, seals of 1 mm to 0.1 m length and 0.5 to
   5 mm width are simulated from one surface.
4. If the leakage is small, a few constrictions carry the pressure drop, whatever the size of the surface.

The surfaces are self-affine (Hurst exponent 0.8), and their cells are squares of 50 µm. The script writes
real_sizes.csv (finding 3), real_sizes_cells.csv (findings 1, 2 and 4) and a picture into the folder OUT.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

import femseal as fs

CELL, POINTS = 50e-6, 48  # side of a cell [m], and its number of points
MODULUS, SLOPE = 115e9, 0.2
#: Nominal pressures divided by the hardness.
LOADING = (0.01, 0.03, 0.06, 0.1, 0.15, 0.2)
PEAKS = (0.1, 0.2)
UNLOADING = (0.17, 0.13, 0.1, 0.075, 0.05, 0.03, 0.015, 0.007)
#: Loads for the study of single cells, up to closing and back, divided by the hardness.
TO_CLOSING = (0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.33, 0.36, 0.39)
#: H/(E*·rms slope); sizes (x1, x2) [m] of the seals.
PLASTICITY = (0.05, 0.1, 0.3)
SIZES = ((0.5e-3, 1e-3), (0.5e-3, 1e-2), (0.5e-3, 0.1), (2e-3, 1e-2), (5e-3, 1e-2))
#: Numbers of cells along each side of the surfaces in the study of single cells.
FACES = (4, 8)


def scene(
    plasticity: float, cells: int = 4, loading=LOADING, peaks=PEAKS, unloading=UNLOADING
) -> fs.Scene:
    """Return a scene: a dry surface with a given number of cells per side, and its load cycle."""
    n, size = cells * POINTS, cells * CELL
    pixel = CELL / POINTS
    face = fs.self_affine(
        (n, n), (size, size), hurst=0.8, rms_slope=SLOPE, roll_off=25e-6, cut_off=8 * pixel, rng=1
    )
    hardness = plasticity * MODULUS * SLOPE
    return fs.Scene(
        surface=face,
        modulus=MODULUS,
        hardness=hardness,
        fluid=fs.Liquid(viscosity=1e-3, density=1000.0),
        inlet_pressure=1e7,
        outlet_pressure=0.0,
        loading=tuple(hardness * p for p in loading),
        unload_from=tuple(hardness * p for p in peaks),
        unloading=tuple(hardness * p for p in unloading),
        fluid_pressure="ignored",
    )


def doubling_share(pressure: np.ndarray, leakage: np.ndarray) -> float:
    """Return the fraction of the peak load that has been removed when the leakage has doubled; NaN if it never doubles.

    The arrays begin at the peak and continue along the unloading.

    >>> doubling_share(np.array([4.0, 2.0, 1.0]), np.array([1.0, 2.0, 8.0]))
    0.5
    """
    if not leakage[0] > 0 or not (leakage >= 2 * leakage[0]).any():
        return float("nan")
    at = np.interp(np.log(2 * leakage[0]), np.log(leakage), pressure)
    return float(1 - at / pressure[0])


def study(plasticity=PLASTICITY, sizes=SIZES, realisations=3, mapper=map):
    """Test finding 3; return a row for each hardness, size and peak."""
    rows = []
    for ratio in plasticity:
        case = scene(ratio)
        for breadth, length in sizes:
            sampling = fs.Sampling(
                length, realisations, seed=1, breadth=breadth, median_fields=False
            )
            result = fs.stochastic(case, (4, 4), sampling, mapper=mapper)
            median, spread = result.quantile(0.5), result.realisation_spread
            for peak in case.unload_from:
                top = next(
                    n
                    for n, s in enumerate(case.steps)
                    if s.unloaded_from is None and s.pressure == peak
                )
                way = [top] + [n for n, s in enumerate(case.steps) if s.unloaded_from == peak]
                pressure = np.array([case.steps[n].pressure for n in way])
                half = np.exp(np.interp(-peak / 2, -pressure, np.log(median[way])))
                rows.append({
                    "H/(E* slope)": ratio,
                    "breadth_mm": breadth * 1e3,
                    "length_mm": length * 1e3,
                    "peak/H": round(peak / case.hardness, 4),
                    "leakage_m2_per_s": float(median[top]),
                    "spread_ln": float(spread[top]),
                    "load_lost_when_doubled": doubling_share(pressure, median[way]),
                    "growth_at_half_load": float(half / median[top]),
                })  # fmt: skip
    return rows


def cells_of_faces(faces=FACES, plasticity=0.1, mapper=map) -> dict[int, fs.FaceResult]:
    """Solve the cells of surfaces of several sizes (cells per side), loaded until they close and then unloaded."""
    load = {"loading": TO_CLOSING, "peaks": TO_CLOSING[-1:], "unloading": TO_CLOSING[-2::-2]}
    return {n: fs.two_scale(scene(plasticity, n, **load), (n, n), mapper=mapper) for n in faces}


def scatter(result: fs.FaceResult, hardness: float):
    """Test findings 1, 2 and 4; return a row for each load.

    Each row contains, among others:

    - decades: number of decades between the 5 % and the 95 % quantile of k1 of the open cells;
    - closed: fraction of closed cells;
    - over_plates: median of k1 divided by h̄³/12;
    - half_of_drop: smallest number of cells that together carry half of the pressure drop.
    """
    rows = []
    for s, step in enumerate(result.steps):
        k, gap = result.k1[s].ravel(), result.cells.mean_gap[s].ravel()
        is_open = k > 0
        low, high = (
            np.quantile(np.log10(k[is_open]), (0.05, 0.95)) if is_open.any() else (np.nan, np.nan)
        )
        drop = np.sort(result.cells.drop_fraction[s].ravel())[::-1]
        rows.append({
            "cells": k.size,
            "branch": step.branch,
            "load/H": round(step.pressure / hardness, 4),
            "leakage_over_first": float(result.leakage[s] / result.leakage[0]),
            "decades": float(high - low),
            "closed": float(1 - is_open.mean()),
            "over_plates": float(np.median(k[is_open] / (gap[is_open] ** 3 / 12))) if is_open.any() else np.nan,
            "half_of_drop": int(np.searchsorted(drop.cumsum(), 0.5) + 1) if result.leakage[s] > 0 else 0,
        })  # fmt: skip
    return rows


def draw(rows, faces, path):
    """Draw the permeability and pressure drop of the cells, and below them the growth of leakage on unloading."""
    with fs.plots.style.style():
        _draw(rows, faces).savefig(path, dpi=fs.plots.style.DPI)


def _draw(rows, faces):
    from matplotlib.figure import Figure

    ratios = sorted({r["H/(E* slope)"] for r in rows})
    # two columns of a journal
    figure = Figure(figsize=(2 * fs.plots.style.PAGE, 7.2), layout="constrained")
    axes = figure.subplots(3, 2).ravel()
    for ax, letter in zip(axes, "abcdef", strict=True):
        ax.set_title(f"({letter})", loc="left", fontweight="bold")
    _draw_cells(axes[:3], faces)
    peaks, shades = (
        sorted({r["peak/H"] for r in rows}),
        ("#E69F00", "#00467F", "#009E73", "#666666"),
    )
    for ax, ratio in zip(axes[3:], ratios, strict=False):
        chosen = [r for r in rows if r["H/(E* slope)"] == ratio]
        for peak, colour in zip(peaks, shades, strict=False):
            for breadth, marker in zip(
                sorted({r["breadth_mm"] for r in chosen}), "osD^", strict=False
            ):
                some = [r for r in chosen if r["breadth_mm"] == breadth and r["peak/H"] == peak]
                some.sort(key=lambda r: r["length_mm"])
                ax.plot([r["length_mm"] for r in some], [r["growth_at_half_load"] for r in some], marker=marker,
                        ms=4, mfc="none", color=colour, label=f"peak {peak:g} H, {breadth:g} mm wide")  # fmt: skip
        ax.set(
            xscale="log",
            xlabel="length of the seal [mm]",
            title=f"unloading, H/(E* h′) = {ratio:g}",
            ylim=(1, None),
        )
        ax.grid()
        ax.set_ylabel("leakage at half of the peak\nload / leakage at the peak")
    for ax in axes[3 + len(ratios) :]:
        ax.axis("off")
    handles, names = axes[3].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    return figure


def _draw_cells(axes, faces):
    largest = faces[max(faces)]
    loading = largest.steps.on_loading
    for chosen, name, marker, colour in (
        (loading, "loading", "o", "#E69F00"),
        (~loading, "unloading", "x", "#00467F"),
    ):
        k, gap = largest.k1[chosen].ravel(), largest.cells.mean_gap[chosen].ravel()
        pressure = np.broadcast_to(
            largest.steps.pressures[chosen, None, None], largest.k1[chosen].shape
        ).ravel()
        shown = k > 0
        style = {
            "ls": "",
            "marker": marker,
            "ms": 3,
            "mfc": "none",
            "mew": 0.7,
            "color": colour,
            "label": name,
        }
        axes[0].plot(pressure[shown] / 1e6, k[shown], **style)
        axes[1].plot(gap[shown] * 1e6, k[shown], **style)
    gap = largest.cells.mean_gap[largest.cells.mean_gap > 0]
    plates = np.geomspace(gap.min(), gap.max(), 30)
    axes[1].plot(plates * 1e6, plates**3 / 12, "k-", lw=1, label="h̄³/12")
    floor = 1e-9 * np.nanmax(largest.k1)
    axes[0].set(
        yscale="log",
        xlabel="nominal pressure [MPa]",
        ylabel="permeability of cells [m³]",
        title="cells",
    )
    axes[1].set(yscale="log", xscale="log", xlabel="mean gap of the cell [µm]", title="cells")
    axes[1].xaxis.set_minor_formatter("")
    for ax in axes[:2]:
        ax.set_ylim(floor, None)
        ax.legend()
    for (n, result), marker in zip(faces.items(), "os^", strict=False):
        records = [r for r in scatter(result, 1.0) if r["half_of_drop"]]
        axes[2].plot([r["leakage_over_first"] for r in records], [r["half_of_drop"] for r in records], ls="", ms=4,
                     marker=marker, label=f"{n * n} cells")  # fmt: skip
    axes[2].set(xscale="log", yscale="log", xlabel="leakage divided by that at the first load",
                ylabel="cells that carry half\nof the pressure drop", title="constrictions")  # fmt: skip
    axes[2].invert_xaxis()
    axes[2].legend()


def write(rows, path):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--realisations", type=int, default=3)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    faces = cells_of_faces()
    hardness = scene(0.1).hardness
    write(
        [row for face in faces.values() for row in scatter(face, hardness)],
        options.out / "real_sizes_cells.csv",
    )
    rows = study(realisations=options.realisations)
    write(rows, options.out / "real_sizes.csv")
    draw(rows, faces, options.out / "real_sizes.png")


if __name__ == "__main__":
    main()
