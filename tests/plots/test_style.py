"""Pictures have the quality of those in a journal: one style, units on the axes, every load, every pixel, vectors."""

import base64
import io
import re
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from PIL import Image
from small_cases import TABLES, steel_scene

import femseal as fs
from femseal.base import InputError
from femseal.plots.heights import draw_heights, survey_figure
from femseal.plots.maps import default_step, relative_flow
from femseal.plots.realisations import realisation_figure
from femseal.plots.streamlines import draw_streamlines
from femseal.plots.style import PAGE, rendered
from femseal.results import assemble
from femseal.results.file_options import read_formats

pytestmark = pytest.mark.usefixtures("drawn_pictures")

UNIT = re.compile(r"\[[^\]]+\]$")
#: Loads of the run: three on loading, and two on unloading.
LOADS = {"loading": (5e7, 1e8, 2e8), "unload_from": (2e8,), "unloading": (1e8, 5e7)}


@pytest.fixture(scope="module")
def results():
    """A stochastic run that also solved the surface, of more pixels along x2 than a dataset has blocks."""
    face = fs.self_affine(
        (48, 144), (6e-5, 1.8e-4), hurst=0.8, rms_slope=0.2, roll_off=3e-5, cut_off=1e-5, rng=1
    )
    scene = steel_scene(face, **LOADS)
    two_scale = fs.two_scale(scene, (2, 6))
    stochastic = fs.stochastic(scene, (2, 6), fs.Sampling(3.6e-4, 5, seed=1))
    return assemble(scene, two_scale, stochastic)


@pytest.fixture(scope="module")
def figures(results):
    names = ("leakage", "cells", "seal", "realisation", "pressure", "surface")
    return {name: getattr(results.plot, name)() for name in names}


def test_every_picture_is_as_wide_as_a_column_and_has_units_on_its_axes(figures):
    for name, figure in figures.items():
        assert figure.get_figwidth() == pytest.approx(85 / 25.4), name
        for axes in figure.axes:
            for label in (axes.get_xlabel(), axes.get_ylabel()):
                assert UNIT.search(label), (name, label)
            for image in axes.images:
                if image.colorbar is not None:
                    assert UNIT.search(image.colorbar.ax.get_xlabel()), name
            assert "[" not in axes.get_title()
        assert figure._suptitle is None or "[" not in figure._suptitle.get_text()


def test_maps_show_a_load_at_which_the_tiles_leak(results):
    """Near closing the surface may leak past all of its cells, and the tiles of the realisation then show no flow."""
    data = results.dataset.copy(deep=True)
    highest = default_step(data)
    data["drawn_flux"][highest] = 0.0
    lower = default_step(data)
    assert lower != highest
    assert np.any(data["drawn_flux"].values[lower] != 0)
    assert "no flow through the tiles" in realisation_figure(data, highest)._suptitle.get_text()
    data["drawn_flux"][:] = 0.0
    assert default_step(data) == highest


def test_letters_can_be_read_in_print(figures):
    for name, figure in figures.items():
        for text in figure.findobj(matplotlib.text.Text):
            if text.get_text() and text.get_visible():
                assert 6.5 <= text.get_fontsize() <= 8, (name, text.get_text())


def test_panels_and_their_labels_do_not_leave_the_picture(figures):
    for name, figure in figures.items():
        FigureCanvasAgg(figure).draw()
        width, height = figure.bbox.size
        for axes in figure.axes:
            box = axes.get_tightbbox()
            assert -2 <= box.x0 < box.x1 <= width + 2, name
            assert -2 <= box.y0 < box.y1 <= height + 2, name


def test_the_style_of_the_user_does_not_matter_and_stays(results):
    first = rendered(results.plot.leakage(), "png")
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "black", "lines.linewidth": 5}):
        assert rendered(results.plot.leakage(), "png") == first
        assert matplotlib.rcParams["font.size"] == 20


def test_axes_of_the_user_have_the_style_of_the_user(results):
    with matplotlib.rc_context({"axes.labelsize": 15}):
        axes = Figure().add_subplot()
        results.plot(ax=axes)
        assert axes.xaxis.label.get_fontsize() == 15


# --- maps -------------------------------------------------------------------------------------------------


def test_maps_show_every_pixel(results, figures):
    step = 2  # the highest load
    assert max(results.dataset["face_gap"].shape) < 144
    gap = results.gap(step).values
    image = figures["seal"].axes[1].images[0]
    shown = np.ma.filled(image.get_array(), 0.0)  # x1 is vertical: the map lies on its side
    assert_allclose(shown, np.maximum(gap, 0) * 1e6, rtol=1e-6)
    assert image.get_interpolation() == "none"
    pressure = figures["seal"].axes[0].images[0]
    assert_allclose(np.ma.filled(pressure.get_array(), 0.0) * 1e6, results.contact_pressure(step))
    left, right = (figures["seal"].axes[0].get_position().extents[[0, 2]]) * PAGE
    assert right - left > 2.6  # inch: the map fills the width


