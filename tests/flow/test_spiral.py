"""Grooves that wind in a spiral: fluid follows them once the lands are closed."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

import femseal as fs
from femseal.case.case import parse_case
from femseal.flow.edge_flow import cell_stencil
from femseal.flow.grid import Grid
from femseal.flow.law import cubic_law
from femseal.flow.spiral import spiral_flow
from femseal.preparation import prepare
from femseal.seal.lay import Lay
from femseal.seal.layouts import AnnularLayout, MeshLayout, RectangularLayout
from femseal.seal.tiles import PieceSize
from femseal.studies import Sampling
from femseal.studies.drawn_study import stochastic

D = 1e-6
OIL = fs.Liquid(1e-3)


@pytest.mark.parametrize("across", [0.0, 1e-18, 3e-17])
@pytest.mark.parametrize("lead", [60e-6, 0.5e-3])
def test_the_closed_form_is_the_integral(across, lead):
    along, inner, outer = 2e-15, 2e-3, 2.6e-3

    def resistance(r):
        tangent = 2 * lead / (2 * np.pi * r)
        return 1 / (r * (across + along * tangent**2) / (1 + tangent**2))

    exact = 2 * np.pi / quad(resistance, inner, outer, epsrel=1e-12)[0]
    found = fs.analytic.turned_annulus_rate(along, across, 2 * lead, 1.0, 1.0, inner, outer)
    assert_allclose(found, exact, rtol=1e-9)


def test_a_ring_of_tiles_converges_to_the_closed_form():
    """Both permeabilities in their elements, turned by the angle of the spiral: of second order."""
    inner, outer, lead, across, along = 2e-3, 2.6e-3, 0.5e-3, 1e-18, 2e-16
    errors = []
    for n in (8, 16, 32):
        side = (outer - inner) / n
        layout = AnnularLayout(inner, outer, lay={"kind": "spiral", "lead": lead})
        tiles = layout.lay_out(PieceSize((side, 40 * side), n))
        k = tiles.permeability(np.full(tiles.count, across), np.full(tiles.count, along))
        exact = fs.analytic.turned_annulus_rate(along, across, lead, 1.0, 1.0, inner, outer)
        errors.append(abs(tiles.seal.flow(k, bounds=True).conductance / exact - 1))
    assert errors[2] < 1e-5
    assert errors[2] < errors[0] / 12


def window(n=16):
    """A piece of ridges along x2 that touch under load, with open valleys between them."""
    x = (np.arange(n) + 0.5) / n
    return np.repeat(1e-6 * np.cos(2 * np.pi * x)[:, None], n, axis=1)


def ridges():
    """A face of pieces in one row, so that all are alike: in more they reach into their neighbours' ridges."""
    return fs.Topography(np.tile(window(), (1, 4)), (D, D), (True, True))


def drawn(lay, load, length=2e-3):
    surface = ridges()
    scene = fs.Scene(surface, 115e9, 2e9, OIL, 1e6, 0.0, loading=(load,), fluid_pressure="ignored",
                     layout=RectangularLayout(lay))  # fmt: skip
    sampling = Sampling(length=length, breadth=128 * D, realisations=2, seed=1)
    return stochastic(scene, (1, 4), sampling)


def along(pieces):
    """Permeability along the grooves of pieces that are all alike, under the only load."""
    k = pieces.k[0, 1, 0]
    assert_allclose(k, k[0, 0], rtol=1e-6)
    return k[0, 0]


