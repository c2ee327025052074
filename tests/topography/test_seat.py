"""Seats with a form: contact finds its own band, as Hertz's line contact does where the face is smooth."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.case.case import parse_case
from femseal.preparation import prepare
from femseal.results.selections import load_names
from femseal.studies.face_states import band_breadth
from femseal.studies.sampling import Sampling, laid_out
from femseal.studies.seal_contact import seal_contact
from femseal.topography.seat import (
    LEAST_DEPTH,
    BallOnCone,
    CrownedSeat,
    FlatSeat,
    ProfileSeat,
    RoundedSeat,
    TiltedSeat,
)

E, D = 115e9, 1e-6
OIL = fs.Liquid(1e-3)


def smooth(n1=1024, spacing=D):
    return fs.Topography(np.zeros((n1, 2)), (spacing, spacing), (False, True))


def rough(n1=1024, n2=256, rng=6):
    return fs.turned((n1, n2), (n1 * D, n2 * D), pitch=64 * D, depth=1.2e-6, feed_error=0.03, depth_error=0.1,
                     roughness=0.3e-6, roughness_roll_off=36 * D, cut_off=8 * D, rng=rng)  # fmt: skip


def solved(face, forces, hardness=np.inf, **given):
    breadth = face.size[0]
    scene = fs.Scene(face, E, hardness, OIL, 1e6, 0.0, loading=tuple(f / breadth for f in forces),
                     fluid_pressure="ignored", **given)  # fmt: skip
    return fs.deterministic(scene)


@pytest.mark.parametrize("radius", [0.05, 0.02])
@pytest.mark.parametrize("force", [50e3, 200e3])
def test_a_smooth_crown_is_hertz_s_line_contact(radius, force):
    """a² = 4 W R/(π E*), p₀ = 2 W/(π a)."""
    found = solved(CrownedSeat(radius).on(smooth()), [force], rtol=1e-8)
    half = np.sqrt(4 * force * radius / (np.pi * E))
    assert_allclose(found.band_breadth[0], 2 * half, atol=2 * D)
    assert_allclose(found.largest_row_pressure[0], 2 * force / (np.pi * half), rtol=0.01)
    x = (np.arange(1024) + 0.5 - 512) * D
    hertz = 2 * force / (np.pi * half) * np.sqrt(np.maximum(1 - (x / half) ** 2, 0))
    inside = np.abs(x) < 0.95 * half
    assert_allclose(found.row_pressure[0][inside], hertz[inside], atol=0.01 * hertz.max())
    assert_allclose(found.row_pressure[0].sum() * D, force, rtol=1e-6)


def test_the_half_width_converges_to_hertz_s():
    errors = []
    for n in (128, 256, 512):
        found = solved(CrownedSeat(0.02).on(smooth(n, 1.024e-3 / n)), [100e3], rtol=1e-8)
        half = np.sqrt(4 * 100e3 * 0.02 / (np.pi * E))
        errors.append(abs(found.largest_row_pressure[0] / (2 * 100e3 / (np.pi * half)) - 1))
    assert errors[2] < 0.5 * errors[0]
    assert errors[2] < 2e-3


def test_a_soft_crown_yields_all_over_its_band():
    """Far beyond first yield the band is about W/H broad."""
    hardness = 0.2e9
    found = solved(CrownedSeat(0.01).on(smooth()), [100e3], hardness)
    assert_allclose(found.largest_row_pressure[0], hardness, rtol=1e-6)
    assert_allclose(found.band_breadth[0], 100e3 / hardness, rtol=0.02)


def test_a_ball_on_a_cone_is_a_crown_of_its_radius_under_the_normal_force():
    """Its normal force per length is the axial one over the sine of half the angle."""
    ball, crown = BallOnCone(0.02, np.radians(30)), CrownedSeat(0.02)
    assert ball.load_factor == pytest.approx(2)
    one, other = (solved(seat.on(smooth()), [100e3]) for seat in (ball, crown))
    assert_allclose(one.row_pressure, other.row_pressure, atol=2e-3 * other.row_pressure.max())


def test_roughness_makes_the_band_broader_than_hertz_s():
    """Greenwood & Tripp's trend: the less, the higher the load."""
    face, radius = rough(1024, 64), 0.05
    forces = np.array([20e3, 50e3, 100e3, 200e3])
    found = solved(CrownedSeat(radius).on(face), forces)
    hertz = 2 * np.sqrt(4 * forces * radius / (np.pi * E))
    ratio = found.band_breadth / hertz
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
def test_form_decides_on_leakage_as_in_a_published_trial(radius):
    face = rough()
    forces = np.array([20e3, 50e3, 100e3, 200e3])[: len(TRIAL[radius])]
    found = solved((FlatSeat() if radius is None else CrownedSeat(radius)).on(face), forces, 2.8e9)
    assert_allclose(found.leakage * 1e-3 / 1e6 * 1e18, TRIAL[radius], rtol=0.03)