def test_vector_pictures_contain_every_pixel_of_a_map(results, tmp_path):
    (path,) = results.plot.write(tmp_path, ["svg"], ["seal"])
    root = ElementTree.parse(path).getroot()
    sizes = []
    for image in (element for element in root.iter() if element.tag.endswith("image")):
        data = next(value for name, value in image.attrib.items() if name.endswith("href"))
        sizes.append(Image.open(io.BytesIO(base64.b64decode(data.split(",", 1)[1]))).size)
    assert sizes.count((144, 48)) == 4  # three maps, and the flow


def test_heights_are_a_shaded_relief():
    """A slope that rises to the upper left is in the shadow on the other side of the ridge."""
    axes = Figure().add_subplot()
    x = np.arange(40.0)
    ridge = -np.abs(x - 20)[:, None] + np.zeros((40, 40))
    draw_heights(axes, ridge, (4e-5, 4e-5))
    heights, shade = axes.images
    assert_allclose(heights.get_array(), ridge.T)
    colour = shade.get_array()
    left, right = colour[20, 5], colour[20, 35]  # the light comes from the left
    assert_allclose(left[:3], 1.0)
    assert_allclose(right[:3], 0.0)
    assert left[3] > 0.05
    assert right[3] > 0.05
    level = Figure().add_subplot()
    draw_heights(level, np.zeros((8, 8)), (4e-5, 4e-5))
    assert len(level.images) == 1


def test_flow_between_parallel_plates_is_even_and_stops_at_a_wall():
    gap = np.full((10, 8), 1e-6)
    pressure = np.broadcast_to(np.linspace(1e6, 1e5, 10)[:, None], gap.shape).copy()
    assert_allclose(relative_flow(gap, pressure, (1e-4, 8e-5)), 1.0)
    gap[:, 3], pressure[:, 3] = 0.0, np.nan
    flow = relative_flow(gap, pressure, (1e-4, 8e-5))
    assert_allclose(flow[:, 3], 0.0)
    assert_allclose(np.delete(flow, 3, axis=1), 1.0)


@pytest.mark.parametrize("is_long", [False, True])
def test_dots_of_spikes_lie_on_the_spikes_of_a_surveyed_face(is_long):
    """Also if the map lies on its side."""
    heights = fs.self_affine((40, 80), (4e-5, 8e-5), hurst=0.8, rms_slope=0.1, rng=3).heights
    heights = heights.copy() if is_long else heights[:, :40].copy()
    heights[10, 30] += 50e-6
    axes = survey_figure(fs.Topography(heights, (1e-6, 1e-6))).axes[0]
    dots = axes.lines[-1]
    position = (30.5, 10.5) if is_long else (10.5, 30.5)
    assert_allclose([dots.get_xdata(), dots.get_ydata()], np.transpose([position]))


# --- lines ------------------------------------------------------------------------------------------------


def test_every_load_that_leaks_has_a_line_and_a_name(results, figures):
    data = results.dataset
    leaking = np.flatnonzero(np.nan_to_num(data["leakage_two_scale"].values) != 0)
    pressure = data["face_fluid_pressure"].values / 1e6
    lines = figures["pressure"].axes[0].lines
    assert len(lines) == leaking.size > 3
    for line, step in zip(lines, leaking, strict=True):
        assert_allclose(line.get_ydata(), np.nanmean(pressure[step], axis=1), rtol=1e-5)
        names = line.get_label()
        assert names.startswith(f"{data['nominal_pressure'].values[step] / 1e6:g} MPa")
    (legend,) = figures["pressure"].legends
    assert len(legend.get_texts()) == leaking.size + 1


def test_colours_of_cells_name_every_load(results, figures):
    gap_axes, pressure_axes = figures["cells"].axes
    bars = [a for a in gap_axes.child_axes if a.get_xlabel() == "nominal pressure [MPa]"]
    assert [text.get_text() for text in bars[0].get_xticklabels()] == ["50", "100", "200"]
    k = results.dataset["state_k1"].values.reshape(5, -1)
    medians = [line for line in pressure_axes.lines if str(line.get_label()).startswith("median")]
    assert len(medians) == 2
    expected = [np.median(row[row > k.max() * 1e-6]) for row in k[:3]]
    assert_allclose(medians[0].get_ydata(), expected)


def test_realisations_have_streamlines_from_the_inlet_to_the_outlet(figures):
    for axes in figures["realisation"].axes[-2:]:
        streams = [c for c in axes.collections if isinstance(c, LineCollection)]
        path = next(c for c in streams if c.get_label() == "path")
        assert len(streams) == 2
        points = np.concatenate(path.get_segments())
        (bottom, top), height = axes.get_ylim(), np.ptp(axes.get_ylim())
        assert points[:, 1].min() < bottom + 0.1 * height
        assert points[:, 1].max() > top - 0.1 * height


