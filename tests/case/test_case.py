"""Case files: every fault is reported with its key, what was given and what is allowed; good ones are prepared."""

import re
import tomllib
from dataclasses import MISSING, dataclass, fields
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from each import each
from numpy.testing import assert_allclose
from pydantic import TypeAdapter, ValidationError
from small_cases import template_cases

import femseal as fs
from femseal.base.quantities import to_si
from femseal.base.validate import parameter
from femseal.case.case import Case, parse_case
from femseal.case.case_tables import ContactTable
from femseal.case.fault_report import case_faults
from femseal.case.schema import case_schema
from femseal.case.template import case_template
from femseal.case.values import Length, Table, key, table_of_any
from femseal.contact import PerfectlyPlastic
from femseal.fluids import FLUIDS
from femseal.preparation.preparation import prepare
from femseal.runs.forecast import describe
from femseal.seal.tiles import PieceSize
from femseal.studies import Sampling
from femseal.topography import repair

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "examples").glob("*.toml"))
TEMPLATE = case_template(Case)


@pytest.fixture
def data():
    return tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", CASES, ids=lambda p: p.name)
def test_shipped_cases_are_valid_and_forecast(path):
    case = fs.load_case(path)
    prepared = prepare(case)
    assert prepared.scene.surface.rms_height > 0
    words = [line.split()[0] for line in describe(case, prepared)]
    # the first attempt is deterministic, which has no pieces
    divided = {"accuracy"} if case.accuracy else {"pieces"} if case.cells else set()
    assert {"case", "surface", "filter", "load", "expected", "disk"} | divided <= set(words)


def test_quantities_become_si(data):
    case = parse_case(data)
    assert case.load.loading[:2] == (25e6, 50e6)
    assert case.law == PerfectlyPlastic(2.8e9)
    assert_allclose(case.modulus, 210e9 / (2 * 0.91))
    assert case.echo()["face"][0]["size"] == [240e-6, 480e-6]
    assert "nose_radius" not in case.echo()["face"][0]  # nothing that was not given
    del data["counter_material"]
    assert_allclose(parse_case(data).modulus, 210e9 / 0.91)  # against a rigid flat


