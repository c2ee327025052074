"""Hard scenes of the whole chain, from heights to leakage."""

from dataclasses import replace
from functools import partial
from math import pi

import numpy as np
from hard_scene import HardScene
from judges import between, exactly, falling, near, refused, zero_and_positive

from femseal.analytic import wavy_full_contact_pressure
from femseal.fluids import Liquid
from femseal.gases import IdealGas
from femseal.studies import Scene, deterministic
from femseal.topography import Topography, self_affine

E, HARDNESS, D, ETA, DROP = 115e9, 3e9, 1e-6, 1e-3, 1e6
WATER = Liquid(viscosity=ETA)

scene = partial(HardScene, "chain")


def chain_scene(heights, spacing=(D, D), **given):
    """A scene of heights [m] on pixels of 1 µm: steel, water, 200 MPa; `given` takes the place of any of it."""
    base = {
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


def chain_face(shape=(64, 96), slope=0.1, rng=1):
    """Heights of a rough face [m]."""
    size = (shape[0] * D, shape[1] * D)
    return self_affine(
        shape, size, hurst=0.8, rms_slope=slope, roll_off=24 * D, cut_off=8 * D, rng=rng
    ).heights


def _leakage(heights, **given):
    return deterministic(chain_scene(heights, **given)).leakage


def _last_pools():
    """An egg box at 99.9 % in contact."""
    n = 128
    c = np.cos(2 * pi * (np.arange(n) + 0.5) / n)
    pressure = 0.9979056 * wavy_full_contact_pressure(E, 1e-6, n * D)
    return float(_leakage(1e-6 * c[:, None] * c, hardness=np.inf, loading=(pressure,))[0])


def _closing():
    """A rough face at the load that closes it, to a millionth, and just below."""
    heights = chain_face((48, 64))
    low, high = 2e8, 2.9e9
    while high > (1 + 1e-6) * low:
        middle = (low + high) / 2
        low, high = (middle, high) if _leakage(heights, loading=(middle,))[0] > 0 else (low, middle)
    closed, open_ = (float(_leakage(heights, loading=(load,))[0]) for load in (high, low))
    return closed, open_


def _held_open():
    """A rough face held open by a spike of a millimetre."""
    heights = np.array(chain_face((48, 48)))
    heights[20, 30] += 1e-3
    return float(_leakage(heights, hardness=np.inf, loading=(1e5,))[0])


def _peaks():
    """Leakage at one load: on first loading, after a peak and after a higher one."""
    leakage = _leakage(chain_face(), loading=(1e8,), unload_from=(3e8, 9e8), unloading=(1e8,))
    return leakage[[0, -2, -1]]


def _scratched():
    """A flat face with a scratch from inlet to outlet, as deep as wide; then a spike in the middle of it."""
    heights = np.zeros((61, 67))
    heights[:, 30:34] = -4e-6
    scratched = float(_leakage(heights, loading=(1e7,))[0])
    heights[29:32, 30:34] = 0.0
    return scratched, float(_leakage(heights, loading=(1e7,))[0])


def _undefined():
    heights = chain_face()
    heights = np.where(np.arange(heights.size).reshape(heights.shape) == 7, np.nan, heights)
    return _leakage(heights)


def _slipping(inlet, outlet):
    """Helium with slip over helium without it."""
    helium = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
    heights = 0.1 * chain_face((32, 48))
    ends = {"inlet_pressure": inlet, "outlet_pressure": outlet, "loading": (1e6,)}
    slip, viscous = (
        _leakage(heights, fluid=replace(helium, slip=s), **ends)[0] for s in (True, False)
    )
    return float(slip / viscous)


SCENES = (
    scene(
        "99.9 % in contact, pools",
        "an egg box at 99.9 % in contact: leakage [m²/s]",
        exactly(0.0, "pools are joined to nothing"),
        _last_pools,
    ),
    scene(
        "both sides of closing under load",
        "a rough face at the load that closes it, found to a millionth, and just below: leakage [m²/s]",
        zero_and_positive("closed and open"),
        _closing,
    ),
    scene(
        "face held open by a spike",
        "one pixel stands out by 1 mm: leakage [m²/s]",
        near(1e-9 / 12 * DROP / (ETA * 48 * D), 0.003, "plates 1 mm apart"),
        _held_open,
    ),
    scene(
        "higher and higher peaks",
        "leakage at 100 MPa: on first loading, after 300 MPa and after 900 MPa [m²/s]",
        falling("a higher peak leaves less"),
        _peaks,
    ),
    scene(
        "scratch with a bridge",
        "a flat face with a scratch from end to end is bridged by three pixels: leakage [m²/s]",
        falling("the bridge seals"),
        _scratched,
    ),
    scene(
        "holes left in a face",
        "one point is undefined and not filled",
        refused("surface", "1 of 6144 points undefined", "fill"),
        _undefined,
    ),
    scene(
        "gas with slip at high pressure",
        "helium at 1e12 Pa: leakage over that without slip",
        near(1.0, 1e-3, "continuum"),
        lambda: _slipping(2e12, 1e12),
    ),
    scene(
        "gas with slip near vacuum",
        "helium at 0.01 Pa: leakage over that without slip",
        between(1e3, 1e12, "free molecules"),
        lambda: _slipping(0.02, 0.01),
    ),
)
