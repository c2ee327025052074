"""Hard scenes of the flow through a cell: closing, contrast, grooves, single channels, units."""

from functools import partial
from math import pi

import numpy as np
from hard_scene import HardScene
from judges import between, exactly, near, zero_and_positive

from femseal.analytic import (
    large_gap,
    parallel_plates,
    wavy_gap_across,
    wavy_gap_along,
)
from femseal.flow import cell_permeability, permeability_tensor
from femseal.topography import self_affine

D, H = 1e-6, 1e-6
PLATES = float(parallel_plates(H))

scene = partial(HardScene, "flow")


def _k(gap, spacing=(D, D), **given):
    return cell_permeability(gap, spacing, **given).value


def _heights(n=96, rng=1):
    z = self_affine(
        (n, n), (n * D, n * D), hurst=0.8, rms_slope=0.1, roll_off=n * D / 3, cut_off=8 * D, rng=rng
    )
    return z.heights / z.rms_height


def _cut(share, n=96, rng=1):
    """A rough face cut by a plane, with a share in contact."""
    z = _heights(n, rng)
    return H * np.maximum(np.quantile(z, 1 - share) - z, 0)


def _closing():
    """Permeability of a rough face, its plane on both sides of the height at which it closes, to 12 digits."""
    z = _heights()
    low, high = float(z.min()), float(z.max())
    for _ in range(45):
        middle = (low + high) / 2
        is_open = cell_permeability(np.maximum(middle - z, 0), (D, D)).percolates
        low, high = (low, middle) if is_open else (middle, high)
    return [_k(H * np.maximum(level - z, 0)) for level in (low, high)]


def _ridges(amplitude, n=512):
    return H * (1 + amplitude * np.cos(2 * pi * (np.arange(n) + 0.5) / n))


def _turned_ridges():
    x = 2 * pi * np.arange(256) / 256
    tensor = permeability_tensor(H * (1 + 0.6 * np.cos(x[:, None] + x)), (D, D))
    return np.linalg.eigvalsh(tensor)


def _units(scale, pixel):
    gap = _cut(0.3, 48)
    return _k(scale * gap, (pixel * D, pixel * D)) / scale**3 / _k(gap) - 1


def _islands():
    n, radius = 256, 32
    x = np.arange(n) - (n - 1) / 2
    disc = x[:, None] ** 2 + x**2 < radius**2
    share = disc.mean()
    return _k(np.where(disc, 0.0, H), sides="periodic") / PLATES / ((1 - share) / (1 + share))


def _spiked():
    """A spike of contact in every 100th pixel, at random."""
    gap = np.where(np.random.default_rng(6).random((128, 128)) < 0.01, 0.0, H)
    return _k(gap) / PLATES


SCENES = (
    scene(
        "both sides of closing",
        "a rough face, the last two planes of a bisection of its closing to 12 digits [m³]",
        zero_and_positive("closed and open"),
        _closing,
    ),
    scene(
        "contrast 1e15 in a smooth gap",
        "sinusoidal ridges that leave 1e-5 of the widest gap, on 32768 × 1 pixels [m³]",
        near(wavy_gap_across(H, 1 - 2e-5), 0.01, "harmonic mean of h³"),
        lambda: _k(_ridges(1 - 2e-5, 2**15)[:, None]),
    ),
    scene(
        "grooves at 45°",
        "ridges of 0.6 of the gap at 45°: principal permeabilities [m³]",
        near((wavy_gap_across(H, 0.6), wavy_gap_along(H, 0.6)), 1e-3, "those across and along"),
        _turned_ridges,
    ),
    scene(
        "large gap",
        "an isotropic face of rms height h/20: permeability over that of the mean gap",
        near(float(large_gap(1.0, 0.05)) * 12, 1e-3, "Elrod"),
        lambda: np.trace(permeability_tensor(H * (1 + 0.05 * _heights()), (D, D))) / 2 / PLATES,
    ),
    scene(
        "one round island",
        "a disc of contact in a periodic cell: permeability over Maxwell's (1 − f)/(1 + f)",
        near(1.0, 0.01, "islands far apart"),
        _islands,
    ),
    scene(
        "spikes everywhere",
        "1 % of the pixels are spikes of contact: permeability over that of the plates",
        between(0.9, 0.99 / 1.01, "the bound of Hashin & Shtrikman above"),
        _spiked,
    ),
    scene(
        "gaps in 1e-36 m and 1e36 m",
        "gap 2⁻¹⁰⁰ and 2¹⁰⁰ times as large, pixels 2³⁰⁰ and 2⁻³⁰⁰ times: relative change",
        exactly((0.0, 0.0), "the cube of the unit"),
        lambda: (_units(2.0**-100, 2.0**300), _units(2.0**100, 2.0**-300)),
    ),
)
