"""The contact of a whole seal with its form, and the seals that are drawn under it."""

from dataclasses import replace
from functools import cache
from operator import attrgetter

import numpy as np
import pytest
from mesh_files import write_gmsh
from numpy.testing import assert_allclose
from skfem import MeshQuad
from small_cases import STRIP, steel_scene

import femseal as fs
from femseal import analytic
from femseal.case import parse_case
from femseal.contact import HalfSpace
from femseal.face.cut import Cut
from femseal.preparation import prepare
from femseal.seal import AnnularLayout, MeasuredForm, MeshLayout, WavyForm
from femseal.studies import cut_and_cover
from femseal.studies.contact_points import ContactPoints
from femseal.studies.rough_layer import RoughLayer
from femseal.studies.seal_contact import remove_waves_of_forms, solve_seal_contact
from femseal.topography import CrownedSeat

E, D = 115e9, 1e-6
RING = AnnularLayout(4e-3, 4.4e-3)


@cache
def face(n=64, rms_slope=0.2, pixel=D):
    waves = {"roll_off": 32 * D, "cut_off": 8 * D, "rng": 11}
    rough = fs.self_affine((n, n), (n * D, n * D), hurst=0.75, rms_slope=rms_slope, **waves)
    return fs.Topography(rough.heights, (pixel, pixel))


def scene(loading, surface=None, hardness=np.inf, **more):
    surface = face() if surface is None else surface
    return steel_scene(surface, hardness=hardness, loading=tuple(loading), **more)


def contact_of(one, form, breadth=None, length=None):
    sampling = fs.Sampling(length, seed=1, breadth=breadth, form=form)
    _, tiles = cut_and_cover(one.surface, one.layout, None, sampling)
    return solve_seal_contact(one, tiles, sampling.form)


# closed forms


