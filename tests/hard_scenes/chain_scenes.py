"""Hard scenes of the whole chain, from heights to leakage."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import pi
from typing import Any

import numpy as np
from hard_scene import HardScene
from judges import Between, Exactly, Falling, Near, Refused, ZeroAndPositive, at_most

from femseal.analytic import wavy_full_contact_pressure
from femseal.fluids import IdealGas, Liquid
from femseal.studies import Scene
from femseal.studies.face_study import deterministic
from femseal.topography import Topography, self_affine

E, HARDNESS, D, ETA, DROP = 115e9, 3e9, 1e-6, 1e-3, 1e6
WATER = Liquid(viscosity=ETA)

scene = partial(HardScene, stage="chain")


def chain_scene(heights: np.ndarray, spacing: tuple[float, float] = (D, D), **given: Any) -> Scene:
    """A scene of heights [m] on pixels of 1 µm: steel, water, 200 MPa; `given` takes the place of any of it."""
    base: dict[str, Any] = {
        "modulus": E,
        "hardness": HARDNESS,
        "fluid": WATER,
        "inlet_pressure": DROP,
        "fluid_pressure": "ignored",
        "outlet_pressure": 0.0,
        "loading": (2e8,),
        "boundary": ("periodic", "periodic"),
    }
    return Scene(surface=Topography(heights, spacing), **(base | given))


def chain_face(shape: tuple[int, int] = (64, 96), slope: float = 0.1, rng: int = 1) -> np.ndarray:
    """Heights of a rough face [m]."""
    size = (shape[0] * D, shape[1] * D)
    return self_affine(
        shape, size, hurst=0.8, rms_slope=slope, roll_off=24 * D, cut_off=8 * D, rng=rng
    ).heights


def _leakage(heights: np.ndarray, **given: Any) -> np.ndarray:
    return deterministic(chain_scene(heights, **given)).leakage


def _last_pools() -> float:
    """An egg box at 99.9 % in contact."""
    n = 128
    c = np.cos(2 * pi * (np.arange(n) + 0.5) / n)
    pressure = 0.9979056 * wavy_full_contact_pressure(E, 1e-6, n * D)
    return float(_leakage(1e-6 * c[:, None] * c, hardness=np.inf, loading=(pressure,))[0])


def _closing() -> tuple[float, float]:
    """A rough face at the load that closes it, to a millionth, and just below."""
    heights = chain_face((48, 64))
    low, high = 2e8, 2.9e9
    while high > (1 + 1e-6) * low:
        middle = (low + high) / 2
        low, high = (middle, high) if _leakage(heights, loading=(middle,))[0] > 0 else (low, middle)
    closed, open_ = (float(_leakage(heights, loading=(load,))[0]) for load in (high, low))
    return closed, open_


def _hardnesses() -> list[float]:
    heights = chain_face((48, 64))
    return [
        float(_leakage(heights, hardness=r * E * 0.1, loading=(5e7,))[0])
        for r in (1.0, 0.1, 0.03, 0.01)
    ]


def _never_plastic() -> float:
    heights = chain_face((48, 64))
    hard, elastic = (
        _leakage(heights, hardness=h, loading=(5e7,))[0] for h in (100 * E * 0.1, np.inf)
    )
    return float(hard / elastic - 1)


def _asperity() -> float:
    """A ball of half a millimetre on a plane, leaking along one axis over the other; pixels of 1 : 2."""
    x1, x2 = (np.arange(64) - 31.5) * D, (np.arange(32) - 15.5) * 2 * D
    heights = -(x1[:, None] ** 2 + x2**2) / (2 * 5e-4)
    faces = (heights, (D, 2 * D)), (heights.T, (2 * D, D))
    along, across = (
        deterministic(chain_scene(*f, hardness=np.inf, loading=(2e7,))).leakage[0] for f in faces
    )
    return float(along / across)


def _held_open() -> float:
    """A rough face held open by a spike of a millimetre."""
    heights = np.array(chain_face((48, 48)))
    heights[20, 30] += 1e-3
    return float(_leakage(heights, hardness=np.inf, loading=(1e5,))[0])


def _ledge() -> float:
    """A face of which half is a metre below."""
    heights = np.zeros((16, 48))
    heights[:, 24:] = -1.0
    return float(_leakage(heights, loading=(1e8,))[0])


def _peaks() -> np.ndarray:
    """Leakage at one load: on first loading, after a peak and after a higher one."""
    leakage = _leakage(chain_face(), loading=(1e8,), unload_from=(3e8, 9e8), unloading=(1e8,))
    return leakage[[0, -2, -1]]


def _loads() -> np.ndarray:
    return _leakage(chain_face(), loading=(0.0, 1e6, 3e7, 1e8, 3e8, 1e9, 2.9e9))


def _primes() -> float:
    heights = np.random.default_rng(1).standard_normal((61, 97)) * 1e-7
    plain, mirrored = (_leakage(h, loading=(1e9,))[0] for h in (heights, heights[:, ::-1]))
    return float(mirrored / plain)


def _unloaded() -> float:
    loading, _, unloading = _leakage(
        chain_face(), loading=(1e8,), unload_from=(6e8,), unloading=(1e8,)
    )
    return float(unloading / loading)


def _peak_again() -> float:
    peak = 3e8
    leakage = _leakage(
        chain_face(), loading=(1e8,), unload_from=(peak,), unloading=((1 - 1e-9) * peak,)
    )
    return float(abs(leakage[2] / leakage[1] - 1))


def _stresses() -> float:
    """Relative change of leakage with all stresses, and the viscosity, 2⁴⁰ times as large."""
    plain = chain_scene(chain_face((32, 48)))
    unit = 2.0**40
    scaled = replace(
        plain,
        modulus=unit * E,
        hardness=unit * HARDNESS,
        loading=(unit * 2e8,),
        fluid=Liquid(viscosity=unit * ETA),
        inlet_pressure=unit * DROP,
    )
    small, large = (float(deterministic(s).leakage[0]) for s in (plain, scaled))
    return abs(large / small - 1)


def _scratched() -> tuple[float, float]:
    """A flat face with a scratch from inlet to outlet, as deep as wide; then a spike in the middle of it."""
    heights = np.zeros((61, 67))
    heights[:, 30:34] = -4e-6
    scratched = float(_leakage(heights, loading=(1e7,))[0])
    heights[29:32, 30:34] = 0.0
    return scratched, float(_leakage(heights, loading=(1e7,))[0])


def _holes() -> float:
    """A face that misses 2 % of its points, filled, over the whole one."""
    heights = chain_face()
    missing = np.where(np.random.default_rng(2).random(heights.shape) < 0.02, np.nan, heights)
    filled = Topography(missing, (D, D)).fill_undefined().heights
    whole, mended = (float(_leakage(h, loading=(1e8,))[0]) for h in (heights, filled))
    return mended / whole


def _undefined() -> np.ndarray:
    heights = chain_face()
    heights = np.where(np.arange(heights.size).reshape(heights.shape) == 7, np.nan, heights)
    return _leakage(heights)


def _gas() -> float:
    """A gas without slip over water, both as drops of pressure potential."""
    gas = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=293.15, slip=False)
    heights = chain_face()
    water, air = (
        _leakage(heights, fluid=fluid, inlet_pressure=1e7, outlet_pressure=1e5)[0]
        for fluid in (WATER, gas)
    )
    drops = [np.subtract(*f.potential([1e7, 1e5])) / f.reference_density for f in (WATER, gas)]
    return float(air / water / (drops[1] / drops[0]))


def _slipping(inlet: float, outlet: float) -> float:
    """Helium with slip over helium without it."""
    helium = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
    heights = 0.1 * chain_face((32, 48))
    ends = {"inlet_pressure": inlet, "outlet_pressure": outlet, "loading": (1e6,)}
    slip, viscous = (
        _leakage(heights, fluid=replace(helium, slip=s), **ends)[0] for s in (True, False)
    )
    return float(slip / viscous)


def _twice() -> float:
    heights = np.random.default_rng(3).integers(0, 5, (48, 80)) * 1e-7
    first, second = (float(_leakage(heights)[0]) for _ in range(2))
    return abs(first - second)


SCENES: tuple[HardScene, ...] = (
    scene(
        "99.9 % in contact, pools",
        what="an egg box at 99.9 % in contact: leakage [m²/s]",
        must=Exactly(0.0, "pools are joined to nothing"),
        run=_last_pools,
    ),
    scene(
        "both sides of closing under load",
        what="a rough face at the load that closes it, found to a millionth, and just below: leakage [m²/s]",
        must=ZeroAndPositive("closed and open"),
        run=_closing,
    ),
    scene(
        "leakage at H/(E*h′) = 100",
        what="a hardness that is never reached: relative change of leakage",
        must=Exactly(0.0, "the elastic face"),
        run=_never_plastic,
    ),
    scene(
        "leakage at H/(E*h′) from 1 to 0.01",
        what="one face and load, falling hardness: leakage [m²/s]",
        must=Falling("a softer face seals better"),
        run=_hardnesses,
    ),
    scene(
        "one asperity, leakage along and across",
        what="a ball on pixels of 1 : 2: leakage along one axis over that along the other",
        must=Near(1.0, 0.01, "a ball has no direction"),
        run=_asperity,
    ),
    scene(
        "face held open by a spike",
        what="one pixel stands out by 1 mm: leakage [m²/s]",
        must=Near(1e-9 / 12 * DROP / (ETA * 48 * D), 0.003, "plates 1 mm apart"),
        run=_held_open,
    ),
    scene(
        "ledge of a metre along the leakage",
        what="half of a face lies 1 m below the other: leakage [m²/s]",
        must=Near(0.5 / 12 * DROP / (ETA * 16 * D), 1e-6, "plates 1 m apart"),
        run=_ledge,
    ),
    scene(
        "higher and higher peaks",
        what="leakage at 100 MPa: on first loading, after 300 MPa and after 900 MPa [m²/s]",
        must=Falling("a higher peak leaves less"),
        run=_peaks,
    ),
    scene(
        "stresses of 1e12 times the size",
        what="modulus, hardness, load, pressure and viscosity 2⁴⁰ times as large: relative change of leakage",
        must=Exactly(0.0, "no stress of its own"),
        run=_stresses,
    ),
    scene(
        "no roughness at all",
        what="two flat faces under load: leakage [m²/s]",
        must=Exactly(0.0),
        run=lambda: _leakage(np.zeros((32, 32)))[0],
    ),
    scene(
        "huge steps of load",
        what="loads of 0, 1 MPa … 2.9 GPa with H = 3 GPa: leakage [m²/s]",
        must=Falling("more load, no more leakage", steeply=False),
        run=_loads,
    ),
    scene(
        "leakage after unloading",
        what="leakage at 100 MPa after 600 MPa over that before",
        must=Between(0.05, 0.9, "a face keeps the print of its peak"),
        run=_unloaded,
    ),
    scene(
        "peak repeated",
        what="an unloading that stops 1e-9 below its peak: relative change of leakage",
        must=at_most(0.01, "the state of the peak"),
        run=_peak_again,
    ),
    scene(
        "scratch with a bridge",
        what="a flat face with a scratch from end to end is bridged by three pixels: leakage [m²/s]",
        must=Falling("the bridge seals"),
        run=_scratched,
    ),
    scene(
        "scratch with a bridge, sealed",
        what="the same: leakage with the bridge [m²/s]",
        must=Exactly(0.0),
        run=lambda: _scratched()[1],
    ),
    scene(
        "holes in a face",
        what="2 % of the points are undefined and filled: leakage over that of the whole face",
        must=Between(0.8, 1.25, "a fill is a small change"),
        run=_holes,
    ),
    scene(
        "holes left in a face",
        what="one point is undefined and not filled",
        must=Refused(("surface", "1 of 6144 points undefined", "fill")),
        run=_undefined,
    ),
    scene(
        "face of prime numbers of pixels",
        what="61 × 97 white pixels at 1 GPa: leakage of the mirror image over its own",
        must=Near(1.0, 1e-4, "symmetry"),
        run=_primes,
    ),
    scene(
        "face of integers",
        what="heights of 0 to 4 steps of 0.1 µm: leakage [m²/s], twice",
        must=at_most(0.0, "one input, one answer"),
        run=_twice,
    ),
    scene(
        "gas without slip",
        what="leakage of air over that of water over the ratio of their drops of potential",
        must=Near(1.0, 1e-9, "one permeability"),
        run=_gas,
    ),
    scene(
        "gas with slip at high pressure",
        what="helium at 1e12 Pa: leakage over that without slip",
        must=Near(1.0, 1e-3, "continuum"),
        run=lambda: _slipping(2e12, 1e12),
    ),
    scene(
        "gas with slip near vacuum",
        what="helium at 0.01 Pa: leakage over that without slip",
        must=Between(1e3, 1e12, "free molecules"),
        run=lambda: _slipping(0.02, 0.01),
    ),
)
