"""The folder of a run as meshio reads it, and, where it is installed, as ParaView itself opens it."""

import json
import os
import shutil
import subprocess
from itertools import count
from pathlib import Path

import matplotlib.image
import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import steel_scene

import femseal as fs
from femseal.report import write_folder
from femseal.results import assemble
from femseal.results.vtk_files import Cells, write_series

MACRO = Path(__file__).parents[2] / "examples" / "paraview_two_scale.py"
M1, M2 = 3, 4
in_paraview = pytest.mark.skipif(
    shutil.which("pvpython") is None or shutil.which("xvfb-run") is None,
    reason="ParaView is not installed",
)
#: Numbers the calls of ParaView.
CALLS = count()
#: Reads every file it is given and writes, for every time, what is in it.
SCRIPT = """
import json, sys
import paraview.simple as pv
from paraview import servermanager
from vtkmodules.util.numpy_support import vtk_to_numpy
found = {}
for path in sys.argv[2:]:
    source = pv.OpenDataFile(path)
    source.UpdatePipelineInformation()
    steps = found[path] = []
    for time in list(source.GetProperty("TimestepValues") or []) or [None]:
        source.UpdatePipeline() if time is None else source.UpdatePipeline(time)
        data = servermanager.Fetch(source)
        step = {"time": time, "bounds": data.GetBounds()}
        for kind in ("Cell", "Point", "Field"):
            arrays = getattr(data, "Get%sData" % kind)()
            each = [arrays.GetArray(n) for n in range(arrays.GetNumberOfArrays())]
            step[kind] = {a.GetName(): vtk_to_numpy(a).tolist() for a in each}
        steps.append(step)
    pv.Delete(source)
json.dump(found, open(sys.argv[1], "w"))
"""


@pytest.fixture(scope="module")
def results():
    face = fs.turned((48, 96), (60e-6, 120e-6), pitch=27e-6, depth=1e-6, roughness=0.3e-6, rng=2)
    loads = {"loading": (50e6, 700e6), "unload_from": (700e6,), "unloading": (50e6,)}
    scene = steel_scene(face, inlet_pressure=3e7, outlet_pressure=1e6, **loads)
    return assemble(scene, fs.two_scale(scene, (M1, M2)))


@pytest.fixture(scope="module")
def folder(results, tmp_path_factory):
    path = tmp_path_factory.mktemp("a run") / "out"
    write_folder(results, path, results.scene.surface)
    return path


def test_meshio_reads_meshes_of_any_content(tmp_path):
    """Of files of raw bytes meshio gives some arrays the values of others, depending on how well each compresses."""
    rng = np.random.default_rng(3)
    n_steps, left = 60, np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    cells = {f"cell_{n}": rng.normal(size=(n_steps, 2)) for n in range(4)}
    for values in cells.values():
        values[rng.random(values.shape) < rng.random((n_steps, 1))] = 0.0
    grid = Cells("", np.stack([left, left + np.array([1, 0])]), np.zeros((n_steps, 2)), cells)
    write_series("grid", grid.at, range(n_steps), tmp_path)
    for s in range(n_steps):
        mesh = meshio.read(tmp_path / "grid" / f"step_{s:04d}.vtu")
        assert len(mesh.points) == 6
        for name, values in cells.items():
            assert_array_equal(mesh.cell_data[name][0], values[s])


def pvpython(*arguments):
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith("PYTHON")
    }
    # two at a time may both take the display that -a finds free, and a server that ends takes the socket of the next
    # one on its display with it: begin at a number of this process, and of this call
    display = 1000 + (10 * os.getpid() + next(CALLS)) % 50000
    # a server starts anew when its last client leaves, and takes no other one meanwhile: pvpython opens window by window
    server = "-screen 0 1280x1024x24 -noreset"
    command = ["xvfb-run", "-a", "-n", str(display), "-s", server, "pvpython", *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)


@in_paraview
def test_paraview_opens_every_file(results, folder, tmp_path):
    (tmp_path / "read.py").write_text(SCRIPT, encoding="utf-8")
    paths = sorted(p for p in folder.rglob("*.*") if p.suffix in (".pvd", ".vtu", ".vti"))
    run = pvpython(tmp_path / "read.py", tmp_path / "found.json", *paths)
    assert run.returncode == 0, run.stderr
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    assert set(found) == {str(path) for path in paths}
    for path in folder.rglob("*.pvd"):
        steps = found[str(path)]
        fields = [step["Field"] for step in steps]
        assert [step["time"] for step in steps] == [0, 1, 2]
        assert_allclose([f["nominal_pressure_MPa"][0] for f in fields], [50, 700, 50])
        assert_allclose([f["unloaded_from_MPa"][0] for f in fields], [np.nan, np.nan, 700])
    for s, step in enumerate(found[str(folder / "vtk/cells.pvd")]):
        known = meshio.read(folder / f"vtk/cells/step_{s:04d}.vtu").cell_data
        assert step["Cell"].keys() == known.keys()
        for name, (values,) in known.items():
            assert_array_equal(step["Cell"][name], values)
    two = results.two_scale
    for s, step in enumerate(found[str(folder / "fields.pvd")]):
        assert_allclose(step["bounds"][:4], [0, 60e-6, 0, 120e-6])
        for name, values in (
            ("gap_um", two.gap[s] * 1e6),
            ("contact_pressure_MPa", two.contact_pressure[s] / 1e6),
            ("fluid_pressure_MPa", two.fluid_pressure[s] / 1e6),
        ):
            assert_allclose(np.reshape(step["Cell"][name], (48, 96), order="F"), values, rtol=1e-6)
    (heights,) = found[str(folder / "vtk/surface.vti")]
    shown = np.reshape(heights["Point"]["height_um"], (48, 96), order="F")
    assert_allclose(shown, results.scene.surface.heights * 1e6, rtol=1e-6)


@in_paraview
def test_the_macro_draws_both_scales(folder, tmp_path):
    run = pvpython(MACRO, folder, tmp_path / "view.png", 1)
    assert run.returncode == 0, run.stderr
    assert np.ptp(matplotlib.image.imread(tmp_path / "view.png")[..., :3]) > 0.5
    run = pvpython(MACRO, tmp_path, tmp_path / "view.png", 0)
    assert run.returncode == 1
    assert f"there is no {tmp_path / 'vtk' / 'cells.pvd'}" in run.stderr
    assert "Traceback" not in run.stderr
