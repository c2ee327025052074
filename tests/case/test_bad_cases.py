"""Cases that nobody should write: refused with a short message, before anything large is made, or warned of."""

import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import h5py
import numpy as np
import pytest
from each import each

import femseal as fs
from femseal import cli
from femseal.base.errors import shortened, shown
from femseal.base.machine import within_free_memory
from femseal.base.quantities import to_si
from femseal.case.case import parse_case
from femseal.preparation import prepared as sizes
from femseal.preparation.preparation import prepare
from femseal.results import RunFacts, assemble
from femseal.results.results_file import save
from femseal.runs.forecast import describe

ROOT = Path(__file__).parents[2]
#: A message that people read: no line is longer, in characters.
LONGEST = 420


@pytest.fixture
def data():
    case = tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))
    case["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
    case["cells"] = {"count": [2, 4]}
    return case


@pytest.fixture
def memory(monkeypatch):
    """A machine with 4 GB free."""
    monkeypatch.setattr(sizes, "free_memory", lambda: 4e9)


def refusal(call, *arguments):
    """The message of the InputError, of which no line is long."""
    with pytest.raises(fs.InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert max(map(len, message.splitlines())) <= LONGEST, message
    assert message.replace("\n", "").isprintable()
    return message


# --- words ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "key", "given", "expected"),
    [
        ("output", "classes", "L0.01", "a list in square brackets"),
        ("load", "loading", "50 MPa", "a list in square brackets"),
        ("output", "test_fluid", "helium", "a table"),
        ("contact", "rtol", "small", "a number"),
        ("output", "budget", "maybe", "true or false"),
    ],
)
def test_values_of_another_type_are_told_in_words_of_the_file(data, table, key, given, expected):
    data.setdefault(table, {})[key] = given
    assert (
        f"{table}.{key}: given {shown(given)}, expected {expected}"
        in refusal(parse_case, data).splitlines()
    )


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"stochastic": {"breadth": "100 km"}}, "stochastic.breadth"),
        (
            {"seal": {"kind": "annular", "inner_radius": "5 mm", "outer_radius": "49 m"}},
            "seal.outer_radius",
        ),
    ],
)
def test_seals_of_too_many_rows_of_tiles_are_refused_before_they_are_laid_out(data, changes, key):
    data["stochastic"] = {}
    message = refusal(lambda: prepare(parse_case(data | changes)))
    assert message.startswith(f"{key}: given ")
    assert "expected at most 1000 tiles from inlet to outlet" in message


def test_tables_and_values_in_place_of_one_another_are_told(data):
    data |= {
        "cells": True,
        "seal": {"kind": "annular", "inner_radius": "5 mm", "outer_radius": "6 mm", "inlet": {}},
    }
    lines = refusal(parse_case, data).splitlines()
    assert {"cells: given True, expected a table", "seal.inlet: expected 'inner' or 'outer'"} <= {
        *lines
    }


# --- units ------------------------------------------------------------------------------------------------


@each(
    "unit",
    [
        "(",
        "'''",
        "m\\",
        "m (",
        "m * ",
        "[m]",
        "m; m",
        "m\x00",
        "**",
        "m**999999999",
        "m^m",
        "((m))",
        "millimeter kilo",
        "lambda: m",
        "None",
        "a b c d e f g",
        "m" * 1000,
        "(" * 1000,
        "m*" * 500 + "m",
    ],
)
def test_text_that_is_no_unit_is_refused(unit):
    refusal(to_si, f"1 {unit}", "m")


def test_only_names_with_exponents_reach_the_parser_of_units(monkeypatch):
    def parser():
        raise AssertionError("asked")

    monkeypatch.setattr("femseal.base.quantities._registry", parser)
    for unit in ("m(", "'", "m.__class__", "m\nm", "m[0]", "m:m", "m**2**2", '"m"'):
        refusal(to_si, f"1 {unit}", "m")


