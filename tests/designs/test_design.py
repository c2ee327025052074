"""Designs: scaling laws of contact and flow, stiffness, data sheet, command, and files of a case."""

import csv
import json

import numpy as np
import pytest
from design_cases import GROOVED, design_case
from numpy.testing import assert_allclose
from small_cases import E, steel_scene

import femseal as fs
from femseal.base import InputError
from femseal.designs.data_sheet import sheet_sentences, sheet_tables
from femseal.results import RunFacts, assemble

CYCLE = {"loading": (1e7, 1e8, 4e8), "unload_from": (4e8,), "unloading": (1e8, 1e7)}


@pytest.fixture(scope="module")
def face():
    return fs.self_affine((48, 48), (60e-6, 60e-6), hurst=0.8, rms_slope=0.2, cut_off=10e-6, rng=1)


def test_scaling_laws_hold_for_contact_and_flow(face):
    """L(αa, E, αH, αp) = α³ L(a, E, H, p) and L(a, βE, βH, βp) = L(a, E, H, p), which the slopes are made of."""

    def scaled(factor, modulus, heights):
        loads = {name: tuple(factor * p for p in loads) for name, loads in CYCLE.items()}
        surface = face.with_heights(heights * face.heights)
        given = {"modulus": modulus * E, "hardness": factor * 2e9, "rtol": 1e-8}
        return fs.deterministic(steel_scene(surface, **given, **loads)).leakage

    exact = scaled(1.0, 1.0, 1.0)
    assert (exact > 0).all()
    assert_allclose(scaled(1.3, 1.0, 1.3), 1.3**3 * exact, rtol=2e-3)
    assert_allclose(scaled(1.3, 1.3, 1.0), exact, rtol=2e-3)


def test_one_seal_has_no_probability(face):
    scene = steel_scene(face, hardness=2e9, loading=CYCLE["loading"])
    study = fs.deterministic(scene)
    limit = float(np.sqrt(study.leakage[0] * study.leakage[1])) * 1e9
    answer = fs.design(assemble(scene, study), classes=[f"{limit!r} µL/(m·s)"])
    assert_allclose(answer.requirements[0].assembly.computed, np.sqrt(1e7 * 1e8), rtol=1e-6)
    assert "no probability" in answer.notes[0]
    assert "without an error budget" in answer.notes[1]
    assert "not unloaded" in answer.notes[2]
    assert "31.6 MPa" in repr(answer)


