"""Cases that nobody should write: refused with a short message, before anything large is made, or warned of."""

import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from small_cases import STRIP, steel_scene

import femseal as fs
from femseal.case import explanations, parse_case
from femseal.preparation import prepare
from femseal.report import write_report
from femseal.results import save

ROOT = Path(__file__).parents[2]
#: A message that people read: no line is longer, in characters.
LONGEST = 420
READ = fs.read_topography
SPIRAL = {"lay": {"kind": "spiral", "lead": "30 um"}}


@pytest.fixture
def data():
    case = tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))
    case["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
    case["cells"] = {"count": [2, 4]}
    return case


def ring(outer, **more):
    return {"kind": "annular", "inner_radius": "5 mm", "outer_radius": outer, **more}


def refusal(call, *arguments):
    """The message of the InputError, of which no line is long."""
    with pytest.raises(fs.InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert max(map(len, message.splitlines())) <= LONGEST, message
    assert message.replace("\n", "").isprintable()
    return message


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (
            {"contact": {"fluid_pressure": "trapped"}, "seal": SPIRAL, "method": "two-scale"},
            "contact.fluid_pressure: given 'trapped'",
        ),
        ({"method": "two-scale", "cells": {"count": [16, 1]}}, "cells: given 16 × 1 of 64 × 96"),
        ({"seed": -1, "extra": 1}, r"extra: .*\n.*|seed: .*\n.*"),
    ],
)
def test_faults_of_several_keys(data, tables, said):
    message = refusal(lambda: prepare(parse_case(data | {"compare": []} | tables)))
    assert re.match(said, message), message


# --- one fault of a case ------------------------------------------------------------------------------------

