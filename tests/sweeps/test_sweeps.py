"""Sweeps over keys of a case, and finished runs side by side."""

import csv
import io
import re
from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import SWEPT as CASE

import femseal as fs
from femseal.budget import ErrorBudget, ErrorPart
from femseal.case.reading import read_case
from femseal.results.run_comparison import compared
from femseal.results.variables import add_budgets
from femseal.runs import job
from femseal.store.store import Store
from femseal.sweeps.sweeping import parsed_keys, variations

KEYS = {"material.hardness": ["3 GPa", "6 GPa"], "fluid.viscosity": ["1 mPa*s", "2 mPa*s"]}


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Folder and comparison of a sweep over two keys."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "small.toml").write_text(CASE)
    return folder / "out", fs.sweep(folder / "small.toml", KEYS, folder / "out", workers=1)


# --- the cases of a sweep ---------------------------------------------------------------------------------


def test_values_are_those_of_toml_or_text():
    found = parsed_keys(
        ["a.b=3GPa, 4 GPa", 'c="x,y",[1,2],["u", "v,w"]', "d=1,2.5,true", "e=two-scale"]
    )
    assert found == {
        "a.b": ["3GPa", "4 GPa"],
        "c": ["x,y", [1, 2], ["u", "v,w"]],
        "d": [1, 2.5, True],
        "e": ["two-scale"],
    }


def test_every_combination_is_a_case_with_its_own_name(case):
    data, folder = read_case(case)
    found = variations(data, folder, KEYS | {"cells.count": [[2, 4], [4, 8]]})
    assert len(found) == 8
    assert len({v.name for v in found}) == 8
    assert all(v.name.isascii() and not set(v.name) & set('/\\ *:"?') for v in found)
    assert found[0].name == "hardness=3GPa_viscosity=1mPa-s_count=-2-4"
    assert found[3].values == ("3 GPa", "2 mPa*s", "[4, 8]")
    assert [v.case.law.hardness for v in found] == [3e9] * 4 + [6e9] * 4
    assert found[-1].case.cells.count == (4, 8)
    assert data["material"]["hardness"] == "3 GPa"  # the tables of the case stay


def test_a_key_of_one_of_two_faces(case):
    data, folder = read_case(case)
    data["face"] = [data["face"], dict(data["face"])]
    second = variations(data, folder, {"face.1.rms_slope": [0.1, 0.3]})
    assert [[face.rms_slope for face in v.case.face] for v in second] == [[0.2, 0.1], [0.2, 0.3]]
    with pytest.raises(
        fs.InputError,
        match=r"face\.2\.hurst: given '2', expected the number of one of the 2 tables",
    ):
        variations(data, folder, {"face.2.hurst": [0.5]})


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["material.hardnes=1GPa"], "material.hardnes: given an unknown key"),
        (["material.hardness=3"], "material.hardness: given 3, expected text with a number"),
        (["seed"], "sweep: given 'seed', expected a key of the case and its values"),
        (["seed=1,2", "seed=3"], "sweep: given the key seed twice"),
        (["seed=1,1"], "expected values that differ"),
        (["seed.x=1"], "sweep: given 'seed.x', expected a dotted key of the case"),
        (
            ['load.loading=["2MPa","1MPa"]'],
            "load.loading: given 2 MPa, 1 MPa, expected rising pressures",
        ),
        (["cells.count=[2,4],[32,64]"], r"with count = [32, 64]"),
        (
            [
                f"{key}={','.join(map(str, range(2, 42)))}"
                for key in ("seed", "stochastic.realisations")
            ],
            "given 1600 cases, expected at most 1000",
        ),
    ],
)
def test_bad_input_is_found_before_any_work(femseal, case, contacts, arguments, fault):
    output = case.parent / "out"
    code, _, errors = femseal("sweep", case, *arguments, "-o", output, "--workers", 1)
    assert code == 2
    assert fault in errors
    assert "Traceback" not in errors
    assert not output.exists()
    assert not contacts


