"""Seats with a form: contact finds its own band, as Hertz's line contact does where the face is smooth."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import STRIP, E, steel_scene

import femseal as fs
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.studies import Sampling, cut_and_cover
from femseal.studies.face_result import fields_of_rows
from femseal.studies.seal_contact import solve_seal_contact
from femseal.topography import (
    BallOnCone,
    CrownedSeat,
    FlatSeat,
    ProfileSeat,
    RoundedSeat,
    TiltedSeat,
)

D = 1e-6


def smooth(n1=1024, spacing=D):
    return fs.Topography(np.zeros((n1, 2)), (spacing, spacing), (False, True))


def rough(n1=1024, n2=256, rng=6):
    return fs.turned((n1, n2), (n1 * D, n2 * D), pitch=64 * D, depth=1.2e-6, feed_error=0.03, depth_error=0.1,
                     roughness=0.3e-6, roughness_roll_off=36 * D, cut_off=8 * D, rng=rng)  # fmt: skip


def solved(face, forces, hardness=np.inf, **given):
    loading = tuple(f / face.size[0] for f in forces)
    return fs.deterministic(steel_scene(face, hardness=hardness, loading=loading, **given))


def hertz(forces, radius):
    """Half of the breadth of the band [m], its largest pressure [Pa]."""
    half = np.sqrt(4 * np.asarray(forces) * radius / (np.pi * E))
    return half, 2 * np.asarray(forces) / (np.pi * half)


@pytest.mark.parametrize(("radius", "force"), [(0.05, 50e3), (0.05, 200e3), (0.02, 200e3)])
def test_a_smooth_crown_has_the_pressure_of_a_hertz_line_contact(radius, force):
    """a² = 4 W R/(π E*), p₀ = 2 W/(π a)."""
    found = solved(CrownedSeat(radius).add_to(smooth()), [force], rtol=1e-8)
    half, peak = hertz(force, radius)
    assert_allclose(found.band_breadth[0], 2 * half, atol=2 * D)
    assert_allclose(found.largest_row_pressure[0], peak, rtol=0.01)
    x = (np.arange(1024) + 0.5 - 512) * D
    inside = np.abs(x) < 0.95 * half
    expected = peak * np.sqrt(1 - (x[inside] / half) ** 2)
    assert_allclose(found.row_pressure[0][inside], expected, atol=0.01 * peak)
    assert_allclose(found.row_pressure[0].sum() * D, force, rtol=1e-6)


def test_the_peak_pressure_converges_to_that_of_hertz():
    seats = [CrownedSeat(0.02).add_to(smooth(n, 1.024e-3 / n)) for n in (128, 512)]
    peaks = [solved(seat, [100e3], rtol=1e-8).largest_row_pressure[0] for seat in seats]
    errors = np.abs(np.array(peaks) / hertz(100e3, 0.02)[1] - 1)
    assert errors[1] < min(0.5 * errors[0], 2e-3)


def test_a_soft_crown_yields_over_its_whole_contact_width():
    """Far beyond first yield the band is about W/H broad."""
    hardness = 0.2e9
    found = solved(CrownedSeat(0.01).add_to(smooth()), [100e3], hardness)
    assert_allclose(found.largest_row_pressure[0], hardness, rtol=1e-6)
    assert_allclose(found.band_breadth[0], 100e3 / hardness, rtol=0.02)


def test_a_ball_on_a_cone_equals_a_crown_under_the_normal_force():
    """Its normal force per length is the axial one over the sine of half the angle."""
    ball, crown = BallOnCone(0.02, np.radians(30)), CrownedSeat(0.02)
    assert ball.load_factor == pytest.approx(2)
    one, other = (solved(seat.add_to(smooth()), [100e3]) for seat in (ball, crown))
    assert_allclose(one.row_pressure, other.row_pressure, atol=2e-3 * other.row_pressure.max())


def test_roughness_makes_the_contact_wider_than_that_of_hertz():
    """Greenwood & Tripp's trend: the less, the higher the load."""
    forces = np.array([20e3, 50e3, 100e3, 200e3])
    found = solved(CrownedSeat(0.05).add_to(rough(1024, 64)), forces)
    ratio = found.band_breadth / (2 * hertz(forces, 0.05)[0])
    assert (ratio > 1).all()
    assert (np.diff(ratio) < 0.05).all()