AIR = {
    "kind": "ideal-gas",
    "viscosity": "18 uPa*s",
    "molar_mass": "29 g/mol",
    "temperature": "20 °C",
}
SOLID_AT_2_GPA = {
    "kind": "liquid",
    "viscosity": "1 mPa*s",
    "pressure_viscosity": "20 1/GPa",
    "inlet_pressure": "2 GPa",
}


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("seed", -1, "seed: given -1"),
        ("hurst", 1, r"hurst: given an unknown key, .*; perhaps meant: hurst in \[face\]"),
        ("folder", "elsewhere", "folder: given a value, expected no such key"),
        ("face", [STRIP["face"]] * 3, "face: "),
        ("face.pitch", "1,5 um", "pitch: given '1,5 um'.* comma"),
        ("face.pitch", "-1 um", "pitch: given '-1 um'.* > 0"),
        ("face.pitch", 60, "pitch: given 60.* unit"),
        ("face.pitch", "60 MPa", "pitch: given '60 MPa'"),
        ("face.pitch", "1 um", "face.pitch: given"),
        ("face.picth", "60 um", "picth: given an unknown key.* pitch"),
        ("face.shift", 1, "shift: given an unknown key, .*; shift is a key of kind 'file'$"),
        ("face.hurst", 0, "hurst: .* above 0"),
        ("face.roughness", "-1 nm", "roughness: .* >= 0"),
        ("face.feed_error", 1.1, "feed_error: .* from 0 to 1"),
        ("face.points", [0, 4], "points.0: .* greater than or equal to 1"),
        ("surface.shortest_wave", "1 um", r"given 1 µm, .*surface.points = \[480, 960\]"),
        ("surface.shortest_wave", "1 mm", "given 1 mm, expected less than the larger side"),
        *(("surface.spikes", value, "a number|greater than 0") for value in (0, -6, "six", True)),
        ("material.hardness", "1 GPa", "material: .*not both"),
        ("material.young", "0 GPa", "young: .* > 0"),
        ("material.poisson", 0.51, "poisson: given 0.51, .* at most 0.5"),
        ("material.poisson", -1, "poisson: .* above -1"),
        ("load.loading", [], r"loading: given \[\], .* at least one"),
        ("load.loading", ["one"], "loading.0: given 'one'"),
        ("load.loading", "50 MPa", "loading: given '50 MPa', expected a list in square brackets"),
        ("load.loading", ["2 MPa", "1 MPa"], "rising"),
        ("load.loading", ["1 MPa", "1 MPa"], "rising"),
        ("load.loading", ["2.8 GPa"], "given 2.8 GPa, expected .*below the hardness.* 2.8 GPa"),
        ("load.loading", ["100 bar(g)"], r"'100 bar\(g\)', expected a pressure without \(g\) or"),
        ("load.unload_from", ["4 GPa"], "given 4 GPa, expected .*below the hardness"),
        (
            "load.unload_from",
            ["25 MPa"],
            r"load.unloading: .* at least one pressure below the peak, 25 MPa",
        ),
        (
            "load.unloading",
            [],
            r"unloading: given an empty list, expected at least one pressure below",
        ),
        ("contact.rtol", "small", "rtol: given 'small', expected a number"),
        (
            "flow.solver",
            "magic",
            "'magic', .*'auto', 'multigrid', 'elimination', 'amg' or 'direct'",
        ),
        ("flow.rtol", 1e-3, "rtol: given an unknown key, expected solver"),
        ("fluid.kind", "water", "kind: given 'water', .*liquid"),
        ("fluid.viscosity", "1 Pa", "viscosity: given '1 Pa'"),
        ("fluid.colour", "blue", "given an unknown key, expected kind, viscosity, density, "),
        ("fluid.loading", 1, r"; perhaps meant: loading in \[load\]"),
        ("fluid.molar_mass", 1, "; molar_mass is a key of kind 'ideal-gas'$"),
        ("fluid.inlet_pressure", "-1 Pa", "inlet_pressure: .* >= 0"),
        ("fluid.inlet_pressure", "100 kPa", "given 100 kPa, .* above that of the outlet, 100 kPa"),
        ("fluid.inlet_pressure", "5 GPa", "given 5 GPa, expected less"),
        ("fluid", SOLID_AT_2_GPA, r"fluid\.inlet_pressure: given 2e\+09 Pa, expected a pressure"),
        ("fluid", AIR | {"slip": "maybe", "inlet_pressure": "5 bar"}, "slip: given 'maybe'"),
        ("fluid", {"name": "grease"}, "fluid.name: given 'grease', .*one of water, mineral oil"),
        ("fluid", {"name": 3}, "fluid.name: given 3, .*one of water, mineral oil"),
        (
            "fluid",
            {
                "name": "mineral oil ISO VG 46",
                "temperature": "90 °C",
                "inlet_pressure": "5 bar",
            },
            "at 90 °C.* 20 °C",
        ),
        ("fluid", {"name": "air", "temperature": "90"}, "temperature: given '90', .* '20 °C'"),
        ("fluid", {"name": "water", "temperature": "90"}, "temperature: given '90', .* '20 °C'"),
        ("fluid", AIR | {"temperature": "-300 °C"}, "temperature: given '-300 °C', .* zero"),
        ("fluid", {"name": "water", "temperature": "-300 °C"}, "given '-300 °C', .* absolute zero"),
        ("fluid", {"name": "air", "temperature": "-1 K"}, "temperature: given '-1 K', .* zero"),
        ("fluid", {"name": "air", "temperature": "0 K"}, "temperature: given '0 K', .* zero"),
        ("output.throughput_temperature", "-300 °C", "temperature: given '-300 °C', .* zero"),
        ("fluid", {"name": "air", "kind": "grease"}, "kind: given 'grease', .*'ideal-gas'"),
        ("fluid", {"name": "air", "colour": "blue"}, "colour: given an unknown key, .*name"),
        ("output.test_fluid", SOLID_AT_2_GPA, r"test_fluid.inlet_pressure: given 2e\+09 Pa"),
        ("output.test_fluid", "helium", "test_fluid: given 'helium', expected a table"),
        ("output.classes", "L0.01", "classes: given 'L0.01', expected a list in square brackets"),
        ("output.budget", "maybe", "budget: given 'maybe', expected true or false"),
        ("cells", True, "cells: given True, expected a table"),
        ("cells.count", [8.5, 2], "count.0: given 8.5, .*whole number"),
        ("cells.count", [64, 64], "8 × 8 points"),
        ("cells.count", [4, 6], "two shortest waves, 20 µm"),
        ("cells.count", [3, 7], "two shortest waves, 20 µm"),
        ("cells.size", "30 um", "either `count` or `size`"),
        ("cells", {"size": "61 um"}, r"size: given 61 µm, expected at most the shorter side"),
        ("cells.young", 1, r"; perhaps meant: young in \[material\]"),
        ("stochastic.length", ["1 mm", "2 mm"], "a number and a unit"),
        (
            "stochastic.length",
            "29.9 um",
            "length: given 29.9 µm, .*at least the length of a cell, 30 µm",
        ),
        ("stochastic.quantiles", [0.9, 0.1], "rising"),
        ("stochastic.quantiles", [0.5, 0.5], "rising"),
        ("stochastic.realisations", 1, "greater than or equal to 2"),
        ("stochastic.breadth", "100 km", "expected at most 1000 tiles from inlet to outlet"),
        ("seal.kind", "square", "kind: given 'square', .*'rectangular'"),
        ("seal.radius", "1 mm", "given an unknown key, expected kind, form, flatness, lay"),
        ("seal", ring("6 mm", inlet={}), "seal.inlet: expected 'inner' or 'outer'"),
        ("seal", ring("49 m"), "seal.outer_radius: given .* at most 1000 tiles from inlet"),
        ("seat", {"kind": "flat", "radius": 1}, "radius is a key of kind 'crowned' or 'ball-on"),
    ],
)
def test_faults_name_key_value_and_what_is_allowed(data, path, value, said):
    data |= {"flow": {}, "surface": {}, "seal": {"kind": "rectangular"}}
    if path == "seal":
        data["stochastic"] = {}
    *table, key = path.split(".")
    (data.setdefault(*table, {}) if table else data)[key] = value
    message = refusal(lambda: prepare(parse_case(data)))
    assert re.search(said, message, re.MULTILINE), message
    assert message.startswith(path.split(".")[0])


