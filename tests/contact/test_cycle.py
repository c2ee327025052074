"""Load cycle: invariants of loading and unloading with plastic deformation, bad input."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal.base.errors import InputError
from femseal.contact import HalfSpace, PerfectlyPlastic, load_cycle, load_states, solve_contact
from femseal.contact.cycle import _yielded_again
from femseal.loads import LoadProgramme

E, H, D = 115e9, 4e9, 1e-6
LAW = PerfectlyPlastic(H)
SHAPE = (48, 40)
HALF_SPACE = HalfSpace(SHAPE, (D, D), E, ("mirror", "periodic"))
PEAKS = (0.2 * H, 0.4 * H)
LOADING = (0.05 * H, 0.1 * H, 0.2 * H, 0.3 * H, 0.4 * H)
UNLOADING = (0.02 * H, 0.1 * H, 0.15 * H, 0.3 * H)
RTOL = 1e-9


def rough(shape, slope=0.25, seed=0):
    rng = np.random.default_rng(seed)
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None, :])
    amplitude = np.where((q > 0) & (q <= 1 / 6), np.maximum(q, 0.08) ** -1.8, 0.0)
    h = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * amplitude).real
    return h * slope * D / np.sqrt(sum((np.diff(h, axis=a) ** 2).mean() for a in (0, 1)))


GAP = rough(SHAPE)


def alone(gap, pressure, hardness=H, deformation=None):
    return solve_contact(
        gap, HALF_SPACE, pressure=pressure, hardness=hardness, deformation=deformation, rtol=RTOL
    )


@pytest.fixture(scope="module")
def cycle():
    return load_cycle(
        GAP,
        HALF_SPACE,
        loading=LOADING,
        hardness=H,
        unload_from=PEAKS,
        unloading=UNLOADING,
        rtol=RTOL,
    )


def state(cycle, pressure, peak=None):
    (found,) = [s for s in cycle if s.pressure == pressure and s.unloaded_from == peak]
    return found.contact


def test_states_follow_the_programme(cycle):
    assert [(s.pressure, s.unloaded_from) for s in cycle] == [
        (s.pressure, s.unloaded_from) for s in LoadProgramme.of(LOADING, PEAKS, UNLOADING)
    ]
    for s in cycle:
        assert_allclose(s.contact.mean_pressure, s.pressure, rtol=1e-12)
        assert s.contact.residual <= RTOL


def test_loading_is_path_independent(cycle):
    for p in LOADING:
        assert np.array_equal(state(cycle, p).pressure, alone(GAP, p).pressure)


@pytest.mark.parametrize("peak", PEAKS)
def test_at_the_peak_unloading_returns_the_same_state(cycle, peak):
    virgin = state(cycle, peak)
    assert virgin.plastic_fraction > 0.02
    again = alone(GAP, peak, deformation=virgin.plastic_deformation)
    assert_allclose(again.pressure, virgin.pressure, rtol=0, atol=1e-6 * H)
    assert_allclose(again.gap, virgin.gap, rtol=0, atol=1e-6 * np.ptp(GAP))
    assert_allclose(
        again.plastic_deformation, virgin.plastic_deformation, rtol=0, atol=1e-6 * np.ptp(GAP)
    )
    assert_allclose(again.approach, virgin.approach, rtol=0, atol=1e-6 * np.ptp(GAP))


@pytest.mark.parametrize("peak", PEAKS)
def test_reloading_follows_the_unloading_curve(cycle, peak):
    """Down to a pressure and up again: what yielded on the way, if anything, changes nothing up to the peak."""
    left = state(cycle, peak).plastic_deformation
    for low, high in [(0.02 * H, 0.1 * H), (0.1 * H, 0.15 * H)]:
        down = state(cycle, low, peak)
        up = alone(GAP, high, deformation=down.plastic_deformation)
        reference = state(cycle, high, peak)
        assert_allclose(up.pressure, reference.pressure, rtol=0, atol=1e-6 * H)
        assert_allclose(up.gap, reference.gap, rtol=0, atol=1e-6 * np.ptp(GAP))
        assert_allclose(down.plastic_deformation, left, rtol=0, atol=1e-6 * np.ptp(GAP))


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


def test_two_unloadings_share_the_loading_curve(cycle):
    one = load_cycle(
        GAP,
        HALF_SPACE,
        loading=LOADING,
        hardness=H,
        unload_from=PEAKS[:1],
        unloading=UNLOADING,
        rtol=RTOL,
    )
    for s in one:
        assert np.array_equal(
            s.contact.pressure, state(cycle, s.pressure, s.unloaded_from).pressure
        )
    assert sum(s.branch == "loading" for s in cycle) == len(LOADING)


def test_without_hardness_unloading_is_loading():
    states = load_cycle(
        GAP, HALF_SPACE, loading=[1e8, 4e8], unload_from=[4e8], unloading=[1e8], rtol=RTOL
    )
    assert_allclose(states[2].contact.pressure, states[0].contact.pressure, rtol=0, atol=1e-12 * H)
    assert not states[2].contact.plastic_deformation.any()


def test_unloading_to_nothing_leaves_the_deformed_gap(cycle):
    states = load_cycle(
        GAP,
        HALF_SPACE,
        loading=[0.2 * H],
        hardness=H,
        unload_from=[0.2 * H],
        unloading=[0.0],
        rtol=RTOL,
    )
    deformed = GAP + states[0].contact.plastic_deformation
    assert_allclose(states[1].contact.gap, deformed - deformed.min(), rtol=0, atol=1e-15)
    assert np.array_equal(
        states[1].contact.plastic_deformation, states[0].contact.plastic_deformation
    )


def test_hardness_per_point():
    hardness = H * np.random.default_rng(1).uniform(0.5, 1.5, SHAPE)
    peak = 0.3 * H
    states = load_cycle(
        GAP,
        HALF_SPACE,
        loading=[0.1 * H, peak],
        hardness=hardness,
        unload_from=[peak],
        unloading=[0.1 * H],
        rtol=RTOL,
    )
    again = alone(GAP + states[1].contact.plastic_deformation, peak, hardness)
    assert_allclose(again.pressure, states[1].contact.pressure, rtol=0, atol=1e-6 * H)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"loading": []}, "loading"),
        ({"loading": [2e8, 1e8]}, "rising"),
        ({"loading": [1e8, 1e8]}, "rising"),
        ({"loading": [-1e8]}, "loading"),
        ({"loading": [np.nan]}, "loading"),
        ({"loading": [np.inf]}, "loading"),
        ({"loading": 1e8}, "loading"),
        ({"loading": ["1 MPa"]}, "loading"),
        ({"loading": [1e8, 5e9]}, "hardness"),
        ({"unload_from": [5e9], "unloading": [1e8]}, "hardness"),
        ({"unload_from": [-1.0], "unloading": [1e8]}, "unload_from"),
        ({"unload_from": [1e8]}, "unloading"),
        ({"unload_from": [1e8], "unloading": [2e8]}, "unloading"),
        ({"unloading": [1e7]}, "unload_from"),
        ({"unload_from": [1e8], "unloading": [-1e7]}, "unloading"),
        ({"hardness": -1.0}, "hardness"),
        ({"hardness": np.full((3, 3), H)}, "hardness"),
        ({"rtol": 0.0}, "rtol"),
        ({"gap0": np.full(SHAPE, np.nan)}, "gap0"),
        ({"gap0": np.zeros((3, 3))}, "gap0"),
    ],
)
def test_bad_programmes_are_refused_before_anything_is_solved(change, word, monkeypatch):
    def unwanted(*args, **kwargs):
        raise AssertionError("solved")

    monkeypatch.setattr("femseal.contact.active_sets.ActiveSets.solve", unwanted)
    given = {"gap0": GAP, "loading": [1e8, 2e8], "hardness": H} | change
    with pytest.raises(InputError, match=word):
        load_cycle(given.pop("gap0"), HALF_SPACE, **given)


def test_yielding_on_unloading_is_reported():
    states = load_cycle(
        GAP,
        HALF_SPACE,
        loading=[0.4 * H],
        hardness=H,
        unload_from=[0.4 * H],
        unloading=[0.39 * H, 0.1 * H],
    )
    assert states[0].yielded_again == 0
    for state in states[1:]:
        grown = state.contact.plastic_deformation - states[0].contact.plastic_deformation
        assert grown.min() >= 0
        assert state.yielded_again == pytest.approx(np.mean(grown > 1e-4 * np.ptp(GAP)), abs=0.02)
    # a plastic deformation at the wrong place is pressed flat again
    moved = np.roll(states[0].contact.plastic_deformation, 20, axis=0)
    contact = solve_contact(
        GAP, HALF_SPACE, pressure=0.4 * H, hardness=H, deformation=moved, rtol=1e-6
    )
    assert _yielded_again(contact, moved, 1e-6) > 0.02


def test_states_that_do_not_depend_on_each_other_go_to_the_map_together():
    """All of loading in any order, then all of unloading; of each what is taken, worked out where it is solved."""
    gap0, calls = -rough(SHAPE), []

    def backwards(function, *iterables):
        items = list(zip(*iterables, strict=True))
        calls.append([args[0] for args in items])
        done = {n: function(*items[n]) for n in reversed(range(len(items)))}
        return (done[n] for n in range(len(items)))

    steps = LoadProgramme.of(LOADING[:3], PEAKS[:1], UNLOADING[:2])
    expected = list(load_states(gap0, HALF_SPACE, steps, law=LAW))
    taken = list(
        load_states(
            gap0,
            HALF_SPACE,
            steps,
            law=LAW,
            take=lambda s: (s.name, s.contact.gap),
            mapper=backwards,
        )
    )
    assert calls == [list(steps[:3]), list(steps[3:])]
    assert [name for name, _ in taken] == [step.name for step in steps]
    for (_, gap), state in zip(taken, expected, strict=True):
        assert_array_equal(gap, state.contact.gap)