def test_the_data_sheet_shows_the_sealing_index(face, tmp_path):
    """The table, the file for programs and Python have the same exponents and limits."""
    loads = {"loading": (5e7, 1e8, 2e8), "unload_from": (2e8,), "unloading": (1e8, 5e7)}
    scene = steel_scene(face, hardness=2e9, **loads)
    results = assemble(scene, fs.deterministic(scene))
    answer = fs.design(results, tmp_path, classes=["1 mL/(m·s)", "2 mL/(m·s)"])
    indices = results.sealing_indices(["1 mL/(m·s)", "2 mL/(m·s)"])
    assert repr(answer.sealing_indices) == repr(indices)  # intervals that are not known are NaN
    table = sheet_tables(answer)[-1]
    assert table.heads == ("load", "contact pressure", "n", "1 mL/(m·s)", "2 mL/(m·s)")
    assert table.lines[0][0] == "loading"
    assert table.lines[-1][0] == "unloading from 200 MPa"
    assert table.lines[-1][1] == "50 – 200 MPa"
    assert table.lines[0][2] == f"{indices[0].exponent:.2g}"
    assert any("integral of pⁿ" in sentence for sentence in sheet_sentences(answer))
    with (tmp_path / "design.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if "sealing index" in row["figure"]]
    assert len(rows) == 3 * len(indices)
    exponent, first, second = rows[:3]
    assert_allclose(float(exponent["computed"]), indices[0].exponent)
    assert_allclose(float(first["computed"]), indices[0].limits[0].value)
    assert_allclose(float(first["computed"]) / float(second["computed"]), 2)
    assert first["class"] == "1 mL/(m·s)"
    assert rows[-1]["assembly_pressure_Pa"] == "200000000.0"


def test_a_seal_with_a_seat_has_no_sealing_index(face):
    scene = steel_scene(face, hardness=2e9, loading=CYCLE["loading"])
    facts = RunFacts(case={"seat": {"kind": "crowned"}})
    answer = fs.design(
        assemble(scene, fs.deterministic(scene), facts=facts), classes=["1 mL/(m·s)"]
    )
    assert answer.sealing_indices == ()
    assert not any("Sealing index" in table.title for table in sheet_tables(answer))
    (said,) = [sentence for sentence in sheet_sentences(answer) if "sealing index" in sentence]
    assert "does not follow from this run, because the run has a seat" in said


def test_the_stiffness_of_a_wave_is_that_of_its_closed_form():
    """From half of the pressure that flattens it to a sixth; the mean gap is the integral of Westergaard's."""
    n, wavelength, height = 256, 64e-6, 0.1e-6
    x = (np.arange(n) + 0.5) / n
    wave = fs.Topography(np.tile(height * np.cos(2 * np.pi * x), (8, 1)), (wavelength / n,) * 2)
    flat = fs.analytic.wave_full_contact_pressure(E, height, wavelength)
    loads = {"loading": (flat / 2,), "unload_from": (flat / 2,), "unloading": (flat / 6,)}
    ends = {"hardness": np.inf, "inlet_pressure": 1e3, "boundary": ("periodic", "periodic")}
    scene = steel_scene(wave, **ends, **loads)
    answer = fs.design(assemble(scene, fs.deterministic(scene)))
    gaps = [fs.analytic.wave_gap(x, ratio, height, 1.0).mean() for ratio in (1 / 2, 1 / 6)]
    assert_allclose(answer.stiffness[flat / 2], flat / 3 / (gaps[1] - gaps[0]), rtol=2e-3)


def test_a_case_gives_files_and_a_section_of_the_report(tmp_path):
    results = fs.run(design_case(face=GROOVED), workers=1)
    limit = float(np.exp(np.mean(np.log(results.leakage.values[:2])))) * 1e9
    wanted = [f"{limit:.6g} mg/(m·s)", "L0.01"]  # of water
    given = {"classes": wanted, "workers": 1, "assembly": ["100 MPa"]}
    answer = fs.design(design_case(face=GROOVED), tmp_path, **given)
    assert answer.seals.steps.unload_from == (1e8, 4e8)
    need = answer.requirements[0]
    assert 2e7 < need.assembly.computed < 1e8 * 1.0001
    assert need.assembly.low <= need.assembly.computed <= need.assembly.value
    found = {s.quantity: s.leakage for s in answer.sensitivities}
    assert np.isfinite([*found.values()]).all()
    assert 0.05 < found["hardness"] < 5  # a harder seal keeps wider gaps
    homogeneous = ("hardness", "contact modulus", "nominal pressure")
    assert_allclose(sum(found[name] for name in homogeneous), 0, atol=1e-12)
    with (tmp_path / "design.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert_allclose(float(rows[0]["computed"]), need.assembly.computed)
    assert next(row["relation"] for row in rows if row["class"] == "L0.01") == ">"
    assert json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))["probability"] == 0.95
    assert (tmp_path / "design.png").read_bytes().startswith(b"\x89PNG")
    assert "What the seal needs" in (tmp_path / "report.html").read_text(encoding="utf-8")
    reused = fs.design(tmp_path, classes=wanted)
    assert reused.requirements == answer.requirements
    hardness = next(s for s in reused.sensitivities if s.quantity == "hardness")
    assert "takes a solution" in hardness.how


def test_sensitivities_are_known_if_the_class_is_met_because_no_path_is_open():
    """They hold at the highest load with a leakage above 0, and the answer says so."""
    loads = {"loading": ["20 MPa", "100 MPa", "2.7 GPa"]}
    closing = design_case(
        face=GROOVED, load=loads, output={"budget": False}, method="deterministic"
    )
    results = fs.run(closing, workers=1)
    first, second, last = results.leakage.values
    assert first > second > last == 0
    limit = f"{1e9 * second / 2:.6g} µL/(m·s)"
    answer = fs.design(closing, classes=[limit, "1 L/(m·s)"], workers=1)
    assert answer.requirements[0].assembly.at == pytest.approx(2.7e9)
    assert answer.at == ("", pytest.approx(1e8))
    slopes = {s.quantity: s for s in answer.sensitivities}
    for name in ("nominal pressure", "hardness", "roughness amplitude", "contact modulus"):
        assert np.isfinite(slopes[name].leakage)
    assert np.isfinite([s.pressure for s in answer.sensitivities[1:]]).all()
    (note,) = [note for note in answer.notes if "sensitivities hold at" in note]
    assert note.startswith("the sensitivities hold at 100 MPa, the highest load")
    assert "at 2.7 GPa, which" in note


