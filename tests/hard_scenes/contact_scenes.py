"""Hard scenes of contact: loads, hardnesses, grids and units at their ends."""

from __future__ import annotations

from functools import partial
from math import inf, pi
from typing import Any

import numpy as np
from hard_scene import HardScene
from judges import Between, Exactly, Falling, Near, at_most

from femseal.analytic import (
    wave_contact_fraction,
    wave_full_contact_pressure,
    wavy_contact_fraction_full,
    wavy_contact_fraction_light,
    wavy_full_contact_pressure,
)
from femseal.contact import (
    Contact,
    HalfSpace,
    HardnessTable,
    LinearHardening,
    NixGao,
    load_cycle,
    solve_contact,
)
from femseal.topography import self_affine

E, D, LOAD = 115e9, 1e-6, 1e8
SLOPE = 0.1

scene = partial(HardScene, stage="contact")


def _rough(n: int = 96, rng: int = 1) -> np.ndarray:
    size = (n * D, n * D)
    return -self_affine(
        (n, n), size, hurst=0.8, rms_slope=SLOPE, roll_off=n * D / 3, cut_off=8 * D, rng=rng
    ).heights


def _grid(gap0: np.ndarray, spacing: tuple[float, float] = (D, D), modulus: float = E) -> HalfSpace:
    return HalfSpace(gap0.shape, spacing, modulus)


def _solved(gap0: np.ndarray, **given: Any) -> Contact:
    return solve_contact(gap0, _grid(gap0), **{"pressure": LOAD} | given)


def _carried(
    gap0: np.ndarray, half_space: HalfSpace, pressure: float, hardness: float = inf
) -> tuple[float, float]:
    """Relative error of the load and of the signs of pressure and gap; a thousandth of that of complementarity."""
    contact = solve_contact(gap0, half_space, pressure=pressure, hardness=hardness)
    p, g = contact.pressure, contact.gap
    signs = max(abs(p.mean() / pressure - 1), -p.min() / p.max(), -g.min() / max(np.ptp(g), 1e-300))
    stiffness = pi * half_space.modulus / (4 * np.sqrt(np.prod(half_space.spacing)))
    raw = half_space.displacement(p) + gap0 - contact.approach
    fault = np.linalg.norm(p - np.clip(p - stiffness * raw, 0, hardness)) / np.linalg.norm(p)
    return float(signs), 1e-3 * float(fault)


def _wave(ratio: float) -> float:
    n = 512
    gap0 = 1e-6 * (1 - np.cos(2 * pi * (np.arange(n) + 0.5) / n))[None, :]
    full = wave_full_contact_pressure(E, 1e-6, n * D)
    return solve_contact(gap0, _grid(gap0), pressure=ratio * full).area_fraction


def _egg_box(ratio: float) -> Contact:
    n = 256
    c = np.cos(2 * pi * (np.arange(n) + 0.5) / n)
    return _solved(
        1e-6 * (1 - c[:, None] * c), pressure=ratio * wavy_full_contact_pressure(E, 1e-6, n * D)
    )


def _over_full() -> tuple[float, float]:
    contact = _egg_box(1.001)
    return contact.area_fraction, contact.mean_gap


def _soft() -> float:
    hardness = 0.01 * E * SLOPE
    contact = _solved(_rough(), pressure=0.1 * hardness, hardness=hardness)
    return contact.area_fraction


def _hard() -> float:
    gap0 = _rough()
    hard, elastic = (_solved(gap0, hardness=hardness) for hardness in (100 * E * SLOPE, inf))
    return float(np.abs(hard.pressure - elastic.pressure).max() / elastic.pressure.max())


def _hardnesses() -> list[float]:
    gap0 = _rough()
    ratios = (0.01, 0.1, 1.0, 10.0)
    return [
        _solved(gap0, pressure=0.005 * E * SLOPE, hardness=r * E * SLOPE).area_fraction
        for r in ratios
    ]


def _flat_slope() -> float:
    gap0, hardness = _rough(), 0.3 * E * SLOPE
    flat, plain = (
        _solved(gap0, pressure=0.02 * E * SLOPE, hardness=law)
        for law in (LinearHardening(hardness, 0.0), hardness)
    )
    return float(np.abs(flat.gap - plain.gap).max() + abs(flat.fft_pairs - plain.fft_pairs))


