"""Compute the permeability of cut self-affine surfaces, for comparison with a public collection.

The surfaces have a power-law spectrum between two wave numbers, k1 (in waves per side) and 64 k1, with a Hurst
exponent of 0.8. They are cut so that 30 % of the area is in contact. K is the permeability without the factor
1/12, divided by the variance of the heights to the power 3/2. "Between reservoirs" means a constant pressure
along inlet and outlet; "periodic" is the permeability tensor of the cell.
"""

from __future__ import annotations

import numpy as np

from femseal.flow import cell_permeability, permeability_tensor

#: Mean and scatter of ten faces by k1: reservoirs, periodic (public repository of reynoldsflow).
CLAIMED = {8: ((0.0833, 0.0110), (0.0688, 0.0073)), 16: ((0.0705, 0.0053), (0.0623, 0.0049))}
CLOSED, RATIO = 0.3, 64


def heights(n, k1, seed):
    """Generate heights (n, n) of unit variance with a power-law spectrum between two wave numbers."""
    wave = np.hypot(*np.meshgrid(*[np.fft.fftfreq(n) * n] * 2, indexing="ij"))
    is_in_range = (wave >= k1) & (wave <= RATIO * k1)
    amplitude = np.where(is_in_range, np.maximum(wave, 1) ** -1.8, 0.0)
    noise = np.random.default_rng(seed).standard_normal((n, n))
    z = np.fft.ifft2(np.fft.fft2(noise) * amplitude).real
    return z / z.std()


def cut_faces(cases=((8, 1024, 10), (16, 2048, 4))):
    """Compute mean and scatter of the permeabilities (reservoirs, periodic), by k1.

    A case is (k1, points per side, number of surfaces).
    """
    records = []
    for k1, n, count in cases:
        values = []
        for seed in range(count):
            z = heights(n, k1, seed)
            gap, pixel = np.maximum(z - np.quantile(z, CLOSED), 0.0), (1 / n, 1 / n)
            between = cell_permeability(gap, pixel, sides="periodic").value
            values.append((12 * between, 12 * permeability_tensor(gap, pixel)[0, 0]))
        mean, scatter = np.mean(values, axis=0), np.std(values, axis=0, ddof=1)
        records.append({"k1": k1, "faces": count, "mean": mean, "scatter": scatter})
    return records
