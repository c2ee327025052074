"""The window of `femseal view`: its fields are those of the results, and a picture of it can be written."""

import os
import subprocess
import sys

import matplotlib.image
import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import TABLES

import femseal as fs
from femseal.base import InputError
from femseal.plots.surface_view import _heights_and_sides, surface_mesh, view_surface
from femseal.plots.view import ends_of_seal, seal_meshes, surface_meshes, view_run

CASE = f"""
method = "stochastic"
compare = ["two-scale"]
seed = 2
[face]
kind = "self-affine"
points = [32, 64]
size = ["30 um", "60 um"]
rms_slope = 0.2
roll_off = "20 um"
{TABLES}[cells]
count = [2, 4]
[stochastic]
length = "120 um"
realisations = 3
[output]
pictures = false
report = false
budget = false
"""
PROBE = """
import pyvista as pv, sys
probe = pv.Plotter(off_screen=True)
probe.add_mesh(pv.Sphere())
probe.screenshot(sys.argv[1])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("view")
    (path / "case.toml").write_text(CASE, encoding="utf-8")
    fs.run(path / "case.toml", path / "results", workers=1)
    return path / "results"


def test_fields_of_the_window_are_those_of_the_results(folder):
    results = fs.open_results(folder)
    meshes = surface_meshes(results, 1, ["contact_pressure", "gap"])
    image = meshes["contact_pressure"]
    wanted = results.contact_pressure(1).values / 1e6
    assert_allclose(
        image.cell_data["contact pressure [MPa]"].reshape(wanted.shape, order="F"), wanted
    )
    assert_allclose(image.bounds[:4], [0, 30, 0, 60], rtol=1e-6)
    gap = np.asarray(meshes["gap"].cell_data["gap [µm]"])
    assert np.isnan(gap).sum() == (results.gap(1).values <= 0).sum() > 0
    tiles = seal_meshes(results, 0, ["fluid_pressure"])["fluid_pressure"]
    assert tiles.n_cells == len(results.dataset["drawn_corners"])
    assert_allclose(
        tiles.cell_data["fluid pressure [MPa]"],
        results.dataset["drawn_fluid_pressure"].values[0].ravel() / 1e6,
    )
    assert ends_of_seal(results) is None  # a strip


def test_the_surface_has_its_heights(folder):
    results = fs.open_results(folder)
    heights = results.dataset["face_height"].values
    mesh, factor = surface_mesh(*_heights_and_sides(results), None)
    assert_allclose(mesh.bounds[:4], [15 / 32, 30 - 15 / 32, 30 / 64, 60 - 30 / 64], rtol=1e-6)
    z = mesh.points[:, 2].reshape(heights.shape, order="F")
    assert_allclose(z, factor * heights * 1e6, rtol=1e-5, atol=1e-6)
    assert_allclose(mesh.point_data["height [µm]"], z.ravel(order="F") / factor, rtol=1e-5)
    assert 0.04 < np.ptp(z) / 60 < 0.125
    face = fs.Topography(np.full((8, 8), np.nan), (1e-6, 1e-6))
    with pytest.raises(InputError, match="undefined"):
        view_surface(face, picture="x.png")


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"field": "height"}, "field"),
        ({"step": 99}, "step"),
        ({"picture": "view.gif"}, "output"),
        ({"field": "gap", "seal": True, "picture": "view.png"}, "field"),
    ],
)
def test_what_cannot_be_shown_is_refused(folder, options, what):
    with pytest.raises(InputError) as caught:
        view_run(fs.open_results(folder), **options)
    assert caught.value.what == what


@pytest.mark.slow
def test_the_window_is_drawn(folder, tmp_path):
    surroundings = dict(os.environ)
    if not surroundings.get("DISPLAY"):
        surroundings["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"
    picture = tmp_path / "view.png"

    def runs(*command):
        return subprocess.run(
            [sys.executable, *map(str, command)],
            env=surroundings,
            capture_output=True,
            text=True,
            timeout=300,
        )

    if runs("-c", PROBE, tmp_path / "probe.png").returncode:
        pytest.skip("nothing can be drawn off screen here")
    found = runs("-m", "femseal", "view", folder, "-o", picture)
    assert found.returncode == 0, found.stderr
    image = matplotlib.image.imread(picture)[..., :3]
    # three panels, each with a picture in colours on white
    for panel in np.array_split(image, 3, axis=1):
        assert 0.02 < np.mean(panel.min(axis=-1) < 0.5) < 0.8
