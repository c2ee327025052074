"""The error budget of studies and of runs, and the errors of pixels, filter and measured patches."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import binom
from small_cases import SWEPT, steel_scene

import femseal as fs
from femseal.budget import CoarserSolution
from femseal.budget.estimates import median_interval
from femseal.budget.leakage_changes import expected_sensitivity, sensitivity
from femseal.budget.missing_waves import filter_part
from femseal.budget.pixel_size import pixels_part
from femseal.budget.versions import coarser_points
from femseal.loads import LoadProgramme
from femseal.preparation import prepare
from femseal.runs.forecast import forecast
from femseal.runs.run_description import describe
from femseal.studies.patch_interval import interval_widths
from femseal.topography import Patches

# --- coarser solutions ---------------------------------------------------------------------------------------------

UNLOADING = {"unload_from": (1e9,), "unloading": (6e8, 1e8)}


@pytest.fixture(scope="module")
def scene():
    return steel_scene(rough(64), loading=(1e8, 3e8, 6e8, 1e9, 1.5e9), **UNLOADING)


def rough(n, seed=3):
    waves = {"hurst": 0.8, "rms_slope": 0.2, "roll_off": 32e-6, "rng": seed}
    return fs.self_affine((n, n), (n * 1e-6,) * 2, **waves)


def test_a_step_that_is_open_on_one_grid_only_may_be_sealed_or_open(scene):
    q = np.array([1.0, 0.5, 0.2, 1e-3, 0.0, 1e-2, 0.1])
    other = np.array([1.1, 0.4, 0.1, 0.0, 1e-4, 1e-2, 0.1])
    part = pixels_part(scene, q, CoarserSolution((32, 32), other))
    assert_array_equal(part.lower[3:5], 0)
    assert part.upper[3] > q[3]
    assert part.upper[4] >= 1e-4
    assert (part.lower[:3] > 0).all()


IN_CONTACT = np.array([0.02, 0.06, 0.12, 0.2, 0.3, 0.28, 0.25])


def test_removed_waves_count_by_their_slope(scene):
    """The row ends with the slope that was removed; octaves that hold nothing do not count."""
    q = np.full(7, 0.5)
    filtered = CoarserSolution((32, 32), 0.2 * q, rms_slope=0.8 * scene.surface.rms_slope)
    widths = [
        np.log(filter_part(scene, q, IN_CONTACT, filtered, kept).upper / q)
        for kept in (0.3, 0.7, 0.95, 0.99, 1 - 1e-6)
    ]
    assert (np.diff(widths, axis=0) < 0).all()
    assert np.max(widths[-1]) < 0.02
    assert "filter" not in error_budget_of(scene, q, filtered=filtered)
    assert "filter" in error_budget_of(scene, q, filtered=filtered, kept_slope=0.9)


def test_the_row_of_removed_waves_depends_on_the_state_of_a_load_alone(scene):
    """A load by itself has the row that it has among others; an unloading has no less than its peak."""
    q = np.array([1.0, 0.5, 0.2, 0.05, 1e-3, 2e-3, 1e-2])
    other = q * np.array([1.2, 0.9, 0.5, 1.5, 0.2, 0.9, 1.0])
    part = filter_part(scene, q, IN_CONTACT, CoarserSolution((32, 32), other), 0.8)
    for s in range(5):
        alone = replace(scene, loading=(scene.loading[s],), unload_from=(), unloading=())
        solution = CoarserSolution((32, 32), other[s : s + 1])
        single = filter_part(alone, q[s : s + 1], IN_CONTACT[s : s + 1], solution, 0.8)
        assert_allclose([single.lower[0], single.upper[0]], [part.lower[s], part.upper[s]])
    widths = np.log(part.upper / q)
    peak = scene.steps.peak_indices
    assert (widths >= widths[peak]).all()


def test_states_that_leak_far_less_than_their_mean_gap_have_wider_intervals(scene):
    """What counts is the leakage of the state over that of an open seal, not that of another load."""
    study = fs.deterministic(replace(scene, surface=scene.surface.resample((16, 16))))
    share = np.array([1.0, 0.5, 0.2, 0.9e-2, 0.8e-2, 1.1e-2, 0.1])
    q = share * study.open_leakage(scene)
    half = CoarserSolution((32, 32), 1.1 * q)
    widths = fs.error_budget(scene, replace(study, leakage=q), coarse=[half]).widths()["pixels"]
    part = pixels_part(scene, q, half, in_contact=study.contact_fraction)
    plain = np.log(part.upper / q)
    assert_allclose(widths, plain * np.where(share < 1e-2, 3.0, 1.0))


def error_budget_of(scene, q, **solutions):
    study = fs.deterministic(replace(scene, surface=scene.surface.resample((16, 16))))
    return fs.error_budget(scene, replace(study, leakage=q), **solutions).widths()


def test_a_load_by_itself_has_parts_no_narrower_than_among_others(scene):
    """Of a leakage that falls by a power of the load, and a solution that is shifted by a part of the load."""
    steps = LoadProgramme.of([1e8, 2e8, 4e8, 8e8])
    in_contact = np.array([0.02, 0.05, 0.1, 0.2])
    power = expected_sensitivity(in_contact)
    q = np.exp(-power * np.log(steps.pressures / 1e8))
    other = q * np.exp(0.03 * power)
    found = sensitivity(steps, q, in_contact)
    assert (found >= power).all()
    among = replace(scene, loading=tuple(steps.pressures), unload_from=(), unloading=())
    full = pixels_part(among, q, CoarserSolution((32, 32), other), in_contact=in_contact)
    for s in range(4):
        here = slice(s, s + 1)
        alone = replace(among, loading=(steps[s].pressure,))
        assert_allclose(sensitivity(alone.steps, q[here], in_contact[here]), 2 * power[s])
        solution = CoarserSolution((32, 32), other[here])
        single = pixels_part(alone, q[here], solution, in_contact=in_contact[here])
        assert single.upper[0] > full.upper[s]
        assert single.lower[0] < full.lower[s]


@pytest.mark.slow
def test_the_part_of_the_pixels_holds_the_truth_of_twice_the_points():
    """One load of each of 24 faces: as many as 99 of 100 counts of a band of 95 % have."""
    held = []
    for seed in range(24):
        face = rough(64, seed)
        scene = steel_scene(face, loading=(1e8, 2e8, 4e8, 6e8, 8e8))
        own, half, truth = (
            fs.deterministic(replace(scene, surface=face.resample((points, points)))).leakage
            for points in (64, 32, 128)
        )
        part = pixels_part(scene, own, CoarserSolution((32, 32), half))
        s = seed % 5
        held.append(part.lower[s] <= truth[s] <= part.upper[s])
    assert sum(held) >= binom.ppf(0.01, len(held), 0.95)


# --- drawn seals ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [7, 25])
def test_the_interval_of_the_median_holds_it(count):
    rng = np.random.default_rng(count)
    ends = np.array([median_interval(rng.lognormal(size=count)) for _ in range(400)])
    assert np.sum((ends[:, 0] <= 1) & (ends[:, 1] >= 1)) >= binom.ppf(0.01, 400, 0.95)


def test_the_median_of_seals_that_are_mostly_sealed():
    low, high = median_interval(np.array([0.0] * 6 + [1.0, 2.0, 3.0, 4.0]))
    assert (low, high) == (0.0, 3.0)
    assert median_interval(np.zeros(4)) == (0.0, 0.0)


@pytest.fixture(scope="module")
def strips(scene):
    """Drawn seals as broad as the face, and twice as broad, of a fluid that presses the faces apart."""
    pressed = replace(scene, inlet_pressure=3e7, fluid_pressure="acts")
    samplings = (
        fs.Sampling(length=3e-4, realisations=4, seed=1, breadth=breadth)
        for breadth in (None, 128e-6)
    )
    return pressed, [fs.stochastic(pressed, (2, 2), sampling) for sampling in samplings]


def test_what_one_patch_does_not_know_is_a_part_of_drawn_seals(strips):
    scene, studies = strips
    for study, kind in zip(studies, ("in order", "at random"), strict=True):
        budget, q = fs.error_budget(scene, study), study.quantile(0.5)
        assert [part.name for part in budget.parts][-2:] == ["realisations", "patch"]
        assert budget.parts[0].name == "solver"
        known = np.isfinite(q) & (q > 0)
        assert known.any()
        lower, upper = interval_widths(kind).ends(q, study.patch_state)
        assert_allclose(budget.parts[-1].lower[known], lower[known])
        assert_allclose(budget.parts[-1].upper[known], upper[known])
        of_draws = budget.widths()["realisations"][known]
        assert (of_draws < np.log(upper[known] / q[known])).all()


def test_three_patches_tell_what_a_patch_does_not_know():
    waves = {"hurst": 0.8, "rms_slope": 0.2, "roll_off": 16e-6}
    patches = [fs.self_affine((32, 32), (32e-6,) * 2, **waves, rng=n) for n in range(3)]
    for count, name in ((2, "patch"), (3, "patches")):
        scene = steel_scene(Patches(patches[:count]), loading=(1e8, 3e8))
        sampling = fs.Sampling(length=3e-4, realisations=3, seed=1)
        study = fs.stochastic(scene, (2, 2 * count), sampling)
        widths = fs.error_budget(scene, study).widths()
        assert list(widths)[-2:] == ["realisations", name]
        assert (widths[name] > 0).all()


# --- runs ----------------------------------------------------------------------------------------------------------

CASE = SWEPT.replace("budget = false", "").replace('method = "stochastic"', 'method = "two-scale"')


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


def test_a_run_has_the_band_and_its_parts(case, tmp_path):
    results = fs.run(case, tmp_path / "out", workers=1)
    again = fs.open_results(tmp_path / "out")
    for found in (results, again):
        data, budget = found.dataset, found.budget
        assert {"solver", "pixels"} <= set(budget.widths())
        assert_allclose(data["leakage_two_scale_budget_lower"], budget.lower)
        assert_allclose(data["leakage_two_scale_budget_upper"], budget.upper)
        assert (budget.lower < found.leakage.values).all()
        assert (budget.upper > found.leakage.values).all()
        lower = data["leakage_two_scale_budget_part_lower"].sel(budget_part="pixels")
        assert_allclose(lower, next(part for part in budget.parts if part.name == "pixels").lower)
    assert "leakage_two_scale_budget_lower_m2_per_s" in results.rows()[0]
    assert "95 % interval" in results.table().heads[3]
    assert (
        "Half-width of the 95 % interval by source"
        in (tmp_path / "out" / "report.html").read_text()
    )


def test_the_budget_can_be_switched_off(case):
    case.write_text(CASE.replace("[output]", "[output]\nbudget = false"))
    stages = []
    results = fs.run(case, workers=1, progress=lambda stage, done, total: stages.append(stage))
    assert not [stage for stage in stages if "budget" in stage]
    assert results.budget is None
    assert results.budgets == {}
    assert not [name for name in results.dataset.variables if "budget" in name]
    loaded = fs.load_case(case)
    assert not any("error budget" in line for line in describe(loaded, prepare(loaded)))


def test_check_says_what_the_budget_solves_besides(case):
    loaded = fs.load_case(case)
    prepared = prepare(loaded)
    (line,) = (line for line in describe(loaded, prepared) if line.startswith("error budget"))
    assert "16 × 32 points" in line
    off = loaded.model_copy(update={"output": loaded.output.model_copy(update={"budget": False})})
    assert (
        1.02
        < forecast(loaded, prepared).parallel_seconds / forecast(off, prepared).parallel_seconds
        < 2.2
    )
    sure = loaded.output.model_copy(update={"model_parts": ()})
    numbers = loaded.model_copy(update={"output": sure})
    assert (
        1.02
        < forecast(numbers, prepared).parallel_seconds / forecast(off, prepared).parallel_seconds
        < 1.6
    )


def test_two_scales_of_the_whole_face_are_looked_at_by_the_deterministic_one_on_fewer_points(case):
    both = CASE.replace('"two-scale"\n', '"two-scale"\ncompare = ["deterministic"]\n')
    case.write_text(both)
    stages = []
    results = fs.run(
        case, workers=1, progress=lambda stage, done, total: stages.append((stage, done, total))
    )
    assert set(results.budgets) == {"deterministic", "two_scale"}
    contacts = {stage for stage, *_ in stages if stage.startswith("error budget: ")}
    assert contacts == {"error budget: contact of the whole face"}
    one, two = (results.budgets[name].widths()["pixels"] for name in ("deterministic", "two_scale"))
    assert_allclose(one, two, rtol=1e-6)


def test_cells_keep_eight_pixels_on_coarser_points():
    assert coarser_points((65, 128)) == (33, 64)
    assert coarser_points((96, 96), (24, 32)) == (48, 48)
    assert coarser_points((90, 96), (24, 32)) == (45, 48)
    assert coarser_points((60, 96), (40, 64)) == (40, 64)
    assert coarser_points((30, 36), (24, 32)) is None
    assert coarser_points((136, 128), divide_by=(8, 8)) == (72, 64)
