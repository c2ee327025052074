"""Results out and in again: dataset, tables, pictures, files for ParaView."""

import csv
import io
import json
import os
import re
import warnings
from dataclasses import dataclass, fields, replace
from math import nan
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import pyvista
import xarray
from matplotlib.patches import Rectangle
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import soft_cycle

from femseal.base import FemsealError, InputError
from femseal.base.fields import CELL, PIXEL, STEP, declared
from femseal.base.leak_units import leakage_unit
from femseal.budget import ErrorBudget, ErrorPart
from femseal.plots import cells_figure, leakage_figure, seal_figure
from femseal.report import write_folder
from femseal.results import RunFacts, assemble, open_results, save
from femseal.results.leakage_format import format_leakage
from femseal.results.tables import totals_table
from femseal.studies import FaceResult, Sampling, deterministic, stochastic, two_scale
from femseal.studies.cell_states import FaceCells

pytestmark = pytest.mark.usefixtures("drawn_pictures")

CASE = {"title": "trial", "seed": 7, "material": {"modulus": 115e9}, "cells": [4, 8]}
M1, M2 = 4, 8


@pytest.fixture(scope="module")
def scene():
    return soft_cycle((64, 128))


@pytest.fixture(scope="module")
def studies(scene):
    sampling = Sampling(240e-6, 20, seed=7)
    return {
        "deterministic": deterministic(scene),
        "two_scale": two_scale(scene, (M1, M2)),
        "stochastic": stochastic(scene, (M1, M2), sampling),
    }


@pytest.fixture(scope="module")
def results(scene, studies):
    report, timings = {"rms_height": 1e-6}, {"two-scale": 1.5}
    return assemble(
        scene, *studies.values(), facts=RunFacts(case=CASE, surface=report, timings=timings)
    )


