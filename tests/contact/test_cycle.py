"""Load cycle: invariants of loading and unloading with plastic deformation, bad input."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from plastic_contacts import yielding_face

from femseal.base import InputError
from femseal.contact import (
    HalfSpace,
    PerfectlyPlastic,
    contact_at_loads,
    load_cycle,
    load_states,
    solve_contact,
)
from femseal.loads import LoadProgramme

E, H, D = 115e9, 4e9, 1e-6
LAW = PerfectlyPlastic(H)
SHAPE = (48, 40)
HALF_SPACE = HalfSpace(SHAPE, (D, D), E, ("mirror", "periodic"))
PEAKS = (0.2 * H, 0.4 * H)
LOADING = (0.05 * H, 0.1 * H, 0.2 * H, 0.3 * H, 0.4 * H)
UNLOADING = (0.02 * H, 0.1 * H, 0.15 * H, 0.3 * H)
RTOL = 1e-9


GAP = yielding_face(SHAPE)


def alone(gap, pressure, hardness=H, deformation=None):
    return solve_contact(
        gap, HALF_SPACE, pressure=pressure, hardness=hardness, deformation=deformation, rtol=RTOL
    )


def cycle_of(hardness=H, **loads):
    given = {"loading": LOADING, "unload_from": PEAKS, "unloading": UNLOADING} | loads
    return load_cycle(GAP, HALF_SPACE, hardness=hardness, rtol=RTOL, **given)


@pytest.fixture(scope="module")
def cycle():
    return cycle_of()


def state(cycle, pressure, peak=None):
    (found,) = [s for s in cycle if s.pressure == pressure and s.unloaded_from == peak]
    return found.contact


def test_states_follow_the_programme(cycle):
    steps = LoadProgramme.of(LOADING, PEAKS, UNLOADING)
    assert [(s.pressure, s.unloaded_from) for s in cycle] == [
        (s.pressure, s.unloaded_from) for s in steps
    ]
    for s in cycle:
        assert_allclose(s.contact.mean_pressure, s.pressure, rtol=1e-12)
        assert s.contact.residual <= RTOL


def test_loading_is_path_independent(cycle):
    for p in LOADING:
        assert np.array_equal(state(cycle, p).pressure, alone(GAP, p).pressure)


@pytest.mark.parametrize("peak", PEAKS)
def test_reloading_follows_the_unloading_curve(cycle, peak):
    """Down to a pressure and up again: what yielded on the way, if anything, changes nothing up to the peak."""
    assert state(cycle, peak).plastic_fraction > 0.02
    for start, high, expected in (
        (state(cycle, peak), peak, state(cycle, peak)),
        (state(cycle, 0.02 * H, peak), 0.1 * H, state(cycle, 0.1 * H, peak)),
        (state(cycle, 0.1 * H, peak), 0.15 * H, state(cycle, 0.15 * H, peak)),
    ):
        up = alone(GAP, high, deformation=start.plastic_deformation)
        assert_allclose(up.pressure, expected.pressure, rtol=0, atol=1e-6 * H)
        for name in ("gap", "plastic_deformation", "approach"):
            found, exact = getattr(up, name), getattr(expected, name)
            assert_allclose(found, exact, rtol=0, atol=1e-6 * np.ptp(GAP))


@pytest.mark.parametrize("peak", PEAKS)
def test_beyond_the_peak_the_virgin_curve_continues(cycle, peak):
    deformed = GAP + state(cycle, peak).plastic_deformation
    for p in (0.5 * H, 0.8 * H):
        virgin, reloaded = alone(GAP, p), alone(deformed, p)
        assert_allclose(reloaded.pressure, virgin.pressure, rtol=0, atol=1e-6 * H)
        assert_allclose(reloaded.gap, virgin.gap, rtol=0, atol=1e-6 * np.ptp(GAP))
        total = reloaded.plastic_deformation + state(cycle, peak).plastic_deformation
        assert_allclose(total, virgin.plastic_deformation, rtol=0, atol=1e-6 * np.ptp(GAP))


def test_permanent_deformation_grows_with_the_load(cycle):
    left = [state(cycle, p).plastic_deformation for p in LOADING]
    for a, b in pairwise(left):
        assert np.all(b >= a - 1e-7 * np.ptp(GAP))
        assert b.sum() > a.sum()


@pytest.mark.parametrize("peak", PEAKS)
def test_unloading_keeps_the_plastic_deformation(cycle, peak):
    left = state(cycle, peak).plastic_deformation
    for s in cycle:
        if s.unloaded_from == peak:
            assert np.all(s.contact.plastic_deformation >= left)
            # an elastic half-space does not yield further on the way down
            assert_allclose(s.contact.plastic_deformation, left, rtol=0, atol=1e-6 * np.ptp(GAP))


def test_unloading_has_more_contact_and_less_gap_than_loading(cycle):
    for p in (0.1 * H, 0.3 * H):
        down, up = state(cycle, p, 0.4 * H), state(cycle, p)
        assert down.area_fraction > up.area_fraction
        assert down.mean_gap < up.mean_gap
        assert down.plastic_fraction < up.plastic_fraction


@pytest.mark.parametrize("hardness", [H, H * np.random.default_rng(1).uniform(0.5, 1.5, SHAPE)])
def test_unloading_to_nothing_leaves_the_deformed_gap(hardness):
    peak = 0.2 * H
    up, down = cycle_of(hardness, loading=[peak], unload_from=[peak], unloading=[0.0])
    deformed = GAP + up.contact.plastic_deformation
    assert_allclose(down.contact.gap, deformed - deformed.min(), rtol=0, atol=1e-15)
    assert np.array_equal(down.contact.plastic_deformation, up.contact.plastic_deformation)
    again = alone(deformed, peak, hardness)
    assert_allclose(again.pressure, up.contact.pressure, rtol=0, atol=1e-6 * H)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"loading": []}, "loading"),
        ({"loading": [2e8, 1e8]}, "rising"),
        ({"loading": [1e8, 1e8]}, "rising"),
        ({"loading": [-1e8]}, "loading"),
        ({"loading": [np.nan]}, "loading"),
        ({"loading": 1e8}, "loading"),
        ({"loading": ["1 MPa"]}, "loading"),
        ({"loading": [1e8, 5e9]}, "hardness"),
        ({"unload_from": [5e9], "unloading": [1e8]}, "hardness"),
        ({"unload_from": [-1.0], "unloading": [1e8]}, "unload_from"),
        ({"unload_from": [1e8]}, "unloading"),
        ({"unload_from": [1e8], "unloading": [2e8]}, "unloading"),
        ({"unloading": [1e7]}, "unload_from"),
        ({"hardness": -1.0}, "hardness"),
        ({"rtol": 0.0}, "rtol"),
        ({"gap0": np.full(SHAPE, np.nan)}, "gap0"),
        ({"gap0": np.zeros((3, 3))}, "gap0"),
    ],
)
def test_bad_programmes_are_refused(change, word):
    given = {"gap0": GAP, "loading": [1e8, 2e8], "hardness": H} | change
    with pytest.raises(InputError, match=word):
        load_cycle(half_space=HALF_SPACE, **given)


def test_yielding_on_unloading_is_reported():
    peak, *states = cycle_of(
        loading=[0.4 * H], unload_from=[0.4 * H], unloading=[0.1 * H, 0.39 * H]
    )
    assert peak.yielded_again == 0
    for state in states:
        grown = state.contact.plastic_deformation - peak.contact.plastic_deformation
        assert grown.min() >= 0
        assert state.yielded_again == pytest.approx(np.mean(grown > 1e-4 * np.ptp(GAP)), abs=0.02)


def test_states_that_do_not_depend_on_each_other_go_to_the_map_together(cycle):
    """All of loading in any order, then all of unloading."""
    calls = []

    def backwards(function, *iterables):
        items = list(zip(*iterables, strict=True))
        calls.append([args[0] for args in items])
        return reversed([function(*item) for item in reversed(items)])

    steps = LoadProgramme.of(LOADING, PEAKS, UNLOADING)
    solve = contact_at_loads(GAP, HALF_SPACE, steps, LAW)
    found = list(load_states(steps, solve, rtol=RTOL, mapper=backwards))
    assert calls == [list(steps[: len(LOADING)]), list(steps[len(LOADING) :])]
    for one, other in zip(found, cycle, strict=True):
        assert_array_equal(one.contact.gap, other.contact.gap)


def test_what_has_not_yielded_goes_back_along_the_loading_and_is_solved_once(contacts):
    """Stops on the loading curve and off it, from two peaks, and the same states as solved alone."""
    loads = {"loading": [1e7, 3e7], "unload_from": [2e7, 3e7], "unloading": [1e7, 0.5e7]}
    cycle = cycle_of(np.inf, **loads)
    assert sorted(contacts) == [0.5e7, 1e7, 2e7, 3e7]
    names = [step.name for step in LoadProgramme.of(**loads)]
    assert [state.name for state in cycle] == names
    for state in cycle:
        expected = alone(GAP, state.pressure, np.inf)
        assert_array_equal(state.contact.pressure, expected.pressure)
        assert_array_equal(state.contact.gap, expected.gap)


def test_only_peaks_that_have_yielded_leave_something(contacts):
    """The first peak is below the pressure at which the highest point yields, the second above."""
    light = alone(GAP, 1e6, np.inf)
    hardness = 1.5 * light.pressure.max()
    cycle = cycle_of(hardness, loading=[1e6], unload_from=[1e6, 1e8], unloading=[5e5])
    assert contacts[1:] == [1e6, 1e8, 5e5, 5e5]
    up, peak, after_light, after_peak = cycle
    assert not up.contact.plastic_deformation.any()
    assert not after_light.contact.plastic_deformation.any()
    assert peak.contact.plastic_deformation.any()
    assert after_peak.contact.mean_gap < after_light.contact.mean_gap