def test_other_forms():
    x = np.linspace(-5e-4, 5e-4, 11)
    assert (FlatSeat().depth(x, 1e-3) == 0).all()
    land = RoundedSeat(4e-4, 1e-2)
    assert_allclose(land.depth(x, 1e-3)[[0, 3, 5]], [(3e-4) ** 2 / 2e-2, 0, 0], atol=1e-20)
    assert_allclose(TiltedSeat(1e-3).depth(x, 1e-3), x * np.tan(1e-3))
    inlet, outlet = (
        solved(TiltedSeat(sign * 2e-3).on(smooth(256)), [20e3]).row_pressure[0] for sign in (1, -1)
    )
    assert inlet[:128].sum() > 0.99 * inlet.sum()  # the inlet's side is the higher one
    assert_allclose(outlet, inlet[::-1], rtol=1e-3, atol=1e-4 * inlet.max())


def test_a_profile_is_read_from_a_file(tmp_path):
    x = np.linspace(0, 1.2, 50)
    path = tmp_path / "seat profile.csv"
    path.write_text("x1, z\n" + "\n".join(f"{a},{-((a - 0.6) ** 2) / 100}" for a in x))
    face = smooth(512)
    found, crown = ProfileSeat(path, "mm").on(face), CrownedSeat(0.05).on(face)
    assert_allclose(found.heights, crown.heights, atol=2e-9)
    for text, message in (
        ("x1,z\n0,0\n", "expected a file of numbers"),
        ("a,b\n0,0\n1,1\n", "expected a file of numbers"),
        ("x1,z\n0,0\n0,1\n", "x1 rising"),
        ("x1,z\n0,0\n0.1,0\n", "as broad as the face"),
        ("x1,z\n0,zero\n1,1\n", "expected a file of numbers"),
    ):
        path.write_text(text)
        with pytest.raises(fs.InputError, match=message):
            ProfileSeat(path, "mm").on(face)


def test_a_form_that_is_nearly_flat_is_left_out():
    face = rough(256, 256)
    radius = (face.size[0] / 2) ** 2 / (2 * LEAST_DEPTH * face.rms_height)
    assert not CrownedSeat(1.1 * radius).matters(face)
    assert CrownedSeat(0.9 * radius).matters(face)
    forces = np.array([0.02, 0.08, 0.2]) * 2.8e9 * face.size[0]
    flat, formed = (
        solved(seat.on(face), forces, 2.8e9).leakage
        for seat in (FlatSeat(), CrownedSeat(1.1 * radius))
    )
    assert_allclose(formed, flat, rtol=5e-3)


CASE = {
    "method": "deterministic",
    "face": {
        "kind": "self-affine",
        "points": [128, 64],
        "size": ["128 um", "64 um"],
        "rms_slope": 0.1,
        "hurst": 0.8,
    },
    "material": {"young": "210 GPa", "hardness": "3 GPa"},
    "load": {"loading": ["2 N/mm", "10 N/mm"]},
    "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
}


