"""Grooves that wind in a spiral: fluid follows them once the lands are closed."""

from dataclasses import replace

import numpy as np
import pytest
from networks import cell_links
from numpy.testing import assert_allclose
from scipy.integrate import quad

import femseal as fs
from femseal.flow.law import cubic_law
from femseal.flow.spiral import spiral_flow
from femseal.preparation import prepare
from femseal.seal import AnnularLayout, MeshLayout, RectangularLayout
from femseal.seal.layouts import parse_lay
from femseal.seal.tiles import CellSize
from femseal.studies import Sampling, stochastic

D = 1e-6
OIL = fs.Liquid(1e-3)


@pytest.mark.parametrize(
    ("along", "across"),
    [
        (2e-15, 0.0),
        (2e-15, 1e-27),
        (2e-15, 1e-18),
        (2e-15, 3e-17),
        (2e-15, 2e-15),
        (1e-27, 2e-15),
        (0.0, 2e-15),
    ],
)
@pytest.mark.parametrize("lead", [60e-6, 0.5e-3, 20e-3])
def test_the_closed_form_is_the_integral(along, across, lead):
    inner, outer = 2e-3, 2.6e-3

    def resistance(r):
        tangent = 2 * lead / (2 * np.pi * r)
        return 1 / (r * (across + along * tangent**2) / (1 + tangent**2))

    exact = 2 * np.pi / quad(resistance, inner, outer, epsrel=1e-12)[0]
    found = fs.analytic.turned_annulus_rate(along, across, 2 * lead, 1.0, 1.0, inner, outer)
    assert_allclose(found, exact, rtol=1e-9)


@pytest.mark.parametrize(("along", "lead"), [(0.0, 1e-3), (2e-15, 0.0)])
def test_nothing_flows_through_a_ring_that_is_closed_across_the_grooves(along, lead):
    assert fs.analytic.turned_annulus_rate(along, 0.0, lead, 1.0, 1.0, 2e-3, 2.6e-3) == 0


def test_a_ring_of_tiles_converges_to_the_closed_form():
    """Both permeabilities in their elements, turned by the angle of the spiral: of second order."""
    inner, outer, lead, across, along = 2e-3, 2.6e-3, 0.5e-3, 1e-18, 2e-16
    errors = []
    for n in (8, 16, 32):
        side = (outer - inner) / n
        layout = AnnularLayout(inner, outer, lay={"kind": "spiral", "lead": lead})
        tiles = layout.lay_out(CellSize((side, 40 * side), n))
        k = tiles.permeability(np.full(tiles.count, across), np.full(tiles.count, along))
        exact = fs.analytic.turned_annulus_rate(along, across, lead, 1.0, 1.0, inner, outer)
        errors.append(abs(tiles.seal.flow(k, bounds=True).conductance / exact - 1))
    assert errors[2] < 1e-5
    assert errors[2] < errors[0] / 12


def window(n=16):
    """A cell of ridges along x2 that touch under load, with open valleys between them."""
    x = (np.arange(n) + 0.5) / n
    return np.repeat(1e-6 * np.cos(2 * np.pi * x)[:, None], n, axis=1)


def ridges():
    """A face of cells in one row, so that all are alike: in more they reach into their neighbours' ridges."""
    return fs.Topography(np.tile(window(), (1, 4)), (D, D), (True, True))


def drawn(lay, load=2e8, length=2e-3):
    scene = scene_of(ridges(), RectangularLayout(lay), loading=(load,))
    sampling = Sampling(length=length, breadth=128 * D, realisations=2, seed=1)
    return stochastic(scene, (1, 4), sampling)


def scene_of(surface, layout, **given):
    given = {"fluid_pressure": "ignored"} | given
    return fs.Scene(surface, 115e9, 2e9, OIL, 1e6, 0.0, layout=layout, **given)


def along(cells):
    """Permeability along the grooves of cells that are all alike, under the only load."""
    k = cells.k[0, 1, 0]
    assert_allclose(k, k[0, 0], rtol=1e-6)
    return k[0, 0]