@pytest.fixture(scope="module")
def folder(results, scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "deep" / "out"
    written = write_folder(results, path, scene.surface)
    assert sorted(written) == sorted(p for p in path.rglob("*") if p.is_file())
    return path


# --- dataset ----------------------------------------------------------------------------------------------


def pixels_of(path):
    """Fields of a file of VTK, by their names."""
    return pyvista.read(path).cell_data


def test_values_are_those_of_the_studies(results, studies, scene):
    data, two, drawn = results.dataset, studies["two_scale"], studies["stochastic"]
    for name, values in (
        ("leakage_two_scale", two.leakage),
        ("cell_k1", two.k1),
        ("cell_k2", two.k2),
        ("cell_pressure", two.cells.pressure),
        ("cell_mean_gap", two.cells.mean_gap),
        ("cell_contact_fraction", two.cells.contact_fraction),
        ("cell_drop_fraction", two.cells.drop_fraction),
        ("leakage_deterministic", studies["deterministic"].leakage),
        ("leakage", drawn.leakage),
        ("leakage_median", drawn.quantile(0.5)),
        ("leakage_lower", drawn.quantile(0.05)),
        ("leakage_upper", drawn.quantile(0.95)),
        ("state_k1", drawn.cells.k[0, 0]),
        ("state_factor", drawn.cells.factor),
        ("cell1", (np.arange(M1) + 0.5) * 15e-6),
        ("cell2", (np.arange(M2) + 0.5) * 15e-6),
    ):
        assert_allclose(data[name].values, values, rtol=1e-12, err_msg=name)
    assert results.steps == scene.steps
    assert data["leakage_upper"].attrs["quantile"] == 0.95
    assert (data["leakage_upper"] > data["leakage_lower"]).any()
    for name, variable in data.variables.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert data["cell_k1"].attrs["units"] == "m^3"


def test_contact_share_comes_from_the_best_study(scene, studies):
    for name, expected in (
        ("deterministic", studies["deterministic"].contact_fraction),
        ("two_scale", studies["deterministic"].contact_fraction),
        ("stochastic", studies["stochastic"].cells.contact_fraction.mean(axis=(1, 2))),
    ):
        assert_allclose(assemble(scene, studies[name]).dataset["contact_fraction"], expected)


def test_attributes_tell_the_origin(results, studies):
    attrs = results.dataset.attrs
    assert json.loads(attrs["case"]) == CASE == results.case
    assert attrs["seed"] == 7
    assert json.loads(attrs["surface"]) == {"rms_height": 1e-6}
    assert json.loads(attrs["timings"]) == {"two-scale": 1.5}
    for name, study in studies.items():
        solvers = json.loads(attrs["solvers"])[name]
        assert solvers["systems"] == dict(study.solve_counts.systems) != {}
        assert solvers["worst_imbalance"] == study.solve_counts.worst_imbalance < 1e-2
        flows = study.solve_counts.solved + study.solve_counts.closed
        assert solvers["solved"] + solvers["closed"] == flows
        assert (flows > 0) == (study.cells is not None)
    assert {"femseal", "python", "numpy", "scikit-fem"} <= set(json.loads(attrs["versions"]))
    assert json.loads(attrs["machine"])["cores"] == os.cpu_count()
    assert attrs["Conventions"].startswith("CF")


def test_best_leakage_at_hand(scene, studies):
    order = ("stochastic", "two_scale", "deterministic")
    methods = ("median", "two-scale", "deterministic")
    for n, method in enumerate(methods):
        r = assemble(scene, *(studies[name] for name in order[n:]))
        assert r.method == method
        assert r.leakage.name == f"leakage_{method.replace('-', '_')}"
        assert method in repr(r)
        volume_rate = r.dataset["leakage_total"]
        assert_allclose(r.leakage_in("kg/s") / volume_rate, scene.fluid.reference_density)
        assert_allclose(volume_rate / r.leakage, r.leak_basis.length)


def test_flow_towards_the_inlet_and_failed_steps_are_shown(scene, studies):
    dry = replace(scene, fluid_pressure="ignored")
    back = replace(dry, inlet_pressure=0.0, outlet_pressure=1e6)
    two, drawn = two_scale(back, (M1, M2)), studies["stochastic"]
    assert_allclose(two.leakage, -two_scale(dry, (M1, M2)).leakage, rtol=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        failed = replace(two, leakage=two.leakage * nan)
        r = assemble(back, failed, replace(drawn, leakage=-drawn.leakage))
        for figure in (leakage_figure(r), cells_figure(r), seal_figure(r, 0)):
            figure.savefig(io.BytesIO(), dpi=40)
    assert "at 700 MPa: failed" in repr(assemble(back, failed))


def test_failures_are_nan_not_sealed(scene, studies):
    leakage = studies["stochastic"].leakage.copy()
    leakage[:, 1] = nan
    broken = replace(studies["stochastic"], leakage=leakage, failures=("realisation 0: bad",))
    r = assemble(scene, broken)
    for end in ("leakage_median", "leakage_lower", "leakage_mean", "sealed_fraction"):
        assert_array_equal(np.isnan(r.dataset[end]), [False, True, False, False, False])
    assert r.failures == ["realisation 0: bad"]
    # too few realisations have no quantiles
    few = assemble(scene, replace(broken, leakage=leakage[:19])).dataset
    assert "leakage_median" in few
    assert "leakage_lower" not in few


def test_file_is_read_by_plain_xarray_and_comes_back(results, folder, scene):
    with xarray.open_dataset(folder / "results.nc") as data:
        assert set(data.variables) == set(results.dataset.variables)
        for name, variable in results.dataset.variables.items():
            assert_array_equal(data[name].values, variable.values, err_msg=name)
            assert data[name].attrs["units"] == variable.attrs["units"]
        assert_array_equal(data["branch"].values, ["loading"] * 3 + ["unloading"] * 2)
    back = open_results(folder)
    assert (back.steps, back.case, back.folder) == (scene.steps, CASE, folder)
    assert back.rows() == results.rows()
    assert back._repr_html_() == results._repr_html_()
    # everything but the large fields can be drawn and written again
    assert leakage_figure(back).axes
    assert cells_figure(back).axes
    assert seal_figure(back).axes


def foreign(path):
    path.mkdir()
    xarray.Dataset({"a": 1}).to_netcdf(path / "results.nc", engine="h5netcdf")


def nonsense(path):
    path.mkdir()
    (path / "results.nc").write_bytes(b"nonsense")


def test_many_failures_fit_into_the_file(scene, studies, tmp_path):
    many = replace(
        studies["two_scale"], failures=tuple(f"cell {n}: did not converge, é" for n in range(20000))
    )
    r = assemble(scene, many)
    save(r, tmp_path)
    assert open_results(tmp_path).failures == list(many.failures)


# --- file -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda path: None, "no such folder"),
        (Path.mkdir, r"no results.nc in it"),
        (nonsense, "a readable netCDF file"),
        (foreign, "another program"),
    ],
)
def test_a_missing_or_foreign_folder_is_an_error_in_one_line(tmp_path, make, text):
    make(tmp_path / "out")
    with pytest.raises(InputError, match=text) as caught:
        open_results(tmp_path / "out")
    assert "\n" not in str(caught.value)


