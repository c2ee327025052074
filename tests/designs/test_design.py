"""Design answers: Qmin and QSmin of seals whose leakage is a power of the load, scaling laws, and files of a case."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal import analytic
from femseal.base import to_text
from femseal.base.errors import InputError
from femseal.case.case import parse_case
from femseal.cli import main
from femseal.designs import data_sheet
from femseal.designs.requirements import Seals, crossings, pressure_for, requirement, sealing_load
from femseal.designs.sensitivities import Variants, level_at, sensitivities, slope_at
from femseal.loads import LoadProgramme
from femseal.report.page import report_html
from femseal.results import assemble

STEPS = LoadProgramme.of(
    [1e7, 3e7, 1e8, 4e8, 9e8], unload_from=[4e8, 9e8], unloading=[3e8, 1e8, 3e7, 1e7]
)
#: On loading L = A p^−3, on unloading from Q_A it grows with p^−½ from there.
FALL, RISE = 3.0, 0.5


def pascals(value):
    return to_text(value, "Pa", 3)


def power_law(amplitudes, steps=STEPS):
    """Leakages (seals, steps) of the two power laws; exact between steps too, because they are straight in log–log."""
    p = steps.pressures
    top = p[steps.peak_indices]
    law = np.where(steps.on_loading, p**-FALL, top**-FALL * (p / top) ** -RISE)
    return np.asarray(amplitudes, dtype=float)[:, None] * law


AMPLITUDES = np.exp(np.random.default_rng(3).normal(0, 0.3, 60)) * 1e12


def test_pressures_of_power_laws_are_exact():
    seals, limit = Seals.of(STEPS, power_law(AMPLITUDES)), 1e12 * 2e8**-FALL
    assert_allclose(seals.needed_on_loading(limit), (AMPLITUDES / limit) ** (1 / FALL))
    for peak in (4e8, 9e8):
        exact = peak * (AMPLITUDES * peak**-FALL / limit) ** (1 / RISE)
        exact = np.where(exact < 1e7, 0.0, np.where(exact > peak, np.inf, exact))
        assert_allclose(seals.needed_on_unloading(limit, peak), exact)
    assert np.isfinite(seals.needed_on_unloading(limit, 4e8)).all()


def test_a_share_of_the_seals_keeps_the_class():
    """At Qmin the share of seals in the class is at least the probability, and just below it is not."""
    seals, limit = Seals.of(STEPS, power_law(AMPLITUDES)), 1e12 * 2e8**-FALL
    need = requirement(seals, "L", limit, 0.9)
    for needed, leak in (
        (need.assembly, lambda p: AMPLITUDES * p**-FALL),
        (need.service[4e8], lambda p: AMPLITUDES * 4e8**-FALL * (p / 4e8) ** -RISE),
    ):
        assert np.mean(leak(needed.value * 1.000001) <= limit) >= 0.9
        assert np.mean(leak(needed.value * 0.999999) <= limit) < 0.9
        assert needed.relation == "="
        assert needed.low == needed.value == needed.computed
    assert_allclose(need.assembly.value, pressure_for((AMPLITUDES / limit) ** (1 / FALL), 0.9))


def test_the_whole_band_of_error_decides():
    """A band that is a factor f wide on both sides moves Qmin by f to the power of 1/3."""
    limit = 1e12 * 2e8**-FALL
    needed = requirement(
        Seals.of(STEPS, power_law(np.full(3, 1e12)), 1 / 1.3, 1.3), "L", limit, 0.9
    ).assembly
    found = np.array([needed.low, needed.computed, needed.value]) / 2e8
    assert_allclose(found, np.array([1 / 1.3, 1, 1.3]) ** (1 / FALL))
    assert needed.text(pascals) == "218 MPa (as computed: 200 MPa)"
    vague = requirement(
        Seals.of(STEPS, power_law(np.full(3, 1e12)), 0.0, 1e6), "L", limit, 0.9
    ).assembly
    assert (vague.low, vague.value, vague.relation) == (0.0, np.inf, ">")
    assert vague.text(pascals) == "above 900 MPa (as computed: 200 MPa)"
    # what is sealed leaks what its band allows
    sealed = power_law(np.full(3, 1e12)) * (STEPS.pressures < 1e8)
    open_ = Seals.of(STEPS, sealed, 1.0, 1.0, np.where(STEPS.pressures == 1e8, 1e-3, 0.0))
    assert (
        open_.needed_on_loading(limit)[0]
        < replace(open_, leakage=open_.upper).needed_on_loading(limit)[0]
    )


def test_what_keeps_a_class_keeps_it_at_higher_loads():
    """Bands of a test fluid are those of the run by their factor, which may rise faster than the leakage falls."""
    leakage, limit = power_law([1e12]), 1e12 * 2e8**-FALL
    factor = np.where(STEPS.pressures > 5e8, 10 * limit / leakage, 1.0)
    seals = Seals.of(STEPS, leakage, 1.0, factor)
    assert requirement(seals, "L", limit, 0.5).assembly.text(pascals) == "200 MPa"


def test_nothing_is_extrapolated():
    seals = Seals.of(STEPS, power_law([1e12]))
    above = requirement(seals, "L", 1e12 * 1e9**-FALL, 0.5)
    assert above.assembly.relation == ">"
    assert above.assembly.text(pascals) == "above 900 MPa"
    assert above.service[9e8].relation == ">"
    below = requirement(seals, "L", 1e12 * 9e6**-FALL, 0.5)
    assert below.assembly.text(pascals) == "at most 10 MPa"
    assert below.service[4e8].text(pascals) == "at most 10 MPa"
    assert below.assembly.low == 0


def test_loads_that_the_fluid_carries_alone_are_open():
    leakage, limit = power_law(AMPLITUDES), 1e12 * 2e8**-FALL
    seals = Seals.of(STEPS, np.where(STEPS.pressures == 1e7, np.nan, leakage))
    assert seals.count == len(AMPLITUDES)
    assert_allclose(seals.needed_on_loading(limit), (AMPLITUDES / limit) ** (1 / FALL))
    assert np.all(seals.needed_on_unloading(limit, 9e8) >= 3e7)
    assert Seals.of(STEPS, np.full_like(leakage, np.nan)).count == 0


def test_an_unloading_is_open_at_loads_that_the_first_loading_sealed():
    leakage = power_law(AMPLITUDES)
    late = np.array([step.unloaded_from is not None and step.pressure < 5e7 for step in STEPS])
    assert late.any()
    assert np.isin(STEPS.pressures[late], STEPS.pressures[STEPS.on_loading]).any()
    seals = Seals.of(STEPS, np.where(late, np.nan, leakage))
    assert seals.count == len(AMPLITUDES)
    assert np.isinf(seals.leakage[:, late]).all()
    assert np.isfinite(seals.leakage[:, ~late]).all()
    assert np.all(seals.needed_on_unloading(1.0, 9e8) == 1e8)


def test_where_a_seal_closes_the_step_that_keeps_the_limit_is_taken():
    """No logarithm reaches 0: between an open and a closed step the closed one is known to be enough."""
    pressure = np.array([4e8, 1e8, 3e7, 0.0])
    leak = np.array(
        [[0.0, 0.0, 1.0, 5.0], [0.0, 1e-3, 1.0, 5.0], [0.0, 0.0, 0.0, 0.0], [1.0, 2.0, 3.0, 4.0]]
    )
    assert_allclose(crossings(pressure, leak, 0.0), [1e8, 4e8, 0.0, np.inf])
    assert_allclose(crossings(pressure, leak, 0.5)[[0, 2, 3]], [1e8, 0.0, np.inf])
    # a load of 0 has no logarithm either
    assert_allclose(crossings(pressure, leak, 2.0)[0], 3e7)
    closing = np.array([[5.0, 1.0, 1e-3, 0.0, 0.0]])
    seals = Seals.of(LoadProgramme.of(STEPS.loading), closing)
    assert sealing_load(seals, 0.5).value == 4e8


def test_slopes_leave_out_loads_whose_leakage_is_not_known():
    leak = power_law(AMPLITUDES)
    leak[:, 4] = np.inf
    seals = Seals.of(STEPS, leak)
    assert seals.count == len(AMPLITUDES)
    assert_allclose(slope_at(seals, 5e7, 0.9), -FALL)
    assert np.isnan([slope_at(seals, 6e8, 0.9), level_at(seals, 6e8, 0.9)]).all()


def test_a_loading_that_leaks_more_again_counts_from_there_on():
    leak = np.array([[1.0, 0.1, 1.0, 0.1, 0.01]])
    seals = Seals.of(LoadProgramme.of(STEPS.loading), leak)
    assert 1e8 < seals.needed_on_loading(0.5)[0] < 4e8


def test_slopes_of_power_laws_are_exact():
    """L = A p^−3 H^2 η^−1: amplitude 2 − 2 + 3 + 1, modulus 3 − 2."""
    seals = Seals.of(STEPS, power_law(AMPLITUDES))
    harder = Seals.of(STEPS, power_law(AMPLITUDES) * 1.1**2)
    found = {
        s.quantity: s for s in sensitivities(seals, Variants(harder, inlet_slope=1.0), 2e8, 0.9)
    }
    exact = {
        "nominal pressure": -3,
        "hardness": 2,
        "roughness amplitude": 4,
        "contact modulus": 1,
        "viscosity": -1,
        "breadth, same pressure": -1,
        "breadth, same force": 2,
        "inlet pressure": 1,
    }
    for name, slope in exact.items():
        assert_allclose(found[name].leakage, slope, rtol=1e-9)
        if name != "nominal pressure":
            assert_allclose(found[name].pressure, slope / 3, rtol=1e-9)
    assert_allclose(slope_at(seals, 1e7, 0.5), -3)
    assert_allclose(slope_at(seals, 9e8, 0.5), -3)
    assert np.isnan(slope_at(seals, 9.1e8, 0.5))
    assert_allclose(np.exp(level_at(seals, 2e8, 1.0)), AMPLITUDES.max() * 2e8**-FALL)
    elastic = {
        s.quantity: s.leakage
        for s in sensitivities(seals, Variants(hardness_counts=False), 2e8, 0.9)
    }
    assert elastic["hardness"] == 0
    assert_allclose(elastic["roughness amplitude"], 6)
    unknown = {s.quantity: s.leakage for s in sensitivities(seals, Variants(), 2e8, 0.9)}
    assert np.isnan([unknown["hardness"], unknown["roughness amplitude"]]).all()
    slip = Variants(
        hardness_counts=False,
        law_length="slip_length",
        longer=Seals.of(STEPS, power_law(AMPLITUDES) * 1.1**0.3),
    )
    # L(αa, αp, αη, αb) = α² L: what goes with the slip length no longer goes with the amplitude
    slippery = {s.quantity: s.leakage for s in sensitivities(seals, slip, 2e8, 0.9)}
    assert_allclose(
        [slippery[name] for name in ("viscosity", "slip length", "roughness amplitude")],
        [-1, 0.3, 5.7],
    )
    harder = Seals.of(STEPS, power_law(AMPLITUDES) * 1.1**2)
    hardening = {
        s.quantity: s.leakage
        for s in sensitivities(seals, Variants(harder, hardens=True), 2e8, 0.9)
    }
    assert_allclose(hardening["contact modulus"], FALL - hardening["hardness"])
    assert np.isnan(hardening["roughness amplitude"])
    gas = Variants(
        hardness_counts=False,
        law_length="viscosity",
        longer=Seals.of(STEPS, power_law(AMPLITUDES) * 1.1**-0.4),
    )
    rarefied = {s.quantity: s.leakage for s in sensitivities(seals, gas, 2e8, 0.9)}
    assert_allclose(
        [rarefied["viscosity"], rarefied["roughness amplitude"]], [-0.4, 5.4], rtol=1e-9
    )


@pytest.fixture(scope="module")
def face():
    return fs.self_affine((48, 48), (60e-6, 60e-6), hurst=0.8, rms_slope=0.2, cut_off=10e-6, rng=1)


def test_scaling_laws_hold_for_contact_and_flow(face):
    """L(αa, E, αH, αp) = α³ L(a, E, H, p) and L(a, βE, βH, βp) = L(a, E, H, p), which the slopes are made of."""
    scene = fs.Scene(
        face,
        115e9,
        2e9,
        fs.Liquid(1e-3),
        1e6,
        0.0,
        loading=(1e8, 4e8),
        unload_from=(4e8,),
        unloading=(1e8,),
        rtol=1e-8,
    )

    def scaled(factor, modulus, heights):
        loads = {
            name: tuple(factor * p for p in getattr(scene, name))
            for name in ("loading", "unload_from", "unloading")
        }
        higher = fs.Topography(heights * face.heights, face.spacing)
        return fs.deterministic(
            replace(scene, surface=higher, modulus=modulus * 115e9, hardness=factor * 2e9, **loads)
        ).leakage

    exact = fs.deterministic(scene).leakage
    assert (exact > 0).all()
    assert_allclose(scaled(1.3, 1.0, 1.3), 1.3**3 * exact, rtol=2e-3)
    assert_allclose(scaled(1.3, 1.3, 1.0), exact, rtol=2e-3)


def test_one_seal_has_no_probability(face):
    scene = fs.Scene(face, 115e9, 2e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(1e7, 1e8, 4e8))
    study = fs.deterministic(scene)
    limit = float(np.sqrt(study.leakage[0] * study.leakage[1])) * 1e9
    answer = fs.design(assemble(scene, study), classes=[f"{limit!r} µL/(m·s)"])
    assert_allclose(answer.requirements[0].assembly.computed, np.sqrt(1e7 * 1e8), rtol=1e-6)
    assert "no probability" in answer.notes[0]
    assert "without an error budget" in answer.notes[1]
    assert "not unloaded" in answer.notes[2]
    assert "(" not in answer.requirements[0].assembly.text(pascals)
    assert repr(answer).startswith("<femseal.Design of 1 seal, probability 0.95")
    assert "31.6 MPa" in repr(answer)
    assert "Qmin(L)" in answer._repr_html_()


def test_the_stiffness_of_a_wave_is_that_of_its_closed_form():
    """From half of the pressure that flattens it to a sixth; the mean gap is the integral of Westergaard's."""
    n, wavelength, height, modulus = 256, 64e-6, 0.1e-6, 115e9
    x = (np.arange(n) + 0.5) / n
    wave = fs.Topography(np.tile(height * np.cos(2 * np.pi * x), (8, 1)), (wavelength / n,) * 2)
    flat = analytic.wave_full_contact_pressure(modulus, height, wavelength)
    scene = fs.Scene(
        wave,
        modulus,
        np.inf,
        fs.Liquid(1e-3),
        1e3,
        0.0,
        loading=(flat / 2,),
        unload_from=(flat / 2,),
        unloading=(flat / 6,),
        boundary=("periodic", "periodic"),
        fluid_pressure="ignored",
    )
    answer = fs.design(assemble(scene, fs.deterministic(scene)))
    gaps = [analytic.wave_gap(x, ratio, height, 1.0).mean() for ratio in (1 / 2, 1 / 6)]
    assert_allclose(answer.stiffness[flat / 2], flat / 3 / (gaps[1] - gaps[0]), rtol=2e-3)
    told = f"{answer.stiffness[flat / 2] / 1e12:.3g} MPa/µm"
    assert any(told in text for text in data_sheet.sheet_sentences(answer))


