"""Sobol indices of the leakage over ranges of keys of a case."""

import csv

import numpy as np
import pytest
from each import each
from numpy.testing import assert_allclose
from scipy.stats import qmc
from test_calibration import CASE

import femseal as fs
from femseal.designs import sobol as module
from femseal.designs.sobol import KeyRange, indices_of, sobol
from femseal.loads import LoadStep


def test_indices_of_a_known_function():
    """ln(leakage) = 2 a + b + 4 a b on the unit square, centred: closed forms by integration."""
    keys = tuple(KeyRange(name, 0.0, 1.0, "") for name in "ab")
    points = qmc.Sobol(2, rng=1).random_base2(6)
    a, b = (points - 0.5).T
    open_ = np.exp(2 * a + b + 4 * a * b)
    leakage = np.c_[open_, np.where(open_ > 1, open_, 0)]
    found = indices_of(keys, (LoadStep(1.0), LoadStep(2.0)), points, leakage)
    # variances 4/12, 1/12 and 16/144
    parts = np.array([4 / 12, 1 / 12, 16 / 144])
    assert_allclose(found.first[0], parts[:2] / parts.sum(), atol=0.03)
    assert_allclose(found.total[0], (parts[:2] + parts[2]) / parts.sum(), atol=0.03)
    assert_allclose(found.spread[0], parts.sum() ** 0.5, rtol=0.05)
    assert np.isnan(found.total[1]).all()


def test_sobol_from_the_command_line(tmp_path, femseal, monkeypatch):
    path = tmp_path / "case.toml"
    path.write_text(CASE, encoding="utf-8")
    keys = {"material.young": ["200 GPa", "220 GPa"], "fluid.viscosity": ["1 mPa*s", "4 mPa*s"]}
    first = sobol(path, keys, tmp_path / "out", scenes=12, workers=1)
    # leakage goes with one over the viscosity, which hides 10 % of modulus
    assert first.total[0, 1] > 0.9 > 0.1 > first.total[0, 0]
    assert_allclose(first.spread[0], np.log(4) / 12**0.5, rtol=0.15)
    monkeypatch.setattr(module, "_leakage", lambda *a: pytest.fail("a scene was solved again"))
    again = sobol(path, keys, tmp_path / "out", scenes=12, workers=1)
    assert_allclose(again.total, first.total)
    with (tmp_path / "out" / "sobol.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert_allclose([float(row["total fluid.viscosity"] or "nan") for row in rows], first.total[:, 1])
    code, _, said = femseal("design", path, "--sobol", "material.hardness=4GPa,2GPa", "--workers", 1)
    assert code == 2
    assert "that rise" in said


@each("keys, what", [
    ({"material.young": ["1 GPa"]}, "sobol: material.young"),
    ({"material.young": ["1 GPa", "2 MPa"]}, "sobol: material.young"),
    ({"load.relaxation": [0.1, 0.2]}, "sobol"),
    ({"nothing": [1, 2]}, "nothing"),
    ({"surface.shortest_wave": ["1 um", "9 um"]}, "surface.shortest_wave"),
    ({}, "sobol"),
])  # fmt: skip
def test_bad_ranges_are_refused_before_any_work(keys, what, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_leakage", lambda *a: pytest.fail("a scene was solved"))
    (tmp_path / "case.toml").write_text(CASE, encoding="utf-8")
    with pytest.raises(fs.InputError) as error:
        sobol(tmp_path / "case.toml", keys, workers=1)
    assert error.value.what == what
