"""Coated bodies: compliance against closed forms, finite elements and integrals; the contact solver with them."""

import itertools

import numpy as np
import pytest
from coated_block import block_compliance, with_ratio
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import j0

import femseal as fs
from femseal.base import InputError
from femseal.contact.layered import checked_modulus, layer_factor, modulus_of_waves

STEEL = fs.Solid(200e9, 0.3)
SILVER = fs.Solid(82.7e9, 0.367)
KINDS = ("periodic", "mirror", "free")


# --- kernel -----------------------------------------------------------------------------------------------


def test_a_layer_of_the_material_of_its_substrate_changes_nothing():
    body = fs.Coated(STEEL, STEEL, 1.0)
    assert_allclose(layer_factor(body, np.geomspace(1e-6, 100, 60)), 1.0, rtol=1e-12)


@pytest.mark.parametrize("ratio", [0.05, 0.4, 3.0, 20.0])
def test_thick_and_thin_layers(ratio):
    substrate, layer = with_ratio(ratio)
    body = fs.Coated(substrate, layer, 1.0)
    assert_allclose(layer_factor(body, np.array([30.0, 1e3])), 1.0, rtol=1e-12)
    expected = layer.plane_modulus / substrate.plane_modulus
    assert_allclose(layer_factor(body, np.array([1e-9])), expected, rtol=1e-6)


def test_an_incompressible_layer_on_a_rigid_base():
    # (sinh 2t − 2t)/(cosh 2t + 1 + 2t²), which is 2t³/3 for thin layers
    body = fs.Coated(None, fs.Solid(1e6, 0.5), 1.0)
    t = np.geomspace(0.05, 15, 40)
    exact = (np.sinh(2 * t) - 2 * t) / (np.cosh(2 * t) + 1 + 2 * t**2)
    assert_allclose(layer_factor(body, t), exact, rtol=1e-9)
    assert_allclose(layer_factor(body, np.array([1e-4])), 2e-12 / 3, rtol=1e-6)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.45])
def test_a_thin_layer_on_a_rigid_base_is_compressed_uniaxially(poisson):
    # u = p d/M with the modulus M = E(1 − ν)/((1 + ν)(1 − 2ν)) of a layer that cannot widen
    layer = fs.Solid(3.0, poisson)
    confined = 3.0 * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    body = fs.Coated(None, layer, 1e-5)
    q = np.array([1.0])
    compliance = 2 / (q * modulus_of_waves((body, None), q))
    assert_allclose(compliance, 1e-5 / confined, rtol=1e-6)


@pytest.mark.parametrize("ratio", [0.25, 1.5, 5.0])
def test_finite_elements_in_plane_strain(ratio):
    substrate, layer = with_ratio(ratio)
    for t in np.geomspace(0.05, 8.0, 10):
        body = fs.Coated(substrate, layer, t)  # the wave number is 1
        kernel = 2 * layer_factor(body, np.array(t)) / layer.plane_modulus
        assert_allclose(block_compliance(ratio, t), kernel, rtol=0.01)


# --- grids ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("boundary", list(itertools.product(KINDS, KINDS)))
def test_a_layer_of_the_same_material_on_any_grid(boundary):
    rng = np.random.default_rng(1)
    p = rng.random((9, 12))
    plain = fs.HalfSpace((9, 12), (1e-6, 2e-6), (STEEL, STEEL), boundary)
    coated = fs.Coated(STEEL, STEEL, 3e-6)
    same = fs.HalfSpace((9, 12), (1e-6, 2e-6), (coated, STEEL), boundary)
    u, v = plain.displacement(p), same.displacement(p)
    assert_allclose(v - v.mean(), u - u.mean(), rtol=0, atol=1e-12 * np.abs(u).max())


@pytest.mark.parametrize("boundary", list(itertools.product(KINDS, KINDS)))
@pytest.mark.parametrize(("thickness", "solid"), [(1e-3, SILVER), (1e-12, STEEL)])
def test_thick_and_thin_layers_on_any_grid(boundary, thickness, solid):
    p = np.random.default_rng(2).random((8, 10))
    grid = (8, 10), (1e-6, 1e-6)
    coated = fs.HalfSpace(*grid, (fs.Coated(STEEL, SILVER, thickness), STEEL), boundary)
    plain = fs.HalfSpace(*grid, (solid, STEEL), boundary)
    u, v = plain.displacement(p), coated.displacement(p)
    assert_allclose(v - v.mean(), u - u.mean(), rtol=0, atol=1e-4 * np.abs(u - u.mean()).max())