def test_the_picture_marks_limits_and_pressures(face):
    loads = {"loading": (1e7, 1e8, 4e8), "unload_from": (4e8,), "unloading": (1e8, 1e7)}
    scene = fs.Scene(face, 115e9, 2e9, fs.Liquid(1e-3), 1e6, 0.0, **loads)
    study = fs.deterministic(scene)
    limit = float(np.sqrt(study.leakage[3] * study.leakage[4])) * 1e9
    answer = fs.design(
        assemble(scene, study), classes=[f"{limit:.4g} mg/(m·s)", f"{limit * 1e9:.4g} mg/(m·s)"]
    )
    axes = answer.plot().axes[0]
    named = {text.get_text().strip() for text in axes.texts}
    need = answer.requirements[0]
    assert need.service[4e8].relation == "="
    assert {
        need.name,
        pascals(need.assembly.computed),
        pascals(need.service[4e8].computed),
    } <= named
    places = {
        (float(x), float(y))
        for line in axes.lines
        if len(line.get_xdata()) == 1
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    }
    assert any(
        np.allclose(place, (need.assembly.computed / 1e6, limit), rtol=1e-3) for place in places
    )


def case(**more):
    return parse_case(
        {
            "method": "stochastic",
            "face": {
                "kind": "self-affine",
                "points": [32, 32],
                "size": ["60 um", "60 um"],
                "hurst": 0.8,
                "rms_slope": 0.2,
            },
            "material": {"young": "210 GPa", "yield_stress": "1 GPa"},
            "load": {
                "loading": ["20 MPa", "100 MPa", "400 MPa"],
                "unload_from": ["400 MPa"],
                "unloading": ["100 MPa", "20 MPa"],
            },
            "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "10 bar"},
            "cells": {"count": [2, 2]},
            "stochastic": {"length": "300 um", "realisations": 8},
            **more,
        }
    )