def test_a_key_removed_since_the_last_release_says_what_to_do_instead(data, monkeypatch):
    monkeypatch.setitem(explanations.REMOVED, "face.lay", "turn the map with `rotate`")
    data["face"]["lay"] = "x1"
    message = refusal(parse_case, data)
    assert message == "face.lay: given 'x1', expected none: removed; turn the map with `rotate`"


@pytest.mark.parametrize("several", [False, True])
def test_a_key_of_a_table_that_may_be_a_list_is_named_as_in_the_file(data, several):
    """An error of pydantic and one of the object itself; a single table has no number."""
    wave = {"kind": "waves", "height": "3 um", "lobes": 2}
    place = "seal.form.1" if several else "seal.form"
    for wrong, said in (
        ({"height": "3 Pa"}, "height: given '3 Pa', expected"),
        (
            {"wavelength": "4 mm"},
            "lobes: given both lobes and wavelength, expected exactly one of them",
        ),
    ):
        forms = [wave, wave | wrong] if several else wave | wrong
        message = refusal(parse_case, data | {"seal": {"form": forms}})
        assert message.startswith(f"{place}.{said}"), message


# --- messages ---------------------------------------------------------------------------------------------


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
        ("cells", "count", [10**5000, 2]),
    ]:
        message = refusal(parse_case, data | {table: data[table] | {key: value}})
        assert len(message.splitlines()) <= 21
    refusal(parse_case, data | {"title": long})
    for path in (long, "a\x00b"):
        refusal(parse_case, data | {"face": {"kind": "file", "path": path}})


