"""The study of real sizes, on little faces and seals: its own figures are right, and the findings are there."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

PATH = Path(__file__).parents[2] / "examples" / "real_sizes.py"
spec = importlib.util.spec_from_file_location("real_sizes", PATH)
real_sizes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(real_sizes)


def test_load_lost_when_leakage_doubles():
    """ln Q straight in p from 100: doubled half way to the point where it is four times as large."""
    pressure = np.array([100.0, 60.0, 20.0])
    assert_allclose(real_sizes.doubling_share(pressure, np.array([1.0, 2.0, 4.0])), 0.4)
    assert_allclose(real_sizes.doubling_share(pressure, np.array([1.0, 4.0, 9.0])), 0.2)
    assert np.isnan(real_sizes.doubling_share(pressure, np.array([1.0, 1.5, 1.9])))
    assert np.isnan(real_sizes.doubling_share(pressure, np.array([0.0, 1.5, 1.9])))


def test_cells_show_what_the_paper_found(tmp_path):
    """Cells scatter by decades and some close; permeability falls below that of plates; few carry the drop."""
    face = real_sizes.cells_of_faces((4,))[4]
    rows = real_sizes.scatter(face, real_sizes.scene(0.1).hardness)
    up = [row for row in rows if row["branch"] == "loading"]
    assert up[0]["decades"] < 1 < 2 < up[-1]["decades"]
    assert up[0]["closed"] == 0 < up[-1]["closed"]
    assert 0.5 < up[0]["over_plates"] < 1
    assert up[0]["half_of_drop"] > 4 > 2 > up[-1]["half_of_drop"] > 0
    by_load = {row["load/H"]: row["leakage_over_first"] for row in up}
    down = [row for row in rows if row["branch"] == "unloading"]
    assert all(row["leakage_over_first"] < by_load[row["load/H"]] for row in down)


@pytest.mark.slow
def test_small_seals(tmp_path):
    """Leakage per length does not depend on the length; half the load changes it by less than half; it falls with peaks."""
    rows = real_sizes.study((0.1,), ((0.1e-3, 1e-3), (0.1e-3, 4e-3)), realisations=3)
    assert [(r["length_mm"], r["peak/H"]) for r in rows] == [
        (n, p) for n in (1, 4) for p in (0.1, 0.2)
    ]
    short, long = (np.array([r["leakage_m2_per_s"] for r in rows[n : n + 2]]) for n in (0, 2))
    assert (np.diff(short) < 0).all()
    assert_allclose(long, short, rtol=0.3)
    assert all(1 < r["growth_at_half_load"] < 2 for r in rows)
    real_sizes.draw(rows, real_sizes.cells_of_faces((2,)), tmp_path / "sizes.png")
    assert (tmp_path / "sizes.png").stat().st_size > 10_000