def test_a_closed_strip_leaks_along_its_groove():
    """Equal pieces: k₂ sin²α of the one that is closed across, as the pressure falls along x1 alone."""
    plain, wound = (
        drawn(lay, 2e8).leakage[0, 0] for lay in ("x2", {"kind": "spiral", "lead": "16 um"})
    )
    assert plain == 0
    k2 = along(drawn("x2", 2e8).pieces)
    sine2 = (16e-6 / np.hypot(16e-6, 2e-3)) ** 2
    assert_allclose(wound, k2 * sine2 * 1e6 / (1e-3 * 128e-6), rtol=1e-3)
    double = drawn({"kind": "spiral", "lead": "16 um", "starts": 2}, 2e8).leakage[0, 0]
    assert_allclose(double / wound, 4, rtol=1e-3)


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_a_closed_ring_leaks_along_its_groove(inlet):
    """Equal pieces: the closed form of a ring whose lands are closed, either way."""
    surface, lead = ridges(), 32e-6
    layout = AnnularLayout(
        0.5e-3, 0.756e-3, inlet, lay={"kind": "spiral", "lead": lead, "starts": 2}
    )
    scene = fs.Scene(
        surface, 115e9, 2e9, OIL, 1e6, 0.0, loading=(2e8,), fluid_pressure="ignored", layout=layout
    )
    found = stochastic(scene, (1, 4), Sampling(None, realisations=2, seed=1))
    k2 = along(found.pieces)
    exact = fs.analytic.turned_annulus_rate(k2, 0.0, 2 * lead, 1e6, 1e-3, 0.5e-3, 0.756e-3)
    assert_allclose(found.leakage[0, 0] * found.seal.length, exact, rtol=2e-3)


def test_circumferential_is_a_spiral_without_lead():
    for lay in ("circumferential", {"kind": "spiral", "lead": "0 um"}):
        assert RectangularLayout(lay) == RectangularLayout("x2")
        assert AnnularLayout(1e-3, 2e-3, lay=lay) == AnnularLayout(1e-3, 2e-3)


def test_directions_of_a_spiral():
    lay = Lay.of({"kind": "spiral", "lead": "0.5 mm", "starts": 2})
    assert str(lay) == "in a spiral of lead 1 mm"
    radii = np.array([[1e-3, 0.0], [0.0, 2e-3]])
    found = lay.directions(radii)
    assert_allclose(found[0, 0] / found[0, 1], 1e-3 / (2 * np.pi * 1e-3))
    assert_allclose(found[1, 1] / -found[1, 0], 1e-3 / (2 * np.pi * 2e-3))


def grooves(shape, pitch, land=-1e-7):
    """Gap of grooves along x2, closed on the lands unless `land` is positive."""
    x = np.arange(shape[0]) + 0.5
    profile = np.maximum(land - 1e-6 * np.cos(2 * np.pi * x / pitch), 0.0)
    return np.repeat(profile[:, None], shape[1], axis=1)


def plain(gap):
    return fs.cell_permeability(gap, (D, D), sides="periodic")


@pytest.mark.parametrize("circumference", [None, 1e-3])
def test_closed_lands_leave_the_way_along_the_groove(circumference):
    """k22 tan²α, to the links of the seam beyond the turns: of first order in the pixels of a turn."""
    errors = []
    for n2 in (32, 64, 128):
        gap = grooves((96, n2), 16)
        k, potential = spiral_flow(
            gap, (D, D), fs.flow.Spiral(16 * D, circumference), plain(gap).fluid_pressure
        )
        k22 = fs.cell_permeability(gap, (D, D), axis=1, sides="periodic").value
        exact = k22 * (16 * D / (circumference or n2 * D)) ** 2
        errors.append(1 - k / exact)
        assert np.nanmin(potential) >= 0
        assert np.nanmax(potential) <= 1
    assert_allclose(np.array(errors) * [6 * 32, 6 * 64, 6 * 128], 1.0, rtol=0.02)


def test_open_lands_add_to_the_grooves():
    gap = grooves((1024, 64), 16, land=1.2e-6)
    k11, k22 = plain(gap).value, fs.cell_permeability(gap, (D, D), axis=1, sides="periodic").value
    found = spiral_flow(gap, (D, D), fs.flow.Spiral(16 * D), plain(gap).fluid_pressure)[0]
    assert_allclose(found, k11 + k22 * (16 / 64) ** 2, rtol=2e-3)


