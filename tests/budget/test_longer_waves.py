"""Waves longer than the patch: what is drawn of them, and their row in the budget."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom
from small_cases import STRIP, steel_scene

import femseal as fs
from femseal.budget import longer_waves_part
from femseal.budget.longer_waves import DRAWS, _draw_form, _rms_between, longer_waves
from femseal.case import parse_case
from femseal.loads import LoadProgramme
from femseal.seal import AnnularLayout, Frame, MeasuredForm, WavyForm
from femseal.topography import Representative, representative

D, N = 1e-6, 64
SIDE = N * D


def scene(roll_off, **changed):
    waves = {"rms_slope": 0.1, "roll_off": roll_off, "cut_off": 8 * D, "rng": 5}
    face = fs.self_affine((2 * N, 2 * N), (2 * SIDE, 2 * SIDE), hurst=0.8, **waves)
    patch = face.crop((N, N)).detrend(1)
    surface = fs.Topography(patch.heights, (D, D), (False, False))
    return steel_scene(surface, **{"loading": (2e7, 2e8)} | changed)


def changes(one, breadth, flatness=None, length=8 * SIDE):
    return longer_waves(
        one, breadth, length, representative(one.surface), flatness=flatness, seed=1
    )


RISING = Representative(SIDE, None, (1, 1), True, SIDE, 1e-24, 0.8)


@pytest.mark.parametrize("hurst", [0.5, 0.8, 1.0])
def test_the_height_of_the_waves_is_the_integral_of_their_spectrum(hurst):
    """(1/2π)∫q C dq with C = C₀ (q/q₀)^(−2−2H), by the trapezoidal rule."""
    low, high = 2 * np.pi / (8 * SIDE), 2 * np.pi / SIDE
    q = np.geomspace(low, high, 20_001)
    density = RISING.density * (q * RISING.octave / (2 * np.pi)) ** (-2 - 2 * hurst)
    exact = np.sqrt(np.trapezoid(q * density, q) / (2 * np.pi))
    assert_allclose(_rms_between(RISING, hurst, SIDE, 8 * SIDE), exact, rtol=1e-6)


def test_drawn_waves_have_that_height_and_lie_between_both_lengths():
    rng = np.random.default_rng(0)
    form = _draw_form(rng, 0.8, (SIDE, 8 * SIDE), 1e-6, None)
    waves = 2 * np.pi / np.hypot(*form.vectors.T)
    assert SIDE <= waves.min() < waves.max() <= 8 * SIDE
    # the median wave by the integral of q C is where q^(−2H) is half way between both ends
    halfway = np.mean((1 / np.array([SIDE, 8 * SIDE])) ** -1.6) ** (1 / 1.6)
    assert_allclose(np.median(waves), halfway, rtol=0.1)
    points = rng.uniform(0, 500 * SIDE, (20_000, 2))
    assert_allclose(form.heights(points, Frame()).std(), 1e-6, rtol=0.15)
    limited = replace(form, flatness=2e-7)
    assert_allclose(np.ptp(limited.heights(points, Frame())), 2e-7)
    low = replace(form, flatness=1.0)
    assert_allclose(low.heights(points, Frame()), form.heights(points, Frame()))


def test_a_patch_that_holds_its_waves_has_no_row_and_one_that_does_not_has():
    assert changes(scene(SIDE / 5), 4 * SIDE) is None
    rising = scene(4 * SIDE)
    assert changes(rising, SIDE) is None  # as broad as the patch
    narrow = replace(rising, layout=AnnularLayout(40 * SIDE, 40.5 * SIDE))
    assert changes(narrow, None, length=None) is None
    found = changes(rising, 4 * SIDE)
    assert found.shape == (DRAWS, 2)
    assert (
        found.mean(axis=0) > 0
    ).all()  # what stands apart leaks more than what is pressed leaks less


@pytest.mark.slow
def test_broader_seals_and_less_flat_ones_may_leak_more():
    rising = scene(4 * SIDE)
    spread = [np.abs(changes(rising, rows * SIDE)).max() for rows in (2, 8)]
    assert spread[1] > spread[0]
    flat = scene(SIDE / 5)
    means = [changes(flat, 4 * SIDE, flatness).mean(axis=0) for flatness in (1e-8, 1e-6, 4e-6)]
    assert (np.diff(np.array(means), axis=0) > 0).all()
    assert np.abs(means[0]).max() < 0.05
    # beyond, the gap between crests decides: its cube
    high, higher = (changes(flat, 4 * SIDE, flatness).mean(axis=0)[0] for flatness in (8e-6, 16e-6))
    assert_allclose(higher - high, np.log(8), rtol=0.15)
    assert np.isnan(
        changes(flat, 4 * SIDE, 1e-3)
    ).all()  # steeper than a half-space allows: unknown


def test_a_form_leaves_the_waves_that_are_too_short_for_it():
    """Measured far apart a form has a row still, and the less the finer it is; waves known exactly are no others."""
    rising = scene(4 * SIDE)
    given = 8 * SIDE, 16 * SIDE, representative(rising.surface)

    def spread(form):
        found = longer_waves(rising, *given, flatness=None, seed=1, forms=(form,))
        return None if found is None else found.std(axis=0)[0]

    def measured(count):
        lines = np.linspace(0, 8 * SIDE, count), np.linspace(0, 16 * SIDE, 2 * count)
        points = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        return MeasuredForm.from_points(points, np.zeros(len(points)))

    coarse, finer, none = (spread(measured(count)) for count in (4, 9, 40))
    assert none is None
    assert 0 < finer < coarse
    assert spread(WavyForm(1e-9, lobes=2)) >= coarse


def test_the_part_holds_a_draw_more_on_either_side():
    steps = LoadProgramme.of((1e6, 1e8))
    rng = np.random.default_rng(1)
    held = []
    for _ in range(400):
        draws = rng.normal([1.0, -0.2], [0.5, 0.3], (9, 2))
        part = longer_waves_part(draws[:8], False, steps, np.ones(2))
        held.append((part.lower <= np.exp(draws[8])) & (np.exp(draws[8]) <= part.upper))
    assert (np.sum(held, axis=0) >= binom.ppf(0.01, 400, 0.95)).all()
    part = longer_waves_part(np.array([[0.1, np.inf]] * 8), True, steps, np.ones(2))
    assert part.upper[1] == np.inf
    assert part.lower[0] <= 1 <= part.upper[0]
    assert "flatness of the seal" in part.note


def test_a_case_with_a_flatness_has_the_row():
    seal = {"kind": "annular", "inner_radius": "1 mm", "outer_radius": "1.128 mm"}
    case = STRIP | {"stochastic": {"realisations": 2}, "cells": {"count": [2, 4]}}
    case["face"] = case["face"] | {"points": [64, 64], "size": ["64 um"] * 2, "roll_off": "16 um"}
    plain, flat = (
        fs.run(parse_case(case | {"seal": seal | more}), workers=1)
        for more in ({}, {"flatness": "1 um"})
    )
    assert "longer waves" not in plain.budget.widths()
    assert (flat.budget.widths()["longer waves"] > 0.1).all()
    assert_allclose(flat.leakage, plain.leakage)