#: k/L1 [1e-18 m²] of a published trial, by force per length [kN/m] and radius [m].
TRIAL = {
    None: [42.1, 19.1, 7.3, 1.07],
    0.2: [44.1, 20.3, 8.5, 2.0],
    0.05: [45.9, 16.1, 5.3, 1.07],
    0.01: [42.4, 8.7, 1.1],
}


@pytest.mark.parametrize(
    "radius", [0.05, *(pytest.param(r, marks=pytest.mark.slow) for r in (None, 0.2, 0.01))]
)
def test_the_form_changes_the_leakage_as_in_a_published_experiment(radius):
    face = rough()
    forces = np.array([20e3, 50e3, 100e3, 200e3])[: len(TRIAL[radius])]
    found = solved(
        (FlatSeat() if radius is None else CrownedSeat(radius)).add_to(face), forces, 2.8e9
    )
    assert_allclose(found.leakage * 1e-3 / 1e6 * 1e18, TRIAL[radius], rtol=0.03)


def test_depths_of_all_forms_agree_with_their_equations():
    x = np.linspace(-5e-4, 5e-4, 11)
    assert (FlatSeat().depth(x, 1e-3) == 0).all()
    land = RoundedSeat(4e-4, 1e-2)
    assert_allclose(land.depth(x, 1e-3)[[0, 3, 5]], [(3e-4) ** 2 / 2e-2, 0, 0], atol=1e-20)
    assert_allclose(TiltedSeat(1e-3).depth(x, 1e-3), x * np.tan(1e-3))
    inlet = solved(TiltedSeat(2e-3).add_to(smooth(256)), [20e3]).row_pressure[0]
    assert inlet[:128].sum() > 0.99 * inlet.sum()  # the inlet's side is the higher one


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x1,z\n0,0\n", "at least two lines of finite numbers"),
        ("x1,z\n0,0\n1,inf\n", "at least two lines of finite numbers"),
        ("a,b\n0,0\n1,1\n", "one column each of x1, z"),
        ("x1,z\n0,0\n0,1\n", "x1 rising"),
        ("x1,z\n0,0\n0.1,0\n", "at least as long as the face is wide"),
        ("x1,z\n0,zero\n1,1\n", "numbers with decimal points"),
        ("x1 z\n0,5 1,2\n9,5 1,3\n", "numbers with decimal points"),
        ("x1;z\n0,5;1,2\n9,5;1,3\n", "numbers with decimal points"),
        ("x1,z\n0,5,1,2\n9,5,1,3\n", "numbers with decimal points"),
    ],
)
def test_a_profile_is_read_from_a_file(tmp_path, text, message):
    x = np.linspace(0, 1.2, 50)
    path = tmp_path / "seat profile.csv"
    path.write_text("x1, z\n" + "\n".join(f"{a},{-((a - 0.6) ** 2) / 100}" for a in x))
    face = smooth(512)
    found, crown = ProfileSeat(path, "mm").add_to(face), CrownedSeat(0.05).add_to(face)
    assert_allclose(found.heights, crown.heights, atol=2e-9)
    path.write_text(text)
    with pytest.raises(fs.InputError, match=message):
        ProfileSeat(path, "mm").add_to(face)


def test_a_form_of_less_than_a_third_of_a_per_cent_of_the_roughness_changes_little():
    face = rough(256, 256)
    crown = CrownedSeat((face.size[0] / 2) ** 2 / (2 * 0.003 * face.rms_height))
    forces = np.array([0.02, 0.08, 0.2]) * 2.8e9 * face.size[0]
    flat, formed = (solved(s.add_to(face), forces, 2.8e9).leakage for s in (FlatSeat(), crown))
    assert_allclose(formed, flat, rtol=5e-3)


