"""What the fluid does beside flowing: the part of the load that it carries, and capillary entry pressures."""

import warnings
from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.budget import ErrorPart
from femseal.contact import HalfSpace, solve_contact
from femseal.flow import critical_constriction
from femseal.fluids import capillary_entry_pressure
from femseal.report.leakage_tables import key_numbers
from femseal.results.dataset import RunFacts, assemble
from femseal.results.tables import totals_table

WATER = fs.Liquid(1e-3, surface_tension=0.073, contact_angle=radians(120))


@pytest.fixture(scope="module")
def scene():
    face = fs.self_affine((32, 48), (32e-6, 48e-6), hurst=0.8, rms_slope=0.1, cut_off=8e-6, rng=2)
    return fs.Scene(
        face,
        115e9,
        3e9,
        WATER,
        40e6,
        0.0,
        loading=(50e6, 100e6, 200e6),
        unload_from=(200e6,),
        unloading=(100e6, 50e6),
    )


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


def test_results_say_what_the_fluid_does(scene):
    study = fs.deterministic(scene)
    data = assemble(scene, study).dataset
    assert data["fluid_carried_pressure"].attrs["units"] == "Pa"
    assert_allclose(data["fluid_carried_pressure"].values, study.carried_pressure)
    assert data.attrs["fluid_effect"].startswith(
        "it presses the faces apart, and carries about 20 MPa"
    )
    parted = replace(scene, inlet_pressure=200e6)
    opened = assemble(parted, fs.deterministic(parted))
    assert any(
        "the fluid carries all: the faces part below about 100 MPa" in text
        for text in opened.warnings
    )
    sides = fs.compare({"open": opened, "shut": assemble(scene, study)}).table()
    assert opened.open_steps
    for table in (opened.table(), totals_table(opened), sides):
        assert "open" in str(table)
        assert "failed" not in str(table)
    two = replace(scene, loading=(1e6, 100e6), unload_from=(), unloading=())
    single = fs.deterministic(two)
    part = ErrorPart.of("pixels", single.leakage, np.full(2, 0.1), np.full(2, 0.1), "")
    budget = fs.ErrorBudget("deterministic", single.leakage, (part,), two.steps)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assemble(
            two, single, facts=RunFacts(budgets={"deterministic": budget})
        ).plot()  # one load has a leakage
    numbers = [number.value for number in key_numbers(opened)]
    assert ("open" in numbers, "failed" in numbers) == (True, False)
    little = replace(scene, inlet_pressure=5e3)
    assert "left out" in assemble(little, fs.deterministic(little)).dataset.attrs["fluid_effect"]


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
