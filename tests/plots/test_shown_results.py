"""Results show themselves: one line without arrays, a table, a picture of their own numbers."""

import io
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray
from matplotlib import pyplot
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import InputError, Shown
from femseal.base.leak_units import leakage_unit
from femseal.plots.map_panels import clip_to_decades
from femseal.plots.pressure_lines import surface_leakage
from femseal.studies import STUDIES, Study

MODULUS, HARDNESS = 115e9, 1.4e9


@pytest.fixture(scope="module")
def face():
    return fs.self_affine(
        (32, 64), (40e-6, 80e-6), hurst=0.8, rms_slope=0.15, roll_off=30e-6, rng=2
    )


@pytest.fixture(scope="module")
def states(face):
    body = fs.HalfSpace(face.shape, face.spacing, MODULUS)
    cycle = {"loading": [5e7, 4e8], "unload_from": [4e8], "unloading": [1e8]}
    return fs.load_cycle(face.gap(), body, hardness=HARDNESS, **cycle)


@pytest.fixture(scope="module")
def shown(face, states):
    way = {"loading": (5e7, 4e8), "unload_from": (4e8,), "unloading": (1e8,)}
    scene = steel_scene(face, hardness=HARDNESS, **way)
    k = fs.cell_permeability(states[0].contact.gap, face.spacing)
    seal = fs.RectangularSeal(face.size, (3, 4))
    return {
        "topography": face,
        "contact": states[0].contact,
        "state": states[2],
        "cycle": states,
        "permeability": k,
        "leakage": fs.seal_leakage(seal, k.value, fs.Liquid(1e-3), inlet_pressure=1e6),
        "deterministic": fs.deterministic(scene),
        "two_scale": fs.two_scale(scene, (2, 4)),
        "stochastic": fs.stochastic(scene, (2, 4), fs.Sampling(160e-6, 20, seed=1)),
    }


def test_a_nearly_even_flow_has_a_scale_whose_ticks_differ():
    _, norm = clip_to_decades(np.array([35.51, 35.52]), 4)
    assert norm.vmax == 35.52
    assert norm.vmin < 0.99 * norm.vmax


NAMES = [
    "topography",
    "contact",
    "state",
    "cycle",
    "permeability",
    "leakage",
    "deterministic",
    "two_scale",
    "stochastic",
]


def test_few_outliers_leave_the_colours_to_the_others(face):
    """A spike and a pit do not set the range; the bar says what is out of it."""
    z = face.heights.copy()
    z[3, 4], z[20, 30], z[5, 5:8] = 100e-6, -50e-6, np.nan
    image = fs.Topography(z, face.spacing).plot().axes[0].images[0]
    ends = np.array([face.heights.min(), face.heights.max()])
    assert_allclose(image.get_clim(), ends * 1e6, rtol=1e-12)
    share = f"{100 / (z.size - 3):.2g} %"
    key = [text.get_text() for text in image.axes.get_legend().get_texts()]
    assert key == [f"{share} above", f"{share} below"]
    for level in (np.full((4, 4), np.nan), np.zeros((4, 4))):
        fs.Topography(level, (1e-6, 1e-6)).plot().savefig(io.BytesIO(), dpi=40)


@pytest.mark.parametrize("name", NAMES)
def test_results_show_themselves(shown, name):
    """In one short line without arrays, a well-formed table, and a picture."""
    line = repr(shown[name])
    assert line.startswith(type(shown[name]).__name__ + "(")
    assert len(line) < 900
    assert not {"array", "\n"} & {*line.split("("), *line}
    table = ElementTree.fromstring(f"<div>{shown[name]._repr_html_()}</div>")
    assert len(list(table.iter("tr"))) >= 3
    picture = io.BytesIO()
    shown[name].plot().savefig(picture, dpi=40)
    assert len(picture.getvalue()) > 2000


def test_pictures_show_the_numbers(shown):
    pressure, gap = (axes.images[0].get_array() for axes in shown["contact"].plot().axes[:2])
    contact = shown["contact"]
    assert_allclose(np.nan_to_num(np.ma.filled(pressure, 0.0)) * 1e6, contact.pressure)
    assert_allclose(np.nan_to_num(np.ma.filled(gap, 0.0)) * 1e-6, contact.gap)
    loading, unloading = shown["cycle"].plot().axes[0].lines
    assert_allclose(loading.get_xdata(), [50, 400])
    assert_allclose(unloading.get_xdata(), [400, 100])  # from the peak on
    shares = [100 * s.contact.area_fraction for s in shown["cycle"]]
    assert_allclose(unloading.get_ydata(), shares[1:])
    drop = shown["permeability"].plot().axes[0].images[0].get_array()
    assert drop.shape == (32, 64)


