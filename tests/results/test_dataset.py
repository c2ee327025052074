"""Results out and in again: dataset, tables, pictures, files for ParaView."""

import csv
import io
import json
import os
import re
import tracemalloc
import warnings
from dataclasses import dataclass, fields, replace

import matplotlib.image
import numpy as np
import pytest
import xarray
from matplotlib.patches import Rectangle
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import soft_cycle

from femseal.base import shared_array
from femseal.base.errors import FemsealError, InputError
from femseal.base.fields import PART, PIECE, PIXEL, REALISATION, STEP, declared
from femseal.base.leak_rates import leakage_unit
from femseal.budget import ErrorBudget, ErrorPart
from femseal.fluids import Liquid
from femseal.plots import leakage_figure, pieces_figure, seal_figure
from femseal.report import write_folder
from femseal.results import RunFacts, assemble, open_results, save, write_vtk
from femseal.results.selections import branch_text
from femseal.results.tables import format_leakage
from femseal.studies import FaceResult, Sampling, Scene, StochasticResult
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.studies.piece_states import FacePieces
from femseal.studies.piece_study import two_scale
from femseal.studies.stochastic_result import MedianSeal
from femseal.topography import Topography, self_affine

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


def test_values_are_those_of_the_studies(results, studies, scene):
    data, two = results.dataset, studies["two_scale"]
    for name, values in (
        ("leakage_two_scale", two.leakage),
        ("piece_k1", two.k1),
        ("piece_k2", two.k2),
        ("piece_pressure", two.pieces.pressure),
        ("piece_mean_gap", two.pieces.mean_gap),
        ("piece_contact_fraction", two.pieces.contact_fraction),
        ("piece_drop_fraction", two.pieces.drop_fraction),
        ("leakage_deterministic", studies["deterministic"].leakage),
        ("leakage", studies["stochastic"].leakage),
        ("leakage_median", studies["stochastic"].quantile(0.5)),
        ("leakage_lower", studies["stochastic"].quantile(0.05)),
        ("state_k1", studies["stochastic"].pieces.k[0, 0]),
        ("state_factor", studies["stochastic"].pieces.factor),
    ):
        assert_array_equal(data[name].values, values, err_msg=name)
    assert not [n for n, v in data.variables.items() if {"x1", "x2"} & set(v.dims)]
    assert results.steps == scene.steps
    assert_allclose(data["piece2"], (np.arange(M2) + 0.5) * 15e-6)
    assert_allclose(data["piece1"], (np.arange(M1) + 0.5) * 15e-6)


def test_every_variable_says_what_it_is(results):
    for name, variable in results.dataset.variables.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert results.dataset["piece_k1"].attrs["units"] == "m^3"
    assert results.dataset["nominal_pressure"].attrs["units"] == "Pa"


def test_quantiles_are_ordered(results):
    data = results.dataset
    assert (data["leakage_lower"] <= data["leakage_median"]).all()
    assert (data["leakage_median"] <= data["leakage_upper"]).all()
    assert (data["leakage_upper"] > data["leakage_lower"]).any()
    assert data["leakage_upper"].attrs["quantile"] == 0.95


def test_contact_share_comes_from_the_best_study(scene, studies):
    two, det, lib = (
        assemble(scene, studies[name]).dataset["contact_fraction"].values
        for name in ("two_scale", "deterministic", "stochastic")
    )
    assert_array_equal(two, det)
    assert_allclose(det, studies["deterministic"].contact_fraction)
    assert_allclose(lib, studies["stochastic"].pieces.contact_fraction.mean(axis=(1, 2)))


def test_attributes_tell_the_origin(results, studies):
    attrs = results.dataset.attrs
    assert json.loads(attrs["case"]) == CASE == results.case
    assert attrs["seed"] == 7
    assert json.loads(attrs["surface"]) == {"rms_height": 1e-6}
    assert json.loads(attrs["timings"]) == {"two-scale": 1.5}
    assert json.loads(attrs["counts"])["two_scale"] == studies["two_scale"].pieces.counts.by_kind()
    for name, study in studies.items():
        solvers = json.loads(attrs["solvers"])[name]
        assert solvers["systems"] == study.solvers.by_solver() != {}
        assert solvers["worst_imbalance"] == study.solvers.worst_imbalance < 1e-2
    assert {"femseal", "python", "numpy", "scikit-fem"} <= set(json.loads(attrs["versions"]))
    assert attrs["inlet_pressure_Pa"] == 1e6
    assert "Liquid" in attrs["fluid"]
    assert results.warnings == []
    assert attrs["tiles"] == "4 × 16 tiles"


