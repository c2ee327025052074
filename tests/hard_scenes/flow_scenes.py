"""Hard scenes of the flow through a cell: closing, contrast, grooves, single channels, units."""

from __future__ import annotations

from functools import partial
from math import pi
from typing import Any

import numpy as np
from hard_scene import HardScene
from judges import Between, Exactly, Falling, Near, ZeroAndPositive, at_most

from femseal.analytic import (
    large_gap,
    parallel_plates,
    stripes_across,
    stripes_along,
    wavy_gap_across,
    wavy_gap_along,
)
from femseal.flow import cell_permeability, permeability_tensor
from femseal.topography import self_affine

D, H = 1e-6, 1e-6
PLATES = float(parallel_plates(H))

scene = partial(HardScene, stage="flow")


def _k(gap: np.ndarray, spacing: tuple[float, float] = (D, D), **given: Any) -> float:
    return cell_permeability(gap, spacing, **given).value


def _heights(n: int = 96, rng: int = 1) -> np.ndarray:
    z = self_affine(
        (n, n), (n * D, n * D), hurst=0.8, rms_slope=0.1, roll_off=n * D / 3, cut_off=8 * D, rng=rng
    )
    return z.heights / z.rms_height


def _cut(share: float, n: int = 96, rng: int = 1) -> np.ndarray:
    """A rough face cut by a plane, with a share in contact."""
    z = _heights(n, rng)
    return H * np.maximum(np.quantile(z, 1 - share) - z, 0)


