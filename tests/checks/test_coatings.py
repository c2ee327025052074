"""The warning that thin coatings are constrained by the bodies on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import OIL

import femseal as fs
from femseal.checks import constrained_hardness_ratio
from femseal.checks.coatings import constraint_warnings

STEEL = fs.Solid(200e9, 0.3, hardness=2e9)
SOFT = fs.Solid(50e9, 0.37, hardness=0.2e9)
#: Width of the lands [m].
WIDTH = 16e-6


def scene_of(thickness, load=0.498, substrate=STEEL, counter=STEEL):
    """Flat lands that cover half of the surface, on a soft coating that yields almost everywhere below them."""
    heights = np.zeros((32, 32))
    heights[:, :16] = 1e-6
    heights += 1e-9 * np.random.default_rng(1).standard_normal(heights.shape)
    return fs.Scene(
        surface=fs.Topography(heights, (1e-6, 1e-6)),
        modulus=(fs.Coated(substrate, SOFT, thickness), counter),
        hardness=SOFT.hardness,
        fluid=OIL,
        inlet_pressure=1e5,
        outlet_pressure=0.0,
        loading=(0.2 * SOFT.hardness, load * SOFT.hardness),
        boundary=("periodic", "periodic"),
        fluid_pressure="ignored",
    )


def texts(scene):
    return [text for text in fs.deterministic(scene).warnings if "hinder" in text]


@pytest.mark.parametrize(("widths", "expected"), [(10, 1.443), (20, 2.474), (2, 1.0)])
def test_strips_carry_the_pressure_of_the_slab_method(widths, expected):
    """(2/√3) σ_y (1 + w/4d), over 2.8 σ_y."""
    assert_allclose(constrained_hardness_ratio(widths / 4, 1.0), expected, rtol=1e-3)


def test_the_rise_and_the_equivalent_load_are_those_of_the_slab_method():
    scene = scene_of(WIDTH / 12)
    distance = fs.deterministic(scene).states[-1].edge_distance
    assert_allclose(distance, WIDTH / 4, rtol=0.1)  # not quite all points of the lands yield
    (text,) = texts(scene)
    rise = 2 / np.sqrt(3) * (1 + 12 * distance / WIDTH) / 2.8
    assert text.startswith("The seal may leak more than computed: at loading 99.6 MPa")
    assert f"a factor of up to {rise:.2g}" in text
    assert f"computed for {99.6 / rise:.3g} MPa, 1" in text


def test_a_thick_coating_is_not_constrained():
    assert not texts(scene_of(WIDTH / 6))


def test_a_soft_neighbour_yields_before_the_hardness_rises():
    soft = replace(STEEL, hardness=1.1 * SOFT.hardness)
    assert not texts(scene_of(WIDTH / 12, substrate=soft))
    assert not texts(scene_of(WIDTH / 12, counter=soft))
    # two soft coatings yield together, and their thicknesses add up
    thin = fs.Coated(STEEL, SOFT, WIDTH / 24)
    assert texts(replace(scene_of(WIDTH / 24), modulus=(thin, STEEL)))
    (text,) = texts(replace(scene_of(WIDTH / 24), modulus=(thin, thin)))
    assert f"{WIDTH / 12 * 1e6:.3g} µm thick" in text


def test_a_seal_with_random_cells_warns_as_its_surface_does():
    scene = scene_of(WIDTH / 12)
    warnings = fs.stochastic(scene, (1, 2), fs.Sampling(64e-6, 2, seed=1)).warnings
    assert sum("hinder" in text for text in warnings) == 1


def test_a_load_of_zero_does_not_spoil_the_study():
    """The surfaces leak without a load, but ln(0) is no load to interpolate from."""
    scene = scene_of(WIDTH / 12)
    unloaded = replace(scene, loading=(0.0, *scene.loading))
    (text,) = texts(unloaded)
    assert text == texts(scene)[0]


def test_a_closed_surface_has_no_edge_to_which_its_coating_could_flow():
    """The load step at which all points touch is not judged; the step before it is."""
    scene = scene_of(WIDTH / 12)
    leakage = np.array([1.0, 0.1])
    (text,) = constraint_warnings(scene, leakage, np.array([WIDTH / 4, np.inf]))
    assert "at loading 40 MPa" in text
    assert "inf" not in text
    assert not [*constraint_warnings(scene, leakage, np.array([np.inf, np.inf]))]