#: Grooves along the seal, across the leakage.
GROOVED = {
    "kind": "turned",
    "points": [32, 32],
    "size": ["60 um", "60 um"],
    "pitch": "30 um",
    "depth": "1.5 um",
    "roughness": "0.3 um",
    "roughness_roll_off": "20 um",
}


def test_a_case_gives_files_and_a_section_of_the_report(tmp_path):
    results = fs.run(case(face=GROOVED), workers=1)
    limit = float(np.exp(np.mean(np.log(results.leakage.values[:2])))) * 1e9
    wanted = [f"{limit:.6g} mg/(m·s)", "L0.01"]  # of water
    answer = fs.design(
        case(face=GROOVED), tmp_path, classes=wanted, workers=1, assembly=["100 MPa"]
    )
    assert answer.seals.steps.unload_from == (1e8, 4e8)
    need = answer.requirements[0]
    assert 2e7 < need.assembly.computed < 1e8 * 1.0001
    assert need.assembly.low <= need.assembly.computed <= need.assembly.value
    assert {s.quantity for s in answer.sensitivities} >= {
        "hardness",
        "roughness amplitude",
        "viscosity",
    }
    assert all(np.isfinite(s.leakage) for s in answer.sensitivities)
    slopes = {s.quantity: s.leakage for s in answer.sensitivities}
    assert 0.05 < slopes["hardness"] < 5  # a harder seal keeps wider gaps
    assert_allclose(
        sum(slopes[name] for name in ("hardness", "contact modulus", "nominal pressure")),
        0,
        atol=1e-12,
    )
    with (tmp_path / "design.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert_allclose(float(rows[0]["computed"]), need.assembly.computed)
    assert next(row["relation"] for row in rows if row["class"] == "L0.01") == ">"
    assert json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))["probability"] == 0.95
    assert (tmp_path / "design.png").read_bytes().startswith(b"\x89PNG")
    again = fs.open_results(tmp_path)
    page = report_html(again)
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("What the seal needs") == 2
    assert "QSmin(L), Q_A = 400 MPa" in page
    assert "d ln Qmin / d ln x" in page
    reused = fs.design(tmp_path, classes=wanted)
    assert reused.requirements == answer.requirements
    assert "takes a solution" in next(
        s.how for s in reused.sensitivities if s.quantity == "hardness"
    )
    (tmp_path / "design.json").write_text("[1]")
    assert "What the seal needs" not in report_html(again)