@pytest.mark.parametrize("boundary", ["periodic", "mirror"])
def test_a_single_wave_is_that_of_the_kernel(boundary):
    n, d, thickness = 32, 1e-6, 4e-6
    body = fs.Coated(STEEL, SILVER, thickness)
    half_space = fs.HalfSpace((n, 4), (d, d), (body, None), boundary)
    q = (2 if boundary == "periodic" else 1) * 3 * np.pi / (n * d)
    wave = np.cos(q * (np.arange(n) + 0.5) * d)[:, None] * np.ones(4)
    S = layer_factor(body, np.array(q * thickness))
    expected = 2 * S / (SILVER.plane_modulus * q) * wave
    assert_allclose(half_space.displacement(wave), expected, atol=1e-12 * np.abs(expected).max())


def excess_at(body, x, y, d):
    """Displacement at (x, y) beyond that of the layer's half-space, by a pixel at 0: an integral over waves."""

    def excess(r):
        def integrand(t):
            return float((layer_factor(body, np.array(t)) - 1) * j0(t * r / body.thickness))

        value = quad(integrand, 0, 25, limit=400, epsabs=1e-12, epsrel=1e-12)[0]
        return value / (np.pi * body.layer.plane_modulus * body.thickness)

    nodes, weights = np.polynomial.legendre.leggauss(6)
    total = 0.0
    for a, b in itertools.product(range(6), repeat=2):
        r = np.hypot(x - d * nodes[a] / 2, y - d * nodes[b] / 2)
        total += weights[a] * weights[b] * d**2 / 4 * excess(r)
    return total


@pytest.mark.parametrize("substrate", [STEEL, None, fs.Solid(10e9, 0.3)])
def test_free_axes_have_the_integral_over_all_waves(substrate):
    d = 1e-6
    body = fs.Coated(substrate, SILVER, 3e-6)
    p = np.zeros((9, 7))
    p[2, 1] = 1.0
    grid = (9, 7), (d, d)
    u = fs.HalfSpace(*grid, (body, STEEL), "free").displacement(p)
    u -= fs.HalfSpace(*grid, (SILVER, STEEL), "free").displacement(p)
    for i, j in ((2, 1), (3, 1), (8, 6), (0, 5)):
        expected = excess_at(body, (i - 2) * d, (j - 1) * d, d)
        assert_allclose(u[i, j], expected, rtol=1e-6)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("kind", ["periodic", "mirror"])
@pytest.mark.parametrize("substrate", [STEEL, None])
def test_a_wave_along_a_strip_has_the_integral_over_the_waves_across(order, kind, substrate):
    n1, n2, d = 24, 16, 1e-6
    body = fs.Coated(substrate, SILVER, 3e-6)
    q2 = (2 if kind == "periodic" else 1) * np.pi / (n2 * d)
    p = np.zeros((n1, n2))
    wave = np.cos(q2 * (np.arange(n2) + 0.5) * d)
    p[3] = wave
    grid = (n1, n2)[::order], (d, d)
    boundary = ("free", kind)[::order]

    def displacement(pair):
        u = fs.HalfSpace(*grid, pair, boundary).displacement(p if order == 1 else p.T)
        return u if order == 1 else u.T

    u = displacement((body, None)) - displacement((SILVER, None))
    for i in (3, 4, 9, 23):

        def integrand(q1, i=i):
            q = np.hypot(q1, q2)
            excess = float(layer_factor(body, np.array(q * body.thickness))) - 1
            weight = np.sinc(q1 * d / (2 * np.pi)) * np.sinc(q2 * d / (2 * np.pi))
            return 2 * excess / (SILVER.plane_modulus * q) * weight * np.cos(q1 * (i - 3) * d)

        value = quad(integrand, 0, 8e6, limit=1000, epsabs=1e-25, epsrel=1e-10)[0]
        expected = d / np.pi * value
        scale = np.abs(u[3]).max()
        assert_allclose(u[i], expected * wave, rtol=0, atol=1e-6 * scale)


def test_a_line_on_a_strip_is_plane_strain():
    # differences of the level: ∫ C(q) sinc (1 − cos qx) dq/π
    n1, d = 20, 1e-6
    body = fs.Coated(STEEL, SILVER, 3e-6)
    p = np.zeros((n1, 4))
    p[5] = 1.0
    grid = (n1, 4), (d, d)
    u = fs.HalfSpace(*grid, (body, None), ("free", "periodic")).displacement(p)
    u -= fs.HalfSpace(*grid, (SILVER, None), ("free", "periodic")).displacement(p)
    for i in (6, 12, 19):

        def integrand(q, i=i):
            excess = float(layer_factor(body, np.array(q * body.thickness))) - 1
            weight = np.sinc(q * d / (2 * np.pi)) * (1 - np.cos(q * (i - 5) * d))
            return 2 * excess / (SILVER.plane_modulus * q) * weight

        value = quad(integrand, 0, 8e6, limit=1000, epsabs=1e-25, epsrel=1e-10)[0]
        assert_allclose(u[5, 0] - u[i, 0], d / np.pi * value, rtol=1e-6)


