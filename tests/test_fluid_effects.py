"""What is estimated beside the flow: the part of the load that the fluid carries, and capillary entry pressures."""

from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest
from femseal.studies.fluid_load import carried_pressure, relief_warning, relieved_leakage
from numpy.testing import assert_allclose

import femseal as fs
from femseal.contact import HalfSpace, solve_contact
from femseal.fluids import capillary_entry_pressure
from femseal.results.dataset import assemble

WATER = fs.Liquid(1e-3, surface_tension=0.073, contact_angle=radians(120))


@pytest.fixture(scope="module")
def scene():
    face = fs.self_affine((32, 48), (32e-6, 48e-6), hurst=0.8, rms_slope=0.1, cut_off=8e-6, rng=2)
    return fs.Scene(
        face, 115e9, 3e9, WATER, 40e6, 0.0, loading=(50e6, 100e6, 200e6), unload_from=(200e6,), unloading=(100e6, 50e6)
    )


def test_mean_pressure_of_the_fluid(scene):
    assert_allclose(carried_pressure(scene), 20e6, rtol=1e-9)
    gas = replace(scene, fluid=fs.IdealGas(2e-5, 0.029, 293.0), inlet_pressure=1e6, outlet_pressure=101_325.0)
    a, b = 1e6, 101_325.0
    assert_allclose(carried_pressure(gas), 2 / 3 * (a**3 - b**3) / (a**2 - b**2) - b, rtol=1e-4)  # p² falls evenly
    assert carried_pressure(replace(gas, inlet_pressure=2e4, outlet_pressure=0.0)) == 0


def test_leakage_is_interpolated_on_its_own_branch(scene):
    leakage = np.exp(-np.array([50.0, 100.0, 200.0, 100.0, 50.0]) / [30, 30, 30, 60, 60])
    leakage[3:] *= leakage[2] / np.exp(-200 / 60)
    found = relieved_leakage(scene, leakage)
    assert np.isnan(found[[0, 4]]).all()  # 30 MPa is below the lowest step
    assert_allclose(found[[1, 2, 3]] / leakage[[1, 2, 3]], np.exp([20 / 30, 20 / 30, 20 / 60]), rtol=1e-9)
    leakage[2:] = 0
    assert relieved_leakage(scene, leakage)[2] == leakage[1]  # closed above, open below: the open one
    assert relief_warning(replace(scene, inlet_pressure=5e6), leakage) == ""
    steep = np.exp(-scene.steps.pressures / 46e6)
    assert "about 1.9 times" in relief_warning(replace(scene, inlet_pressure=60e6), steep)


def test_a_uniform_fluid_pressure_does_what_a_lower_load_does():
    """Contact with the fluid pressure as lower bound, p >= p_f: p − p_f is the dry contact under the load less p_f."""
    n, length, amplitude, modulus, fluid = 64, 1e-4, 1e-7, 1e11, 5e6
    x = (np.arange(n) + 0.5) / n
    gap0 = amplitude * (1 - np.cos(2 * np.pi * x))[:, None] * np.ones((1, 2))
    body = HalfSpace((n, 2), (length / n, length / n), modulus)
    dry = solve_contact(gap0, body, pressure=30e6)
    # the wave closes at p* = πE*Δ/λ above the fluid pressure: the sealing load is affine in it
    full = np.pi * modulus * amplitude / length
    sealed, open_ = (solve_contact(gap0, body, pressure=full * share) for share in (1.01, 0.97))
    assert (sealed.gap == 0).all()
    assert (open_.gap > 0).any()
    assert dry.pressure.min() == 0
    assert_allclose((dry.pressure + fluid).mean(), 30e6 + fluid, rtol=1e-9)


def test_results_tell_the_estimate(scene):
    scene = replace(scene, inlet_pressure=90e6)
    study = fs.deterministic(scene)
    results = assemble(scene, deterministic=study)
    told = [text for text in results.warnings if "lifts the faces" in text]
    assert len(told) == 2
    assert "as if the contact pressure were lower by 45 MPa" in told[0]
    assert "about" in told[1]
    lifted = results.dataset["leakage_lifted"]
    assert lifted.attrs["units"] == "m^2/s"
    known = np.isfinite(lifted.values)
    assert known.tolist() == [False, True, True, True, False]
    assert (lifted.values[known] > study.leakage[known]).all()
    calm = replace(scene, inlet_pressure=1e6)
    assert "leakage_lifted" not in assemble(calm, deterministic=fs.deterministic(calm)).dataset
    parted = replace(scene, inlet_pressure=200e6)
    assert any("it parts them" in text for text in assemble(parted, deterministic=fs.deterministic(parted)).warnings)


def test_capillary_entry_pressure():
    assert_allclose(capillary_entry_pressure(WATER, 1e-6), 2 * 0.073 * 0.5 / 1e-6, rtol=1e-12)
    assert capillary_entry_pressure(WATER, 0.0) == inf
    for wets in (replace(WATER, contact_angle=radians(60)), replace(WATER, surface_tension=None), fs.Liquid(1e-3)):
        assert np.isnan(capillary_entry_pressure(wets, 1e-6))


def test_results_have_the_entry_pressure_of_the_critical_constriction(scene):
    study = fs.deterministic(scene)
    data = assemble(scene, deterministic=study).dataset["capillary_entry_pressure"]
    assert data.attrs["units"] == "Pa"
    for s, gap in enumerate(study.gap):
        found = fs.critical_constriction(gap.astype(float), scene.surface.spacing, sides="periodic")
        assert_allclose(data[s], inf if found is None else 0.073 / found.gap, rtol=1e-6)
    assert (study.leakage > 0).tolist() == np.isfinite(data.values).tolist()
    dry = replace(scene, fluid=fs.Liquid(1e-3))
    assert "capillary_entry_pressure" not in assemble(dry, deterministic=fs.deterministic(dry)).dataset
