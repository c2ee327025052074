"""The benchmark `plastic_law` solves the plastic solid, and its records support the row of the error budget."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
import plastic_law as benchmark
from common import read_rows
from references import plastic_solid
from references.plastic_solid import MODULUS, PlasticSolid, press


def test_more_points_keep_the_heights():
    z = benchmark.Case().heights()
    assert_allclose(benchmark.interpolated(z, 64)[::2, ::2], z, atol=1e-12)


def test_mixing_solves_a_linear_fixed_point_in_as_many_steps_as_unknowns():
    matrix, right = np.array([[0.2, 0.5], [-0.4, 0.6]]), np.array([1.0, 2.0])
    pressures, changes, p = [], [], np.zeros(2)
    for _ in range(3):
        pressures, changes = [*pressures, p], [*changes, matrix @ p + right - p]
        p = plastic_solid._anderson(pressures, changes)
    assert_allclose(p, np.linalg.solve(np.eye(2) - matrix, right), rtol=1e-9)


def test_a_missing_peer_is_named(monkeypatch):
    monkeypatch.setattr(benchmark, "tamaas", None)
    with pytest.raises(SystemExit, match="pip install tamaas"):
        benchmark.measure([], benchmark.RECORDS)


def test_the_row_of_the_budget_contains_the_records():
    rows = read_rows([benchmark.RECORDS])
    cases = [
        benchmark.Case(seed=2),
        benchmark.Case("turned", 1),
        benchmark.Case(seed=2, severity=0.6),
    ]
    contained, leaking, _ = benchmark.intervals(benchmark.records_of(rows, cases))
    assert leaking > 20
    assert contained >= 0.9 * leaking


@pytest.mark.slow
def test_a_solid_that_does_not_yield_is_elastic():
    pytest.importorskip("tamaas")
    z, body = rough()
    contact = fs.solve_contact(z.max() - z, body, pressure=0.01, rtol=1e-8)
    found = press(PlasticSolid(16, 9, 0.2, 1e3, 0.0), z.max() - z, 0.01, contact.pressure, 1e-6)
    assert_allclose(found.pressure, contact.pressure, atol=1e-5 * contact.pressure.max())


@pytest.mark.slow
def test_a_kept_state_is_found_again_and_reloading_is_elastic():
    pytest.importorskip("tamaas")
    z, body = rough()
    hardness = 0.3 * MODULUS * 0.2
    load = 0.15 * hardness
    gap0 = z.max() - z
    first = fs.solve_contact(gap0, body, pressure=load, hardness=hardness)
    solid = PlasticSolid(16, 9, 0.2, hardness / 2.8, 0.02)
    peak = press(solid, gap0, load, first.pressure)
    solid.keep()
    plastic = np.asarray(solid.kept_displacement).copy()
    unloaded = press(solid, gap0, load / 3, peak.pressure)
    solid.keep()
    again = press(solid, gap0, load, peak.pressure)
    assert unloaded.gap.mean() > 1.1 * peak.gap.mean()
    assert_allclose(again.gap.mean(), peak.gap.mean(), rtol=5e-3)
    assert np.abs(plastic).max() > 0.1 * z.std()


def rough():
    face = fs.self_affine((16, 16), 1.0, hurst=0.8, rms_slope=0.2, roll_off=0.9, cut_off=0.5, rng=1)
    return np.asarray(face.heights), fs.HalfSpace((16, 16), (1 / 16, 1 / 16), MODULUS)
