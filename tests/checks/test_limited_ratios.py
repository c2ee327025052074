"""Warnings that a limit on a leakage ratio determines the median leakage of stochastic seals."""

import numpy as np
import pytest
from small_cases import STRIP

import femseal as fs
from femseal.case import parse_case
from femseal.checks import limited_factor_warnings, limited_median_warnings
from femseal.loads import LoadProgramme
from femseal.preparation import prepare
from femseal.studies import stochastic_study

STEPS = LoadProgramme.of([1e7, 3e7, 1e8], unload_from=[1e8], unloading=[3e7])
SURFACE = np.array([1.0, 0.3, 0.1, 0.2])


@pytest.mark.parametrize(
    ("ratio", "load"),
    [
        ([1, 1, 1, 1], ""),
        ([1, 1.99, 1, 0.51], ""),
        ([1, 2, 1, 1], "loading 30 MPa:"),
        ([1, 0.5, 1, 1], "loading 30 MPa:"),
        ([1, 1, 2, 2], "loading 100 MPa and 1 more load:"),
        ([1, np.nan, 1, 1], ""),
        ([1, 0, 1, 1], ""),
    ],
)
def test_a_median_at_its_largest_or_smallest_ratio_is_warned_of(ratio, load):
    texts = list(limited_median_warnings(STEPS, ratio * SURFACE, SURFACE, 2.0))
    assert len(texts) == bool(load)
    assert all(f"only a limit at {load}" in text for text in texts)


def test_a_leakage_that_is_too_small_to_be_compared_is_not_warned_of():
    """It is less than 1/1000 of the leakage at the first load."""
    surface = SURFACE * [1, 1, 1e-3, 1]
    assert not [*limited_median_warnings(STEPS, surface * [1, 1, 2, 1], surface, 2.0)]


@pytest.mark.parametrize("factor", [3.0, 5.0, 1 / 3, 0.1])
def test_a_limited_correction_factor_is_warned_of(factor):
    cells = SURFACE / [1, 1, factor, 1]
    (text,) = limited_factor_warnings(STEPS, SURFACE, STEPS, SURFACE, cells, 3.0, STEPS.pressures)
    assert "only a limit at loading 100 MPa:" in text
    within = (STEPS, SURFACE, STEPS, SURFACE, SURFACE / 2.9, 3.0, STEPS.pressures)
    assert not [*limited_factor_warnings(*within)]
    # the contact states of the cells have tabulated pressures: the nearest one to 100 MPa is limited
    states = LoadProgramme.of([1e6, 2e7, 9e7])
    table = np.array([2.0, 0.5, 0.1])
    given = (STEPS, SURFACE, states, table, table / [1, 1, factor], 3.0)
    assert [*limited_factor_warnings(*given, STEPS.pressures)] == [text]
    # with fluid pressure on the surfaces, all contact pressures are nearer to the other states
    assert not [*limited_factor_warnings(*given, 0.5 * STEPS.pressures)]


def test_a_load_that_takes_a_limited_factor_from_its_neighbour_is_warned_of():
    """At the highest load the surface is closed but its cells leak: its factor is that of the load below it."""
    steps = LoadProgramme.of([1e7, 3e7, 1e8, 2e8])
    surface, cells = np.array([1.0, 0.5, 0.1, 0.0]), np.array([1.0, 0.5, 0.002, 0.01])
    (text,) = limited_factor_warnings(steps, cells, steps, surface, cells, 3.0, steps.pressures)
    assert "only a limit at loading 100 MPa and 1 more load:" in text


@pytest.mark.parametrize("breadth", [{}, {"breadth": "60 um"}], ids=["in order", "at random"])
def test_a_study_warns_of_its_limit(monkeypatch, breadth):
    """With a limit close to 1, every ratio of this strip is limited."""
    strip = STRIP | {"stochastic": {"length": "300 um", "realisations": 3} | breadth}
    prepared = prepare(parse_case(strip))

    def solve():
        return fs.stochastic(prepared.scene, prepared.cells, prepared.sampling)

    assert not any("only a limit" in text for text in solve().warnings)
    monkeypatch.setattr(stochastic_study, "MOST_RATIO", 1 + 1e-5)
    monkeypatch.setattr(stochastic_study, "MOST_FACTOR", 1 + 1e-5)
    (text,) = (text for text in solve().warnings if "only a limit" in text)
    assert "loading 50 MPa" in text
