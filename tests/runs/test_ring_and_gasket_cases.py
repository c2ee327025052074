"""Cases of a ring and of a gasket from their file to ParaView, and the faults of a seal's table."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import pyvista
from numpy.testing import assert_allclose, assert_array_equal

import femseal as fs
from femseal.base import Stage
from femseal.case import parse_case
from femseal.execution.processes import over_processes
from femseal.plots.drawing import png
from femseal.plots.maps import seal_figure
from femseal.preparation import prepare

EXAMPLES = Path(__file__).parents[2] / "examples"
#: Fewer loads and tiles; the ring is narrower, and the gasket has larger cells.
REDUCED = {
    "annular_seal": {
        "seal": {"outer_radius": "10.6 mm"},
        "face": {"points": [96, 96], "size": ["120 um", "120 um"]},
        "cells": {"count": [2, 2]},
    },
    "gasket_seal": {"face": {"points": [64, 128]}},
}
LOAD = {"loading": ["50 MPa", "200 MPa"], "unload_from": ["200 MPa"], "unloading": ["50 MPa"]}


def reduced(name, **more):
    data = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    changes = REDUCED[name] | {"load": LOAD, "stochastic": {"realisations": 3}}
    for table, keys in (*changes.items(), *more.items()):
        data[table] = data.get(table, {}) | keys
    return data


@pytest.fixture(
    scope="module", params=["annular_seal", pytest.param("gasket_seal", marks=pytest.mark.slow)]
)
def done(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    case = parse_case(reduced(request.param), EXAMPLES)
    return case, fs.run(case, folder, workers=1), folder


def test_leakage_is_that_of_the_shape(done):
    """Between what rings of the smallest and the largest permeability of a drawn part would leak; it closes and opens."""
    case, results, _ = done
    assert results.failures == []
    first, top, back = results.leakage.values
    assert 0 < top < back < first
    length = results.dataset.attrs["seal_size_m"][1]
    # the squares of the whole gasket: see test_meshes; across the lay, on the ring everywhere, less than k of the element
    expected, squares, within = {
        "annular": (np.pi * 20.6e-3, 2 * np.pi / np.log(10.6 / 10), 0.6),
        "mesh": (0.11, 10.1, 0.35),
    }[case.seal.kind]
    assert_allclose(length, expected)
    rate = case.fluid.inlet_pressure / case.fluid.viscosity * squares / length
    for k, leakage in zip(results.dataset["drawn_permeability"], (first, top, back), strict=True):
        assert 0.5 * k.min() * rate < leakage < k.max() * rate
        assert_allclose(leakage, np.exp(np.log(k).mean()) * rate, rtol=within)


@pytest.mark.parametrize("done", ["annular_seal"], indirect=True)
def test_results_do_not_depend_on_workers_and_a_finished_run_is_found(done, monkeypatch, tmp_path):
    case, results, folder = done
    with over_processes(2) as mapper:
        list(mapper(Stage("start", abs), [1, 2]))
    monkeypatch.chdir(tmp_path)  # the processes stay where they were
    again = fs.run(case, "again", workers=2)
    for view in (folder / "vtk").rglob("*.vt?"):  # by another process than that of the pictures
        assert (tmp_path / "again" / view.relative_to(folder)).read_bytes() == view.read_bytes()
    for name in ("leakage", "drawn_permeability"):
        assert_array_equal(again.dataset[name].values, results.dataset[name].values)
    log = (folder / "run.log").read_text(encoding="utf-8")
    fs.run(case, folder, resume=True)
    assert (folder / "run.log").read_text(encoding="utf-8") == log


def test_files_for_people_and_paraview(done):
    case, results, folder = done
    reader, data = pyvista.get_reader(folder / "vtk" / "drawn.pvd"), results.dataset
    assert reader.time_values == [0, 1, 2]
    reader.set_active_time_value(1)
    block = reader.read()[0]
    assert block.n_cells == data.sizes["part"]
    # corners that parts share are one point
    assert block.n_points < 0.9 * data.sizes["part"] * data.sizes["corner"]
    assert_allclose(block.cell_data["permeability_m3"], data["drawn_permeability"].values[1])
    p = block.cell_data["fluid_pressure_MPa"] * 1e6
    assert 0 <= p.min() < 0.15 * p.max() < p.max() <= case.fluid.inlet_pressure
    # the fluid pressure falls from the bore outwards
    r = np.hypot(*block.cell_centers().points[:, :2].T)
    assert p[r < np.quantile(r, 0.1)].mean() > 3 * p[r > np.quantile(r, 0.9)].mean()
    assert len(png(seal_figure(results))) > 20_000


TWO_SCALE = {"method": "two-scale"}


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("annular_seal", {"stochastic": {"length": "1 mm"}}, "stochastic.length: given 1 mm, exp"),
        ("annular_seal", {"stochastic": {"breadth": "1 mm"}}, "stochastic.breadth: given 1 mm, "),
        ("annular_seal", TWO_SCALE, "seal.kind: given annular with the method two-scale"),
        ("gasket_seal", {"seal": {"unit": "kg"}}, "seal.unit: given 'kg'"),
        (
            "gasket_seal",
            {"seal": {"inlet": "door"}},
            "seal.inlet: given 'door', expected the name of a boundary of the mesh: 'bore'",
        ),
    ],
)
def test_faults_are_one_line_with_their_key(name, changes, words):
    tables = {key: table for key, table in changes.items() if isinstance(table, dict)}
    data = reduced(name, **tables) | (changes if changes is TWO_SCALE else {})
    with pytest.raises(fs.InputError, match=f"^{words}") as error:
        prepare(parse_case(data, EXAMPLES))
    assert "\n" not in str(error.value)


def test_a_strip_is_as_long_as_the_face():
    prepared = prepare(parse_case(reduced("annular_seal") | {"seal": {"kind": "rectangular"}}))
    assert prepared.sampling.length == prepared.scene.surface.size[1]


def test_another_mesh_is_another_run(tmp_path):
    """The content of the mesh is part of what a run goes on from."""
    from femseal.runs.identity import face_files

    data = reduced("gasket_seal") | {"seal": reduced("gasket_seal")["seal"] | {"path": "seal.msh"}}
    (tmp_path / "seal.msh").write_text("one")
    first = face_files(parse_case(data, tmp_path))
    (tmp_path / "seal.msh").write_text("two")
    assert list(first) == ["seal.msh"] != face_files(parse_case(data, tmp_path))
