"""Case files: every fault is reported with its key, what was given and what is allowed; good ones are prepared."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.case import parse_case
from femseal.forecast import describe

ROOT = Path(__file__).parents[1]
CASES = [*sorted((ROOT / "examples").glob("*.toml")), ROOT / "femseal" / "template.toml"]


@pytest.fixture
def data():
    return tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", CASES, ids=lambda p: p.name)
def test_shipped_cases_are_valid_and_forecast(path):
    case = fs.load_case(path)
    prepared = case.prepare()
    assert prepared.scene.surface.rms_height > 0
    assert any("expected" in line for line in describe(case, prepared))


def test_quantities_become_si(data):
    case = parse_case(data)
    assert case.load.loading[:2] == (25e6, 50e6)
    assert case.hardness == 2.8e9
    assert_allclose(case.modulus, 210e9 / (2 * 0.91))
    assert case.echo()["face"][0]["size"] == [240e-6, 480e-6]


@pytest.mark.parametrize(
    ("table", "key", "value", "words"),
    [
        ("face", "pitch", "1,5 um", ["face.0.pitch", "'1,5 um'", "comma"]),
        ("face", "pitch", "-1 um", ["face.0.pitch", "'-1 um'", "> 0"]),
        ("face", "pitch", 60, ["face.0.pitch", "60", "unit"]),
        ("face", "pitch", "60 MPa", ["face.0.pitch", "60 MPa"]),
        ("face", "picth", "60 um", ["face.0.picth", "unknown key", "pitch"]),
        ("load", "loading", [], ["load.loading", "[]", "at least one"]),
        ("load", "loading", ["2 MPa", "1 MPa"], ["load", "rising"]),
        ("load", "loading", ["3 GPa"], ["load", "3 GPa", "below the hardness", "2.8 GPa"]),
        ("load", "unloading", [], ["load", "both, or neither"]),
        ("fluid", "kind", "water", ["fluid.kind", "'water'", "liquid"]),
        ("fluid", "viscosity", "1 Pa", ["fluid.viscosity", "1 Pa"]),
        ("cells", "count", [8.5, 2], ["cells.count.0", "8.5", "whole number"]),
        ("stochastic", "sampler", "magic", ["stochastic.sampler", "'magic'", "history, derivative"]),
        ("stochastic", "quantiles", [0.9, 0.1], ["stochastic", "rising"]),
        ("material", "hardness", "1 GPa", ["material", "not both"]),
    ],
)
def test_faults_name_key_value_and_what_is_allowed(data, table, key, value, words):
    data[table][key] = value
    with pytest.raises(fs.InputError) as caught:
        parse_case(data)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    assert "\n" not in str(caught.value)


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
        ("cells", {"count": [64, 64]}, ["cells", "8 pixels"]),
        ("cells", {"count": [18, 36]}, ["cells", "two shortest waves"]),
        ("stochastic", {"length": "1 um"}, ["stochastic.length", "1 µm", "at least one cell"]),
    ],
)
def test_cells_and_seals_that_do_not_suit_the_surface(data, table, value, words):
    data[table] = value
    with pytest.raises(fs.InputError) as caught:
        parse_case(data).prepare()
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_files(tmp_path, data):
    data["face"] = {"kind": "file", "path": "face.npy", "spacing": ["1 um", "1 um"]}
    with pytest.raises(fs.InputError, match=r"face\.npy"):
        parse_case(data, tmp_path)
    rng = np.random.default_rng(0)
    heights = fs.self_affine((192, 384), (192e-6, 384e-6), hurst=0.8, rms_slope=0.2, rng=rng).heights.copy()
    heights[:100] = np.nan
    np.save(tmp_path / "face.npy", heights)
    with pytest.raises(fs.InputError, match="undefined"):
        parse_case(data, tmp_path).prepare()
    heights[:100] = 0
    heights[5, 7] = np.nan
    np.save(tmp_path / "face.npy", heights)
    prepared = parse_case(data, tmp_path).prepare()
    assert_allclose(prepared.conditioning.undefined_share, 1 / heights.size)


def test_unreadable_case_files(tmp_path):
    for text, word in (("a = [", "TOML"), (None, "read")):
        path = tmp_path / f"{word}.toml"
        if text is not None:
            path.write_text(text)
        with pytest.raises(fs.InputError, match=word):
            fs.load_case(path)