@each(
    ("text", "unit", "value"),
    [
        ("210000 N/mm2", "Pa", 210e9),
        ("210000 N/mm²", "Pa", 210e9),
        ("1000 kgf/cm2", "Pa", 98066500.0),
        ("1 mPas", "Pa*s", 1e-3),
        ("1 mPa·s", "Pa*s", 1e-3),
        ("1 N/(mm^2)", "Pa", 1e6),
        ("870 kg/m3", "kg/m^3", 870.0),
        ("870 kg m-3", "kg/m^3", 870.0),
        ("30 %", "", 0.3),
    ],
)
def test_units_as_they_are_often_written(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-12)


def test_pressure_times_time_is_no_pressure():
    refusal(to_si, "5 MPas", "Pa")


# --- messages ---------------------------------------------------------------------------------------------


def test_long_texts_lose_their_middle():
    assert shortened("a" * 20, 9) == "aaaa…aaaa"
    assert shortened("a\nb") == "a\\nb"
    assert len(shown("a" * 10_000)) < 100
    assert len(shown([[[[[list(range(1000))] * 100]]]])) < 200
    assert shown(10**5000) == "a number of too many digits"


def test_messages_stay_short(data):
    long = "x" * 5000
    for table, key, value in [
        ("face", "pitch", long),
        ("face", long, 1),
        ("face", "a\nb\x1b[2J", 1),
        ("face", "kind", long),
        ("material", "young", [[1] * 1000] * 1000),
        ("load", "loading", [long] * 1000),
        ("fluid", "kind", {"a": {"b": long}}),
        ("stochastic", "sampler", long),
        ("cells", "count", [10**5000, 2]),
        ("stochastic", "realisations", long),
    ]:
        message = refusal(parse_case, data | {table: data[table] | {key: value}})
        assert len(message.splitlines()) <= 21
    refusal(parse_case, data | {"title": long})
    refusal(parse_case, data | {"face": {"kind": "file", "path": long}})
    refusal(parse_case, data | {"face": {"kind": "file", "path": "a\x00b"}})


# --- files ------------------------------------------------------------------------------------------------


def test_only_files_of_a_usual_size_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "large.toml").write_bytes(b"#" * 2_000_000)
    for path in (
        tmp_path / "pipe.toml",
        tmp_path / "folder.toml",
        tmp_path / "large.toml",
        "/dev/zero",
        "/dev/null",
    ):
        assert "case: given" in refusal(fs.load_case, path)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 50_000,
        "a = " + "[" * 400 + "]" * 400,
        "a = " + "{b=" * 20_000,
        "seed = " + "9" * 5000,
        "seed = 0x" + "f" * 20_000,
        "a." * 20_000 + "a = 1",
        "a" * 5000,
        "[" + "a." * 400 + "a]",
        "a = '\x00'",
    ],
    ids=range(9),
)
def test_text_that_is_no_case_is_refused(tmp_path, text):
    (tmp_path / "case.toml").write_text(text)
    refusal(fs.load_case, tmp_path / "case.toml")


def test_faces_larger_than_the_memory_are_refused_before_they_are_read(monkeypatch, tmp_path):
    def read(*_, **__):
        raise AssertionError("read")

    for suffix in (".npy", ".txt", ".x3p", ".plu"):
        path = tmp_path / f"face{suffix}"
        with path.open("wb") as file:
            file.truncate(3_000_000_000)  # takes no space on the disk
        monkeypatch.setattr("femseal.topography.formats.free_memory", lambda: 4e9)
        monkeypatch.setattr("femseal.topography.read.READERS", {suffix: read})
        assert "a file of 3 GB, expected one that can be read in the 4 GB" in refusal(
            fs.read_topography, path
        )


