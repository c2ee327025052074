"""The table [load] of a case: forces, maps of the pressure, and what they refuse."""

import json
import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import small_turned_seal

import femseal as fs
from femseal.base import quantities
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.runs.identity import face_files
from femseal.seal import AngleTable, Frame, MapsAtLoads, Profile, Uniform
from femseal.studies.tile_pressure import pressure_fractions, seal_for_maps

ROOT = Path(__file__).parents[2]


@pytest.fixture
def data():
    case = small_turned_seal()
    case["stochastic"] = {"length": "1 mm", "realisations": 4}
    case["load"] = {
        "loading": ["50 MPa", "100 MPa"],
        "unload_from": ["100 MPa"],
        "unloading": ["50 MPa"],
    }
    case.pop("compare", None)
    return case


def load_of(data, **keys):
    return parse_case(data | {"load": data["load"] | keys}).load


class TestForces:
    def test_units_are_told_apart(self, data):
        forces = {"loading": ["5 kN", "10 kN"], "unload_from": ["10 kN"], "unloading": ["5000 N"]}
        load = load_of(data, **forces)
        assert (load.unit, load.highest) == ("N", 1e4)
        assert load.pressures(1e-4, 0.1) == {
            "loading": (5e7, 1e8),
            "unload_from": (1e8,),
            "unloading": (5e7,),
        }
        lengthwise = {
            "loading": ["50 N/mm", "100 N/mm"],
            "unload_from": ["1e5 N/m"],
            "unloading": ["50 N/mm"],
        }
        load = load_of(data, **lengthwise)
        assert (load.unit, load.highest) == ("N/m", 1e5)
        assert_allclose(load.pressures(1e-4, 0.1)["loading"], (5e7, 1e8))

    def test_they_become_pressures_by_the_size_of_the_seal(self, data):
        """A strip 1 mm long and as broad as its face, 60 µm, or 0.5 mm; a ring by its own radii."""

        def pressures(loading, **tables):
            return prepare(parse_case(data | {"load": {"loading": loading}} | tables)).scene.loading

        assert_allclose(pressures(["3 N", "6 N"]), (5e7, 1e8))
        assert_allclose(pressures(["3 N/mm", "6 N/mm"]), (5e7, 1e8))
        assert_allclose(
            pressures(["25 N"], stochastic=data["stochastic"] | {"breadth": "0.5 mm"}), (5e7,)
        )
        ring = {"kind": "annular", "inner_radius": "0.2 mm", "outer_radius": "0.3 mm"}
        drawn = {key: value for key, value in data["stochastic"].items() if key != "length"}
        assert_allclose(pressures(["5 N"], seal=ring, stochastic=drawn), (5 / (np.pi * 5e-8),))
        assert_allclose(pressures(["5 N/mm"], seal=ring, stochastic=drawn), (5e7,))
        face = {"method": "deterministic"}
        assert_allclose(pressures(["3 N/mm"], **face), (5e7,))
        with pytest.raises(
            fs.InputError,
            match=r"load.loading: given forces, although the length of the seal is unknown, expected .* per length",
        ):
            pressures(["3 N"], **face)
        with pytest.raises(
            fs.InputError, match=r"load: given 1 kN on 0.06 mm², 16.67 GPa, expected .* 2.8 GPa"
        ):
            pressures(["1 kN"])

    @pytest.mark.parametrize(
        ("loading", "words"),
        [
            (["50 MPa", "100 N"], "loads of one kind, not Pa and N"),
            (["50 N/mm", "100 N"], "loads of one kind, not N/m and N"),
            (["-5 N"], "load.loading.0: given '-5 N', expected a pressure >= 0.* or a force"),
            (["5 m"], "load.loading.0: given '5 m', expected a pressure >= 0.* or a force"),
            ([5.0], "load.loading.0: given 5.0"),
            (["1,5 MPa"], "comma"),
        ],
    )
    def test_what_is_refused(self, data, loading, words):
        with pytest.raises(fs.InputError, match=words):
            parse_case(data | {"load": {"loading": loading}})

    def test_a_reworded_message_has_no_effect(self, data, monkeypatch):
        monkeypatch.setattr(quantities._GivenQuantity, "expected", "something else")
        with pytest.raises(fs.InputError, match=r"a pressure >= 0.* or a force"):
            parse_case(data | {"load": {"loading": ["5 m"]}})
        with pytest.raises(fs.InputError, match="comma"):
            parse_case(data | {"load": {"loading": ["1,5 MPa"]}})