@pytest.fixture
def unread(monkeypatch):
    """A machine with 10 MB free, on which no reader may be called."""
    for module in ("femseal.topography.formats", "femseal.seal.mesh_files"):
        monkeypatch.setattr(f"{module}.free_memory", lambda: 1e7)
    suffixes = (".npy", ".txt", ".x3p", ".plu", ".npz", ".plux")
    readers = dict.fromkeys(suffixes, lambda *_, **__: pytest.fail("read"))
    monkeypatch.setattr("femseal.topography.formats.READERS", readers)


@pytest.mark.usefixtures("unread")
def test_files_larger_than_the_memory_are_refused_before_they_are_read(tmp_path):
    for suffix in (".npy", ".txt", ".x3p", ".plu", ".msh"):
        path = tmp_path / f"large{suffix}"
        with path.open("wb") as file:
            file.truncate(3_000_000_000)  # takes no space on the disk
        read = partial(fs.MeshSeal, inlet="a", outlet="b") if suffix == ".msh" else READ
        assert "of 3 GB, expected" in refusal(read, path)


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
        "a." * 5_000 + "a = 1",
        "a" * 5000,
        "[" + "a." * 400 + "a]",
        "a = '\x00'",
    ],
    ids=range(9),
)
def test_text_that_is_no_case_is_refused(tmp_path, text):
    (tmp_path / "case.toml").write_text(text)
    refusal(fs.load_case, tmp_path / "case.toml")


# --- sizes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "key", "value", "words"),
    [
        ("face", "points", [100_000, 100_000], "face.points.*4 GB of free memory.*640 GB"),
        ("face", "points", [10**12, 10**12], "face.points.*GB of free memory"),
        ("face", "points", [10**30, 2], "face.points.*1000000000000"),
        ("surface", "points", [60_000, 60_000], "surface.points.*GB of free memory"),
        ("cells", "count", [10**6, 10**6], "cells.*8 × 8 points"),
        ("cells", "size", "1e-25 m", "cells.*8 × 8 points"),
        ("stochastic", "length", "1e6 km", "stochastic.length.*GB of free memory"),
        ("stochastic", "length", "1e29 m", "stochastic.length.*GB of free memory"),
        ("stochastic", "realisations", 10**11, "stochastic.realisations.*GB of free memory"),
        ("load", "loading", ["1e-300 Pa"], r"load.loading.*1e\+30"),
        ("face", "size", ["1e300 m", "1 mm"], r"face.size.*1e\+30"),
        ("load", "unloading", [f"{n + 1} kPa" for n in range(9000)], "load.*at most 10000 steps"),
    ],
)
def test_sizes_are_weighed_before_anything_is_made(monkeypatch, data, table, key, value, words):
    monkeypatch.setattr("femseal.preparation.memory.free_memory", lambda: 4e9)
    if table == "face":
        made = "femseal.case.faces.TurnedFace.make_heights"
        monkeypatch.setattr(made, lambda *_, **__: pytest.fail("made"))
    given = {key: value} if table == "cells" else data.get(table, {}) | {key: value}
    message = refusal(lambda: prepare(parse_case(data | {table: given})))
    assert re.search(words, message, re.DOTALL), message