def test_a_long_wave_under_a_stiff_layer_is_westergaard_s():
    """On the middle row of a seal many waves broad, under the mean that this row has."""
    wave, height = 1e-3, 0.1e-6
    full = analytic.wave_full_contact_pressure(E, height / 2, wave)
    one = scene((0.3 * full, 0.8 * full), face(64, 1e-5, 16 * D))
    for pressure in contact_of(one, WavyForm(height, lobes=2), 10 * wave, 2 * wave).pressure:
        row = pressure[pressure.shape[0] // 2]
        ratio = row.mean() / full
        touching = analytic.wave_contact_fraction(ratio)
        assert_allclose((row > 0).mean(), touching, atol=2 / (row.size / 2))
        # p = 2 p̄ cos ψ √(sin²ψa − sin²ψ)/sin²ψa at the crest, Johnson 1985, eq. 13.7
        assert_allclose(row.max(), 2 * ratio * full / np.sqrt(ratio), rtol=0.03)


def test_a_layer_of_springs_on_rigid_bodies_is_winkler_s():
    """s = s₀ − c p: cells within the approach δ have p = (δ − h)/c, others stand h − δ apart."""
    depth = np.random.default_rng(3).uniform(0, 3e-6, 16 * 24)
    body = HalfSpace((16, 24), (D, D), 1e25, ("free", "periodic"))
    cells = ContactPoints(body, np.ones((16, 24), bool), depth, np.inf)
    stiffness, free, none = 1e-14, 2e-6, np.zeros(depth.size)

    def layer(p):
        return free - stiffness * p, np.full(p.size, -stiffness)

    for approach in (0.5e-6, 1.5e-6, 4e-6):
        exact = np.maximum(approach - depth, 0.0) / stiffness
        apart = np.maximum(depth - approach, 0.0)
        p, separation, opening, _ = cells.solve(layer, exact.mean(), none, none)
        assert_allclose(p, exact, atol=1e-4 * exact.max())
        assert_allclose(opening, apart, atol=1e-9)
        assert_allclose(separation, free - stiffness * exact + apart, atol=1e-9)


def test_cells_of_one_depth_are_a_flat_punch_where_all_of_the_pressure_deforms_the_bodies():
    """On a stiff layer p/p̄ = 2/(π √(1 − (2x/b)²)); with rows, which carry it alike, they are pressed evenly."""
    count, breadth = 384, 2e-3
    spacing = breadth / count
    body = HalfSpace((count, 1), (spacing, spacing), E, ("free", "periodic"))
    inside, none = np.ones((count, 1), bool), np.zeros(count)

    def stiff(p):
        return np.zeros(p.size), np.full(p.size, -1e-20)

    punch = ContactPoints(body, inside, none, np.inf)
    even = ContactPoints(body, inside, none, np.inf, row=np.arange(count))
    x = (np.arange(count) + 0.5) / count * 2 - 1
    middle = np.abs(x) < 0.9
    exact = 1e6 * 2 / (np.pi * np.sqrt(1 - x**2))
    assert_allclose(punch.solve(stiff, 1e6, none, none)[0][middle], exact[middle], rtol=0.01)
    assert_allclose(even.solve(stiff, 1e6, none, none)[0], 1e6, rtol=1e-12)


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_crown_that_touches_all_over_adds_hertz_s_pressure_to_an_even_one(share):
    """Hertz: a band as broad as the seal has the peak E* b/4R and π/4 of it in the mean; all rows carry the rest."""
    breadth, radius = 1e-3, 0.2
    of_hertz = E * breadth / (4 * radius) * np.pi / 4
    one = scene((of_hertz / share,), face(64, 1e-6, 16 * D))
    (pressure,) = contact_of(one, CrownedSeat(radius), breadth, 2e-3).pressure
    x = (np.arange(len(pressure)) + 0.5) / len(pressure) * 2 - 1
    exact = of_hertz * (1 / share - 1 + 4 / np.pi * np.sqrt(1 - x**2))
    inside = np.abs(x) < 0.9
    assert_allclose(pressure[inside, 0], exact[inside], rtol=0.01)


@pytest.mark.parametrize("breadth", [0.4e-3, 2e-3])
def test_a_form_of_no_height_changes_nothing(breadth):
    """Neither the pressure of the tiles nor the leakage, of a seal that is pressed evenly without it."""
    one = scene((5e7, 2e8), hardness=2.8e9, unload_from=(2e8,), unloading=(5e7,))
    given = {"length": 0.4e-3, "realisations": 2, "seed": 1, "breadth": breadth}
    flat = fs.stochastic(one, (2, 2), fs.Sampling(**given)).leakage
    for height in (1e-13, 1e-11):
        form = (WavyForm(height, lobes=2),)
        assert (contact_of(one, form, breadth, 0.4e-3).pressure_fractions == 1).all()
        assert_allclose(fs.stochastic(one, (2, 2), fs.Sampling(**given, form=form)).leakage, flat)
    # it changes by no more than the interpolation between tabulated pressures, and then in proportion to the height
    small, more = (
        contact_of(one, (WavyForm(height, lobes=2),), breadth, 0.4e-3).pressure_fractions - 1
        for height in (4e-10, 8e-10)
    )
    assert 0 < np.abs(small).max() < 0.02
    assert_allclose(more, 2 * small, atol=0.1 * np.abs(more).max())


def around(radius, count):
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), angle


def test_the_highest_place_presses_hardest():
    """A bump at one side of a ring, and the opposite side stands apart."""
    points, angle = around(4.2e-3, 24)
    bump = MeasuredForm.from_points(points, 4e-6 * np.exp(-((angle - np.pi) ** 2)))
    contact = contact_of(scene((1e6,), layout=RING), bump)
    columns = contact.pressure.shape[2]
    for place in (contact.pressure[0].mean(axis=0).argmax(), contact.separation[0].mean(axis=0).argmin()):  # fmt: skip
        assert place == pytest.approx(columns / 2, abs=0.05 * columns)


@pytest.mark.parametrize("fraction", [0.9, 0.5, 0.2])
def test_the_layer_unloads_as_the_face_does(fraction):
    one = scene((5e7, 2e8), hardness=1.5e9, unload_from=(2e8,), unloading=(fraction * 2e8,))
    layer = RoughLayer.of(one, map)
    even = replace(one, boundary=("periodic", "periodic"))
    first, peak, down = even.contact_states(attrgetter("contact.mean_gap"), mapper=map)
    loaded = layer.on_loading(np.array([5e7, 2e8]))[0]
    assert_allclose(loaded, [first, peak], rtol=0.02)
    back = layer.on_unloading(np.array([fraction * 2e8]), np.array([2e8]))[0][0]
    assert_allclose(back, down, rtol=0.02)
    assert peak < back < layer.on_loading(np.array([fraction * 2e8]))[0][0]


