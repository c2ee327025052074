"""Seals of several lengths from one library: in a study, in a case, in tables and pictures."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import STRIP

import femseal as fs
from femseal.case.case import parse_case
from femseal.case.schema import case_schema
from femseal.preparation.preparation import prepare
from femseal.results import assemble, open_results, tables
from femseal.runs.forecast import describe, forecast

LENGTHS = (240e-6, 60e-6, 2e-3)
CASE = STRIP | {
    "stochastic": {"sampler": "block", "length": ["240 um", "60 um", "2 mm"], "realisations": 6, "library_cells": 8},
    "output": {"paraview": "none"},
}


@pytest.fixture(scope="module")
def scene():
    surface = fs.self_affine((32, 64), (30e-6, 60e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=2)
    return fs.Scene(
        surface,
        115e9,
        3e9,
        fs.Liquid(1e-3),
        1e6,
        0.0,
        loading=(5e7, 3e8, 2.5e9),
        unload_from=(3e8,),
        unloading=(1e8,),
    )


@pytest.fixture(scope="module")
def sampling():
    return fs.Sampling(LENGTHS[0], realisations=6, library_cells=8, seed=3, other_lengths=LENGTHS[1:])


@pytest.fixture(scope="module")
def seals(scene, sampling):
    return fs.stochastic(scene, (2, 4), sampling)


@pytest.fixture(scope="module")
def results(scene, seals):
    return assemble(scene, stochastic=seals)


@pytest.mark.parametrize(
    "options",
    [{}, {"pressure": "uniform", "bounds": True}, {"pressure": "global"}, {"sampler": "runs"}, {"sampler": "copula"}],
    ids=str,
)
def test_every_length_is_what_it_is_by_itself(scene, sampling, options):
    few = replace(sampling, **options, library_cells=3, realisations=3)
    several = fs.stochastic(scene, (2, 4), few)
    for seals, length in zip((several, *several.other_lengths), LENGTHS, strict=True):
        alone = replace(few, length=length, other_lengths=())
        own = fs.stochastic(scene, (2, 4), alone)
        assert seals.seal.size == own.seal.size
        for name in ("leakage", "leakage_resampled", "leakage_lower_bound", "leakage_dirichlet_cuts"):
            if getattr(own, name) is not None:
                assert_array_equal(getattr(seals, name), getattr(own, name), err_msg=name)


def test_windows_are_solved_once_for_all_lengths(scene, sampling):
    stages = []

    def mapper(stage, *iterables):
        stages.append(stage.name)
        return map(stage, *iterables)

    for sampler in ("runs", "block"):
        fs.stochastic(scene, (2, 4), replace(sampling, sampler=sampler), mapper=mapper)
    assert stages.count("runs of columns") == 1
    assert stages.count("flow in windows") == 2
    assert stages.count("drawn seals") == 3


def test_the_dataset_has_median_and_band_of_every_length(results, seals):
    data = results.dataset
    assert_allclose(data["seal_length"], [240e-6, 60e-6, 1.995e-3], rtol=0.01)
    for n, own in enumerate((seals, *seals.other_lengths)):
        for name, values in (
            ("median", own.quantile(0.5)),
            ("upper", own.quantile(0.95)),
            ("lower_together", own.quantile(0.05, resampled=True)),
        ):
            assert_array_equal(data[f"leakage_of_lengths_{name}"][n], values)
        assert_array_equal(data["sealed_fraction_of_lengths"][n], own.sealed_fraction)
    assert_array_equal(data["leakage_median"], data["leakage_of_lengths_median"][0])
    # the leakage per length of longer seals scatters less
    width = np.log(data["leakage_of_lengths_upper"] / data["leakage_of_lengths_lower"])[:, 0]
    assert width[2] < width[0] < width[1]


def test_tables_of_lengths(results):
    table = results.lengths_table()
    assert table.heads == ("seal length", "50 MPa", "300 MPa", "unloading 100 MPa from 300 MPa")
    assert [line[0] for line in table.lines] == ["240 µm", "60 µm", "1.995 mm"]
    rows = list(csv.DictReader(io.StringIO(tables.lengths_csv(results))))
    assert len(rows) == 3 * 4
    median = results.dataset["leakage_of_lengths_median"].values
    assert_allclose([float(row["leakage_median_m2_per_s"]) for row in rows], median.ravel())
    whole = assemble(results.scene, stochastic=results.stochastic, leakage_unit="mL/min")
    # of the whole seal, each of its own length
    expected = whole.dataset["leakage_of_lengths_median"].values / tables.length_scales(whole)[:, None]
    assert_allclose(expected, median * np.array(whole.dataset["seal_length"])[:, None] * 6e7)
    assert whole.lengths_table().lines[2][0] == "1.995 mm"


def test_picture_of_lengths(results):
    (axes,) = results.plot_lengths().axes
    assert axes.get_xlabel() == "length of the seal [mm]"
    _, factor = results.leak_unit, results.leak_basis.factor(results.leak_unit)
    first = axes.lines[0]
    assert_allclose(first.get_xdata(), np.sort(results.dataset["seal_length"]) * 1e3)
    median = results.dataset["leakage_of_lengths_median"].values[[1, 0, 2], 0]
    assert_allclose(first.get_ydata(), median / factor)
    with pytest.raises(fs.InputError, match="one length"):
        assemble(results.scene, stochastic=replace(results.stochastic, other_lengths=())).plot_lengths()


def test_a_case_with_a_list_of_lengths(tmp_path):
    case = parse_case(CASE)
    assert case.stochastic.lengths == pytest.approx(LENGTHS)
    text = "\n".join(describe(case, prepare(case)))
    assert "240 µm long; as many of 60 µm, 2 mm" in text
    one = parse_case(CASE | {"stochastic": CASE["stochastic"] | {"length": "240 um"}})
    assert one.stochastic.length == pytest.approx(240e-6)
    assert forecast(one, prepare(one)).work < forecast(case, prepare(case)).work
    found = fs.run(case, tmp_path / "out", workers=1)
    assert {"lengths.csv", "lengths.png"} <= {path.name for path in (tmp_path / "out").iterdir()}
    back = open_results(tmp_path / "out")
    assert back.lengths_table().lines[2][0] == "1.995 mm"
    page = (tmp_path / "out" / "report.html").read_text()
    assert "By length of seal" in page
    assert "Seals of other lengths are drawn from the same library: 60 µm, 1.995 mm." in page
    assert fs.run(case, tmp_path / "out", resume=True, workers=1).dataset.equals(found.dataset)


@pytest.mark.parametrize(
    ("length", "fault"),
    [
        (["1 mm", "1 mm"], r"stochastic\.length: given .*, expected a length > 0, .* or a list of some that differ"),
        ([], r"stochastic\.length: given \[\], expected a length"),
        (["1 mm", "2"], r"stochastic\.length: given .*, expected text with a number and a unit"),
        (["1 mm", "1 um"], r"stochastic\.length: given 1 µm, expected at least one cell, 15 µm"),
        (["60 um", "61 um"], r"stochastic\.length: given 60 µm, 60 µm in whole cells, expected lengths that differ"),
    ],
)
def test_lengths_that_cannot_be(length, fault):
    with pytest.raises(fs.InputError, match=fault):
        prepare(parse_case(CASE | {"stochastic": CASE["stochastic"] | {"length": length}}))


def test_the_schema_knows_one_length_and_several():
    length = case_schema()["definitions"]["StochasticTable"]["properties"]["length"]
    kinds = [option["type"] for option in length["anyOf"]]
    assert kinds == ["string", "array"]