@pytest.mark.parametrize("error", [MemoryError("3 TiB"), OverflowError(), RecursionError()])
def test_what_is_too_large_all_the_same_is_bad_input(monkeypatch, data, tmp_path, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("femseal.case.faces.TurnedFace.make_heights", fail)
    assert "case: given a size or number that is too large" in refusal(
        lambda: prepare(parse_case(data))
    )
    if isinstance(error, MemoryError):
        np.save(tmp_path / "face.npy", np.zeros((4, 4)))
        monkeypatch.setattr("femseal.topography.formats.READERS", {".npy": fail})
        assert "fit into memory" in refusal(READ, tmp_path / "face.npy")


HELIUM = {"name": "helium", "inlet_pressure": "40 mPa", "outlet_pressure": "1 mPa"}


FROM_1_MPA = {"inlet_pressure": "1 MPa", "outlet_pressure": "0 bar"}


# --- what is wrong, and what is odd ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "given", "words"),
    [
        ("material", {"young": "210 MPa"}, "material.young 210 MPa .*5 GPa to 1200 GPa.*unit"),
        ("counter_material", {"young": "210 TPa"}, r"counter_material.young 2.1e\+05 GPa .*usual"),
        ("fluid", {"viscosity": "1 MPa*s"}, "fluid.viscosity 1 MPa·s .*1 µPa·s to 1 kPa·s"),
        ("fluid", {"density": "1 g/m^3"}, r"fluid.density 0.001 kg/m³ .*50 kg/m³ to 2.5e\+04"),
        (
            "fluid",
            {"inlet_pressure": "400 MPa"},
            r"at loading 25 MPa and 14 more steps.*carries all of 25 MPa.*200 MPa",
        ),
        ("fluid", AIR | FROM_1_MPA, r"outlet is a vacuum \(0 Pa absolute\).*fluid.outlet_pressure"),
        ("load", {"loading": ["1 Pa", "2 Pa"]}, r"load.loading 1 Pa \(and 1 more\)"),
        ("load", {"loading": ["100 MPa", "2.7 GPa"]}, "2.7 GPa is 96% .*2.8 GPa"),
        ("output", {"nominal_diameter": "50 m"}, "nominal_diameter 50 m .*1 mm to 10 m"),
        ("output", {"test_fluid": HELIUM}, "test_fluid.inlet_pressure 40 mPa .*100 Pa to 2 GPa"),
        ("face", {"depth": "60 um"}, "rms slope is .*half-space"),
    ],
)
def test_odd_cases_are_warned_of_with_their_numbers(data, table, given, words):
    if table == "load" or "kind" in given:
        data[table] = {}
    data.setdefault(table, {}).update(given)
    found = prepare(parse_case(data)).warnings
    assert sum(bool(re.search(words, text)) for text in found) == 1, found


def test_usual_cases_are_not_warned_of(data):
    assert prepare(parse_case(data)).warnings == ()
    # a vacuum is odd for a gas alone, and contact without pressure cannot be compared
    data["fluid"]["outlet_pressure"] = "0 bar"
    data["load"]["loading"] = ["0 MPa", *data["load"]["loading"]]
    assert prepare(parse_case(data)).warnings == ()


@pytest.fixture
def quick(data):
    data |= {"method": "deterministic", "compare": [], "load": {"loading": ["100 MPa"]}}
    data["face"] |= {"points": [32, 32], "size": ["60 um", "60 um"]}
    return data


def test_a_run_warns_of_odd_cases(quick):
    quick["fluid"]["inlet_pressure"] = "400 MPa"
    results = fs.run(parse_case(quick), workers=1)
    assert (
        "the fluid carries all of 100 MPa, and the surfaces separate below about 200 MPa"
        in results.warnings[0]
    )
    (failure,) = results.failures
    said = re.match(
        r"loading 100 MPa: open: the surfaces separate below (\d+) MPa, all of which", failure
    )
    assert said
    # the mean fluid pressure, which is half of the inlet pressure between parallel surfaces
    assert 150 < float(said[1]) < 250


@pytest.mark.parametrize(
    ("study", "settings"),
    [
        (fs.deterministic, ()),
        (fs.two_scale, ((2, 2),)),
        (fs.stochastic, ((2, 2), fs.Sampling(length=60e-6, realisations=2, seed=1))),
    ],
)
def test_results_of_studies_called_from_python_warn_of_odd_scenes_too(study, settings):
    heights = fs.self_affine((32, 32), (60e-6, 60e-6), hurst=0.8, rms_slope=0.1, rng=1)
    usual = steel_scene(heights, fluid_pressure="acts", loading=(100e6,))
    odd = replace(usual, inlet_pressure=400e6)
    (told,) = set(study(odd, *settings).warnings) - set(study(usual, *settings).warnings)
    assert "The seal is open at loading 100 MPa, unless" in told
    soft = replace(usual, modulus=115e6, loading=(1e5,))
    assert "contact modulus 115 MPa" in study(soft, *settings).warnings[0]


