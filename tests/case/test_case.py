"""Case files: every fault is reported with its key, what was given and what is allowed; good ones are prepared."""

import re
import tomllib
from dataclasses import MISSING, fields
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import template_cases

import femseal as fs
from femseal.base import to_si
from femseal.case import Case, case_schema, case_template, parse_case
from femseal.contact import PerfectlyPlastic
from femseal.fluids import FLUIDS
from femseal.preparation import prepare
from femseal.runs.identity import face_files
from femseal.runs.run_description import describe
from femseal.seal.tiles import CellSize
from femseal.studies import Sampling
from femseal.topography import repair

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "examples").glob("*.toml"))
TEMPLATE = case_template(Case)


EXAMPLE = (ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8")


@pytest.fixture
def data():
    return tomllib.loads(EXAMPLE)


@pytest.mark.parametrize("path", CASES, ids=lambda p: p.name)
def test_shipped_cases_are_valid_and_forecast(path):
    case = fs.load_case(path)
    prepared = prepare(case)
    assert prepared.scene.surface.rms_height > 0
    # the elements of the gasket are larger than its cells, which is said
    coarse = [text for text in prepared.warnings if "-clmax" in text]
    assert len(prepared.warnings) == len(coarse) == (path.name == "gasket_seal.toml")
    assert describe(case, prepared)


def test_quantities_become_si(data):
    case = parse_case(data)
    assert case.load.loading[:2] == (25e6, 50e6)
    assert case.law == PerfectlyPlastic(2.8e9)
    assert_allclose(case.modulus, 210e9 / (2 * 0.91))
    assert case.echo()["face"][0]["size"] == [240e-6, 480e-6]
    assert "nose_radius" not in case.echo()["face"][0]  # nothing that was not given
    del data["counter_material"]
    assert_allclose(parse_case(data).modulus, 210e9 / 0.91)  # against a rigid flat


def test_values_at_their_limits_are_taken(data):
    data["face"] |= {
        "hurst": 1,
        "roughness": "0 m",
        "feed_error": 0,
        "depth_error": 1,
        "waviness": "0 um",
    }
    data["material"] |= {"poisson": 0.5}
    data["load"]["loading"] = ["0 Pa", "2.79999 GPa"]
    data["load"]["unloading"] = ["0 Pa"]
    data["fluid"]["outlet_pressure"] = "0 bar"
    data["stochastic"] |= {"quantiles": [0, 1], "realisations": 2}
    case = parse_case(data)
    assert case.load.loading == (0.0, 2.79999e9)
    assert case.stochastic.quantiles == (0.0, 1.0)


@pytest.mark.parametrize("kind", FLUIDS)
def test_every_registered_fluid_can_be_chosen(data, kind):
    """Its parameters are keys, in their unit, with the range and the default of the class."""
    of_class = {f.name: f for f in fields(FLUIDS[kind])}
    given = {"kind": kind, "inlet_pressure": "2 bar"}
    if "name" in of_class:
        pytest.importorskip("CoolProp", reason="the extra femseal[fluids] is not installed")
        given["name"] = "nitrogen"
    declared = {name: f for name, f in of_class.items() if "allowed" in f.metadata}
    for name, f in declared.items():
        given[name] = f.metadata["allowed_example"]

    def fluid(table):
        return parse_case(data | {"fluid": table}).fluid

    expected = {name: to_si(given[name], f.metadata["unit"]) for name, f in declared.items()}
    expected |= {"name": given["name"]} if "name" in given else {}
    assert fluid(given).fluid == FLUIDS[kind](**expected)
    assert fluid(given).outlet_pressure == FLUIDS[kind].outlet_pressure
    for name, f in declared.items():
        low = f"{f.metadata['above'] - 300:g} {f.metadata['unit']}"
        with pytest.raises(fs.InputError, match=rf"^fluid\.{name}: given '.*such as"):
            fluid(given | {name: low})
        without = {key: value for key, value in given.items() if key != name}
        if f.default is MISSING:
            with pytest.raises(fs.InputError, match=f"^fluid.{name}: given nothing"):
                fluid(without)
        else:
            assert getattr(fluid(without).fluid, name) == f.default


def test_a_fluid_by_its_name(data):
    data["fluid"] = {"name": "Helium", "inlet_pressure": "5 bar", "slip": False}
    case = parse_case(data)
    assert case.fluid.fluid == fs.IdealGas(19.62e-6, 4.0026e-3, 293.15, slip=False)
    assert case.fluid.outlet_pressure == 101_325
    assert case.echo()["fluid"]["name"] == "Helium"
    data["fluid"] = {"name": "water", "inlet_pressure": "5 bar", "viscosity": "2 mPa*s"}
    assert parse_case(data).fluid.fluid == fs.Liquid(2e-3, 998.21)
    data["fluid"] |= {"kind": "roelands-liquid", "pressure_viscosity": "1 1/GPa"}
    assert parse_case(data).fluid.fluid == fs.RoelandsLiquid(2e-3, 1e-9, 998.21)


@pytest.mark.parametrize("method", ["deterministic", "two-scale", "stochastic", "auto"])
def test_face_material_load_and_fluid_are_a_case(data, method):
    """Two scales get cells of eight shortest waves or more a side, seals two a side and the length of the face."""
    face = data["face"] | {"points": [128, 200], "size": ["60 um", "90 um"]}
    tables = {key: data[key] for key in ("material", "load", "fluid")}
    prepared = prepare(parse_case(tables | {"face": face, "method": method}))
    assert prepared.cells == {"two-scale": (2, 3), "stochastic": (2, 3)}.get(method)
    if method == "stochastic":
        assert prepared.sampling.length == pytest.approx(90e-6)
        assert prepared.sampling.realisations is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("yield_stress", "yeild_stress", "yeild_stress: .*perhaps meant: yield_stress (line LINE)"),
        ('"12 mm"', '"12,5 mm"', "no comma (line LINE)"),
        ('"1 mPa*s"', "1 mPa*s  # water", '; perhaps meant: viscosity = "1 mPa*s"'),
        ("poisson = 0.3", "poisson = 0,3", "; perhaps meant: poisson = 0.3"),
        ("poisson = 0.3", "poisson = .3", "; perhaps meant: poisson = 0.3"),
        ("poisson = 0.3", "poisson = 0.3\npoisson = 0.3", "Cannot overwrite a value.*"),
        ('pitch = "60 um"\n', "", 'pitch: given nothing, .* such as pitch = "60 um".*'),
        ("[fluid]", "[test_fluid]", 'fluid: missing, .* such as\n[fluid]\nkind = "liquid".*'),
        (EXAMPLE, "a = [", ".*TOML.*"),
    ],
)
def test_faults_of_a_file_say_their_line_and_what_may_be_meant(tmp_path_factory, old, new, said):
    path, text = tmp_path_factory.mktemp("case") / "case.toml", EXAMPLE.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    line = next((n for n, line in enumerate(text.splitlines(), 1) if new in line), 0)
    said = ".*".join(map(re.escape, said.replace("LINE", str(line)).split(".*")))
    with pytest.raises(fs.InputError, match=rf"(?ms){said}$"):
        fs.load_case(path)