def test_an_unfinished_case_is_found_before_any_work(case, tmp_path, contacts):
    last = tmp_path / "out" / "seed=2" / ".checkpoint"
    last.mkdir(parents=True)
    (last / "0.results").write_bytes(b"")
    with pytest.raises(fs.InputError, match="unfinished run"):
        fs.sweep(case, {"seed": [1, 2]}, tmp_path / "out", workers=1)
    assert not contacts


# --- runs of a sweep --------------------------------------------------------------------------------------


def test_every_case_is_what_a_run_of_its_own_gives(swept, tmp_path):
    folder, found = swept
    for hardness, viscosity in (("3 GPa", "1 mPa*s"), ("6 GPa", "2 mPa*s")):
        text = CASE.replace('"3 GPa"', f'"{hardness}"').replace('"1 mPa*s"', f'"{viscosity}"')
        (tmp_path / "own.toml").write_text(text)
        own = fs.run(tmp_path / "own.toml", workers=1)
        run = found.runs[found.settings.index((hardness, viscosity))]
        for name in own.dataset.data_vars:
            assert_array_equal(run.dataset[name].values, own.dataset[name].values, err_msg=name)
        assert fs.open_results(folder / found.names[found.runs.index(run)]).case == own.case


def test_cases_share_what_their_keys_do_not_change(case, tmp_path, contacts):
    def solved(function, *arguments):
        """What a function gives, and how many contacts it solves."""
        contacts.clear()
        return function(*arguments, workers=1), len(contacts)

    _, alone = solved(fs.run, case)
    fluids = {"fluid.viscosity": ["1 mPa*s", "4 mPa*s"]}
    found, both = solved(fs.sweep, case, fluids, tmp_path / "fluids")
    assert both == alone
    assert_allclose(found.leakage(0), 4 * found.leakage(1), rtol=1e-9)
    case.write_text(CASE + '[contact]\nfluid_pressure = "ignored"\n')
    _, alone = solved(fs.run, case)
    # the highest load is peak in one only, so that it leaves its deformation behind
    more = {"load.loading": [["50 MPa", "300 MPa"], ["50 MPa", "100 MPa", "300 MPa"]]}
    assert solved(fs.sweep, case, more, tmp_path / "loads")[1] == alone + 1
    assert not list(tmp_path.glob("*/.shared"))


def test_a_sweep_goes_on_and_takes_more_values(swept, contacts):
    folder, found = swept
    again = fs.sweep(folder.parent / "small.toml", KEYS, folder, resume=True, workers=1)
    assert not contacts
    assert again.names == found.names
    for one, other in zip(again.runs, found.runs, strict=True):
        assert_array_equal(one.leakage, other.leakage)


class Killed(Exception):
    """Stands for the end of the process."""


def test_a_sweep_that_was_killed_solves_each_contact_once(tmp_path, contacts, monkeypatch):
    (case := tmp_path / "small.toml").write_text(CASE + "pictures = false\nreport = false\n")
    keys, out = {"material.hardness": ["3 GPa", "6 GPa"]}, tmp_path / "out"
    whole = fs.sweep(case, keys, tmp_path / "whole", workers=1)
    solved_once = len(contacts)
    contacts.clear()

    def kill(stage, done, total):
        if stage == "stochastic: contact of the whole face" and done == 1:
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(Store, "__exit__", lambda *a: None)  # as a kill leaves it
        with pytest.raises(Killed):
            fs.sweep(case, keys, out, progress=kill, workers=1)
    again = fs.sweep(case, keys, out, resume=True, workers=1)
    assert len(contacts) == solved_once
    for expected, run in zip(whole.runs, again.runs, strict=True):
        assert_array_equal(run.leakage, expected.leakage)
    assert (out / "sweep.csv").read_bytes() == (tmp_path / "whole/sweep.csv").read_bytes()
    assert not list(out.rglob(".*"))