@pytest.mark.parametrize(
    ("table", "key", "value", "words"),
    [
        ("face", "pitch", "1,5 um", ["face.pitch", "'1,5 um'", "comma"]),
        ("face", "pitch", "-1 um", ["face.pitch", "'-1 um'", "> 0"]),
        ("face", "pitch", 60, ["face.pitch", "60", "unit"]),
        ("face", "pitch", "60 MPa", ["face.pitch", "60 MPa"]),
        ("face", "picth", "60 um", ["face.picth", "an unknown key", "pitch"]),
        ("load", "loading", [], ["load.loading", "[]", "at least one"]),
        ("load", "loading", ["2 MPa", "1 MPa"], ["load", "rising"]),
        ("load", "loading", ["3 GPa"], ["load", "3 GPa", "below the hardness", "2.8 GPa"]),
        ("load", "unloading", [], ["load", "both, or neither"]),
        (
            "load",
            "interpolate",
            "1 %",
            ["load.interpolate: given '1 %', expected none: removed; every load is solved"],
        ),
        (
            "surface",
            "filter_sensitivity",
            True,
            ["surface.filter_sensitivity: given True", "removed; the row"],
        ),
        ("fluid", "kind", "water", ["fluid.kind", "'water'", "liquid"]),
        ("fluid", "viscosity", "1 Pa", ["fluid.viscosity", "1 Pa"]),
        ("cells", "count", [8.5, 2], ["cells.count.0", "8.5", "whole number"]),
        (
            "stochastic",
            "sampler",
            "runs",
            ["stochastic.sampler: given 'runs', expected none: removed; each tile"],
        ),
        (
            "stochastic",
            "library",
            "kept",
            ["stochastic.library: given 'kept', expected none: removed"],
        ),
        (
            "stochastic",
            "library_cells",
            4,
            ["stochastic.library_cells: given 4, expected none: removed"],
        ),
        (
            "stochastic",
            "width",
            0.1,
            ["stochastic.width: given 0.1, expected none: removed; seals are drawn until"],
        ),
        ("stochastic", "bounds", True, ["stochastic.bounds", "removed; the band of error"]),
        ("stochastic", "length", ["1 mm", "2 mm"], ["stochastic.length", "a number and a unit"]),
        ("stochastic", "quantiles", [0.9, 0.1], ["stochastic", "rising"]),
        ("material", "hardness", "1 GPa", ["material", "not both"]),
        ("material", "young", "0 GPa", ["material.young", "> 0"]),
        ("material", "poisson", 0.51, ["material.poisson", "0.51", "at most 0.5"]),
        ("material", "poisson", -1, ["material.poisson", "above -1"]),
        ("face", "hurst", 0, ["face.hurst", "above 0"]),
        ("face", "roughness", "-1 nm", ["face.roughness", ">= 0"]),
        ("face", "feed_error", 1.1, ["face.feed_error", "from 0 to 1"]),
        ("face", "points", [0, 4], ["face.points.0", "greater than or equal to 1"]),
        ("load", "loading", ["1 MPa", "1 MPa"], ["load", "rising"]),
        ("load", "loading", ["2.8 GPa"], ["load", "2.8 GPa", "below the hardness"]),
        ("load", "unload_from", ["4 GPa"], ["load", "4 GPa", "below the hardness"]),
        (
            "load",
            "unload_from",
            ["25 MPa"],
            ["load", "a pressure in `unloading` below the peak 25 MPa"],
        ),
        ("fluid", "inlet_pressure", "-1 Pa", ["fluid.inlet_pressure", ">= 0"]),
        ("cells", "size", "30 um", ["cells", "one of `count` and `size`"]),
        ("stochastic", "quantiles", [0.5, 0.5], ["stochastic", "rising"]),
        (
            "stochastic",
            "realisations",
            1,
            ["stochastic.realisations", "greater than or equal to 2"],
        ),
        (
            "stochastic",
            "pressure",
            "magic",
            ["stochastic.pressure", "removed; pieces lie in the contact of the whole face"],
        ),
        (
            "flow",
            "solver",
            "magic",
            ["flow.solver", "'magic'", "'auto', 'multigrid', 'elimination' or 'amg'"],
        ),
        ("flow", "rtol", 1e-3, ["flow.rtol", "given an unknown key, expected solver"]),
        ("seal", "kind", "square", ["seal.kind", "'square'", "'rectangular'"]),
        (
            "seal",
            "radius",
            "1 mm",
            ["seal.radius", "given an unknown key, expected kind, form, flatness, lay"],
        ),
    ],
)
def test_faults_name_key_value_and_what_is_allowed(data, table, key, value, words):
    data["flow"] = {}
    data["surface"] = {}
    data["cells"] = {"count": [4, 8]}
    data.setdefault(table, {"kind": "rectangular"})[key] = value
    with pytest.raises(fs.InputError) as caught:
        parse_case(data)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


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
    parameters = {f.name: f for f in fields(FLUIDS[kind]) if "allowed" in f.metadata}
    examples = {
        name: re.search("'(.*)'", f.metadata["allowed"])[1] for name, f in parameters.items()
    }
    named = {"name": "nitrogen"} if "name" in (f.name for f in fields(FLUIDS[kind])) else {}
    if named:
        pytest.importorskip("CoolProp", reason="the extra femseal[fluids] is not installed")
    data["fluid"] = {"kind": kind, "inlet_pressure": "2 bar", **named, **examples}
    case = parse_case(data)
    expected = {
        name: to_si(text, parameters[name].metadata["unit"]) for name, text in examples.items()
    } | named
    assert case.fluid.fluid == FLUIDS[kind](**expected)
    assert case.fluid.outlet_pressure == FLUIDS[kind].outlet_pressure
    for name, declared in parameters.items():
        low = f"{declared.metadata['above'] - 300:g} {declared.metadata['unit']}"
        with pytest.raises(
            fs.InputError, match=rf"^fluid\.{name}: given '{re.escape(low)}', expected a .*such as"
        ):
            parse_case({**data, "fluid": data["fluid"] | {name: low}})
        without = {key: value for key, value in data["fluid"].items() if key != name}
        if declared.default is MISSING:
            with pytest.raises(
                fs.InputError,
                match=f"^fluid.{name}: given nothing, expected a value for this key(, such as {name} = .+)?$",
            ):
                parse_case({**data, "fluid": without})
        else:
            assert (
                getattr(parse_case({**data, "fluid": without}).fluid.fluid, name)
                == declared.default
            )


def test_a_registered_class_has_a_table_without_another_line():
    @dataclass(frozen=True)
    class Grease:
        """A grease."""

        yield_stress: float = parameter("Pa", "a stress >= 0, such as '40 Pa'", inclusive=True)
        grade: int = 2

    table = TypeAdapter(table_of_any({**FLUIDS, "grease": Grease}, Table))
    read = table.validate_python({"kind": "grease", "yield_stress": "0 Pa"})
    assert read.model_dump() == {"kind": "grease", "yield_stress": 0.0, "grade": 2}
    with pytest.raises(ValidationError, match="such as '40 Pa'"):
        table.validate_python({"kind": "grease", "yield_stress": "-1 Pa"})
    assert "GreaseTable" in table.json_schema()["$defs"]


