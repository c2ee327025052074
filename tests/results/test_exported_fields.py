"""Fields of a run as VTK's own readers and `open_results` give them back; results by branch, piece and step."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

from femseal.base.errors import FemsealError, InputError
from femseal.base.machine import machine, peak_memory
from femseal.case.case import parse_case
from femseal.fluids import Liquid
from femseal.plots import seal_figure
from femseal.report import write_folder
from femseal.results import RunFacts, assemble, export, open_results
from femseal.results.paraview import plan_fields
from femseal.runs import job
from femseal.studies import Sampling, Scene
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.studies.piece_study import two_scale
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
    import pyvista

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
    read = list(in_time(folder / "vtk/pieces.pvd"))
    # time is the step: loads come back on unloading
    assert [time for time, *_ in read] == list(range(6))
    same_steps(results.steps, [fields for *_, fields, _ in read])
    for s, (_, cells, points, _, grid) in enumerate(read):
        assert grid.IsA("vtkUnstructuredGrid")
        assert (grid.GetNumberOfCells(), grid.GetNumberOfPoints()) == (M1 * M2, (M1 + 1) * (M2 + 1))
        for name, variable, factor in (
            ("k1_m3", "piece_k1", 1),
            ("pressure_MPa", "piece_pressure", 1e-6),
            ("mean_gap_um", "piece_mean_gap", 1e6),
            ("contact_fraction", "piece_contact_fraction", 1),
        ):
            assert_allclose(cells[name].reshape(M1, M2), data[variable][s] * factor, rtol=1e-12)
        assert not points


def test_pieces_of_the_seal_lie_where_they_should(results, folder):
    import pyvista

    *_, (_, cells, _, _, grid) = in_time(folder / "vtk/pieces.pvd")
    x1, x2 = (results.dataset[name].values for name in ("piece1", "piece2"))
    number = pyvista.wrap(grid).find_containing_cell((x1[1] * 1.02, x2[2] * 1.02, 0.0))
    assert cells["k1_m3"][number] == results.dataset["piece_k1"][-1, 1, 2]


def test_fields_over_all_pixels(results, studies, scene, folder):
    import pyvista

    two, (d1, d2) = studies["two_scale"], scene.surface.spacing
    read = list(in_time(folder / "fields.pvd"))
    assert [time for time, *_ in read] == list(range(6))
    same_steps(results.steps, [fields for *_, fields, _ in read])
    for s, (_, cells, _, _, image) in enumerate(read):
        assert image.GetDimensions() == (49, 97, 1)
        assert_allclose(image.GetBounds()[:4], (0, 60e-6, 0, 120e-6))
        pixel = pyvista.wrap(image).find_containing_cell((7.5 * d1, 77.5 * d2, 0.0))
        for name, values in (
            ("gap_um", two.gap[s] * 1e6),
            ("contact_pressure_MPa", two.contact_pressure[s] / 1e6),
            ("fluid_pressure_MPa", two.fluid_pressure[s] / 1e6),
        ):
            assert_allclose(cells[name].reshape(48, 96, order="F"), values, rtol=1e-6)
            assert_allclose(cells[name][pixel], values[7, 77], rtol=1e-6)


def test_heights_are_points(scene, folder):
    import pyvista

    image = pyvista.read(folder / "vtk/surface.vti")
    points = image.point_data
    assert_allclose(
        points["height_um"].reshape(48, 96, order="F"), scene.surface.heights * 1e6, rtol=1e-6
    )
    d1, d2 = scene.surface.spacing
    place = image.FindPoint(5.5 * d1, 77.5 * d2, 0.0)
    assert_allclose(points["height_um"][place], scene.surface.heights[5, 77] * 1e6, rtol=1e-6)


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
        plan = plan_fields(results, limit)
        assert list(plan.steps) == list(kept)
        assert bool(plan.left_out) == (len(kept) < 6)
    write_folder(results, tmp_path, scene.surface, fields_limit=3.5 * each)
    back = open_results(tmp_path)
    (text,) = back.left_out
    assert (
        text
        == "fields over all pixels at steps 0, 1, 4: 332 kB of all steps are above the limit of 194 kB (fields_limit)"
    )
    assert text in repr(back)
    assert text in back._repr_html_()
    assert back.stored_steps == [2, 3, 5]
    assert [time for time, *_ in in_time(tmp_path / "fields.pvd")] == [2, 3, 5]
    assert_allclose(back.gap(5), studies["two_scale"].gap[5], rtol=1e-6)
    with pytest.raises(
        InputError, match="step: given 1, which has no gap, expected one of 2, 3, 5"
    ):
        back.gap(1)
    seal_figure(back, 1)
    for path in (tmp_path / "fields").iterdir():
        path.unlink()
    with pytest.raises(InputError, match=r"step: given 5, .* or in `compare`, with fields = true"):
        open_results(tmp_path).gap(5)


# --- results ----------------------------------------------------------------------------------------------


def test_branches_are_labelled(back, studies):
    up, down = back.loading(), back.unloading()
    median = studies["stochastic"].quantile(0.5)
    assert list(up["nominal_pressure"]) == [50e6, 200e6, 700e6]
    assert_array_equal(up["leakage_median"].sel(nominal_pressure=[50e6, 700e6]), median[[0, 2]])
    assert list(down["nominal_pressure"]) == [700e6, 300e6, 50e6]
    assert_array_equal(down["leakage_median"], median[[2, 4, 5]])
    assert down["piece_k1"].dims == ("nominal_pressure", "piece1", "piece2")
    assert "state_k1" not in up
    for peak in (200e6, "200 MPa", "0.2 GPa"):
        assert_array_equal(
            back.unloading(from_=peak)["leakage_two_scale"], studies["two_scale"].leakage[[1, 3]]
        )
    with pytest.raises(InputError, match="from_: given 300 MPa, expected one of 200 MPa, 700 MPa"):
        back.unloading(from_="300 MPa")
    with pytest.raises(InputError, match="from_"):
        back.unloading(from_="200 mm")


def test_a_cycle_without_unloading(scene, studies):
    short = replace(scene, unload_from=(), unloading=())
    r = assemble(short, deterministic(short))
    assert r.loading().sizes["nominal_pressure"] == 3
    with pytest.raises(InputError, match="the cycle has no unloading"):
        r.unloading()


def test_curves_of_a_piece(back, studies, scene):
    two, curves = studies["two_scale"], back.piece(2, 1)
    assert_array_equal(curves["piece_k1"], two.k1[:, 2, 1])
    assert_array_equal(curves["piece_mean_gap"], two.pieces.mean_gap[:, 2, 1])
    assert curves["piece_k1"].dims == ("step",)
    assert list(curves["nominal_pressure"].values) == [s.pressure for s in scene.steps]
    drawn = assemble(scene, studies["stochastic"])
    assert_array_equal(drawn.piece(2, 1)["state_k1"], studies["stochastic"].pieces.k1[:, 2, 1])
    for bad in ((3, 0), (0, 4), (-1, 0), (0.5, 0)):
        with pytest.raises(InputError, match="0 to 2 along x1 and 0 to 3 along x2"):
            back.piece(*bad)
    alone = assemble(scene, studies["deterministic"])
    with pytest.raises(InputError, match="no pieces"):
        alone.piece(0, 0)


@pytest.mark.parametrize("source", ["results", "back"])
def test_fields_on_demand(source, studies, scene, request):
    r, two = request.getfixturevalue(source), studies["two_scale"]
    (d1, d2), first, last = scene.surface.spacing, 16, 32
    assert (r.two_scale is None) == (source == "back")
    assert r.stored_steps == list(range(6))
    for s in (0, 4):
        for values, expected, unit in (
            (r.gap(s), two.gap[s], "m"),
            (r.contact_pressure(s), two.contact_pressure[s], "Pa"),
        ):
            assert_allclose(values, expected, rtol=1e-6)
            assert values.attrs["units"] == unit
            assert r.steps[s].name in values.attrs["long_name"]
        part = r.gap(s, piece=(1, 2))
        assert_allclose(part, two.gap[s, first:last, 48:72], rtol=1e-6)
        assert_allclose(part["x1"], (np.arange(first, last) + 0.5) * d1)
        assert_allclose(part["x2"], (np.arange(48, 72) + 0.5) * d2)
    pixel = r.gap(4).sel(x1=7.4 * d1, x2=77.6 * d2, method="nearest")
    assert_allclose(pixel, two.gap[4, 7, 77], rtol=1e-6)
    for bad in (6, -1, 0.5):
        with pytest.raises(InputError, match="expected 0 to 5"):
            r.gap(bad)


def test_fields_of_a_deterministic_study(scene, studies, tmp_path):
    r = assemble(scene, studies["deterministic"])
    write_folder(r, tmp_path, scene.surface, paraview="none")
    assert not (tmp_path / "vtk").exists()
    for at_hand in (r, open_results(tmp_path)):
        for name in ("gap", "contact_pressure", "fluid_pressure"):
            assert_allclose(
                getattr(at_hand, name)(3), getattr(studies["deterministic"], name)[3], rtol=1e-6
            )


def test_gap_for_other_programs(back, studies, scene, tmp_path):
    """What is read back has the pixel, lies as the face and holds the gap of the step."""
    two, (d1, d2) = studies["two_scale"], scene.surface.spacing
    (path,) = back.export(tmp_path / "gap.npz", step=4)
    face = read_topography(path, array="gap")
    assert_allclose(face.spacing, (d1, d2))
    assert_allclose(face.heights, two.gap[4], rtol=1e-6)
    with np.load(path) as stored:
        assert str(stored["name"]) == back.steps[4].name
        assert_allclose(stored["nominal_pressure"], back.steps[4].pressure)


def test_all_fields_of_a_deterministic_study_are_exported(scene, studies, tmp_path):
    study = studies["deterministic"]
    r = assemble(scene, study)
    for name in ("gap", "contact_pressure", "fluid_pressure"):
        (path,) = r.export(tmp_path / f"{name}.npz", field=name, step=2)
        values = np.load(path)[name]
        assert_allclose(values, getattr(study, name)[2], rtol=1e-6)
    assert np.isnan(values[study.gap[2] == 0]).all()


def test_all_steps_and_pieces_are_exported(back, studies, scene, tmp_path):
    paths = back.export(tmp_path / "p.npz", field="contact_pressure", piece=(1, 2))
    assert [path.name for path in paths] == [f"p_{s:04d}.npz" for s in range(6)]
    two = studies["two_scale"]
    first, last = 16, 32
    with np.load(paths[3]) as stored:
        assert_allclose(
            stored["contact_pressure"], two.contact_pressure[3, first:last, 48:72], rtol=1e-6
        )
        assert_allclose(
            stored["origin"],
            (first * scene.surface.spacing[0], 48 * scene.surface.spacing[1]),
            atol=1e-15,
        )
        assert_allclose(stored["spacing"], scene.surface.spacing)


def test_a_part_of_the_face_is_exported_with_all_its_pixels_and_the_face_in_blocks(
    back, studies, scene, tmp_path, monkeypatch
):
    import pyvista

    monkeypatch.setattr(export, "MOST_PIXELS", 12)
    d1, d2 = scene.surface.spacing
    pressure = studies["two_scale"].contact_pressure[3]
    part = (4.9 * d1, 9.1 * d1, 2.9 * d2, 30.1 * d2)
    (path,) = back.export(tmp_path / "p.npz", field="contact_pressure", step=3, window=part)
    with np.load(path) as stored:
        assert_allclose(stored["contact_pressure"], pressure[5:9, 3:30], rtol=1e-6)
        assert_allclose(stored["origin"], (5 * d1, 3 * d2))
    (path,) = back.export(tmp_path / "p.vti", field="contact_pressure", step=3)
    image = pyvista.read(path)
    blocks = image["contact_pressure_MPa"].reshape(
        tuple(n - 1 for n in image.dimensions[:2]), order="F"
    )
    assert blocks.shape == (12, 12)
    assert_allclose(np.subtract(image.bounds[1:4:2], image.bounds[:4:2]), scene.surface.size)
    assert_allclose(
        blocks[0, 0],
        1e-6 * pressure[: len(pressure) // 12, : pressure.shape[1] // 12].mean(),
        rtol=1e-5,
    )


def test_export_on_the_command_line(folder, tmp_path):
    from typer.testing import CliRunner

    from femseal.cli import app

    done = CliRunner().invoke(
        app, ["export", str(folder), "-o", str(tmp_path / "gap.npz"), "--step", "2"]
    )
    assert (done.exit_code, done.output.split()) == (0, [str(tmp_path / "gap.npz")])
    assert (tmp_path / "gap.npz").stat().st_size > 1000
    window = ("--window", "0 mm", ".06 mm", "0 mm", "50 um")
    done = CliRunner().invoke(
        app, ["export", str(folder), "-o", str(tmp_path / "gap.vti"), "--step", "2", *window]
    )
    assert (done.exit_code, done.output.split()) == (0, [str(tmp_path / "gap.vti")])


def test_what_cannot_be_exported(back, scene, studies, tmp_path):
    for name, given, message in (
        (
            "a.tif",
            {},
            r"output: given 'a.tif', expected a file \.npz, from which NumPy and other programs make \.tif",
        ),
        (
            "a.npz",
            {"field": "heights"},
            "field: given 'heights', expected one of gap, contact_pressure, fluid_pressure",
        ),
        ("a.npz", {"step": 9}, "step: given 9, expected 0 to 5"),
        ("a.npz", {"piece": (9, 9), "step": 0}, "piece: given"),
        ("a.npz", {"window": (0, 1e-3, 2e-3, 1e-3)}, r"window: given \(0, 0.001, 0.002, 0.001\)"),
        (
            "a.npz",
            {"window": (0, 6.1e-5, 0, 6e-5)},
            r"window: given \(0, 6.1e-05, .* x1 from 0 to 6e-05 m, x2 from 0 to",
        ),
        ("a.npz", {"window": (0, 6e-5, -1e-6, 6e-5)}, "expected a part of the face"),
        (
            "a.npz",
            {"window": (0, 6e-5, 1.4e-6, 1.8e-6)},
            "with the centre of a pixel of 1.25e-06 m",
        ),
        ("none/a.npz", {"step": 0}, "a file that can be written"),
    ):
        with pytest.raises(InputError, match=message):
            back.export(tmp_path / name, **given)
    with pytest.raises(InputError, match="expected a part of the face"):
        assemble(scene, studies["deterministic"]).export(tmp_path / "a.npz", window=(0, 1, 0, 1))
    with pytest.raises(
        InputError, match=r"no gap over all pixels, .* \"two-scale\" as method or in `compare`"
    ):
        assemble(scene, studies["stochastic"]).export(tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_results_without_a_face(scene, studies, tmp_path):
    r = assemble(scene, studies["stochastic"])
    write_folder(r, tmp_path)
    assert not (tmp_path / "fields").exists()
    assert open_results(tmp_path).stored_steps == []
    assert open_results(tmp_path).left_out == []


def test_pictures_of_results_read_back(back, results):
    for r in (back, results):
        assert r.plot().axes
        assert r.plot_pieces().axes
    shown, expected = (r.plot_seal(1).axes for r in (back, results))
    assert len(shown) == len(expected) > 3
    for a, b in zip(shown, expected, strict=True):
        assert a.get_title() == b.get_title()
        for image, other in zip(a.get_images(), b.get_images(), strict=True):
            assert_allclose(image.get_array(), other.get_array(), rtol=1e-6)


def test_text_and_html_say_what_there_is(back, results, folder):
    text = repr(back)
    assert text.startswith("<femseal.Results 'trial'>\n")
    assert "6 steps: 3 loading, 3 unloading from 200 MPa, 700 MPa" in text
    assert "over all pixels at 6 of 6 steps" in text
    assert str(folder) in text
    page = back._repr_html_()
    assert page.count("<table>") == page.count("</table>") == 2
    assert "trial" in page
    risky = assemble(results.scene, results.two_scale, facts=RunFacts(case={"title": "<b>&"}))
    assert "&lt;b&gt;&amp;" in risky._repr_html_()


def test_provenance_is_in_the_file(folder):
    with xarray.open_dataset(folder / "results.nc") as data:
        attrs = data.attrs
        for name, variable in data.variables.items():
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
    found = json.loads(attrs["machine"])
    assert found["processor"]
    assert found["cores"] == os.cpu_count()
    assert attrs["date_created"].endswith("+00:00")
    assert attrs["Conventions"].startswith("CF")
    assert json.loads(attrs["left_out"]) == []
    assert json.loads(attrs["counts"])["two_scale"]["solved"] > 0


def test_memory_is_told_in_bytes():
    resource = pytest.importorskip("resource")
    block = np.ones(2**24)
    assert block.nbytes < peak_memory() < machine()["memory_bytes"]
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 0


# --- a case -----------------------------------------------------------------------------------------------


@pytest.fixture
def case():
    return {
        "method": "two-scale",
        "face": {
            "kind": "self-affine",
            "points": [32, 64],
            "size": ["60 um", "120 um"],
            "rms_slope": 0.1,
        },
        "material": {"young": "210 GPa", "hardness": "3 GPa"},
        "load": {"loading": ["50 MPa", "300 MPa"]},
        "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
        "cells": {"count": [2, 4]},
    }


def test_a_case_says_what_is_written_also_when_a_stopped_run_goes_on(case, tmp_path, monkeypatch):
    def full(*args, **options):
        raise OSError("disk full")

    assert parse_case(case).output.paraview == "vtu"
    with monkeypatch.context() as patch:
        patch.setattr("femseal.runs.job.write_folder", full)
        with pytest.raises(FemsealError, match="disk full"):
            job.run(parse_case(case), tmp_path, workers=1)
    solved = []

    def respond(*args, **options):
        solved.append(args)

    monkeypatch.setattr("femseal.contact.cycle.solve_contact", respond)
    chosen = parse_case({**case, "output": {"paraview": "none", "fields_limit": "30 kB"}})
    r = job.run(chosen, tmp_path, resume=True, workers=1)
    assert not solved
    names = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.*")}
    assert "vtk/pieces.pvd" not in names
    # one step of three fields is 25 kB
    assert r.left_out == open_results(tmp_path).left_out
    assert open_results(tmp_path).stored_steps == [1]
    assert r.left_out[0] in (tmp_path / "run.log").read_text(encoding="utf-8")
    timings = json.loads(r.dataset.attrs["timings"])
    assert {
        "two-scale",
        "two-scale: contact of the whole face",
        "two-scale: pieces of the face",
    } <= set(timings)
    assert timings["two-scale"] > timings["two-scale: contact of the whole face"] > 0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            {"paraview": "vtkhdf"},
            "output.paraview: given 'vtkhdf', expected 'vtu' or 'none'",
        ),
        ({"fields_limit": "-1 GB"}, "output.fields_limit: given '-1 GB', expected a size >= 0"),
        ({"fields_limit": "1 m"}, "output.fields_limit"),
        (
            {"films": True},
            "output.films: given an unknown key, expected pictures, report, fields, paraview, fields_limit",
        ),
        ({"pictures": 2}, "output.pictures: given 2, expected "),
        (
            {"pictures": False, "report": True},
            "output.report: given true with pictures = false, expected false",
        ),
    ],
)
def test_faults_of_the_table_are_named(case, table, words):
    with pytest.raises(InputError) as caught:
        parse_case({**case, "output": table})
    assert words in str(caught.value)


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
    step = max(leaking, key=lambda s: back.steps[s].pressure)
    arguments = [
        str(a) for a in (EXAMPLES / "two_scale_view.py", folder, tmp_path / "view.png", step)
    ]
    setting = (
        {} if os.environ.get("DISPLAY") else {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}
    )
    command = [sys.executable, "-c", VIEW, *arguments]
    run = subprocess.run(
        command, env=os.environ | setting, capture_output=True, text=True, timeout=600
    )
    if "can draw" not in run.stdout:
        pytest.skip("nothing can be drawn off screen here")
    assert run.returncode == 0, run.stderr
    import matplotlib.image

    picture = matplotlib.image.imread(tmp_path / "view.png")[..., :3]
    # side by side, with a line between them
    upper, lower = picture[:, :490], picture[:, 510:]
    # black where hardly anything of the pressure drops, and where there is no contact
    assert np.mean(upper.max(axis=-1) < 0.1) > 0.02
    assert np.mean(lower.max(axis=-1) < 0.1) > 0.05
    # the share of contact as in the results
    x, y = (np.flatnonzero((lower[40:-160] < 0.99).any(axis=-1).any(axis=n)) for n in (0, 1))
    face = lower[40:-160][y[0] : y[-1] + 1, x[0] : x[-1] + 1]
    share = float(np.mean(back.contact_pressure(step) > 0))
    assert_allclose(np.mean(face.max(axis=-1) > 0.02), share, atol=0.03)


def test_the_macro_of_paraview_names_what_is_written(folder):
    text = (EXAMPLES / "paraview_two_scale.py").read_text(encoding="utf-8")
    compile(text, "macro", "exec")
    _, cells, points, fields, _ = next(in_time(folder / "vtk/pieces.pvd"))
    _, pixels, *_ = next(in_time(folder / "fields.pvd"))
    for name in ("drop_fraction", "nominal_pressure_MPa", "contact_pressure_MPa"):
        assert name in text
        assert name in {*cells, *points, *fields, *pixels}


# --- full disks -------------------------------------------------------------------------------------------

FULL = """
import resource, signal, sys
from pathlib import Path
from femseal.results.vtk_files import write_series as write
from femseal.results.vtk_files import Heights
from femseal.topography import self_affine
view = Heights(self_affine((64, 64), (1e-4, 1e-4), hurst=0.8, rms_slope=0.1, rng=1))
view.at(0)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
try:
    write(view, Path(sys.argv[1]))
except OSError as error:
    print(type(error).__name__, error.errno)
"""


def test_a_full_disk_is_an_error(tmp_path):
    pytest.importorskip("resource")
    run = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, timeout=120
    )
    assert run.stdout.startswith("OSError"), run.stderr
    assert not list(tmp_path.iterdir())


def test_resolved_flow_of_two_scales_has_its_pressure_at_every_pixel(scene, tmp_path):
    two = two_scale(scene, (M1, M2))
    results = assemble(scene, two)
    write_folder(results, tmp_path, scene.surface)
    for s, (_, cells, *_) in enumerate(in_time(tmp_path / "fields.pvd")):
        shown = cells["fluid_pressure_MPa"].reshape(two.gap.shape[1:], order="F") * 1e6
        assert_allclose(shown, two.fluid_pressure[s], rtol=1e-6)
        assert_allclose(results.fluid_pressure(s), two.fluid_pressure[s], rtol=1e-6)
        assert np.isnan(shown[two.gap[s] <= 0]).all()
        if two.leakage[s] > 0:
            assert np.nanmax(shown) <= scene.inlet_pressure * (1 + 1e-6)
            assert np.nanmin(shown) >= scene.outlet_pressure * (1 - 1e-6)
