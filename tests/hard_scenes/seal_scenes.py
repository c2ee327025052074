"""Hard scenes of the flow over a seal: sizes, contrasts, fluids, maps of pressure."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from hard_scene import HardScene
from judges import Between, Exactly, Near, ZeroAndPositive, at_most

from femseal.analytic import (
    log_symmetric_links,
    parallel_plates,
    stripes_across,
    stripes_along,
)
from femseal.fluids import IdealGas, Liquid, RoelandsLiquid
from femseal.seal import PermeabilityTable, RectangularSeal, seal_leakage, table_pressures
from femseal.seal.pressure_map import AngleTable, Frame, PressedSeal, Profile

K, ETA, DROP = 1e-20, 1e-3, 1e6
WATER = Liquid(viscosity=ETA)
HELIUM = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
STRIP = RectangularSeal((2e-3, 8e-3), (10, 40))
ONE = RectangularSeal((1e-3, 1e-3), (1, 1))

scene = partial(HardScene, stage="seal")


def _rate(
    seal: Any, k: Any, fluid: Any = WATER, *, inlet: float = DROP, outlet: float = 0.0
) -> float:
    return seal_leakage(seal, k, fluid, inlet_pressure=inlet, outlet_pressure=outlet).volume_rate


# --- sizes and contrasts ---


def _columns() -> float:
    """A seal of 1 mm × 100 m whose columns do not know each other, over the sum of their harmonic means."""
    k1 = np.random.default_rng(1).lognormal(sigma=2, size=(2, 100_000))
    flow = (
        RectangularSeal((1e-3, 100.0), (2, 100_000)).flow((k1, np.zeros((1, 100_000)))).conductance
    )
    return flow / float(np.sum(1 / np.sum(1 / k1, axis=0)) * 1e-3 / 0.5e-3)


def _million() -> float:
    rng = np.random.default_rng(2)
    k1, k2 = (np.exp(rng.standard_normal(shape)) for shape in ((1000, 1000), (999, 1000)))
    flow = RectangularSeal((1.0, 1.0), (1000, 1000)).flow((k1, k2)).conductance
    return flow / log_symmetric_links(np.r_[k1.ravel(), k2.ravel()])


def _series() -> float:
    k1 = np.full((10, 40), K)
    k1[5:] = 1e-15 * K
    return STRIP.flow((k1, K)).conductance / 4


def _parallel() -> float:
    k1 = np.full((10, 40), K)
    k1[:, 20:] = 1e-15 * K
    return STRIP.flow((k1, K)).conductance / 4


def _wall() -> tuple[float, float]:
    """A row of closed links, and the same with one of them open."""
    k1 = np.ones((10, 40))
    k1[4] = 0
    closed = STRIP.flow((k1, 1.0)).conductance
    k1[4, 7] = 1e-15
    return closed, STRIP.flow((k1, 1.0)).conductance


def _last_link() -> float:
    k1 = np.ones((10, 40))
    k1[4] = 0
    k1[4, 7] = 1e-12
    return STRIP.flow((k1, 1.0)).conductance  # links of 0.2 mm × 0.2 mm


def _critical() -> tuple[float, float]:
    """Links open with a probability of 0.5, at which a lattice closes; this one is just open."""
    rng = np.random.default_rng(5)
    k1, k2 = ((rng.random(shape) < 0.5).astype(float) for shape in ((200, 200), (199, 200)))
    flow = RectangularSeal((1.0, 1.0), (200, 200)).flow((k1, k2), bounds=True)
    return flow.conductance / flow.lower, flow.upper / flow.conductance


def _primes() -> tuple[float, float]:
    k1, k2 = (
        np.random.default_rng(5).lognormal(sigma=3, size=shape) for shape in ((97, 101), (96, 101))
    )
    flow = RectangularSeal((1.0, 1.0), (97, 101)).flow((k1, k2), bounds=True)
    return flow.conductance / flow.lower, flow.upper / flow.conductance


def _permeabilities_apart() -> float:
    k1, k2 = (
        np.random.default_rng(6).lognormal(sigma=2, size=shape) for shape in ((10, 40), (9, 40))
    )
    plain, tiny = STRIP.flow((k1, k2)), STRIP.flow((2.0**-300 * k1, 2.0**-300 * k2))
    return abs(tiny.conductance * 2.0**300 / plain.conductance - 1)


# --- fluids ---


def _barus(pressure: float) -> float:
    oil = Liquid(viscosity=ETA, pressure_viscosity=20e-9)
    return _rate(ONE, K, oil, inlet=pressure)


def _roelands() -> float:
    oil = RoelandsLiquid(viscosity=0.05, pressure_viscosity=20e-9)
    p = np.geomspace(1.0, 1e9, 40)
    return float(np.abs(oil.pressure(oil.potential(p)) / p - 1).max())


def _gas() -> float:
    dense = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=293.15, slip=False)
    return seal_leakage(STRIP, K, dense, inlet_pressure=1e8, outlet_pressure=1e-3).mass_rate


def _slip(gap: float, inlet: float, outlet: float) -> float:
    """Rate of helium between plates, their permeability given at a few pressures."""
    p = table_pressures(inlet, outlet)
    k = [float(parallel_plates(gap) * HELIUM.flow_factor(gap, q)) for q in p]
    links = tuple(np.multiply.outer(k, np.ones(shape)) for shape in ((10, 40), (9, 40)))
    table = PermeabilityTable(tuple(p), links)
    return seal_leakage(
        STRIP, table, HELIUM, inlet_pressure=inlet, outlet_pressure=outlet
    ).mass_rate


def _slip_integral(gap: float, inlet: float, outlet: float) -> float:
    """The same by quadrature of ∫ F dφ."""
    edges = np.geomspace(outlet, inlet, 100_001)
    p = np.sqrt(edges[1:] * edges[:-1])
    mean = HELIUM.flow_factor(gap, p) @ np.diff(HELIUM.potential(edges))
    return float(parallel_plates(gap) * mean * STRIP.size[1] / STRIP.size[0])


# --- maps of pressure ---


def _local(pressure: np.ndarray) -> np.ndarray:
    """A permeability that falls by e for every 10 MPa."""
    return K * np.exp(-pressure / 1e7)


def _mapped(pressure_map: Any) -> float:
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

SCENES: tuple[HardScene, ...] = (
    scene(
        "a million links",
        what="1000 × 1000 log-normal links: permeability over exp⟨ln k⟩",
        must=Near(1.0, 0.01, "self-duality"),
        run=_million,
        slow=True,
    ),
    scene(
        "seal of 1 : 1e5",
        what="1 mm × 100 m of 200 000 links in separate columns: rate over the sum of harmonic means",
        must=Near(1.0, 1e-7, "series and parallel"),
        run=_columns,
    ),
    scene(
        "links of contrast 1e15 in series",
        what="half of the rows have 1e-15 of the permeability [m³]",
        must=Near(stripes_across((K, 1e-15 * K)), 1e-6, "harmonic mean"),
        run=_series,
    ),
    scene(
        "links of contrast 1e15 in parallel",
        what="half of the columns have 1e-15 of the permeability [m³]",
        must=Near(stripes_along((K, 1e-15 * K)), 1e-6, "arithmetic mean"),
        run=_parallel,
    ),
    scene(
        "closed row of links",
        what="a row of closed links, then one of its 40 opened to 1e-15",
        must=ZeroAndPositive("closed and open"),
        run=_wall,
    ),
    scene(
        "last open link",
        what="the only open link of a row has 1e-12 of the others",
        must=Near(1e-12, 1e-6, "its own conductance"),
        run=_last_link,
    ),
    scene(
        "lattice at its threshold",
        what="half of 80 000 links closed at random, yet open: flow over lower bound, upper bound over flow",
        must=Between(1.0, 1 + 1e-6, "the flow of the network is enclosed"),
        run=_critical,
    ),
    scene(
        "prime numbers of links",
        what="97 × 101 log-normal links: flow over lower bound, upper bound over flow",
        must=Between(1.0, 1 + 1e-6, "the flow of the network is enclosed"),
        run=_primes,
    ),
    scene(
        "permeabilities of 1e-90",
        what="all permeabilities 2⁻³⁰⁰ times as large: relative change",
        must=Exactly(0.0, "no permeability of its own"),
        run=_permeabilities_apart,
    ),
    scene(
        "oil at 0.5 GPa",
        what="Barus's law with αp = 10 [m³/s]",
        must=Near(K / ETA * (1 - np.exp(-10.0)) / 20e-9, 1e-9, "(1 − exp(−αp))/α"),
        run=lambda: _barus(0.5e9),
    ),
    scene(
        "Roelands' oil from 1 Pa to 1 GPa",
        what="pressure to potential and back: largest relative error",
        must=at_most(1e-10, "inverse"),
        run=_roelands,
    ),
    scene(
        "gas from 100 MPa to 1 mPa",
        what="an ideal gas without slip: mass rate [kg/s]",
        must=Near(4 * K * 0.029 * 1e16 / (2 * 8.31446261815324 * 293.15 * 2e-5), 1e-9, "p² law"),
        run=_gas,
    ),
    scene(
        "helium with slip",
        what="plates of 100 nm between 1 MPa and 0.1 MPa: mass rate [kg/s]",
        must=Near(_slip_integral(1e-7, 1e6, 1e5), 1e-3, "∫ F dφ"),
        run=lambda: _slip(1e-7, 1e6, 1e5),
    ),
    scene(
        "helium of free molecules",
        what="plates of 1 nm between 10 Pa and 1 Pa: mass rate [kg/s]",
        must=Near(_slip_integral(1e-9, 10.0, 1.0), 1e-3, "∫ F dφ"),
        run=lambda: _slip(1e-9, 10.0, 1.0),
    ),
    scene(
        "no drop",
        what="equal pressures at both ends [m³/s]",
        must=Exactly(0.0),
        run=lambda: _rate(STRIP, K, outlet=DROP),
    ),
    scene(
        "map of pressure in series",
        what="half and one and a half of the pressure on two strips from inlet to outlet [m³]",
        must=Near(stripes_across(_local(np.array([0.5e8, 1.5e8]))), 1e-6, "harmonic mean"),
        run=lambda: _mapped(_series_map),
    ),
    scene(
        "map of pressure in parallel",
        what="four bolts, the pressure between them a third of that below [m³]",
        must=Near(stripes_along(_local(1e8 * _bolts)), 1e-6, "arithmetic mean"),
        run=lambda: _mapped(AngleTable((1.5, 0.5), repeat=4)),
    ),
    scene(
        "map of one pressure",
        what="two equal strips [m³]",
        must=Near(float(_local(np.array(1e8))), 1e-9, "k(p̄)"),
        run=lambda: _mapped(Profile((0.7, 0.7))),
    ),
)