def test_zips_that_unpack_to_more_than_the_memory_are_refused_before_they_are_read(
    monkeypatch, tmp_path
):
    def read(*_, **__):
        raise AssertionError("read")

    monkeypatch.setattr("femseal.topography.formats.free_memory", lambda: 1e7)
    for suffix in (".npz", ".x3p", ".plux", ".txt"):
        path = tmp_path / f"face{suffix}"
        with ZipFile(path, "w", ZIP_DEFLATED) as archive:
            archive.writestr("z.npy", bytes(5_000_000))
        assert path.stat().st_size < 10_000
        monkeypatch.setattr("femseal.topography.read.READERS", {suffix: read})
        assert "unpacks to 0.005 GB" in refusal(fs.read_topography, path)


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is that of Linux")
def test_memory_is_refused_instead_of_ending_the_process(monkeypatch):
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    monkeypatch.setattr("femseal.base.machine.free_memory", lambda: 5e8)
    with pytest.raises(MemoryError), within_free_memory():
        bytearray(2_000_000_000)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    bytearray(2_000_000_000)


def test_meshes_larger_than_the_memory_are_refused_before_they_are_read(monkeypatch, tmp_path):
    path = tmp_path / "seal.msh"
    with path.open("wb") as file:
        file.truncate(3_000_000_000)
    monkeypatch.setattr("femseal.seal.seal_files.free_memory", lambda: 4e9)
    monkeypatch.setattr("femseal.seal.seal_files._meshio_read", lambda file: pytest.fail("read"))
    assert "of 3 GB, expected a mesh that can be read" in refusal(
        fs.MeshSeal, path, "inlet", "outlet"
    )


def test_files_that_claim_more_heights_than_fit_into_memory_are_refused(monkeypatch, tmp_path):
    def fail(*_, **__):
        raise MemoryError("Unable to allocate 3 TiB")

    np.save(tmp_path / "face.npy", np.zeros((4, 4)))
    monkeypatch.setattr("femseal.topography.read.READERS", {".npy": fail})
    assert "fit into memory" in refusal(fs.read_topography, tmp_path / "face.npy")


# --- sizes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "key", "value", "words"),
    [
        ("face", "points", [100_000, 100_000], ["face.points", "GB of free memory", "640 GB"]),
        ("face", "points", [10**12, 10**12], ["face.points", "GB of free memory"]),
        ("face", "points", [10**30, 2], ["face.points", "1000000000000"]),
        ("surface", "points", [60_000, 60_000], ["surface.points", "GB of free memory"]),
        ("cells", "count", [10**6, 10**6], ["cells", "8 × 8 points"]),
        ("cells", "count", [10_000, 1], ["cells", "8 × 8 points"]),
        ("cells", "size", "1e-25 m", ["cells", "8 × 8 points"]),
        ("stochastic", "length", "1e6 km", ["stochastic.length", "GB of free memory"]),
        ("stochastic", "length", "1e29 m", ["stochastic.length", "GB of free memory"]),
        ("stochastic", "realisations", 10**11, ["stochastic.realisations", "GB of free memory"]),
        ("load", "loading", ["1e-300 Pa"], ["load.loading", "1e+30"]),
        ("face", "size", ["1e300 m", "1 mm"], ["face.size", "1e+30"]),
        (
            "load",
            "unloading",
            [f"{n + 1} kPa" for n in range(9000)],
            ["load", "at most 10000 steps"],
        ),
    ],
)
@pytest.mark.usefixtures("memory")
def test_sizes_are_weighed_before_anything_is_made(monkeypatch, data, table, key, value, words):
    def made(*_, **__):
        raise AssertionError("made")

    if table == "face":
        monkeypatch.setattr("femseal.case.faces.TurnedFace.make_heights", made)
    given = {key: value} if table == "cells" else data.get(table, {}) | {key: value}
    message = refusal(lambda: prepare(parse_case(data | {table: given})))
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    "error", [MemoryError("Unable to allocate 3 TiB"), OverflowError("too large"), RecursionError()]
)
def test_what_is_too_large_all_the_same_is_bad_input(monkeypatch, data, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("femseal.case.faces.TurnedFace.make_heights", fail)
    assert "case: given a size or number that is too large" in refusal(
        lambda: prepare(parse_case(data))
    )


def test_few_grooves_are_drawn_in_time_whatever_the_tool(data):
    """Passes further away than the same groove again cannot be the lowest."""
    size = (60e-6, 120e-6)
    given = {"pitch": 30e-6, "depth": 1.5e-6, "feed_error": 0.1, "depth_error": 0.5, "rng": 3}
    blunt = fs.turned((64, 96), size, nose_radius=1e6, **given)
    assert np.all(np.isfinite(blunt.heights))


# --- what is wrong, and what is odd ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inlet", "outlet", "words"),
    [
        ("1 MPa", "1 MPa", ["given 1 MPa", "above that of the outlet, 1 MPa"]),
        ("1 bar", "2 bar", ["100 kPa", "200 kPa"]),
    ],
)
def test_a_case_leaks_from_inlet_to_outlet(data, inlet, outlet, words):
    data["fluid"] |= {"inlet_pressure": inlet, "outlet_pressure": outlet}
    message = refusal(parse_case, data)
    assert message.startswith("fluid.inlet_pressure: given")
    assert all(word in message for word in words), message


