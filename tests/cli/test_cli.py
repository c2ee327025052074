"""The command line: what it prints, how it ends, what it loads."""

import inspect
import json
import operator
import os
import re
import subprocess
import sys
import tomllib
from contextlib import nullcontext
from math import inf
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from small_cases import template_cases

import femseal as fs
from femseal import cli
from femseal.case import case_schema, parse_case
from femseal.case.faces import SurfaceTable

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "examples").glob("*.toml"))


SCHEMA = case_schema()
NUMBER = (int, float)

KINDS = {
    "string": str,
    "boolean": bool,
    "object": dict,
    "array": list,
    "number": NUMBER,
    "integer": int,
}

#: Words of JSON Schema that the schema uses, the values that they are about, and what these fulfil.
WORDS = {
    "required": (dict, lambda value, given: {*given} <= {*value}),
    "pattern": (str, lambda value, given: re.search(given, value)),
    "maxLength": (str, lambda value, given: len(value) <= given),
    "minItems": (list, lambda value, given: len(value) >= given),
    "maxItems": (list, lambda value, given: len(value) <= given),
    "enum": (object, lambda value, given: value in given),
    "const": (object, operator.eq),
    "minimum": (NUMBER, operator.ge),
    "maximum": (NUMBER, operator.le),
    "exclusiveMinimum": (NUMBER, operator.gt),
    "exclusiveMaximum": (NUMBER, operator.lt),
}


def fits(value, schema, root):
    """Whether a value is what a part of the schema describes."""
    if "$ref" in schema:
        return fits(value, root["definitions"][schema["$ref"].rpartition("/")[2]], root)
    if "type" in schema:
        names = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
        if isinstance(value, bool):
            names = {*names} & {"boolean"}
        if not any(isinstance(value, KINDS[name]) for name in names):
            return False
    options = schema.get("oneOf") or schema.get("anyOf") or [{}]
    inner, known = [], schema.get("properties", {})
    if isinstance(value, dict):
        if schema.get("additionalProperties") is False and not {*value} <= {*known}:
            return False
        inner = [(value[key], known[key]) for key in value.keys() & known]
    elif isinstance(value, list):
        inner = [(item, schema.get("items", {})) for item in value]
    words = [(*WORDS[word], given) for word, given in schema.items() if word in WORDS]
    return (
        any(option == {} or fits(value, option, root) for option in options)
        and all(fits(item, part, root) for item, part in inner)
        and all(check(value, given) for kind, check, given in words if isinstance(value, kind))
    )


@pytest.mark.parametrize("command", ["check", "run", "design"])
def test_a_stop_before_the_work_is_told_and_no_success(femseal, monkeypatch, command):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("femseal.case.reading.read_case", stopped)
    code, _, errors = femseal(command, ROOT / "examples" / "turned_seal.toml")
    assert code == 1
    assert "stopped" in errors


def loops(*_, **__):
    for one in ("a", 1.0):
        njit(lambda x: x)(one)
    raise fs.InputError("face", "none", "one")


@pytest.mark.parametrize(
    ("command", "place", "further"),
    [
        ("check", "runs.run_description.describe", []),
        ("run", "runs.job.prepare", ["--workers", 1]),
        ("sweep", "sweeps.sweeping.prepare", ["seed=1", "--workers", 1]),
        ("design", "designs.answer.job.prepare", ["--no-solve", "--workers", 1]),
        ("calibrate", "calibration.calibrating.prepare", ["test.csv", "--workers", 1]),
    ],
)
def test_commands_tell_once_that_loops_are_compiled(
    femseal, monkeypatch, tmp_path, command, place, further
):
    monkeypatch.chdir(tmp_path)
    test = "pressure [MPa],leakage [mL/(m*s)]\n100,12\n200,6\n300,3.5\n"
    (tmp_path / "test.csv").write_text(test)
    monkeypatch.setattr(f"femseal.{place}", loops)
    code, _, errors = femseal(command, ROOT / "examples" / "turned_seal.toml", *further)
    assert (code, errors.count("compiling for one to two minutes, once after an installation")) == (
        2,
        1,
    )


TURNED = fs.turned((96, 128), (96e-6, 128e-6), pitch=16e-6, depth=1e-6, roughness=2e-8, rng=1)


@pytest.fixture
def face(tmp_path):
    """A face whose x is across its grooves, with a spike and two undefined points."""
    heights = TURNED.heights.copy()
    heights[20, 30] += 2e-5
    heights[50, 60:62] = np.nan
    np.savez(tmp_path / "face.npz", heights=heights, spacing=(1e-6, 1e-6))
    return tmp_path / "face.npz"


