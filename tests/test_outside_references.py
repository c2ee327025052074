"""Findings of others come out: measured by the benchmark `outside_references`, on smaller grids here."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.append(str(Path(__file__).parent / "benchmarks"))
import outside_references as outside

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def softened():
    return outside.bearing_area(n=128)


class TestBearingArea:
    """A material that is soft beside its slopes is cut off at the height whose bearing area is p̄/H."""

    def test_contact_is_the_bearing_area(self, softened):
        for r in softened:
            if r["ratio"] <= 1e-3:
                assert_allclose(r["area"], 1, rtol=2e-3)
                assert r["wrong"] < 2e-3

    def test_the_gap_differs_in_proportion_to_hardness(self, softened):
        # below 1e-3 the sorted heights of the pixels are no denser than the difference
        for share in {r["share"] for r in softened}:
            gap = {r["ratio"]: r["gap"] for r in softened if r["share"] == share}
            assert_allclose(np.log10(gap[0.1] / gap[1e-3]), 2, atol=0.3)

    def test_a_hard_material_is_not_cut_off(self, softened):
        assert all(r["area"] > 1.1 for r in softened if r["ratio"] == 1)


def test_resistance_of_a_saddle_point_near_closing():
    """R ∝ (L_c − L)^−3.45: Dapp & Müser, EPL 109, 2015, 44001."""
    found = outside.saddle_point(n=512, nearest=1.5e-3)
    assert_allclose(found["corrected_exponent"], 3.45, atol=0.05)
    assert_allclose(found["nearest_exponent"], 3.45, atol=0.1)


@pytest.mark.parametrize("peer", ["tamaas", "ContactMechanics"])
def test_contact_fields_are_those_of_other_programs(peer):
    pytest.importorskip(peer, reason=f"{peer} is not installed")
    name = {"tamaas": "Tamaas"}.get(peer, peer)
    for r in outside.contact_fields(name, n=128):
        # the peers stop at about 1e-9 without hardness, ContactMechanics at 1e-7 with hardness
        limit = 1e-7 if np.isinf(r["hardness"]) else 1e-5
        assert r["pressure"] < limit
        assert r["gap"] < limit
        assert r["otherwise"] == 0


def test_flow_tends_to_that_of_reynoldsflow_on_finer_grids():
    pytest.importorskip("reynoldsflow", reason="reynoldsflow is not installed")
    coarse, fine = outside.flow_fields(n=128, refinements=(1, 2))
    for elements in ("edge", "RT0"):
        assert abs(coarse[elements]["value"]) < 0.03
        assert abs(fine[elements]["value"]) < 0.4 * abs(coarse[elements]["value"])
        assert fine[elements]["rms"] < 0.6 * coarse[elements]["rms"] < 3e-3


def test_area_at_small_loads_lies_between_persson_and_bush_gibson_thomas():
    found = outside.persson(n=512, loads=(0.005, 0.01, 0.02, 0.05), seeds=(1,))
    kappa = found["area"] / found["load"]
    assert np.all((np.sqrt(8 / np.pi) < kappa) & (kappa < np.sqrt(2 * np.pi)))


def test_area_of_summits_tends_to_greenwood_and_williamson():
    # what summits do to each other is in proportion to contact radius over distance, thus to √spread
    wide, half, _ = (r["area"] / r["theory"] for r in outside.greenwood_williamson(n=1024))
    assert wide < half < 1
    assert_allclose(2 * half - wide, 1, atol=0.02)
