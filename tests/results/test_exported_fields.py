"""Fields of a run as VTK's own readers and `open_results` give them back; results by branch, cell and step."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import pyvista
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import STRIP

import femseal as fs
from femseal.base import FemsealError, InputError
from femseal.case import parse_case
from femseal.fluids import Liquid
from femseal.report import write_folder
from femseal.results import RunFacts, assemble, open_results, save
from femseal.results.pixel_fields import plan_fields
from femseal.studies import Sampling, Scene, deterministic, stochastic, two_scale
from femseal.topography import read_topography, turned

EXAMPLES = Path(__file__).parents[2] / "examples"
M1, M2 = 3, 4


@pytest.fixture(scope="module")
def scene():
    surface = turned((48, 96), (60e-6, 120e-6), pitch=27e-6, depth=1e-6, roughness=0.3e-6, rng=2)
    return Scene(
        surface,
        115e9,
        2.8e9,
        Liquid(1e-3, pressure_viscosity=5e-8),
        3e7,
        1e6,
        loading=(50e6, 200e6, 700e6),
        unload_from=(200e6, 700e6),
        unloading=(300e6, 50e6),
    )


@pytest.fixture(scope="module")
def studies(scene):
    sampling = Sampling(240e-6, 3, seed=7)
    return {
        "deterministic": deterministic(scene),
        "two_scale": two_scale(scene, (M1, M2)),
        "stochastic": stochastic(scene, (M1, M2), sampling),
    }


@pytest.fixture(scope="module")
def results(scene, studies):
    return assemble(
        scene,
        *studies.values(),
        facts=RunFacts(case={"title": "trial"}, timings={"two-scale": 1.5}),
    )


@pytest.fixture(scope="module")
def folder(results, scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("run")
    write_folder(results, path, scene.surface)
    return path


@pytest.fixture(scope="module")
def back(folder):
    return open_results(folder)


def in_time(path):
    """Step, cell data, point data, field data and mesh of every time of a collection."""
    reader = pyvista.get_reader(path)
    for time in reader.time_values:
        reader.set_active_time_value(time)
        (mesh,) = reader.read()
        assert all(len(values) == 1 for values in mesh.field_data.values())
        yield (
            time,
            mesh.cell_data,
            mesh.point_data,
            {n: a[0] for n, a in mesh.field_data.items()},
            mesh,
        )


def same_steps(steps, fields):
    assert_allclose([f["nominal_pressure_MPa"] for f in fields], [s.pressure / 1e6 for s in steps])
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from / 1e6 for s in steps]
    assert_allclose([f["unloaded_from_MPa"] for f in fields], peaks)


# --- files, read by pyvista -------------------------------------------------------------------------------


def test_seal_is_a_mesh_in_time(results, folder):
    data = results.dataset
    read = list(in_time(folder / "vtk/cells.pvd"))
    # time is the step: loads come back on unloading
    assert [time for time, *_ in read] == list(range(6))
    same_steps(results.steps, [fields for *_, fields, _ in read])
    for s, (_, cells, points, _, grid) in enumerate(read):
        assert (grid.n_cells, grid.n_points) == (M1 * M2, (M1 + 1) * (M2 + 1))
        for name, variable, factor in (
            ("k1_m3", "cell_k1", 1),
            ("k2_m3", "cell_k2", 1),
            ("pressure_MPa", "cell_pressure", 1e-6),
            ("mean_gap_um", "cell_mean_gap", 1e6),
            ("contact_fraction", "cell_contact_fraction", 1),
            ("plastic_fraction", "cell_plastic_fraction", 1),
            ("drop_fraction", "cell_drop_fraction", 1),
        ):
            assert_allclose(cells[name].reshape(M1, M2), data[variable][s] * factor, rtol=1e-12)
        assert not points
    x1, x2 = (data[name].values for name in ("cell1", "cell2"))
    number = grid.find_containing_cell((x1[1] * 1.02, x2[2] * 1.02, 0.0))
    assert cells["k1_m3"][number] == data["cell_k1"][-1, 1, 2]


def test_fields_over_all_pixels(results, studies, scene, folder):
    two, (d1, d2) = studies["two_scale"], scene.surface.spacing
    read = list(in_time(folder / "fields.pvd"))
    assert [time for time, *_ in read] == list(range(6))
    same_steps(results.steps, [fields for *_, fields, _ in read])
    for s, (_, cells, _, _, image) in enumerate(read):
        assert_allclose(image.bounds[:4], (0, 60e-6, 0, 120e-6))
        pixel = image.find_containing_cell((7.5 * d1, 77.5 * d2, 0.0))
        for name, values in (
            ("gap_um", two.gap[s] * 1e6),
            ("contact_pressure_MPa", two.contact_pressure[s] / 1e6),
            ("fluid_pressure_MPa", two.fluid_pressure[s] / 1e6),
        ):
            assert_allclose(cells[name].reshape(48, 96, order="F"), values, rtol=1e-6)
            assert_allclose(cells[name][pixel], values[7, 77], rtol=1e-6)
        assert np.isnan(two.fluid_pressure[s][two.gap[s] <= 0]).all()


def test_heights_are_points(scene, folder):
    image = pyvista.read(folder / "vtk/surface.vti")
    found, expected = image.point_data["height_um"], scene.surface.heights * 1e6
    assert_allclose(found.reshape(48, 96, order="F"), expected, rtol=1e-6)
    d1, d2 = scene.surface.spacing
    place = image.FindPoint(5.5 * d1, 77.5 * d2, 0.0)
    assert_allclose(found[place], expected[5, 77], rtol=1e-6)


def test_names_are_plain_and_carry_units(folder):
    units = ("_MPa", "_um", "_m3", "_m2_per_s", "_fraction", "Time")
    for path in folder.glob("**/*.pvd"):
        _, cells, points, fields, _ = next(in_time(path))
        for name in (*cells, *points, *fields):
            assert name.replace("_", "").isalnum()
            assert name.endswith(units)


# --- size -------------------------------------------------------------------------------------------------


def test_steps_above_the_limit_are_left_out_and_named(results, scene, studies, tmp_path):
    each = 3 * 4 * 48 * 96
    for limit, kept in (
        (6 * each, range(6)),
        (3.5 * each, (2, 3, 5)),
        (each, (2,)),
        (each - 1, ()),
    ):
        steps, left_out = plan_fields(results, limit)
        assert list(steps) == list(kept)
        assert bool(left_out) == (len(kept) < 6)
    write_folder(results, tmp_path, scene.surface, fields_limit=3.5 * each)
    back = open_results(tmp_path)
    (text,) = back.left_out
    assert text.startswith("fields over all pixels at steps 0, 1, 4: 332 kB of all steps are above")
    assert text in repr(back)
    assert back.stored_steps == [2, 3, 5]
    assert [time for time, *_ in in_time(tmp_path / "fields.pvd")] == [2, 3, 5]
    assert_allclose(back.gap(5), studies["two_scale"].gap[5], rtol=1e-6)
    with pytest.raises(InputError, match="given 1, which has no gap, expected one of 2, 3, 5"):
        back.gap(1)
    for path in (tmp_path / "fields").iterdir():
        path.unlink()
    with pytest.raises(InputError, match=r"step: given 5, .* or in `compare`, with fields = true"):
        open_results(tmp_path).gap(5)


# --- results ----------------------------------------------------------------------------------------------


def test_branches_are_labelled(back, studies, scene):
    up, down = back.loading(), back.unloading()
    median = studies["stochastic"].quantile(0.5)
    assert list(up["nominal_pressure"]) == [50e6, 200e6, 700e6]
    assert_array_equal(up["leakage_median"].sel(nominal_pressure=[50e6, 700e6]), median[[0, 2]])
    assert list(down["nominal_pressure"]) == [700e6, 300e6, 50e6]
    assert_array_equal(down["leakage_median"], median[[2, 4, 5]])
    assert down["cell_k1"].dims == ("nominal_pressure", "cell1", "cell2")
    for peak in (200e6, "200 MPa", "0.2 GPa"):
        found = back.unloading(from_=peak)["leakage_two_scale"]
        assert_array_equal(found, studies["two_scale"].leakage[[1, 3]])
    for peak, said in (
        ("300 MPa", "given 300 MPa, expected one of 200 MPa, 700 MPa"),
        ("200 mm", ""),
    ):
        with pytest.raises(InputError, match=f"from_: {said}"):
            back.unloading(from_=peak)
    short = replace(scene, unload_from=(), unloading=())
    with pytest.raises(InputError, match="the cycle has no unloading"):
        assemble(short, deterministic(short)).unloading()


def test_curves_of_a_cell(back, studies, scene):
    two, curves = studies["two_scale"], back.cell(2, 1)
    assert_array_equal(curves["cell_k1"], two.k1[:, 2, 1])
    assert_array_equal(curves["cell_mean_gap"], two.cells.mean_gap[:, 2, 1])
    assert curves["cell_k1"].dims == ("step",)
    assert list(curves["nominal_pressure"].values) == [s.pressure for s in scene.steps]
    drawn = assemble(scene, studies["stochastic"])
    assert_array_equal(drawn.cell(2, 1)["state_k1"], studies["stochastic"].cells.k1[:, 2, 1])
    for bad in ((3, 0), (0, 4), (-1, 0), (0.5, 0)):
        with pytest.raises(InputError, match="0 to 2 along x1 and 0 to 3 along x2"):
            back.cell(*bad)
    alone = assemble(scene, studies["deterministic"])
    with pytest.raises(InputError, match="no cells"):
        alone.cell(0, 0)


@pytest.mark.parametrize("source", ["results", "back"])
def test_fields_on_demand(source, studies, scene, request):
    r, two = request.getfixturevalue(source), studies["two_scale"]
    (d1, d2), first, last = scene.surface.spacing, 16, 32
    assert (r.two_scale is None) == (source == "back")
    assert r.stored_steps == list(range(6))
    for name, unit in (("gap", "m"), ("contact_pressure", "Pa"), ("fluid_pressure", "Pa")):
        values = getattr(r, name)(4)
        assert_allclose(values, getattr(two, name)[4], rtol=1e-6)
        assert values.attrs["units"] == unit
        assert r.steps[4].name in values.attrs["long_name"]
    part = r.gap(4, cell=(1, 2))
    assert_allclose(part, two.gap[4, first:last, 48:72], rtol=1e-6)
    assert_allclose(part["x1"], (np.arange(first, last) + 0.5) * d1)
    assert_allclose(part["x2"], (np.arange(48, 72) + 0.5) * d2)
    for bad in (6, -1, 0.5):
        with pytest.raises(InputError, match="expected 0 to 5"):
            r.gap(bad)


def test_gap_for_other_programs(back, studies, scene, tmp_path):
    """What is read back has the pixel, lies as the face and holds the gap of the step."""
    two = studies["two_scale"]
    (path,) = back.export(tmp_path / "gap.npz", step=4)
    face = read_topography(path, array="gap")
    assert_allclose(face.spacing, scene.surface.spacing)
    assert_allclose(face.heights, two.gap[4], rtol=1e-6)
    with np.load(path) as stored:
        assert str(stored["name"]) == back.steps[4].name
        assert_allclose(stored["nominal_pressure"], back.steps[4].pressure)
    (path,) = back.export(tmp_path / "fluid.npz", field="fluid_pressure", step=2)
    assert_allclose(np.load(path)["fluid_pressure"], two.fluid_pressure[2], rtol=1e-6)


def test_all_steps_and_cells_are_exported(back, studies, scene, tmp_path):
    paths = back.export(tmp_path / "p.npz", field="contact_pressure", cell=(1, 2))
    assert [path.name for path in paths] == [f"p_{s:04d}.npz" for s in range(6)]
    pressure, (d1, d2) = studies["two_scale"].contact_pressure[3], scene.surface.spacing
    with np.load(paths[3]) as stored:
        assert_allclose(stored["contact_pressure"], pressure[16:32, 48:72], rtol=1e-6)
        assert_allclose(stored["origin"], (16 * d1, 48 * d2), atol=1e-15)
        assert_allclose(stored["spacing"], (d1, d2))
    part = (4.9 * d1, 9.1 * d1, 2.9 * d2, 30.1 * d2)
    (path,) = back.export(tmp_path / "p.npz", field="contact_pressure", step=3, window=part)
    with np.load(path) as stored:
        assert_allclose(stored["contact_pressure"], pressure[5:9, 3:30], rtol=1e-6)
        assert_allclose(stored["origin"], (5 * d1, 3 * d2))


def test_a_face_is_exported_for_paraview(back, studies, scene, tmp_path):
    (path,) = back.export(tmp_path / "p.vti", field="contact_pressure", step=3)
    image = pyvista.read(path)
    shape = tuple(n - 1 for n in image.dimensions[:2])
    assert_allclose(np.subtract(image.bounds[1:4:2], image.bounds[:4:2]), scene.surface.size)
    found = image["contact_pressure_MPa"].reshape(shape, order="F")
    assert_allclose(found, 1e-6 * studies["two_scale"].contact_pressure[3], rtol=1e-5)


def test_export_on_the_command_line(folder, tmp_path, femseal):
    window = ("--window", "0 mm", ".06 mm", "0 mm", "50 um")
    for name, more in (("gap.npz", ()), ("gap.vti", window)):
        path = tmp_path / name
        code, output, _ = femseal("export", folder, "-o", path, "--step", "2", *more)
        assert (code, output.split()) == (0, [str(path)])
        assert path.stat().st_size > 1000


def test_what_cannot_be_exported(back, scene, studies, tmp_path):
    alone, drawn = (assemble(scene, studies[name]) for name in ("deterministic", "stochastic"))
    for run, name, given, message in (
        (back, "a.tif", {}, r"output: given 'a.tif', expected a file \.npz, "),
        (back, "a.npz", {"field": "heights"}, "field: given 'heights', expected one of gap, con"),
        (back, "a.npz", {"step": 9}, "step: given 9, expected 0 to 5"),
        (back, "a.npz", {"cell": (9, 9), "step": 0}, "cell: given"),
        (back, "a.npz", {"window": (0, 1e-3, 2e-3, 1e-3)}, r"window: given \(0, 0.001, 0.002, 0.0"),
        (back, "a.npz", {"window": (0, 6.1e-5, 0, 6e-5)}, r"window: given .* x1 from 0 to 6e-05 m"),
        (back, "a.npz", {"window": (0, 6e-5, -1e-6, 6e-5)}, "expected a part of the face"),
        (back, "a.npz", {"window": (0, 6e-5, 1.4e-6, 1.8e-6)}, "with the centre of a pixel of 1.2"),
        (back, "none/a.npz", {"step": 0}, "a file that can be written"),
        (alone, "a.npz", {"window": (0, 1, 0, 1)}, "expected a part of the face"),
        (
            drawn,
            "a.npz",
            {},
            r"results without the gap over all pixels, .* \"two-scale\" as method or in `compare`",
        ),
    ):
        with pytest.raises(InputError, match=message):
            run.export(tmp_path / name, **given)
    assert not list(tmp_path.iterdir())
    write_folder(drawn, tmp_path)
    assert open_results(tmp_path).stored_steps == open_results(tmp_path).left_out == []


CASE = STRIP | {
    "method": "two-scale",
    "face": STRIP["face"] | {"size": ["60 um", "120 um"], "rms_slope": 0.1},
    "load": {"loading": ["50 MPa", "300 MPa"]},
}


# --- a case -----------------------------------------------------------------------------------------------


def test_a_case_says_what_is_written_also_when_a_stopped_run_goes_on(
    tmp_path, monkeypatch, contacts
):
    def full(*args, **options):
        raise OSError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr("femseal.runs.job.write_folder", full)
        with pytest.raises(FemsealError, match="disk full"):
            fs.run(parse_case(CASE), tmp_path, workers=1)
    assert contacts
    contacts.clear()
    chosen = parse_case(CASE | {"output": {"paraview": "none", "fields_limit": "30 kB"}})
    r = fs.run(chosen, tmp_path, resume=True, workers=1)
    assert not contacts
    assert not (tmp_path / "vtk" / "cells.pvd").exists()
    # one step of three fields is 25 kB
    assert r.left_out == open_results(tmp_path).left_out != []
    assert open_results(tmp_path).stored_steps == [1]
    timings = json.loads(r.dataset.attrs["timings"])
    assert "two-scale: cells of the face" in timings
    assert timings["two-scale"] > timings["two-scale: contact of the whole face"] > 0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"paraview": "vtkhdf"}, "output.paraview: given 'vtkhdf', expected 'vtu' or 'none'"),
        ({"fields_limit": "-1 GB"}, "output.fields_limit: given '-1 GB', expected a size >= 0"),
        ({"fields_limit": "1 m"}, "output.fields_limit"),
        (
            {"films": True},
            "output.films: given an unknown key, expected pictures, picture_formats, report, ",
        ),
        ({"pictures": 2}, "output.pictures: given 2, expected "),
        ({"pictures": False, "report": True}, "output.report: given true with pictures = false"),
    ],
)
def test_faults_of_the_table_are_named(table, words):
    with pytest.raises(InputError, match=words):
        parse_case(CASE | {"output": table})


# --- views ------------------------------------------------------------------------------------------------

VIEW = """
import runpy, sys
import pyvista as pv
probe = pv.Plotter(off_screen=True)
probe.add_mesh(pv.Sphere())
probe.screenshot(sys.argv[3])
print("can draw", flush=True)
example = runpy.run_path(sys.argv[1])
step = example["tightest_leaking_step"](sys.argv[2])
assert step == int(sys.argv[4])
example["draw"](sys.argv[2], step).screenshot(sys.argv[3])
"""


def test_two_scale_view_is_drawn(folder, back, tmp_path):
    leaking = np.flatnonzero(back.dataset["leakage_two_scale"].values)
    step, picture = max(leaking, key=lambda s: back.steps[s].pressure), tmp_path / "view.png"
    command = [sys.executable, "-c", VIEW, EXAMPLES / "two_scale_view.py", folder, picture, step]
    off_screen = {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    surroundings = os.environ | ({} if os.environ.get("DISPLAY") else off_screen)
    run = subprocess.run(
        [*map(str, command)], env=surroundings, capture_output=True, text=True, timeout=600
    )
    if "can draw" not in run.stdout:
        pytest.skip("nothing can be drawn off screen here")
    assert run.returncode == 0, run.stderr
    # side by side: black where hardly anything of the pressure drops, and where there is no contact
    image = matplotlib.image.imread(picture)[..., :3].max(axis=-1)
    assert np.mean(image[:, :490] < 0.1) > 0.02
    assert np.mean(image[:, 510:] < 0.1) > 0.05


def test_the_macro_of_paraview_names_what_is_written(folder):
    text = (EXAMPLES / "paraview_two_scale.py").read_text(encoding="utf-8")
    compile(text, "macro", "exec")
    _, cells, points, fields, _ = next(in_time(folder / "vtk/cells.pvd"))
    _, pixels, *_ = next(in_time(folder / "fields.pvd"))
    for name in ("drop_fraction", "nominal_pressure_MPa", "contact_pressure_MPa"):
        assert name in text
        assert name in {*cells, *points, *fields, *pixels}


# --- full disks -------------------------------------------------------------------------------------------


def test_results_for_which_there_is_no_room_are_an_error_and_not_a_crash(folder):
    former, resource = (folder / "results.nc").read_bytes(), pytest.importorskip("resource")
    before, limits = list(folder.iterdir()), resource.getrlimit(resource.RLIMIT_FSIZE)
    results, handler = open_results(folder), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        with pytest.raises(OSError, match="too large"):
            save(results, folder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert (folder / "results.nc").read_bytes() == former
    assert list(folder.iterdir()) == before