def test_files_of_a_case(tmp_path, data, monkeypatch):
    """A case may begin with the mark of its encoding; paths are relative to it, and told as a whole."""
    path = tmp_path / "case.toml"
    path.write_text(EXAMPLE, encoding="utf-8-sig")
    assert fs.load_case(path).echo() == parse_case(data).echo()
    with pytest.raises(fs.InputError, match="read"):
        fs.load_case(tmp_path / "none.toml")
    with pytest.raises(fs.InputError, match=re.escape(f"none is at {tmp_path / 'face.npy'}")):
        parse_case(data | {"face": {"path": "face.npy"}}, tmp_path)
    measured = ROOT / "examples" / "measured_seal.toml"
    path.write_text(measured.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(ROOT / "examples")  # where the face lies, but not the case
    with pytest.raises(fs.InputError, match=r"measured_face\.x3p"):
        fs.load_case(path)
    monkeypatch.chdir(tmp_path)
    assert prepare(fs.load_case(measured)).conditioning.shape_before == (300, 600)


def test_one_value_is_that_of_both_axes_and_a_face_with_a_path_is_of_the_kind_file(data, tmp_path):
    np.save(tmp_path / "face.npy", np.zeros((4, 4)))
    face = {"path": "face.npy", "spacing": "2 um", "periodic": True}
    case = parse_case(data | {"face": face, "contact": {"boundary": "free"}}, tmp_path)
    (read,) = case.face
    assert (read.kind, read.spacing, read.periodic) == ("file", (2e-6, 2e-6), (True, True))
    assert case.contact.boundary == ("free", "free")
    with pytest.raises(fs.InputError, match=r"^face.spacing: given '2 um\^2'.* or a list of two$"):
        parse_case(data | {"face": face | {"spacing": "2 um^2"}}, tmp_path)


class TestPrepare:
    """What was written reaches the studies."""

    @pytest.fixture
    def small(self, data):
        data["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
        data["cells"] = {"count": [2, 4]}
        return data

    def test_scene(self, small):
        small |= {"contact": {"boundary": ["mirror", "periodic"], "rtol": 1e-7}, "seed": 9}
        small["fluid"] |= {"pressure_viscosity": "20 1/GPa", "density": "870 kg/m^3"}
        small |= {"flow": {"solver": "amg"}, "stochastic": {"length": "3 mm", "realisations": 7}}
        prepared = prepare(parse_case(small))
        scene = prepared.scene
        assert scene.boundary == ("mirror", "periodic")
        assert (scene.rtol, scene.solver) == (1e-7, "amg")
        assert scene.fluid == fs.Liquid(viscosity=1e-3, density=870, pressure_viscosity=2e-8)
        assert (scene.inlet_pressure, scene.outlet_pressure) == (1e6, 0.1e6)
        assert scene.loading[-1] == 500e6
        assert scene.unload_from == (250e6, 500e6)
        assert scene.unloading[-1] == 25e6
        assert (scene.modulus, scene.law) == (parse_case(small).modulus, PerfectlyPlastic(2.8e9))
        assert prepared.sampling == Sampling(length=3e-3, realisations=7, seed=9)
        alone = prepare(parse_case(small | {"method": "deterministic", "compare": []}))
        assert alone.sampling is alone.cells is None

    def test_flow_and_shape(self, small):
        case = parse_case(small)
        layout = prepare(case).scene.layout
        tiles = layout.lay_out(CellSize((0.5e-3, 1e-3), 2, length=3e-3))
        assert (tiles.grid, tiles.in_order) == ((2, 3), True)
        assert_allclose(tiles.seal.size, (1e-3, 3e-3))
        other = parse_case(
            small | {"flow": {"solver": "amg"}, "seal": {"kind": "rectangular", "lay": "x2"}}
        )
        assert prepare(other).scene.layout == layout
        # results from another solver are not those of this case
        assert case.echo()["flow"] != other.echo()["flow"]
        assert case.echo()["seal"] == other.echo()["seal"] == {"kind": "rectangular", "lay": "x2"}

    def test_face_and_seed(self, small):
        """As made by hand with the streams of the seed, and flat; another seed, another face."""
        small["face"] |= {"waviness": "0.3 um", "waviness_length": "20 um", "nose_radius": "0.1 mm"}
        given = {
            "pitch": 30e-6,
            "depth": 2.5e-6,
            "feed_error": 0.03,
            "depth_error": 0.1,
            "roughness": 0.8e-6,
            "roughness_roll_off": 36e-6,
            "waviness": 0.3e-6,
            "waviness_length": 20e-6,
            "nose_radius": 1e-4,
        }

        def heights(seed):
            return prepare(parse_case(small | {"seed": seed})).scene.surface.heights

        (stream,) = np.random.SeedSequence(9).spawn(1)
        face = fs.turned((64, 96), (60e-6, 120e-6), rng=np.random.default_rng(stream), **given)
        expected = face.detrend(0).low_pass(8 * 1.25e-6).heights
        assert_allclose(heights(9), expected, atol=1e-12)
        assert not np.allclose(heights(10), expected, atol=1e-8)

    def test_two_faces_are_summed_and_drawn_apart(self, small):
        face = {
            "kind": "self-affine",
            "points": [64, 96],
            "size": ["60 um", "120 um"],
            "rms_height": "0.1 um",
            "roll_off": "20 um",
        }
        one, both = (
            prepare(parse_case(small | {"face": faces, "surface": {"detrend": 0}})).scene.surface
            for faces in (face, [face, face])
        )
        # the other one is as rough, and not the same
        rest = both.heights - one.heights
        assert_allclose([one.rms_height, rest.std()], 0.1e-6, rtol=1e-6)
        assert abs(np.corrcoef(rest.ravel(), one.heights.ravel())[0, 1]) < 0.3

    def test_surface(self, small):
        def prepared(detrend):
            conditions = {"detrend": detrend, "shortest_wave": "15 um", "points": [48, 90]}
            return prepare(parse_case(small | {"surface": conditions}))

        curved, level = prepared(0), prepared(2)
        assert level.scene.surface.shape == level.surface_report["shape"] == (48, 90)
        assert level.conditioning.shortest_wave == 15e-6
        assert level.conditioning.removed_curvature != curved.conditioning.removed_curvature

    @pytest.mark.parametrize(
        ("table", "cells"),
        [
            ({"size": "25 um"}, (2, 5)),  # 60 and 120 µm: 2.4 and 4.8
            ({"size": "60 um"}, (1, 2)),
            ({"count": [3, 6]}, (3, 6)),  # of two shortest waves, 20 µm
        ],
    )
    def test_cells(self, data, table, cells):
        data["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
        assert prepare(parse_case(data | {"cells": table})).cells == cells

    def test_a_seal_may_be_one_cell_long(self, small):
        small |= {"cells": {"count": [1, 4]}, "stochastic": {"length": "30 um"}}
        assert prepare(parse_case(small)).sampling.length == 30e-6


def test_the_template_shows_every_key():
    shown = {
        *re.findall(r"\b(\w+) = ", TEMPLATE),
        *re.findall(r"^(?:# )?\[(?:\w+\.)?(\w+)\]", TEMPLATE, re.MULTILINE),
    }
    keys = {
        name
        for table in case_schema()["definitions"].values()
        for name in table.get("properties", {})
    }
    keys |= set(case_schema()["properties"])
    assert keys - shown == set()


def test_what_the_template_comments_out_is_valid_table_by_table(tmp_path):
    for name in re.findall(r'(?:path|mask) = "(.*?)"', TEMPLATE):
        (tmp_path / name).touch()
    cases = list(template_cases())
    assert len(cases) > 30
    for case in cases:
        if case["fluid"]["kind"] != "real-gas" or find_spec("CoolProp"):
            parse_case(case, tmp_path)


def test_a_file_is_read_as_the_case_says(tmp_path, data):
    """Transposed, in its unit, its holes filled up to the share given."""
    face = fs.self_affine((96, 64), (96e-6, 64e-6), hurst=0.8, rms_slope=0.1, cut_off=16e-6, rng=0)
    heights = face.heights * 1e6
    heights[:2] = np.nan
    np.savez(tmp_path / "face.npz", z=heights, other=np.zeros((2, 2)))
    data["face"] = {
        "kind": "file",
        "path": "face.npz",
        "array": "z",
        "spacing": ["1 um", "1 um"],
        "height_unit": "um",
        "transpose": True,
    }
    data |= {"cells": {"count": [2, 3]}, "surface": {"max_undefined": 0.03, "detrend": 0}}
    prepared = prepare(parse_case(data, tmp_path))
    assert prepared.scene.surface.shape == (64, 96)
    assert_allclose(prepared.conditioning.undefined_fraction, 2 / 96)
    assert_allclose(prepared.scene.surface.rms_height, np.nanstd(heights) * 1e-6, rtol=0.1)
    data["surface"]["max_undefined"] = 0.02
    with pytest.raises(fs.InputError, match="max_undefined"):
        prepare(parse_case(data, tmp_path))


@pytest.fixture
def masked(tmp_path, data):
    """A measured face whose last rows and columns lie under a mask."""
    face = fs.self_affine(
        (120, 140), (120e-6, 140e-6), hurst=0.8, rms_slope=0.1, cut_off=9e-6, rng=1
    )
    np.savez(tmp_path / "face.npz", z=face.heights, spacing=face.spacing)
    mask = np.zeros(face.shape)
    mask[100:], mask[:, 120:] = 1, 2
    np.savetxt(tmp_path / "mask.txt", mask.T, "%d")
    for name in ("bad.npy", "face.npz.npy"):
        (tmp_path / name).write_text("no numbers")
    data["face"] = {"kind": "file", "path": "face.npz", "mask": "mask.txt"}
    data["cells"] = {"count": [1, 1]}
    return data


CROPPED = {"crop": ["10 um", "100 um", "0 um", "120 um"]}


SPACED = {"path": "mask.txt", "spacing": ["1 um", "1 um"]}


def test_a_face_is_masked_and_cropped_as_the_case_says(tmp_path, masked):
    """Results of another mask are those of another case."""
    masked["face"] |= CROPPED
    case = parse_case(masked, tmp_path)
    assert_allclose(prepare(case).scene.surface.size, (90e-6, 120e-6), rtol=0.03)
    before = face_files(case)
    assert set(before) == {"face.npz", "mask.txt"}
    np.savetxt(tmp_path / "mask.txt", np.zeros((140, 120)), "%d")
    assert face_files(case)["mask.txt"] != before["mask.txt"]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, "^face: given [0-9.]+ % undefined points, expected at most 5 %: crop"),
        ({"crop": ["0 um", "1 mm", "0 um", "9 um"]}, r"^face\.crop: given"),
        (CROPPED | {"mask": "none.png"}, r"^face\.mask: given"),
        (CROPPED | SPACED | {"file_mask": False}, r"^face\.file_mask: given"),
        (CROPPED | {"path": "bad.npy"}, r"^face\.path, .*bad.npy: given"),
        (CROPPED | {"mask": "bad.npy"}, r"^face\.mask, .*bad.npy: given"),
        (CROPPED | {"mask": "face.npz.npy"}, r"^face\.mask, .*face.npz.npy: given"),
        ({"crop": ["0 um", "10 um"]}, r"face\.crop"),
        ({"crop": ["-1 um", "10 um", "0 um", "9 um"]}, r"face\.crop"),
        ({"crop": "10 um"}, r"face\.crop"),
        ({"crop": [["0 um", "1 um"], ["0 um", "9 um"]]}, r"face\.crop: .* a list of four lengths"),
        ({"channel": -1}, r"face\.channel"),
        ({"channel": ""}, r"face\.channel"),
        ({"channel": True}, r"face\.channel"),
        ({"file_mask": "maybe"}, r"face\.file_mask"),
    ],
)
def test_masks_and_crops_that_there_are_not(tmp_path, masked, keys, said):
    with pytest.raises(fs.InputError, match=said):
        prepare(parse_case(masked | {"face": masked["face"] | keys}, tmp_path))