@pytest.mark.parametrize("hardness", [np.inf, 1.5e9])
def test_the_layer_is_accurate_between_its_pressures(hardness):
    """Mean gaps in the middle between two pressures of the table, which are solved directly."""
    layer = RoughLayer.of(scene((5e7, 2e8), hardness=hardness), map)
    middle = np.sqrt(layer.pressure[1:-1] * layer.pressure[2:])[-4:]
    one = scene(middle.tolist(), hardness=hardness)
    even = replace(one, boundary=("periodic", "periodic"))
    gaps = list(even.contact_states(attrgetter("contact.mean_gap"), mapper=map))
    separation, slope = layer.on_loading(middle)
    touch = layer.separation[0, 0]
    assert_allclose(separation, gaps, rtol=0, atol=5e-3 * touch)
    # the derivative is that of the interpolation, by central differences
    high, low = (layer.on_loading(middle * (1 + e))[0] for e in (1e-5, -1e-5))
    assert_allclose(slope, (high - low) / (2e-5 * middle), rtol=1e-5)


def test_a_crown_that_has_yielded_all_over_its_band_is_flatter():
    """Bodies sink for good: back at a tenth of the load its highest pressure is less than on the way up."""
    way = {"unload_from": (2e7,), "unloading": (2e6,)}
    one = scene((2e6, 2e7), face(rms_slope=0.01), hardness=0.2e9, **way)
    contact = contact_of(one, CrownedSeat(0.005), 1e-3, 2e-3)
    assert contact.pressure[1].max() == pytest.approx(0.97 * 0.2e9)
    assert contact.pressure[2].max() < 0.85 * contact.pressure[0].max()


# invariants


def test_a_mesh_of_a_rectangle_presses_as_a_free_strip(tmp_path):
    """ContactPoints inside of the mesh alone, the same load, symmetric as the form."""
    plate = MeshQuad.init_tensor(np.linspace(0, 0.4, 9), np.linspace(0, 1.2, 25))
    low, high = (plate.facets_satisfying(lambda x, at=at: x[0] == at, True) for at in (0, 0.4))
    path = tmp_path / "plate.msh"
    write_gmsh(path, plate, **{"in": low, "out": high})
    layout = MeshLayout(path, "mm", "in", "out", lay="x2", centre=(0.2e-3, 0.6e-3))
    points = 1e-3 * np.stack(np.meshgrid(np.linspace(0, 0.4, 5), np.linspace(0, 1.2, 13)), axis=-1)
    points = points.reshape(-1, 2)
    crown = MeasuredForm.from_points(points, -((points[:, 1] - 0.6e-3) ** 2) / 0.2)
    contact = contact_of(scene((2e7,), layout=layout), crown)
    assert contact.grid.inside.all()
    pressure = contact.pressure[0]
    assert_allclose(pressure.mean(), 2e7, rtol=1e-4)
    assert_allclose(pressure, pressure[:, ::-1], rtol=0.02, atol=2e5)
    assert contact.pressure_fractions.shape == (1, plate.nelements)
    assert contact.pressure_fractions[0].max() > 1.5


# waves count once


def test_a_patch_loses_the_waves_that_a_dense_form_has():
    one = scene((1e7,))
    cut = Cut.of(one.surface, (4, 4))
    points = np.stack(np.meshgrid(np.arange(10), np.arange(10)), axis=-1).reshape(-1, 2) * 20 * D
    form = MeasuredForm.from_points(points, np.zeros(len(points)))
    kept = remove_waves_of_forms(one, cut, (form,)).surface
    assert_allclose(kept.low_pass(60 * D).rms_height, 0.0, atol=1e-15)
    assert_allclose(kept.heights, one.surface.high_pass(60 * D).heights)
    coarse = MeasuredForm.from_points(points * 20, np.zeros(len(points)))
    assert remove_waves_of_forms(one, cut, (coarse,)) is one
    assert remove_waves_of_forms(one, cut, (WavyForm(1e-6, lobes=2),)) is one


