"""The grid and the low-pass of measured faces: what was measured is kept, or its loss is told with its share."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import HARDENED

import femseal as fs
from femseal.budget.versions import without_filtered_waves
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.topography import grid_choice


@pytest.fixture
def case(tmp_path):
    """A case of a face whose shortest waves have 4 pixels, and the noise of an instrument [m]."""
    face = fs.self_affine((96, 128), (96e-6, 128e-6), hurst=0.5, rms_slope=0.1, cut_off=4e-6, rng=1)

    def made(noise=1e-9, **surface):
        z = face.heights + np.random.default_rng(0).normal(0, noise, face.shape)
        np.savez(tmp_path / "face.npz", z=z, spacing=face.spacing)
        tables = {
            "face": {"kind": "file", "path": "face.npz", "periodic": [True, True]},
            "load": {"loading": ["200 MPa"]},
            "surface": {"detrend": 0, "spikes": np.inf, **surface},
        }
        return parse_case(HARDENED | tables, tmp_path)

    return made


def of_grid(prepared):
    """Warnings but those of what the small faces hold of their longest waves."""
    return [warning for warning in prepared.warnings if "longest wave" not in warning]


def test_the_default_grid_resolves_the_shortest_measured_wave(case):
    prepared = prepare(case())
    conditioning = prepared.conditioning
    assert_allclose(conditioning.shortest_measured, 4e-6, rtol=0.05)
    assert conditioning.shortest_wave == conditioning.shortest_measured
    assert conditioning.shortest_wave >= 8 * max(conditioning.spacing)
    assert min(conditioning.shape) >= 190
    assert_allclose(prepared.scene.surface.rms_slope, 0.1, rtol=0.02)
    assert of_grid(prepared) == []


def test_condition_can_choose_the_grid_of_a_run(case, tmp_path):
    prepared = prepare(case())
    face = fs.read_topography(tmp_path / "face.npz", periodic=(True, True))
    surface, conditioning = fs.condition(face, detrend=0, spikes=np.inf, shape="auto")
    assert conditioning.shape == prepared.conditioning.shape
    assert_allclose(surface.heights, prepared.scene.surface.heights, atol=1e-15)
    # on the pixels of the map, the filter removes a large part of the slope
    coarse, _ = fs.condition(face, detrend=0, spikes=np.inf)
    assert coarse.rms_slope < 0.9 * surface.rms_slope
    with pytest.raises(fs.InputError, match="auto"):
        fs.condition(face, shape="fine")


def test_a_grid_limited_for_its_cost_is_told(case, monkeypatch):
    monkeypatch.setattr(grid_choice, "MOST_GRID_POINTS", 20_000)
    prepared = prepare(case())
    lost, shortest = prepared.conditioning.lost_slope, prepared.conditioning.shortest_measured
    assert_allclose(np.prod(prepared.scene.surface.shape), 20_000, rtol=0.15)
    assert 0.1 < lost < 0.4
    (warning,) = of_grid(prepared)
    wanted = list(fs.topography.resolving_shape((96e-6, 128e-6), shortest))
    assert f"removes {lost:.0%} of the rms slope" in warning
    assert f"surface.points = {wanted}" in warning
    # what it tells to set keeps the slope
    finer = prepare(case(points=wanted))
    assert finer.conditioning.lost_slope < 0.001
    assert of_grid(finer) == []


@pytest.mark.parametrize(
    ("surface", "words", "way_out"),
    [
        ({"shortest_wave": "16 um"}, "the low-pass at 16 µm removes", "surface.shortest_wave"),
        ({"points": [96, 128]}, "the low-pass at 8 µm removes", "set surface.points = ["),
        (
            {"points": [200, 260], "shortest_wave": "16 um"},
            "the low-pass at 16 µm removes",
            "leave out surface.shortest_wave and surface.points",
        ),
        ({"shortest_wave": "3 um", "noise": 200e-9}, "are noise or beyond the instrument", ""),
    ],
)
def test_what_is_lost_or_kept_by_the_settings_of_the_case_is_told(case, surface, words, way_out):
    told = of_grid(prepare(case(**surface)))
    assert any(words in text and way_out in text for text in told), told


def test_a_wave_that_needs_a_finer_grid_gets_one(case):
    prepared = prepare(case(shortest_wave="5 um"))
    assert prepared.conditioning.shortest_wave == 5e-6
    assert 8 <= 5e-6 / max(prepared.scene.surface.spacing) < 9


def test_results_tell_the_slope_that_is_lost(case):
    coarse = case(shortest_wave="24 um")
    lost = f"{prepare(coarse).conditioning.lost_slope:.0%} of the rms slope"
    assert any(lost in text for text in fs.run(coarse, workers=1).warnings)


def test_the_budget_solves_the_face_without_its_shortest_octave_of_waves(case):
    whole = prepare(case(shortest_wave="12 um"))
    surface = whole.scene.surface
    smooth = without_filtered_waves(whole).scene.surface
    assert smooth.shape == tuple(-(-n // 2) for n in surface.shape)
    expected = surface.low_pass(24e-6).resample(smooth.shape)
    assert_allclose(smooth.heights, expected.heights, atol=1e-15)
    # no wave of 160 µm is left
    assert without_filtered_waves(prepare(case(shortest_wave="80 um"))) is None
