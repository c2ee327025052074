"""Findings of others come out: measured by the benchmark `outside_references`, on smaller grids."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import peers
from references import (
    bearing,
    critical_area,
    cut_faces,
    finishes,
    handbook,
    open_area,
    programs,
    rock_fractures,
    saddle,
    theories,
    turned_copper,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def softened():
    return bearing.bearing_area(n=128)


class TestBearingArea:
    """A material that is soft beside its slopes is cut off at the height of bearing area p̄/H."""

    def test_contact_is_the_bearing_area(self, softened):
        for r in softened:
            if r["H/E*h′"] <= 1e-3:
                assert_allclose(r["area"], 1, rtol=2e-3)
                assert r["wrong"] < 2e-3

    def test_the_gap_differs_in_proportion_to_hardness(self, softened):
        # below 1e-3 the sorted heights of the pixels are no denser than the difference
        for share in {r["p̄/H"] for r in softened}:
            gap = {r["H/E*h′"]: r["gap"] for r in softened if r["p̄/H"] == share}
            assert_allclose(np.log10(gap[0.1] / gap[1e-3]), 2, atol=0.3)

    def test_a_hard_material_is_not_cut_off(self, softened):
        assert all(r["area"] > 1.1 for r in softened if r["H/E*h′"] == 1)


def test_resistance_of_a_saddle_point_near_closing():
    """R ∝ (L_c − L)^−3.45: Dapp & Müser, EPL 109, 2015, 44001."""
    found = saddle.saddle_point(n=512, nearest=1.5e-3)
    assert_allclose(found["corrected"], 3.45, atol=0.05)
    assert_allclose(found["nearest"], 3.45, atol=0.1)


class TestCriticalArea:
    """Dapp, Lücke, Persson & Müser 2012; Wang & Müser, Tribol. Lett. 69, 2021, 1."""

    def test_elastic_isotropic_faces_close_near_two_fifths(self):
        found = critical_area.critical_area(sizes=((2, 60), (4, 40), (8, 6)))
        off = 0.02 + 2 * found["error"]
        assert_allclose(found["extrapolated"], critical_area.CLAIMED, atol=off)
        assert found["error"] < 0.015
        assert np.all(np.diff(found["spread"]) < 0)

    def test_undeformed_faces_close_at_more(self):
        # heights are as likely as depths: an infinite face that is cut off closes at one half
        truncated = critical_area.truncated_areas(8, 12).mean(axis=1)
        assert_allclose(truncated.mean(), 0.5, atol=3 * truncated.std() / np.sqrt(12))
        assert truncated.mean() > critical_area.CLAIMED + 0.04

    def test_finer_pixels_do_not_change_it(self):
        # without the correction for the edges of contact 4 pixels differ by 0.02 from 16
        found = critical_area.resolution(pixels=(8, 16), faces=6, waves=2)
        assert_allclose(found[8], found[16], atol=0.005)

    def test_flow_near_closing_is_that_of_the_last_constriction(self):
        found = critical_area.flow_near_closing(faces=5, pixels=128)
        assert_allclose(found["median"], 3.45, atol=0.15)


class TestFinishes:
    """SAE 650312, 1965: loads from which the finish does not matter, in yield strengths."""

    @pytest.fixture(scope="class")
    def closing(self):
        return finishes.closing_loads(n=128, rms=(0.1e-6, 3e-6))

    def test_scratched_faces_close_only_near_the_hardness(self, closing):
        low, high = closing[finishes.KINDS[2], 3e-6]
        assert 0.85 * 2.75 < low < high < 2.75

    def test_isotropic_faces_close_at_considerably_less(self, closing):
        assert closing[finishes.KINDS[0], 3e-6][1] < 0.6 * 2.75

    def test_very_fine_isotropic_faces_close_about_the_yield_strength(self, closing):
        assert closing[finishes.KINDS[0], 0.1e-6][0] < 1.0


@pytest.mark.parametrize("peer", ["Tamaas", "ContactMechanics"])
def test_contact_fields_are_those_of_other_programs(peer):
    pytest.importorskip(peers.MODULES[peer], reason=f"{peer} is not installed")
    for r in programs.contact_fields(peer, n=128):
        # the peers stop earlier with a hardness
        limit = 1e-7 if np.isinf(r["hardness"]) else 1e-5
        assert r["difference of pressure"] < limit
        assert r["of gap"] < limit
        assert r["pixels otherwise"] == 0


def test_flow_tends_to_that_of_reynoldsflow_on_finer_grids():
    pytest.importorskip("reynoldsflow", reason="reynoldsflow is not installed")
    coarse, fine = programs.flow_fields(n=128, refinements=(1, 2))
    off = [abs(r["difference of permeability"]) for r in (coarse, fine)]
    assert off[1] < 0.4 * off[0] < 0.4 * 0.03
    assert fine["of fluid pressure, rms"] < 0.6 * coarse["of fluid pressure, rms"] < 3e-3


def test_area_at_small_loads_lies_between_persson_and_bush_gibson_thomas():
    kappa = theories.small_loads(n=512, seeds=(1,))["κ"]
    assert np.all((np.sqrt(8 / np.pi) < kappa) & (kappa < np.sqrt(2 * np.pi)))


def test_open_area_near_full_contact_is_that_of_penny_cracks():
    """Spots open to 3/2 of the area under tension, half of Persson's, on coarse and fine pixels."""
    coarse, fine = open_area.open_areas(variants=((256, 8, 8), (512, 16, 8)), seeds=range(4))
    for r in (coarse, fine):
        ratio = r["over tension"]
        # the farther spots are apart the nearer: faces scatter by 3 % from p̄ = 1.25 E*h′ on
        assert ratio[0] > ratio[1] + 0.05
        assert_allclose(ratio[1:3], 1.5, atol=0.08)
        assert_allclose(r["tension over theory"][:2], 1, atol=0.05)
    assert_allclose(fine["over Persson"][:2], coarse["over Persson"][:2], rtol=0.02)