def _saddle() -> tuple[float, float]:
    """A pass between two hills, the water a hair below and above it."""
    n = 65
    x = (np.arange(n) - n // 2) / n
    pass_ = (x[:, None] ** 2 - 4 * x**2) * -H  # rises to the sides, falls to the ends
    wall = np.where(np.abs(x) > 0.3, 1.0, 0.0) * H
    height = pass_ + wall
    return _k(np.maximum(-1e-12 * H - height, 0)), _k(np.maximum(1e-12 * H - height, 0))


def _closing() -> list[float]:
    """Permeability of a rough face, its plane on both sides of the height at which it closes, to 12 digits."""
    z = _heights()
    low, high = float(z.min()), float(z.max())
    for _ in range(45):
        middle = (low + high) / 2
        is_open = cell_permeability(np.maximum(middle - z, 0), (D, D)).percolates
        low, high = (low, middle) if is_open else (middle, high)
    return [_k(H * np.maximum(level - z, 0)) for level in (low, high)]


def _neck() -> np.ndarray:
    """A wall with one channel, a pixel wide, that has a long neck of a thousandth of the gap."""
    gap = np.full((64, 48), H)
    gap[10:50] = 0
    gap[10:50, 17] = H
    gap[20:40, 17] = 1e-3 * H
    return gap


def _contrast_across() -> float:
    gap = np.full((512, 4), H)
    gap[256:] = 1e-5 * H
    return cell_permeability(gap, (D, D), bounds=True).lower


def _contrast_along() -> float:
    gap = np.full((4, 512), H)
    gap[:, 256:] = 1e-5 * H
    return _k(gap)


def _against_pyamg(gap: np.ndarray, spacing: tuple[float, float] = (D, D)) -> tuple[float, float]:
    """Relative difference of the solver chosen, and of elimination, from pyamg."""
    other = _k(gap, spacing, solver="amg")
    return abs(_k(gap, spacing) / other - 1), abs(
        _k(gap, spacing, solver="elimination") / other - 1
    )


def _ridges(amplitude: float, n: int = 512) -> np.ndarray:
    return H * (1 + amplitude * np.cos(2 * pi * (np.arange(n) + 0.5) / n))


def _turned_ridges() -> np.ndarray:
    x = 2 * pi * np.arange(256) / 256
    tensor = permeability_tensor(H * (1 + 0.6 * np.cos(x[:, None] + x)), (D, D))
    return np.linalg.eigvalsh(tensor)


def _units(scale: float, pixel: float) -> float:
    gap = _cut(0.3, 48)
    return _k(scale * gap, (pixel * D, pixel * D)) / scale**3 / _k(gap) - 1


def _islands() -> float:
    n, radius = 256, 32
    x = np.arange(n) - (n - 1) / 2
    disc = x[:, None] ** 2 + x**2 < radius**2
    share = disc.mean()
    return _k(np.where(disc, 0.0, H), sides="periodic") / PLATES / ((1 - share) / (1 + share))


def _levels() -> list[float]:
    z = _heights()
    return [_k(H * np.maximum(level - z, 0)) for level in (2.0, 1.0, 0.5, 0.0, -0.5, -3.5)]


def _spiked() -> float:
    """A spike of contact in every 100th pixel, at random."""
    gap = np.where(np.random.default_rng(6).random((128, 128)) < 0.01, 0.0, H)
    return _k(gap) / PLATES


def _one_channel_in(columns: int) -> np.ndarray:
    gap = np.zeros((64, columns))
    gap[:, columns // 3] = H
    return gap


def _lone_row() -> float:
    return cell_permeability(np.array([[1.0], [0.5], [2.0]]) * H, (D, D), bounds=True).lower


SCENES: tuple[HardScene, ...] = (
    scene(
        "both sides of a pass",
        what="a saddle between two hills, filled to 1e-12 of its depth below the pass and above it [m³]",
        must=ZeroAndPositive("closed and open"),
        run=_saddle,
    ),
    scene(
        "both sides of closing",
        what="a rough face, the last two planes of a bisection of its closing to 12 digits [m³]",
        must=ZeroAndPositive("closed and open"),
        run=_closing,
    ),
    scene(
        "one critical constriction",
        what="a wall with one channel, whose neck has a thousandth of the gap: permeability [m³]",
        must=Near(
            PLATES * 1e-9 * 64 / 20 / 48, 1e-3, "the neck in series with what is next to nothing"
        ),
        run=lambda: cell_permeability(_neck(), (D, D), bounds=True).lower,
    ),
    scene(
        "contrast 1e15 in series",
        what="half of the gap 1e-5 of the other, across the flow [m³]",
        must=Near(
            stripes_across((PLATES, 1e-15 * PLATES)),
            1e-5,
            "harmonic mean; rounding grows with the contrast",
        ),
        run=_contrast_across,
    ),
    scene(
        "contrast 1e15 in a smooth gap",
        what="sinusoidal ridges that leave 1e-5 of the widest gap, on 32768 × 1 pixels [m³]",
        must=Near(wavy_gap_across(H, 1 - 2e-5), 0.01, "harmonic mean of h³"),
        run=lambda: _k(_ridges(1 - 2e-5, 2**15)[:, None]),
    ),
    scene(
        "contrast 1e15 in parallel",
        what="the same along the flow [m³]",
        must=Near(stripes_along((PLATES, 1e-15 * PLATES)), 1e-6, "arithmetic mean"),
        run=_contrast_along,
    ),
    scene(
        "contrast 1e15 at random",
        what="log-normal gap of contrast 1e15 and more: the solver chosen and elimination against pyamg",
        must=at_most(1e-6, "the tolerance"),
        run=lambda: _against_pyamg(H * np.exp(2.2 * _heights())),
    ),
    scene(
        "grooves at 45°",
        what="ridges of 0.6 of the gap at 45°: principal permeabilities [m³]",
        must=Near(
            (wavy_gap_across(H, 0.6), wavy_gap_along(H, 0.6)), 1e-3, "those across and along"
        ),
        run=_turned_ridges,
    ),
    scene(
        "large gap",
        what="an isotropic face of rms height h/20: permeability over that of the mean gap",
        must=Near(float(large_gap(1.0, 0.05)) * 12, 1e-3, "Elrod"),
        run=lambda: np.trace(permeability_tensor(H * (1 + 0.05 * _heights()), (D, D))) / 2 / PLATES,
    ),
    scene(
        "one round island",
        what="a disc of contact in a periodic cell: permeability over Maxwell's (1 − f)/(1 + f)",
        must=Near(1.0, 0.01, "islands far apart"),
        run=_islands,
    ),
    scene(
        "spikes everywhere",
        what="1 % of the pixels are spikes of contact: permeability over that of the plates",
        must=Between(0.9, 0.99 / 1.01, "the bound of Hashin & Shtrikman above"),
        run=_spiked,
    ),
    scene(
        "99.9 % in contact, islands of gap",
        what="a rough face of which 0.1 % is left open [m³]",
        must=Exactly(0.0, "far beyond the threshold"),
        run=lambda: _k(_cut(0.999)),
    ),
    scene(
        "99.9 % in contact, one channel",
        what="64 × 1000 pixels, one column open [m³]",
        must=Near(PLATES / 1000, 1e-9, "a channel in parallel with contact"),
        run=lambda: _k(_one_channel_in(1000)),
    ),
    scene(
        "prime numbers of pixels in a cell",
        what="97 × 89 pixels, two fifths in contact: the solver chosen and elimination against pyamg",
        must=at_most(1e-6, "the tolerance"),
        run=lambda: _against_pyamg(_cut(0.4, 97)[:, :89]),
    ),
    scene(
        "gap of integers",
        what="gaps of 0, 1 and 2: the solver chosen and elimination against pyamg",
        must=at_most(1e-6, "the tolerance"),
        run=lambda: _against_pyamg(
            H * np.random.default_rng(3).choice(3, (64, 64), p=(0.2, 0.4, 0.4))
        ),
    ),
    scene(
        "needles of 1 : 1000",
        what="oblong pixels on a rough gap: the solver chosen and elimination against pyamg",
        must=at_most(1e-6, "the tolerance"),
        run=lambda: _against_pyamg(_cut(0.2), (D, 1000 * D)),
    ),
    scene(
        "one column of three pixels",
        what="3 × 1 pixels: permeability [m³]",
        must=Near(stripes_across(parallel_plates([H, 0.5 * H, 2 * H])), 1e-9, "harmonic mean"),
        run=_lone_row,
    ),
    scene(
        "gaps in 1e-36 m and 1e36 m",
        what="gap 2⁻¹⁰⁰ and 2¹⁰⁰ times as large, pixels 2³⁰⁰ and 2⁻³⁰⁰ times: relative change",
        must=Exactly((0.0, 0.0), "the cube of the unit"),
        run=lambda: (_units(2.0**-100, 2.0**300), _units(2.0**100, 2.0**-300)),
    ),
    scene(
        "planes from far above to far below",
        what="a rough face cut by lower and lower planes, the last one below all of it [m³]",
        must=Falling("less gap, no more flow; 0 at the end", steeply=False),
        run=_levels,
    ),
)