AIR = {
    "kind": "ideal-gas",
    "viscosity": "18 uPa*s",
    "molar_mass": "29 g/mol",
    "temperature": "20 °C",
}


@pytest.mark.parametrize("place", ["fluid", "output.test_fluid"])
def test_pressures_at_which_a_liquid_is_solid_are_refused_before_the_run(data, place):
    table = data if place == "fluid" else data.setdefault("output", {})
    table[place.split(".")[-1]] = {
        "kind": "liquid",
        "viscosity": "1 mPa*s",
        "pressure_viscosity": "20 1/GPa",
        "inlet_pressure": "2 GPa",
    }
    assert refusal(parse_case, data).startswith(
        f"{place}.inlet_pressure: given 2e+09 Pa, expected a pressure that"
    )


@pytest.mark.parametrize(
    ("table", "given", "words"),
    [
        ("material", {"young": "210 MPa"}, ["material.young 210 MPa", "5 GPa to 1200 GPa", "unit"]),
        ("counter_material", {"young": "210 TPa"}, ["counter_material.young 2.1e+05 GPa", "usual"]),
        (
            "fluid",
            {"viscosity": "1 MPa*s"},
            ["fluid.viscosity 1 MPa·s is not in the usual range, 1 µPa·s to 1 kPa·s: is"],
        ),
        (
            "fluid",
            {"density": "1 g/m^3"},
            ["fluid.density 0.001 kg/m^3", "50 kg/m^3 to 2.5e+04 kg/m^3"],
        ),
        (
            "load",
            {"loading": ["1 Pa", "2 Pa"], "unload_from": [], "unloading": []},
            ["load.loading 1 Pa (and 1 more)"],
        ),
        ("output", {"nominal_diameter": "50 m"}, ["output.nominal_diameter 50 m", "1 mm to 10 m"]),
        (
            "output",
            {
                "test_fluid": {
                    "name": "helium",
                    "inlet_pressure": "40 mPa",
                    "outlet_pressure": "1 mPa",
                }
            },
            ["output.test_fluid.inlet_pressure 40 mPa", "100 Pa to 2 GPa"],
        ),
        (
            "fluid",
            {"inlet_pressure": "400 MPa"},
            ["25 MPa", "14 more steps", "the fluid carries all", "200 MPa"],
        ),
        (
            "fluid",
            AIR | {"outlet_pressure": "0 bar"},
            ["fluid.outlet_pressure 0 Pa", "absolute", "vacuum"],
        ),
        (
            "load",
            {"loading": ["100 MPa", "2.7 GPa"], "unload_from": [], "unloading": []},
            ["2.7 GPa is 96%", "2.8 GPa"],
        ),
        ("face", {"depth": "60 um"}, ["rms slope of the face is ", "half-space"]),
    ],
)
def test_odd_cases_are_warned_of_with_their_numbers(data, table, given, words):
    if table == "fluid" and "kind" in given:
        data["fluid"] = {"inlet_pressure": "10 MPa"}
    data.setdefault(table, {}).update(given)
    case = parse_case(data)
    prepared = prepare(case)
    found = [text for text in prepared.warnings if all(word in text for word in words)]
    assert len(found) == 1, prepared.warnings
    assert f"warning        {found[0]}" in describe(case, prepared)