CASE = STRIP | {
    "method": "deterministic",
    "face": STRIP["face"] | {"points": [128, 64], "size": ["128 um", "64 um"], "rms_slope": 0.1},
    "load": {"loading": ["2 N/mm", "10 N/mm"]},
}


def crowned(radius, **more):
    return {"kind": "crowned", "radius": radius, **more}


#: A seat broader than its face.
BROAD = CASE | {
    "method": "stochastic",
    "face": STRIP["face"]
    | {"points": [64, 64], "size": ["64 um", "64 um"], "rms_slope": 0.1, "cut_off": "8 um"},
    "material": {"young": "210 GPa", "poisson": 0.3, "yield_stress": "1 GPa"},
    "load": {"loading": ["10 N/mm", "50 N/mm"]},
    "seat": crowned("20 mm", tolerance=0.1),
    "cells": {"count": [2, 2]},
    "stochastic": {"length": "1 mm", "breadth": "0.5 mm", "realisations": 4},
}

BALL = {"kind": "ball-on-cone", "radius": "50 um", "angle": "45 deg"}
POINT = BALL | {"radius": "0.1 um"}

PROFILE = {"kind": "profile", "path": "none.csv", "unit": "um"}

RING = {"kind": "annular", "inner_radius": "1 mm", "outer_radius": "1.512 mm"}

UNEVEN = {"map": {"kind": "profile", "fractions": [1, 2]}}


@pytest.mark.parametrize(
    ("case", "change", "text"),
    [
        (CASE, {"seat": crowned("-1 mm")}, "seat.radius: given '-1 mm'"),
        (CASE, {"seat": {"kind": "crowned"}}, "seat.radius"),
        (CASE, {"seat": {"kind": "round"}}, "seat.kind"),
        (CASE, {"seat": crowned("0.1 mm")}, "seat: given crowned.* with slopes up to 0.63"),
        (CASE, {"seat": BALL}, "slopes up to vertical"),
        (BROAD, {"seat": BALL}, "form: given a seal .* with slopes up to vertical"),
        (CASE, {"seat": POINT}, "seat: given ball-on-cone.* with no known height"),
        (BROAD, {"seat": POINT}, "form: given a seal .* with no known height"),
        (CASE, {"seat": BALL | {"angle": "120 deg"}}, "seat.angle: given"),
        (CASE, {"seat": {"kind": "tilted", "tilt": "40 deg"}}, "slopes up to 0.84"),
        (CASE, {"seat": PROFILE}, "seat.path: given 'none.csv'"),
        (
            CASE,
            {"seat": crowned("5 mm"), "contact": {"boundary": ["periodic", "periodic"]}},
            "contact.boundary: given periodic along x1 with a crowned seat, expected free along x1",
        ),
        (BROAD, {"method": "two-scale", "compare": ["stochastic"]}, "seat.kind: given a seal that"),
        (BROAD, {"load": BROAD["load"] | UNEVEN}, "load.map: given a map with a"),
        (BROAD, {"seat": crowned("0.5 mm")}, "slopes up to"),
        (
            BROAD,
            {"seal": RING, "stochastic": {"realisations": 4}, "compare": ["deterministic"]},
            "seat.kind: given a seal that takes cells from anywhere",
        ),
    ],
)
def test_invalid_seats_are_refused(case, change, text):
    with pytest.raises(fs.InputError, match=text):
        prepare(parse_case(case | change))


def test_the_form_of_a_measured_surface_is_removed_before_a_seat_is_added(tmp_path):
    path = tmp_path / "face.csv"
    np.savetxt(path, rough(64, 64).heights * 1e6)
    face = {"kind": "file", "path": str(path), "height_unit": "um", "size": ["64 um", "64 um"]}
    file, tilted = CASE | {"face": face}, {"kind": "tilted", "tilt": "0.1 deg"}
    for case, seat, detrend in (
        (file, crowned("5 mm"), 2),
        (file, tilted, None),
        (file, {"kind": "flat"}, None),
        (CASE, crowned("5 mm"), None),
    ):
        assert parse_case(case | {"seat": seat}).surface.detrend == detrend
    for seat, detrend in ((crowned("5 mm"), 1), (tilted, 0)):
        said = f"surface.detrend: given {detrend} with a .* would count twice"
        with pytest.raises(fs.InputError, match=said):
            parse_case(file | {"seat": seat, "surface": {"detrend": detrend}})