@pytest.mark.parametrize(
    ("seat", "more", "text"),
    [
        ({"kind": "crowned", "radius": "-1 mm"}, {}, "seat.radius: given '-1 mm'"),
        ({"kind": "crowned"}, {}, "seat.radius"),
        ({"kind": "round"}, {}, "seat.kind"),
        (
            {"kind": "crowned", "radius": "0.1 mm"},
            {},
            "seat: given crowned with radius 100 µm with slopes up to 0.63",
        ),
        (
            {"kind": "ball-on-cone", "radius": "50 um", "angle": "45 deg"},
            {},
            "slopes up to vertical",
        ),
        ({"kind": "ball-on-cone", "radius": "5 mm", "angle": "120 deg"}, {}, "seat.angle: given"),
        ({"kind": "tilted", "tilt": "40 deg"}, {}, "slopes up to 0.84"),
        ({"kind": "profile", "path": "none.csv", "unit": "um"}, {}, "seat.path: given 'none.csv'"),
        (
            {"kind": "crowned", "radius": "5 mm"},
            {"contact": {"boundary": ["periodic", "periodic"]}},
            "contact.boundary: given periodic along x1 with a crowned seat, expected free along x1",
        ),
    ],
)
def test_bad_seats(seat, more, text):
    with pytest.raises(fs.InputError, match=text):
        prepare(parse_case(CASE | {"seat": seat} | more))


def test_a_measured_face_has_no_form_of_its_own(tmp_path):
    path = tmp_path / "face.csv"
    np.savetxt(path, rough(64, 64).heights * 1e6)
    face = {"kind": "file", "path": str(path), "height_unit": "um", "size": ["64 um", "64 um"]}
    crowned, tilted = {"kind": "crowned", "radius": "5 mm"}, {"kind": "tilted", "tilt": "0.1 deg"}
    for seat, detrend in ((crowned, 2), (tilted, 1), ({"kind": "flat"}, 1)):
        assert parse_case(CASE | {"face": face, "seat": seat}).surface.detrend == detrend
    assert parse_case(CASE | {"seat": crowned}).surface.detrend == 1
    assert parse_case(CASE | {"face": face, "surface": {"detrend": 0}}).surface.detrend == 0
    for seat, detrend in ((crowned, 1), (tilted, 0)):
        with pytest.raises(
            fs.InputError, match=f"surface.detrend: given {detrend} with a .* would count twice"
        ):
            parse_case(CASE | {"face": face, "seat": seat, "surface": {"detrend": detrend}})


def test_results_have_band_and_profile(tmp_path):
    case = parse_case(
        CASE | {"seat": {"kind": "crowned", "radius": "2 mm"}, "output": {"budget": False}}
    )
    assert prepare(case).seat == "crowned with radius 2 mm"
    data = fs.run(case, tmp_path / "out", workers=1).dataset
    assert data["row_pressure"].dims == ("step", "row")
    area = data["row_pressure"].values.sum(axis=1) * float(np.diff(data["row"].values[:2])[0])
    assert_allclose(area + data["fluid_carried_pressure"].values * 128e-6, [2e3, 10e3], rtol=1e-3)
    assert (np.diff(data["band_breadth"].values) > 0).all()
    assert load_names(data) == ["loading 2 N/mm (15.62 MPa)", "loading 10 N/mm (78.12 MPa)"]
    assert load_names(data.assign_attrs(case="{}"))[1] == "loading 78.12 MPa"
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "crowned with radius 2 mm" in page
    assert (tmp_path / "out" / "seat.png").read_bytes().startswith(b"\x89PNG")


def test_all_methods_take_a_seat():
    more = {"method": "stochastic", "compare": ["deterministic", "two-scale"], "seat": {"kind": "crowned", "radius": "2 mm"},
            "cells": {"count": [4, 2]}, "stochastic": {"length": "256 um", "realisations": 4}, "output": {"budget": False}}  # fmt: skip
    results = fs.run(parse_case(CASE | more), workers=1)
    assert_allclose(
        results.dataset["leakage_two_scale"], results.dataset["leakage_deterministic"], rtol=1e-6
    )
    assert_allclose(
        results.dataset["leakage_median"], results.dataset["leakage_deterministic"], rtol=0.5
    )
    ring = {"kind": "annular", "inner_radius": "1 mm", "outer_radius": "1.512 mm"}
    drawn = {"stochastic": {"realisations": 4}, "seal": ring}
    with pytest.raises(
        fs.InputError, match=r"seat\.kind: given a seal that takes pieces anywhere of the face"
    ):
        prepare(parse_case(CASE | more | drawn))