def test_best_leakage_at_hand(scene, studies):
    order = ("stochastic", "two_scale", "deterministic")
    methods = ("median", "two-scale", "deterministic")
    for n, method in enumerate(methods):
        r = assemble(scene, *(studies[name] for name in order[n:]))
        assert r.method == method
        assert r.leakage.name == f"leakage_{method.replace('-', '_')}"
        assert method in repr(r)
        assert (r.per_length == r.leakage).all()
        assert_allclose(r.mass_rate / r.volume_rate, scene.fluid.reference_density)
        assert_allclose(r.volume_rate / r.per_length, r.leak_basis.length)


def test_statistics_are_those_of_the_realisations_that_did_not_fail(studies):
    columns = {
        "powers": [1e-3, 1e-9, 1e-6, np.nan],
        "reversed": [-1e-3, -1e-9, np.nan, -1e-6],
        "half sealed": [0.0, np.nan, 1e-6, np.nan],
        "two": [np.nan, 1e-4, 1e-8, np.nan],
        "two reversed": [np.nan, -1e-4, -1e-8, np.nan],
        "both signs": [1.0, -3.0, np.nan, np.nan],
        "one zero": [0.0, -1e-6, np.nan, np.nan],
        "failed": [np.nan] * 4,
    }
    s = replace(studies["stochastic"], leakage=np.array(list(columns.values())).T)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_allclose(s.quantile(0.5), [1e-6, -1e-6, 0, 1e-6, -1e-6, -1, 0, np.nan], rtol=1e-12)
        assert_allclose(
            s.quantile(0.0), [1e-9, -1e-3, 0, 1e-8, -1e-4, -3, -1e-6, np.nan], rtol=1e-12
        )
        assert_allclose(s.quantile(0.75)[:2], [10**-4.5, -(10**-7.5)], rtol=1e-12)
        means = (1e-3 + 1e-6 + 1e-9) / 3, 1e-6 / 2, (1e-4 + 1e-8) / 2
        mean = [means[0], -means[0], means[1], means[2], -means[2], -1, -5e-7, np.nan]
        assert_allclose(s.mean, mean, rtol=1e-12)
        assert_allclose(s.sealed_fraction, [0, 0, 1 / 2, 0, 0, 0, 1 / 2, np.nan], rtol=1e-12)


def test_flow_towards_the_inlet_and_failed_steps_are_shown(scene, studies):
    dry = replace(scene, fluid_pressure="ignored")
    back = replace(dry, inlet_pressure=0.0, outlet_pressure=1e6)
    two, drawn = two_scale(back, (M1, M2)), studies["stochastic"]
    assert_allclose(two.leakage, -two_scale(dry, (M1, M2)).leakage, rtol=1e-9)
    leakage = -drawn.leakage
    leakage[:, 1] = np.nan
    failed, lost = (
        two.leakage.copy(),
        {name: getattr(two.pieces, name).copy() for name in ("k", "drop_fraction")},
    )
    failed[1] = lost["k"][:, :, 1] = lost["drop_fraction"][1] = np.nan
    two = replace(two, leakage=failed, pieces=replace(two.pieces, **lost))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        r = assemble(back, two, replace(drawn, leakage=leakage))
        axes = leakage_figure(r).axes[0]
        for figure in (leakage_figure(r), pieces_figure(r), seal_figure(r, 0), seal_figure(r, 1)):
            figure.savefig(io.BytesIO(), dpi=40)
    assert "from outlet to inlet" in axes.get_ylabel()
    shown = {line.get_label(): line.get_ydata() for line in axes.get_lines()}["loading"]
    factor, _ = leakage_unit(r.leakage)
    assert_allclose(shown, -r.leakage.values[:3] / factor)
    assert np.isnan(shown[1])
    low, high = (
        format_leakage(r.dataset[n].values[0], factor) for n in ("leakage_lower", "leakage_upper")
    )
    assert f"<td>{low} to {high}</td>" in r._repr_html_()
    assert "at 700 MPa: failed" in repr(assemble(back, replace(two, leakage=two.leakage * np.nan)))