def test_results_contain_contact_width_and_pressure_profile():
    case = parse_case(CASE | {"seat": crowned("2 mm"), "output": {"budget": False}})
    data = fs.run(case, workers=1).dataset
    assert data["row_pressure"].dims == ("step", "row")
    carried = data["row_pressure"].values.mean(axis=1) + data["fluid_carried_pressure"].values
    assert_allclose(carried * 128e-6, [2e3, 10e3], rtol=1e-3)
    assert (np.diff(data["band_breadth"].values) > 0).all()


def test_all_methods_accept_a_seat():
    more = {
        "method": "stochastic",
        "compare": ["deterministic", "two-scale"],
        "seat": crowned("2 mm"),
        "cells": {"count": [4, 2]},
        "stochastic": {"length": "256 um", "realisations": 4},
        "output": {"budget": False},
    }
    data = fs.run(parse_case(CASE | more), workers=1).dataset
    assert_allclose(data["leakage_two_scale"], data["leakage_deterministic"], rtol=1e-6)
    assert_allclose(data["leakage_median"], data["leakage_deterministic"], rtol=0.5)


def patch(n=256, rms_slope=0.2):
    given = {"hurst": 0.75, "rms_slope": rms_slope, "roll_off": 48 * D, "cut_off": 8 * D}
    return fs.self_affine((n, n), (n * D, n * D), **given, rng=11)


class Rows(NamedTuple):
    """Mean pressure of rows at every step (steps, rows) [Pa], the breadth of the band that touches and of all [m]."""

    pressure: np.ndarray
    band: np.ndarray
    breadth: float


def rows_of(face, seat, forces, hardness=np.inf, breadth=1.024e-3, **given):
    """Contact of a seat broader than its face under forces per length."""
    loading = tuple(f / breadth for f in forces)
    scene = steel_scene(face, hardness=hardness, loading=loading, **given)
    sampling = Sampling(1e-3, seed=1, breadth=breadth, form=seat)
    _, tiles = cut_and_cover(face, scene.layout, None, sampling)
    contact = solve_seal_contact(scene, tiles, (seat,))
    return Rows(
        contact.row_pressure,
        fields_of_rows(contact.row_pressure, contact.grid.spacing[0])["band_breadth"],
        breadth,
    )


@pytest.mark.parametrize("radius", [0.05, 0.02])
def test_a_broad_and_nearly_smooth_seat_is_a_hertz_line_contact(radius):
    forces = np.array([50e3, 200e3])
    found = rows_of(patch(n=64, rms_slope=1e-4), CrownedSeat(radius), forces)
    half, peak = hertz(forces, radius)
    assert_allclose(found.band, 2 * half, rtol=0.03)
    assert_allclose(found.pressure.max(axis=1), peak, rtol=0.01)
    assert_allclose(found.pressure.mean(axis=1), forces / 1.024e-3, rtol=1e-9)


def test_a_broad_seat_of_soft_metal_carries_no_more_than_its_hardness():
    """Fully plastic: the rows that carry more than half of it are W/H broad, to the 3 % below it where faces sink."""
    hardness, force = 0.3e9, 100e3
    found = rows_of(patch(n=64, rms_slope=0.01), CrownedSeat(0.01), [force], hardness)
    assert 0.96 * hardness < found.pressure.max() <= hardness
    broad = (found.pressure > 0.5 * hardness).mean() * found.breadth
    assert_allclose(broad, force / hardness, rtol=0.05)