def files(folder):
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def test_another_run_into_the_folder_leaves_nothing_of_the_former(
    results, scene, undrawn, tmp_path
):
    out = tmp_path / "out"
    write_folder(results, out, scene.surface)
    mine = {"notes.txt", "vtk/view.pvsm", "vtk/cells/step_9999.vtu", "vtk/own/a.vtu"}
    kept = [*(out / name for name in mine), tmp_path / "keep.txt", tmp_path / "out2/keep.txt"]
    for path in kept:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    (out / "files.txt").open("a").write(f"../{out.name}2/keep.txt\n{tmp_path}/keep.txt\n")
    # fewer steps, no cells
    short = replace(scene, loading=(50e6,), unload_from=(), unloading=())
    study = deterministic(short)
    for _ in range(2):
        written = write_folder(assemble(short, study), out)
        assert files(out) == {str(p.relative_to(out)) for p in written} | mine
        assert all(path.read_text() == "mine" for path in kept)
        write_folder(results, out, scene.surface)


def test_a_picture_that_fails_loses_neither_the_results_nor_the_former_run(
    results, scene, studies, undrawn, tmp_path, monkeypatch
):
    old = assemble(scene, studies["deterministic"])
    write_folder(old, tmp_path, scene.surface)
    before = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}

    def fail(*args):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("femseal.report.pictures.cells_figure", fail)
        with pytest.raises(FemsealError, match=r"(?=.*No space left)(?=.*/.unfinished/results.nc)"):
            write_folder(results, tmp_path, scene.surface)
    assert open_results(tmp_path / ".unfinished").rows() == results.rows()
    assert all((tmp_path / name).read_bytes() == content for name, content in before.items())
    written = write_folder(results, tmp_path, scene.surface)
    assert files(tmp_path) == {str(p.relative_to(tmp_path)) for p in written}
    assert open_results(tmp_path).rows() == results.rows()


def test_results_come_last(scene, studies, undrawn, tmp_path, monkeypatch):
    """Wherever the files cease to take their places, the folder either has all of them or no results."""
    r = assemble(scene, studies["deterministic"])
    everything = {str(p.relative_to(tmp_path)) for p in write_folder(r, tmp_path / "whole")}
    everything = {name.removeprefix("whole/") for name in everything}
    out = tmp_path / "out"
    save(r, out)
    move, left = os.replace, 0

    def stop_after_some(source, target):
        nonlocal left
        if ".unfinished" not in str(target):
            left -= 1
            if left < 0:
                raise OSError("stopped")
        move(source, target)

    monkeypatch.setattr(os, "replace", stop_after_some)
    for count in {*range(0, len(everything), 3), len(everything) - 1}:
        left = count
        with pytest.raises(FemsealError, match="stopped"):
            write_folder(r, out)
        assert not (out / "results.nc").exists()
        assert open_results(out / ".unfinished").rows() == r.rows()
    left = len(everything)
    write_folder(r, out)
    assert files(out) == everything


