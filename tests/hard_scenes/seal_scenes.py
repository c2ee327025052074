"""Hard scenes of the flow over a seal: sizes, contrasts, fluids, maps of pressure."""

from functools import partial

import numpy as np
from hard_scene import HardScene
from judges import at_most, between, exactly, near

from femseal.analytic import (
    log_symmetric_links,
    parallel_plates,
    stripes_across,
    stripes_along,
)
from femseal.fluids import IdealGas, Liquid, RoelandsLiquid
from femseal.seal import (
    AnnularSeal,
    PermeabilityTable,
    RectangularSeal,
    seal_leakage,
    table_pressures,
)
from femseal.seal.pressure_map import AngleTable, Frame, PressedSeal, Profile

K, ETA, DROP = 1e-20, 1e-3, 1e6
WATER = Liquid(viscosity=ETA)
HELIUM = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
STRIP = RectangularSeal((2e-3, 8e-3), (10, 40))
ONE = RectangularSeal((1e-3, 1e-3), (1, 1))

scene = partial(HardScene, "seal")


def _rate(seal, k, fluid=WATER, *, inlet=DROP, outlet=0.0):
    return seal_leakage(seal, k, fluid, inlet_pressure=inlet, outlet_pressure=outlet).volume_rate


# --- sizes and contrasts ---


def _columns():
    """A seal of 1 mm × 100 m whose columns do not know each other, over the sum of their harmonic means."""
    k1 = np.random.default_rng(1).lognormal(sigma=2, size=(2, 100_000))
    flow = (
        RectangularSeal((1e-3, 100.0), (2, 100_000)).flow((k1, np.zeros((1, 100_000)))).conductance
    )
    return flow / float(np.sum(1 / np.sum(1 / k1, axis=0)) * 1e-3 / 0.5e-3)


def _million():
    rng = np.random.default_rng(2)
    k1, k2 = (np.exp(rng.standard_normal(shape)) for shape in ((1000, 1000), (999, 1000)))
    flow = RectangularSeal((1.0, 1.0), (1000, 1000)).flow((k1, k2)).conductance
    return flow / log_symmetric_links(np.r_[k1.ravel(), k2.ravel()])


def _series():
    k1 = np.full((10, 40), K)
    k1[5:] = 1e-15 * K
    return STRIP.flow((k1, K)).conductance / 4


def _last_link():
    k1 = np.ones((10, 40))
    k1[4] = 0
    k1[4, 7] = 1e-12
    return STRIP.flow((k1, 1.0)).conductance  # links of 0.2 mm × 0.2 mm


def _critical():
    """Links open with a probability of 0.5, at which a lattice closes; this one is just open."""
    rng = np.random.default_rng(5)
    k1, k2 = ((rng.random(shape) < 0.5).astype(float) for shape in ((200, 200), (199, 200)))
    flow = RectangularSeal((1.0, 1.0), (200, 200)).flow((k1, k2), bounds=True)
    return flow.conductance / flow.lower, flow.upper / flow.conductance


def _permeabilities_apart():
    k1, k2 = (
        np.random.default_rng(6).lognormal(sigma=2, size=shape) for shape in ((10, 40), (9, 40))
    )
    plain, tiny = STRIP.flow((k1, k2)), STRIP.flow((2.0**-300 * k1, 2.0**-300 * k2))
    return abs(tiny.conductance * 2.0**300 / plain.conductance - 1)


# --- fluids ---


def _barus(pressure):
    oil = Liquid(viscosity=ETA, pressure_viscosity=20e-9)
    return _rate(ONE, K, oil, inlet=pressure)


def _roelands():
    oil = RoelandsLiquid(viscosity=0.05, pressure_viscosity=20e-9)
    p = np.geomspace(1.0, 1e9, 40)
    return float(np.abs(oil.pressure(oil.potential(p)) / p - 1).max())


def _gas():
    dense = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=293.15, slip=False)
    return seal_leakage(STRIP, K, dense, inlet_pressure=1e8, outlet_pressure=1e-3).mass_rate


def _slip(gap, inlet, outlet):
    """Rate of helium between plates, their permeability given at a few pressures."""
    p = table_pressures(inlet, outlet)
    k = [float(parallel_plates(gap) * HELIUM.flow_factor(gap, q)) for q in p]
    links = tuple(np.multiply.outer(k, np.ones(shape)) for shape in ((10, 40), (9, 40)))
    table = PermeabilityTable(tuple(p), links)
    return seal_leakage(
        STRIP, table, HELIUM, inlet_pressure=inlet, outlet_pressure=outlet
    ).mass_rate


