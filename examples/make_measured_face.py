"""Write measured_face.x3p: a ground steel face as an interference microscope would measure it.

The surface consists of grinding marks, which are slightly inclined to the seal, and of self-affine roughness.
Waves that the optics do not resolve are removed. Then the artefacts of a measurement are added: a tilt, a
slightly cylindrical form, noise, undefined points where the surface is steep, and a few outliers. The heights
are rounded to whole nanometres.

To write the file again, run: python examples/make_measured_face.py
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import x3pio
from scipy.ndimage import binary_dilation

import femseal as fs

SEED = 11
POINTS = (300, 600)  # along x1, the leakage, and along x2, the seal
PIXEL = 1e-6
RESOLUTION = 10e-6  # shortest wavelength that the optics resolve
LAY_ANGLE = np.deg2rad(1.5)
TILT = (2e-3, -1e-3)
CURVATURE = 20.0  # along x2 [1/m]: a cylinder of radius 50 mm
NOISE = 15e-9
STEEP_SHARE, SPOTS, OUTLIERS = 0.016, 60, 40


def marks(x1: np.ndarray, x2: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the heights [m] of scratches of different depth and width, across s = x1 cos α + x2 sin α."""
    s = x1 * np.cos(LAY_ANGLE) + x2 * np.sin(LAY_ANGLE)
    z = np.zeros(np.broadcast_shapes(x1.shape, x2.shape))
    for centre in np.arange(s.min(), s.max(), 6e-6):
        width, depth = rng.uniform(3e-6, 8e-6), rng.exponential(0.7e-6)
        begin, end = np.sort(rng.uniform(-0.3, 1.3, 2)) * x2.max()
        ends = 1 / (1 + np.exp(-(x2 - begin) / 15e-6)) / (1 + np.exp((x2 - end) / 15e-6))
        z -= depth * ends * np.exp(-(((s - centre - rng.normal(0, 3e-6)) / width) ** 2))
    return z


def measured_face() -> np.ndarray:
    """Return the heights (n1, n2) [m], which are NaN at undefined points."""
    rng = np.random.default_rng(SEED)
    n1, n2 = POINTS
    x1, x2 = ((np.arange(n1) + 0.5) * PIXEL)[:, None], ((np.arange(n2) + 0.5) * PIXEL)[None, :]
    # a part of a larger periodic surface, because the field of view of a microscope is not periodic
    whole = fs.self_affine((2 * n1, 2 * n2), (2 * n1 * PIXEL, 2 * n2 * PIXEL), hurst=0.8, rms_height=0.65e-6,
                           roll_off=28e-6, cut_off=3e-6, rng=rng)  # fmt: skip
    z = whole.heights[:n1, :n2] + marks(x1, x2, rng)
    z = fs.Topography(z, (PIXEL, PIXEL), (False, False)).low_pass(RESOLUTION).heights
    steep = np.hypot(*np.gradient(z, PIXEL))
    z = z + TILT[0] * x1 + TILT[1] * x2 + CURVATURE * (x2 - x2.mean()) ** 2 / 2
    z += rng.normal(0, NOISE, POINTS)
    lost = steep > np.quantile(steep, 1 - STEEP_SHARE)
    lost.flat[rng.integers(0, lost.size, SPOTS)] = True
    lost = binary_dilation(lost) & (rng.random(POINTS) < 0.6)
    z[lost] = np.nan
    rims = np.flatnonzero(binary_dilation(lost) & ~lost)
    z.flat[rng.choice(rims, OUTLIERS, replace=False)] += rng.normal(0, 0.8e-6, OUTLIERS)
    return np.round(z / 1e-9) * 1e-9


if __name__ == "__main__":
    path = Path(__file__).with_name("measured_face.x3p")
    record = x3pio.Metadata.for_software(
        "femseal example", "1", date=datetime(2024, 1, 1, tzinfo=UTC)
    )
    # the rows of the file format run along its y axis, which is x2
    x3pio.write(path, measured_face().T, x_scale=PIXEL, y_scale=PIXEL, z_scale=1e-9, z_type=x3pio.DataType.INT16,
                metadata=record)  # fmt: skip
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