def patch(kind="self-affine", n=256, rng=11, rms_slope=0.2):
    if kind == "turned":
        return rough(n, n, rng)
    return fs.self_affine(
        (n, n),
        (n * D, n * D),
        hurst=0.75,
        rms_slope=rms_slope,
        roll_off=48 * D,
        cut_off=8 * D,
        rng=rng,
    )


class Rows(NamedTuple):
    """Mean pressure of rows at every step (steps, rows) [Pa], the breadth of the band that touches and of all [m]."""

    pressure: np.ndarray
    band: np.ndarray
    breadth: float


def rows_of(face, seat, forces, hardness=np.inf, breadth=1.024e-3, **given):
    """Contact of a seat broader than its face under forces per length."""
    loading = tuple(f / breadth for f in forces)
    scene = fs.Scene(
        face, E, hardness, OIL, 1e6, 0.0, loading=loading, fluid_pressure="ignored", **given
    )
    _, tiles = laid_out(
        face, scene.layout, None, Sampling(1e-3, seed=1, breadth=breadth, form=seat)
    )
    contact = seal_contact(scene, tiles, (seat,))
    return Rows(contact.rows, band_breadth(contact.rows, contact.grid.spacing[0]), breadth)


@pytest.mark.parametrize("radius", [0.05, 0.02])
def test_a_broad_seat_that_is_nearly_smooth_is_hertz_s_line_contact(radius):
    forces = np.array([50e3, 200e3])
    found = rows_of(patch(n=64, rms_slope=1e-4), CrownedSeat(radius), forces)
    half = np.sqrt(4 * forces * radius / (np.pi * E))
    assert_allclose(found.band, 2 * half, rtol=0.03)
    assert_allclose(found.pressure.max(axis=1), 2 * forces / (np.pi * half), rtol=0.01)
    assert_allclose(found.pressure.mean(axis=1), forces / 1.024e-3, rtol=1e-9)


def test_a_broad_seat_of_soft_metal_carries_no_more_than_its_hardness():
    """Fully plastic: the rows that carry more than half of it are W/H broad, to the 3 % below it where faces sink."""
    hardness, force = 0.3e9, 100e3
    found = rows_of(patch(n=64, rms_slope=0.01), CrownedSeat(0.01), [force], hardness)
    assert found.pressure.max() <= hardness
    assert found.pressure.max() > 0.96 * hardness
    assert_allclose(
        (found.pressure > 0.5 * hardness).mean() * found.breadth, force / hardness, rtol=0.05
    )


def test_a_broad_seat_comes_back_to_its_peak_and_keeps_its_band_on_the_way_down():
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
def test_both_ways_of_a_seat_spread_the_load_alike(radius):
    """The form on the heights of a broad face, and rows of a seat that a narrower face covers."""
    forces = np.array([50e3, 100e3, 200e3])
    whole = solved(CrownedSeat(radius).on(rough(1024, 128)), forces, 2.8e9).row_pressure
    rows = rows_of(rough(256, 128), CrownedSeat(radius), forces, 2.8e9).pressure

    def spread(p):
        x = (np.arange(p.shape[1]) + 0.5) / p.shape[1] - 0.5
        return np.sqrt((p * x**2).sum(axis=1) / p.sum(axis=1))

    assert_allclose(spread(rows), spread(whole), rtol=0.12 if radius == 0.05 else 0.1)