def test_usual_cases_are_not_warned_of(data):
    assert prepare(parse_case(data)).warnings == ()
    for path in sorted((ROOT / "examples").glob("*.toml")):
        assert prepare(fs.load_case(path)).warnings == ()
    # a vacuum is odd for a gas alone, and contact without pressure cannot be compared
    data["fluid"]["outlet_pressure"] = "0 bar"
    data["load"]["loading"] = ["0 MPa", *data["load"]["loading"]]
    assert prepare(parse_case(data)).warnings == ()


def test_a_run_warns_of_odd_cases(data):
    data |= {"method": "deterministic", "compare": []}
    data["face"] |= {"points": [32, 32], "size": ["60 um", "60 um"]}
    data["load"] = {"loading": ["100 MPa"]}
    data["fluid"]["inlet_pressure"] = "400 MPa"
    results = fs.run(parse_case(data), workers=1)
    assert "the fluid carries all: the faces part below about 200 MPa" in results.warnings[0]
    (failure,) = results.failures
    assert re.fullmatch(
        r"loading 100 MPa: open: the faces part below 20\d MPa, all of which the fluid carries",
        failure,
    )


def test_results_of_studies_called_from_python_warn_of_odd_scenes_too():
    heights = fs.self_affine(
        (32, 32), (60e-6, 60e-6), hurst=0.8, rms_slope=0.1, rng=np.random.default_rng(1)
    )
    given = {"modulus": 115e9, "hardness": 2.8e9, "fluid": fs.Liquid(1e-3), "inlet_pressure": 1e6}
    usual = fs.Scene(heights, outlet_pressure=0.0, loading=(100e6,), **given)
    odd = replace(usual, inlet_pressure=400e6)
    sampling = fs.Sampling(length=60e-6, realisations=2, seed=1)
    for study, settings in (
        (fs.deterministic, ()),
        (fs.two_scale, ((2, 2),)),
        (fs.stochastic, ((2, 2), sampling)),
    ):
        told = set(study(odd, *settings).warnings) - set(study(usual, *settings).warnings)
        assert len(told) == 1
        assert "of 100 MPa, the load at loading 100 MPa, the fluid carries all" in told.pop()
    assert (
        "contact modulus 115 MPa"
        in fs.deterministic(replace(usual, modulus=115e6, loading=(1e5,))).warnings[0]
    )
    study = fs.deterministic(odd)
    assert assemble(odd, study, facts=RunFacts(warnings=study.warnings)).warnings == list(
        study.warnings
    )


# --- results ----------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, data):
    data |= {"method": "deterministic", "compare": [], "title": "small"}
    data["face"] |= {"points": [32, 32], "size": ["60 um", "60 um"]}
    data["load"] = {"loading": ["100 MPa"]}
    save(fs.run(parse_case(data), workers=1), tmp_path / "results")
    assert fs.open_results(tmp_path / "results").case["title"] == "small"
    return tmp_path / "results"


def test_results_read_no_other_file(folder):
    """Neither through links, nor through values that lie outside or are put together from elsewhere."""
    path = folder / "results.nc"
    (folder / "secret").write_bytes(b"12345678" * 10)
    whole = path.read_bytes()
    virtual = h5py.VirtualLayout(shape=(1,), dtype=float)
    virtual[:] = h5py.VirtualSource(str(folder / "secret"), "x", shape=(1,))
    for change in (
        lambda file: file.__setitem__("x", h5py.ExternalLink(str(folder / "secret"), "/")),
        lambda file: file.__setitem__("x", h5py.SoftLink("/leakage_deterministic")),
        lambda file: file.create_dataset(
            "x", (1,), float, external=[(str(folder / "secret"), 0, 8)]
        ),
        lambda file: file.create_virtual_dataset("x", virtual),
        lambda file: file.create_group("x"),
    ):
        with h5py.File(path, "r+") as file:
            change(file)
        assert "whose 'x' is" in refusal(fs.open_results, folder)
        path.write_bytes(whole)