def test_cases_that_fail_do_not_stop_the_others(case, tmp_path, monkeypatch):
    run = job.run

    def failing(case, *arguments, **options):
        if case.seed == 2:
            raise fs.NotConverged("contact: residual 0.1")
        return run(case, *arguments, **options)

    monkeypatch.setattr(job, "run", failing)
    said = r"1 of 3 cases failed.*\n.*seed=2: contact: residual 0.1"
    with pytest.raises(fs.FemsealError, match=said):
        fs.sweep(case, {"seed": [1, 2, 3]}, tmp_path / "out", workers=1)
    assert {line["seed"] for line in lines_of(tmp_path / "out" / "sweep.csv")} == {"1", "3"}


def lines_of(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


# --- side by side -----------------------------------------------------------------------------------------


def test_table_of_a_sweep(swept):
    folder, found = swept
    lines = lines_of(folder / "sweep.csv")
    assert len(lines) == 4 * 3
    assert [line["hardness"] for line in lines[::3]] == ["3 GPa", "3 GPa", "6 GPa", "6 GPa"]
    for n, run in enumerate(found.runs):
        own = lines[3 * n : 3 * n + 3]
        assert_allclose([float(line["leakage_m2_per_s"]) for line in own], run.leakage.values)
        assert [float(line["nominal_pressure_Pa"]) for line in own] == [5e7, 3e8, 1e8]
    heads, cells = list(found.table().heads), found.table().lines
    assert heads[:-1] == ["hardness", "viscosity", "50 MPa", "300 MPa", "100 MPa from 300 MPa"]
    assert heads[-1] == "rank at 300 MPa"
    # twice the viscosity, half the leakage
    assert float(cells[0][2]) == pytest.approx(2 * float(cells[1][2]), rel=0.01)


def test_dataset_of_a_sweep(swept, tmp_path):
    """One dimension for each key; numbers are numbers, and runs of no sweep lie along `run`."""
    _, comparison = swept
    data = comparison.dataset()
    names = [comparison.runs[0].leakage.name, "contact_fraction"]
    for run, (hardness, viscosity) in zip(comparison.runs, comparison.settings, strict=True):
        part = data.sel(hardness=hardness, viscosity=viscosity)
        for name in names:
            assert_allclose(part[name].values, run.dataset[name].values)
    assert data["contact_fraction"].attrs == comparison.runs[0].dataset["contact_fraction"].attrs
    assert data["nominal_pressure"].values.tolist() == [5e7, 3e8, 1e8]
    two = fs.compare({"a": comparison.runs[0], "b": comparison.runs[3]}).dataset()
    assert two["run"].values.tolist() == ["a", "b"]
    assert_allclose(two[names[0]].sel(run="b").values, comparison.runs[3].leakage.values)
    numbers = replace(
        comparison, keys=("seed",), settings=tuple((str(n),) for n in range(1, 5))
    ).dataset()
    assert numbers["seed"].values.tolist() == [1, 2, 3, 4]
    assert_allclose(numbers[names[0]].sel(seed=2).values, comparison.runs[1].leakage.values)


def test_picture_of_a_sweep(swept):
    folder, found = swept
    assert matplotlib.image.imread(folder / "sweep.png").shape[1] > 1000
    left, right = found.plot().axes
    lines = [line.get_ydata() for line in left.lines if len(line.get_xdata()) > 1]
    assert_allclose(lines[::2], [found.leakage(n)[:2] for n in range(4)])
    assert_allclose(right.lines[0].get_xdata(), [3, 6])
    assert_allclose(right.lines[0].get_ydata(), [found.leakage(n)[1] for n in (0, 2)])


@pytest.mark.parametrize("count", [2, 4])
def test_intervals_are_drawn_and_told_where_they_are_known(swept, count):
    """The legend says of nothing that is not there; shaded areas and bars end where the intervals do."""
    _, found = swept
    bare = fs.compare(dict(zip(found.names, found.runs, strict=True)))
    assert bare.interval(0) is None
    (panel,) = bare.plot().axes
    assert legend_title(panel) == "dashed: unloading"
    known = [with_budget(run) for run in found.runs[:count]]
    both = compared(found.names[:count], known, keys=found.keys, settings=found.settings[:count])
    for n, run in enumerate(known):
        assert_allclose(both.interval(n), np.outer([0.5, 3], both.leakage(n)))
        assert_allclose(both.rows()[3 * n]["interval_upper_m2_per_s"], 3 * run.leakage.values[0])
    assert re.fullmatch(r"[\d.]+ \([\d.]+–[\d.]+\)", both.table().lines[0][2])
    panel, key_panel = both.plot().axes
    words = "shaded" if count <= 3 else "bars"
    assert legend_title(panel) == f"dashed: unloading; {words}: 95 % interval on loading"
    assert "95 % interval" in key_panel.get_title()
    ends = [
        np.sort(segment[:, 1])
        for lines in key_panel.collections
        for segment in lines.get_segments()
    ]
    expected = [np.outer([0.5, 3], both.leakage(n)[1:2]).ravel() for n in range(count)]
    assert_allclose(sorted(map(tuple, ends)), sorted(map(tuple, expected)))
    shown = [c for c in panel.collections if hasattr(c, "get_segments") == (words == "bars")]
    assert len(shown) == count


def legend_title(axes):
    (legend,) = axes.figure.legends
    return legend.get_title().get_text()


def with_budget(results):
    """The results with an interval from half of the leakage to three times as much."""
    leakage = results.leakage.values
    part = ErrorPart("patch", leakage / 2, 3 * leakage, "by hand")
    data = results.dataset.copy()
    add_budgets(data, {"stochastic": ErrorBudget("stochastic", leakage, (part,), results.steps)})
    return replace(results, dataset=data)


def test_runs_of_other_loads_methods_and_lengths(case, swept, tmp_path):
    folder, found = swept
    text = CASE.replace("50 MPa", "40 MPa").replace('"stochastic"', '"deterministic"')
    (tmp_path / "other.toml").write_text(text)
    fs.run(tmp_path / "other.toml", tmp_path / "other", workers=1)
    folders = {"drawn": folder / found.names[0], "whole": tmp_path / "other"}
    both = fs.compare(folders, unit="mL/min")
    common = ["loading 300 MPa", "unloading 100 MPa from 300 MPa"]
    assert [step.name for step in both.common_steps] == common
    assert [line[:2] for line in both.table().lines] == [
        ("drawn", "median"),
        ("whole", "deterministic"),
    ]
    for n, run in enumerate(both.runs):  # of the whole seal, each of its own length
        assert_allclose(both.leakage(n), run.leakage_in("mL/min").values)
    assert both.band(1) is None
    rows = both.rows()
    assert len(rows) == 6
    assert np.isnan(rows[-1]["leakage_lower_m2_per_s"])


def test_compare_on_the_command_line(femseal, swept, tmp_path):
    folder, found = swept
    runs = [folder / name for name in found.names[:3]]
    code, text, _ = femseal("compare", *runs, "-o", tmp_path / "out", "--unit", "mL/h")
    assert code == 0
    assert "leakage of the whole seal [mL/h]" in text
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"comparison.csv", "comparison.png"}
    vectors = femseal("compare", *runs, "-o", tmp_path / "print", "--format", "svg,pdf")
    assert "comparison.svg and comparison.pdf" in vectors[1]
    names = {p.name for p in (tmp_path / "print").iterdir()}
    assert names == {"comparison.csv", "comparison.svg", "comparison.pdf"}
    for wrong, fault in (
        ([runs[0]], "given 1 run, expected two or more"),
        ([runs[0], tmp_path / "none"], "no such folder"),
        ([*runs, "--unit", "miles"], "leakage_unit: given 'miles'"),
        ([*runs, "--unit", "mbar*L/s"], "for a liquid"),
    ):
        code, _, errors = femseal("compare", *wrong)
        assert (code, fault in errors) == (2, True), errors
    with pytest.raises(fs.InputError, match="a different name for each run"):
        fs.compare([found.runs[0], found.runs[0]])  # of one run twice the names are the same