@pytest.mark.slow
def test_both_ways_of_a_seat_leak_alike():
    """Drawn seals over deterministic faces, as a fraction of the same for flat seats: 1 within 10 %.

    Under the sharpest crown whole faces scatter by a third: there it is 1 within three standard errors of their mean.
    """
    breadth, forces = 1.024e-3, np.array([50e3, 100e3, 200e3])
    given = {"loading": tuple(forces / breadth), "fluid_pressure": "ignored"}
    faces = [fs.self_affine((1024, 256), (breadth, 0.256e-3), hurst=0.75, rms_slope=0.2, roll_off=48 * D,
                            cut_off=8 * D, rng=rng) for rng in range(6, 30)]  # fmt: skip
    scene = fs.Scene(patch(n=512), E, 2.3e9, OIL, 1e6, 0.0, **given)

    def both(seat):
        whole = np.array(
            [fs.deterministic(replace(scene, surface=seat.on(face))).leakage for face in faces]
        )
        form = () if seat == FlatSeat() else seat
        sampling = fs.Sampling(length=8e-3, breadth=breadth, realisations=20, seed=1, form=form)
        # the band of the sharpest crown is two to five of these pieces broad
        return whole, fs.stochastic(scene, (8, 8), sampling).quantile(0.5)

    flat, of_flat = both(FlatSeat())
    for radius in (0.2, 0.05, 0.01):
        whole, drawn = both(CrownedSeat(radius))
        ratio = (drawn / whole.mean(axis=0)) / (of_flat / flat.mean(axis=0))
        scatter = (whole / whole.mean(axis=0) - flat / flat.mean(axis=0)).std(
            axis=0, ddof=1
        ) / np.sqrt(len(faces))
        assert (np.abs(ratio - 1) < np.maximum(0.1, 3 * scatter)).all()


BROAD = {
    "method": "stochastic",
    "face": {"kind": "self-affine", "points": [64, 64], "size": ["64 um", "64 um"], "hurst": 0.8, "rms_slope": 0.1,
             "roll_off": "32 um", "cut_off": "8 um"},
    "material": {"young": "210 GPa", "poisson": 0.3, "yield_stress": "1 GPa"},
    "load": {"loading": ["10 N/mm", "50 N/mm"]},
    "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
    "seat": {"kind": "crowned", "radius": "20 mm", "tolerance": 0.1},
    "cells": {"count": [2, 2]},
    "stochastic": {"length": "1 mm", "breadth": "0.5 mm", "realisations": 4},
}  # fmt: skip


def test_a_broad_seat_runs_from_a_case(tmp_path):
    results = fs.run(parse_case(BROAD), tmp_path)
    data = results.dataset
    assert_allclose(data["row_pressure"].mean("row"), [10e3 / 0.5e-3, 50e3 / 0.5e-3])
    assert_allclose(data["row"].values[[0, -1]].sum(), results.stochastic.seal.size[0])
    assert (data["band_breadth"].values < 0.5e-3).all()
    form = data["leakage_stochastic_budget_part_upper"].sel(budget_part="form")
    assert (form > data["leakage_median"]).all()
    assert "touches on a band" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "seat.png").is_file()
    assert not any("the body below" in text for text in results.warnings)


def test_a_body_that_yields_below_a_seat_is_warned_of():
    """Hertz: 0.3 GPa under 50 N/mm, more than 1.79 × 120 MPa."""
    softer = {
        "material": BROAD["material"] | {"yield_stress": "120 MPa"},
        "output": {"budget": False, "pictures": False},
    }
    (warning,) = (
        text
        for text in fs.run(parse_case(BROAD | softer), workers=1).warnings
        if "the body below" in text
    )
    assert "yields from 215 MPa on" in warning


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"method": "two-scale", "compare": ["stochastic"]},
            "seat.kind: given a seal that takes pieces anywhere of the face, with",
        ),
        (
            {"load": BROAD["load"] | {"map": {"kind": "profile", "fractions": [1, 2]}}},
            "load.map: given a map with a",
        ),
        ({"seat": {"kind": "crowned", "radius": "0.5 mm"}}, "slopes up to"),
    ],
)
def test_broad_seats_that_are_refused(change, text):
    with pytest.raises(fs.InputError, match=text):
        prepare(parse_case(BROAD | change))