def test_failures_are_nan_not_sealed(scene, studies):
    leakage = studies["stochastic"].leakage.copy()
    leakage[:, 1] = np.nan
    broken = replace(studies["stochastic"], leakage=leakage, failures=("realisation 0: bad",))
    r = assemble(scene, broken)
    for name in (
        "leakage_median",
        "leakage_lower",
        "leakage_upper",
        "leakage_mean",
        "sealed_fraction",
    ):
        assert_array_equal(np.isnan(r.dataset[name]), [False, True, False, False, False])
    assert r.failures == ["realisation 0: bad"]
    assert "failures   1, the first: realisation 0: bad" in repr(r)
    # too few realisations have no quantiles
    few = assemble(scene, replace(broken, leakage=leakage[:19])).dataset
    assert "leakage_median" in few
    assert "leakage_lower" not in few
    assert "failed" in r._repr_html_()


def test_many_failures_fit_into_the_file(scene, studies, tmp_path):
    many = replace(
        studies["two_scale"], failures=tuple(f"cell {n}: did not converge, é" for n in range(20000))
    )
    r = assemble(scene, many)
    save(r, tmp_path)
    kept = open_results(tmp_path).failures
    assert kept[0] == "cell 0: did not converge, é"
    assert kept[-1] == f"… and {20000 - len(kept) + 1} more"


def test_what_does_not_fit_together_is_refused(scene, studies):
    with pytest.raises(InputError, match="no study"):
        assemble(scene)
    with pytest.raises(InputError, match="another load programme"):
        assemble(replace(scene, loading=(1e6,), unload_from=(), unloading=()), studies["two_scale"])
    with pytest.raises(InputError, match="quantiles"):
        assemble(scene, studies["two_scale"], facts=RunFacts(quantiles=(0.9, 0.1)))


# --- file -------------------------------------------------------------------------------------------------


def test_file_is_read_by_plain_xarray(results, folder):
    with xarray.open_dataset(folder / "results.nc") as data:
        assert set(data.variables) == set(results.dataset.variables)
        for name, variable in results.dataset.variables.items():
            assert_array_equal(data[name].values, variable.values, err_msg=name)
            assert data[name].attrs["units"] == variable.attrs["units"]
        assert_array_equal(data["branch"].values, ["loading"] * 3 + ["unloading"] * 2)
        assert data.sizes["realisation"] == 20


def test_results_come_back(results, folder, scene):
    back = open_results(folder)
    assert back.steps == scene.steps
    assert back.case == CASE
    assert back.folder == folder
    assert back.rows() == results.rows()
    assert back._repr_html_() == results._repr_html_()
    assert back.two_scale is None
    # everything but the large fields can be drawn and written again
    assert leakage_figure(back) is not None
    assert pieces_figure(back) is not None
    assert seal_figure(back) is not None


def test_a_missing_or_foreign_folder_is_an_error_in_one_line(tmp_path):
    for make, text in (
        (lambda p: None, "no such folder"),
        (lambda p: p.mkdir(), "no results.nc in it"),
        (
            lambda p: (p.mkdir(), (p / "results.nc").write_bytes(b"nonsense")),
            "a readable netCDF file",
        ),
        (
            lambda p: (
                p.mkdir(),
                xarray.Dataset({"a": 1}).to_netcdf(p / "results.nc", engine="h5netcdf"),
            ),
            "another program",
        ),
    ):
        path = tmp_path / text.replace(" ", "_")
        make(path)
        with pytest.raises(InputError, match=text) as caught:
            open_results(path)
        assert "\n" not in str(caught.value)