def test_results_that_claim_more_than_the_memory_are_refused(folder):
    with h5py.File(folder / "results.nc", "r+") as file:
        file.create_dataset("x", (10**7, 10**7), float, chunks=(1000, 1000), compression="gzip")
    assert "unpacks to 8e+05 GB" in refusal(fs.open_results, folder)


@pytest.mark.parametrize("value", [3.0, b"\xff", "[1", "7", [1, 2]])
def test_attributes_of_results_of_another_kind_are_refused(folder, value):
    with h5py.File(folder / "results.nc", "r+") as file:
        file.attrs["warnings"] = value
    refusal(fs.open_results, folder)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("nominal_pressure", np.array(["a"], h5py.string_dtype())),
        ("leakage_deterministic", np.zeros((2, 3))),
        ("leakage_deterministic", np.zeros(1, [("a", float)])),
        ("step", np.zeros(0)),
        ("nominal_pressure", None),
    ],
)
def test_fields_of_results_of_another_kind_are_refused(folder, name, value):
    with h5py.File(folder / "results.nc", "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value
    refusal(fs.open_results, folder)


def test_results_that_make_no_page_are_refused(monkeypatch, folder):
    from femseal.report import page

    def fail(*_):
        raise KeyError("deep within")

    monkeypatch.setattr(page, "report_html", fail)
    assert "results.nc (KeyError: 'deep within')" in refusal(page.write_report, folder)
    with pytest.raises(KeyError):  # of a run, it is a fault of the program
        page.write_report(fs.open_results(folder))


# --- keys of the case -------------------------------------------------------------------------------------


def test_messages_name_keys_of_the_case(tmp_path, data):
    for surface, words in [
        (
            {"shortest_wave": "1 um"},
            ["surface.shortest_wave: given 1 µm", "µm", "surface.points = [480, 960]"],
        ),
        (
            {"shortest_wave": "1 mm"},
            ["surface.shortest_wave: given 1 mm", "less than the larger side"],
        ),
    ]:
        message = refusal(lambda surface=surface: prepare(parse_case(data | {"surface": surface})))
        assert all(word in message for word in words), message
    data["face"]["pitch"] = "1 um"
    assert refusal(lambda: prepare(parse_case(data))).startswith("face.pitch: given")
    data["face"]["pitch"] = "30 um"
    spiral = {
        "seal": {"lay": {"kind": "spiral", "lead": "30 um"}},
        "method": "two-scale",
        "compare": [],
    }
    for tables, words in [
        (
            {"contact": {"fluid_pressure": "trapped"}} | spiral,
            "contact.fluid_pressure: given 'trapped'",
        ),
        (
            {"fluid": data["fluid"] | {"inlet_pressure": "5 GPa"}},
            "fluid.inlet_pressure: given 5 GPa, expected less",
        ),
        (
            {"flow": {"discretisation": "Q2"}},
            "flow.discretisation: given 'Q2', expected none: removed; the flow of a grid always",
        ),
        (
            {"cells": {"flow": "links"}},
            "cells.flow: given 'links', expected none: removed; the flow of a face is always",
        ),
        (
            {"cells": {"contact": "windows"}},
            "cells.contact: given 'windows', expected none: removed; the contact is",
        ),
        (
            {"method": "two-scale", "cells": {"count": [16, 1]}},
            "cells: given 16 × 1 of 64 × 96 points, expected",
        ),
    ]:
        message = refusal(lambda tables=tables: prepare(parse_case(data | tables)))
        assert message.startswith(words), message
    heights = np.zeros((64, 96))
    heights[:20] = np.nan
    np.save(tmp_path / "face.npy", heights)
    data["face"] = {"kind": "file", "path": "face.npy", "spacing": ["1 um", "1 um"]}
    message = refusal(lambda: prepare(parse_case(data, tmp_path)))
    assert "max_undefined" in message
    assert "max_share" not in message


# --- the command line -------------------------------------------------------------------------------------


def command(*arguments, **streams):
    return subprocess.run(
        [sys.executable, "-c", "from femseal.cli import main; main()", *map(str, arguments)],
        text=True,
        stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        **streams,
    )


needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")


@needs_full
def test_a_full_standard_output_is_one_line():
    with open("/dev/full", "w") as full:
        for arguments in (["schema"], ["check", ROOT / "examples" / "turned_seal.toml"]):
            done = command(*arguments, stdout=full)
            assert done.returncode == 1
            assert (
                done.stderr
                == "femseal: standard output: cannot be written (No space left on device)\n"
            )


@needs_full
def test_a_full_log_file_is_one_line(capsys):
    import logging

    from femseal.execution.terminal import log_lines

    with log_lines(Path("/dev/full"), quiet=True, terminal=False):
        for n in range(3):
            logging.getLogger("femseal").info("line %d", n)
    errors = capsys.readouterr().err
    assert errors == "log-file: lines are missing in '/dev/full' (No space left on device)\n"


def test_names_of_files_are_no_formulas(tmp_path):
    from femseal.preparation.survey import survey

    heights = fs.self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.1, rng=1)
    path = tmp_path / r"a$\frac{$b.npz"
    np.savez(path, z=heights.heights, spacing=heights.spacing)
    reading = {
        "size": None,
        "spacing": None,
        "spikes": 6.0,
        "detrend": 1,
        "shortest_wave": None,
        "max_undefined": 0.05,
    }
    survey(path, tmp_path / "face.png", **reading)
    assert (tmp_path / "face.png").stat().st_size > 1000


