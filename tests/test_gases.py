"""Real gases: the table against a quadrature of CoolProp, the thin gas, every method, and what is refused."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from coolprop_gases import LEFT_OUT, needs_coolprop, potential_by_quadrature, potential_drop
from numpy.testing import assert_allclose
from small_cases import CASE, steel_scene

import femseal as fs
from femseal import gases
from femseal.base import NotConverged
from femseal.checks.ideal_gas import ideal_gas_error
from femseal.fluids import FLUIDS, potential_of
from femseal.named_fluids import FLUID_TABLE, named_fluid
from femseal.studies import FluidState
from femseal.studies.other_fluid import limit_factors


def test_a_table_that_does_not_resolve_a_gas_ends(monkeypatch):
    """Density and viscosity that differ at random from pressure to pressure are not interpolated by any table."""
    random = np.random.default_rng(0)
    monkeypatch.setattr(
        gases,
        "density_and_viscosity",
        lambda name, t, p: (random.random(p.shape), np.ones(p.shape)),
    )
    monkeypatch.setattr(gases, "_highest_pressure", lambda name, t: (1e8, False))
    with pytest.raises(NotConverged, match="10,000 pressures do not resolve density and viscosity"):
        gases._table("noise", 300.0)


@needs_coolprop
@pytest.mark.parametrize(
    ("name", "temperature", "highest"),
    [
        ("nitrogen", 293.15, 1e8),
        ("hydrogen", 293.15, 1e8),
        ("methane", 293.15, 1e8),
        ("helium", 423.15, 1e8),
        ("co2", 305.0, 2e7),  # just above its critical point
        ("Propane", 293.15, 8.3e5),
    ],
)
def test_potential_agrees_with_a_quadrature(name, temperature, highest):
    gas, rng = fs.RealGas(name, temperature), np.random.default_rng(1)
    for p in np.exp(rng.uniform(np.log(1e4), np.log(highest), 4)):
        assert_allclose(gas.potential(p), potential_by_quadrature(name, temperature, p), rtol=1e-6)
    p = np.append(np.geomspace(1e-3, highest, 50), 0.0)
    assert_allclose(gas.pressure(gas.potential(p)), p, rtol=1e-9)
    assert_allclose(gas.slope(p[:-1]), gas.density_at(p[:-1]) / gas.viscosity_at(p[:-1]), rtol=1e-5)


@needs_coolprop
@pytest.mark.parametrize("name", ["nitrogen", "hydrogen", "methane"])
def test_a_dense_gas_agrees_with_a_quadrature_and_a_thin_one_is_ideal(name):
    real = fs.RealGas(name)
    assert_allclose(real.potential(7e7), potential_by_quadrature(name, 293.15, 7e7), rtol=1e-6)
    ideal = fs.IdealGas(float(real.viscosity_at(1.0)), real.molar_mass, 293.15)
    ratio = [float(real.potential(p) / ideal.potential(p)) for p in (1e3, 1e4, 1e5)]
    assert_allclose(ratio, 1, rtol=1e-3)
    assert_allclose(ratio[0], 1, rtol=2e-5)  # CoolProp's gas constant is that of its equation
    # in proportion to the pressure, as the second virial coefficient has it
    assert_allclose((ratio[2] - ratio[0]) / (ratio[1] - ratio[0]), 99 / 9, rtol=0.05)
    assert_allclose(real.law.factor(1e-7, 1e3), ideal.law.factor(1e-7, 1e3), rtol=1e-4)
    assert_allclose(real.reference_density, ideal.reference_density, rtol=1e-12)
    assert 1 < real.law.factor(1e-7, 7e7) < 1.05


@needs_coolprop
def test_mean_free_path_is_proportional_to_viscosity_over_density():
    gas = fs.RealGas("nitrogen")
    for p in (1e5, 7e7):
        speed = np.sqrt(2 * 8.314462618 * 293.15 / gas.molar_mass)
        wanted = 1e-7 * gas.density_at(p) * speed / (2 * gas.viscosity_at(p))
        assert_allclose(gas.law.inverse_knudsen(1e-7, p), wanted, rtol=1e-5)


def scene(fluid, inlet, outlet=1e5):
    face = fs.self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.1, cut_off=6e-6, rng=2)
    ends = {"inlet_pressure": inlet, "outlet_pressure": outlet, "hardness": np.inf}
    return steel_scene(face, fluid=fluid, loading=(3e7,), **ends)


@needs_coolprop
@pytest.mark.parametrize("slip", [False, True])
@pytest.mark.parametrize("method", ["deterministic", "two-scale", "stochastic"])
def test_every_method_accepts_a_real_gas_and_conserves_mass(method, slip):
    real = fs.RealGas("hydrogen", 293.15, slip)
    thin = fs.IdealGas(float(real.viscosity_at(1.0)), real.molar_mass, 293.15, slip)
    solve = {
        "deterministic": fs.deterministic,
        "two-scale": lambda s: fs.two_scale(s, (4, 4)),
        "stochastic": lambda s: fs.stochastic(s, (4, 4), fs.Sampling(480e-6, 3, seed=1)),
    }[method]
    scenes = scene(real, 7e7), scene(real, 2e4, 1e4), scene(thin, 2e4, 1e4)
    dense, low, ideal = (np.ravel(solve(one).leakage)[-1] for one in scenes)
    assert dense > 0
    assert_allclose(low, ideal, rtol=1e-3)
    assert potential_drop(real, 7e7, 1e5) < 0.75 * potential_drop(thin, 7e7, 1e5)
    if not slip:  # one conductance for all fluids
        assert_allclose(
            dense / potential_drop(real, 7e7, 1e5),
            ideal / potential_drop(thin, 2e4, 1e4),
            rtol=1e-9,
        )


@needs_coolprop
def test_a_real_gas_presses_faces_apart_and_its_mass_is_conserved_in_a_seal():
    real = fs.RealGas("hydrogen", 293.15, False)
    pressed = replace(scene(real, 7e7), loading=(2e8,))
    apart = replace(pressed, fluid_pressure="acts")
    assert fs.deterministic(apart).leakage[0] > 1.1 * fs.deterministic(pressed).leakage[0]
    seal, rng = fs.RectangularSeal((1e-3, 1e-3), (6, 5)), np.random.default_rng(0)
    k = 1e-20 * np.exp(rng.normal(size=(6, 5)))
    leakage = fs.seal_leakage(seal, k, real, inlet_pressure=7e7, outlet_pressure=0.0)
    assert leakage.imbalance < 1e-9
    assert_allclose(leakage.mass_rate, leakage.conductance * real.potential(7e7), rtol=1e-12)
    p = leakage.fluid_pressure
    assert_allclose([p.max(), p.min()], [7e7, 0.0], rtol=1e-9)


@needs_coolprop
def test_a_vapour_just_below_saturation_is_a_gas():
    gas, seal = fs.RealGas("CO2"), fs.RectangularSeal((1e-3, 1e-3), (4, 4))
    inlet = (1 - 1e-5) * gas.highest_pressure
    leakage = fs.seal_leakage(seal, 1e-20, gas, inlet_pressure=inlet)
    assert_allclose(np.max(leakage.fluid_pressure), inlet, rtol=1e-9)
    assert_allclose(leakage.mass_rate, 1e-20 * potential_of(gas, "inlet", inlet), rtol=1e-9)


@needs_coolprop
@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: potential_of(fs.RealGas("CO2"), "inlet", 6e6),
            r"^inlet: given 6 MPa, expected less than 5.729 MPa, absolute, at which CO2 ",
        ),
        (lambda: potential_of(fs.RealGas("propane"), "inlet", 1e6), "propane condenses at 20 °C"),
        (
            lambda: potential_of(fs.RealGas("oxygen"), "inlet", 8.1e7),
            "at most 80 MPa, absolute, up to which CoolProp knows oxygen at 20 °C",
        ),
        (lambda: fs.RealGas("grease", 293.15), "name: .*Acetone"),
        (
            lambda: fs.RealGas("acetone", 500.0),
            "a fluid whose viscosity CoolProp knows: for this one it knows only the density",
        ),
        (lambda: fs.RealGas("krypton"), "krypton.*knows only the density. Give the viscosity"),
        (lambda: named_fluid("N2O"), "N2O.*knows only the density. Give the viscosity"),
        (lambda: fs.RealGas("helium", 1e5), "a temperature from"),
        (lambda: fs.RealGas("helium", -1.0), "^temperature: given -1.0"),
        (lambda: fs.RealGas("helium", 300.0, "no"), "^slip: given 'no'"),
    ],
)
def test_invalid_real_gases_and_pressures_are_refused(call, said):
    with pytest.raises(fs.InputError, match=said):
        call()


def test_without_coolprop_a_real_gas_is_refused_with_advice(monkeypatch, tmp_path):
    for name in LEFT_OUT:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(fs.InputError, match=r"pip install 'femseal\[fluids\]'"):
        fs.RealGas("nitrogen")
    with pytest.raises(
        fs.InputError,
        match=r"fluid.name: given 'nitrogen' at 20 °C, .*pip install 'femseal\[fluids\]'",
    ):
        fs.load_case(
            case_of(tmp_path, 'kind = "real-gas"\nname = "nitrogen"\ninlet_pressure = "700 bar"\n')
        )


def case_of(folder, table):
    path = folder / "case.toml"
    path.write_text(re.sub(r'kind = "liquid"\nvis.*\n.*\n', table, CASE))
    return path


@needs_coolprop
def test_a_case_can_choose_a_real_gas(tmp_path):
    table = 'kind = "real-gas"\nname = "nitrogen"\nslip = false\ninlet_pressure = "200 bar"\n'
    case = fs.load_case(case_of(tmp_path, table))
    assert case.fluid.fluid == fs.RealGas("nitrogen", 293.15, slip=False)
    assert (case.fluid.outlet_pressure, case.echo()["fluid"]["name"]) == (101_325.0, "nitrogen")
    for name, said in (
        ("", "fluid.name: given nothing"),
        ('name = "co2"\n', r"fluid.inlet_pressure: given 6 MPa, .*condens"),
        ('name = "grease"\n', r"fluid.name: given 'grease'"),
    ):
        table = f'kind = "real-gas"\n{name}inlet_pressure = "60 bar"\n'
        with pytest.raises(fs.InputError, match=said):
            fs.load_case(case_of(tmp_path, table))


@needs_coolprop
def test_a_real_test_gas_has_the_limits_of_the_ideal_gas_at_low_pressure():
    states = [
        FluidState(fs.RealGas(name, 293.15, False), 2e5, 1e5) for name in ("helium", "nitrogen")
    ]
    ideal = [
        FluidState(FLUIDS["ideal-gas"](**FLUID_TABLE[n].parameters), 2e5, 1e5)
        for n in ("helium", "nitrogen")
    ]
    found, wanted = limit_factors(*states), limit_factors(*ideal)
    assert_allclose([found.viscous, found.molecular], [wanted.viscous, wanted.molecular], rtol=2e-3)


@needs_coolprop
@pytest.mark.parametrize(
    "name", [name for name, fluid in FLUID_TABLE.items() if fluid.kind == "ideal-gas"]
)
def test_the_error_of_the_ideal_gas_law_agrees_with_the_potentials(name):
    gas = fs.IdealGas(**FLUID_TABLE[name].parameters)
    for inlet in (2e6, 7e7):
        real = potential_by_quadrature(name, 293.15, inlet) - potential_by_quadrature(
            name, 293.15, 1e5
        )
        found = ideal_gas_error(gas, inlet, 1e5)
        assert found.name == name
        assert_allclose(found.ratio, potential_drop(gas, inlet, 1e5) / real, rtol=1e-5)
    with pytest.MonkeyPatch.context() as patch:
        for module in LEFT_OUT:
            patch.setitem(sys.modules, module, None)
        found = ideal_gas_error(gas, 2e6, 1e5)
        assert np.isnan(found.ratio)
        assert "is not installed" in found.reason