# seals drawn under a form


def drawn(one, form, **more):
    return fs.stochastic(one, (2, 2), fs.Sampling(None, 3, seed=1, form=form, **more))


NARROW = AnnularLayout(1e-3, 1.064e-3)


def test_a_wavy_ring_leaks_where_it_stands_apart_as_a_gap_of_that_height():
    """Waves so high that the roughness does not count: the cube of the gap between them."""
    one = scene((1e5, 2e7), face(rms_slope=1e-3), layout=NARROW)
    found = drawn(one, WavyForm(5e-6, lobes=2))
    fields = found.median_seal
    open_gap = np.mean(fields.separation**3, axis=1) / 12
    assert open_gap[1] < 0.9 * open_gap[0]
    assert_allclose(found.quantile(0.5), open_gap * 1e6 / 1e-3 / 64e-6, rtol=0.05)
    assert_allclose(np.ptp(fields.form), 5e-6, rtol=0.01)


def test_higher_waves_leak_more_and_the_load_presses_them_flat():
    """They touch less: the area rises ever more slowly with the pressure."""
    one = scene((2e6, 5e7, 4e8), layout=NARROW)
    forms = (WavyForm(height, lobes=2) for height in (1e-7, 1e-6, 4e-6))
    flat, *wavy = (drawn(one, form) for form in ((), *forms))
    leakage = np.array([result.quantile(0.5) for result in wavy])
    assert (np.diff(leakage[:, 0]) > 0).all()
    assert leakage[2, 0] > 10 * flat.quantile(0.5)[0]
    assert_allclose(leakage[0], flat.quantile(0.5), rtol=0.3)


def test_the_band_of_a_measured_form_is_one_of_its_own():
    """Waves and seats are known exactly."""
    points, angle = around(1.03e-3, 12)
    measured = MeasuredForm.from_points(points, 1e-7 * np.cos(2 * angle))
    forms = measured, WavyForm(1e-7, lobes=2), CrownedSeat(0.1), ()
    kinds = [drawn(scene((5e7,), layout=NARROW), form).kind for form in forms]
    assert kinds == ["with form", "at random", "at random", "in order"]


CASE = STRIP | {
    "seal": {"kind": "annular", "inner_radius": "1 mm", "outer_radius": "1.064 mm"},
    "stochastic": {"realisations": 2},
}
WAVES = {"kind": "waves", "height": "0.5 um", "lobes": 2}


def case_with(form, **more):
    return parse_case(CASE | {"seal": CASE["seal"] | {"form": form}} | more)


def test_a_case_gives_the_form_and_its_error_is_a_part_of_the_budget():
    results = fs.run(case_with(WAVES | {"tolerance": 0.2}), workers=1)
    data = results.dataset
    assert data["drawn_form"].dims == ("part",)
    assert data["drawn_nominal_pressure"].dims == data["drawn_separation"].dims == ("step", "part")
    assert (results.budget.widths()["form"] > 0.01).all()


MAP = {"load": CASE["load"] | {"map": {"kind": "angle", "fractions": [1, 2]}}}


@pytest.mark.parametrize(
    ("form", "more", "text"),
    [
        ({"kind": "waves", "height": "1 um"}, {}, "seal.form.lobes: given neither"),
        (
            WAVES,
            {"method": "deterministic", "seal": {"form": WAVES}},
            "seal.form: given a form with",
        ),
        (WAVES, MAP, "load.map: given a map with seal.form"),
        ({"path": "none.csv", "unit": "um"}, {}, r"seal\.form\.path: .*, expected a file that exi"),
        (WAVES | {"height": "1 mm", "lobes": 6}, {}, "form: given a seal .* with slopes up to"),
    ],
)
def test_bad_forms(form, more, text):
    with pytest.raises(fs.InputError, match=text):
        prepare(case_with(form, **more))


def test_a_form_and_a_map_are_refused_together():
    both = {"form": WavyForm(1e-6, lobes=2), "pressure_map": fs.seal.AngleTable((1.0, 2.0))}
    with pytest.raises(fs.InputError, match="form: given a form and also a pressure map"):
        fs.Sampling(1e-3, seed=1, **both)