def test_a_file_in_the_way_is_an_error(results, tmp_path):
    (tmp_path / "out").write_text("x")
    with pytest.raises(InputError, match="output folder"):
        save(results, tmp_path / "out")


def files(folder):
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def test_another_run_into_the_folder_leaves_nothing_of_the_former(
    results, scene, undrawn, tmp_path
):
    out = tmp_path / "out"
    write_folder(results, out, scene.surface)
    mine = {
        "notes.txt",
        "vtk/view.pvsm",
        "vtk/pieces/step_9999.vtu",
        "vtk/own/a.vtu",
        "old_leakage.png",
    }
    for name in mine:
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_text("mine")
    (out / "files.txt").open("a").write(f"../{out.name}2/keep.txt\n{tmp_path}/keep.txt\n")
    for keep in (tmp_path / "keep.txt", tmp_path / "out2/keep.txt"):
        keep.parent.mkdir(exist_ok=True)
        keep.write_text("mine")
    # fewer steps, no pieces
    short = replace(scene, loading=(50e6,), unload_from=(), unloading=())
    study = deterministic(short)
    written = write_folder(assemble(short, study), out)
    assert files(out) == {str(p.relative_to(out)) for p in written} | mine
    assert {p.name for p in written} == {
        "results.nc",
        "table.csv",
        "table.xlsx",
        "report.html",
        "leakage.png",
        "seal.png",
        "fields.pvd",
        "step_0000.vti",
        "files.txt",
    }
    assert not list(out.glob("vtk/states*"))
    assert (out / "vtk/view.pvsm").read_text() == "mine"
    assert (tmp_path / "keep.txt").exists()
    assert (tmp_path / "out2/keep.txt").exists()
    write_folder(results, out, scene.surface)
    write_folder(assemble(short, study), out)
    assert files(out) == {str(p.relative_to(out)) for p in written} | mine


@pytest.mark.parametrize(
    "error", [ValueError("no such colour"), OSError(28, "No space left on device")]
)
def test_a_picture_that_fails_loses_neither_the_results_nor_the_former_run(
    results, scene, studies, undrawn, tmp_path, monkeypatch, error
):
    old = assemble(scene, studies["deterministic"])
    write_folder(old, tmp_path, scene.surface)
    before = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}

    def fail(*args):
        raise error

    with monkeypatch.context() as patch:
        patch.setattr("femseal.report.pictures.pieces_figure", fail)
        with pytest.raises(FemsealError, match=error.args[-1]) as caught:
            write_folder(results, tmp_path, scene.surface)
    assert str(tmp_path / ".unfinished/results.nc") in str(caught.value)
    assert open_results(tmp_path / ".unfinished").rows() == results.rows()
    assert open_results(tmp_path).rows() == old.rows()
    assert all((tmp_path / name).read_bytes() == content for name, content in before.items())
    written = write_folder(results, tmp_path, scene.surface)
    assert files(tmp_path) == {str(p.relative_to(tmp_path)) for p in written}
    assert open_results(tmp_path).rows() == results.rows()


def test_results_come_last(scene, studies, undrawn, tmp_path, monkeypatch):
    """Wherever the files cease to take their places, the folder either has all of them or no results."""
    r = assemble(scene, studies["deterministic"])
    everything = {
        "results.nc",
        "table.csv",
        "table.xlsx",
        "report.html",
        "leakage.png",
        "seal.png",
        "fields.pvd",
    }
    everything |= {"files.txt"}
    everything |= {f"fields/step_{s:04d}.vti" for s in range(5)}
    save(r, tmp_path)
    move, left = os.replace, 0

    def stop_after_some(source, target):
        nonlocal left
        if ".unfinished" not in str(target):
            left -= 1
            if left < 0:
                raise OSError("stopped")
        move(source, target)

    monkeypatch.setattr(os, "replace", stop_after_some)
    for count in range(len(everything)):
        left = count
        with pytest.raises(FemsealError, match="stopped"):
            write_folder(r, tmp_path)
        assert not (tmp_path / "results.nc").exists()
        assert open_results(tmp_path / ".unfinished").rows() == r.rows()
    left = len(everything)
    write_folder(r, tmp_path)
    assert files(tmp_path) == everything