def test_slip_of_a_gas_is_a_switch(data):
    data["fluid"] = {
        "kind": "ideal-gas",
        "viscosity": "18 uPa*s",
        "molar_mass": "29 g/mol",
        "temperature": "20 °C",
        "inlet_pressure": "5 bar",
    }
    assert parse_case(data).fluid.fluid.slip is True
    data["fluid"]["slip"] = False
    assert parse_case(data).fluid.fluid.slip is False
    data["fluid"]["slip"] = "maybe"
    with pytest.raises(fs.InputError, match=r"^fluid\.slip: given 'maybe', expected true or false"):
        parse_case(data)


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


@pytest.mark.parametrize(
    ("fluid", "words"),
    [
        ({"name": "grease"}, ["fluid.name: given 'grease'", "one of water, mineral oil"]),
        ({"name": 3}, ["fluid.name: given 3", "one of water, mineral oil"]),
        (
            {"name": "mineral oil ISO VG 46", "temperature": "90 °C"},
            ["fluid.name", "at 90 °C", "20 °C"],
        ),
        (
            {"name": "air", "temperature": "90"},
            ["fluid.temperature: given '90'", "such as '20 °C'"],
        ),
        ({"name": "air", "kind": "grease"}, ["fluid.kind: given 'grease'", "'ideal-gas'"]),
        ({"name": "air", "colour": "blue"}, ["fluid.colour: given an unknown key", "name"]),
    ],
)
def test_names_of_fluids_that_there_are_not(data, fluid, words):
    data["fluid"] = {"inlet_pressure": "5 bar", **fluid}
    with pytest.raises(fs.InputError) as caught:
        parse_case(data)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_table_that_is_missing_is_shown_as_text_to_paste(data):
    with pytest.raises(
        fs.InputError, match=r'fluid: missing, expected a table such as\n\[fluid\]\nkind = "liquid"'
    ):
        parse_case({k: v for k, v in data.items() if k != "fluid"})


@each("method", ["deterministic", "two-scale", "stochastic", "auto"])
def test_face_material_load_and_fluid_are_a_case(data, method):
    """Two scales get pieces of eight shortest waves or more a side, seals two a side and the length of the face."""
    face = data["face"] | {"points": [128, 200], "size": ["60 um", "90 um"]}
    case = parse_case(
        {key: data[key] for key in ("material", "load", "fluid")} | {"face": face, "method": method}
    )
    prepared = prepare(case)
    assert prepared.cells == {"two-scale": (2, 3), "stochastic": (2, 3)}.get(method)
    if method == "stochastic":
        assert (prepared.sampling.length, prepared.sampling.realisations) == (
            pytest.approx(90e-6),
            None,
        )
    lines = "\n".join(describe(case, prepared))
    assert ("as many as the band of error needs" in lines) == (method == "stochastic")


