"""Deterministic runs have maps: in memory, in the dataset, for ParaView, in pictures and on the page."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.plots.drawing import drawn, load_axis
from femseal.plots.maps import default_step, seal_figure
from femseal.report import write_folder
from femseal.report.page import report_html
from femseal.results import assemble
from femseal.results.variables import block_means

pytestmark = pytest.mark.usefixtures("drawn_pictures")

LOADS = (2e7, 2e8, 1.6e9)


@pytest.fixture(scope="module")
def scene():
    face = fs.self_affine(
        (32, 48), (60e-6, 90e-6), hurst=0.8, rms_slope=0.15, roll_off=30e-6, rng=2
    )
    return fs.Scene(face, 115e9, 2.8e9, fs.Liquid(1e-3), 1e6, 1e5, loading=LOADS, unload_from=(2e8,), unloading=(2e7,),
                    fluid_pressure="ignored")  # fmt: skip


@pytest.fixture(scope="module")
def study(scene):
    return fs.deterministic(scene)


@pytest.fixture(scope="module")
def folder(scene, study, tmp_path_factory):
    target = tmp_path_factory.mktemp("deterministic")
    results = assemble(scene, study)
    results.dataset.attrs["face_files"] = json.dumps({"a.x3p": "0123abcd" * 8})
    write_folder(results, target, scene.surface)
    return target


def test_fields_are_those_of_the_contact_and_of_the_flow(scene, study):
    body = fs.HalfSpace(scene.surface.shape, scene.surface.spacing, scene.modulus, scene.boundary)
    gap0 = scene.surface.heights.max() - scene.surface.heights
    contact = fs.solve_contact(
        gap0, body, pressure=LOADS[1], hardness=scene.hardness, rtol=scene.rtol
    )
    assert_allclose(study.contact_pressure[1], contact.pressure, rtol=1e-6)
    assert_allclose(study.contact_pressure[...].mean(axis=(1, 2)), scene.steps.pressures, rtol=1e-5)
    flow = fs.cell_permeability(contact.gap, scene.surface.spacing, sides="periodic")
    assert_allclose(study.fluid_pressure[1], 1e5 + 9e5 * flow.fluid_pressure, rtol=1e-5)
    assert study.fluid_pressure.dtype == study.gap.dtype == np.float32
    # no fluid in contact; the rest of what is undefined are pockets
    assert np.isnan(study.fluid_pressure[study.gap == 0]).all()
    closed = study.leakage == 0
    assert closed.any()
    standing = study.fluid_pressure[closed]
    assert set(np.unique(standing[np.isfinite(standing)]).round()) <= {1e5, 1e6}


def test_the_pressure_of_a_gas_is_that_of_its_potential(scene):
    gas = fs.IdealGas(viscosity=18e-6, molar_mass=29e-3, temperature=293.15)
    flat = replace(scene.surface, heights=np.zeros(scene.surface.shape))
    apart = replace(scene, surface=flat, fluid=gas)
    share = np.array([0.0, 0.25, 1.0])
    assert_allclose(apart.pressure_at(share), np.sqrt(1e10 + share * (1e12 - 1e10)))


def test_the_dataset_has_their_means_over_blocks(scene, study, folder):
    data = fs.open_results(folder).dataset
    assert data["face_gap"].shape == study.gap.shape  # a small face has a block for each pixel
    assert_allclose(data["face_gap"], study.gap)
    assert_allclose(data["face_contact_pressure"], study.contact_pressure)
    assert_allclose(data["face_fluid_pressure"], study.fluid_pressure)
    assert_allclose(data["block1"][[0, -1]], [60e-6 / 64, 60e-6 * 63 / 64])
    assert_allclose(data["face_height"], scene.surface.heights, atol=1e-12)


def test_means_over_blocks():
    values = np.arange(35.0).reshape(5, 7)
    values[0, :4] = np.nan
    found = block_means(values, 2)
    upper = np.mean([7, 8, 9]), np.mean([4, 5, 6, 10, 11, 12, 13])
    assert_allclose(found, [upper, [values[2:, :3].mean(), values[2:, 3:].mean()]])
    assert np.isnan(block_means(np.full((4, 4), np.nan), 2)).all()
    assert_allclose(block_means(values, 9)[1:], values[1:])


def test_they_are_read_back_and_by_vtk(study, folder):
    back = fs.open_results(folder)
    assert back.stored_steps == [0, 1, 2, 3]
    for name in ("gap", "contact_pressure", "fluid_pressure"):
        field = getattr(back, name)(1)
        assert_allclose(field.values, getattr(study, name)[1], rtol=1e-6)
        assert "loading 200 MPa" in field.attrs["long_name"]
    reader = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLImageDataReader()
    reader.SetFileName(str(folder / "fields" / "step_0001.vti"))
    reader.Update()
    arrays = reader.GetOutput().GetCellData()
    from vtkmodules.util.numpy_support import vtk_to_numpy

    for name, unit, expected in (
        ("gap_um", 1e-6, study.gap[1]),
        ("contact_pressure_MPa", 1e6, study.contact_pressure[1]),
        ("fluid_pressure_MPa", 1e6, study.fluid_pressure[1]),
    ):
        values = vtk_to_numpy(arrays.GetArray(name)).reshape(study.gap.shape[1:], order="F")
        assert_allclose(values * unit, expected, rtol=1e-6)


def test_page_and_pictures_show_them(scene, study, folder):
    results = assemble(scene, study)
    step = default_step(results.dataset)
    assert study.leakage[step] > 0
    titles = [axes.get_title() for axes in seal_figure(results, step).axes]
    assert [title.split(" [")[0] for title in titles[:3]] == [
        "contact pressure",
        "gap",
        "fluid pressure",
    ]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<img ") == 6  # face, leakage, three maps, drop
    assert "computed 20" in page
    assert "SHA-256 of a.x3p " + "0123abcd" * 8 in page
    assert (folder / "seal.png").is_file()


def test_the_page_of_a_folder_is_the_one_that_the_run_wrote(folder):
    assert report_html(fs.open_results(folder)) == (folder / "report.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.parametrize("sides", [(1, 1), (1, 2.5), (3, 1), (1, 6)])
def test_panels_fill_the_picture(scene, study, sides):
    """Axes with their colour bars take more than a third of it, whatever the proportions of the face."""
    results = assemble(scene, study)
    data = results.dataset.copy()
    for n, side in enumerate(sides, start=1):
        data[f"face{n}"] = data[f"face{n}"] * (side * 1e-4 / float(data[f"face{n}"][-1]))
    figure = seal_figure(replace(results, dataset=data))
    figure.draw_without_rendering()
    boxes = [axes.get_window_extent() for axes in figure.axes]
    assert sum(box.width * box.height for box in boxes) > figure.bbox.width * figure.bbox.height / 3
    assert figure.get_figwidth() == 5.4


def test_panels_are_cut_out_of_the_picture(scene, study):
    from io import BytesIO

    from PIL import Image

    drawing = drawn(seal_figure(assemble(scene, study)))
    whole, first = (
        np.asarray(Image.open(BytesIO(png))) for png in (drawing.whole, drawing.panels[0])
    )
    assert len(drawing.panels) == 4
    n1 = len(first)
    assert any((whole[row : row + n1] == first).all() for row in range(whole.shape[0] - n1))


@pytest.mark.parametrize(
    ("loads", "scale"),
    [
        ((5, 20, 40, 80), "log"),
        ((1, 10, 100, 400), "log"),
        ((100, 200, 300, 400), "linear"),
        ((0, 5, 50), "symlog"),
        ((0, 100, 200), "linear"),
        ((7,), "linear"),
        ((0,), "linear"),
    ],
)
def test_loads_are_spread_over_the_axis(loads, scale):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 4))
    axes = figure.add_subplot()
    load_axis(axes, np.array(loads, float))
    figure.canvas.draw()
    assert axes.get_xscale() == scale
    places = axes.transAxes.inverted().transform(
        axes.transData.transform([(load, 0.5) for load in loads])
    )[:, 0]
    if max(loads) > 0:
        assert ((places >= 0) & (places <= 1)).all()
    if len(loads) > 1:
        assert np.diff(places).min() > 0.15
        load_axis(axes, np.array(loads, float), logarithmic=True)
        assert axes.get_xscale() == ("log" if min(loads) > 0 else "symlog")