def _steep_slope() -> float:
    gap0 = _rough()
    steep, elastic = (
        _solved(gap0, hardness=law) for law in (LinearHardening(0.1 * E * SLOPE, 1e6 * E / D), inf)
    )
    return float(np.abs(steep.pressure - elastic.pressure).max() / elastic.pressure.max())


def _slopes() -> list[float]:
    gap0, hardness = _rough(), 0.1 * E * SLOPE
    laws = (LinearHardening(hardness, slope * E / D) for slope in (1e-6, 1e-3, 1e-1, 1e1, 1e6))
    return [_solved(gap0, pressure=0.02 * E * SLOPE, hardness=law).area_fraction for law in laws]


def _beyond_hardness(slope: float) -> tuple[float, float]:
    """Load and mean plastic deformation over theirs: u = (p̄ − H)/h where every point yields."""
    gap0, hardness = _rough(), 1e9
    contact = _solved(
        gap0, pressure=1e3 * hardness, hardness=LinearHardening(hardness, slope * E / D)
    )
    deep = float(contact.plastic_deformation.mean()) * slope * E / D / (999 * hardness)
    return float(contact.pressure.mean()) / (1e3 * hardness), deep


def _off_perfect(law: HardnessTable | NixGao, hardness: float) -> float:
    gap0 = _rough()
    curve, plain = (_solved(gap0, pressure=0.02 * E * SLOPE, hardness=h) for h in (law, hardness))
    return float(np.abs(curve.pressure - plain.pressure).max() / plain.pressure.max())


def _off_falling_law() -> float:
    """‖p − H(u)‖/‖p‖ of the points that yield, of a law that falls faster than the pixels are stiff."""
    law = NixGao(0.1 * E * SLOPE, 1e-7, 1e-8)
    contact = _solved(_rough(), pressure=0.02 * E * SLOPE, hardness=law)
    p, u = contact.pressure, contact.plastic_deformation
    return float(np.linalg.norm((p - law.yield_pressure(u))[u > 0]) / np.linalg.norm(p))


def _step_in_table() -> tuple[float, float]:
    """Largest pressures of a table whose hardness jumps fourfold within 1 pm, of loads below and above the jump."""
    soft = 0.1 * E * SLOPE
    law = HardnessTable([0.0, 1e-8, 1e-8 + 1e-12, 1e-6], [soft, soft, 4 * soft, 4 * soft])
    found = (_solved(_rough(), pressure=p * E * SLOPE, hardness=law) for p in (3e-5, 0.02))
    return tuple(float(contact.pressure.max()) / soft for contact in found)


def _units(scale: float, modulus: float) -> float:
    gap0 = _rough(48)
    plain = _solved(gap0, hardness=5e9)
    other = solve_contact(
        scale * gap0,
        _grid(gap0, (scale * D, scale * D), modulus * E),
        pressure=modulus * LOAD,
        hardness=modulus * 5e9,
    )
    p = np.abs(other.pressure / modulus - plain.pressure).max() / plain.pressure.max()
    return float(max(p, np.abs(other.gap / scale - plain.gap).max() / plain.gap.max()))


def _step() -> tuple[float, float]:
    gap0 = np.zeros((64, 48))
    gap0[:, 24:] = 1.0
    contact = _solved(gap0)
    return contact.area_fraction, float(contact.pressure[:, 24:].max())


def _crushed_spike() -> tuple[float, float]:
    gap0 = _rough(64)
    gap0[20, 30] -= 1e-3
    contact = _solved(gap0, hardness=1e10)
    return float(contact.pressure[20, 30]), contact.mean_pressure


def _integers() -> tuple[float, float]:
    gap0 = np.random.default_rng(3).integers(0, 5, (48, 80)) * 1e-7
    return _carried(gap0, _grid(gap0), LOAD, 3e9)


def _primes() -> tuple[float, float]:
    gap0 = np.random.default_rng(4).standard_normal((97, 101)) * 1e-7
    half_space = HalfSpace((97, 101), (D, 3 * D), E, ("mirror", "free"))
    return _carried(gap0, half_space, LOAD, 3e9)


