"""The table [load] of a case: forces, maps of the pressure, and what they refuse."""

import tomllib
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.runs.case import parse_case
from femseal.seal.pressure_map import AngleTable, MapsAtLoads, Profile, Uniform

ROOT = Path(__file__).parents[1]


@pytest.fixture
def data():
    case = tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))
    case["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
    case["cells"] = {"count": [2, 4]}
    case["stochastic"] = {"length": "1 mm", "pressure": "uniform", "library_cells": 4, "realisations": 4}
    case["load"] = {"loading": ["50 MPa", "100 MPa"], "unload_from": ["100 MPa"], "unloading": ["50 MPa"]}
    case.pop("compare", None)
    return case


def load_of(data, **keys):
    return parse_case(data | {"load": data["load"] | keys}).load


class TestForces:
    def test_units_are_told_apart(self, data):
        forces = {"loading": ["5 kN", "10 kN"], "unload_from": ["10 kN"], "unloading": ["5000 N"]}
        load = load_of(data, **forces)
        assert (load.unit, load.highest) == ("N", 1e4)
        assert load.pressures(1e-4, 0.1) == {"loading": (5e7, 1e8), "unload_from": (1e8,), "unloading": (5e7,)}
        lengthwise = {"loading": ["50 N/mm", "100 N/mm"], "unload_from": ["1e5 N/m"], "unloading": ["50 N/mm"]}
        load = load_of(data, **lengthwise)
        assert (load.unit, load.highest) == ("N/m", 1e5)
        assert_allclose(load.pressures(1e-4, 0.1)["loading"], (5e7, 1e8))

    def test_the_echo_tells_them_and_is_a_case_again(self, data):
        case = parse_case(data | {"load": {"loading": ["5 kN", "10 kN"]}})
        assert case.echo()["load"]["loading"] == ["5000.0 N", "10000.0 N"]
        assert parse_case(data).echo()["load"]["loading"] == [5e7, 1e8]

    @pytest.mark.parametrize(
        ("loading", "words"),
        [
            (["50 MPa", "100 N"], "loads of one kind, not Pa and N"),
            (["50 N/mm", "100 N"], "loads of one kind, not N/m and N"),
            (["-5 N"], "load.loading.0: given '-5 N', allowed is a pressure >= 0.* or a force"),
            (["5 m"], "load.loading.0: given '5 m'"),
            ([5.0], "load.loading.0: given 5.0"),
            (["1,5 MPa"], "comma"),
        ],
    )
    def test_what_is_refused(self, data, loading, words):
        with pytest.raises(fs.InputError, match=words):
            parse_case(data | {"load": {"loading": loading}})


class TestMaps:
    def test_kinds(self, data):
        def of(*maps):
            return load_of(data, map=list(maps)).pressure_map(Path(), 1e-4, 0.1)

        assert isinstance(load_of(data).pressure_map(Path(), 1, 1), Uniform)
        assert of({"kind": "profile", "shares": [1, 3]}) == Profile((1, 3))
        profile = of({"kind": "profile", "shares": [1, 3], "positions": ["0 mm", "2 mm"]})
        assert profile == Profile((1, 3), (0, 2e-3))
        angles = of({"kind": "angle", "shares": [1, 2], "angles": ["0 deg", "22.5 deg"], "repeat": 8})
        assert_allclose(angles.angles, AngleTable((1, 2), (0, 0.39269908), 8).angles)
        series = of({"kind": "uniform", "at": "1 MPa"}, {"kind": "profile", "shares": [1, 3], "at": "100 MPa"})
        assert isinstance(series, MapsAtLoads)
        assert series.pressures == (1e6, 1e8)

    def test_loads_of_maps_may_be_forces(self, data):
        maps = [{"kind": "uniform", "at": "1 kN"}, {"kind": "profile", "shares": [1, 3], "at": "10 kN"}]
        load = parse_case(data | {"load": {"loading": ["10 kN"], "map": maps}}).load
        assert load.pressure_map(Path(), 1e-4, 0.1).pressures == (1e7, 1e8)

    @pytest.mark.parametrize(
        ("given", "words"),
        [
            ({"kind": "magic"}, "load.map.kind: given 'magic', allowed is one of 'uniform', 'profile'"),
            ({"kind": "profile", "shares": [1, -1]}, r"load.map.shares.1: given -1"),
            ({"kind": "profile", "shares": [1, float("nan")]}, r"load.map.shares.1"),
            ({"kind": "profile", "shares": []}, r"load.map: shares: given \[\]|load.map.shares"),
            ({"kind": "profile", "shares": [0, 0]}, "not all of them 0"),
            ({"kind": "profile", "shares": [1, 2], "positions": ["0 mm"]}, "positions: given 1 numbers, allowed is 2"),
            ({"kind": "profile", "share": [1]}, "load.map.share: unknown key"),
            ({"kind": "angle", "shares": [1, 2], "repeat": 0}, "load.map.repeat"),
            ({"kind": "angle", "shares": [1, 2], "angles": ["0 deg", "50 deg"], "repeat": 8}, "below one period, 45°"),
            ({"kind": "field", "path": "none.csv"}, "load.map.length_unit: missing"),
            ([{"kind": "uniform"}, {"kind": "uniform"}], "that all have `at`"),
            ([{"kind": "uniform", "at": "2 MPa"}, {"kind": "uniform", "at": "1 MPa"}], "whose `at` rise"),
            ([{"kind": "uniform", "at": "2 N"}, {"kind": "uniform", "at": "3 N"}], "of one kind, not Pa and N"),
            ([], "one table `map`"),
            ("profile", "load.map"),
        ],
    )
    def test_what_is_refused(self, data, given, words):
        with pytest.raises(fs.InputError, match=words):
            load_of(data, map=given)
