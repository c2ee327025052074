"""Let the hardness rise with the plastic depth, from first yield to the fully plastic state of an indentation.

Under a sphere of radius R, the ratio of mean pressure and yield stress σ_y rises from 1.1 at first yield to about 3,
and is a function of E* a/(σ_y R), with the radius a of the contact (Johnson, Contact Mechanics, 1985, section 6.3; first
yield at 2.5). With a² = 2 R u, E* a/(σ_y R) is proportional to the root of the depth u. A point with the plastic depth u
is assumed to carry this pressure, with the mean radius of the summits of the surface as R.
"""

from __future__ import annotations

import numpy as np

import femseal as fs

#: Mean pressure over the yield stress at first yield, and in the fully plastic state of a sphere.
SPHERE = (1.1, 3.0)
#: E* a/(σ_y R) at first yield, and where the contact is fully plastic (Johnson 1985, section 6.3).
FIRST_STRAIN, LAST_STRAIN = 2.5, 40.0
#: Mean curvature of the summits over the rms of the Laplacian of an isotropic Gaussian surface (Nayak, J. Lubr. Technol.
#: 93, 1971, 398): (8/3) √(m₄/π) over √(8 m₄/3).
SUMMIT_CURVATURE = 8 / 3 / np.sqrt(np.pi) / np.sqrt(8 / 3)


def summit_radius(heights, spacing):
    """Return the mean radius of curvature of the summits of periodic heights (n, n)."""
    n = heights.shape[0]
    q = 2 * np.pi * np.fft.fftfreq(n, spacing)
    laplacian = np.fft.ifft2(-(q[:, None] ** 2 + q**2) * np.fft.fft2(heights)).real
    return 1 / (SUMMIT_CURVATURE * laplacian.std())


def depth_law(yield_stress, modulus, radius, ratios=SPHERE):
    """Return the hardness over depth [HardnessTable].

    The ratio of hardness to yield stress rises from the first to the second value of `ratios` with the logarithm of the
    depth, as in the model of the expanding cavity.
    """
    first, largest = ratios
    first_depth = radius / 2 * (FIRST_STRAIN * yield_stress / modulus) ** 2
    depths = first_depth * np.r_[0.0, np.geomspace(0.05, (LAST_STRAIN / FIRST_STRAIN) ** 2, 40)]
    rise = (largest - first) / np.log1p(depths[-1] / first_depth)
    return fs.HardnessTable(depths, yield_stress * (first + rise * np.log1p(depths / first_depth)))