def fields(output):
    """Labels and values of the printed lines."""
    return dict(
        re.split(r"  +", line.strip(), maxsplit=1)
        for line in output.splitlines()
        if line.startswith("  ")
    )


# --- what is loaded, how it ends --------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_questions_are_answered_without_loading_anything(option):
    code = """
import sys
from femseal.cli import main
try:
    main()
except SystemExit as stop:
    assert not stop.code
print([m for m in ("numpy", "scipy", "numba", "pydantic", "pint", "matplotlib", "xarray") if m in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code, option], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_package_is_the_command_too():
    done = subprocess.run(
        [sys.executable, "-m", "femseal", "--version"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("femseal ")


def test_version_lists_the_stack(femseal):
    code, text, _ = femseal("--version")
    listed = dict(line.split(" ") for line in text.splitlines())
    assert code == 0
    assert listed["femseal"] == fs.__version__
    assert listed["numpy"] == np.__version__
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {re.split("[><=]", name)[0] for name in project["dependencies"]} <= set(listed)


def test_commands_are_completed():
    asked = {"_FEMSEAL_COMPLETE": "complete_bash", "COMP_WORDS": "femseal s", "COMP_CWORD": "1"}
    code = "from femseal.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | asked
    )
    assert sorted(done.stdout.split()) == ["schema", "surface", "sweep"]


def test_errors_are_a_line_and_after_debug_a_traceback(femseal, monkeypatch, tmp_path):
    path = tmp_path / "none.toml"
    code, _, errors = femseal("check", path)
    assert code == 2
    assert errors.count("\n") == 1
    code, _, traced = femseal("--debug", "check", path)
    assert code == 2
    assert traced.startswith("Traceback")
    assert traced.endswith(errors)

    def fail(path):
        raise ZeroDivisionError("nothing to divide by")

    monkeypatch.setattr("femseal.case.reading.load_case", fail)
    assert femseal("check", path) == (1, "", "femseal: ZeroDivisionError: nothing to divide by\n")
    assert "in fail" in femseal("--debug", "check", path)[2]
    assert femseal("check")[0] == 2


# --- surface ----------------------------------------------------------------------------------------------


def test_surface_describes_a_face_and_what_a_run_does(femseal, face, tmp_path):
    picture = tmp_path / "face.png"
    code, text, errors = femseal("surface", face, "-o", picture)
    assert (code, errors) == (0, "")
    found, done = map(fields, text.split("what a run does to it"))
    measured = fs.read_topography(face)
    report = fs.describe_surface(measured)
    assert (found["points"], found["size"]) == ("96 × 128", "96 µm × 128 µm")
    assert found["points in spikes"] == done["points in spikes, filled"] == "1"
    assert found["undefined points"] == "0.0163 %"
    assert found["Sq, rms height"] == f"{report.rms_height * 1e9:.4g} nm"
    assert float(found["Std, lay from x2 (Str <= 0.5)"].rstrip("°")) == pytest.approx(0, abs=2)
    surface, conditioning = fs.condition(measured)
    assert done["Sq"] == f"{surface.rms_height * 1e9:.4g} nm"
    assert done["rms slope"] == f"{conditioning.rms_slope:.4g}"
    assert done["shortest wave kept"] == "8 µm"
    assert picture.stat().st_size > 50_000


def test_what_is_said_goes_before_what_the_file_says(femseal, face):
    said = ["--size", "1 mm", "2 mm", "--height-unit", "um", "--spikes", "inf", "--transpose"]
    drawn = ["-o", face.parent / "drawn.svg"]
    code, text, _ = femseal("surface", face, *said, "--shortest-wave", "0.3 mm", *drawn)
    assert code == 0
    assert b"<svg" in drawn[1].read_bytes()
    found = fields(text)
    assert (found["points"], found["size"]) == ("128 × 96", "1 mm × 2 mm")
    assert found["points in spikes"] == "0"
    assert found["shortest wave kept"] == "300 µm"
    report = fs.describe_surface(fs.read_topography(face), spikes=inf)
    assert found["Sq, rms height"] == f"{report.rms_height * 1e-6 * 1e12:.4g} pm"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "1", "2 mm"], "--size: given '1', expected text with a number and a unit"),
        (["--shortest-wave", "1 s"], "--shortest-wave: given '1 s'"),
        (["--spikes", "0"], "--spikes: given 0"),
        (["--detrend", "3"], "--detrend: given 3"),
        (["--max-undefined", "-1"], "--max-undefined: given -1"),
        (
            ["--crop", "0 m", "1 mm", "0 m", "10 um"],
            "--crop: given (0.0, 0.001, 0.0, 1e-05) m, expected start and end along x1",
        ),
        (["--crop", "0 m", "10 um", "8 um", "8 um"], "--crop: given"),
        (["--mask", "none.png"], "--mask: given 'none.png', no such file"),
        (["--shortest-wave", "1 mm"], "--shortest-wave: given 1 mm"),
        (["-o", "no such folder/a.png"], "output: given 'no such folder/a.png'"),
        (["-o", "a.xyz"], "output: given 'a.xyz', expected a file .png, .pdf, .svg"),
        (["--channel", "1"], "channel: given 1"),
    ],
)
def test_bad_options_of_surface(femseal, face, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    if "-o" not in arguments:
        arguments = [*arguments, "-o", "face.png"]
    code, text, errors = femseal("surface", face, *arguments)
    assert (code, text) == (2, "")
    assert message in errors
    assert [p.name for p in tmp_path.iterdir()] == ["face.npz"]


def test_how_a_table_was_understood_is_said(femseal, tmp_path):
    """Points that are missing, and a number far from all others."""
    z = 1e6 * TURNED.heights[:40, :30]
    lines = [f"{2 * i} {2 * j} {z[i, j]:.4f}" for i in range(40) for j in range(30)]
    lines[7] = lines[7].rsplit(maxsplit=1)[0] + " -9999"
    path = tmp_path / "face.xyz"
    path.write_text("\n".join(lines[:90] + lines[91:]))
    said = ["--spacing", "2 um", "2 um", "--height-unit", "um"]
    code, text, errors = femseal("surface", path, *said)
    assert (code, errors) == (0, "")
    assert fields(text)["points"] == "40 × 30"
    assert (
        "note: the table x y z is a grid of 40 × 30 points; 1 point (0.0833 %) is missing" in text
    )
    assert "note: 1 point (0.0833 %) at exactly -9999, far from all others" in text
    code, text, _ = femseal("surface", path, *said, "--no-data", "none")
    assert code == 0
    assert fields(text)["undefined points"] == "0.0833 %"
    code, text, _ = femseal("new", tmp_path / "case.toml", "--from", path, *said)
    assert code == 0
    assert "# the table x y z is a grid" in (tmp_path / "case.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda z: z[:, 90:].fill(np.nan), r"29.7 % undefined points, expected at most 5 %: crop"),
        (lambda z: z.__imul__(1e6), r"expected at most 10 mm; .* \(--height-unit\)"),
    ],
)
def test_surface_describes_what_a_run_refuses(femseal, tmp_path, change, reason):
    z = TURNED.heights.copy()
    change(z)
    np.savez(tmp_path / "face.npz", z=z, spacing=TURNED.spacing)
    drawn = ["-o", tmp_path / "face.png"] if "crop" in reason else []
    code, text, errors = femseal("surface", tmp_path / "face.npz", *drawn)
    assert (code, errors) == (0, "")
    assert re.search(f"note: a run refuses this face: .*{reason}", text)
    assert fields(text)["points"]
    assert not drawn or (tmp_path / "face.png").stat().st_size > 30_000


@pytest.mark.parametrize("shape", [(24, 32), (1, 1), (1, 40), (3, 3), (12, 2)])
def test_a_file_without_a_pixel_and_tiny_maps_are_described(femseal, tmp_path, shape):
    np.save(tmp_path / "face.npy", 1e-7 * np.random.default_rng(0).standard_normal(shape))
    code, text, errors = femseal("surface", tmp_path / "face.npy", "-o", tmp_path / "face.png")
    assert (code, errors) == (0, "")
    assert "a run refuses this face: " in text
    assert "given no pixel size in the file" in text
    assert fields(text.split("what a run does")[0])["points"] == f"{shape[0]} × {shape[1]}"


def test_a_mask_in_the_file_is_told(femseal, tmp_path):
    mask = np.zeros(TURNED.shape, bool)
    mask[10:12, 20:68] = True
    path = tmp_path / "face.npz"
    np.savez(path, z=TURNED.heights, spacing=(1e-6, 1e-6), mask=mask)
    for arguments, share in (([], "0.781 %"), (["--no-file-mask"], "0 %")):
        text = femseal("surface", path, *arguments)[1]
        assert fields(text)["undefined points, filled"] == share


def test_defaults_of_surface_are_those_of_a_case():
    options = inspect.signature(cli.surface).parameters
    table = SurfaceTable()
    assert {
        n: options[n].default for n in ("spikes", "detrend", "max_undefined", "shortest_wave")
    } == {n: getattr(table, n) for n in ("spikes", "detrend", "max_undefined", "shortest_wave")}


# --- schema -----------------------------------------------------------------------------------------------


def faults(case):
    """Whether a case does not fit the schema."""
    return not fits(case, SCHEMA, SCHEMA)


@pytest.mark.parametrize("path", CASES, ids=lambda p: p.name)
def test_shipped_cases_fit_the_schema(path):
    assert not faults(tomllib.loads(path.read_text(encoding="utf-8")))


def test_all_that_the_template_comments_out_fits_the_schema():
    assert not any(map(faults, template_cases()))


@pytest.mark.parametrize(
    ("table", "key", "value", "fits"),
    [
        ("face", "picth", "60 um", False),
        ("face", "pitch", 60, False),
        ("face", "pitch", "60", False),
        ("face", "pitch", "1,5 um", False),
        ("face", "pitch", ".6e2um", True),
        ("face", "points", [64], False),
        ("face", "points", [64, 0], False),
        ("face", "kind", "polished", False),
        ("fluid", "pressure_viscosity", "20 1/GPa", True),
        ("material", "poisson", [0.3], False),
        ("material", "poisson", "0.3", True),
        ("load", "loading", "1 MPa", False),
        ("load", "loading", [], False),
        ("stochastic", "sampler", "magic", False),
        ("contact", "boundary", ["free", "open"], False),
        ("seal", "lay", "x1", True),
        ("surface", "detrend", 3, False),
        ("surface", "spikes", 0, False),
        ("surface", "spikes", inf, True),
        ("surface", "max_undefined", 0, True),
    ],
)
def test_the_schema_refuses_what_a_case_refuses(table, key, value, fits):
    data = tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))
    data.setdefault(table, {})[key] = value
    assert faults(data) != fits
    with nullcontext() if fits else pytest.raises(fs.InputError):
        parse_case(data)


def test_schema_is_printed(femseal):
    """Keys as in the models, and nothing that a file of TOML cannot have."""
    code, text, _ = femseal("schema")
    assert code == 0
    assert json.loads(text) == case_schema()
    assert "null" not in text
    assert "prefixItems" not in text
    assert '"folder"' not in text
    tables = {name: table["properties"] for name, table in case_schema()["definitions"].items()}
    assert set(SurfaceTable.model_fields) == set(tables["SurfaceTable"])


@pytest.mark.parametrize(
    "arguments",
    [("report",), ("surface",), ("new",), ("run", CASES[0], "-o"), ("export", "-o", "gap.npz")],
)
def test_a_name_longer_than_the_file_system_takes_is_one_line(femseal, arguments):
    code, _, err = femseal(*arguments, "a" * 5000)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    assert len(err) < 500


def test_new_writes_the_case_of_a_measured_face(tmp_path, femseal):
    """With what its file says, paths from the case's folder, and questions; it is valid as it is."""
    face, case = ROOT / "examples" / "measured_face.x3p", tmp_path / "cases" / "new.toml"
    case.parent.mkdir()
    assert femseal("new", case, "--from", face)[0] == 0
    text = case.read_text(encoding="utf-8")
    for words in (
        'size = ["300 µm", "600 µm"]',
        'shortest_wave = "10 µm"',
        "Std, lay from x2",
        "# ? which fluid",
    ):
        assert words in text
    assert (case.parent / fs.load_case(case).face[0].path).samefile(face)


