"""A coating acts in every study: surfaces, strips of one wave, blocks, stochastic seals with a form."""

import numpy as np
import pytest
from small_cases import OIL

import femseal as fs
from femseal.seal.form import WavyForm

STEEL = fs.Solid(200e9, 0.3, hardness=2e9)
SOFT = fs.Solid(50e9, 0.37, hardness=0.5e9)


def scenes(surface, thickness, pressures=(2e7, 8e7), **more):
    """The same scene with bare steel, with a coating, and with a solid of its material."""
    bodies = STEEL, fs.Coated(STEEL, SOFT, thickness), SOFT
    laws = STEEL.hardness, fs.CoatedLaw.of(bodies[1]), SOFT.hardness
    for body, law in zip(bodies, laws, strict=True):
        yield fs.Scene(
            surface=surface,
            modulus=(body, STEEL),
            hardness=law,
            fluid=OIL,
            inlet_pressure=1e6,
            outlet_pressure=0.0,
            loading=pressures,
            **more,
        )


def rough(shape, seed=3):
    size = tuple(n * 1e-6 for n in shape)
    return fs.self_affine(shape, size, hurst=0.8, rms_slope=0.1, roll_off=2e-5, rng=seed)


def by_blocks(scene):
    return fs.by_blocks(scene, (2, 2)).leakage


def with_a_form(scene):
    sampling = fs.Sampling(2e-4, 2, seed=1, form=(WavyForm(1e-7, lobes=2),))
    return fs.stochastic(scene, (2, 2), sampling).leakage


STUDIES = {
    "deterministic": (lambda scene: fs.deterministic(scene).leakage, (64, 64)),
    "two-scale": (lambda scene: fs.two_scale(scene, (2, 2)).leakage, (64, 64)),
    "blocks": (by_blocks, (96, 96)),
    "with a form": (with_a_form, (48, 64)),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "blocks")) for name in STUDIES]
)
def test_a_soft_coating_lets_less_through_and_a_thick_one_what_its_metal_does(name):
    study, shape = STUDIES[name]
    bare, thin, soft = (study(scene) for scene in scenes(rough(shape), 2e-6))
    _, thick, _ = (study(scene) for scene in scenes(rough(shape), 1e-2))
    # of modulus and hardness, both fall
    assert (soft < 0.9 * bare).all()
    assert (thin < 0.95 * bare).all()
    np.testing.assert_allclose(thick, soft, rtol=0.02)


def test_a_thick_coating_is_its_metal_with_a_form_up_to_closing():
    """Both have a table of the rough layer, whose pressures must not depend on a substrate that never yields."""
    surface, pressures = rough((48, 64)), (2e7, 1.5e8, 2.5e8)
    _, thick, _ = scenes(surface, 1e-2, pressures)
    _, _, soft = scenes(surface, 1e-2, pressures)
    np.testing.assert_allclose(with_a_form(thick), with_a_form(soft), rtol=2e-3)


@pytest.mark.parametrize("boundary", ["periodic", ("free", "periodic"), ("free", "mirror")])
def test_a_profile_of_one_point_in_breadth_takes_a_coating(boundary):
    """Waves along x1 alone: a mean gap between those of both metals, and the gap of the same waves on a broad grid."""
    x = (np.arange(256) + 0.5) / 256
    profile = 1e-7 * (1 - np.cos(2 * np.pi * 8 * x))[:, None]
    contacts = []
    for body in (STEEL, fs.Coated(STEEL, SOFT, 2e-6), SOFT):
        half_space = fs.HalfSpace((256, 1), (1e-6, 1e-6), (body, STEEL), boundary)
        contacts.append(fs.solve_contact(profile, half_space, pressure=2e7, hardness=1e10))
    bare, coated, soft = (contact.mean_gap for contact in contacts)
    assert soft < 0.99 * coated < 0.98 * bare
    broad = fs.HalfSpace((256, 6), (1e-6, 1e-6), (fs.Coated(STEEL, SOFT, 2e-6), STEEL), boundary)
    contact = fs.solve_contact(profile + np.zeros(6), broad, pressure=2e7, hardness=1e10)
    np.testing.assert_allclose(contact.gap[:, :1], contacts[1].gap, rtol=0, atol=1e-11)