@dataclass(frozen=True, repr=False)
class More(FaceResult):
    wet: np.ndarray = declared("wet", "1", "fraction wetted", STEP, heading="wet [%]", default=None)
    heat: np.ndarray = declared("heat", "Pa", "stress of heat", PIXEL, default=None)


@dataclass(frozen=True, eq=False)
class Cells(FaceCells):
    depth: np.ndarray = declared("cell_depth", "m", "depth of cells", CELL, default=None)


def with_more(kind, known, **more):
    return kind(**{f.name: getattr(known, f.name) for f in fields(known)}, **more)


# --- tables -----------------------------------------------------------------------------------------------


def test_a_new_field_is_one_entry(scene, studies, undrawn, tmp_path):
    """A field that says what it is and where it lives comes out in every file and table that has such fields."""
    two = studies["two_scale"]
    deep = with_more(Cells, two.cells, depth=np.full((5, M1, M2), 2e-6))
    heat = np.full((5, 64, 128), 4e6, np.float32)
    more = with_more(More, replace(two, cells=deep), wet=np.linspace(0.1, 0.5, 5), heat=heat)
    r = assemble(scene, more)
    write_folder(r, tmp_path)
    back = open_results(tmp_path)
    for name, text in (("wet", "fraction wetted"), ("cell_depth", "depth of cells")):
        assert back.dataset[name].attrs["long_name"] == text
    assert r.rows()[4]["wet"] == 0.5
    assert ",wet," in (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines()[0] + ","
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for table in (r._repr_html_(), str(r.table()), page):
        assert "wet [%]" in " ".join(table.split())
    assert_allclose(pixels_of(tmp_path / "vtk/cells/step_0000.vtu")["depth_um"], 2.0)
    assert_allclose(pixels_of(tmp_path / "fields/step_0002.vti")["heat_MPa"], 4.0)
    for results in (r, back):
        found = results.pixels("heat", 2, (1, 3))
        assert (found.attrs["units"], found.shape) == ("Pa", (16, 16))
        assert_allclose(found, 4e6)
    assert_allclose(r.cell(1, 2)["cell_depth"], 2e-6)


def test_tables_say_what_happened(results, scene, folder):
    factor, unit = leakage_unit(results.leakage)
    table = results.table()
    assert f"in {unit}" in table.title
    column = table.heads.index("median")
    for line, q in zip(table.lines, results.leakage.values, strict=True):
        assert line[column] == ("sealed" if q == 0 else format_leakage(q, factor))
    rows = results.rows()
    assert [r["branch"] for r in rows] == ["loading"] * 3 + ["unloading from 700 MPa"] * 2
    assert [r["nominal_pressure_Pa"] for r in rows] == [s.pressure for s in scene.steps]
    with (folder / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(r["leakage_m2_per_s"]) for r in rows] == list(results.leakage.values)
    two = results.dataset["leakage_two_scale"].values
    assert [float(r["leakage_two_scale_m2_per_s"]) for r in rows] == list(two)


def test_what_results_have_nothing_for_is_refused(scene, studies, results, tmp_path):
    alone = assemble(scene, studies["deterministic"])
    undrawn = assemble(scene, replace(studies["stochastic"], median_seal=None))
    other = replace(scene, loading=(1e6,), unload_from=(), unloading=())
    two = studies["two_scale"]
    (tmp_path / "out").write_text("x")
    for call, message in (
        (lambda: cells_figure(alone), "cells figure"),
        (lambda: seal_figure(undrawn), "seal figure"),
        (lambda: seal_figure(results, 9), "step: given 9"),
        (lambda: assemble(scene), "no study"),
        (lambda: assemble(other, two), "a different load programme"),
        (lambda: assemble(scene, two, facts=RunFacts(quantiles=(0.9, 0.1))), "quantiles"),
        (lambda: save(results, tmp_path / "out"), "output folder"),
    ):
        with pytest.raises(InputError, match=message):
            call()


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([2e-3], "L/(m·s)"),
        ([0.0, 1e-6], "mL/(m·s)"),
        ([1e-30], "pL/(m·s)"),
        ([0.0, np.nan], "µL/(m·s)"),
    ],
)
def test_unit_follows_the_size(values, expected):
    assert leakage_unit(values)[1] == expected


