"""Loads of a run as quantities, texts and ticks."""

from itertools import pairwise

import numpy as np
import pytest
from loaded_datasets import dataset_with_loads
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from femseal.plots.leakage_panels import (
    LeakageCurves,
    leakage_panel,
)
from femseal.results.load_steps import LoadFormat, given_loads, load_format


@pytest.mark.parametrize(
    "loads", [(66.43, 140.5, 141.2, 300), (1, 2, 3, 4, 5, 6), (276.79, 369.05, 461.31, 9000)]
)
@pytest.mark.parametrize("load_format", [LoadFormat(), LoadFormat("kN", 4.2e-8)])
def test_loads_are_ticks_whose_labels_do_not_touch(loads, load_format):
    pressure = np.array(loads) * 1e6
    curves = LeakageCurves(
        pressure, np.full(len(loads), np.nan), 1 / pressure, "median", loads=load_format
    )
    figure = Figure(figsize=(5.4, 4))
    axes = figure.add_axes((0.18, 0.2, 0.78, 0.7))
    leakage_panel(axes, curves)
    FigureCanvasAgg(figure).draw()
    _, factor = load_format.axis
    # a tick with a label stands in for one without
    ticks = np.union1d(axes.get_xticks(), axes.get_xticks(minor=True))
    assert_allclose(ticks, pressure * factor)
    boxes = sorted(
        text.get_window_extent().extents[[0, 2]].tolist()
        for text in axes.get_xticklabels()
        if text.get_text()
    )
    assert len(boxes) == len(loads)  # every load has a label
    assert all(right < left for (_, right), (left, _) in pairwise(boxes))
    assert ("kN" in axes.get_xlabel()) == (load_format.unit == "kN")


@pytest.mark.parametrize(
    ("loads", "unit", "force", "per_pascal"),
    [
        ((5e7, 1e8), "Pa", "", 0.0),
        (("1000.0 N", "2000.0 N"), "N", "kN", 2.0 / 1e8),
        (("100.0 N", "200.0 N"), "N", "N", 200.0 / 1e8),
        (("1000.0 N/m", "2000.0 N/m"), "N/m", "N/mm", 2.0 / 1e8),
        # spaces and prefixes are no matter
        (("1kN", "2kN"), "N", "kN", 2.0 / 1e8),
    ],
)
def test_forces_of_a_stored_case_are_read_as_quantities(loads, unit, force, per_pascal):
    data = dataset_with_loads(*loads)
    assert given_loads(data)[0] == unit
    assert load_format(data)[:2] == (force, pytest.approx(per_pascal))


def test_a_short_load_is_the_force_alone():
    force = LoadFormat("kN", 2e-8, 3)
    assert (force.short(1e8), force.full(1e8)) == ("2 kN", "2 kN (100 MPa)")
    pressure = LoadFormat(digits=3)
    assert pressure.short(1e8) == pressure.full(1e8) == "100 MPa"
