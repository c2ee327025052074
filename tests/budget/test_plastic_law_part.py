"""The row "plastic law" of the error budget, beside the plastic solid of the benchmark."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

import femseal as fs
from femseal.budget.plastic_law import equivalent_ratios, plastic_law_part

E, SLOPE = 115e9, 0.2


def scene(severity, ratio=2.8, loading=(0.05, 0.1, 0.2)):
    """A surface with 2.8 σ_y = severity · E* h′, and the hardness ratio · σ_y."""
    face = fs.self_affine(
        (48, 48), 48e-6, hurst=0.75, rms_slope=SLOPE, roll_off=24e-6, cut_off=8e-6, rng=2
    )
    usual = severity * E * face.rms_slope
    loads = tuple(load * usual for load in loading)
    return fs.Scene(face, E, usual * ratio / 2.8, fs.Liquid(1e-3), 1e5, 0.0, loading=loads)


def part_of(scene, ratio=2.8):
    study = fs.deterministic(scene)
    return study.leakage, plastic_law_part(scene, study, study.leakage, ratio)


def test_elastic_surfaces_have_no_such_error():
    elastic = replace(scene(0.3), hardness=np.inf)
    assert part_of(elastic)[1] is None


def test_rough_surfaces_may_leak_more_or_less_and_smooth_ones_less():
    q, rough = part_of(scene(0.1))
    assert (rough.lower < q).all()
    assert (rough.upper > q).all()
    q, smooth = part_of(scene(0.3))
    assert (smooth.lower < 0.9 * q).all()
    assert_allclose(smooth.upper, q)


def test_the_interval_of_another_ratio_is_that_of_the_same_metal():
    """The metal is the same, so the interval of its leakage should not depend on the ratio that was chosen."""
    q, usual = part_of(scene(0.3))
    lower_q, chosen = part_of(scene(0.3, 2.4), 2.4)
    assert (lower_q < q).all()
    assert (chosen.upper > lower_q).all()
    assert_allclose(chosen.lower, usual.lower, rtol=0.25)


def test_ratios_are_held_constant_outside_the_measured_range():
    assert equivalent_ratios(1e-6) == equivalent_ratios(0.01)
    assert equivalent_ratios(1e3) == equivalent_ratios(10.0)
    low, high = equivalent_ratios(0.17)
    assert low < high