def test_spikes_along_the_lay_are_a_warning_of_the_case(tmp_path, data):
    x1 = np.indices((128, 96))[0]
    rng = np.random.default_rng(3)
    z = 1e-7 * np.cos(2 * np.pi * x1 / 16) + 1e-9 * rng.standard_normal(x1.shape)
    z[(np.abs(x1 - 60) < 5) & (rng.random(z.shape) < 0.06)] += 3e-6
    np.savez(tmp_path / "face.npz", z=z, spacing=(1e-6, 1e-6))
    face = {"kind": "file", "path": "face.npz"}
    data["cells"] = {"count": [1, 1]}
    for spikes, faces, told in ((6, face, True), (6, [face, face], True), (np.inf, face, False)):
        case = parse_case(data | {"face": faces, "surface": {"spikes": spikes}}, tmp_path)
        assert any("surface.spikes = inf" in text for text in prepare(case).warnings) == told


@pytest.fixture
def two_faces(tmp_path, data):
    """Two measured faces, a spike and an undefined point in each, the second on a grid of its own."""
    for name, shape, seed in (("lower", (96, 128), 1), ("upper", (120, 160), 2)):
        face = fs.self_affine(
            shape, (96e-6, 128e-6), hurst=0.8, rms_slope=0.1, cut_off=9e-6, rng=seed
        )
        heights = face.heights.copy()
        heights[10, 12], heights[50, 60] = 1e-4, np.nan
        np.savez(tmp_path / f"{name}.npz", z=heights, spacing=face.spacing)
    data["face"] = [{"kind": "file", "path": f"{name}.npz"} for name in ("lower", "upper")]
    data["cells"] = {"count": [2, 3]}
    return data