def _slip_integral(gap, inlet, outlet):
    """The same by quadrature of ∫ F dφ."""
    edges = np.geomspace(outlet, inlet, 100_001)
    p = np.sqrt(edges[1:] * edges[:-1])
    mean = HELIUM.flow_factor(gap, p) @ np.diff(HELIUM.potential(edges))
    return float(parallel_plates(gap) * mean * STRIP.size[1] / STRIP.size[0])


# --- maps of pressure ---


def _local(pressure):
    """A permeability that falls by e for every 10 MPa."""
    return K * np.exp(-pressure / 1e7)


def _mapped(pressure_map):
    """Permeability of a strip of 10 × 40 links under a map of pressure with a mean of 100 MPa."""
    x1, x2 = (np.linspace(0, side, n + 1) for side, n in zip(STRIP.size, STRIP.cells, strict=True))
    corner = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1)
    outlines = np.stack(
        [corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=2
    )
    pressed = PressedSeal(Frame.of_strip(STRIP.size), outlines.reshape(-1, 4, 2))
    k1 = _local(1e8 * pressed.fractions(pressure_map, pressed.centres, 1e8)[0]).reshape(STRIP.cells)
    return STRIP.flow((k1, np.sqrt(k1[1:] * k1[:-1]))).conductance / 4


_turn = np.linspace(0, 360, 40, endpoint=False) + 4.5
_bolts = 1 + 0.5 * (np.abs((_turn % 90) / 45 - 1) * 2 - 1)  # mean 1, four peaks of 1.5
_series_map = Profile((0.5, 1.5))

SCENES = (
    scene(
        "ring of hair and mile",
        "radii of 1 µm and 1 km, all in one row of links",
        near(2 * np.pi / np.log(1e9), 1e-9, "2πk/ln(r_o/r_i)"),
        lambda: AnnularSeal(1e-6, 1e3, (1, 7)).flow(1.0).conductance,
    ),
    scene(
        "a million links",
        "1000 × 1000 log-normal links: permeability over exp⟨ln k⟩",
        near(1.0, 0.01, "self-duality"),
        _million,
        slow=True,
    ),
    scene(
        "seal of 1 : 1e5",
        "1 mm × 100 m of 200 000 links in separate columns: rate over the sum of harmonic means",
        near(1.0, 1e-7, "series and parallel"),
        _columns,
    ),
    scene(
        "links of contrast 1e15 in series",
        "half of the rows have 1e-15 of the permeability [m³]",
        near(stripes_across((K, 1e-15 * K)), 1e-6, "harmonic mean"),
        _series,
    ),
    scene(
        "last open link",
        "the only open link of a row has 1e-12 of the others",
        near(1e-12, 1e-6, "its own conductance"),
        _last_link,
    ),
    scene(
        "lattice at its threshold",
        "half of 80 000 links closed at random, yet open: flow over lower bound, upper bound over flow",
        between(1.0, 1 + 1e-6, "the flow of the network is enclosed"),
        _critical,
    ),
    scene(
        "permeabilities of 1e-90",
        "all permeabilities 2⁻³⁰⁰ times as large: relative change",
        exactly(0.0, "no permeability of its own"),
        _permeabilities_apart,
    ),
    scene(
        "oil at 0.5 GPa",
        "Barus's law with αp = 10 [m³/s]",
        near(K / ETA * (1 - np.exp(-10.0)) / 20e-9, 1e-9, "(1 − exp(−αp))/α"),
        lambda: _barus(0.5e9),
    ),
    scene(
        "Roelands' oil from 1 Pa to 1 GPa",
        "pressure to potential and back: largest relative error",
        at_most(1e-10, "inverse"),
        _roelands,
    ),
    scene(
        "gas from 100 MPa to 1 mPa",
        "an ideal gas without slip: mass rate [kg/s]",
        near(4 * K * 0.029 * 1e16 / (2 * 8.31446261815324 * 293.15 * 2e-5), 1e-9, "p² law"),
        _gas,
    ),
    scene(
        "helium of free molecules",
        "plates of 1 nm between 10 Pa and 1 Pa: mass rate [kg/s]",
        near(_slip_integral(1e-9, 10.0, 1.0), 1e-3, "∫ F dφ"),
        lambda: _slip(1e-9, 10.0, 1.0),
    ),
    scene(
        "map of pressure in series",
        "half and one and a half of the pressure on two strips from inlet to outlet [m³]",
        near(stripes_across(_local(np.array([0.5e8, 1.5e8]))), 1e-6, "harmonic mean"),
        lambda: _mapped(_series_map),
    ),
    scene(
        "map of pressure in parallel",
        "four bolts, the pressure between them a third of that below [m³]",
        near(stripes_along(_local(1e8 * _bolts)), 1e-6, "arithmetic mean"),
        lambda: _mapped(AngleTable((1.5, 0.5), repeat=4)),
    ),
)
