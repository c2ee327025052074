"""Spectra that are continued below the waves that an instrument sees."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from small_cases import HARDENED, steel_scene

import femseal as fs
from femseal.budget import CoarserSolution, continuation_part
from femseal.budget.missing_waves import filter_part
from femseal.budget.versions import continued_versions
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.runs.run_description import describe
from femseal.topography import continuation_of, spectrum

MEASURED = fs.self_affine(
    (128, 128), (128e-6, 128e-6), hurst=0.8, rms_slope=0.05, cut_off=2.5e-6, rng=1
)


"""Power law from 40 to 8 pixels, behind a plateau."""


def test_a_continued_short_band_has_the_right_slope():
    """Surfaces that are known down to 8 µm are continued to 2 µm; the truth was generated down to 2 µm."""
    added = []
    for seed in range(4):
        given = {"hurst": 0.8, "rms_height": 1e-7, "roll_off": 40e-6, "rng": seed}
        size, shape = (256e-6, 256e-6), (1024, 1024)
        truth = fs.self_affine(shape, size, cut_off=2e-6, **given)
        seen = truth.low_pass(8e-6).resample((256, 256))
        found = continuation_of(seen, 2e-6)
        slopes = truth.low_pass(1.01 * found.longest).rms_slope, found.slope_to(2e-6)
        added.append((slopes[1] ** 2 - slopes[0] ** 2) / (truth.rms_slope**2 - slopes[0] ** 2))
    assert_allclose(np.mean(added), 1, atol=0.07)


def test_a_continued_surface_has_the_spectrum_of_one_generated_with_these_waves():
    size, shape = (128e-6, 128e-6), (512, 512)
    made = fs.self_affine(shape, size, hurst=0.8, rms_slope=0.1, cut_off=1e-6, rng=1)
    seen = made.low_pass(2.5e-6).resample((128, 128))
    found = fs.continue_spectrum(seen, 1e-6, shape=(1024, 1024), rng=2)
    assert_allclose(found.rms_slope, 0.1, rtol=0.005)
    assert_allclose(found.rms_height, made.rms_height, rtol=1e-3)
    law = spectrum(found).law
    assert_allclose(law.hurst, 0.8, atol=0.01)
    assert_allclose(law.shortest, 1e-6, rtol=0.1)
    known = continuation_of(seen, 1e-6)
    assert_allclose(known.slope_to(1e-6), 0.1, rtol=0.005)  # closed form
    # measured waves stay
    longest = 1.01 * known.longest
    wide = seen.low_pass(longest).resample(found.shape)
    assert_allclose(found.low_pass(longest).heights, wide.heights, atol=1e-6 * seen.rms_height)


def test_waves_are_the_same_on_every_grid_and_differ_between_realisations():
    one = fs.continue_spectrum(MEASURED, 1e-6, rng=3)
    fine = fs.continue_spectrum(MEASURED, 1e-6, shape=(1024, 1024), rng=3)
    assert_allclose(fine.resample(one.shape).heights, one.heights, atol=1e-9 * one.rms_height)
    other = fs.continue_spectrum(MEASURED, 1e-6, rng=3, realisation=1)
    found = continuation_of(MEASURED, 1e-6, rng=3)
    first, second = (face.high_pass(found.longest).heights for face in (one, other))
    # a seat ends a face along x1, and not its waves
    formed = one.with_form(np.linspace(0, 1e-6, one.shape[0]))
    added = found.add_to(formed).heights - formed.heights
    assert_allclose(added, first, atol=1e-9 * one.rms_height)
    assert 0 < abs(first.std() / second.std() - 1) < 0.02  # the slope is drawn by its error
    assert abs(np.mean(first * second)) < 0.1 * first.var()


def test_each_patch_is_continued_separately():
    halves = np.split(MEASURED.heights, 2, axis=1)
    patches = fs.Patches([fs.Topography(z, MEASURED.spacing, (False, False)) for z in halves])
    known = continuation_of(patches, 1e-6, rng=3)
    fine = patches.low_pass(known.longest).resample((1024, 1024))
    found = known.add_to(fine)
    assert known.periodic == (False, False)
    assert found.widths == (512, 512)
    one, two = np.split(found.heights - fine.heights, 2, axis=1)
    assert abs(np.mean(one * two)) < 0.1 * one.var()
    assert_allclose(found.rms_slope, known.slope_to(1e-6), rtol=0.03)
    assert_allclose(known.add_to(found, factor=-1.0).heights, fine.heights, atol=1e-15)


def test_added_waves_are_symmetric_at_borders_that_are_not_periodic():
    part = fs.Topography(MEASURED.heights[:100], MEASURED.spacing, (False, True))
    found = fs.continue_spectrum(part, 1e-6, rng=3)
    assert found.periodic == (False, True)
    # the slope across a border vanishes: no wave is shorter than the cut-off
    assert_allclose(found.low_pass(0.99e-6).heights, found.heights, atol=1e-9 * found.rms_height)
    known = continuation_of(part, 1e-6)
    assert_allclose(found.rms_slope, known.slope_to(1e-6), rtol=0.03)


@pytest.mark.parametrize(
    ("hurst", "of_slope"),
    [(0.6, 1.05), (0.6, 1.3), (0.9, 1.05)],
)
def test_waves_beyond_the_slope_set_by_hardness_do_not_count(hurst, of_slope):
    given = {"hurst": hurst, "rms_slope": 0.05, "cut_off": 2.5e-6, "rng": 1}
    found = continuation_of(fs.self_affine((128, 128), (128e-6, 128e-6), **given), 1e-6)
    slope = of_slope * found.rms_slope
    last = found.shortest_relevant_wave(slope / 2 * 1e11, 1e11)
    assert_allclose(found.slope_to(last), slope, rtol=1e-9)
    assert found.shortest_relevant_wave(found.rms_slope / 2.1 * 1e11, 1e11) == found.longest
    assert found.shortest_relevant_wave(inf, 1e11) == 0


NOISE = fs.Topography(np.random.default_rng(1).normal(0, 1e-8, (64, 64)), (1e-6, 1e-6))


@pytest.mark.parametrize(
    ("face", "wave", "shape", "said"),
    [
        (MEASURED, 5e-6, None, r"continue_spectrum: given 5 µm, expected less than 2\.67 µm"),
        (MEASURED, -1e-6, None, "continue_spectrum"),
        (MEASURED, 1e-6, (256, 256), r"shape: given .*256.*, expected at least 8 pixels"),
        (NOISE, 5e-7, None, "continue_spectrum: given .* whose spectrum follows no power law"),
    ],
)
def test_surfaces_without_a_power_law_are_not_continued(face, wave, shape, said):
    with pytest.raises(fs.InputError, match=said):
        fs.continue_spectrum(face, wave, shape=shape, rng=1)


# --- of a case --------------------------------------------------------------------------------------------

SIZE = (32e-6, 32e-6)
TRUTH = fs.self_affine(
    (512, 512), SIZE, hurst=0.8, rms_slope=0.2, roll_off=16e-6, cut_off=0.5e-6, rng=4
)


@pytest.fixture
def case(tmp_path):
    """A face of which waves down to 2 µm are measured, continued to 1 µm."""
    np.save(tmp_path / "face.npy", TRUTH.low_pass(1.6e-6).resample((48, 48)).heights)
    size = {"size": ["32 um", "32 um"], "height_unit": "m"}

    def made(surface, **output):
        tables = {
            "seed": 7,
            "face": {"kind": "file", "path": "face.npy", **size},
            "surface": {"detrend": 0, "spikes": inf, "continue_spectrum": "1 um"} | surface,
            "material": {"young": "210 GPa", "hardness": "4 GPa"},
            "load": {"loading": ["20 MPa", "100 MPa", "300 MPa"]},
            "contact": {"boundary": ["mirror", "mirror"]},
            "output": {"pictures": False} | output,
        }
        return parse_case(HARDENED | tables, tmp_path)

    return made


def test_a_case_solves_the_continued_surface(case):
    prepared = prepare(case({}))
    path = case({}).folder / "face.npy"
    measured = fs.read_topography(path, size=SIZE, height_unit="m").detrend(0)
    face = fs.continue_spectrum(measured, 1e-6, rng=7)
    assert face.shape == (256, 256)
    assert_allclose(prepared.scene.surface.heights, face.heights, atol=1e-12)
    assert prepared.conditioning.shortest_wave == 1e-6
    assert_allclose(prepared.conditioning.rms_slope, face.rms_slope)
    assert [text for text in prepared.warnings if "longest wave" not in text] == []
    longer = prepare(case({"shortest_wave": "4 um"}))
    assert longer.continuation.longest == 4e-6
    # three states each: pixels, more and less hardness, three other phases, fewer waves, as measured
    text = "\n".join(describe(case({}), prepared))
    assert "states again, 21 on 128 × 128 points" in text


def test_the_error_budget_solves_other_phases_and_fewer_waves(case):
    prepared = prepare(case({}))
    *others, shorter = (one.scene.surface for one in continued_versions(prepared))
    face, longest = prepared.scene.surface, prepared.continuation.longest
    assert len({one.rms_slope for one in (face, *others)}) == 4
    long = face.low_pass(1.01 * longest).heights
    for one in others:
        assert_allclose(one.low_pass(1.01 * longest).heights, long, atol=1e-12)
    assert_allclose(shorter.low_pass(2e-6).heights, shorter.heights, atol=1e-12)
    assert continued_versions(replace(prepared, continuation=None)) == []


@pytest.mark.parametrize(
    ("surface", "message"),
    [
        ({"continue_spectrum": "3 um"}, r"given 3 µm, expected less than .* measured"),
        (
            {"points": [128, 128]},
            r"surface\.points: given .*128.*, expected 8 pixels .*256, 256",
        ),
        ({"continue_spectrum": "-1 um"}, "continue_spectrum: given '-1 um', expected a length > 0"),
        ({"continue_spectrum": "1 nm"}, r"surface\.points.*GB"),
    ],
)
def test_a_case_that_cannot_be_continued_is_refused(surface, message, case):
    with pytest.raises(fs.InputError, match=message):
        prepare(case(surface))


def test_the_interval_of_a_continued_surface_contains_the_leakage_with_all_waves(case):
    results = fs.run(case({}), workers=1)
    truth = fs.Topography(TRUTH.heights, TRUTH.spacing, (False, False))
    leakage = fs.deterministic(replace(results.scene, surface=truth)).leakage
    budget = results.budget
    assert np.all((budget.lower < leakage) & (leakage < budget.upper))
    (part,) = (part for part in budget.parts if part.name == "continuation")
    assert np.all(budget.widths()["continuation"] < 0.5)
    assert "4 realisations" in part.note
    assert "continuation" not in {p.name for p in budget.numerical.parts}
    off = fs.run(case({}, model_parts=[]), workers=1)
    assert "continuation" not in {p.name for p in off.budget.parts}


def test_the_error_of_the_continuation_combines_scatter_and_trend():
    surface = fs.self_affine((16, 16), (16e-6, 16e-6), hurst=0.8, rms_slope=0.1, rng=1)
    scene = steel_scene(surface, loading=(1e7, 2e7, 4e7))
    q, in_contact, kept = np.array([8e-9, 4e-9, 0.0]), np.array([0.02, 0.04, 0.5]), 1.0

    def solution(first, second, closed=0.0):
        changed = [q[0] * np.exp(first), q[1] * np.exp(second), closed]
        return CoarserSolution((8, 8), np.array(changed), q)

    def part(others, shorter):
        found = continuation_part(scene, q, in_contact, others, shorter, kept)
        return np.array([found.lower, found.upper])

    same, trend = solution(0, 0), solution(-0.2, -0.2)
    lower, upper = part([solution(0.1, 0.1), solution(-0.1, 0.0), solution(0.0, 0.3)], same)
    sd = np.std([[0, 0.1, -0.1, 0.0], [0, 0.1, 0, 0.3]], axis=1, ddof=1)
    student = stats.t(3).ppf(0.975) * np.sqrt(1.25) * sd
    assert_allclose(np.log(upper[:2] / q[:2]), student + np.array([0, 0.1]), rtol=1e-9)
    assert_allclose(np.log(q[:2] / lower[:2]), student - np.array([0, 0.1]), rtol=1e-9)
    assert upper[2] > 0  # within the scatter of the load at which it closes
    # without waves beyond the cut-off there is no trend
    assert_allclose(part([same] * 3, trend)[:, :2], [q[:2], q[:2]])
    kept = 0.7
    alone = filter_part(scene, q, in_contact, trend, kept)
    assert (alone.upper[:2] > q[:2]).all()
    assert_allclose(part([same] * 3, trend), [alone.lower, alone.upper])
    assert part([same, same, solution(0, 0, 1e-9)], same)[1, 2] >= 1e-9
    assert np.all(np.isnan(part([same, same, solution(*[np.nan] * 3)], same)[1, :2]))