def test_a_rough_face_one_turn_long_is_the_least_dissipation():
    """Against a dense minimum of the dissipation over all potentials, links written one by one."""
    n1, n2, shift = 9, 7, 3
    gap = np.maximum(np.random.default_rng(5).uniform(-0.4, 1, (n1, n2)), 0) * 1e-6
    found = spiral_flow(gap, (D, D), fs.flow.Spiral(shift * D), plain(gap).fluid_pressure)[0]
    stencil = cell_stencil(gap / gap.max(), Grid.of_pixel_centres((n1, n2), (1.0, 1.0), "periodic"))
    number = np.arange((n1 + 2) * n2).reshape(n1 + 2, n2)
    links = []
    for c, a, b, _ in stencil.conductances():
        links += zip(c.ravel(), a.ravel(), b.ravel(), strict=True)
    links = [
        (c, a, b)
        for c, a, b in links
        if not (a % n2 == n2 - 1 and b % n2 == 0 and a // n2 == b // n2)
    ]
    for i in range(1 - shift, n1 + 1):
        ends = [gap[k, column] for k, column in ((i - 1, -1), (i + shift - 1, 0)) if 0 <= k < n1]
        c = cubic_law(np.mean(ends) / gap.max()) if min(ends) > 0 else 0.0
        links.append((c, number[max(i, 0), -1], number[min(i + shift, n1 + 1), 0]))
    matrix = np.zeros((len(links), number.size))
    for k, (c, a, b) in enumerate(links):
        matrix[k, a], matrix[k, b] = np.sqrt(c), -np.sqrt(c)
    fixed, free = matrix[:, :n2].sum(axis=1), matrix[:, n2:-n2]
    residual = fixed + free @ np.linalg.lstsq(free, -fixed, rcond=None)[0]
    assert found > 0
    assert_allclose(found, gap.max() ** 3 * n1 / n2 * (residual @ residual), rtol=1e-7)


def test_a_part_of_a_turn_stands_for_all_of_it():
    """Rough grooves, closed lands: a face repeated 8 times around, against one of them with an eighth of the drop."""
    rng = np.random.default_rng(3)
    gap = grooves((128, 32), 16) * rng.uniform(0.3, 1, (128, 32))
    spiral = fs.flow.Spiral(16 * D, 8 * 32 * D)
    around, part = (
        spiral_flow(one, (D, D), spiral, plain(one).fluid_pressure)[0]
        for one in (np.tile(gap, (1, 8)), gap)
    )
    assert_allclose(part, around, rtol=0.02)


def test_a_blocked_groove_leaks_nothing():
    gap = grooves((64, 32), 16)
    gap[40, :] = gap[:, 5] = 0.0
    gap[30:50, 5] = 0.0
    found = spiral_flow(gap, (D, D), fs.flow.Spiral(16 * D), plain(gap).fluid_pressure)
    assert found[0] == 0.0


def test_a_lead_that_hardly_matters_is_left_out():
    gap = grooves((64, 32), 16, land=3e-6)
    assert spiral_flow(gap, (D, D), fs.flow.Spiral(16 * D, 0.1), plain(gap).fluid_pressure) is None
    assert spiral_flow(gap, (D, D), fs.flow.Spiral(16 * D), plain(gap).fluid_pressure) is not None


def whole(lay, **given):
    surface = fs.Topography(np.tile(window(), (6, 3)), (D, D), (False, True))
    given = {"loading": (2e8, 6e8), "fluid_pressure": "ignored"} | given
    return fs.Scene(surface, 115e9, 2e9, OIL, 1e6, 0.0, layout=RectangularLayout(lay), **given)


def test_studies_of_a_face_follow_its_groove():
    """Deterministic and two-scale: sealed as rings, k22 tan²α as a spiral; the fluid that acts opens it further."""
    lay = {"kind": "spiral", "lead": "16 um", "circumference": "1 mm"}
    assert not fs.deterministic(whole("x2")).leakage.any()
    found = fs.deterministic(whole(lay))
    k22 = [fs.cell_permeability(g, (D, D), axis=1, sides="periodic").value for g in found.gap]
    assert_allclose(
        found.leakage, np.array(k22) * (16e-6 / 1e-3) ** 2 * 1e6 / (1e-3 * 96e-6), rtol=0.25
    )
    assert_allclose(fs.two_scale(whole(lay), (6, 3)).leakage, found.leakage, rtol=1e-5)
    assert_allclose(fs.two_scale(whole(lay), (6, 3)).leakage, found.leakage, rtol=0.1)
    pressed = fs.deterministic(whole(lay, fluid_pressure="acts", loading=(2e7,))).leakage
    assert pressed > fs.deterministic(whole(lay, loading=(2e7,))).leakage


def test_a_face_may_be_any_fraction_of_a_turn():
    """Closed lands: the leakage falls as the square of the circumference, here 1 m and 100 m around 48 µm."""
    one, more = (
        fs.deterministic(whole({"kind": "spiral", "lead": "16 um", "circumference": c}))
        for c in ("1 m", "100 m")
    )
    assert_allclose(more.leakage, 1e-4 * one.leakage, rtol=1e-5)


def test_a_groove_that_is_filled_somewhere_leads_nowhere():
    lay = {"kind": "spiral", "lead": "16 um", "circumference": "1 mm"}
    scene = whole(lay)
    heights = scene.surface.heights.copy()
    heights[:, 20:30] = heights.max()
    filled = replace(scene, surface=fs.Topography(heights, (D, D), (False, True)))
    assert not fs.deterministic(filled).leakage.any()
    assert not fs.two_scale(filled, (6, 3)).leakage.any()


@pytest.mark.parametrize(
    ("solve", "text"),
    [
        (
            lambda lay: fs.deterministic(whole(lay | {"circumference": "10 um"})),
            "lay.circumference: given 10 µm",
        ),
        (
            lambda lay: fs.deterministic(whole(lay | {"lead": "96 um"})),
            "lay.lead: given 96 µm on a face 96 µm broad",
        ),
    ],
)
def test_spirals_that_a_face_cannot_follow(solve, text):
    with pytest.raises(fs.InputError, match=text):
        solve({"kind": "spiral", "lead": "16 um"})


def test_the_groove_of_a_row_is_as_open_as_its_tiles_in_turn():
    tiles = RectangularLayout({"kind": "spiral", "lead": "0.4 mm"}).lay_out(
        PieceSize((1e-3, 1e-3), 3, length=4e-3)
    )
    assert tiles.grid == (3, 4)
    assert_allclose(tiles.tangent, 0.1)
    open_along = np.random.default_rng(1).uniform(0.1, 1, (3, 4))
    across, _ = tiles.permeability(np.zeros(12), open_along.ravel()).T
    expected = np.repeat(0.01 / 1.01 / (1 / open_along).mean(axis=1), 4)
    assert_allclose(across, expected[tiles.tile])
    open_along[1, 2] = 0.0
    across, _ = tiles.permeability(np.zeros(12), open_along.ravel()).T
    assert not across[tiles.tile // 4 == 1].any()


CASE = """
method = "{method}"
[face]
{face}
[material]
young = "210 GPa"
poisson = 0.3
yield_stress = "1 GPa"
[load]
loading = ["100 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
[cells]
count = [2, 2]
[stochastic]
length = "12 mm"
{breadth}
[seal]
kind = "rectangular"
{lay}
"""
TURNED = 'kind = "turned"\npoints = [64, 64]\nsize = ["120 um", "120 um"]\npitch = "40 um"\ndepth = "1.5 um"'


@pytest.mark.parametrize(
    ("lay", "method", "breadth", "text"),
    [
        ("", "stochastic", "breadth = '1 mm'", "in a spiral of lead 40 µm"),
        ("", "deterministic", "", "in a spiral of lead 40 µm"),
        ("", "stochastic", "", "in a spiral of lead 40 µm"),
        ("lay = 'x2'", "stochastic", "", "x2"),
        (
            "lay = {kind = 'spiral', lead = '20 um'}",
            "deterministic",
            "",
            "in a spiral of lead 20 µm",
        ),
    ],
)
def test_a_turned_face_winds_with_its_pitch(tmp_path, lay, method, breadth, text):
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(face=TURNED, lay=lay, method=method, breadth=breadth))
    layout = prepare(fs.load_case(path)).scene.layout
    assert str(layout.lay) == text
    assert layout.lay.circumference == (None if text == "x2" else 12e-3)


@pytest.mark.parametrize(("lay", "asked"), [("", 1), ("lay = 'x2'", 0)])
def test_a_measured_face_with_grooves_is_asked_whether_they_wind(tmp_path, lay, asked):
    np.save(
        tmp_path / "face.npy",
        np.tile(window(32), (4, 4)) + 1e-8 * np.random.default_rng(0).normal(size=(128, 128)),
    )
    face = 'kind = "file"\npath = "face.npy"\nheight_unit = "m"\nspacing = ["2 um", "2 um"]'
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(face=face, lay=lay, method="deterministic", breadth=""))
    warnings = [w for w in prepare(fs.load_case(path)).warnings if "grooves along x2" in w]
    assert len(warnings) == asked
    if asked:
        assert "64 µm apart" in warnings[0]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (
            lambda: Lay.of({"kind": "spiral", "lead": "-1 um"}),
            "lay.lead: given '-1 um', expected a length >= 0",
        ),
        (lambda: Lay.of({"kind": "spiral", "lead": "1 um", "starts": 0}), "lay.starts: given 0"),
        (lambda: Lay.of({"kind": "spiral", "lead": "1 um", "turns": 2}), "lay: given"),
        (
            lambda: AnnularLayout(1e-3, 2e-3, lay={"kind": "spiral", "lead": "2 mm"}),
            "lay.lead: given 2 mm on a seal 1 mm",
        ),
        (
            lambda: MeshLayout("a.msh", "in", "out", "mm", {"kind": "spiral", "lead": "2 um"}),
            "lay: .* on a mesh",
        ),
        (
            lambda: drawn({"kind": "spiral", "lead": "1 mm"}, 1e8),
            "lay.lead: given 1 mm on a seal 128 µm broad",
        ),
    ],
)
def test_bad_spirals(make, text):
    with pytest.raises(fs.InputError, match=text):
        make()