def test_new_asks_for_what_a_text_does_not_say(tmp_path, femseal):
    """The pixel and the unit; with both the case reads the face, and says how the text lies."""
    face = fs.self_affine((48, 64), (48e-6, 64e-6), hurst=0.8, rms_height=1e-7, rng=1)
    case, header = tmp_path / "new.toml", "Width: 48 um\nHeight: 64 um"
    np.savetxt(tmp_path / "face.txt", face.heights.T * 1e6)
    np.savetxt(tmp_path / "sized.txt", face.heights.T * 1e6, header=header)
    for name, words in (
        ("face.txt", "given no pixel size and no unit of heights, expected --spacing"),
        ("sized.txt", "given no unit of heights, expected --height-unit um"),
    ):
        code, text, errors = femseal("new", case, "--from", tmp_path / name)
        assert (code, text, case.exists()) == (2, "", False)
        assert words in errors
    said = ("--spacing", "1 um", "1 um", "--height-unit", "um")
    assert femseal("new", case, "--from", tmp_path / "face.txt", *said)[0] == 0
    assert "# a line of the text runs along x1" in case.read_text(encoding="utf-8")
    (table,) = fs.load_case(case).face
    found = table.make(tmp_path, np.random.default_rng()).topography
    np.testing.assert_allclose(found.heights, face.heights, rtol=1e-12)
    np.testing.assert_allclose(found.spacing, 1e-6)


def test_a_scheduler_without_its_extra_is_told_how_to_install_it(femseal, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, complaint = femseal(
        "run", CASES[0], "-o", tmp_path / "results", "--scheduler", "local"
    )
    assert (code, complaint) == (
        2,
        "femseal: scheduler: given 'local', expected one after: pip install 'femseal[cluster]'\n",
    )
