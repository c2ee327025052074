"""The verdict on a leakage class: one answer in report, tables, design and terminal, with test fluids and failed loads."""

import json
import re
import tomllib
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import TABLES, steel_scene

import femseal as fs
from femseal.budget import ErrorBudget, ErrorPart
from femseal.designs.data_sheet import sheet_tables
from femseal.report import report_tables
from femseal.report.page import report_html
from femseal.report.report_tables import class_table, key_numbers
from femseal.results import RunFacts, assemble
from femseal.results.measures import best_narrowing, lowering
from femseal.results.verdict_text import verdict_sentences
from femseal.studies import FluidState, OtherLeakage

HELIUM = fs.IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15, slip=False)
STATE = FluidState(HELIUM, 1e5, 0.0)
CASE = f"""
method = "stochastic"
seed = 2
[face]
kind = "self-affine"
points = [32, 64]
size = ["30 um", "60 um"]
rms_slope = 0.2
roll_off = "20 um"
{TABLES}[cells]
count = [2, 4]
[stochastic]
length = "120 um"
realisations = 4
[output]
paraview = "none"
fields = false
"""


@pytest.fixture(scope="module")
def study():
    """A face that is loaded to 400 MPa and back, whose leakages the tests replace."""
    face = fs.self_affine((48, 48), (6e-5, 6e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    loads = {"loading": (5e7, 1e8, 2e8, 4e8), "unload_from": (4e8,), "unloading": (2e8, 1e8)}
    scene = steel_scene(face, **loads)
    return scene, fs.deterministic(scene)


#: Leakages [m²/s] on loading to 400 MPa and back, and the ends of their interval over them.
LEAKAGE = np.array([1e-6, 1e-7, 1e-8, 1e-9, 2e-9, 4e-9])
FACTOR = 5.0


def results_of(study, leakage=LEAKAGE, test=None, factor=FACTOR, source="patch", **facts):
    scene, found = study
    leakage = np.asarray(leakage, float)
    part = ErrorPart(source, leakage / factor, leakage * factor, "by hand")
    budget = ErrorBudget("deterministic", leakage, (part,), scene.steps)
    other = None if test is None else OtherLeakage(STATE, np.asarray(test, float))
    facts = RunFacts(budgets={"deterministic": budget}, test=other, **facts)
    return assemble(scene, replace(found, leakage=leakage), facts=facts)


def number_of(text):
    """The number that a text means, also one with a power of ten such as 7.3·10⁻⁷."""
    digits = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
    plain = text.replace("·", "").replace("10", "e", 1) if set(text) & set("⁰⁴⁵⁶⁷⁸⁹⁻") else text
    mantissa, _, power = plain.partition("e")
    return float(mantissa or 1) * 10.0 ** int(power.translate(digits) or 0)


def limit_of(results, leakage):
    """A limit of the user's own, in mg/(m·s) of the fluid that decides."""
    return f"{leakage * results.class_basis.density * 1e6:.6g} mg/(m·s)"


def test_loads_are_those_of_leakage_and_upper_end(study):
    """Straight in ln(leakage) over ln(pressure): between 50 and 100 MPa as p to the power of −3.32."""
    scene, found = study
    asked = limit_of(assemble(scene, found), 3e-7)
    results = results_of(study, classes=[asked])
    (verdict,) = results.verdicts
    slope = np.log(0.1) / np.log(2)
    exact = 5e7 * np.array([0.3, 0.3 / FACTOR]) ** (1 / slope)
    assert_allclose([verdict.assembly.computed, verdict.assembly.value], exact, rtol=1e-6)
    assert verdict.met_as_computed
    assert verdict.met_with_interval
    assert verdict.assembly_load == 4e8
    assert verdict.service[4e8].value == 0
    assert verdict.widest_source == "patch"
    assert "larger measured area" in verdict.narrowed_by
    generated = results_of(study, classes=[asked], case={"face": {"kind": "turned"}})
    assert generated.verdicts[0].narrowed_by == "a larger generated surface"


def test_an_unknown_leakage_at_the_first_load_is_no_start_of_a_change(study):
    unknown = [np.nan, *LEAKAGE[1:]]
    text = " ".join(results_of(study, leakage=unknown).verdict_lines)
    assert "On loading at 50 MPa, the leakage is unknown" in text
    assert "changes from" not in text
    assert "On loading it changes from" in " ".join(results_of(study).verdict_lines)


@pytest.mark.parametrize("given", ["hardness", "yield_stress"])
def test_the_measure_against_the_error_of_the_plastic_law_is_a_key_that_the_case_accepts(
    study, given
):
    case = tomllib.loads(CASE) | {"material": {"young": "210 GPa", given: "1 GPa"}}
    results = results_of(study, source="plastic law", case=case)
    measure = best_narrowing(results, 3).action
    assert ("hardness_over_yield" in measure) == (given == "yield_stress")
    # certain, or out of reach: nothing is to be narrowed
    for value in (1e-5, 1e-12):
        far = results_of(study, classes=[limit_of(results, value)])
        assert far.verdicts[0].widest_source == ""


def test_report_table_design_and_terminal_say_the_same(tmp_path, femseal):
    path, folder = tmp_path / "case.toml", tmp_path / "results"
    path.write_text(f'{CASE}classes = ["500 mg/(m·s)"]\n')
    code, printed, _ = femseal("run", path, "-o", folder, "--workers", "1")
    assert code == 0
    results = fs.open_results(folder)
    assert "as computed" in results.verdict_lines[0]
    assert "with the whole 95 % interval" in results.verdict_lines[0]
    text = " ".join(results.verdict_lines)

    def flat(words):
        return " ".join(words.split())

    assert flat(printed).endswith(flat(f"{text} results in {folder}"))
    page = unescape((folder / "report.html").read_text(encoding="utf-8"))
    page = re.sub("<[^>]+>", " ", page)
    squeezed = re.sub(r"\s", "", page)
    assert squeezed.index(re.sub(r"\s", "", text)) < squeezed.index("wholeseal,loading")
    _, told, _ = femseal("design", folder)
    assert flat(told).startswith(flat(text))
    # a design without an output writes nothing
    before = {file: file.stat().st_mtime_ns for file in folder.rglob("*")}
    for given in (results, folder):
        fs.design(given, classes=["L1"])
    assert {file: file.stat().st_mtime_ns for file in folder.rglob("*")} == before
    # the cells of both tables too
    answer = fs.design(results)
    (report,), (design,) = class_table(results).lines, sheet_tables(answer)[0].lines
    assert report == design[: len(report)]
    need = answer.requirements[0]
    assert (need.assembly, need.service) == (
        results.verdicts[0].assembly,
        results.verdicts[0].service,
    )


def test_a_failed_load_never_counts_as_met(study):
    """Also one at which only the fluid in service failed; loads beside it have the same verdict as before."""
    asked = ["1 kg/(m·s)"]
    failed = LEAKAGE.copy()
    failed[5] = np.nan
    for leakage, test in ((failed, None), (LEAKAGE, failed), (failed, LEAKAGE)):
        results = results_of(study, leakage, test, classes=asked)
        assert results.classes == ["1 kg/(m·s)"] * 5 + ["failed"]
        assert results.dataset["class_met"].values[0].tolist() == [1, 1, 1, 1, 1, 0]
        (verdict,) = results.verdicts
        assert verdict.met_with_interval
        assert verdict.assembly.value == 0
        assert verdict.service[4e8].value == verdict.service[4e8].computed == 2e8
        assert verdict.failed == ("unloading 100 MPa from 400 MPa",)
        text = " ".join(verdict_sentences(verdict, lambda p: f"{p / 1e6:g} MPa"))
        assert "The solution failed at unloading 100 MPa from 400 MPa" in text
    at_top = LEAKAGE.copy()
    at_top[3] = np.nan
    (verdict,) = results_of(study, at_top, classes=asked).verdicts
    assert verdict.answer == "not met, as the solution failed"


def test_with_a_test_fluid_the_first_screen_shows_the_test(study):
    """Its tiles have one unit for value and interval, and neither a unit of nothing nor a ratio of two sealed ones."""
    test = 3 * LEAKAGE
    test[3] = 0.0
    own = np.where(test == 0, 0.0, LEAKAGE)
    case = {"output": {"test_fluid": {"name": "helium"}}}
    results = results_of(study, own, test, classes=["1e-3 mbar·L/s"], case=case)
    tiles = key_numbers(results)
    assert [label for label, *_ in tiles] == [
        f"test with helium, {name}"
        for name in ("loading 400 MPa", "loading 50 MPa", "unloading 100 MPa from 400 MPa")
    ]
    assert tiles[0][1] == "sealed"
    units = {re.sub(r"[\d.·⁰-⁹⁻¹²³]+ ", "", value) for _, value, _ in tiles[1:]}
    assert len(units) == 1
    (unit,) = units
    amounts = [number_of(value.removesuffix(f" {unit}")) for _, value, _ in tiles[1:]]
    per_length = results.class_basis.factor(fs.base.leak_units.LEAK_UNITS[unit])
    assert_allclose(amounts, test[[0, 5]] / per_length, rtol=5e-3)
    for (_, _, interval), q in zip(tiles[1:], test[[0, 5]], strict=True):
        low, high, name = re.fullmatch(r"95 % interval (.+)–(.+) ([^ ]+)", interval).groups()
        assert name == unit
        ends = np.array([1 / FACTOR, FACTOR]) * q / per_length
        assert_allclose([number_of(low), number_of(high)], ends, rtol=5e-2)
    found = report_tables.test_fluid(results)
    assert found["leakage"] == "sealed"
    both_gases = found["ratio"] * 3
    assert_allclose(
        both_gases, report_tables.test_fluid(results_of(study, own, own, case=case))["ratio"]
    )
    nothing = results_of(study, 0 * own, 0 * own, case=case)
    assert report_tables.test_fluid(nothing)["ratio"] == 0
    page = report_html(results)
    assert page.index("test with helium, loading 400 MPa") < page.index("Maps of the seal")
    for words in ("sealed mbar", "sealed mL", "nan times", "inf times"):
        assert words not in page
        assert words not in report_html(nothing)


def test_no_interval_is_said_as_such(study):
    scene, found = study
    results = assemble(scene, found, facts=RunFacts(classes=["1 kg/(m·s)"]))
    (verdict,) = results.verdicts
    assert verdict.met_with_interval is None
    text = " ".join(results.verdict_lines)
    assert "no error budget" in text
    assert "whole 95" not in text
    assert class_table(results).heads == (
        "class",
        "met, as computed",
        "kept after 400 MPa, as computed",
    )
    assert assemble(scene, found).verdicts == ()


def test_many_classes_are_told_in_a_sentence_each(study):
    results = results_of(study, classes=["ISO 5208"], nominal_diameter=0.05)
    texts = results.verdict_lines[: len(results.verdicts)]
    assert len(texts) == len(class_table(results).lines) > 2
    assert all(text.count(".") <= 3 and "On loading" not in text for text in texts)


def test_narrowing_follows_from_the_error_budget(study):
    """Twice the points divide the distance of second order by four; independent parts of a patch by the root of the area."""
    q, step = LEAKAGE[3], 3
    for source, power in (("pixels", 1 / 4), ("patch", 1 / 2), ("hardness", 1 / 2)):
        narrowing = best_narrowing(results_of(study, source=source), step)
        assert narrowing.source == source
        assert not narrowing.is_best_case
        assert_allclose([narrowing.lower, narrowing.upper], q * FACTOR ** np.array([-power, power]))
    best = best_narrowing(results_of(study, source="thin gap"), step)
    assert best.is_best_case
    assert_allclose([best.lower, best.upper], q)
    # the interval of a test fluid is that of the fluid in service, in the ratio of both
    tested = best_narrowing(results_of(study, test=3 * LEAKAGE, source="pixels"), step)
    assert_allclose(tested.upper, 3 * q * FACTOR**0.25)
    sealed = np.where(LEAKAGE < 3e-9, 0.0, LEAKAGE)
    assert best_narrowing(results_of(study, sealed), step) is None


def test_effects_of_load_and_finish_are_those_of_solving_again():
    """The scaling law gives the effect of the heights from those of load and hardness; a solution of lower heights does too."""
    face = fs.self_affine((64, 64), (6e-5, 6e-5), hurst=0.8, rms_slope=0.2, cut_off=8e-6, rng=1)
    loads = {"loading": (1.8e8, 2e8, 2.2e8)}
    scene = steel_scene(face, **loads)

    def leakage(changed):
        return fs.deterministic(changed).leakage

    q = leakage(scene)
    harder = leakage(replace(scene, hardness=scene.law.times(1.1)))
    part = ErrorPart("hardness", q**2 / harder, harder, "by hand")
    budget = ErrorBudget("deterministic", q, (part,), scene.steps)
    results = assemble(
        scene, fs.deterministic(scene), facts=RunFacts(budgets={"deterministic": budget})
    )
    effect = lowering(results, q, 1)
    assert np.log(effect.by_load) == pytest.approx(np.log(q[2] / q[1]), rel=0.2)
    lower = steel_scene(fs.Topography(0.8 * face.heights, face.spacing, face.periodic), **loads)
    assert np.log(effect.by_finish) == pytest.approx(np.log(leakage(lower)[1] / q[1]), rel=0.15)
    assert np.isnan(lowering(results, q, 0).by_load)


def test_without_a_class_leakage_and_cycle_are_said_in_usual_units(study):
    """At the assembly load first; 1 mL/min is 20 drops a minute, and no number needs a power of ten."""
    scene, found = study
    per_length = assemble(scene, found).class_basis.factor(fs.base.leak_units.LEAK_UNITS["mL/min"])
    results = results_of(study, per_length * np.array([3000.0, 40.0, 6.0, 0.1, 0.5, 0.002]))
    first = results.verdict_lines[0]
    assert "at the assembly load of 400 MPa: 2 drops/min (95 % interval 0.4–10 drops/min)" in first
    assert "from 3 L/min at 50 MPa to 2 drops/min at 400 MPa" in first
    assert "Unloaded from there to 100 MPa it is 2.4 drops/h" in first
    assert "leakage class" in results.verdict_lines[-1]
    assert not re.search("·10", " ".join(results.verdict_lines))


def test_with_a_test_fluid_the_test_is_said_first(study):
    case = {"output": {"test_fluid": {"name": "helium"}}, "fluid": {"name": "water"}}
    case["stochastic"] = {"length": 0.1}
    lines = results_of(study, LEAKAGE, 3 * LEAKAGE, case=case).verdict_lines
    assert lines[0].startswith(
        "Leakage of the whole seal in the test with helium from 100 kPa to 0 Pa"
    )
    assert "mbar·L/s" in lines[0]
    assert re.match(
        r"In service with water, the leakage of the whole seal .*\(95 % interval", lines[1]
    )
    # without a length in the case, the seal is only as long as the surface
    del case["stochastic"]
    first, service = results_of(study, LEAKAGE, 3 * LEAKAGE, case=case).verdict_lines[:2]
    for line in (first, service):
        assert "of seal, as long as the surface, because the case states no length" in line


def test_reached_accuracy_is_said(study):
    attempts = {
        "wanted": 0.1,
        "reached": False,
        "half_width": np.log(1.2),
        "with_model": np.log(1.5),
        "model_parts": ["hardness"],
    }
    lines = results_of(study, attributes={"accuracy": json.dumps(attempts)}).verdict_lines
    assert (
        "The accuracy of 10 % is not reached: the numerical error is 20 %, and with the model and its input "
        "it is 50 %."
    ) in lines


def test_the_verdict_says_what_remains_after_relaxation(study):
    """At 400 MPa 10⁻⁹ m²/s leak, and 2·10⁻⁹ m²/s at 200 MPa, after half of the load was lost."""
    case = {"load": {"relaxation": 0.5}}
    tight, loose = (limit_of(results_of(study, factor=1.01), value) for value in (1.5e-9, 3e-9))
    (text,) = results_of(study, factor=1.01, classes=[tight], case=case).verdict_lines[:1]
    lost = "If 50 % of the assembly load is lost before service, it is still met after an assembly "
    assert f"{lost}at no load up to 400 MPa" in text
    (text,) = results_of(study, factor=1.01, classes=[loose], case=case).verdict_lines[:1]
    assert f"{lost}at every load from 400 MPa on" in text
    assert "is lost before" not in results_of(study, classes=[loose]).verdict_lines[0]


def test_an_action_that_hardly_narrows_the_interval_is_said_to_do_so(study):
    """Of six independent errors of about the same size, only one becomes smaller."""
    scene, found = study

    def text_of(others):
        names = ["patch", *others]
        factors = [FACTOR, *(0.99 * FACTOR for _ in others)]
        parts = tuple(
            ErrorPart(name, LEAKAGE / factor, LEAKAGE * factor, "by hand")
            for name, factor in zip(names, factors, strict=True)
        )
        budget = ErrorBudget("deterministic", LEAKAGE, parts, scene.steps)
        facts = RunFacts(budgets={"deterministic": budget})
        return " ".join(assemble(scene, replace(found, leakage=LEAKAGE), facts=facts).verdict_lines)

    assert "would narrow the interval from" in text_of([])
    crowded = text_of(["pixels", "waves", "hardness", "correction", "reference"])
    assert "would narrow the interval only slightly, from" in crowded