def test_a_page_that_cannot_be_written_is_bad_input(monkeypatch, tmp_path):
    from femseal.report import page

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(page, "open_results", lambda folder: None)
    monkeypatch.setattr(page, "report_html", lambda *given: "page")
    monkeypatch.setattr(page, "write_text", full)
    assert "No space left" in refusal(page.write_report, tmp_path, tmp_path / "page.html")


def test_devices_and_pipes_are_not_replaced_by_files(monkeypatch, tmp_path):
    from femseal.base.files import write_text
    from femseal.report import page

    monkeypatch.setattr(page, "open_results", lambda folder: None)
    monkeypatch.setattr(page, "report_html", lambda *given: "page")
    os.mkfifo(tmp_path / "pipe")
    for write in (
        lambda: page.write_report(tmp_path, tmp_path / "pipe"),
        lambda: write_text(tmp_path / "pipe", "x"),
    ):
        assert "a device, a pipe or a folder" in refusal(write)
    assert (tmp_path / "pipe").is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_out_of_memory_is_one_line(monkeypatch, capsys):
    def fail(path):
        raise MemoryError

    monkeypatch.setattr("femseal.case.case.load_case", fail)
    monkeypatch.setattr(sys, "argv", ["femseal", "check", "case.toml"])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 1
    assert capsys.readouterr().err.startswith("femseal: out of memory")


def test_long_lists_of_what_is_allowed_lose_their_end(data, monkeypatch):
    def refused(name, temperature, pressures):
        raise fs.InputError("name", "x" * 1000, "one of " + ", ".join(map(str, range(500))))

    monkeypatch.setattr("femseal.case.fluid.named_fluid", refused)
    data["fluid"] = {"name": "x" * 1000, "inlet_pressure": "1 MPa"}
    message = refusal(parse_case, data)
    assert ", expected one of 0, 1, 2" in message
    assert message.endswith("…")


@pytest.mark.usefixtures("memory")
def test_long_seals_are_weighed_before_their_pressures_are_looked_at(monkeypatch, data):
    monkeypatch.setattr(
        "femseal.preparation.preparation.check_map", lambda *_: pytest.fail("looked at")
    )
    data["stochastic"] |= {"length": "1000 km"}
    assert "stochastic.length: given a seal 1 Mm long, of 2.67e+11 tiles" in refusal(
        lambda: prepare(parse_case(data))
    )
