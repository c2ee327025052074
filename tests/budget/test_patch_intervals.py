"""The 95 % interval of what measured patches do not tell: by the contact state alone, calibrated on whole surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.budget.patch_errors import calibrated_part
from femseal.studies.patch_interval import (
    COMPUTATIONS,
    DIFFICULTY,
    LEAST_KNOWN,
    LEAST_TRUTH,
    IntervalWidths,
    calibration_rows,
    distances_to_truth,
    interval_widths,
    state_of_rows,
    weighted_quantile,
)
from femseal.studies.patch_state import PatchState
from femseal.studies.stochastic_study import _count_needed
from femseal.topography import Patches


def state(carriers, contact, detours=0.0, open_leakage=1.0):
    arrays = np.broadcast_arrays(*map(np.atleast_1d, (carriers, contact, detours)))
    return PatchState(*arrays, np.full(arrays[0].shape, open_leakage))


# --- by the state --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", COMPUTATIONS)
def test_the_distances_grow_with_what_one_patch_cannot_tell(kind):
    difficulty = DIFFICULTY[kind]
    for harder in (
        state([100.0, 30.0, 5.0, 1.0], 0.1),
        state(20.0, 0.1, [0.0, 0.5, 1.0]),
    ):
        for distance in difficulty.distances(harder):
            assert (np.diff(distance) >= 0).all()
    for distance in difficulty.distances(state([100.0, 30.0, 5.0, 1.0], 0.1)):
        assert (np.diff(distance) > 0).all()
    # more contact closes more of the paths
    above_or_below = np.sum(difficulty.distances(state(20.0, [0.1, 0.2, 0.4])), axis=0)
    assert (np.diff(above_or_below) > 0).all()
    # a sealed state is as uncertain as one with a single constriction
    sealed, single = (difficulty.distances(s) for s in (state(np.nan, 0.3, np.nan), state(1, 0.3)))
    assert_allclose(sealed, single)


@pytest.mark.parametrize("kind", COMPUTATIONS)
def test_an_interval_is_as_wide_whatever_the_size_of_the_leakage(kind):
    q = np.array([0.5, 0.1, 1e-2, 0.0])
    ends = interval_widths(kind).ends(q, state([50, 20, 5, np.nan], 0.2))
    scaled = state([50, 20, 5, np.nan], 0.2, open_leakage=1e-9)
    for end, other in zip(ends, interval_widths(kind).ends(1e-9 * q, scaled), strict=True):
        assert_allclose(other, 1e-9 * end)
    lower, upper = ends
    assert (lower <= q).all()
    assert (q < upper).all()
    assert lower[3] == 0
    assert np.isfinite(upper).all()


def test_no_upper_end_is_far_above_an_open_seal():
    hardest = state(1.0, 0.8, 1.0)
    for kind in COMPUTATIONS:
        widths, most = interval_widths(kind), DIFFICULTY[kind].largest_ratio
        assert widths.ends(np.array([0.1]), hardest)[1] == most
        assert widths.ends(np.array([most]), hardest)[1] == 2 * most


def test_leakage_against_the_drop_has_its_ends_on_its_own_side():
    part = calibrated_part("patch", "in order", np.array([-0.5]), state(20.0, 0.1))
    assert part.upper[0] < -0.5 < part.lower[0] < 0


def scene_of(loading, seed=3, **changes):
    waves = {"hurst": 0.8, "rms_slope": 0.2, "roll_off": 20e-6, "cut_off": 8e-6}
    face = fs.self_affine((64, 64), (64e-6, 64e-6), **waves, rng=seed)
    surface = fs.Topography(face.heights, face.spacing, (False, False))
    return replace(steel_scene(surface, loading=loading, **changes), rtol=1e-6)


CYCLE = {"unload_from": (6e8,), "unloading": (5e8, 3e8, 1e8)}


@pytest.mark.parametrize(
    ("breadth", "effect"), [(None, "ignored"), (1e-4, "ignored"), (1e-4, "acts")]
)
def test_the_interval_of_one_load_is_the_same_whichever_other_loads_are_listed(breadth, effect):
    """With a fluid that acts, states are interpolated between tabulated ones, which other loads place elsewhere."""
    fluid = {"fluid_pressure": effect, "inlet_pressure": 2e7}
    sampling = fs.Sampling(3e-4, realisations=8, seed=1, breadth=breadth)

    def intervals(loading, load):
        scene = scene_of(loading, **fluid, **CYCLE)
        study = fs.stochastic(scene, None, sampling)
        budget = fs.error_budget(scene, study)
        at = [(s.pressure, s.unloaded_from) for s in scene.steps].index(load)
        patch = budget.parts[-1]
        ends = patch.lower[at], patch.upper[at], budget.lower[at], budget.upper[at]
        return np.log(np.maximum(ends, 1e-12))

    every = (1e8, 2e8, 3e8, 4.5e8, 6e8)
    tolerance = 0.02 if effect == "ignored" else 0.12
    for load in ((6e8, None), (3e8, 6e8)):
        # of an interval of about ± 1 in the logarithm
        assert_allclose(intervals((6e8,), load), intervals(every, load), atol=tolerance)


def test_the_number_of_realisations_is_that_of_the_state_that_needs_most():
    """A load asks for as many whether or not others are listed with it."""
    rng = np.random.default_rng(1)
    draws = np.exp(0.3 * rng.normal(size=(6, 3))) * [1.0, 0.1, 1e-3]
    states = [state(*values) for values in ((80, 0.05), (30, 0.2), (3, 0.4))]
    alone = [_count_needed(draws[:, [n]], "in order", one) for n, one in enumerate(states)]
    together = PatchState(
        *(np.concatenate(v) for v in zip(*(vars(s).values() for s in states), strict=True))
    )
    assert _count_needed(draws, "in order", together) == max(alone)


def test_intervals_of_a_load_cycle_are_monotone():
    scene = scene_of((1e8, 3e8, 6e8, 9e8), unload_from=(6e8, 9e8), unloading=(5e8, 3e8, 1e8))
    study = fs.stochastic(scene, None, fs.Sampling(3e-4, realisations=5, seed=1))
    budget, steps = fs.error_budget(scene, study), scene.steps
    for branch in steps.branches[1:]:
        peak = steps.peak_indices[branch[0]]
        assert (budget.upper[peak] <= budget.upper[branch]).all()
        assert (budget.lower[peak] <= budget.lower[branch]).all()
    loading = np.flatnonzero(steps.on_loading)
    assert (np.diff(budget.upper[loading]) <= 0).all()
    assert (np.diff(budget.lower[loading]) <= 0).all()


def test_two_measured_patches_narrow_the_interval():
    """Their common state has twice the carriers."""
    narrower = []
    for seed in range(3):
        patches = [scene_of((4e8,), 10 * seed + n).surface for n in range(2)]
        half_widths = []
        for surface in (patches[0], patches[1], Patches(patches)):
            scene = replace(scene_of((4e8,)), surface=surface)
            study = fs.stochastic(scene, None, fs.Sampling(3e-4, realisations=5, seed=1))
            widths = interval_widths(study.kind, len(surface.patches))
            lower, upper = widths.ends(study.quantile(0.5), study.patch_state)
            half_widths.append(float(np.log(upper / lower)[0]) / 2)
        narrower.append(half_widths[2] / np.mean(half_widths[:2]))
    assert max(narrower) < 1.0
    assert np.mean(narrower) < 0.93


# --- calibration ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", COMPUTATIONS)
def test_each_end_leaves_out_as_much_of_its_calibration_as_it_may(kind):
    """Steps of a scene share its weight, and a scene that is not there is beyond all."""
    rows = [row for row in calibration_rows(kind) if row["patch"] != "both"]
    rows = [row for row in rows if float(row["leakage"]) > 0]
    leakage, truth = (np.array([float(row[n]) for row in rows]) for n in ("leakage", "truth"))
    scene = np.array([row["scene"] for row in rows])
    # an end that the open seal limits is of another kind
    limit = 0.99 * DIFFICULTY[kind].largest_ratio
    kept = truth < limit
    rows = [row for row, keep in zip(rows, kept, strict=True) if keep]
    leakage, truth, scene = leakage[kept], truth[kept], scene[kept]
    widths, end = IntervalWidths.calibrate(kind, rows), (1 + DIFFICULTY[kind].fraction) / 2
    names = list(scene)
    weight = np.array([1 / names.count(name) for name in names]) / (widths.scenes + 1)
    beyond = 1 / (widths.scenes + 1)

    def missed(above):
        _, upper = replace(widths, above=above).ends(leakage, state_of_rows(rows))
        return weight[truth > upper].sum() + beyond

    largest = missed(20.0)
    assert missed(widths.above * (1 + 1e-9)) <= max(1 - end, largest) + 1e-9
    assert missed(widths.above * (1 - 1e-9)) > 1 - end
    assert 0.0 < widths.below < 20.0


def test_a_quantile_weighs_scenes_and_not_steps():
    score = np.array([1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 4.0])
    scene = np.array(["a", "b", *["c"] * 6, "d"])
    # weights 1/5 each, one fifth beyond all
    assert weighted_quantile(score, scene, 0.2) == 1.0
    assert weighted_quantile(score, scene, 0.39) == 2.0
    assert weighted_quantile(score, scene, 0.59) == 3.0
    assert weighted_quantile(score, scene, 0.95) == 4.0


def test_a_truth_below_the_least_is_no_further_than_that():
    leakage = np.array([1.0, 1.0, 0.1 * LEAST_TRUTH, 1e-6 * LEAST_KNOWN])
    truth = np.array([0.0, 0.5, 0.0, LEAST_KNOWN])
    below, above = distances_to_truth(leakage, truth)
    assert_allclose(below[:3], [-np.log(LEAST_TRUTH), np.log(2), 0.0])
    assert_allclose(above[[1, 3]], [-np.log(2), 0.0])
    assert np.isneginf(above[[0, 2]]).all()