def test_a_broad_seat_returns_to_its_peak_and_keeps_its_contact_width_on_unloading():
    """Elastic: loading again; plastic: a band that is smoother on the way down, so that it is narrower."""
    breadth, forces = 1.024e-3, [50e3, 100e3, 200e3]
    peak, stops = 200e3 / breadth, (200e3 / breadth, 100e3 / breadth, 50e3 / breadth)
    way = {"unload_from": (peak,), "unloading": stops}
    elastic, plastic = (
        rows_of(patch(n=128), CrownedSeat(0.02), forces, h, **way) for h in (np.inf, 2e9)
    )
    assert_allclose(elastic.pressure[3:], elastic.pressure[1::-1], rtol=1e-4, atol=1e3)
    assert (plastic.pressure[3].max() > plastic.pressure[1].max()).all()
    assert (plastic.band[3:] <= plastic.band[1::-1]).all()


@pytest.mark.parametrize("radius", [0.2, 0.05, 0.01])
def test_both_calculations_of_a_seat_distribute_the_load_alike(radius):
    """The form on the heights of a broad face, and rows of a seat that a narrower face covers."""
    forces = np.array([50e3, 100e3, 200e3])
    whole = solved(CrownedSeat(radius).add_to(rough(1024, 128)), forces, 2.8e9).row_pressure
    rows = rows_of(rough(256, 128), CrownedSeat(radius), forces, 2.8e9).pressure

    def spread(p):
        x = (np.arange(p.shape[1]) + 0.5) / p.shape[1] - 0.5
        return np.sqrt((p * x**2).sum(axis=1) / p.sum(axis=1))

    assert_allclose(spread(rows), spread(whole), rtol=0.12 if radius == 0.05 else 0.1)


@pytest.mark.slow
def test_both_calculations_of_a_seat_give_the_same_leakage():
    """Drawn seals over deterministic faces, as a fraction of the same for flat seats: 1 within 10 %.

    Under the sharpest crown whole faces scatter by a third: there it is 1 within three standard errors of their mean.
    """
    breadth, forces = 1.024e-3, np.array([50e3, 100e3, 200e3])
    given = {"hurst": 0.75, "rms_slope": 0.2, "roll_off": 48 * D, "cut_off": 8 * D}
    faces = [fs.self_affine((1024, 256), (breadth, 0.256e-3), **given, rng=n) for n in range(6, 30)]
    scene = steel_scene(patch(n=512), hardness=2.3e9, loading=tuple(forces / breadth))

    def both(seat, form):
        whole = [
            fs.deterministic(replace(scene, surface=seat.add_to(face))).leakage for face in faces
        ]
        sampling = fs.Sampling(length=8e-3, breadth=breadth, realisations=20, seed=1, form=form)
        # the band of the sharpest crown is two to five of these cells broad
        drawn = fs.stochastic(scene, (8, 8), sampling).quantile(0.5)
        mean = np.mean(whole, axis=0)
        return drawn / mean, whole / mean

    flat, of_flat = both(FlatSeat(), ())
    for radius in (0.2, 0.05, 0.01):
        found, whole = both(CrownedSeat(radius), CrownedSeat(radius))
        scatter = (whole - of_flat).std(axis=0, ddof=1) / np.sqrt(len(faces))
        assert (np.abs(found / flat - 1) < np.maximum(0.1, 3 * scatter)).all()


def test_a_broad_seat_runs_from_a_case():
    results = fs.run(parse_case(BROAD), workers=1)
    data = results.dataset
    assert_allclose(data["row_pressure"].mean("row"), [10e3 / 0.5e-3, 50e3 / 0.5e-3])
    assert_allclose(data["row"].values[[0, -1]].sum(), results.stochastic.seal.size[0])
    assert (data["band_breadth"].values < 0.5e-3).all()
    form = data["leakage_stochastic_budget_part_upper"].sel(budget_part="form")
    assert (form > data["leakage_median"]).all()
    assert not any("the body below" in text for text in results.warnings)


def test_a_warning_says_that_the_body_below_a_seat_yields():
    """Hertz: 0.3 GPa under 50 N/mm, more than 1.79 × 120 MPa."""
    soft = {"material": BROAD["material"] | {"yield_stress": "120 MPa"}}
    results = fs.run(parse_case(BROAD | soft | {"output": {"budget": False}}), workers=1)
    (warning,) = (text for text in results.warnings if "the body below" in text)
    assert "yields from 215 MPa on" in warning
