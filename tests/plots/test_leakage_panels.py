"""Panels with the leakage over the load: intervals, limits and legends."""

from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.testing import assert_allclose

from femseal.plots.leakage_panels import (
    BandHandle,
    LeakageCurves,
    leakage_line,
    leakage_panel,
    limit_lines,
    set_leakage_axis,
)


def test_no_marker_covers_the_word_sealed():
    figure = Figure(figsize=(3.4, 3))
    axes = figure.add_axes((0.25, 0.2, 0.7, 0.75))
    load = np.linspace(1, 10, 40)
    leakage = np.where(load < 2, 1e-6, 0.0)
    set_leakage_axis(axes, leakage)
    leakage_line(axes, load, leakage, marker="s", ms=4)
    FigureCanvasAgg(figure).draw()
    (word,) = axes.texts
    (_, markers) = axes.lines
    centres = axes.transAxes.transform(np.column_stack([np.zeros(1), markers.get_ydata()[:1]]))
    top_of_markers = centres[0, 1] + markers.get_markersize() / 72 * figure.dpi / 2
    assert top_of_markers < word.get_window_extent().y0 + 1


@pytest.mark.parametrize(("lower", "upper"), [(0.2e-9, 1.1e-9), (0.0, 1.1e-9), (1e-14, np.inf)])
def test_the_band_of_error_ends_where_it_ends_or_at_the_edge(lower, upper):
    leakage = np.array([2e-9, 0.5e-9])
    ends = np.array([1.5e-9, lower]), np.array([4e-9, upper])
    axes = Figure().subplots()
    loads, peaks = np.array([1e8, 2e8]), np.full(2, np.nan)
    leakage_panel(axes, LeakageCurves(loads, peaks, leakage, "median", band=ends))
    (area,) = axes.collections
    x, y = area.get_paths()[0].vertices.T
    assert_allclose(y[x == 100].max(), 4e-9)
    edges = np.clip([lower, upper], *axes.get_ylim())
    assert_allclose([y[x == 200].min(), y[x == 200].max()], edges)


def test_every_limit_has_a_name_and_names_do_not_touch():
    figure = Figure(figsize=(5.4, 4))
    axes = figure.add_axes((0.18, 0.2, 0.5, 0.7))
    axes.set(yscale="log", ylim=(1e-3, 1e3))
    limits = {f"class {n}": 1.02**n for n in range(12)} | {
        "top": 990.0,
        "bottom": 1.1e-3,
        "beyond": 2e3,
    }
    limit_lines(axes, limits)
    FigureCanvasAgg(figure).draw()
    named = ", ".join(text.get_text() for text in axes.texts)
    assert sorted(named.split(", ")) == sorted({*limits} - {"beyond"})
    # of the name alone, without its line
    boxes = sorted(Text.get_window_extent(text).extents[[1, 3]].tolist() for text in axes.texts)
    assert all(upper <= lower + 1 for (_, upper), (lower, _) in pairwise(boxes))
    assert axes.bbox.y0 - 10 < boxes[0][0] < boxes[-1][1] < axes.bbox.y1 + 10


def test_the_legend_of_an_interval_has_the_colours_of_its_areas():
    """One patch for each branch, with the colour and opacity of the area."""
    leakage = np.array([4.0, 2.0, 1.0, 1.2, 1.4]) * 1e-9
    curves = LeakageCurves(
        pressure=np.array([1e7, 2e7, 4e7, 2e7, 1e7]),
        peaks=np.array([np.nan, np.nan, np.nan, 4e7, 4e7]),
        leakage=leakage,
        title="median of the realisations",
        band=(leakage / 2, 2 * leakage),
        band_name="95 % interval",
    )
    axes = Figure().add_subplot()
    handles = leakage_panel(axes, curves)
    legend = axes.legend(handles=handles)
    entry = next(handle for handle in handles if isinstance(handle, BandHandle))
    areas = [area.get_facecolor()[0] for area in axes.collections]
    assert len(areas) == 2
    assert_allclose([patch.get_facecolor() for patch in entry], areas)
    assert [text.get_text() for text in legend.texts][-1] == "95 % interval"
