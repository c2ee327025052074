"""Pressures that a leakage class needs: exact for power laws, and never extrapolated."""

import numpy as np
from leakage_laws import FALL, RISE, STEPS, power_law
from numpy.testing import assert_allclose
from power_law_seals import AMPLITUDES, seals_of

from femseal.base import to_text
from femseal.designs.requirements import Seals, requirement, sealing_load
from femseal.loads import LoadProgramme


def pascals(value):
    return to_text(value, "Pa", 3)


MEAN, LIMIT = 1e12, 1e12 * 2e8**-FALL


def test_pressures_of_power_laws_are_exact():
    seals = seals_of()
    assert_allclose(seals.needed_pressures(LIMIT), (AMPLITUDES / LIMIT) ** (1 / FALL))
    for peak in (4e8, 9e8):
        exact = peak * (AMPLITUDES * peak**-FALL / LIMIT) ** (1 / RISE)
        exact = np.where(exact < 1e7, 0.0, np.where(exact > peak, np.inf, exact))
        assert_allclose(seals.needed_pressures(LIMIT, peak), exact)
    assert np.isfinite(seals.needed_pressures(LIMIT, 4e8)).all()


def test_a_share_of_the_seals_keeps_the_class():
    """At its pressure the share of seals in the class is at least the probability, and just below it is not."""
    for peak, leak in (
        (None, lambda p: AMPLITUDES * p**-FALL),
        (4e8, lambda p: AMPLITUDES * 4e8**-FALL * (p / 4e8) ** -RISE),
    ):
        needed = seals_of().needed_by_fraction(0.9, LIMIT, peak)
        assert np.mean(leak(needed.value * 1.000001) <= LIMIT) >= 0.9
        assert np.mean(leak(needed.value * 0.999999) <= LIMIT) < 0.9
        assert needed.relation == "="
        assert needed.low == needed.value == needed.computed
    need = requirement(seals_of(), "L", LIMIT, 0.9)
    assert need.for_fraction == seals_of().needed_by_fraction(0.9, LIMIT)
    # as computed it is the median seal
    middle = np.sort(AMPLITUDES)[(len(AMPLITUDES) - 1) // 2]
    assert_allclose(need.assembly.computed, (middle / LIMIT) ** (1 / FALL))


def test_the_whole_interval_decides():
    """An interval that is a factor f wide on both sides moves Qmin by f to the power of 1/3."""
    median = power_law([MEAN])[0]

    def needed(low, high, scatter=1.0):
        seals = MEAN * np.array([1 / scatter, 1.0, scatter])
        interval = low * median, high * median
        return requirement(seals_of(power_law(seals), STEPS, interval), "L", LIMIT, 0.9).assembly

    known, vague = needed(1 / 1.3, 1.3), needed(0.0, 1e6)
    found = np.array([known.low, known.computed, known.value]) / 2e8
    assert_allclose(found, np.array([1 / 1.3, 1, 1.3]) ** (1 / FALL))
    assert known.text(pascals) == "from 218 MPa on (as computed: from 200 MPa on)"
    assert (vague.low, vague.value, vague.relation) == (0.0, np.inf, ">")
    # it holds the scatter of the seals already
    assert needed(1 / 1.3, 1.3, scatter=5.0) == known
    # what is sealed leaks what its interval allows
    sealed = np.where(STEPS.pressures < 1e8, median, 0.0)
    upper = np.where(STEPS.pressures == 1e8, 10 * LIMIT, sealed)
    wide = requirement(seals_of(sealed[None], STEPS, (sealed, upper)), "L", LIMIT, 0.9).assembly
    assert wide.computed < wide.value


def test_what_keeps_a_class_keeps_it_at_higher_loads():
    """Intervals of a test fluid are those of the run by their factor, which may rise faster than the leakage falls."""
    leakage, limit = power_law([1e12]), 1e12 * 2e8**-FALL
    upper = np.where(STEPS.pressures > 5e8, 10 * limit, leakage[0])
    seals = Seals.from_leakage(STEPS, leakage, (leakage[0], upper))
    assert requirement(seals, "L", limit, 0.5).assembly.text(pascals) == "from 200 MPa on"


def test_nothing_is_extrapolated():
    for pressure, relation, words in (
        (1e9, ">", "at no load up to 900 MPa"),
        (9e6, None, "at every load from 10 MPa on"),
    ):
        need = requirement(seals_of(power_law([MEAN])), "L", MEAN * pressure**-FALL, 0.5)
        assert need.assembly.text(pascals) == words
        assert relation is None or need.assembly.relation == need.service[9e8].relation == relation
    assert need.service[4e8].text(pascals) == "down to the lowest load of 10 MPa"
    assert need.assembly.low == 0
    never = requirement(seals_of(power_law([MEAN])), "L", MEAN * 1e9**-FALL, 0.5)
    assert never.service[4e8].text(pascals) == "not even at 400 MPa"


def test_loads_that_the_fluid_carries_alone_are_open():
    seals = seals_of(np.where(STEPS.pressures == 1e7, np.nan, power_law(AMPLITUDES)))
    assert seals.count == len(AMPLITUDES)
    assert_allclose(seals.needed_pressures(LIMIT), (AMPLITUDES / LIMIT) ** (1 / FALL))
    assert np.all(seals.needed_pressures(LIMIT, 9e8) >= 3e7)
    assert seals_of(np.full((60, len(STEPS)), np.nan)).count == 0
    # also on an unloading, at loads that the first loading sealed
    late = ~STEPS.on_loading & (STEPS.pressures < 5e7)
    seals = seals_of(np.where(late, np.nan, power_law(AMPLITUDES)))
    assert seals.count == len(AMPLITUDES)
    assert np.isinf(seals.leakage[:, late]).all()
    assert np.all(seals.needed_pressures(1.0, 9e8) == 1e8)


def test_where_a_seal_closes_the_step_that_keeps_the_limit_is_taken():
    """No logarithm reaches 0: between an open and a closed step the closed one is known to be enough."""
    loading = LoadProgramme.of(STEPS.loading)
    closing = seals_of(np.array([[5.0, 1.0, 1e-3, 0.0, 0.0]]), loading)
    assert sealing_load(closing).value == 4e8
    # a loading that leaks more again counts from there on
    again = seals_of(np.array([[1.0, 0.1, 1.0, 0.1, 0.01]]), loading)
    assert 1e8 < again.needed_pressures(0.5)[0] < 4e8