def test_faults_of_a_file_say_line_and_the_key_that_is_meant(tmp_path):
    text = (ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8")
    path = tmp_path / "case.toml"
    path.write_text(
        text.replace("yield_stress", "yeild_stress", 1).replace('"12 mm"', '"12,5 mm"'),
        encoding="utf-8",
    )
    lines = path.read_text(encoding="utf-8").splitlines()
    typo, comma = (
        next(n for n, line in enumerate(lines, 1) if word in line) for word in ("yeild", "12,5")
    )
    with pytest.raises(fs.InputError) as error:
        fs.load_case(path)
    first, second = str(error.value).splitlines()
    assert first.startswith("material.yeild_stress: given an unknown key, expected young, poisson")
    assert first.endswith(f"; perhaps meant: yield_stress (line {typo})")
    assert second.endswith(f"not a comma: '12.5 mm' (line {comma})")


@pytest.mark.parametrize(
    ("old", "new", "meant"),
    [
        ('viscosity = "1 mPa*s"', "viscosity = 1 mPa*s  # water", 'viscosity = "1 mPa*s"'),
        ("poisson = 0.3", "poisson = 0,3", "poisson = 0.3"),
        ("poisson = 0.3", "poisson = .3", "poisson = 0.3"),
        (
            "poisson = 0.3",
            "poisson = “0.3”  # typed in a letter",
            'poisson = "0.3"  # typed in a letter',
        ),
    ],
)
def test_values_without_quotes_or_with_a_comma_are_shown_as_they_may_be_meant(
    tmp_path, old, new, meant
):
    text = (ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8")
    (tmp_path / "case.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(fs.InputError, match=rf"; perhaps meant: {re.escape(meant)}$"):
        fs.load_case(tmp_path / "case.toml")


@pytest.mark.parametrize(
    ("table", "key", "meant"),
    [
        ("cells", "solver", "flow"),
        ("fluid", "loading", "load"),
        ("cells", "young", "material"),
        ("", "hurst", "face"),
    ],
)
def test_a_key_of_another_table_is_said_to_be_there(data, table, key, meant):
    (data.setdefault(table, {}) if table else data)[key] = 1
    with pytest.raises(
        fs.InputError,
        match=rf"{key}: given an unknown key, .*; perhaps meant: {key} in \[{meant}\]",
    ):
        parse_case(data)


@pytest.mark.parametrize(
    ("table", "key", "kinds"),
    [
        ("face", "shift", "'file'"),
        ("fluid", "molar_mass", "'ideal-gas'"),
        ("seat", "radius", "'crowned' or 'ball-on-cone'"),
    ],
)
def test_a_key_of_another_kind_of_the_table_is_said_to_be_of_that(data, table, key, kinds):
    data.setdefault(table, {"kind": "flat"})[key] = 1
    with pytest.raises(
        fs.InputError,
        match=rf"{table}\.{key}: given an unknown key, .*; {key} is a key of kind {kinds}$",
    ):
        parse_case(data)


def test_nothing_is_guessed_for_a_key_that_is_there_twice(tmp_path):
    text = (ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8")
    (tmp_path / "case.toml").write_text(
        text.replace("poisson = 0.3", "poisson = 0.3\npoisson = 0.3"), encoding="utf-8"
    )
    with pytest.raises(
        fs.InputError, match=r"Cannot overwrite a value \(at line \d+, column \d+\)\)$"
    ):
        fs.load_case(tmp_path / "case.toml")


def test_a_case_may_begin_with_the_mark_of_its_encoding(tmp_path, data):
    text = (ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8")
    (tmp_path / "case.toml").write_text(text, encoding="utf-8-sig")
    assert fs.load_case(tmp_path / "case.toml").echo() == parse_case(data).echo()


def test_a_missing_key_is_shown_with_a_value(data):
    del data["face"]["pitch"]
    data["load"]["map"] = {"kind": "field", "path": "flange.vtu", "length_unit": "mm"}
    with pytest.raises(fs.InputError) as error:
        parse_case(data)
    assert str(error.value).splitlines() == [
        'face.pitch: given nothing, expected a value for this key, such as pitch = "60 um"',
        'load.map.pressure_unit: given nothing, expected a value for this key, such as pressure_unit = "MPa"',
    ]


def test_one_value_is_that_of_both_axes(data, tmp_path):
    np.save(tmp_path / "face.npy", np.zeros((4, 4)))
    face = {"path": "face.npy", "spacing": "2 um", "periodic": True}
    case = parse_case(data | {"face": face, "contact": {"boundary": "free"}}, tmp_path)
    assert (case.face[0].spacing, case.face[0].periodic) == ((2e-6, 2e-6), (True, True))
    assert case.contact.boundary == ("free", "free")
    with pytest.raises(
        fs.InputError, match=r"^face.spacing: given '2 um\^2', expected .* or a list of two$"
    ):
        parse_case(data | {"face": face | {"spacing": "2 um^2"}}, tmp_path)


def test_a_file_that_is_not_there_is_shown_with_its_whole_path(data, tmp_path):
    with pytest.raises(fs.InputError, match=re.escape(f"none is at {tmp_path / 'face.npy'}")):
        parse_case(data | {"face": {"path": "face.npy"}}, tmp_path)


def test_a_face_with_a_path_is_of_the_kind_file(data, tmp_path):
    np.save(tmp_path / "face.npy", np.zeros((4, 4)))
    assert parse_case(data | {"face": {"path": "face.npy"}}, tmp_path).face[0].kind == "file"


def test_keys_that_are_no_part_of_a_case(data):
    with pytest.raises(fs.InputError, match="folder: given a value, expected no such key"):
        parse_case({**data, "folder": "elsewhere"})
    with pytest.raises(fs.InputError, match="face"):
        parse_case({**data, "face": [data["face"]] * 3})
    data["fluid"]["colour"] = "blue"
    with pytest.raises(
        fs.InputError,
        match=r"fluid\.colour: given an unknown key, expected kind, viscosity, density, ",
    ) as caught:
        parse_case(data)
    assert "molar_mass" not in str(caught.value)


def test_a_list_with_faulty_items_is_not_called_empty(data):
    data["load"]["loading"] = ["one"]
    with pytest.raises(fs.InputError) as caught:
        parse_case(data)
    assert "at least one" not in str(caught.value)
    assert "load.loading.0" in str(caught.value)


def test_all_faults_are_reported_at_once(data):
    data["seed"] = -1
    data["face"]["depth"] = "no"
    data["extra"] = 1
    with pytest.raises(fs.InputError) as caught:
        parse_case(data)
    assert len(str(caught.value).splitlines()) == 3


@pytest.mark.parametrize(
    ("table", "value", "words"),
    [
        ("cells", {"count": [64, 64]}, ["cells", "8 × 8 points"]),
        ("cells", {"count": [18, 36]}, ["cells", "two shortest waves"]),
        ("stochastic", {"length": "1 um"}, ["stochastic.length", "1 µm", "at least one piece"]),
    ],
)
def test_cells_and_seals_that_do_not_suit_the_surface(data, table, value, words):
    data[table] = value
    with pytest.raises(fs.InputError) as caught:
        prepare(parse_case(data))
    assert all(word in str(caught.value) for word in words), str(caught.value)


class TestPrepare:
    """What was written reaches the studies."""

    @pytest.fixture
    def small(self, data):
        data["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
        data["cells"] = {"count": [2, 4]}
        return data

    def test_scene(self, small):
        small["contact"] = {"boundary": ["mirror", "periodic"], "rtol": 1e-7}
        small["fluid"] |= {"pressure_viscosity": "20 1/GPa", "density": "870 kg/m^3"}
        scene = prepare(parse_case(small)).scene
        assert scene.boundary == ("mirror", "periodic")
        assert scene.rtol == 1e-7
        assert scene.fluid == fs.Liquid(viscosity=1e-3, density=870, pressure_viscosity=2e-8)
        assert (scene.inlet_pressure, scene.outlet_pressure) == (10e6, 0.1e6)
        assert scene.loading[-1] == 500e6
        assert scene.unload_from == (250e6, 500e6)
        assert scene.unloading[-1] == 25e6
        assert (scene.modulus, scene.law) == (parse_case(small).modulus, PerfectlyPlastic(2.8e9))

    def test_gas(self, small):
        small["fluid"] = {
            "kind": "ideal-gas",
            "viscosity": "18 uPa*s",
            "molar_mass": "29 g/mol",
            "temperature": "20 °C",
            "inlet_pressure": "5 bar",
        }
        scene = prepare(parse_case(small)).scene
        assert scene.fluid == fs.IdealGas(viscosity=18e-6, molar_mass=0.029, temperature=293.15)
        assert (scene.inlet_pressure, scene.outlet_pressure) == (5e5, 101_325)

    def test_flow_and_shape(self, small):
        case = parse_case(small)
        scene = prepare(case).scene
        assert scene.solver == "auto"
        tiles = scene.layout.lay_out(PieceSize((0.5e-3, 1e-3), 2, length=3e-3))
        assert (tiles.grid, tiles.in_place) == ((2, 3), True)
        assert_allclose(tiles.seal.size, (1e-3, 3e-3))
        small["flow"] = {"solver": "amg"}
        small["seal"] = {"kind": "rectangular", "lay": "x2"}
        other = parse_case(small)
        prepared = prepare(other)
        assert prepared.scene.solver == "amg"
        assert prepared.scene.layout == scene.layout
        assert any(line.split() == ["flow", "solver", "amg"] for line in describe(other, prepared))
        # results from another solver are not those of this case
        assert case.echo()["flow"] != other.echo()["flow"]
        assert case.echo()["seal"] == other.echo()["seal"] == {"kind": "rectangular", "lay": "x2"}

    def test_sampling(self, small):
        small["seed"] = 9
        small["stochastic"] = {
            "length": "3 mm",
            "realisations": 7,
        }
        expected = Sampling(length=3e-3, realisations=7, seed=9)
        assert prepare(parse_case(small)).sampling == expected
        small |= {"method": "two-scale", "compare": []}
        assert prepare(parse_case(small)).sampling is None
        small |= {"method": "deterministic"}
        assert prepare(parse_case(small)).cells is None

    def test_face_and_seed(self, small):
        """As made by hand with the streams of the seed, and flat; another seed, another face."""
        small["seed"] = 9
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
        (stream,) = np.random.SeedSequence(9).spawn(1)
        face = fs.turned((64, 96), (60e-6, 120e-6), rng=np.random.default_rng(stream), **given)
        expected = face.detrend(1).low_pass(8 * 1.25e-6).heights
        assert_allclose(prepare(parse_case(small)).scene.surface.heights, expected, atol=1e-12)
        small["seed"] = 10
        assert not np.allclose(
            prepare(parse_case(small)).scene.surface.heights, expected, atol=1e-8
        )

    def test_two_faces_are_summed_and_drawn_apart(self, small):
        face = {
            "kind": "self-affine",
            "points": [64, 96],
            "size": ["60 um", "120 um"],
            "rms_height": "0.1 um",
            "roll_off": "20 um",
        }
        small["face"] = [face, face]
        small["surface"] = {"detrend": 0}
        both = prepare(parse_case(small)).scene.surface
        small["face"] = face
        one = prepare(parse_case(small)).scene.surface
        assert_allclose(one.rms_height, 0.1e-6, rtol=1e-6)
        # the other one is as rough, and not the same
        rest = both.heights - one.heights
        assert_allclose(rest.std(), 0.1e-6, rtol=1e-6)
        assert abs(np.corrcoef(rest.ravel(), one.heights.ravel())[0, 1]) < 0.3

    def test_surface(self, small):
        small["surface"] = {"detrend": 2, "shortest_wave": "15 um", "points": [48, 90]}
        prepared = prepare(parse_case(small))
        assert prepared.scene.surface.shape == (48, 90)
        assert prepared.conditioning.shortest_wave == 15e-6
        small["surface"]["detrend"] = 0
        assert (
            prepared.conditioning.removed_curvature
            != prepare(parse_case(small)).conditioning.removed_curvature
        )
        assert prepared.surface_report["shape"] == (48, 90)

    def test_cells_by_their_size(self, small):
        small["cells"] = {"size": "25 um"}
        assert prepare(parse_case(small)).cells == (2, 5)  # 60 and 120 µm: 2.4 and 4.8
        small["cells"] = {"size": "60 um"}
        assert prepare(parse_case(small)).cells == (1, 2)
        small["cells"] = {"size": "61 um"}
        with pytest.raises(
            fs.InputError, match=r"cells\.size: given 61 µm, expected at most the shorter side"
        ):
            prepare(parse_case(small))

    def test_pieces_hold_two_shortest_waves_both_ways(self, small):
        """10 µm is the shortest: pieces of 20 × 20 µm pass, narrower ones do not."""
        small["cells"] = {"count": [3, 6]}
        assert prepare(parse_case(small)).cells == (3, 6)
        for count in ([4, 6], [3, 7]):
            small["cells"] = {"count": count}
            with pytest.raises(fs.InputError, match="two shortest waves, 20 µm"):
                prepare(parse_case(small))

    def test_a_seal_has_at_least_one_piece(self, small):
        """Along the seal: pieces are 60 µm across and 30 µm along it."""
        small["cells"] = {"count": [1, 4]}
        small["stochastic"]["length"] = "30 um"
        assert prepare(parse_case(small)).sampling.length == 30e-6
        small["stochastic"]["length"] = "29.9 um"
        with pytest.raises(fs.InputError, match="at least one piece, 30 µm"):
            prepare(parse_case(small))


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


def test_a_key_is_declared_once(tmp_path, monkeypatch):
    """A new key of a table is in the schema, in a new case, in messages and on the page of keys."""
    monkeypatch.syspath_prepend(ROOT / "docs" / "extensions")
    from case_keys import write_case_keys

    class Ground(ContactTable):
        """Contact of ground faces."""

        grit: Length = key("size of the grains", example="30 um", since="0.3")

    class NewCase(Case):
        contact: Ground = key("how the faces touch")

    schema = case_schema(NewCase)
    assert schema["definitions"]["Ground"]["properties"]["grit"]["description"].startswith(
        "size of the grains; a length > 0"
    )
    text = case_template(NewCase)
    assert re.search(r'^grit = "30 um" +# size of the grains$', text, re.MULTILINE)
    with pytest.raises(ValidationError) as found:
        NewCase.model_validate(tomllib.loads(text.replace("grit = ", "# grit = ")))
    (fault,) = case_faults(NewCase, found.value)
    assert (fault.what, fault.expected) == (
        "contact.grit",
        'a value for this key, such as grit = "30 um"',
    )
    write_case_keys(tmp_path / "keys.md", NewCase, schema)
    assert (
        "| `grit` | > 0 | m |  | yes | 0.3 | Size of the grains |"
        in (tmp_path / "keys.md").read_text()
    )


def test_a_file_is_read_as_the_case_says(tmp_path, data):
    """Relative to the case, transposed, in its unit, its holes filled up to the share given."""
    heights = (
        fs.self_affine(
            (96, 64), (96e-6, 64e-6), hurst=0.8, rms_slope=0.1, cut_off=16e-6, rng=0
        ).heights
        * 1e6
    )
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
    data["cells"] = {"count": [2, 3]}
    data["surface"] = {"max_undefined": 0.03, "detrend": 0}
    prepared = prepare(parse_case(data, tmp_path))
    assert prepared.scene.surface.shape == (64, 96)
    assert_allclose(prepared.scene.surface.rms_height, np.nanstd(heights) * 1e-6, rtol=0.1)
    data["surface"] = {"max_undefined": 0.02, "detrend": 0}
    with pytest.raises(fs.InputError, match="undefined"):
        prepare(parse_case(data, tmp_path))


def test_a_face_is_masked_and_cropped_as_the_case_says(tmp_path, data):
    face = fs.self_affine(
        (120, 140), (120e-6, 140e-6), hurst=0.8, rms_slope=0.1, cut_off=9e-6, rng=1
    )
    np.savez(tmp_path / "face.npz", z=face.heights, spacing=face.spacing)
    mask = np.zeros(face.shape)
    mask[100:], mask[:, 120:] = 1, 2
    np.savetxt(tmp_path / "mask.txt", mask.T, "%d")
    data["face"] = {"kind": "file", "path": "face.npz", "mask": "mask.txt"}
    data["cells"] = {"count": [1, 1]}
    with pytest.raises(
        fs.InputError, match=r"^face: given [0-9.]+ % undefined points, expected at most 5 %: crop"
    ):
        prepare(parse_case(data, tmp_path))
    data["face"] |= {"crop": ["10 um", "100 um", "0 um", "120 um"]}
    assert_allclose(
        prepare(parse_case(data, tmp_path)).scene.surface.size, (90e-6, 120e-6), rtol=0.03
    )
    for name, value in (
        ("crop", ["0 um", "1 mm", "0 um", "9 um"]),
        ("mask", "none.png"),
        ("file_mask", False),
    ):
        wrong = {"path": "mask.txt", "spacing": ["1 um", "1 um"]} if name == "file_mask" else {}
        case = parse_case(data | {"face": data["face"] | wrong | {name: value}}, tmp_path)
        with pytest.raises(fs.InputError, match=rf"^face\.{name}: given"):
            prepare(case)
    (tmp_path / "bad.npy").write_text("no numbers")
    for name in ("path", "mask"):
        with pytest.raises(
            fs.InputError, match=rf"^face\.{name}, {re.escape(str(tmp_path / 'bad.npy'))}: given"
        ):
            prepare(parse_case(data | {"face": data["face"] | {name: "bad.npy"}}, tmp_path))
    for name, value in (
        ("crop", ["0 um", "10 um"]),
        ("crop", ["-1 um", "10 um", "0 um", "9 um"]),
        ("crop", "10 um"),
        ("crop: given .* expected four lengths in one list", [["0 um", "10 um"], ["0 um", "9 um"]]),
        ("channel", -1),
        ("channel", ""),
        ("channel", True),
        ("file_mask", "maybe"),
    ):
        with pytest.raises(fs.InputError, match=rf"face\.{name}"):
            parse_case(data | {"face": data["face"] | {name.partition(":")[0]: value}}, tmp_path)
    assert (
        parse_case(data | {"face": data["face"] | {"channel": "Height"}}, tmp_path).face[0].channel
        == "Height"
    )


def test_a_mask_is_a_file_of_the_case_as_the_face_is(tmp_path, data):
    """Results of another mask are those of another case."""
    from femseal.runs.job import face_files

    np.savez(tmp_path / "face.npz", z=np.zeros((4, 4)), spacing=(1e-6, 1e-6))
    np.save(tmp_path / "mask.npy", np.zeros((4, 4)))
    data["face"] = {"kind": "file", "path": "face.npz", "mask": "mask.npy"}
    case = parse_case(data, tmp_path)
    before = face_files(case)
    assert set(before) == {"face.npz", "mask.npy"}
    np.save(tmp_path / "mask.npy", np.eye(4))
    assert face_files(case)["mask.npy"] != before["mask.npy"]
    (tmp_path / "mask.npy").unlink()
    with pytest.raises(fs.InputError, match=r"face\.mask: given 'mask.npy'"):
        face_files(case)


def test_a_second_face_with_holes_is_named(tmp_path, two_faces):
    with np.load(tmp_path / "upper.npz") as stored:
        z = stored["z"].copy()
        z[80:] = np.nan
        np.savez(tmp_path / "upper.npz", z=z, spacing=stored["spacing"])
    with pytest.raises(
        fs.InputError, match=r"^face\.1: given 33.3 % undefined points.*: crop the map"
    ):
        prepare(parse_case(two_faces, tmp_path))


def test_spikes_along_the_lay_are_a_warning_of_the_case(tmp_path, data):
    x1 = np.indices((128, 96))[0]
    rng = np.random.default_rng(3)
    z = 1e-7 * np.cos(2 * np.pi * x1 / 16) + 1e-9 * rng.standard_normal(x1.shape)
    z[(np.abs(x1 - 60) < 5) & (rng.random(z.shape) < 0.06)] += 3e-6
    np.savez(tmp_path / "face.npz", z=z, spacing=(1e-6, 1e-6))
    data["face"] = {"kind": "file", "path": "face.npz"}
    data["cells"] = {"count": [1, 1]}
    warnings = prepare(parse_case(data, tmp_path)).warnings
    assert any("follow the lay" in text and "surface.spikes = inf" in text for text in warnings)
    data["surface"] = {"spikes": np.inf}
    assert not any(
        "follow the lay" in text for text in prepare(parse_case(data, tmp_path)).warnings
    )
    # as one of two faces, too
    data |= {"surface": {}, "face": [data["face"], data["face"]]}
    assert any("follow the lay" in text for text in prepare(parse_case(data, tmp_path)).warnings)


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
    assert prepared.conditioning.spike_points == 2
    assert_allclose(
        prepared.conditioning.undefined_fraction, (1 / (96 * 128) + 1 / (120 * 160)) / 2
    )
    lines = describe(parse_case(two_faces, tmp_path), prepared)
    assert any(
        "two faces overlap on " in line and "% of the first, the second resampled" in line
        for line in lines
    )
    assert any(" 2 in spikes filled" in line for line in lines)


def test_only_the_second_face_is_placed(tmp_path, two_faces):
    two_faces["face"][0]["shift"] = ["1 um", "0 um"]
    with pytest.raises(
        fs.InputError, match=r"face\.0: given shift, expected that in the second face"
    ):
        parse_case(two_faces, tmp_path)
    two_faces["face"][0] = {"kind": "file", "path": "lower.npz"}
    for name, value in (("mirror", "x3"), ("rotate", 90), ("rotate", "1 um"), ("shift", ["1 um"])):
        two_faces["face"][1] = {"kind": "file", "path": "upper.npz", name: value}
        with pytest.raises(fs.InputError, match=rf"face\.1\.{name}"):
            parse_case(two_faces, tmp_path)
    two_faces["face"][1] = {"kind": "file", "path": "upper.npz", "shift": ["1 mm", "0 um"]}
    with pytest.raises(fs.InputError, match="shift: given 1 mm"):
        prepare(parse_case(two_faces, tmp_path))


def test_spikes_of_files_are_filled_unless_left_alone(tmp_path, two_faces):
    two_faces["face"] = two_faces["face"][:1]
    assert prepare(parse_case(two_faces, tmp_path)).conditioning.spike_points == 1
    two_faces["surface"] = {"spikes": np.inf}
    left = prepare(parse_case(two_faces, tmp_path))
    assert left.conditioning.spike_points == 0
    assert left.conditioning.rms_slope_before > 1
    for wrong in (0, -6, "six", True):
        two_faces["surface"] = {"spikes": wrong}
        with pytest.raises(
            fs.InputError, match=r"surface\.spikes: given .*, expected a number > 0"
        ):
            parse_case(two_faces, tmp_path)


def test_paths_are_relative_to_the_case_file(tmp_path, monkeypatch):
    text = (ROOT / "examples" / "measured_seal.toml").read_text(encoding="utf-8")
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(ROOT / "examples")  # where the face lies, but not the case
    with pytest.raises(fs.InputError, match=r"measured_face\.x3p"):
        fs.load_case(tmp_path / "case.toml")
    monkeypatch.chdir(tmp_path)
    assert prepare(
        fs.load_case(ROOT / "examples" / "measured_seal.toml")
    ).conditioning.shape_before == (300, 600)


def test_files(tmp_path, data):
    data["face"] = {"kind": "file", "path": "face.npy", "spacing": ["1 um", "1 um"]}
    with pytest.raises(fs.InputError, match=r"face\.npy"):
        parse_case(data, tmp_path)
    rng = np.random.default_rng(0)
    heights = fs.self_affine(
        (192, 384), (192e-6, 384e-6), hurst=0.8, rms_slope=0.2, rng=rng
    ).heights.copy()
    heights[:100] = np.nan
    np.save(tmp_path / "face.npy", heights)
    with pytest.raises(fs.InputError, match="undefined"):
        prepare(parse_case(data, tmp_path))
    heights[:100] = 0
    heights[5, 7] = np.nan
    np.save(tmp_path / "face.npy", heights)
    prepared = prepare(parse_case(data, tmp_path))
    assert_allclose(prepared.conditioning.undefined_fraction, 1 / heights.size)


def test_unreadable_case_files(tmp_path):
    for text, word in (("a = [", "TOML"), (None, "read")):
        path = tmp_path / f"{word}.toml"
        if text is not None:
            path.write_text(text)
        with pytest.raises(fs.InputError, match=word):
            fs.load_case(path)
