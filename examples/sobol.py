"""Which input matters most for the leakage
=========================================

This script computes Sobol indices for ranges of three inputs. The first-order index of an input is the
fraction of the variance of ln(leakage) that this input explains alone. The total index also includes the interactions
of the input with the other inputs.
If you have a case file, ``femseal.preparation.prepare(fs.load_case("seal.toml")).scene`` makes a scene from it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import loguniform, sobol_indices

import femseal as fs

RANGES = {"hardness [Pa]": (2e9, 4e9), "roughness": (0.8, 1.25), "viscosity [Pa·s]": (1e-3, 2e-3)}
FACE = fs.self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.2, roll_off=24e-6, rng=1)
SCENE = fs.Scene(
    FACE, 115e9, 3e9, fs.Liquid(1e-3), inlet_pressure=1e6, outlet_pressure=0.0, loading=(100e6,)
)


def log_leakage(values: np.ndarray) -> np.ndarray:
    """Compute ln(leakage [m²/s]) of n scenes.

    The array `values` has the shape (3, n). Its rows are the hardness [Pa], a factor by which the heights are
    multiplied, and the viscosity [Pa·s].
    """
    leakages = []
    for hardness, roughness, viscosity in values.T:
        face = fs.Topography(roughness * FACE.heights, FACE.spacing)
        scene = replace(SCENE, surface=face, hardness=hardness, fluid=fs.Liquid(viscosity))
        leakages.append(fs.deterministic(scene).leakage[0])
    return np.log(leakages)


def indices(count: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Compute the first-order and the total index of each of the three inputs from 5 × `count` scenes.

    The argument `count` must be a power of 2.
    """
    result = sobol_indices(
        func=log_leakage, n=count, dists=[loguniform(*ends) for ends in RANGES.values()], rng=1
    )
    return result.first_order, result.total_order


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    first_order, total_order = indices()
    for name, first, total in zip(RANGES, first_order, total_order, strict=True):
        print(f"{name:18} alone {first:.2f}, in total {total:.2f}")

    figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
    rows = np.arange(len(RANGES))
    axes.barh(rows + 0.2, first_order, height=0.4, color="#0072B2", label="alone")
    axes.barh(rows - 0.2, total_order, height=0.4, color="#E69F00", label="with interactions")
    axes.set_yticks(rows, list(RANGES))
    axes.set_xlabel("fraction of the variance of ln(leakage)")
    axes.legend()
    plt.show()
