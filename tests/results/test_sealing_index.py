"""The sealing index: required values are exact for power laws, and ranges and intervals are stated."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import InputError
from femseal.budget import ErrorBudget, ErrorPart
from femseal.results import RunFacts, assemble
from femseal.results.sealing_index import (
    equivalent_width,
    index_text,
    sealing_indices,
)

#: Pressures of the loading and of the unloading from the highest one [Pa].
UP, DOWN = (5e7, 1e8, 2e8, 4e8), (2e8, 1e8, 5e7)
K0, P0, N, N_DOWN = 3e-18, 1e8, 2.7, 0.4


def permeability(steps):
    """Power laws [m³]: with the exponent N on loading, and with N_DOWN on unloading from the peak."""
    p, peak = steps.pressures, max(UP)
    up = K0 * (p / P0) ** -N
    down = K0 * (peak / P0) ** -N * (p / peak) ** -N_DOWN
    return np.where(steps.on_loading, up, down)


@pytest.fixture(scope="module")
def solved():
    face = fs.self_affine((16, 16), (2e-5, 2e-5), hurst=0.8, rms_slope=0.1, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=UP, unload_from=(4e8,), unloading=DOWN)
    return scene, fs.deterministic(scene)


def results_of(solved, leakage=None, ends=None, drive=1e9, **fluid):
    """Results of a strip with a given leakage (steps,) [m²/s], and ends of its interval as ratios.

    drive : pressure drop over the viscosity of a liquid, and its equivalent for a gas [1/s].
    """
    scene, study = solved
    scene = dataclasses.replace(scene, **fluid)
    if leakage is None:
        leakage = permeability(scene.steps) * drive / scene.surface.size[0]
    study = dataclasses.replace(study, scene=scene) if hasattr(study, "scene") else study
    facts = RunFacts()
    if ends is not None:
        part = ErrorPart("patch", ends[0] * leakage, ends[1] * leakage, "assumed")
        budget = ErrorBudget("deterministic", leakage, (part,), scene.steps)
        facts = RunFacts(budgets={"deterministic": budget})
    results = assemble(scene, study, facts=facts)
    results.dataset["leakage_deterministic"][:] = leakage
    return results


def test_a_power_law_returns_its_exponent_and_its_limit(solved):
    results = results_of(solved)
    up, down = results.sealing_indices(["1 mL/(m·s)"])
    assert_allclose(up.exponent, N, rtol=1e-9)
    assert_allclose(down.exponent, N_DOWN, rtol=1e-9)
    assert (up.unloaded_from, down.unloaded_from) == (None, 4e8)
    assert (up.law.lowest_pressure, up.law.highest_pressure, up.law.count) == (5e7, 4e8, 4)
    assert up.law.deviation < 1e-9
    scene = results.scene
    drive = scene.inlet_pressure / scene.fluid.viscosity
    (limit,) = up.limits
    assert_allclose(limit.value, P0**N * K0 * drive / 1e-6, rtol=1e-9)
    assert_allclose(limit.in_megapascals(limit.value), limit.value * 1e3 / 1e6**N, rtol=1e-9)
    assert np.isnan([limit.lower, limit.upper, *up.exponent_interval]).all()


GAS = fs.IdealGas(viscosity=1.9e-5, molar_mass=4e-3, temperature=293.0, slip=False)


@pytest.mark.parametrize(
    ("fluid", "drive"),
    [
        # Darcy's law, k Δp/(η w) for a liquid
        ({}, 1e6 / 1e-3),
        # and k (p_in² − p_out²)/(2 η p w) for a gas, whose volume is given at the pressure p
        (
            {"fluid": GAS, "inlet_pressure": 4e6, "outlet_pressure": 1e5},
            (4e6**2 - 1e5**2) / (2 * GAS.viscosity * 101_325.0),
        ),
    ],
)
def test_a_seal_at_the_limit_leaks_exactly_the_class(solved, fluid, drive):
    results = results_of(solved, drive=drive, **fluid)
    for index in results.sealing_indices(["1 mL/(m·s)"]):
        (limit,) = index.limits
        pressure = 3e8
        width = limit.value / pressure**index.exponent
        profile = [0.0, width], [pressure, pressure]
        assert_allclose(index.of_profile(*profile), limit.value, rtol=1e-9)
        k = K0 * 3**-N if index.unloaded_from is None else K0 * 4**-N * (3 / 4) ** -N_DOWN
        assert_allclose(k * drive / width, 1e-6, rtol=1e-6)
        assert_allclose(index.law.at(pressure), k, rtol=1e-6)


def test_a_profile_at_the_limit_leaks_exactly_the_class(solved):
    """The pressure rises linearly from 100 to 400 MPa; its resistance ∫ dl/k is integrated independently."""
    up = results_of(solved).sealing_indices(["1 mL/(m·s)"])[0]
    pressures = np.array([1e8, 4e8])
    unit_index = up.of_profile([0.0, 1.0], pressures)
    width = up.limits[0].value / unit_index
    fine = np.linspace(*pressures, 200_001)
    resistance = np.trapezoid((fine / P0) ** N / K0, dx=width / 200_000)
    assert_allclose(1e6 / 1e-3 / resistance, 1e-6, rtol=1e-6)


def test_the_ring_is_as_wide_as_its_logarithm():
    """A broad ring leaks 2πk D/ln(r_o/r_i), as `seal_leakage` says as well."""
    ring = fs.AnnularSeal(1e-3, 3e-3, (4, 8))
    leak = fs.seal_leakage(ring, 2e-18, fs.Liquid(1e-3), inlet_pressure=1e6)
    dataset = xarray.Dataset(attrs={"seal_size_m": list(ring.size), "seal_kind": "annular"})
    results = SimpleNamespace(dataset=dataset, case={})
    width = equivalent_width(results)
    assert_allclose(2e-18 * 1e9 / width, leak.per_length, rtol=1e-9)
    dataset.attrs["seal_kind"] = "rectangular"
    assert equivalent_width(results) == ring.size[0]


def test_the_range_is_stated_in_results(solved):
    """At 400 MPa the permeability is a third of that of the power law of the other loads."""
    steps = solved[0].steps
    bent = permeability(steps) * np.where(steps.pressures == 4e8, 1 / 3, 1)
    results = results_of(solved, bent * 1e9 / 2e-5)
    first, second = [i for i in results.sealing_indices(["1 mL/(m·s)"]) if i.unloaded_from is None]
    assert (first.law.lowest_pressure, first.law.highest_pressure) == (2e8, 4e8)
    assert (second.law.lowest_pressure, second.law.highest_pressure) == (5e7, 2e8)
    assert_allclose(second.exponent, N, rtol=1e-9)
    assert_allclose(first.exponent, N + np.log(3) / np.log(2), rtol=1e-9)
    # with a tolerance that allows it, one law is enough
    wide = results.sealing_indices(["1 mL/(m·s)"], tolerance=0.9)
    assert [i.law.count for i in wide if i.unloaded_from is None] == [4]


def test_the_interval_contains_every_leakage_of_the_interval_of_the_run(solved):
    """True leakages between the ends: a seal at the upper end of the index meets the class in all of them."""
    results = results_of(solved, ends=(0.6, 1.8))
    rng = np.random.default_rng(1)
    steps = results.steps
    up = results.sealing_indices(["1 mL/(m·s)"])[0]
    (limit,) = up.limits
    assert_allclose([limit.lower / limit.value, limit.upper / limit.value], [0.6, 1.8], rtol=1e-9)
    assert_allclose(up.exponent_interval, N, rtol=1e-9)  # the error is the same at all loads
    p = steps.pressures[steps.on_loading]
    for _ in range(20):
        true = K0 * (p / P0) ** -N * rng.uniform(0.6, 1.8, p.size)
        assert (true * 1e9 * p**up.exponent / limit.upper <= 1e-6 * (1 + 1e-9)).all()
        assert (true * 1e9 * p**up.exponent / limit.lower >= 1e-6 * (1 - 1e-9)).all()


def test_ends_that_open_with_the_load_widen_the_exponent(solved):
    """The upper end falls with p^0.3 less than the leakage, and the lower end with p^0.2 more."""
    p = np.array([*UP, *DOWN])
    results = results_of(solved, ends=((p / 5e7) ** -0.2, (p / 5e7) ** 0.3))
    up = results.sealing_indices()[0]
    assert_allclose(up.exponent_interval, (N - 0.3, N + 0.2), rtol=1e-6)
    # a seal that may be sealed has no largest exponent, and no smallest index
    sealed = results_of(solved, ends=(0.0, np.inf)).sealing_indices()[0]
    assert sealed.exponent_interval == (-np.inf, np.inf)
    assert (sealed.limits[0].lower, sealed.limits[0].upper) == (0.0, np.inf)


def test_results_without_a_uniform_pressure_are_refused(solved):
    for table, said in (
        ({"load": {"map": [{"kind": "bolts"}]}}, "a map of the pressure"),
        ({"seal": {"kind": "rectangular", "form": [{}]}}, "a form of the seal"),
        ({"seat": {"kind": "crowned"}}, "a seat"),
    ):
        results = results_of(solved)
        facts = RunFacts(case=table)
        changed = assemble(results.scene, solved[1], facts=facts)
        with pytest.raises(InputError, match=f"{said}.*flat strip"):
            sealing_indices(changed)
    with pytest.raises(InputError, match="tolerance"):
        results_of(solved).sealing_indices(tolerance=2)
    with pytest.raises(InputError, match="fewer than two loads"):
        results_of(solved, np.zeros(7)).sealing_indices()


def test_numbers_are_short():
    texts = [index_text(x) for x in (3412.0, 1.23e7, 0.5, 1.2e-5, np.inf, 0.0)]
    assert texts == ["3400", "1.2e7", "0.5", "1.2e-5", "unknown", "0"]
