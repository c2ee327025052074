"""The grid and the low-pass of measured faces: what was measured is kept, or its loss is told with its share."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.case.case import parse_case
from femseal.preparation import face, preparation
from femseal.preparation.preparation import prepare
from femseal.refinement.coarser import without_filtered_waves
from femseal.runs.forecast import describe

ROOT = Path(__file__).parents[2]


@pytest.fixture
def case(tmp_path):
    """A case of a face whose shortest waves have 4 pixels, and the noise of an instrument."""
    face = fs.self_affine((96, 128), (96e-6, 128e-6), hurst=0.5, rms_slope=0.1, cut_off=4e-6, rng=1)
    noise = np.random.default_rng(0).normal(0, 1e-9, face.shape)
    np.savez(tmp_path / "face.npz", z=face.heights + noise, spacing=face.spacing)
    data = tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))
    data["face"] = {"kind": "file", "path": "face.npz", "periodic": [True, True]}
    data |= {"method": "deterministic", "compare": []}
    data["load"] = {"loading": ["200 MPa"]}

    def made(tables=None, **surface):
        return parse_case(
            {**data, "surface": {"detrend": 0, "spikes": np.inf, **surface}, **(tables or {})},
            tmp_path,
        )

    return made


def of_grid(prepared):
    """Warnings but those of what the small faces hold of their long waves."""
    return [warning for warning in prepared.warnings if "long waves" not in warning]


def test_the_default_grid_resolves_the_shortest_measured_wave(case):
    prepared = prepare(case())
    conditioning = prepared.conditioning
    assert_allclose(conditioning.shortest_measured, 4e-6, rtol=0.05)
    assert conditioning.shortest_wave == conditioning.shortest_measured
    assert conditioning.shortest_wave >= 8 * max(conditioning.spacing)
    assert min(conditioning.shape) >= 190
    assert_allclose(prepared.scene.surface.rms_slope, 0.1, rtol=0.02)
    assert of_grid(prepared) == []


def test_a_grid_limited_for_its_cost_is_told(case, monkeypatch):
    for module in (face, preparation):
        monkeypatch.setattr(module, "MOST_POINTS", 20_000)
    prepared = prepare(case())
    lost = prepared.conditioning.lost_slope
    assert_allclose(np.prod(prepared.scene.surface.shape), 20_000, rtol=0.15)
    assert 0.1 < lost < 0.4
    (warning,) = of_grid(prepared)
    wanted = list(
        fs.topography.resolving_shape((96e-6, 128e-6), prepared.conditioning.shortest_measured)
    )
    for words in (
        f"removes {lost:.0%} of the rms slope",
        f"surface.points = {wanted}",
        "are taken",
    ):
        assert words in warning
    # what it tells to set keeps the slope
    assert prepare(case(points=wanted)).conditioning.lost_slope < 0.001
    assert of_grid(prepare(case(points=wanted))) == []


def test_settings_rule_and_their_loss_is_told(case):
    """A wave that needs a finer grid gets one; a longer one, or a coarse grid, is warned of."""
    prepared = prepare(case(shortest_wave="5 um"))
    assert prepared.conditioning.shortest_wave == 5e-6
    assert 8 <= 5e-6 / max(prepared.scene.surface.spacing) < 9
    (warning,) = of_grid(prepare(case(shortest_wave="16 um")))
    assert "the low-pass at 16 µm removes" in warning
    assert warning.endswith("leave out surface.shortest_wave")
    (warning,) = of_grid(prepare(case(points=[96, 128])))
    assert "the low-pass at 8 µm removes" in warning
    assert "set surface.points = [" in warning
    both = of_grid(prepare(case(points=[200, 260], shortest_wave="16 um")))
    assert both[0].endswith("leave out surface.shortest_wave and surface.points")


def test_noise_that_is_kept_is_told(case, tmp_path):
    with np.load(tmp_path / "face.npz") as file:
        noise = np.random.default_rng(1).normal(0, 200e-9, file["z"].shape)
        np.savez(tmp_path / "noisy.npz", z=file["z"] + noise, spacing=file["spacing"])
    face = case().face[0].model_copy(update={"path": Path("noisy.npz")})
    warnings = of_grid(prepare(case(shortest_wave="3 um").model_copy(update={"face": (face,)})))
    assert any(
        "are noise or beyond the instrument: surface.shortest_wave = '" in text for text in warnings
    )


def test_check_and_results_tell_the_slope_that_is_lost(case):
    prepared = prepare(coarse := case(shortest_wave="24 um"))
    lines = describe(coarse, prepared)
    lost = f"{prepared.conditioning.lost_slope:.0%} of the rms slope"
    assert any(line.startswith("warning") and lost in line for line in lines)
    share = f"{prepared.conditioning.lost_slope:.0%} of that above noise"
    assert any(line.startswith("filter") and share in line for line in lines)
    results = fs.run(coarse, workers=1)
    assert any(lost in text for text in results.warnings)


def test_the_budget_solves_the_face_without_its_shortest_octave_of_waves(case):
    whole = prepare(case(shortest_wave="12 um"))
    surface = whole.scene.surface
    smooth = without_filtered_waves(whole).scene.surface
    assert smooth.shape == tuple(-(-n // 2) for n in surface.shape)
    assert_allclose(
        smooth.heights, surface.low_pass(24e-6).resample(smooth.shape).heights, atol=1e-15
    )
    assert (
        without_filtered_waves(prepare(case(shortest_wave="80 um"))) is None
    )  # no wave of 160 µm is left