# --- contact ----------------------------------------------------------------------------------------------


def test_a_wave_closes_at_the_pressure_of_westergaard_times_the_factor():
    # full contact from p* = πE*Δ/(λS) on, where the pressure just reaches 0 in the valleys
    n, d, height = 128, 1e-6, 1e-7
    body = fs.Coated(STEEL, SILVER, 30e-6)
    half_space = fs.HalfSpace((n, 1), (d, d), (body, None))
    q = 2 * np.pi / (n * d)
    modulus = float(modulus_of_waves((body, None), np.array(q)))
    closes = fs.analytic.wave_full_contact_pressure(modulus, height, n * d)
    gap0 = height * (1 + np.cos(q * (np.arange(n) + 0.5) * d))[:, None]
    assert fs.solve_contact(gap0, half_space, pressure=1.001 * closes).area_fraction == 1
    open_gap = fs.solve_contact(gap0, half_space, pressure=0.98 * closes)
    assert open_gap.area_fraction < 1


@pytest.mark.parametrize("boundary", ["periodic", "mirror", "free", ("free", "periodic")])
@pytest.mark.parametrize(
    "pair",
    [
        (fs.Coated(STEEL, SILVER, 5e-6), STEEL),
        (fs.Coated(SILVER, STEEL, 5e-6), fs.Coated(STEEL, SILVER, 1e-6)),
        (None, fs.Coated(None, SILVER, 20e-6)),
        (fs.Coated(fs.Solid(5e9, 0.3), STEEL, 2e-6), None),
    ],
)
def test_contact_of_rough_coated_bodies_converges(pair, boundary):
    face = fs.self_affine((96, 96), (96e-6, 96e-6), hurst=0.8, rms_slope=0.15, rng=1, roll_off=4e-5)
    half_space = fs.HalfSpace(face.shape, face.spacing, pair, boundary)
    gap0 = face.heights.max() - face.heights
    contact = fs.solve_contact(gap0, half_space, pressure=1e8, hardness=1e9, rtol=1e-6)
    # the pressure that is returned gives the gap that is returned
    gap = gap0 + half_space.displacement(contact.pressure)
    touches = (contact.pressure > 0) & (contact.pressure < 1e9)
    assert np.ptp(gap[touches]) < 1e-4 * np.ptp(gap)
    assert_allclose(contact.pressure.mean(), 1e8, rtol=1e-9)


def test_two_bodies_without_a_coating_are_their_contact_modulus():
    half_space = fs.HalfSpace((4, 4), (1e-6, 1e-6), (STEEL, SILVER))
    assert half_space == fs.HalfSpace((4, 4), (1e-6, 1e-6), fs.contact_modulus(STEEL, SILVER))
    assert checked_modulus((None, SILVER)) == fs.contact_modulus(SILVER)


@pytest.mark.parametrize(
    ("modulus", "message"),
    [
        ((None, None), "two rigid bodies"),
        ((STEEL,), "two bodies"),
        ((STEEL, 2e11), "two bodies"),
        (STEEL, "two bodies"),
        ("115 GPa", "115 GPa"),
    ],
)
def test_bodies_that_are_none(modulus, message):
    with pytest.raises(InputError, match=message):
        fs.HalfSpace((4, 4), (1e-6, 1e-6), modulus)


def test_wrong_coatings():
    with pytest.raises(InputError, match="thickness"):
        fs.Coated(STEEL, SILVER, 0.0)
    with pytest.raises(InputError, match="substrate"):
        fs.Coated(fs.Coated(STEEL, SILVER, 1e-6), SILVER, 1e-6)
    with pytest.raises(InputError, match="layer"):
        fs.Coated(STEEL, None, 1e-6)
    with pytest.raises(InputError, match="HalfSpace"):
        fs.contact_modulus(fs.Coated(STEEL, SILVER, 1e-6))


def test_a_layer_that_is_far_stiffer_than_its_substrate_on_a_free_axis():
    body = fs.Coated(fs.Solid(1e6, 0.3), STEEL, 1e-6)
    with pytest.raises(InputError, match="100 times"):
        fs.HalfSpace((4, 4), (1e-6, 1e-6), (body, None), "free").symbol()
