"""Cases of a ring and of a gasket from their file to ParaView, and the faults of a seal's table."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import femseal as fs
from femseal import cli
from femseal.base.stage import Stage
from femseal.case.case import parse_case
from femseal.execution.processes import over_processes
from femseal.plots import seal_figure
from femseal.plots.drawing import drawn
from femseal.preparation.preparation import prepare
from femseal.runs.forecast import describe

pytestmark = pytest.mark.usefixtures("drawn_pictures")

EXAMPLES = Path(__file__).parents[2] / "examples"
#: Fewer loads and tiles; the ring is narrower, and the gasket has larger pieces.
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


@pytest.fixture(scope="module", params=sorted(REDUCED))
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
    k = results.dataset["drawn_permeability"].values
    length = results.dataset.attrs["seal_size_m"][1]
    if case.seal.kind == "annular":
        assert_allclose(length, np.pi * 20.6e-3)
        squares = 2 * np.pi / np.log(10.6 / 10)
    else:
        assert_allclose(length, 0.11)
        squares = 10.1  # of the whole gasket, see test_meshes
    rate = case.fluid.inlet_pressure / case.fluid.viscosity * squares / length
    for s, leakage in enumerate((first, top, back)):
        assert 0.5 * k[s].min() * rate < leakage < k[s].max() * rate
        # across the lay, on the ring everywhere, less than k of the element
        assert_allclose(
            leakage,
            np.exp(np.log(k[s]).mean()) * rate,
            rtol=0.6 if case.seal.kind == "annular" else 0.35,
        )


@pytest.mark.parametrize("done", ["gasket_seal"], indirect=True)
def test_results_do_not_depend_on_workers_and_a_finished_run_is_found(done, monkeypatch, tmp_path):
    case, results, folder = done
    with over_processes(2) as mapper:
        list(mapper(Stage("start", abs), [1, 2]))
    monkeypatch.chdir(tmp_path)  # the processes stay where they were
    again = fs.run(case, "again", workers=2)
    for view in sorted(
        (folder / "vtk").rglob("*.vt?")
    ):  # by another process than that of the pictures
        assert (tmp_path / "again" / view.relative_to(folder)).read_bytes() == view.read_bytes()
    assert_array_equal(again.dataset["leakage"].values, results.dataset["leakage"].values)
    assert_array_equal(
        again.dataset["drawn_permeability"].values, results.dataset["drawn_permeability"].values
    )
    log = (folder / "run.log").read_text(encoding="utf-8")
    fs.run(case, folder, resume=True)
    assert (folder / "run.log").read_text(encoding="utf-8") == log


def test_files_for_people_and_paraview(done):
    import pyvista

    case, results, folder = done
    reader = pyvista.get_reader(folder / "vtk" / "drawn.pvd")
    assert reader.time_values == [0, 1, 2]
    reader.set_active_time_value(1)
    block = reader.read()[0]
    data = results.dataset
    assert block.n_cells == data.sizes["part"]
    assert (
        block.n_points < 0.9 * data.sizes["part"] * data.sizes["corner"]
    )  # corners that parts share are one point
    assert_allclose(block.cell_data["permeability_m3"], data["drawn_permeability"].values[1])
    p = block.cell_data["fluid_pressure_MPa"] * 1e6
    assert 0 <= p.min() < 0.15 * p.max() < p.max() <= case.fluid.inlet_pressure
    # the fluid pressure falls from the bore outwards
    r = np.hypot(*block.cell_centers().points[:, :2].T)
    assert p[r < np.quantile(r, 0.1)].mean() > 3 * p[r > np.quantile(r, 0.9)].mean()
    assert (folder / "seal.png").stat().st_size > 20_000
    page = (folder / "report.html").read_text(encoding="utf-8")
    words = {
        "annular": "a ring between the radii 10 mm and 10.6 mm",
        "mesh": "the mesh bolted_ring.msh, lay x2",
    }
    assert words[case.seal.kind] in page
    assert "The drawn seal nearest to the median" in page


def test_parts_are_drawn_in_the_colours_of_their_values(done):
    _, results, _ = done
    figure, data = seal_figure(results, 0), results.dataset
    detail = next(axes for axes in figure.axes if axes.get_title().startswith("fluid pressure"))
    middles = data["drawn_corners"].values.mean(axis=1) * 1e3
    # a high seal lies
    middles = middles[:, ::-1] if detail.get_xlabel().startswith("x2") else middles
    # near enough for the middle of a part to be its own pixel
    (x, y), side = middles[0], 0.2 * np.ptp(middles, axis=0).min()
    detail.set(xlim=(x - side, x + side), ylim=(y - side, y + side))
    pixels = drawn(figure).pixels
    places = detail.transData.transform(middles)
    low, high = detail.bbox.get_points()
    seen = ((places > low + 3) & (places < high - 3)).all(axis=1)
    assert seen.sum() > 100
    columns, rows = places[seen].astype(int).T
    (parts,) = detail.collections
    colours = parts.to_rgba(data["drawn_fluid_pressure"].values[0, seen] / 1e6, bytes=True)[:, :3]
    assert_allclose(pixels[len(pixels) - 1 - rows, columns].astype(int), colours, atol=1)


@pytest.mark.parametrize("name", sorted(REDUCED))
def test_check_knows_the_shape(name):
    case = parse_case(reduced(name), EXAMPLES)
    lines = "\n".join(describe(case, prepare(case)))
    assert re.search(r"^seal +(a ring between|the mesh bolted_ring)", lines, re.MULTILINE)
    assert re.search(
        {
            "annular_seal": rf"3 seals of 10 × 400 tiles, 37 % of a length of {2 * np.pi * 10.3:.1f} mm",
            "gasket_seal": r"3 seals of 5940 tiles in 5940 elements",
        }[name],
        lines,
    )


def refused(data, folder=EXAMPLES):
    with pytest.raises(fs.InputError) as error:
        prepare(parse_case(data, folder))
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("name", "table", "keys", "words"),
    [
        (
            "annular_seal",
            "stochastic",
            {"length": "1 mm"},
            "stochastic.length: given 1 mm, expected none with a seal of",
        ),
        (
            "annular_seal",
            "stochastic",
            {"breadth": "1 mm"},
            "stochastic.breadth: given 1 mm, expected none with a seal",
        ),
        ("gasket_seal", "seal", {"unit": "kg"}, "seal.unit: given 'kg'"),
    ],
)
def test_faults_are_one_line_with_their_key(name, table, keys, words):
    assert refused(reduced(name, **{table: keys})).startswith(words)


def test_a_shape_needs_the_method_that_draws_it_and_a_strip_is_as_long_as_the_face():
    data = reduced("annular_seal") | {"method": "two-scale"}
    assert refused(data).startswith(
        "seal.kind: given annular with the method two-scale, expected it with stochastic"
    )
    data = reduced("annular_seal") | {"seal": {"kind": "rectangular"}}
    prepared = prepare(parse_case(data))
    assert prepared.sampling.length == prepared.scene.surface.size[1]


def test_bad_seals_end_with_code_2_and_write_nothing(tmp_path, monkeypatch, capsys):
    text = (EXAMPLES / "gasket_seal.toml").read_text(encoding="utf-8")
    path = tmp_path / "case.toml"
    path.write_text(
        text.replace("../meshes", str(EXAMPLES.parent / "meshes")).replace('"bore"', '"door"')
    )
    monkeypatch.setattr("sys.argv", ["femseal", "run", str(path), "-o", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    out, told = capsys.readouterr()
    assert (stop.value.code, out) == (2, "")
    assert told.startswith(
        "femseal: seal.inlet: given 'door', expected the name of a boundary of the mesh: 'bore'"
    )
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_another_mesh_is_another_run(tmp_path):
    """The content of the mesh is part of what a run goes on from."""
    from femseal.runs.job import face_files

    data = reduced("gasket_seal") | {"seal": reduced("gasket_seal")["seal"] | {"path": "seal.msh"}}
    (tmp_path / "seal.msh").write_text("one")
    first = face_files(parse_case(data, tmp_path))
    (tmp_path / "seal.msh").write_text("two")
    assert list(first) == ["seal.msh"] != face_files(parse_case(data, tmp_path))