def _needles() -> tuple[float, float]:
    gap0 = np.random.default_rng(5).standard_normal((16, 64)) * 1e-8
    half_space = HalfSpace((16, 64), (D, 100 * D), E, ("free", "periodic"))
    return _carried(gap0, half_space, LOAD)


def _again() -> tuple[float, float]:
    """Largest change of the gap when the peak is met again, on an unloading that hardly leaves it, and back."""
    gap0 = _rough(64)
    peak = 3 * LOAD
    cycle = load_cycle(
        gap0,
        _grid(gap0),
        loading=[LOAD],
        hardness=5e9,
        unload_from=[peak],
        unloading=[(1 - 1e-9) * peak, LOAD],
    )
    first, top, near, low = (state.contact for state in cycle)
    same = np.abs(near.gap - top.gap).max() / top.gap.max()
    return float(same), low.mean_gap / first.mean_gap


def _feather() -> tuple[float, float]:
    gap0 = _rough(48)
    return _carried(gap0, _grid(gap0), 1e-3)


SCENES: tuple[HardScene, ...] = (
    scene(
        "wave that is all but closed",
        what="a wave on 1 × 512 pixels at 0.999 of the pressure of full contact: share in contact",
        must=Near(float(wave_contact_fraction(0.999)), 0.004, "Westergaard"),
        run=lambda: _wave(0.999),
    ),
    scene(
        "99.9 % in contact",
        what="an egg box just before its last spots close: open share",
        must=Near(
            1 - float(wavy_contact_fraction_full(0.9979056)), 0.2, "Johnson, Greenwood & Higginson"
        ),
        run=lambda: 1 - _egg_box(0.9979056).area_fraction,
    ),
    scene(
        "full contact",
        what="an egg box just after its last spots closed: share in contact, mean gap [m]",
        must=Exactly((1.0, 0.0)),
        run=_over_full,
    ),
    scene(
        "light contact",
        what="an egg box at 1e-3 of full contact, its two crests as balls: share in contact",
        must=Near(float(wavy_contact_fraction_light(1e-3)), 0.03, "two Hertz contacts"),
        run=lambda: _egg_box(1e-3).area_fraction_corrected,
    ),
    scene(
        "H/(E*h′) = 0.01",
        what="a face as soft as clay at a tenth of its hardness: share in contact",
        must=Between(0.1, 0.103, "all of it at the hardness, p̄/H"),
        run=_soft,
    ),
    scene(
        "H/(E*h′) = 100",
        what="a hardness that is never reached: difference to the elastic pressure over its largest",
        must=Exactly(0.0, "the elastic contact"),
        run=_hard,
    ),
    scene(
        "H/(E*h′) from 0.01 to 10",
        what="one face and load, rising hardness: share in contact",
        must=Falling("a harder face touches no more", steeply=False),
        run=_hardnesses,
    ),
    scene(
        "hardening slope 0",
        what="hardening without a slope: largest difference of the gap to perfect plasticity [m], and of transforms",
        must=Exactly(0.0, "the same law"),
        run=_flat_slope,
    ),
    scene(
        "hardening slope of 1e6 E*/pixel",
        what="points that harden at once: difference to the elastic pressure over its largest",
        must=at_most(1e-4, "the elastic contact"),
        run=_steep_slope,
    ),
    scene(
        "hardening slopes from 1e-6 to 1e6 E*/pixel",
        what="one face and load, rising slope: share in contact",
        must=Falling("a harder face touches no more", steeply=False),
        run=_slopes,
    ),
    scene(
        "a thousand times the hardness, soft",
        what="p̄ = 1000 H with a slope of 1e-4 E*/pixel: load, mean plastic deformation over (p̄ − H)/h",
        must=Near((1.0, 1.0), 1e-6, "all points yield"),
        run=lambda: _beyond_hardness(1e-4),
    ),
    scene(
        "a thousand times the hardness, stiff",
        what="p̄ = 1000 H with a slope of 1e4 E*/pixel: load, mean plastic deformation over (p̄ − H)/h",
        must=Near((1.0, 1.0), 1e-6, "all points yield"),
        run=lambda: _beyond_hardness(1e4),
    ),
    scene(
        "a table with a steep step",
        what="hardness jumps fourfold within 1 pm: largest pressure over the lower hardness, at a light and a high load",
        must=Near((1.0, 4.0), 1e-6, "the light load stays below the jump, the high one passes it"),
        run=_step_in_table,
    ),
    scene(
        "a step at no depth",
        what="a table that jumps fourfold within 1 fm from the face on: largest difference of pressure to the upper hardness",
        must=at_most(1e-5, "the upper hardness alone"),
        run=lambda: _off_perfect(
            HardnessTable([0.0, 1e-15], [0.1 * E * SLOPE, 0.4 * E * SLOPE]), 0.4 * E * SLOPE
        ),
    ),
    scene(
        "Nix–Gao with a tiny h*",
        what="h* = 1 fm: largest difference of pressure to the hardness H₀ alone",
        must=at_most(1e-5, "perfect plasticity"),
        run=lambda: _off_perfect(NixGao(0.1 * E * SLOPE, 1e-15), 0.1 * E * SLOPE),
    ),
    scene(
        "Nix–Gao that softens at once",
        what="h* = 0.1 µm with a smallest depth of 10 nm, whose hardness falls faster than the pixels are stiff: pressures "
        "off the law where points yield, ‖p − H‖/‖p‖",
        must=at_most(2e-6, "the law at the plastic deformation"),
        run=_off_falling_law,
    ),
    scene(
        "lengths in 1e-18 m",
        what="heights and pixels 2⁻⁶⁰ times as large: largest relative change",
        must=Exactly(0.0, "no length of its own"),
        run=lambda: _units(2.0**-60, 1.0),
    ),
    scene(
        "lengths in 1e18 m",
        what="heights and pixels 2⁶⁰ times as large: largest relative change",
        must=Exactly(0.0, "no length of its own"),
        run=lambda: _units(2.0**60, 1.0),
    ),
    scene(
        "moduli of 1e-7 and 1e29 Pa",
        what="modulus, hardness and load 2⁻⁶⁰ and 2⁶⁰ times as large: largest relative change",
        must=Exactly((0.0, 0.0), "no pressure of its own"),
        run=lambda: (_units(1.0, 2.0**-60), _units(1.0, 2.0**60)),
    ),
    scene(
        "step of a metre",
        what="a ledge of 1 m on pixels of 1 µm: share in contact, largest pressure on the low half [Pa]",
        must=Exactly((0.5, 0.0), "the upper half carries all"),
        run=_step,
    ),
    scene(
        "spike that is crushed",
        what="one pixel stands out by 1 mm, with a hardness of 10 GPa: its pressure and the mean [Pa]",
        must=Near((1e10, LOAD), 1e-9, "the hardness, and the rest carries on"),
        run=_crushed_spike,
    ),
    scene(
        "heights of integers",
        what="five heights and no other: relative error of load and signs, a thousandth of that of complementarity",
        must=at_most(1e-9, "equilibrium, signs and complementarity"),
        run=_integers,
    ),
    scene(
        "prime numbers of pixels",
        what="white noise on 97 × 101 oblong pixels, mirrored and free: the same errors",
        must=at_most(1e-9, "equilibrium, signs and complementarity"),
        run=_primes,
    ),
    scene(
        "pixels of 1 : 100",
        what="white noise on needles, free and periodic: the same errors",
        must=at_most(1e-9, "equilibrium, signs and complementarity"),
        run=_needles,
    ),
    scene(
        "load of a feather",
        what="a load of 1 mPa on steel: the same errors",
        must=at_most(1e-9, "equilibrium, signs and complementarity"),
        run=_feather,
    ),
    scene(
        "peak met again",
        what="an unloading that stops 1e-9 below its peak: change of the gap over the largest",
        must=at_most(1e-4, "the state of the peak"),
        run=lambda: _again()[0],
    ),
    scene(
        "gap after unloading",
        what="mean gap on unloading over that on loading, at one load",
        must=Between(0.5, 0.99, "a face keeps the print of its peak"),
        run=lambda: _again()[1],
    ),
)
