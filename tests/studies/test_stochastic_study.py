"""Drawn seals: closed forms of equal cells, invariants, maps, the fluid that acts, places, and faults."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import OIL, E, H, steel_scene

from femseal.base import InputError
from femseal.contact import LinearHardening
from femseal.execution.run import ordered_map
from femseal.face.cut import Cut
from femseal.fluids import Liquid
from femseal.gases import IdealGas
from femseal.loads import LoadProgramme, LoadStep
from femseal.seal import (
    AngleTable,
    AnnularLayout,
    MapsAtLoads,
    PressureField,
    Profile,
    RectangularLayout,
)
from femseal.studies import Sampling, deterministic, stochastic
from femseal.studies.cell_states import solve_cells_at_pressures
from femseal.topography import Patches, Topography, self_affine

N, D = 32, 1e-6
SIDE = N * D
GAS = IdealGas(2e-5, 0.028, 293.15, slip=False)


@cache
def face(rng=2):
    return self_affine((N, N), (SIDE, SIDE), hurst=0.8, rms_slope=0.15, roll_off=SIDE / 2, rng=rng)


def scene(**changed):
    return steel_scene(**({"surface": face(), "loading": (1e8, 3e8)} | changed))


def broad(realisations=1, rows=2, columns=8, **options):
    """A strip so many faces broad and long."""
    return Sampling(
        columns * SIDE, realisations, seed=3, breadth=rows * SIDE, median_fields=False, **options
    )


def drawn(one, sampling=None, cells=(2, 2), **options):
    return stochastic(one, cells, broad() if sampling is None else sampling, **options)


def periodic(one):
    """Leakage of the face that goes on periodically, per length of a strip as broad as the face [m²/s]."""
    return deterministic(replace(one, boundary=("periodic", "periodic"))).leakage


@dataclass(frozen=True)
class Halves:
    """A map of two values, beside each other along x2."""

    first: float
    second: float

    def at(self, points, frame):
        return np.where(points[:, 1] < frame.size[1] / 2, self.first, self.second)


# closed forms


@pytest.mark.parametrize("columns", [1, 2, 7])
def test_a_strip_of_equal_cells_leaks_as_the_face_over_its_breadth(columns):
    one = scene()
    assert_allclose(
        drawn(one, broad(rows=3, columns=columns), (1, 1)).leakage[0], periodic(one) / 3, rtol=1e-6
    )


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_a_ring_of_equal_cells_is_the_closed_form(inlet):
    one = scene(layout=AnnularLayout(20 * SIDE, 24 * SIDE, inlet))
    found = drawn(one, Sampling(None, 1, seed=0), (1, 1))
    assert_allclose(
        found.leakage[0] * found.seal.length,
        2 * np.pi / np.log(1.2) * SIDE * periodic(one),
        rtol=1e-6,
    )


def test_in_order_columns_of_the_whole_breadth_leak_what_the_face_leaks():
    one = scene(unload_from=(3e8,), unloading=(1e8,))
    found = drawn(one, Sampling(5 * SIDE, 3, seed=1), (2, 1))
    assert found.tiles.in_order
    assert_allclose(found.leakage, np.tile(deterministic(one).leakage, (3, 1)), rtol=1e-6)
    assert_array_equal(found.row_pressure.shape, (3, N))
    assert found.largest_row_pressure.shape == found.band_breadth.shape == (3,)


# invariants


def test_lengths_and_pressures_scale():
    """By 1000 in all lengths leakage is 1000² times as large; with all pressures and the viscosity it stays."""

    def leakage(length=1, pressure=1):
        surface = Topography(length * face().heights, (length * D,) * 2, (True, True))
        loads = {"loading": (1e8, 3e8), "unload_from": (3e8,), "unloading": (1e8,)}
        loads = {name: tuple(pressure * p for p in loads[name]) for name in loads}
        size = {"breadth": 2 * length * SIDE, "median_fields": False}
        sampling = Sampling(8 * length * SIDE, 2, seed=3, pressure_map=Profile((0.6, 1.4)), **size)
        solids = {"modulus": pressure * E, "hardness": pressure * H}
        fluid = {"inlet_pressure": pressure * 1e6, "fluid": Liquid(pressure * 1e-3)}
        return drawn(scene(surface=surface, **loads, **solids, **fluid), sampling).leakage

    assert_allclose(leakage(length=1000), 1e6 * leakage(), rtol=1e-5)
    assert_allclose(leakage(pressure=1 / 7), leakage(), rtol=1e-4)


def test_realisations_are_the_same_whoever_draws_them():
    one = scene()
    five = drawn(one, broad(5)).leakage
    assert_array_equal(drawn(one, broad(2)).leakage, five[:2])
    assert len(np.unique(five[:, 0])) == 5
    with ordered_map(2) as mapper:
        assert_array_equal(drawn(one, broad(5), mapper=mapper).leakage, five)
    assert not np.isin(drawn(one, replace(broad(5), seed=4)).leakage, five).any()


def test_longer_seals_scatter_less_about_the_same_leakage():
    one = scene()
    short, long = (drawn(one, broad(40, columns=n)) for n in (4, 64))
    spread = [s.realisation_spread for s in (short, long)]
    assert (spread[1] < spread[0] / 2.5).all()  # 4 by independent columns
    assert_allclose(np.median(long.leakage, axis=0), short.mean, rtol=0.15)


def test_as_many_seals_are_drawn_as_the_band_needs():
    long, short, three = (
        drawn(scene(), replace(broad(), realisations=count, length=faces * SIDE)).leakage
        for count, faces in ((None, 400), (None, 3), (3, 3))
    )
    assert len(long) == 3
    assert 3 < len(short) <= 200
    assert_array_equal(short[:3], three)


# maps


@pytest.mark.parametrize("columns", [2, 8])
@pytest.mark.parametrize("low", [0.0, 0.6])
def test_halves_beside_each_other_leak_their_mean_and_in_a_row_their_harmonic_mean(columns, low):
    """Equal cells: the pressure falls alike in both halves, so that none flows across; without pressure they touch."""
    one, high = scene(loading=(2e8,)), 2 - low
    k = np.array([periodic(scene(loading=(p * 2e8,)))[0] for p in (low, high)])
    beside, in_a_row = (
        drawn(one, broad(columns=columns, pressure_map=of), (1, 1)).leakage[0, 0]
        for of in (Halves(5 * low, 5 * high), Profile((5 * low, 5 * high)))
    )
    assert_allclose(beside, k.mean() / 2, rtol=1e-4)
    assert_allclose(in_a_row, 1 / np.mean(1 / k) / 2, rtol=1e-4)


def test_a_field_over_a_strip_of_two_columns_covers_it():
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]]) * SIDE
    field = PressureField.from_points(corners, [0.6e8, 1.4e8, 0.6e8, 1.4e8])
    line = Profile((0.6, 1.4), (0.0, 2 * SIDE))
    found = [
        drawn(scene(), broad(columns=2, pressure_map=of), (1, 1)).leakage for of in (field, line)
    ]
    assert_allclose(found[0], found[1], rtol=1e-6)


# the fluid presses the faces apart


def tabled(one, pressures):
    """k of the face at nominal pressures, from a ladder of them alone [m³]."""
    steps = LoadProgramme([LoadStep(float(p)) for p in pressures])
    cells = solve_cells_at_pressures(one, Cut.of(one.surface, (1, 1)), steps, map)
    return cells.surface_leakage * 1e-3 / one.inlet_pressure * SIDE


@pytest.mark.parametrize("fluid", [OIL, GAS], ids=["liquid", "gas"])
def test_a_broad_seal_of_equal_cells_has_the_mean_over_the_fluid_pressure(fluid):
    """∫ k(p̄ − s) ds over the pressure of a liquid, ∫ k(p̄ − s) s ds of a gas, over that without the fluid."""
    load, p_in = 2e8, 8e7
    one = scene(loading=(load,), inlet_pressure=p_in, fluid=fluid)
    wet, dry = (
        drawn(replace(one, fluid_pressure=acts), broad(rows=16, columns=3), (1, 1)).leakage[0, 0]
        for acts in ("acts", "ignored")
    )
    x, w = np.polynomial.legendre.leggauss(8)
    s = p_in * (1 - x) / 2  # falling, so that the loads rise
    weight, around = (w, 0.0) if fluid is OIL else (w * s, 101325.0)
    k = tabled(scene(), load - (s - around))
    exact = (weight @ k) / weight.sum() / tabled(scene(), [load])[0]
    assert exact > 1.15
    assert_allclose(wet / dry, exact, rtol=5e-3)


def test_the_contact_as_nominal_is_the_total_less_what_the_fluid_carries():
    options = {"inlet_pressure": 4e7, "fluid_pressure": "acts"}
    contact = drawn(scene(loading=(1e8,), nominal="contact", **options)).leakage
    total = drawn(scene(loading=(1e8 + 2e7,), **options)).leakage
    assert_allclose(contact, total, rtol=2e-3)


@pytest.mark.parametrize("fluid", [OIL, GAS], ids=["liquid", "gas"])
def test_reversed_flow_is_the_same_with_another_sign(fluid):
    def leakage(inlet, outlet):
        ends = {"inlet_pressure": inlet, "outlet_pressure": outlet, "fluid_pressure": "acts"}
        return drawn(scene(fluid=fluid, **ends), broad(rows=4), (1, 1)).leakage

    assert (leakage(3e7, 1e5) > 0).all()
    assert_allclose(leakage(1e5, 3e7), -leakage(3e7, 1e5), rtol=1e-3)
    assert_array_equal(leakage(3e7, 3e7), 0)


def test_faces_that_the_fluid_parts_have_no_leakage_and_the_others_theirs():
    one = scene(loading=(1e7, 2e8), inlet_pressure=4e7, fluid_pressure="acts")
    for sampling in (broad(2), replace(broad(2), realisations=None), Sampling(4 * SIDE, seed=1)):
        found = drawn(one, sampling)
        assert np.isnan(found.leakage[:, 0]).all()
        assert any("the surfaces separate" in text for text in found.failures)
        alone = drawn(replace(one, loading=(2e8,)), sampling).leakage[:, 0]
        assert_allclose(found.leakage[:, 1], alone, rtol=0.02)


# faults, and scenes at random


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"length": None}, "length"),
        ({"cells": (5, 2)}, "8 × 8 points"),
        ({"cells": (2.0, 2)}, "cells"),
        ({"breadth": 1.0}, "at most 1000 tiles"),
        ({"pressure_map": Profile((1.0, *[0.0] * 11)), "breadth": 12 * SIDE}, "hardness"),
        ({"layout": AnnularLayout(1e-3, 1.1e-3)}, "whose shape determines the size"),
    ],
)
def test_faults_are_named(changes, what):
    given = {"length": 8 * SIDE, "breadth": 2 * SIDE, "realisations": 1, "seed": 1} | changes
    cells, layout = given.pop("cells", (2, 2)), given.pop("layout", RectangularLayout())
    with pytest.raises(InputError, match=what):
        stochastic(scene(layout=layout), cells, Sampling(**given))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("realisations", 0),
        ("realisations", 1.5),
        ("seed", -1),
        ("seed", None),
        ("seed", True),
        ("breadth", np.nan),
        ("length", -1.0),
    ],
)
def test_faults_of_a_sampling_are_named(name, value):
    with pytest.raises(InputError, match=name):
        Sampling(**{"length": 1e-3, "realisations": 1, "seed": 1} | {name: value})


def random_scene(seed):
    """A scene of any kind, its cells and its sampling."""
    rng = np.random.default_rng(seed)

    def one_of(*choices):
        return choices[rng.integers(len(choices))]

    shape = one_of((16, 16), (32, 32), (33, 47), (24, 56), (48, 17), (97, 61))
    size = shape[0] * D, shape[1] * D
    waves = {"hurst": rng.uniform(0.3, 1.0), "roll_off": min(size) * rng.uniform(0.6, 1)}
    patches = [
        self_affine(shape, size, rms_slope=0.2, rng=1000 * seed + n, **waves)
        for n in range(one_of(1, 1, 1, 2, 3))
    ]
    loads = sorted(10 ** rng.uniform(6, 9.3, one_of(1, 2, 4)))
    loads = [0.0, *loads] if one_of(True, False, False) else loads
    peak = loads[-1]
    unloading = one_of((), (), (0.5 * peak, 0.05 * peak), (0.3 * peak, 0.0))
    pressures = [one_of(1e3, 1e5, 1e6, 0.3 * peak), one_of(1e2, 1e5)]
    pressures = pressures[:: one_of(1, 1, 1, -1)]
    lay = one_of("x2", "x1", {"angle": 0.7}, {"kind": "spiral", "lead": size[0] / 4})
    kind = one_of("strip", "strip", "as broad", "ring")
    layout, length = RectangularLayout(lay), size[1] * rng.uniform(0.3, 9)
    breadth = size[0] * rng.uniform(0.8, 4)
    if kind == "ring":
        lay = one_of("radial", "x1", lay)
        layout = AnnularLayout(3e-4, 3e-4 + breadth, one_of("inner", "outer"), lay=lay)
        length = None
    changing = MapsAtLoads((1e7, 1e8), (Profile((0.5, 1.5)), AngleTable((1.0, 0.7))))
    maps = Profile((0.6, 1.4)), AngleTable((0.5, 1.5), repeat=2), AngleTable((0.0, 1.0)), changing
    options = {"pressure_map": one_of(*maps)} if one_of(True, True, False) else {}
    cells = one_of(None, None, (1, 1), (2, 2), (1, 3), (3, 1), (4, 3))
    given = {
        "surface": Patches(patches) if len(patches) > 1 else patches[0],
        "hardness": one_of(np.inf, 3e9, 3e9, LinearHardening(3e9, 1e9)),
        "loading": tuple(loads),
        "fluid": one_of(OIL, GAS, replace(GAS, slip=True)),
        "layout": layout,
        "inlet_pressure": pressures[0],
        "outlet_pressure": pressures[1],
        "fluid_pressure": one_of("acts", "ignored"),
        "nominal": one_of("total", "contact"),
        "boundary": (one_of("free", "mirror", "periodic"), one_of("periodic", "mirror")),
        "unload_from": (peak,) if unloading else (),
        "unloading": unloading,
    }
    breadth = breadth if kind == "strip" else None
    return given, cells, Sampling(length, one_of(1, 2, None), seed=seed, breadth=breadth, **options)


def check_random_scene(seed):
    """The scene is solved, or refused with a reason; leakage is ≥ 0, in the direction of the drop, or NaN with a reason."""
    try:
        given, cells, sampling = random_scene(seed)
        one = scene(**given)
        found = stochastic(one, cells, sampling)
    except InputError:
        return False
    signed = found.leakage * np.sign(one.inlet_pressure - one.outlet_pressure)
    assert not (signed < 0).any()
    assert not np.isnan(signed).any() or found.failures
    return True


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    "seeds", [range(4, 10), pytest.param(range(100), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_scenes_at_random(seeds):
    """Kinds, shapes, maps, fluids, laws, places, unloading and small patches in any combination."""
    assert sum(check_random_scene(seed) for seed in seeds) > 0.4 * len(seeds)