def test_a_closed_strip_leaks_along_its_groove():
    """Equal cells: k₂ sin²α of the one that is closed across, as the pressure falls along x1 alone."""
    plain, wound, double = (drawn(lay) for lay in ("x2", SPIRAL, SPIRAL | {"starts": 2}))
    assert plain.leakage[0, 0] == 0
    sine2 = (16e-6 / np.hypot(16e-6, 2e-3)) ** 2
    exact = along(plain.cells) * sine2 * 1e6 / (1e-3 * 128e-6)
    assert_allclose(wound.leakage[0, 0], exact, rtol=1e-3)
    assert_allclose(double.leakage[0, 0], 4 * exact, rtol=2e-3)


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_a_closed_ring_leaks_along_its_groove(inlet):
    """Equal cells: the closed form of a ring whose lands are closed, either way."""
    lay = {"kind": "spiral", "lead": 32e-6, "starts": 2}
    scene = scene_of(ridges(), AnnularLayout(0.5e-3, 0.756e-3, inlet, lay=lay), loading=(2e8,))
    found = stochastic(scene, (1, 4), Sampling(None, realisations=2, seed=1))
    k2 = along(found.cells)
    exact = fs.analytic.turned_annulus_rate(k2, 0.0, 64e-6, 1e6, 1e-3, 0.5e-3, 0.756e-3)
    assert_allclose(found.leakage[0, 0] * found.seal.length, exact, rtol=2e-3)


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
    """Against a dense minimum of the dissipation over all potentials, with the links of the seam written out."""
    n1, n2, shift = 9, 7, 3
    gap = np.maximum(np.random.default_rng(5).uniform(-0.4, 1, (n1, n2)), 0)
    c1, c2 = cell_links(gap, (1.0, 1.0), "periodic")
    node = np.arange((n1 + 2) * n2).reshape(n1 + 2, n2)
    # along, across but for the seam, and over the seam `shift` rows onwards
    row = np.arange(1 - shift, n1 + 1)
    last, first = (
        np.where((k >= 0) & (k < n1), gap[np.clip(k, 0, n1 - 1), column], np.nan)
        for k, column in ((row - 1, -1), (row + shift - 1, 0))
    )
    closed = (last == 0) | (first == 0)
    seam = np.where(closed, 0.0, cubic_law(np.nanmean([last, first], axis=0)))
    c = np.r_[c1.ravel(), c2[:, :-1].ravel(), seam]
    over = node[np.maximum(row, 0), -1], node[np.minimum(row + shift, n1 + 1), 0]
    a = np.r_[node[:-1].ravel(), node[1:-1, :-1].ravel(), over[0]]
    b = np.r_[node[1:].ravel(), node[1:-1, 1:].ravel(), over[1]]
    matrix = np.zeros((c.size, node.size))
    matrix[np.arange(c.size), a], matrix[np.arange(c.size), b] = np.sqrt(c), -np.sqrt(c)
    fixed, free = matrix[:, :n2].sum(axis=1), matrix[:, n2:-n2]
    residual = fixed + free @ np.linalg.lstsq(free, -fixed, rcond=None)[0]
    gap = 1e-6 * gap
    found = spiral_flow(gap, (D, D), fs.flow.Spiral(shift * D), plain(gap).fluid_pressure)[0]
    assert found > 0
    assert_allclose(found, 1e-18 * n1 / n2 * (residual @ residual), rtol=1e-7)


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
    return scene_of(surface, RectangularLayout(lay), **{"loading": (2e8, 6e8)} | given)


def test_studies_of_a_face_follow_its_groove():
    """Deterministic and two-scale: sealed as rings, k22 tan²α as a spiral; the fluid that acts opens it further."""
    lay = SPIRAL | {"circumference": "1 mm"}
    assert not fs.deterministic(whole("x2")).leakage.any()
    found = fs.deterministic(whole(lay))
    k22 = [fs.cell_permeability(g, (D, D), axis=1, sides="periodic").value for g in found.gap]
    exact = np.array(k22) * (16e-6 / 1e-3) ** 2 * 1e6 / (1e-3 * 96e-6)
    assert_allclose(found.leakage, exact, rtol=0.25)
    assert_allclose(fs.two_scale(whole(lay), (6, 3)).leakage, found.leakage, rtol=1e-5)
    # closed lands: the leakage falls as the square of the circumference
    longer = fs.deterministic(whole(SPIRAL | {"circumference": "10 m"}))
    assert_allclose(
        longer.leakage,
        1e-4 * fs.deterministic(whole(SPIRAL | {"circumference": "0.1 m"})).leakage,
        rtol=1e-5,
    )
    pressed = fs.deterministic(whole(lay, fluid_pressure="acts", loading=(2e7,))).leakage
    assert pressed > fs.deterministic(whole(lay, loading=(2e7,))).leakage
    scene = whole(lay)
    heights = scene.surface.heights.copy()
    heights[:, 20:30] = heights.max()
    filled = replace(scene, surface=fs.Topography(heights, (D, D), (False, True)))
    assert not fs.deterministic(filled).leakage.any()
    assert not fs.two_scale(filled, (6, 3)).leakage.any()


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
SPIRAL = {"kind": "spiral", "lead": "16 um"}


@pytest.mark.parametrize(
    ("lay", "lead"),
    [("", "40 µm"), ("lay = 'x2'", ""), ("lay = {kind = 'spiral', lead = '20 um'}", "20 µm")],
)
def test_a_turned_face_winds_with_its_pitch(tmp_path, lay, lead):
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(face=TURNED, lay=lay, method="stochastic", breadth=""))
    found = prepare(fs.load_case(path)).scene.layout.lay
    assert str(found) == (f"in a spiral of lead {lead}" if lead else "x2")
    assert found.circumference == (12e-3 if lead else None)


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
    ("make", "changed", "text"),
    [
        (parse_lay, {"lead": "-1 um"}, "lay.lead: given '-1 um', expected a length >= 0"),
        (parse_lay, {"starts": 0}, "lay.starts: given 0"),
        (parse_lay, {"turns": 2}, "lay: given"),
        (lambda lay: AnnularLayout(1e-3, 2e-3, lay=lay), {"lead": "2 mm"}, "lay.lead: .* 1 mm"),
        (lambda lay: AnnularLayout(1e-3, 2e-3, lay=lay), {"lead": "1 mm"}, "less than the width"),
        (lambda lay: MeshLayout("a.msh", "in", "out", "mm", lay), {}, "lay: .* on a mesh"),
        (drawn, {"lead": "1 mm"}, "lay.lead: given 1 mm on a seal 128 µm wide"),
        (
            lambda lay: fs.deterministic(whole(lay)),
            {"circumference": "10 um"},
            "circumference: given 10",
        ),
        (
            lambda lay: fs.deterministic(whole(lay)),
            {"lead": "96 um"},
            "lay.lead: given 96 µm on a face 96",
        ),
    ],
)
def test_bad_spirals(make, changed, text):
    with pytest.raises(fs.InputError, match=text):
        make(SPIRAL | changed)
