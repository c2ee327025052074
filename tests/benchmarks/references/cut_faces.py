"""Permeability of self-affine faces cut off at a height, against a public collection of such results.

Faces have a power-law spectrum between two wave numbers, k1 (in waves on a side) and 64 k1, Hurst exponent .8, and are
cut so that 30 % is in contact; K is without the 1/12, over the variance of the heights to the power 3/2. Between
reservoirs the pressure is constant along inlet and outlet; periodic is the tensor of the cell.
"""

from __future__ import annotations

import numpy as np

from femseal.flow import cell_permeability, permeability_tensor

#: Mean and scatter of ten faces by k1: reservoirs, periodic (results of the public repository of reynoldsflow).
CLAIMED = {8: ((0.0833, 0.0110), (0.0688, 0.0073)), 16: ((0.0705, 0.0053), (0.0623, 0.0049))}
CLOSED = 0.3


def face(n, k1, k2, seed):
    """Heights (n, n) of unit variance with a power law between two wave numbers."""
    wave = np.hypot(*np.meshgrid(*[np.fft.fftfreq(n) * n] * 2, indexing="ij"))
    amplitude = np.where((wave >= k1) & (wave <= k2), np.maximum(wave, 1) ** -1.8, 0.0)
    z = np.fft.ifft2(np.fft.fft2(np.random.default_rng(seed).standard_normal((n, n))) * amplitude).real
    return z / z.std()


def cut_faces(cases=((8, 1024, 10), (16, 2048, 4)), ratio=64):
    """Permeabilities of faces, by k1, points a side and number of faces."""
    found = []
    for k1, n, count in cases:
        values = []
        for seed in range(count):
            z = face(n, k1, ratio * k1, seed)
            gap = np.maximum(z - np.quantile(z, CLOSED), 0.0)
            reservoirs = cell_permeability(gap, (1 / n, 1 / n), sides="periodic").value
            values.append((12 * reservoirs, 12 * permeability_tensor(gap, (1 / n, 1 / n))[0, 0]))
        found.append({"k1": k1, "points": n, "values": np.array(values)})
    return found


def line(found):
    """Line of the table."""
    texts = []
    for one in found:
        mean, scatter = one["values"].mean(axis=0), one["values"].std(axis=0, ddof=1)
        theirs = " and ".join(f"{m:.4f} ± {s:.4f}" for m, s in CLAIMED[one["k1"]])
        ours = " and ".join(f"{m:.4f} ± {s:.4f}" for m, s in zip(mean, scatter, strict=True))
        texts.append(
            f"{one['k1']} longest waves a side, {len(one['values'])} faces of {one['points']}²: {ours} (theirs {theirs})"
        )
    return ["self-affine faces cut off at 30 % contact: K/m₀^1.5 between reservoirs, and periodic",
            "public repository of reynoldsflow, ten faces each", "; ".join(texts)]  # fmt: skip