def test_nothing_is_left_behind_by_a_failure(results, scene, undrawn, tmp_path, monkeypatch):
    save(results, tmp_path)
    before = (tmp_path / "results.nc").read_bytes()

    def fail(*args):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_folder(results, tmp_path, scene.surface)
    with pytest.raises(OSError, match="disk full"):
        write_vtk(results, scene.surface, tmp_path / "vtk")
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [tmp_path / "results.nc"]
    assert (tmp_path / "results.nc").read_bytes() == before


# --- tables -----------------------------------------------------------------------------------------------


def test_a_new_field_is_one_entry(scene, studies, undrawn, tmp_path):
    """A field that says what it is and where it lives comes out in every file and table that has such fields."""

    @dataclass(frozen=True, repr=False)
    class More(FaceResult):
        wet: np.ndarray = declared(
            "wet", "1", "fraction wetted", STEP, heading="wet [%]", default=None
        )
        heat: np.ndarray = declared("heat", "Pa", "stress of heat", PIXEL, default=None)

    @dataclass(frozen=True, eq=False)
    class Pieces(FacePieces):
        depth: np.ndarray = declared("piece_depth", "m", "depth of pieces", PIECE, default=None)

    @dataclass(frozen=True, repr=False)
    class Drawn(MedianSeal):
        depth: np.ndarray = declared("drawn_depth", "m", "depth of parts", PART, default=None)

    @dataclass(frozen=True, repr=False)
    class Seals(StochasticResult):
        worth: np.ndarray = declared(
            "worth", "1", "worth of realisations", REALISATION, default=None
        )

    def with_more(kind, known, **more):
        return kind(**{f.name: getattr(known, f.name) for f in fields(known)}, **more)

    drawn = studies["stochastic"].median_seal
    deep = with_more(Drawn, drawn, depth=np.full(drawn.permeability.shape, 3e-6))
    two = studies["two_scale"]
    more = with_more(
        More,
        replace(two, pieces=with_more(Pieces, two.pieces, depth=np.full((5, M1, M2), 2e-6))),
        wet=np.linspace(0.1, 0.5, 5),
        heat=np.full((5, 64, 128), 4e6, np.float32),
    )
    seals = with_more(
        Seals, replace(studies["stochastic"], median_seal=deep), worth=np.ones((20, 5))
    )
    r = assemble(scene, more, seals)
    write_folder(r, tmp_path)
    back = open_results(tmp_path)
    for name, text in (
        ("wet", "fraction wetted"),
        ("piece_depth", "depth of pieces"),
        ("drawn_depth", "depth of parts"),
        ("worth", "worth of realisations"),
    ):
        assert back.dataset[name].attrs["long_name"] == text
    assert r.rows()[4]["wet"] == 0.5
    assert ",wet," in (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines()[0] + ","
    for page in (
        r._repr_html_(),
        str(r.table()),
        (tmp_path / "report.html").read_text(encoding="utf-8"),
    ):
        assert "wet [%]" in " ".join(page.split())
    cells, *_ = arrays("vtkXMLUnstructuredGridReader", tmp_path / "vtk/pieces/step_0000.vtu")
    assert_allclose(cells["depth_um"], 2.0)
    cells, *_ = arrays("vtkXMLUnstructuredGridReader", tmp_path / "vtk/drawn/step_0000.vtu")
    assert_allclose(cells["depth_um"], 3.0)
    cells, *_ = arrays("vtkXMLImageDataReader", tmp_path / "fields/step_0002.vti")
    assert_allclose(cells["heat_MPa"], 4.0)
    for results in (r, back):
        found = results.pixels("heat", 2, (1, 3))
        assert found.attrs["units"] == "Pa"
        assert found.shape == (16, 16)
        assert_allclose(found, 4e6)
    assert_allclose(r.piece(1, 2)["piece_depth"], 2e-6)


def test_table_says_what_happened(results, scene):
    from rich.console import Console

    stream = io.StringIO()
    Console(file=stream, width=80).print(results.table())
    text = " ".join(stream.getvalue().split())
    factor, unit = leakage_unit(results.leakage)
    assert f"in {unit}" in text
    assert "loading" in text
    assert "unloading from 700 MPa" in text
    assert {"redraws", "patch,"} <= {*text.split()}  # headings are wrapped
    assert "…" not in text
    for row in results.rows():
        value = row["leakage_m2_per_s"] / factor
        number = f"{float(f'{value:.3g}'):.0f}" if value >= 999.5 else f"{value:.3g}"
        assert ("sealed" if value == 0 else number) in text
    rows = results.rows()
    assert [r["branch"] for r in rows] == ["loading"] * 3 + ["unloading from 700 MPa"] * 2
    assert [r["nominal_pressure_Pa"] for r in rows] == [s.pressure for s in scene.steps]


def test_notebook_table_has_a_row_for_each_step(results):
    html = results._repr_html_().partition("<caption>")[2].partition("</table>")[0]
    assert html.count("<tr>") == 1 + len(results.steps)
    assert "unloading from 700 MPa" in html


def test_spreadsheet_table_is_in_si(results, folder):
    with (folder / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert_array_equal([float(r["leakage_m2_per_s"]) for r in rows], results.leakage.values)
    assert_array_equal(
        [float(r["leakage_two_scale_m2_per_s"]) for r in rows], results.dataset["leakage_two_scale"]
    )


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


def test_names_of_branches():
    assert branch_text(np.nan) == "loading"
    assert branch_text(9e8) == "unloading from 900 MPa"


def test_branches_of_tables_have_the_forces_of_the_case(results):
    load = {"loading": ["35000 N"], "unload_from": ["35000 N"]}
    data = results.dataset.assign_attrs(case=json.dumps({"load": load}))
    text = str(replace(results, dataset=data).table())
    assert re.search(r"unloading\s+from\s+35\s+kN", text)
    assert not re.search(r"from\s+700\s+MPa", text)


# --- pictures ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["leakage", "pieces", "seal", "surface"])
def test_pictures_show_something(folder, name):
    image = matplotlib.image.imread(folder / f"{name}.png")[..., :3]
    assert min(image.shape[:2]) > 400
    assert len(np.unique((image[::3, ::3] * 15).astype(int).reshape(-1, 3), axis=0)) > 15


def test_leakage_picture_shows_the_numbers(results):
    axes = leakage_figure(results).axes[0]
    factor, unit = leakage_unit(results.leakage)
    assert unit in axes.get_ylabel()
    lines = {line.get_label(): line for line in axes.get_lines()}
    shown = np.array(lines["loading"].get_ydata())
    expected = results.leakage.values[:3] / factor
    assert_allclose(shown[expected > 0], expected[expected > 0])
    assert_allclose(lines["loading"].get_xdata(), [50, 200, 700])
    assert_allclose(lines["unloading from 700 MPa"].get_xdata(), [700, 300, 50])


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


def test_pictures_of_a_seal_without_any_flow(scene, studies):
    two = studies["two_scale"]
    zero = replace(two, pieces=replace(two.pieces, k=two.pieces.k * 0), leakage=two.leakage * 0)
    r = assemble(scene, zero)
    assert seal_figure(r).axes[2].get_title().startswith("fluid pressure [MPa], no flow")
    # per length, and of the whole seal
    assert r._repr_html_().count("<td>sealed</td>") == 2 * len(r.steps)
    assert "at 700 MPa: sealed" in repr(r)
    for figure in (seal_figure(r), seal_figure(r, 4), pieces_figure(r)):
        figure.savefig(io.BytesIO(), dpi=40)


def test_picture_of_the_seal_shows_the_critical_step(results):
    assert seal_figure(results).get_suptitle() == "loading 700 MPa; inlet at x1 = 0"
    assert seal_figure(results, 0).get_suptitle().startswith("loading 50 MPa;")
    with pytest.raises(InputError, match="step: given 9"):
        seal_figure(results, 9)


def test_pictures_that_the_results_have_nothing_for(scene, studies):
    r = assemble(scene, studies["deterministic"])
    with pytest.raises(InputError, match="pieces figure"):
        pieces_figure(r)
    with pytest.raises(InputError, match="seal figure"):
        seal_figure(assemble(scene, replace(studies["stochastic"], median_seal=None)))


def test_picture_of_a_surface_with_holes():
    heights = np.random.default_rng(1).standard_normal((20, 30)) * 1e-6
    heights[3, 4] = np.nan
    Topography(heights, (1e-6, 2e-6)).plot().savefig(io.BytesIO())


# --- ParaView ---------------------------------------------------------------------------------------------


def arrays(reader_name, path):
    """Cell data, point data, field data and output of one of VTK's own readers."""
    import vtkmodules.vtkIOXML as io_xml
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = getattr(io_xml, reader_name)()
    reader.SetFileName(str(path))
    reader.Update()
    output = reader.GetOutput()
    found = []
    for data in (output.GetCellData(), output.GetPointData()):
        pairs = [data.GetAbstractArray(n) for n in range(data.GetNumberOfArrays())]
        found.append({a.GetName(): vtk_to_numpy(a) for a in pairs})
    fields = output.GetFieldData()
    named = [fields.GetAbstractArray(n) for n in range(fields.GetNumberOfArrays())]
    found.append({a.GetName(): a.GetValue(0) for a in named})
    return (*found, output)


def test_seal_is_read_back_by_vtk(results, folder):
    data = results.dataset
    for s in range(data.sizes["step"]):
        cells, points, fields, grid = arrays(
            "vtkXMLUnstructuredGridReader", folder / f"vtk/pieces/step_{s:04d}.vtu"
        )
        assert grid.GetNumberOfCells() == M1 * M2
        for name, variable, factor in (
            ("k1_m3", "piece_k1", 1),
            ("pressure_MPa", "piece_pressure", 1e-6),
            ("mean_gap_um", "piece_mean_gap", 1e6),
            ("k2_m3", "piece_k2", 1),
            ("contact_fraction", "piece_contact_fraction", 1),
            ("plastic_fraction", "piece_plastic_fraction", 1),
            ("drop_fraction", "piece_drop_fraction", 1),
        ):
            assert_allclose(cells.pop(name).reshape(M1, M2), data[variable][s] * factor, rtol=1e-12)
        assert not cells
        assert not points
        assert_allclose(fields["nominal_pressure_MPa"], results.steps[s].pressure / 1e6)


def test_seal_lies_where_it_should(results, folder):
    """The piece (1, 6), found by its place."""
    import pyvista

    grid = pyvista.read(folder / "vtk/pieces/step_0000.vtu")
    place = (1.5 * 15e-6, 6.4 * 15e-6, 0.0)
    assert_allclose(
        grid.cell_data["k1_m3"][grid.find_containing_cell(place)],
        results.dataset["piece_k1"][0, 1, 6],
    )


def test_series_have_the_step_as_time(results, folder):
    import pyvista

    names = sorted(p.name for p in (folder / "vtk").glob("*.pvd"))
    assert names == ["drawn.pvd", "pieces.pvd", "states.pvd"]
    for name in names:
        reader = pyvista.get_reader(folder / "vtk" / name)
        assert reader.time_values == [0, 1, 2, 3, 4]
        reader.set_active_time_value(4)
        block = reader.read()[0]
        assert block.field_data["nominal_pressure_MPa"][0] == 50
        assert block.field_data["unloaded_from_MPa"][0] == 700


def test_surface_is_read_back_by_vtk(scene, folder):
    _, points, _, grid = arrays("vtkXMLImageDataReader", folder / "vtk/surface.vti")
    assert_allclose(
        points["height_um"].reshape(64, 128, order="F"), scene.surface.heights * 1e6, rtol=1e-6
    )
    d1, d2 = scene.surface.spacing
    number = grid.FindPoint(5.5 * d1, 77.5 * d2, 0.0)
    assert_allclose(points["height_um"][number], scene.surface.heights[5, 77] * 1e6, rtol=1e-6)


def test_names_are_plain(folder):
    cells, points, fields, _ = arrays(
        "vtkXMLUnstructuredGridReader", folder / "vtk/pieces/step_0000.vtu"
    )
    for name in (*cells, *points, *fields):
        assert name.replace("_", "").isalnum()


@pytest.mark.parametrize("cells", [(1, 8), (4, 1), (1, 1)])
def test_a_single_row_or_column_of_pieces_goes_all_the_way(scene, cells, tmp_path):
    two = two_scale(scene, cells)
    drawn = stochastic(scene, cells, Sampling(240e-6, 2, seed=7))
    assert two.leakage.max() > 0
    assert drawn.leakage.shape == (2, 5)
    assert not two.failures + drawn.failures
    r = assemble(scene, two, drawn)
    write_folder(r, tmp_path, scene.surface)
    data = open_results(tmp_path).dataset
    assert (data.sizes["piece1"], data.sizes["piece2"]) == cells
    for name, values in (("pieces", data["piece_k1"][0]), ("states", data["state_k1"][0])):
        found, points, *_ = arrays(
            "vtkXMLUnstructuredGridReader", tmp_path / f"vtk/{name}/step_0000.vtu"
        )
        assert not points
        assert_allclose(found["k1_m3"], values.values.ravel())


def test_pieces_of_the_picture_are_those_that_seals_draw_from(results, studies):
    pieces = studies["stochastic"].pieces
    gap, pressure = pieces_figure(results).axes
    loading = np.array([s.unloaded_from is None for s in pieces.steps])
    for axes, values in ((gap, pieces.mean_gap * 1e6), (pressure, pieces.pressure / 1e6)):
        for name, chosen in (("loading", loading), ("unloading", ~loading)):
            (line,) = (line for line in axes.get_lines() if line.get_label() == name)
            shown = pieces.k1[chosen] > 1e-6 * pieces.k1.max()
            assert_allclose(line.get_xdata(), values[chosen][shown])
            assert_allclose(line.get_ydata(), pieces.k1[chosen][shown])


def test_results_are_written_state_by_state(tmp_path, monkeypatch):
    """Of states that lie on disk, results.nc and fields take the memory of a few, however many there are."""
    monkeypatch.setattr(shared_array, "PART_OF_MEMORY", 0)
    monkeypatch.setattr("femseal.results.variables.FIELD_BLOCKS", 8)
    surface = self_affine(
        (256, 256), (60e-6, 60e-6), hurst=0.8, rms_slope=0.15, roll_off=40e-6, rng=2
    )
    loads = np.linspace(50e6, 800e6, 24)
    scene = Scene(surface, 115e9, 1.4e9, Liquid(1e-3), 1e6, 0.0, loading=tuple(loads), rtol=1e-2)

    def written(folder, steps):
        shorter = replace(scene, loading=tuple(loads[:steps]))
        study = deterministic(shorter)
        tracemalloc.start()
        save(assemble(shorter, study), folder)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    written(tmp_path / "first", 1)  # loads packages
    few, many = (written(tmp_path / str(steps), steps) for steps in (4, 24))
    assert many - few < 4 * 4 * surface.heights.size, "four states of the twenty that are more"


def test_a_band_that_says_nothing_has_no_number_and_a_warning_with_its_source(scene, studies):
    study = studies["deterministic"]
    q, wide = study.leakage, np.zeros(len(scene.steps))
    wide[0] = 90.0
    parts = (
        ErrorPart.of("solver", q, 0 * q + 0.1, 0 * q + 0.1, ""),
        ErrorPart.of("filter", q, wide, wide, ""),
    )
    budget = ErrorBudget("deterministic", q, parts)
    results = assemble(scene, study, facts=RunFacts(budgets={"deterministic": budget}))
    table = results.table()
    column = table.heads.index("95 % band of error")
    assert [line[column].endswith(" to > 1000 times") for line in table.lines] == [
        True,
        *[False] * (q.size - 1),
    ]
    (text,) = (text for text in results.warnings if "factor of 1000" in text)
    assert text.startswith("the leakage at loading 50 MPa is not known")
    assert text.endswith(": filter")
    again = assemble(
        scene, study, facts=RunFacts(budgets={"deterministic": replace(budget, parts=parts[:1])})
    )
    assert not any("factor of 1000" in text for text in again.warnings)
