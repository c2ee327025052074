"""Quick estimates of contact and leakage by the spectrum of a surface alone."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from fluid_cases import OIL, case_with_fluid
from numpy.testing import assert_allclose

import femseal as fs
from femseal.checks import estimate_surface
from femseal.checks.quick_estimate import ERROR_FACTORS, LIGHT_CONTACT
from femseal.flow.law import FlowLaw
from femseal.flow.pressure_drop import PressureDrop
from femseal.preparation import prepare
from femseal.runs.run_description import describe

WAVES = np.geomspace(1e4, 1e6, 40)
POWERS = 1e-12 * (WAVES / WAVES[0]) ** -1.6


def test_grooves_across_the_flow_close_before_grooves_along_it():
    face = fs.self_affine((64, 64), (1e-4, 1e-4), hurst=0.8, rms_slope=0.1, rng=3)
    ridged = face.with_heights(face.heights + 3 * face.low_pass(2e-5).heights.mean(axis=1)[:, None])
    crossed = face.with_heights(ridged.heights.T)
    loads = np.geomspace(1e6, 5e9, 40)
    across, along = (
        estimate_surface(surface, 1e11, np.inf, loads) for surface in (ridged, crossed)
    )
    assert_allclose(across.area, along.area)
    assert np.all(across.permeability <= along.permeability * (1 + 1e-9))
    assert (across.permeability == 0).sum() > (along.permeability == 0).sum()


def test_the_stated_error_factors_are_those_of_the_benchmark():
    page = (Path(__file__).parents[1] / "benchmarks" / "quick_estimate.md").read_text(
        encoding="utf-8"
    )
    cells = re.search(rf"\| contact below {100 * LIGHT_CONTACT:g} % (.*)", page)[1].split("|")
    assert [float(cell) for cell in cells[4:6]] == list(ERROR_FACTORS)


@dataclass(frozen=True)
class MaxwellSlip(FlowLaw):
    """Slip on both faces by the mean free path of a gas, which goes with 1/p: F = 1 + 6 Kn."""

    depends_on_pressure = True
    path_times_pressure: float

    def factor(self, gap, pressure=0.0):
        with np.errstate(divide="ignore"):
            return 1 + 6 * self.path_times_pressure / (np.asarray(gap) * pressure)


@dataclass(frozen=True)
class SlippingGas(fs.IdealGas):
    law = MaxwellSlip(0.02)


@pytest.mark.parametrize("outlet", [0.0, 0.1, 1e3, 0.99e5])
def test_a_gas_that_slips_takes_the_mean_of_slip_over_p_dp(outlet):
    """∫(1 + 6 λp/(hp)) p dp over the drop: 1 + 12 λp/(h (p₁ + p₂)), finite where the outlet is a vacuum."""
    inlet, gaps = 1e5, np.array([1e-9, 1e-7, 1e-5])
    drop = PressureDrop.of_fluid(SlippingGas(19.6e-6, 4.0026e-3, 293.15), inlet, outlet)
    exact = 1 + 12 * 0.02 / (gaps * (inlet + outlet))
    assert_allclose([drop.mean_factor_of(gap) for gap in gaps], exact, rtol=1e-5)
    assert np.isnan(drop.mean_factor_of(np.nan))
    assert np.isfinite(drop.mean_factor_of(0.0))
    assert PressureDrop.of_fluid(fs.Liquid(1e-3), inlet, outlet).mean_factor_of(1e-9) == 1


def test_a_liquid_that_slips_flows_1_plus_6b_over_h_times_as_fast():
    drop = PressureDrop.of_fluid(fs.Liquid(1e-3, slip_length=1e-6), 1e6, 0.0)
    assert_allclose([drop.mean_factor_of(gap) for gap in (1e-6, 6e-6)], [7, 2])
    assert np.isnan(drop.mean_factor_of(np.nan))
    assert np.isfinite(drop.mean_factor_of(0.0))


def test_quick_estimate_and_description_contain_the_slip_of_a_liquid():
    without, slipping = (
        case_with_fluid({**OIL, "slip_length": length}, rms_height="0.5 um")
        for length in ("0 um", "1 um")
    )
    prepared = prepare(slipping)
    estimates = prepared.estimate(), prepare(without).estimate()
    assert_allclose(estimates[0].leakage / estimates[1].leakage, 1 + 6e-6 / estimates[1].gap)
    line = next(line for line in describe(slipping, prepared) if "the viscous flow" in line)
    factor = 1 + 6e-6 / prepared.scene.surface.rms_height
    assert f" {factor:.3g} times the viscous flow" in line


def test_helium_into_a_vacuum_leaks_as_the_quick_estimate():
    helium = {"name": "helium", "inlet_pressure": "1 atm"}
    leakages = []
    for outlet in ("0 Pa", "1e-3 mbar", "1 mbar"):
        given = case_with_fluid(helium | {"outlet_pressure": outlet}, rms_height="0.5 um")
        leakages.append(prepare(given).estimate().leakage[0])
    assert_allclose(leakages, leakages[0], rtol=0.01)
    results = fs.run(
        case_with_fluid(helium | {"outlet_pressure": "0 Pa"}, rms_height="0.5 um"), workers=1
    )
    assert leakages[0] / results.leakage.values[0] == pytest.approx(1, abs=0.9)
    assert not any("quick estimate" in text for text in results.warnings)


def test_a_seat_that_is_higher_than_the_roughness_has_no_quick_estimate():
    for radius, has_estimate in (("1 m", True), ("5 mm", False)):
        crowned = case_with_fluid(OIL, {"kind": "crowned", "radius": radius}, rms_height="0.5 um")
        assert (prepare(crowned).estimate() is not None) == has_estimate