# --- results ----------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, quick):
    save(fs.run(parse_case(quick), workers=1), tmp_path / "results")
    assert fs.open_results(tmp_path / "results").case["method"] == "deterministic"
    return tmp_path / "results"


def test_results_read_no_other_file(folder):
    """Neither through links, nor through values that lie outside or are put together from elsewhere."""
    path, secret = folder / "results.nc", str(folder / "secret")
    (folder / "secret").write_bytes(b"12345678" * 10)
    whole = path.read_bytes()
    virtual = h5py.VirtualLayout(shape=(1,), dtype=float)
    virtual[:] = h5py.VirtualSource(secret, "x", shape=(1,))
    for change in (
        lambda file: file.__setitem__("x", h5py.ExternalLink(secret, "/")),
        lambda file: file.__setitem__("x", h5py.SoftLink("/leakage_deterministic")),
        lambda file: file.create_dataset("x", (1,), float, external=[(secret, 0, 8)]),
        lambda file: file.create_virtual_dataset("x", virtual),
        lambda file: file.create_group("x"),
    ):
        with h5py.File(path, "r+") as file:
            change(file)
        assert "whose 'x' is" in refusal(fs.open_results, folder)
        path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.create_dataset("x", (10**7, 10**7), float, chunks=(1000, 1000), compression="gzip")
    assert "unpacks to 8e+05 GB" in refusal(fs.open_results, folder)


def test_attributes_and_fields_of_results_of_another_kind_are_refused(folder):
    path = folder / "results.nc"
    whole = path.read_bytes()
    for name, value in (
        *(("", warnings) for warnings in (3.0, b"\xff", "[1", "7", [1, 2])),
        ("nominal_pressure", np.array(["a"], h5py.string_dtype())),
        ("nominal_pressure", None),
        ("leakage_deterministic", np.zeros((2, 3))),
        ("leakage_deterministic", np.zeros(1, [("a", float)])),
        ("step", np.zeros(0)),
    ):
        with h5py.File(path, "r+") as file:
            if name:
                del file[name]
            if name and value is not None:
                file[name] = value
            elif not name:
                file.attrs["warnings"] = value
        refusal(fs.open_results, folder)
        path.write_bytes(whole)


# --- the command line -------------------------------------------------------------------------------------


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_a_full_standard_output_is_one_line():
    for arguments in (["schema"], ["check", ROOT / "examples" / "turned_seal.toml"]):
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [sys.executable, "-c", "from femseal.cli import main; main()", *arguments],
                text=True,
                stdout=full,
                stderr=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
            )
        said = "femseal: standard output: cannot be written (No space left on device)\n"
        lines = done.stderr.removeprefix(
            "compiling for one to two minutes, once after an installation\n"
        )
        assert (done.returncode, lines) == (1, said)


def test_names_of_files_are_no_formulas(tmp_path, femseal):
    heights = fs.self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.1, rng=1)
    path = tmp_path / r"a$\frac{$b.npz"
    np.savez(path, z=heights.heights, spacing=heights.spacing)
    assert femseal("surface", path, "-o", tmp_path / "face.png")[0] == 0
    assert (tmp_path / "face.png").stat().st_size > 1000


def test_devices_and_pipes_are_not_replaced_by_files(tmp_path, folder):
    os.mkfifo(tmp_path / "pipe")
    assert "a device, a pipe or a folder" in refusal(write_report, folder, tmp_path / "pipe")
    assert (tmp_path / "pipe").is_fifo()


def test_out_of_memory_is_one_line(monkeypatch, femseal):
    def fail(path):
        raise MemoryError

    monkeypatch.setattr("femseal.case.reading.load_case", fail)
    code, _, errors = femseal("check", "case.toml")
    assert code == 1
    assert errors.startswith("femseal: out of memory")