def test_a_second_face_is_laid_on_the_first(tmp_path, two_faces):
    two_faces["face"][1] |= {"mirror": "x2", "rotate": "90 deg", "shift": ["10 um", "-5 um"]}
    prepared = prepare(parse_case(two_faces, tmp_path))
    lower, upper = (
        repair(fs.read_topography(tmp_path / f"{n}.npz"))[0] for n in ("lower", "upper")
    )
    both, overlap = fs.combine(lower, upper, mirror="x2", rotate=np.pi / 2, shift=(10e-6, -5e-6))
    shape = tuple(-(-n // c) * c for n, c in zip(both.shape, (2, 3), strict=True))
    expected, _ = fs.condition(both, shape=shape)
    assert_allclose(prepared.scene.surface.heights, expected.heights, atol=1e-12)
    assert prepared.overlap == overlap
    assert 0.5 < overlap.fraction < 0.8
    assert prepared.surface_report["overlap"]["shape"] == overlap.shape
    # of both faces
    holes = (1 / (96 * 128) + 1 / (120 * 160)) / 2
    assert prepared.conditioning.spike_points == 2
    assert_allclose(prepared.conditioning.undefined_fraction, holes)


@pytest.mark.parametrize(
    ("face", "keys", "said"),
    [
        (
            0,
            {"shift": ["1 um", "0 um"]},
            r"face\.0: given shift, expected no such keys in the table of the first face, only in the table of the second face",
        ),
        (1, {"mirror": "x3"}, r"face\.1\.mirror"),
        (1, {"rotate": 90}, r"face\.1\.rotate"),
        (1, {"rotate": "1 um"}, r"face\.1\.rotate"),
        (1, {"shift": ["1 um"]}, r"face\.1\.shift"),
        (1, {"shift": ["1 mm", "0 um"]}, "shift: given 1 mm"),
        (1, {"path": "holes.npz"}, r"^face\.1: given 33.3 % undefined points.*: crop the map"),
    ],
)
def test_only_a_second_face_that_meets_the_first_is_placed(tmp_path, two_faces, face, keys, said):
    with np.load(tmp_path / "upper.npz") as stored:
        z = np.where(np.arange(120)[:, None] < 80, stored["z"], np.nan)
        np.savez(tmp_path / "holes.npz", z=z, spacing=stored["spacing"])
    faces = list(two_faces["face"])
    faces[face] = faces[face] | keys
    with pytest.raises(fs.InputError, match=said):
        prepare(parse_case(two_faces | {"face": faces}, tmp_path))


def test_spikes_of_files_are_filled_unless_left_alone(tmp_path, two_faces):
    filled, left = (
        prepare(
            parse_case(
                two_faces | {"face": two_faces["face"][:1], "surface": {"spikes": spikes}}, tmp_path
            )
        ).conditioning
        for spikes in (6.0, np.inf)
    )
    assert (filled.spike_points, left.spike_points) == (1, 0)
    assert left.rms_slope_before > 1