def test_a_narrow_ring_has_streamlines_and_its_path():
    """They are short beside the picture."""
    angles = np.linspace(0, 2 * np.pi, 181)
    inner, outer = (
        np.stack([r * np.cos(angles), r * np.sin(angles)], axis=1) for r in (11.0, 12.0)
    )
    corners = np.stack([inner[:-1], outer[:-1], outer[1:], inner[1:]], axis=1)
    middle = corners.mean(axis=1)
    axes = Figure(figsize=(3, 3)).add_axes((0, 0, 1, 1))
    axes.set(xlim=(-12, 12), ylim=(-12, 12))
    draw_streamlines(axes, corners, middle, "white", middle[20])
    lines, path = (np.concatenate(lines.get_segments()) for lines in axes.collections)
    assert len(lines) > 50
    radius = np.hypot(*path.T)
    assert radius.min() < 11.2
    assert radius.max() > 11.8
    assert_allclose(np.arctan2(*path.T), np.arctan2(*middle[20]), atol=0.05)


def test_no_streamline_leaves_the_seal():
    """The tiles are large triangles between two hexagons, and the flow is radial."""
    outer = np.stack([f(np.arange(7) * np.pi / 3) for f in (np.cos, np.sin)], axis=1)
    inner = 0.8 * outer
    corners = np.concatenate(
        [
            np.stack([inner[:-1], outer[:-1], outer[1:]], axis=1),
            np.stack([inner[:-1], outer[1:], inner[1:]], axis=1),
        ]
    )
    axes = Figure(figsize=(3, 3)).add_axes((0, 0, 1, 1))
    axes.set(xlim=(-1, 1), ylim=(-1, 1))
    draw_streamlines(axes, corners, corners.mean(axis=1), "white")
    x, y = np.concatenate(axes.collections[0].get_segments()).T
    normals = (np.arange(6) + 0.5) * np.pi / 3
    distance = (np.cos(normals)[:, None] * x + np.sin(normals)[:, None] * y).max(axis=0)
    apothem, pixel = np.cos(np.pi / 6), 2 / 160
    assert len(x) > 50
    assert distance.min() > 0.8 * apothem - 3 * pixel
    assert distance.max() < apothem + 3 * pixel


# --- formats ----------------------------------------------------------------------------------------------


def test_pictures_are_written_as_vectors(results, tmp_path):
    paths = results.plot.write(tmp_path, ["svg", "pdf"], ["leakage"])
    assert [path.name for path in paths] == ["leakage.svg", "leakage.pdf"]
    svg, pdf = (path.read_bytes() for path in paths)
    root = ElementTree.fromstring(svg)
    assert root.get("width") == f"{PAGE * 72:.6f}pt"
    assert not [e for e in root.iter() if e.tag.endswith("image")]  # lines alone
    assert pdf.startswith(b"%PDF")
    assert pdf.rstrip().endswith(b"%%EOF")
    assert b"/Subtype /Type3" not in pdf  # fonts that journals accept
    again = results.plot.write(tmp_path / "again", ["svg", "pdf"], ["leakage"])
    assert [path.read_bytes() for path in again] == [svg, pdf]
    pyplot.close("all")


def test_formats_and_pictures_that_are_unknown_are_refused(results, tmp_path):
    assert read_formats(" SVG, .pdf,svg") == ("svg", "pdf")
    with pytest.raises(InputError, match="svg,pdf"):
        read_formats("svg,gif")
    for options, what in (
        ({"formats": ["gif"]}, "format"),
        ({"formats": "svg"}, "format"),
        ({"names": ["seel"]}, "picture"),
        ({"step": 99}, "step"),
    ):
        with pytest.raises(InputError) as caught:
            results.plot.write(tmp_path / "none", **options)
        assert caught.value.what == what
    assert not (tmp_path / "none").exists()
    with pytest.raises(InputError, match="the results have no folder either"):
        results.plot.write()


CASE = f"""
method = "deterministic"
[face]
kind = "self-affine"
points = [24, 32]
size = ["30 um", "40 um"]
rms_slope = 0.2
roll_off = "20 um"
{TABLES}[output]
report = false
budget = false
paraview = "none"
"""


def test_commands_write_the_formats_that_are_asked_for(femseal, tmp_path):
    case, out = tmp_path / "case.toml", tmp_path / "out"
    case.write_text(CASE, encoding="utf-8")
    run = ["run", case, "-o", out, "--workers", 1, "--quiet", "--format"]
    assert femseal(*run, "svg,gif")[0] == 2
    assert not out.exists()
    assert femseal(*run, "svg,pdf")[0] == 0
    assert {path.suffix for path in out.glob("leakage.*")} == {".svg", ".pdf"}
    ElementTree.parse(out / "leakage.svg")
    assert "leakage.svg" in (out / "files.txt").read_text()
    code, text, _ = femseal("plot", out, "seal", "--format", "pdf", "--step", 0, "-o", tmp_path)
    assert code == 0
    assert text.strip() == str(tmp_path / "seal.pdf")
    assert (tmp_path / "seal.pdf").read_bytes().startswith(b"%PDF")
    assert femseal("plot", out, "cells")[0] == 2  # a deterministic run has no cells
