"""Curves of a cell over any path of the pressure: exact at the states of the ladder, and sane between them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal.face.curves import CellCurves, LogCurve, local_peaks
from femseal.loads import LoadProgramme, LoadStep

FRACTIONS = (0.8, 0.5, 0.2, 0.05)
LOADING = np.linspace(0.2, 1.0, 9) ** 3 * 8e8


def ladder(peaks=(2, 5, 8), loading=LOADING):
    loads = [float(p) for p in loading]
    down = [LoadStep(f * loads[n], loads[n]) for n in peaks for f in FRACTIONS]
    return LoadProgramme([*map(LoadStep, loads), *down])


def law(p, peak=None, steep=6.0):
    """ln k that is straight in the cube root on loading; unloading gives a part of it back, as ln(peak/p)."""
    top = -steep * np.cbrt(p / 8e8)
    if peak is None:
        return top
    below = -steep * np.cbrt(peak / 8e8)
    return below + 0.3 * (top - below)


def values(steps, closed=np.inf, reopens=1.0):
    """k of the states of a ladder; closed from a pressure on, open again below a fraction of the peak."""
    found = []
    for step in steps:
        if step.unloaded_from is None:
            found.append(np.exp(law(step.pressure)) if step.pressure < closed else 0.0)
        else:
            shut = step.unloaded_from >= closed and step.pressure > reopens * step.unloaded_from
            found.append(0.0 if shut else np.exp(law(step.pressure, step.unloaded_from)))
    return np.array(found)


@pytest.mark.parametrize("closed", [np.inf, 3e8])
@pytest.mark.parametrize("peaks", [(8,), (2, 5, 8)])
def test_states_of_the_ladder_are_exact(closed, peaks):
    steps = ladder(peaks)
    k = values(steps, closed, reopens=0.3)
    assert (k == 0).any() == np.isfinite(closed)
    assert_allclose(
        CellCurves(steps, k).k_on_paths(steps.pressures[:, None], steps)[:, 0], k, rtol=1e-10
    )


def test_a_straight_line_in_the_cube_root_is_exact_between_states():
    steps = ladder(())
    p = np.linspace(LOADING[0], LOADING[-1], 101)
    assert_allclose(CellCurves(steps, values(steps)).k_on_loading(p), np.exp(law(p)), rtol=1e-10)
    # beyond the ends it is constant
    assert_allclose(
        CellCurves(steps, values(steps)).k_on_loading(np.array([0.0, 2e9])),
        np.exp(law(LOADING[[0, -1]])),
    )


def test_the_error_between_states_falls_with_the_third_order_or_better():
    """ln k of a smooth bend, from ladders of 5, 9 and 17 states."""
    p = np.linspace(LOADING[0], LOADING[-1], 301)

    def bent(p):
        return np.exp(-3 * np.cbrt(p / 8e8) - 4 * np.cbrt(p / 8e8) ** 3)

    errors = []
    for n in (5, 9, 17):
        steps = ladder((), np.linspace(0.2, 1.0, n) ** 3 * 8e8)
        found = CellCurves(steps, bent(steps.pressures)).k_on_loading(p)
        errors.append(np.abs(np.log(found / bent(p))).max())
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 4
    assert errors[2] < 2e-3


@pytest.mark.parametrize("closed", [np.inf, 3e8, 2.2e8])
def test_curves_are_monotone_and_unloading_lies_below_loading(closed):
    steps = ladder()
    curves = CellCurves(steps, values(steps, closed, reopens=0.3))
    p = np.linspace(1e6, 8e8, 400)
    loaded = curves.k_on_loading(p)
    assert (np.diff(loaded) <= 0).all()
    for peak in np.linspace(2e7, 8e8, 23):
        below = p[p < peak]
        found = curves.k_on_unloading(below, np.full(below.shape, peak))
        assert (np.diff(found) <= 1e-12 * found[:-1]).all()
        assert (found <= curves.k_on_loading(below) * (1 + 1e-12)).all()
        if peak < closed:
            floor = curves.k_on_loading(np.array([peak]))
            assert (found >= floor * (1 - 1e-12)).all()


def test_unloading_starts_on_the_loading_curve():
    steps = ladder()
    curves = CellCurves(steps, values(steps))
    for peak in np.linspace(5e7, 8e8, 37):
        near = curves.k_on_unloading(np.array([peak * (1 - 1e-9)]), np.array([peak]))
        assert_allclose(near, curves.k_on_loading(np.array([peak])), rtol=1e-6)


def test_unloading_between_peaks_is_that_of_the_law():
    """ln k of the law is smooth in both pressures: three peaks give it within some per cent."""
    steps = ladder()
    curves = CellCurves(steps, values(steps))
    for peak in (9e7, 2.5e8, 6e8):
        p = peak * np.array([0.1, 0.3, 0.6, 0.9])
        assert_allclose(curves.k_on_unloading(p, np.full(4, peak)), np.exp(law(p, peak)), rtol=0.06)


def test_a_closed_cell_stays_closed_until_it_reopens():
    steps = ladder()
    k = values(steps, closed=3e8, reopens=0.3)
    curves = CellCurves(steps, k)
    loading = LOADING[LOADING < 3e8]
    end = np.cbrt(loading[-1]) / 2 + np.cbrt(LOADING[len(loading)]) / 2
    assert curves.k_on_loading(np.array([(0.999 * end) ** 3]))[0] > 0
    assert curves.k_on_loading(np.array([(1.001 * end) ** 3]))[0] == 0
    peak = np.full(60, 8e8)
    p = np.linspace(0.01, 0.99, 60) * 8e8
    found = curves.k_on_unloading(p, peak)
    reopened = p / peak < 0.35  # halfway between the open and the closed state, .2 and .5
    assert_array_equal(found > 0, reopened)
    # between the peak that just closes it and the next of the ladder, it reopens at every fraction in between
    opens = []
    for peak in np.linspace(end**3 * 1.0001, 8e8, 7):
        p = np.linspace(0.01, 0.9999, 400) * peak
        opens.append((p / peak)[curves.k_on_unloading(p, np.full(400, peak)) > 0].max())
    assert opens[0] > 0.99
    assert (np.diff(opens) < 0).all()
    assert opens[-1] == pytest.approx(0.35, abs=0.01)


def test_a_cell_that_never_opens_or_never_unloads():
    steps = ladder()
    curves = CellCurves(steps, np.zeros(len(steps)))
    assert not curves.k_on_paths(steps.pressures[:, None], steps).any()
    assert not curves.k_on_unloading(np.array([1e6, 3e8]), np.array([1e8, 8e8])).any()
    steps, p = ladder(()), np.array([1e8, 5e8])
    curves = CellCurves(steps, values(steps))
    assert_array_equal(curves.k_on_unloading(p, np.full(2, 8e8)), curves.k_on_loading(p))


def test_the_peak_of_a_cell_is_that_of_its_own_path():
    """A map that presses a cell less while the load rises, and more while it falls."""
    seal = LoadProgramme.of([1e8, 2e8, 4e8], unload_from=[2e8, 4e8], unloading=[3e8, 1e8])
    falling, rising = 1e8 * np.array([[3, 2, 1, 2.5, 0.5, 4], [1, 2, 4, 1, 3, 1]])
    found = local_peaks(np.stack([falling, rising], axis=1), seal)
    assert_allclose(found.T / 1e8, [[3, 3, 3, 3, 3, 4], [1, 2, 4, 2, 4, 4]])
    steps = ladder()
    curves = CellCurves(steps, values(steps))
    k = curves.k_on_paths(falling[:, None], seal)[:, 0]
    assert_allclose(k[[0, 5]], curves.k_on_loading(falling[[0, 5]]))
    assert_allclose(k[1:5], curves.k_on_unloading(falling[1:5], np.full(4, 3e8)))


def test_a_step_whose_flow_failed_is_left_out():
    steps = ladder((5, 8))
    k = values(steps)
    whole = CellCurves(steps, k)
    for lost in (0, 3, 8, 9, 12, len(steps) - 1):
        holed = k.copy()
        holed[lost] = np.nan
        curves = CellCurves(steps, holed)
        p = np.linspace(3e7, 7.9e8, 50)
        assert_allclose(
            curves.k_on_loading(p), whole.k_on_loading(p), rtol=0.01 if lost not in (0, 8) else 4
        )
        assert np.isfinite(curves.k_on_unloading(0.5 * p, p)).all()
        assert (curves.k_on_loading(p) > 0).all()
    on_loading, down = steps.on_loading, ~steps.on_loading
    lost = CellCurves(steps, np.where(on_loading, np.nan, k))
    assert np.isnan(lost.k_on_paths(steps.pressures[:, None], steps)).all()
    lost = CellCurves(steps, np.where(down, np.nan, k)).k_on_paths(steps.pressures[:, None], steps)[
        :, 0
    ]
    assert_allclose(lost[on_loading], k[on_loading])
    assert np.isnan(lost[down]).all()


def test_a_curve_of_logarithms_ends_where_it_closes():
    curve = LogCurve(np.array([1.0, 2.0, 3.0, 4.0]), np.exp([-1.0, -2.0, -np.inf, -1.0]))
    assert curve.end == 2.5
    assert_allclose(curve(np.array([0.0, 1.0, 1.5, 2.0, 2.4])), [-1, -1, -1.5, -2, -2.4])
    assert np.isneginf(curve(np.array([2.6, 4.0]))).all()
    single = LogCurve(np.array([1.0, 2.0]), np.array([1.0, 0.0]))
    assert_allclose(single(np.array([0.5, 1.4, 1.6])), [0, 0, -np.inf])
