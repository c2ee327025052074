"""Solids: hardness, contact modulus, and what is not a solid."""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.materials import METALS, Solid, contact_modulus, named_solid

STEEL = Solid(210e9, 0.3, yield_stress=500e6)
COPPER = Solid(120e9, 0.34, hardness=600e6)


def test_hardness_from_yield_stress_directly_or_infinite():
    assert_allclose(STEEL.hardness, 2.8 * 500e6)
    assert COPPER.hardness == 600e6
    assert Solid(210e9, 0.3).hardness == inf


def test_another_ratio_of_hardness_to_yield_stress():
    soft = Solid(210e9, 0.3, yield_stress=500e6, hardness_over_yield=2.3)
    assert_allclose(soft.hardness, 2.3 * 500e6)
    assert replace(soft, young=200e9).hardness == soft.hardness
    with pytest.raises(InputError, match=r"^hardness_over_yield: given .*> 0"):
        Solid(210e9, 0.3, yield_stress=500e6, hardness_over_yield=0.0)


def test_the_yield_stress_of_a_solid_is_replaced_without_its_hardness():
    softer = replace(STEEL, yield_stress=400e6, hardness=None)
    assert softer == Solid(210e9, 0.3, yield_stress=400e6)
    with pytest.raises(
        InputError, match=r"replace, a new yield_stress together with hardness=None"
    ):
        replace(STEEL, yield_stress=400e6)


def test_contact_modulus_agrees_with_its_definition():
    assert_allclose(contact_modulus(STEEL, STEEL), 210e9 / (2 * (1 - 0.09)), rtol=1e-12)
    assert_allclose(contact_modulus(STEEL), 210e9 / (1 - 0.09), rtol=1e-12)
    assert contact_modulus(STEEL, COPPER) == contact_modulus(COPPER, STEEL)
    assert contact_modulus(STEEL, COPPER) < contact_modulus(COPPER)


@pytest.mark.parametrize("young", [0.0, -1.0, nan, inf])
def test_invalid_youngs_moduli_are_refused(young):
    with pytest.raises(InputError, match=r"^young: given .*> 0 \[Pa\]"):
        Solid(young, 0.3)


@pytest.mark.parametrize("poisson", [-1.0, 0.51, nan, "0.3", None, True])
def test_invalid_poisson_ratios_are_refused(poisson):
    with pytest.raises(InputError, match=r"^poisson: given .*a number in \(-1, 0.5\]"):
        Solid(210e9, poisson)


@pytest.mark.parametrize(
    "value", [0.0, -1.0, nan, "x", "1e9", [1e9], [1e9, 2e9], np.array([1e9, 2e9])]
)
def test_invalid_strengths_are_refused(value):
    with pytest.raises(InputError, match=r"^yield_stress: given .*> 0 \[Pa\]"):
        Solid(210e9, 0.3, yield_stress=value)
    with pytest.raises(InputError, match=r"^hardness: given .*> 0 \[Pa\]"):
        Solid(210e9, 0.3, hardness=value)


def test_yield_stress_and_hardness_together_are_refused():
    with pytest.raises(InputError, match=r"^hardness: given .*yield_stress or hardness, not both"):
        Solid(210e9, 0.3, yield_stress=500e6, hardness=1e9)


def test_ten_metals_have_values_and_sources():
    assert len(METALS) == 10
    for name, (solid, source) in METALS.items():
        assert 60e9 < solid.young < 220e9
        assert 0.25 < solid.poisson < 0.4
        assert 10e6 < solid.yield_stress < 1.2e9
        assert source
        assert fs.named_solid(name.upper()) is solid


@pytest.mark.parametrize(
    ("given", "nearest"),
    [("copper", "copper, soft"), ("coper, soft", "copper, soft"), ("304", "steel 304/316, annealed"),
     ("inconel", "Inconel 718, aged"), ("316L", "steel 304/316, annealed"), ("AlMg 6061", "aluminium 6061-T6")],
)  # fmt: skip
def test_an_unknown_name_is_told_the_nearest(given, nearest):
    said = rf"^name: given '{given}', expected one of .*; perhaps meant: '{nearest}'$"
    with pytest.raises(fs.InputError, match=said):
        named_solid(given)