def test_area_of_summits_tends_to_greenwood_and_williamson():
    # what summits do to each other goes with contact radius over distance, thus with √spread
    found = theories.greenwood_williamson(n=1024)[:2]
    wide, half = (r["area over theory"] for r in found)
    assert wide < half < 1
    assert_allclose(2 * half - wide, 1, atol=0.02)
    # with that as point forces the theory has the area found
    for r in found:
        assert_allclose(r["area over theory"], r["interacting"], rtol=5e-3)
        assert 1 - r["interacting"] > 5 * abs(r["interacting"] - r["area over theory"])


def test_permeability_of_cut_faces_is_that_of_a_public_collection():
    """Both means of five faces of 8 longest waves a side lie within their scatter and ours."""
    (found,) = cut_faces.cut_faces(cases=((8, 1024, 5),))
    for (mean, scatter), ours in zip(cut_faces.CLAIMED[8], found["mean"], strict=True):
        assert abs(ours - mean) < 2 * scatter * (1 / np.sqrt(5) + 1 / np.sqrt(10))


def test_radial_leakage_of_turned_copper_ends_where_it_was_found_to():
    """Near 50 MPa, for some copper between soft and half hard."""
    found = turned_copper.turned_copper(pitches=(96e-6, 192e-6), depths=(3e-6, 10e-6))
    low, high = found["copper, soft"][0], found["copper, half hard"][1]
    assert low < turned_copper.CLAIMED < 1.2 * high


def test_a_face_gives_the_cycle_of_rock_fractures():
    """The rise on loading, and what is left of it, within a third."""
    best = rock_fractures.rock_fractures(scales=(0.05, 0.07), hardnesses=(0.18, 0.3))
    for what in ("rise", "left"):
        assert_allclose(best[f"{what}, ours"], best[f"{what}, measured"], rtol=1 / 3)


class TestHandbook:
    """Exponents of pressure, hardness and finish beside those of NSWC-11."""

    @pytest.fixture(scope="class")
    def found(self):
        return handbook.handbook_exponents(
            n=128, seeds=(1, 2), rms=(0.5e-6, 2e-6), loads=(0.02, 0.2)
        )

    def test_the_exponent_of_pressure_passes_the_one_of_the_handbook(self, found):
        for kind in ("turned", "ground"):
            light, heavy = (found[kind, load]["pressure"] for load in (0.02, 0.2))
            assert (light < 2).all()
            assert (heavy > 1.5 * light).all()
            assert heavy.max() > 0.8 * handbook.CLAIMED["pressure"]

    def test_finish_counts_more_than_in_the_handbook(self, found):
        for values in found.values():
            assert (values["finish"] > 2.9).all()

    def test_the_exponent_of_hardness_by_the_scaling_law_is_that_of_another_hardness(
        self, monkeypatch
    ):
        surface = handbook.face("ground", 128, 1)
        expected = handbook.exponents(surface, 1e-6, 0.1)["hardness"]
        pressure = 0.1 * handbook.HARDNESS
        logs = []
        for factor in (1 / handbook.STEP, handbook.STEP):
            monkeypatch.setattr(handbook, "HARDNESS", factor * pressure / 0.1)
            logs.append(handbook.log_permeability(surface, 1e-6, pressure))
        assert_allclose((logs[1] - logs[0]) / (2 * np.log(handbook.STEP)), expected, rtol=0.05)


def test_ranges_say_what_is_sealed():
    texts = [handbook.range_text(np.array(v)) for v in ([1.2, 0.95], [np.nan, 3.0], [np.nan])]
    assert texts == ["0.95 to 1.2", "3 (1 sealed)", "sealed"]