class TestMaps:
    def test_kinds(self, data):
        def of(*maps):
            return load_of(data, map=list(maps)).pressure_map(Path(), 1e-4, 0.1)

        assert isinstance(load_of(data).pressure_map(Path(), 1, 1), Uniform)
        assert of({"kind": "profile", "fractions": [1, 3]}) == Profile((1, 3))
        profile = of({"kind": "profile", "fractions": [1, 3], "positions": ["0 mm", "2 mm"]})
        assert profile == Profile((1, 3), (0, 2e-3))
        angles = of(
            {"kind": "angle", "fractions": [1, 2], "angles": ["0 deg", "22.5 deg"], "repeat": 8}
        )
        assert_allclose(angles.angles, AngleTable((1, 2), (0, 0.39269908), 8).angles)
        series = of(
            {"kind": "uniform", "at": "1 MPa"},
            {"kind": "profile", "fractions": [1, 3], "at": "100 MPa"},
        )
        assert isinstance(series, MapsAtLoads)
        assert series.pressures == (1e6, 1e8)
        maps = [
            {"kind": "uniform", "at": "1 kN"},
            {"kind": "profile", "fractions": [1, 3], "at": "10 kN"},
        ]
        load = parse_case(data | {"load": {"loading": ["10 kN"], "map": maps}}).load
        assert load.pressure_map(Path(), 1e-4, 0.1).pressures == (1e7, 1e8)

    @pytest.mark.parametrize(
        ("given", "words"),
        [
            (
                {"kind": "magic"},
                "load.map.kind: given 'magic', expected one of 'uniform', 'profile'",
            ),
            ({"kind": "profile", "fractions": [1, -1]}, r"load.map.fractions.1: given -1"),
            (
                {"kind": "profile", "fractions": []},
                r"load.map: fractions: given \[\]|load.map.fractions",
            ),
            ({"kind": "profile", "share": [1]}, "load.map.share: given an unknown key"),
            ({"kind": "angle", "fractions": [1, 2], "repeat": 0}, "load.map.repeat"),
            ({"kind": "field", "path": "none.csv"}, "load.map.length_unit: given nothing"),
            (
                {"kind": "field", "path": "none.csv", "length_unit": "m", "pressure_unit": "Pa"},
                "load.map.path: given 'none.csv', expected a file that exists",
            ),
            (
                [{"kind": "uniform"}, {"kind": "uniform"}],
                "several tables in order of increasing `at`",
            ),
            (
                [{"kind": "uniform", "at": "2 MPa"}, {"kind": "uniform", "at": "1 MPa"}],
                "in order of increasing `at`",
            ),
            (
                [{"kind": "uniform", "at": "2 N"}, {"kind": "uniform", "at": "3 N"}],
                "of one kind, not Pa and N",
            ),
            ([], "one table `map`"),
            ("profile", "load.map"),
        ],
    )
    def test_what_is_refused(self, data, given, words):
        with pytest.raises(fs.InputError, match=words):
            load_of(data, map=given)

    def test_only_drawn_seals_have_maps(self, data):
        uneven = {"load": data["load"] | {"map": {"kind": "profile", "fractions": [1, 3]}}}
        for other in ({"method": "two-scale"}, {"compare": ["deterministic"]}):
            with pytest.raises(
                fs.InputError,
                match=r"load.map: given a map with the method .*, expected stochastic alone",
            ):
                parse_case(data | uneven | other)
        assert prepare(parse_case(data | uneven)).sampling.pressure_map == Profile((1, 3))