def test_a_seal_that_leaks_along_its_grooves_alone_has_a_band():
    """Where all pieces are closed across, the change of their permeability to fewer pixels is not known."""
    case = {
        "method": "stochastic",
        "seed": 77,
        "face": {
            "kind": "turned",
            "points": [96, 64],
            "size": ["57.6 um", "38.4 um"],
            "pitch": "19.2 um",
            "depth": "0.817 um",
            "feed_error": 0.03,
            "depth_error": 0.1,
            "roughness": "0.2 um",
            "roughness_roll_off": "19.2 um",
        },
        "material": {"young": "200 GPa", "hardness": "2.4 GPa"},
        "load": {"loading": ["200 MPa", "300 MPa", "500 MPa"]},
        "contact": {"fluid_pressure": "ignored"},
        "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
        "seat": {"kind": "tilted", "tilt": "0.3 deg"},
        "cells": {"count": [2, 4]},
        "stochastic": {
            "length": "230.4 um",
            "realisations": 2,
            "breadth": "115.2 um",
        },
        "output": {"pictures": False},
    }
    results = fs.run(parse_case(case), workers=1)
    assert (results.leakage > 0).all()
    assert (results.budget.upper > results.leakage.values).all()
    assert (results.budget.lower < results.leakage.values).all()
