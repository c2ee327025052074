"""Load programmes: their order, the masks and indices of their steps, and what they refuse."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from femseal.base import InputError
from femseal.loads import LoadProgramme, LoadStep

PROGRAMME = LoadProgramme.of((1e8, 2e8, 4e8), (2e8, 4e8), (3e8, 1e8))


def test_peaks_are_added_to_the_loading_curve():
    steps = LoadProgramme.of([1e8, 3e8], unload_from=[2e8], unloading=[0.5e8, 1.5e8, 2.5e8])
    assert [(s.branch, s.pressure) for s in steps] == [
        ("loading", 1e8),
        ("loading", 2e8),
        ("loading", 3e8),
        ("unloading", 1.5e8),
        ("unloading", 0.5e8),
    ]
    assert {s.unloaded_from for s in steps[3:]} == {2e8}


def test_names_of_load_steps_say_branch_and_pressure():
    assert LoadStep(2e8).name == "loading 200 MPa"
    assert LoadStep(2e8, 9e8).name == "unloading 200 MPa from 900 MPa"


@settings(deadline=None, max_examples=50)
@given(
    loading=st.sets(st.floats(0, 1e9), min_size=1, max_size=6),
    peaks=st.sets(st.floats(1e6, 1e9), max_size=3),
    unloading=st.sets(st.floats(0, 9e5), min_size=1, max_size=4),
)
def test_load_steps_are_in_the_order_of_solution(loading, peaks, unloading):
    steps = LoadProgramme.of(sorted(loading), sorted(peaks), sorted(unloading) if peaks else ())
    up = [s.pressure for s in steps if s.branch == "loading"]
    assert up == sorted(loading | peaks)
    for peak in peaks:
        down = [s.pressure for s in steps if s.unloaded_from == peak]
        assert down == sorted(unloading, reverse=True)
    assert len(steps) == len(up) + len(peaks) * (len(unloading) if peaks else 0)
    assert LoadProgramme.of(steps.loading, steps.unload_from, steps.unloading) == steps


def test_branches_of_a_programme_are_indexed():
    assert [s.name for s in PROGRAMME[3:]] == [
        "unloading 100 MPa from 200 MPa",
        "unloading 300 MPa from 400 MPa",
        "unloading 100 MPa from 400 MPa",
    ]
    assert (PROGRAMME.loading, PROGRAMME.unload_from) == ((1e8, 2e8, 4e8), (2e8, 4e8))
    assert PROGRAMME.unloading == (3e8, 1e8)
    assert_array_equal(PROGRAMME.pressures, [1e8, 2e8, 4e8, 1e8, 3e8, 1e8])
    assert_array_equal(PROGRAMME.on_loading, [True] * 3 + [False] * 3)
    assert_array_equal(PROGRAMME.peak_indices, [0, 1, 2, 1, 2, 2])


def test_a_programme_is_a_tuple_and_pickles():
    again = pickle.loads(pickle.dumps(PROGRAMME))
    assert type(again) is LoadProgramme
    assert again == PROGRAMME == tuple(PROGRAMME)
    assert PROGRAMME.index(LoadStep(1e8, 2e8)) == 3


def test_an_empty_programme_has_empty_masks():
    empty = LoadProgramme(())
    assert empty.on_loading.dtype == bool
    assert empty.peak_indices.dtype == np.int64


def test_loads_that_do_not_rise_are_answered_in_their_unit():
    """A force is answered as a force, a line load as a line load, and not as a pressure in pascals."""
    for unit, texts, name in (
        ("Pa", "2 MPa, 1 MPa", "pressures"),
        ("N", "2 MN, 1 MN", "forces"),
        ("N/m", "2 MN/m, 1 MN/m", "line loads"),
    ):
        with pytest.raises(InputError) as caught:
            LoadProgramme.of([2e6, 1e6], unit=unit)
        assert caught.value.given == texts
        assert f"rising {name}" in caught.value.expected
        with pytest.raises(InputError) as caught:
            LoadProgramme.of([1e6, 2e6], [2e6], [3e6], unit=unit)
        assert f"below the peak, {texts.partition(',')[0]}" in caught.value.expected
        with pytest.raises(InputError) as caught:
            LoadProgramme.of([1e6, -2e6], unit=unit)
        assert caught.value.expected == f"a list of finite {name} >= 0 [{unit}]"


def test_an_unknown_unit_of_loads_is_refused():
    with pytest.raises(InputError, match=r"^unit: given psi, expected one of Pa, N, N/m"):
        LoadProgramme.of([1.0], unit="psi")