class TestFieldOfACase:
    @pytest.fixture
    def case(self, data, tmp_path):
        """A case whose map is a field of a mean of 60 MPa, once over the strip of 60 µm × 0.96 mm."""

        def make(text=None, **keys):
            rows = [
                f"{x},{y},{60 + 40 * (y - 0.48)}"
                for x in (0, 0.06)
                for y in np.linspace(0, 0.96, 11)
            ]
            (tmp_path / "flange.csv").write_text(text or "\n".join(["x,y,pressure", *rows]))
            field = {
                "kind": "field",
                "path": "flange.csv",
                "length_unit": "mm",
                "pressure_unit": "MPa",
            } | keys
            drawn = data["stochastic"] | {"length": "0.96 mm"}
            return parse_case(
                data | {"load": data["load"] | {"map": field}, "stochastic": drawn}, tmp_path
            )

        return make

    def test_its_mean_is_compared_with_the_load(self, case):
        assert prepare(case()).warnings == prepare(case(at="60 MPa")).warnings == ()
        (off,) = prepare(case(at="100 MPa")).warnings
        assert off.startswith(
            "the field of pressure at 100 MPa has the mean 60 MPa over the seal: it is scaled"
        )
        (far,) = prepare(case(pressure_unit="kPa")).warnings
        assert (
            far
            == "the field of pressure has the mean 60 kPa over the seal, far from all loads: is its unit right?"
        )

    def test_tiles_that_hardly_touch_are_told(self, data):
        def warnings(fractions, inlet):
            case = data | {
                "load": data["load"] | {"map": {"kind": "profile", "fractions": fractions}}
            }
            return prepare(
                parse_case(case | {"fluid": data["fluid"] | {"inlet_pressure": inlet}})
            ).warnings

        assert warnings([1, 2], "1 MPa") == ()
        (open_,) = warnings([0, 2], "1 MPa")
        text = "of the seal the map presses no more than the fluid carries, "
        assert open_.startswith(f"over 50% {text}")
        (lifted,) = warnings([0.01, 2], "2 MPa")
        assert text in lifted

    @pytest.mark.parametrize(
        ("given", "words"),
        [
            (
                {"length_unit": "um"},
                r"load.map.field: given x 0 to 6e-08 m.* expected a pressure field that covers the seal",
            ),
            ({"length_unit": "kg"}, "load.map.length_unit: given '1 kg'"),
            ({"pressure_unit": "mm"}, "load.map.pressure_unit: given '1 mm'"),
            ({"name": "CPRESS"}, "load.map.path: .* expected one column each of x, y, CPRESS"),
            (
                {"text": "x,y,pressure\n0,0,-1\n1,0,1\n0,2,1"},
                "load.map.pressure: given 1 of 3 values not finite or negative",
            ),
            (
                {"text": "x,y,pressure\n0,0,90\n1,0,1\n0,2,1"},
                r"load.map: given .* GPa in a tile at loading 100 MPa",
            ),
        ],
    )
    def test_what_is_refused(self, case, given, words):
        if words.endswith("100 MPa"):
            given = {
                "text": "x,y,pressure\n"
                + "\n".join(f"{x},{y},{int(y < 0.02)}" for x in (0, 1) for y in (0, 0.01, 0.02, 2))
            }
        with pytest.raises(fs.InputError, match=words) as caught:
            prepare(case(**given))
        assert "\n" not in str(caught.value)

    def test_results_hold_it(self, case, tmp_path):
        """Another field is another run."""
        table = [
            "x,y,pressure",
            *(f"{x},{y},{60 + 40 * (y - 0.48)}" for x in (0, 0.06) for y in (0, 0.96)),
        ]
        found = case("\n".join(table))
        dry = found.contact.model_copy(update={"fluid_pressure": "ignored"})
        found = found.model_copy(update={"contact": dry})
        results = fs.run(found, tmp_path / "out", workers=1)
        data = results.dataset
        pressure = data["drawn_contact_pressure"].values
        y = data["drawn_corners"].values.mean(axis=1)[:, 1] * 1e3
        assert_allclose(pressure[1], 1e8 * (1 + 40 / 60 * (y - 0.48)), rtol=0.01)
        assert_allclose(pressure.mean(axis=1), data["nominal_pressure"].values, rtol=1e-6)
        assert fs.run(found, tmp_path / "out", resume=True).warnings == results.warnings
        of_case = prepare(found).sampling.pressure_map
        of_worker = pickle.loads(pickle.dumps(of_case))
        patches, frame = np.array([[3e-5, 2e-4]]), Frame.for_strip((6e-5, 9.6e-4))
        assert_array_equal(of_worker.at(patches, frame), of_case.at(patches, frame))
        other = case("\n".join(table).replace("40.8", "41.8"))
        assert face_files(other) != json.loads(data.attrs["face_files"])


class TestMesh:
    """The gasket of the examples, under four bolts."""

    @pytest.fixture
    def gasket(self):
        return tomllib.loads((ROOT / "examples" / "gasket_seal.toml").read_text(encoding="utf-8"))

    def prepared(self, gasket, **load):
        return prepare(parse_case(gasket | {"load": gasket["load"] | load}, ROOT / "examples"))

    def test_a_map_round_its_centre(self, gasket):
        under_bolts = {"kind": "angle", "fractions": [2, 1], "repeat": 4}
        prepared = self.prepared(gasket, map=under_bolts)
        _, tiles = prepared.cut_and_tiles
        pressed = seal_for_maps(prepared.scene.layout, tiles)
        fractions = pressed.fractions(prepared.sampling.pressure_map, pressed.centres, 1.0)[0]
        assert_allclose(np.average(fractions, weights=pressed.areas), 1.0)
        angle = np.degrees(np.arctan2(*pressed.centres.T[::-1])) % 90
        expected = 2 - np.abs(np.abs(angle - 45) - 45) / 45
        assert_allclose(fractions / fractions.mean(), expected / expected.mean(), rtol=1e-6)
        of_tiles = pressure_fractions(prepared.scene, tiles, prepared.sampling.pressure_map)
        assert of_tiles.shape == (len(prepared.scene.steps), tiles.count)
        assert_allclose((of_tiles.min(), of_tiles.max()), (fractions.min(), fractions.max()))

    def test_forces_and_profiles(self, gasket):
        """Its area is what a uniform force acts on, its length the one given; a profile needs radii."""
        forces = {"loading": ["200 kN"], "unload_from": [], "unloading": []}
        (pressure,) = self.prepared(gasket, **forces).scene.loading
        (lengthwise,) = self.prepared(
            gasket, **forces | {"loading": [f"{200 / 110} kN/mm"]}
        ).scene.loading
        assert_allclose(lengthwise, pressure, rtol=1e-9)
        assert 1e7 < pressure < 1e9
        with pytest.raises(
            fs.InputError, match=r"load.map.positions: given none on a mesh, expected radii"
        ):
            self.prepared(gasket, map={"kind": "profile", "fractions": [1, 2]})