@pytest.mark.parametrize(
    "name", ["permeability", "leakage", "deterministic", "two_scale", "stochastic"]
)
def test_pictures_of_one_panel_are_drawn_into_given_axes(shown, name):
    figure = Figure()
    axes = figure.subplots(1, 2)[1]
    assert shown[name].plot(ax=axes) is figure
    assert axes.images or axes.lines
    assert not [*figure.axes[0].images, *figure.axes[0].lines]


def test_what_has_no_such_picture_says_so(shown):
    class Bare(Shown):
        pass

    seal = fs.MeshSeal(Path(__file__).parents[2] / "meshes" / "ring.msh", "inlet", "outlet")
    leakage = fs.seal_leakage(seal, 1e-18, fs.Liquid(1e-3), inlet_pressure=1e6)
    for result, said in ((Bare(), "plot: given a Bare"), (leakage, "mesh")):
        with pytest.raises(InputError, match=said):
            result.plot()
    for name in ("topography", "contact", "cycle"):
        with pytest.raises(InputError, match="option 'ax'"):
            shown[name].plot(ax=Figure().add_subplot())


def test_leakages_are_drawn_together(shown):
    """In one unit, m²/s, whatever was drawn first."""
    axes, two = Figure().add_subplot(), shown["two_scale"]
    tight = replace(two, leakage=np.array([1e-6, 0.0, 1e-6]) * two.leakage)
    for study, label in ((two, "rough"), (tight, "smooth")):
        study.plot(ax=axes, label=label)
    assert axes.get_ylabel().endswith("[m²/s]")
    loading = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert_allclose(loading["rough, loading"], two.leakage[:2])
    assert_allclose(loading["smooth, loading"], [tight.leakage[0], np.nan])
    low, high = axes.get_ylim()
    assert low < tight.leakage[0] < two.leakage.max() < high
    assert [text.get_text() for text in axes.texts] == ["sealed"]
    alone = shown["deterministic"].plot().axes[0]
    line = next(line for line in alone.lines if line.get_label() == "loading")
    factor, _ = leakage_unit(shown["deterministic"].leakage)
    assert_allclose(line.get_ydata() * factor, shown["deterministic"].leakage[:2])


def test_pyplot_shows_pictures(shown):
    """`pyplot.show()` opens what `plot()` made; what is drawn into axes that are there is in their figure."""
    pyplot.close("all")
    figure = shown["permeability"].plot()
    assert [pyplot.figure(number) for number in pyplot.get_fignums()] == [figure]
    shown["permeability"].plot(ax=Figure().add_subplot())
    assert len(pyplot.get_fignums()) == 1


CELLS = (
    "face.plot();",
    "face.plot()",
    "figure = face.plot()",
    "face.plot(); face.plot()",
    "1",
    "figure",
)


def test_the_leakage_of_the_surface_is_that_of_any_registered_study(monkeypatch):
    """The method that solves the surface comes before the median of the realisations."""

    class DryStudy(Study):
        name = "dry"

    monkeypatch.setitem(STUDIES, "dry", DryStudy())
    data = xarray.Dataset({"leakage_median": ("step", [1.0]), "leakage_dry": ("step", [2.0])})
    assert surface_leakage(data).tolist() == [2]
    assert surface_leakage(data.drop_vars("leakage_dry")).tolist() == [1]


def test_a_notebook_shows_a_figure_once(tmp_path):
    """Whatever the cell ends with; a figure of an earlier cell once more where it is asked for."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    first = (
        "import numpy as np, femseal as fs\nface = fs.Topography(np.eye(8) * 1e-6, (1e-6, 1e-6))"
    )
    book = nbformat.v4.new_notebook(
        cells=[nbformat.v4.new_code_cell(text) for text in (first, *CELLS)]
    )
    nbclient.NotebookClient(book, timeout=300).execute()
    counts = [
        sum("image/png" in out.get("data", {}) for out in cell.outputs) for cell in book.cells[1:]
    ]
    assert counts == [1, 1, 1, 2, 0, 1]