def test_branches_of_tables_have_the_forces_of_the_case(results):
    load = {"loading": ["35000 N"], "unload_from": ["35000 N"]}
    data = results.dataset.assign_attrs(case=json.dumps({"load": load}))
    text = str(replace(results, dataset=data).table())
    assert re.search(r"unloading\s+from\s+35\s+kN", text)
    assert not re.search(r"from\s+700\s+MPa", text)


def test_leakages_that_are_all_unknown_have_tables_without_warnings(scene, studies):
    unknown = replace(studies["deterministic"], leakage=np.full(len(scene.steps), nan))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "failed" in str(totals_table(assemble(scene, unknown)))


# --- pictures ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["leakage", "cells", "seal", "surface"])
def test_pictures_show_something(folder, name):
    image = matplotlib.image.imread(folder / f"{name}.png")[..., :3]
    assert min(image.shape[:2]) > 400
    assert len(np.unique((image[::3, ::3] * 15).astype(int).reshape(-1, 3), axis=0)) > 15


def test_steps_without_leakage_stand_in_the_strip(scene, studies):
    sealed = replace(studies["two_scale"], leakage=np.array([1e-9, 1e-12, 0.0, 0.0, 1e-13]))
    axes = leakage_figure(assemble(scene, sealed)).axes[0]
    assert "sealed" in [t.get_text().strip() for t in axes.texts]
    points = np.concatenate([line.get_xydata() for line in axes.get_lines()])
    strip = points[points[:, 1] < 0.099]
    assert sorted(strip[:, 0]) == [300, 700, 700]
    # the grey ends below the least leakage, whatever the unit of the axis
    (grey,) = (patch for patch in axes.patches if isinstance(patch, Rectangle))
    top = axes.transData.inverted().transform(grey.get_window_extent())[1, 1]
    assert axes.get_ylim()[0] < top < min(y for y in points[:, 1] if y > 0.099)
    for never in (np.zeros(5), np.full(5, np.nan)):
        leakage_figure(assemble(scene, replace(sealed, leakage=never))).savefig(io.BytesIO())


# --- ParaView ---------------------------------------------------------------------------------------------


def test_a_band_that_says_nothing_has_no_number_and_a_warning_with_its_source(scene, studies):
    q, wide = studies["deterministic"].leakage, np.zeros(len(scene.steps))
    wide[0] = 90.0
    solver = ErrorPart.from_distances("solver", q, 0 * q + 0.1, 0 * q + 0.1, "")
    unknown = ErrorPart.from_distances("filter", q, wide, wide, "")

    def results(*parts):
        budgets = {"deterministic": ErrorBudget("deterministic", q, parts)}
        return assemble(scene, studies["deterministic"], facts=RunFacts(budgets=budgets))

    table = results(solver, unknown).table()
    column = table.heads.index("95 % interval")
    open_ends = [line[column].endswith(" to > 1000 times") for line in table.lines]
    assert open_ends == [True, *[False] * (q.size - 1)]
    (text,) = (text for text in results(solver, unknown).warnings if "factor of 1000" in text)
    assert text.startswith("the leakage at loading 50 MPa is not known")
    assert text.endswith(": filter")
    assert not any("factor of 1000" in text for text in results(solver).warnings)
