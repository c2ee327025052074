"""Closed forms against independent integrals of what they say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal import analytic

N = 20_001
PHASE = (np.arange(N) + 0.5) / N  # midpoints of one period


def test_hertz_pressure_carries_the_load():
    load, radius, modulus = 3.0, 2e-3, 115e9
    a = analytic.hertz_radius(load, radius, modulus)
    r = (np.arange(200_000) + 0.5) / 200_000 * a
    p = analytic.hertz_pressure(r, load, radius, modulus)
    assert_allclose(np.sum(2 * np.pi * r * p) * a / r.size, load, rtol=1e-6)
    assert analytic.hertz_pressure(0.0, load, radius, modulus) == analytic.hertz_peak_pressure(
        load, radius, modulus
    )
    assert analytic.hertz_pressure(1.01 * a, load, radius, modulus) == 0
    # work = ∫ W dδ is 2/5 of Wδ for δ ~ W^{2/3}·…: the stiffness dW/dδ is 2aE*
    d = [analytic.hertz_approach(w, radius, modulus) for w in (load * 0.9999, load * 1.0001)]
    assert_allclose(load * 0.0002 / (d[1] - d[0]), 2 * a * modulus, rtol=1e-7)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_wave_pressure_has_the_given_mean_and_contact_fraction(ratio):
    p = analytic.wave_pressure(PHASE, ratio, 1.0)
    g = analytic.wave_gap(PHASE, ratio, 1e-6, 1.0)
    assert_allclose(p.mean(), ratio, rtol=2e-5)
    assert_allclose(np.mean(p > 0), analytic.wave_contact_fraction(ratio), atol=2 / N)
    assert np.all((p == 0) | (g == 0))


@pytest.mark.parametrize("ratio", [0.1, 0.5])
def test_wave_gap_and_pressure_satisfy_elasticity(ratio):
    """Gap = undeformed wave + displacement − approach, û = 2p̂/(E*|q|), by a discrete Fourier transform."""
    n, length, delta, modulus = 65536, 1e-3, 1e-6, 115e9
    x = np.arange(n) / n * length
    p_full = analytic.wave_full_contact_pressure(modulus, delta, length)
    p = p_full * analytic.wave_pressure(x, ratio, length)
    q = 2 * np.pi * np.fft.rfftfreq(n, length / n)
    p_hat = np.fft.rfft(p)
    p_hat[0] = 0
    u = np.fft.irfft(np.divide(2 * p_hat, modulus * q, out=np.zeros_like(p_hat), where=q > 0))
    expected = delta * (1 - np.cos(2 * np.pi * x / length)) + u
    gap = analytic.wave_gap(x, ratio, delta, length)
    assert_allclose(
        gap - gap.mean(), expected - expected.mean(), atol=1e-6 * delta
    )  # n^-3/2 of the edge


@pytest.mark.parametrize(
    ("ratio", "flow"), [(0, 5 / 16), (0.1, 0.125386), (0.5, 3.534788e-3), (0.9, 7.852893e-7)]
)
def test_wave_groove_flow_agrees_with_a_numerical_mean(ratio, flow):
    assert_allclose(analytic.wave_groove_flow(ratio), flow, rtol=3e-6 if ratio == 0.1 else 2e-7)
    direct = np.mean(analytic.wave_gap(PHASE, ratio, 0.5, 1.0) ** 3)
    assert_allclose(analytic.wave_groove_flow(ratio), direct, rtol=1e-6)


def test_wavy_surface_asymptotes_belong_to_the_same_surface():
    """Light load: two Hertz contacts in λ², of the curvature of the crests of 1 − cos·cos."""
    modulus, delta, length, ratio = 115e9, 1e-6, 1e-3, 1e-6
    p_full = analytic.wavy_full_contact_pressure(modulus, delta, length)
    radius = 1 / (delta * (2 * np.pi / length) ** 2)
    a = analytic.hertz_radius(ratio * p_full * length**2 / 2, radius, modulus)
    assert_allclose(
        analytic.wavy_contact_fraction_light(ratio), 2 * np.pi * a**2 / length**2, rtol=1e-12
    )
    assert_allclose(
        analytic.wavy_contact_fraction_full([0.99, 1.0]), [1 - 0.03 / (2 * np.pi), 1], rtol=1e-12
    )
    # p* flattens the wave: u = 2p/(E*|q|) of the mode cos·cos, |q| = 2√2π/λ
    assert_allclose(2 * p_full / (modulus * 2 * np.sqrt(2) * np.pi / length), delta, rtol=1e-12)


@pytest.mark.parametrize("ε", [0.0, 0.3, 0.8])
def test_wavy_gap_permeabilities_are_means_of_the_cubed_gap(ε):
    h = 2e-6 * (1 + ε * np.cos(2 * np.pi * PHASE))
    assert_allclose(analytic.wavy_gap_along(2e-6, ε), np.mean(h**3) / 12, rtol=1e-12)
    assert_allclose(analytic.wavy_gap_across(2e-6, ε), 1 / np.mean(12 / h**3), rtol=1e-12)


def test_large_gap_is_the_mean_of_along_and_across_to_second_order():
    ε = 1e-3
    both = (analytic.wavy_gap_along(1.0, ε) + analytic.wavy_gap_across(1.0, ε)) / 2
    flat = float(analytic.parallel_plates(1.0))
    assert_allclose(analytic.large_gap(1.0, ε / np.sqrt(2)) - flat, both - flat, rtol=1e-5)


def test_means_of_permeabilities_agree_with_their_definitions():
    assert_allclose(analytic.stripes_across([1.0, 3.0]), 1.5)
    assert_allclose(analytic.checkerboard(2.0, 8.0), 4.0)
    assert_allclose(analytic.log_symmetric_links([2.0, 8.0]), 4.0)
    assert analytic.stripes_across([1.0, 0.0]) == 0.0
    assert analytic.log_symmetric_links([1.0, 0.0]) == 0.0


def test_annulus_tends_to_a_strip():
    q = analytic.annulus_rate(1e-18, 1e6, 1e-3, 1.0, 1.001)
    assert_allclose(q, 1e-18 * 1e6 / 1e-3 * 2 * np.pi * 1.0005 / 0.001, rtol=1e-6)