def test_the_command_says_what_the_seal_needs(tmp_path, femseal):
    output = {"paraview": "none", "fields_limit": "0 byte", "classes": ["L1"]}
    output["picture_formats"] = ["pdf"]
    fs.run(design_case(output=output), tmp_path, workers=1)
    code, told, _ = femseal("design", tmp_path, "--probability", "0.5")
    assert code == 0
    assert "QSmin(L), Q_A = 400 MPa" in told
    assert (tmp_path / "design.json").is_file()
    assert (tmp_path / "design.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / "design.png").is_file()  # the report shows it
    for more, fault in (
        (["--class", "L7"], "classes: given 'L7'"),
        (["--class", "ISO 5208 B"], "nominal_diameter: given none"),
        (["--class", "TA Luft"], "defined for helium"),
        (["--probability", "1.5"], "probability: given 1.5"),
        (["--assembly", "50 MPa"], "assembly: given 50 MPa, expected those that the run is"),
    ):
        code, _, told = femseal("design", tmp_path, *more)
        assert (code, told.count("\n")) == (2, 1)
        assert fault in told


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"assembly": ["1 MPa"]}, "assembly: given 1 MPa"),
        ({"assembly": ["5 GPa"]}, "assembly: given 5 GPa"),
        ({"classes": ["TA Luft"]}, "defined for helium"),
    ],
)
def test_arguments_are_checked_before_anything_is_solved(tmp_path, given, said):
    with pytest.raises(InputError, match=said):
        fs.design(design_case(), tmp_path / "none", **given)
    assert not (tmp_path / "none").exists()


def test_classes_of_the_test_fluid_decide():
    helium = {"name": "helium", "slip": False, "inlet_pressure": "40 bar"}
    results = fs.run(design_case(output={"test_fluid": helium}), workers=1)
    answer = fs.design(results, classes=["TA Luft"])
    assert_allclose(answer.seals.leakage, results.dataset["test_leakage_realisations"])
    gas = fs.IdealGas(19.6e-6, 4.0026e-3, 293.15)
    assert_allclose(answer.requirements[0].limit, 1e-8 / gas.reference_density)
    inlet = next(s.leakage for s in answer.sensitivities if s.quantity == "inlet pressure")
    assert_allclose(inlet, 2 * 40e5**2 / (40e5**2 - 101_325**2), rtol=1e-4)
    # its band is as wide as that of the fluid
    ratio = results.budget.upper / results.leakage.values
    assert_allclose(results.class_interval[1], ratio * results.dataset["test_leakage"].values)


def test_a_load_in_assembly_is_a_force_if_the_case_gives_forces():
    """The same run by pressures and by forces on its area needs the same pressures."""
    from femseal.designs.answer import _as_pressures, _loads_in_assembly, _with_assembly_loads

    plain = design_case(output={"budget": False})
    results = fs.run(plain, workers=1)
    breadth, length = results.dataset.attrs["seal_size_m"]
    area = breadth * length
    loading = [f"{p * area!r} N" for p in results.steps.loading]
    peaks = [f"{p * area!r} N" for p in results.steps.unload_from]
    unloading = [f"{p * area!r} N" for p in results.steps.unloading]
    load = {"loading": loading, "unload_from": peaks, "unloading": unloading}
    by_force = design_case(output={"budget": False}, load=load)
    peak = results.steps.unload_from[0]
    loads = _loads_in_assembly(by_force, None, [f"{peak * area!r} N"])
    assert_allclose(loads, peak * area)
    assert _with_assembly_loads(by_force, loads).load.unit == "N"
    with pytest.raises(InputError, match="forces above the lowest"):
        _with_assembly_loads(by_force, [0.0])
    with pytest.raises(InputError, match="assembly"):
        _loads_in_assembly(by_force, None, ["100 MPa"])
    forces = fs.run(by_force, workers=1)
    assert_allclose(_as_pressures(forces, loads), peak, rtol=1e-9)
    assert fs.design(forces, classes=["L1"], assembly=[f"{peak * area!r} N"]).requirements
