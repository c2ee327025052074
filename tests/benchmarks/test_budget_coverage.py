"""The error budget holds the truth of scenes that neither it nor its calibration has seen."""

import numpy as np
import pytest
from scipy.stats import binom

import budget_coverage
from drawn_scenes import HELD_OUT, KINDS, Drawn


@pytest.mark.parametrize("kind", KINDS)
def test_a_drawn_face_is_the_same_on_any_grid(kind):
    """Its waves are those that 8 pixels resolve, and a filtered face has lost the others."""
    drawn = Drawn(kind, HELD_OUT[0], side=64)
    coarse, fine = drawn.surface(), drawn.surface(3)
    # every third point of the finer grid is at a point of the coarser one
    np.testing.assert_allclose(
        fine.heights[1::3, 1::3], coarse.heights, atol=1e-3 * np.ptp(coarse.heights)
    )
    if kind == "filtered":
        assert drawn.surface(filtered=False).rms_slope > 1.2 * fine.rms_slope


def states_of(scenes, long, function=None):
    """Judged states of scenes of every kind."""
    with np.errstate(divide="ignore", invalid="ignore"):
        for solve, kind, seed in budget_coverage.tasks_of(scenes, long):
            found = (function or solve)(kind, seed)
            yield from budget_coverage.judged(kind, seed, found)


def small(kind, seed):
    return budget_coverage.whole_face(Drawn(kind, seed, side=96))


def assert_mostly_held(states, at_least):
    """Of one load of each scene no fewer than a right band has in 99 of 100 counts."""
    held = [state["holds"] for state in states if state["picked"]]
    assert len(held) >= at_least
    assert sum(held) >= binom.ppf(0.01, len(held), 0.95)


@pytest.mark.slow
def test_bands_hold_the_truth_of_a_dozen_small_scenes():
    states = list(states_of(2, 0, small))
    assert_mostly_held(states, 12)
    leaks = [state for state in states if state["state"] == "leaks"]
    assert np.mean([state["holds"] for state in leaks]) > 0.9
    width, error = (np.median([state[name] for state in leaks]) for name in ("width", "error"))
    assert width < 10 * error


@pytest.mark.slow
def test_bands_hold_the_truth_of_a_hundred_scenes():
    states = list(states_of(18, 10))
    for method, at_least in (("deterministic", 100), ("drawn seals", 35)):
        assert_mostly_held([state for state in states if state["method"] == method], at_least)
