"""What the fluid does beside flowing: the part of the load that it carries, and capillary entry pressures."""

from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.flow import critical_constriction
from femseal.fluids import capillary_entry_pressure
from femseal.results import assemble

WATER = fs.Liquid(1e-3, surface_tension=0.073, contact_angle=radians(120))


@pytest.fixture(scope="module")
def scene():
    face = fs.self_affine((32, 48), (32e-6, 48e-6), hurst=0.8, rms_slope=0.1, cut_off=8e-6, rng=2)
    way = {"loading": (50e6, 100e6, 200e6), "unload_from": (200e6,), "unloading": (100e6, 50e6)}
    return steel_scene(face, fluid=WATER, inlet_pressure=40e6, fluid_pressure="acts", **way)


def test_results_say_what_the_fluid_does(scene):
    study = fs.deterministic(scene)
    shut = assemble(scene, study)
    assert_allclose(shut.dataset["fluid_carried_pressure"].values, study.carried_pressure)
    effect = shut.dataset.attrs["fluid_effect"]
    assert effect.startswith("it pushes the surfaces apart, and carries about 20 MPa")
    parted = replace(scene, inlet_pressure=200e6)
    opened = assemble(parted, fs.deterministic(parted))
    said = "the surfaces separate below about 100 MPa"
    assert any(said in text for text in opened.warnings)
    assert opened.open_steps
    for table in (opened.table(), fs.compare({"open": opened, "shut": shut}).table()):
        assert "open" in str(table)
        assert "failed" not in str(table)
    little = replace(scene, inlet_pressure=5e3)
    assert (
        "is neglected" in assemble(little, fs.deterministic(little)).dataset.attrs["fluid_effect"]
    )


def test_capillary_entry_pressure():
    assert_allclose(capillary_entry_pressure(WATER, 1e-6), 2 * 0.073 * 0.5 / 1e-6, rtol=1e-12)
    assert capillary_entry_pressure(WATER, 0.0) == inf
    for wets in (
        replace(WATER, contact_angle=radians(60)),
        replace(WATER, surface_tension=None),
        fs.Liquid(1e-3),
    ):
        assert np.isnan(capillary_entry_pressure(wets, 1e-6))


def test_results_have_the_entry_pressure_of_the_critical_constriction(scene):
    study = fs.deterministic(scene)
    data = assemble(scene, study).dataset["capillary_entry_pressure"]
    assert data.attrs["units"] == "Pa"
    for s, gap in enumerate(study.gap):
        found = critical_constriction(gap.astype(float), scene.surface.spacing, sides="periodic")
        assert_allclose(data[s], inf if found is None else 0.073 / found.gap, rtol=1e-6)
    assert (study.leakage > 0).tolist() == np.isfinite(data.values).tolist()
    dry = replace(scene, fluid=fs.Liquid(1e-3))
    assert "capillary_entry_pressure" not in assemble(dry, fs.deterministic(dry)).dataset