def test_the_command_says_what_the_seal_needs(tmp_path, monkeypatch, capsys):
    output = {"paraview": "none", "fields_limit": "0 byte", "classes": ["L1"]}
    fs.run(case(output=output), tmp_path, workers=1)

    def design(*more):
        monkeypatch.setattr(
            sys, "argv", ["femseal", "design", str(tmp_path), "--probability", "0.5", *more]
        )
        try:
            main()
        except SystemExit as end:
            return end.code, capsys.readouterr().err
        return 0, capsys.readouterr().out

    code, told = design()
    assert code == 0
    assert "QSmin(L), Q_A = 400 MPa" in told
    assert "L1 " in told
    assert (tmp_path / "design.json").is_file()
    for more, fault in (
        (["--class", "L7"], "classes: given 'L7'"),
        (["--class", "ISO 5208 B"], "nominal_diameter: given none"),
        (["--class", "TA Luft"], "defined for helium"),
        (["--probability", "1.5"], "probability: given 1.5"),
        (
            ["--assembly", "50 MPa"],
            "assembly: given 50 MPa, expected those that the run is unloaded from",
        ),
    ):
        code, told = design(*more)
        assert code == 2
        assert fault in told
        assert told.count("\n") == 1


def test_arguments_are_checked_before_anything_is_solved(tmp_path):
    with pytest.raises(InputError, match="assembly: given 1 MPa"):
        fs.design(case(), tmp_path / "none", assembly=["1 MPa"])
    with pytest.raises(InputError, match="assembly: given 5 GPa"):
        fs.design(case(), tmp_path / "none", assembly=["5 GPa"])
    with pytest.raises(InputError, match="defined for helium"):
        fs.design(case(), tmp_path / "none", classes=["TA Luft"])
    assert not (tmp_path / "none").exists()


def test_classes_of_the_test_fluid_decide(tmp_path):
    helium = {
        "kind": "ideal-gas",
        "viscosity": "19.6 uPa*s",
        "molar_mass": "4.0026 g/mol",
        "temperature": "20 °C",
        "slip": False,
        "inlet_pressure": "40 bar",
    }
    results = fs.run(case(output={"test_fluid": helium}), workers=1)
    answer = fs.design(results, classes=["TA Luft"])
    assert_allclose(answer.seals.leakage, results.dataset["test_leakage_realisations"])
    gas = fs.IdealGas(19.6e-6, 4.0026e-3, 293.15, slip=False)
    assert_allclose(answer.requirements[0].limit, 1e-8 / gas.reference_density)
    inlet = next(s.leakage for s in answer.sensitivities if s.quantity == "inlet pressure")
    assert_allclose(inlet, 2 * 40e5**2 / (40e5**2 - 101_325**2), rtol=1e-4)
