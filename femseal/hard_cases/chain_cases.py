"""Hard scenes of the whole chain, from heights to leakage."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import pi
from typing import Any

import numpy as np

from ..analytic import wave_full_contact_pressure, wave_groove_flow
from ..fluids import IdealGas, Liquid
from ..studies import Sampling, Scene, deterministic, stochastic, two_scale
from ..topography import Topography, self_affine
from .hard_case import HardCase
from .judges import Between, Exactly, Falling, Near, Refused, at_most

E, HARDNESS, D, ETA, DROP = 115e9, 3e9, 1e-6, 1e-3, 1e6
WATER = Liquid(viscosity=ETA)

case = partial(HardCase, stage="chain")


def _scene(heights: np.ndarray, spacing: tuple[float, float] = (D, D), **given: Any) -> Scene:
    base: dict[str, Any] = {
        "modulus": E,
        "hardness": HARDNESS,
        "fluid": WATER,
        "inlet_pressure": DROP,
        "outlet_pressure": 0.0,
        "loading": (2e8,),
        "boundary": ("periodic", "periodic"),
    }
    return Scene(surface=Topography(heights, spacing), **(base | given))


def _rough(shape: tuple[int, int] = (64, 96), slope: float = 0.1, rng: int = 1) -> np.ndarray:
    size = (shape[0] * D, shape[1] * D)
    return self_affine(shape, size, hurst=0.8, rms_slope=slope, roll_off=24 * D, cut_off=8 * D, rng=rng).heights


def _leakage(heights: np.ndarray, **given: Any) -> np.ndarray:
    return deterministic(_scene(heights, **given)).leakage


#: A wave of 1 µm and 256 pixels, and the pressure that flattens it.
_WAVE = 0.5e-6 * np.cos(2 * pi * (np.arange(256) + 0.5) / 256)
_FULL = wave_full_contact_pressure(E, 0.5e-6, 256 * D)


def _grooves(ratio: float) -> float:
    heights = np.repeat(_WAVE[None], 8, axis=0)
    return float(_leakage(heights, hardness=np.inf, loading=(ratio * _FULL,))[0])


def _grooves_exactly(ratio: float) -> float:
    return (2 * 0.5e-6) ** 3 / 12 * wave_groove_flow(ratio) * DROP / (ETA * 8 * D)


def _ridges() -> float:
    heights = np.repeat(_WAVE[:, None], 8, axis=1)
    return float(_leakage(heights, hardness=np.inf, loading=(1e-3 * _FULL,))[0])


def _loads() -> np.ndarray:
    return _leakage(_rough(), loading=(0.0, 1e6, 3e7, 1e8, 3e8, 1e9, 2.9e9))


def _primes() -> float:
    heights = np.random.default_rng(1).standard_normal((61, 97)) * 1e-7
    plain, mirrored = (_leakage(h, loading=(1e9,))[0] for h in (heights, heights[:, ::-1]))
    return float(mirrored / plain)


def _unloaded() -> float:
    loading, _, unloading = _leakage(_rough(), loading=(1e8,), unload_from=(6e8,), unloading=(1e8,))
    return float(unloading / loading)


def _peak_again() -> float:
    peak = 3e8
    leakage = _leakage(_rough(), loading=(1e8,), unload_from=(peak,), unloading=((1 - 1e-9) * peak,))
    return float(abs(leakage[2] / leakage[1] - 1))


def _units() -> float:
    plain = _scene(_rough((32, 48)))
    scale = 2.0**40
    surface = Topography(scale * plain.surface.heights, (scale * D, scale * D))
    small, large = (float(deterministic(s).leakage[0]) for s in (plain, replace(plain, surface=surface)))
    return abs(large / scale**2 / small - 1)


def _scratched() -> tuple[float, float]:
    """A flat face with a scratch from inlet to outlet, as deep as wide; then a spike in the middle of it."""
    heights = np.zeros((61, 67))
    heights[:, 30:34] = -4e-6
    scratched = float(_leakage(heights, loading=(1e7,))[0])
    heights[29:32, 30:34] = 0.0
    return scratched, float(_leakage(heights, loading=(1e7,))[0])


def _holes() -> float:
    """A face that misses 2 % of its points, filled, over the whole one."""
    heights = _rough()
    missing = np.where(np.random.default_rng(2).random(heights.shape) < 0.02, np.nan, heights)
    filled = Topography(missing, (D, D)).fill_undefined().heights
    whole, mended = (float(_leakage(h, loading=(1e8,))[0]) for h in (heights, filled))
    return mended / whole


def _undefined() -> np.ndarray:
    heights = _rough()
    heights = np.where(np.arange(heights.size).reshape(heights.shape) == 7, np.nan, heights)
    return _leakage(heights)


def _scales(cells: tuple[int, int], heights: np.ndarray, load: float = 1e8) -> float:
    """Leakage of two scales over the deterministic one."""
    scene = _scene(heights, loading=(load,))
    return float(two_scale(scene, cells, flow="resolved").leakage[0] / deterministic(scene).leakage[0])


def _drawn_of_one_kind() -> float:
    """A seal drawn from windows that are all alike, over their own leakage; one tile with a mirror in both axes."""
    c = np.cos(2 * pi * (np.arange(32) + 0.5) / 32)
    tile = 1e-7 * c[:, None] * c
    scene = _scene(np.tile(tile, (3, 4)), hardness=np.inf, loading=(1e7,))
    drawn = stochastic(scene, (3, 4), Sampling(1e-3, 3, 12, 1, sampler="block"))
    return float(np.ptp(drawn.leakage) / drawn.leakage.mean())


def _gas() -> float:
    """A gas without slip over water, both as drops of pressure potential."""
    gas = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=293.15, slip=False)
    heights = _rough()
    water, air = (_leakage(heights, fluid=fluid, inlet_pressure=1e7, outlet_pressure=1e5)[0] for fluid in (WATER, gas))
    drops = [np.subtract(*f.potential([1e7, 1e5])) / f.reference_density for f in (WATER, gas)]
    return float(air / water / (drops[1] / drops[0]))


def _slipping(inlet: float, outlet: float) -> float:
    """Helium with slip over helium without it."""
    helium = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
    heights = 0.1 * _rough((32, 48))
    ends = {"inlet_pressure": inlet, "outlet_pressure": outlet, "loading": (1e6,)}
    slip, viscous = (_leakage(heights, fluid=replace(helium, slip=s), **ends)[0] for s in (True, False))
    return float(slip / viscous)


def _symmetric() -> np.ndarray:
    """A face that is its own mirror image in both axes, so that periodic and mirrored sides are one."""
    quarter = _rough((48, 48))
    half = np.concatenate([quarter, quarter[::-1]])
    return np.concatenate([half, half[:, ::-1]], axis=1)


def _twice() -> float:
    heights = np.random.default_rng(3).integers(0, 5, (48, 80)) * 1e-7
    first, second = (float(_leakage(heights)[0]) for _ in range(2))
    return abs(first - second)


CASES: tuple[HardCase, ...] = (
    case(
        "no roughness at all",
        what="two flat faces under load: leakage [m²/s]",
        must=Exactly(0.0),
        run=lambda: _leakage(np.zeros((32, 32)))[0],
    ),
    case(
        "grooves along, light load",
        what="an elastic wave whose grooves run from inlet to outlet, at 0.01 of full contact [m²/s]",
        must=Near(_grooves_exactly(0.01), 0.005, "gap of Westergaard's wave"),
        run=lambda: _grooves(0.01),
    ),
    case(
        "grooves along, half closed",
        what="the same at half of full contact [m²/s]",
        must=Near(_grooves_exactly(0.5), 0.005, "gap of Westergaard's wave"),
        run=lambda: _grooves(0.5),
    ),
    case(
        "grooves along, nearly closed",
        what="the same at 0.9 of full contact [m²/s]",
        must=Near(_grooves_exactly(0.9), 0.03, "gap of Westergaard's wave"),
        run=lambda: _grooves(0.9),
    ),
    case(
        "grooves along, closed",
        what="the same at 1.001 of full contact [m²/s]",
        must=Exactly(0.0),
        run=lambda: _grooves(1.001),
    ),
    case(
        "grooves across",
        what="ridges across the leakage, at 1e-3 of full contact [m²/s]",
        must=Exactly(0.0, "one ridge is enough"),
        run=_ridges,
    ),
    case(
        "huge steps of load",
        what="loads of 0, 1 MPa … 2.9 GPa with H = 3 GPa: leakage [m²/s]",
        must=Falling("more load, no more leakage", steeply=False),
        run=_loads,
    ),
    case(
        "leakage after unloading",
        what="leakage at 100 MPa after 600 MPa over that before",
        must=Between(0.0, 1.0, "a face keeps the print of its peak"),
        run=_unloaded,
    ),
    case(
        "peak repeated",
        what="an unloading that stops 1e-9 below its peak: relative change of leakage",
        must=at_most(0.01, "the state of the peak"),
        run=_peak_again,
    ),
    case(
        "loads repeated",
        what="the same load twice on the loading curve",
        must=Refused(("loading", "rising")),
        run=lambda: _leakage(_rough(), loading=(1e8, 1e8)),
    ),
    case(
        "face of 1e12 times the size",
        what="all lengths 2⁴⁰ times as large: relative change of leakage over length squared",
        must=Exactly(0.0, "no length of its own"),
        run=_units,
    ),
    case(
        "scratch with a bridge",
        what="a flat face with a scratch from end to end is bridged by three pixels: leakage [m²/s]",
        must=Falling("the bridge seals"),
        run=_scratched,
    ),
    case(
        "scratch with a bridge, sealed",
        what="the same: leakage with the bridge [m²/s]",
        must=Exactly(0.0),
        run=lambda: _scratched()[1],
    ),
    case(
        "holes in a face",
        what="2 % of the points are undefined and filled: leakage over that of the whole face",
        must=Between(0.8, 1.25, "a fill is a small change"),
        run=_holes,
    ),
    case(
        "holes left in a face",
        what="one point is undefined and not filled",
        must=Refused(("surface", "1 of 6144 points undefined", "fill")),
        run=_undefined,
    ),
    case(
        "one window in two scales",
        what="a face that is one window: two scales over deterministic",
        must=Near(1.0, 0.05, "the same problem but for mirrored sides"),
        run=lambda: _scales((1, 1), _symmetric()),
    ),
    case(
        "face of prime numbers of pixels",
        what="61 × 97 white pixels at 1 GPa: leakage of the mirror image over its own",
        must=Near(1.0, 1e-4, "symmetry"),
        run=_primes,
    ),
    case(
        "face of integers",
        what="heights of 0 to 4 steps of 0.1 µm: leakage [m²/s], twice",
        must=at_most(0.0, "one input, one answer"),
        run=_twice,
    ),
    case(
        "windows all alike",
        what="a face of twelve equal windows: scatter of drawn seals over their mean",
        must=Between(0.0, 1e-4, "no chance is left"),
        run=_drawn_of_one_kind,
    ),
    case(
        "gas without slip",
        what="leakage of air over that of water over the ratio of their drops of potential",
        must=Near(1.0, 1e-9, "one permeability"),
        run=_gas,
    ),
    case(
        "gas with slip at high pressure",
        what="helium at 1e12 Pa: leakage over that without slip",
        must=Near(1.0, 1e-3, "continuum"),
        run=lambda: _slipping(2e12, 1e12),
    ),
    case(
        "gas with slip near vacuum",
        what="helium at 0.01 Pa: leakage over that without slip",
        must=Between(1e3, 1e12, "free molecules"),
        run=lambda: _slipping(0.02, 0.01),
    ),
)
