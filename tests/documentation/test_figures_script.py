"""The script of figures: what is drawn is what the dataset holds."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal

import femseal as fs
from femseal.base.errors import InputError

SCRIPT = Path(__file__).parents[2] / "examples" / "figures.py"
SPEC = importlib.util.spec_from_file_location("figures", SCRIPT)
figures = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(figures)
TEXT = """
method = "stochastic"
compare = ["two-scale"]
seed = 3
[face]
kind = "turned"
points = [64, 128]
size = ["60 um", "120 um"]
pitch = "30 um"
depth = "1 um"
roughness = "0.3 um"
roughness_roll_off = "30 um"
[material]
young = "210 GPa"
hardness = "2.8 GPa"
[load]
loading = ["50 MPa", "200 MPa", "400 MPa", "800 MPa"]
unload_from = ["400 MPa", "800 MPa"]
unloading = ["600 MPa", "200 MPa", "50 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "10 MPa"
[cells]
count = [4, 8]
[stochastic]
length = "240 um"
realisations = 3
"""
UP, DOWN = [0, 1, 2, 3], [3, 6, 7, 8]


@pytest.fixture(scope="module")
def case_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("case") / "case.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def ran(case_file, tmp_path_factory):
    """Results with all fields, and the same read back from their folder."""
    folder = tmp_path_factory.mktemp("results")
    return fs.run(fs.load_case(case_file), folder, workers=1), fs.open_results(folder)


def curve(axes, label):
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return line.get_data()


def test_the_face_stands_beside_its_leakage(ran):
    face, curves = figures.face_and_leakage(ran[1]).axes[:2]
    heights = ran[0].scene.surface.heights
    assert_allclose(
        face.images[0].get_array(), heights.T * 1e6, rtol=1e-6
    )  # stored in single precision
    assert_allclose(face.images[0].get_extent(), [0, 1e3 * ran[0].scene.surface.size[0], 0, 0.12])
    assert curves.get_xlabel() == "nominal pressure [MPa]"


def test_two_scales(ran):
    whole, results = ran
    data, study = results.dataset, whole.two_scale
    cut = study.pieces.cut
    figure = figures.two_scales(results, step=2)
    above, below = figure.subfigs
    flow, contact = above.axes[:2]
    assert_allclose(
        flow.images[0].get_array().filled(-1),
        np.nan_to_num(data["face_fluid_pressure"][2].T / 1e6, nan=-1),
    )
    assert_allclose(contact.images[0].get_array(), data["piece_pressure"].values[2].T / 1e6)
    panels = np.array(below.axes[:9]).reshape(3, 3)
    pieces = figures.closely(results, 2)
    assert len(pieces) == 3
    for (place, fields), (gap, pressure, fluid) in zip(pieces.items(), panels, strict=True):
        number = place[0] * cut.shape[1] + place[1]
        for axes, field, scale in ((gap, study.gap, 1e6), (pressure, study.contact_pressure, 1e-6)):
            expected = cut.pieces(np.asarray(field[2]))[number].T * scale
            assert_allclose(axes.images[0].get_array().filled(0.0), expected, rtol=1e-5)
        cell = fs.cell_permeability(cut.pieces(study.gap[2])[number], cut.spacing)
        assert_allclose(
            fluid.images[0].get_array().filled(-1),
            np.nan_to_num(cell.fluid_pressure.T, nan=-1),
            atol=1e-4,
        )
        assert_allclose(fluid.images[1].get_alpha() ** 2, fields["flow"].T)
        assert (fields["flow"][fields["gap"] == 0] == 0).all()


def test_flow_between_parallel_plates_is_the_same_everywhere():
    fields = figures.pixel_flow(np.full((12, 8), 5e-7), (1e-6, 2e-6))
    assert_allclose(fields["flow"], 1.0, rtol=1e-6)
    assert_allclose(fields["fluid"][:, 0], 1 - (np.arange(12) + 0.5) / 12, rtol=1e-6)


def of_pieces(field):
    """A field over states as (pieces, states)."""
    return field.values.reshape(len(field), -1).T


def test_cycles(ran):
    results = ran[1]
    data = results.dataset
    k = data["state_k1"].values.reshape(data.sizes["state"], -1).T
    up, down = figures.up_and_down(results, "state_")
    single, every, closed = figures.cycles(results).axes
    chosen = figures.typical(k, up, down, 4)
    assert len(set(chosen)) == 4
    for piece in chosen:
        x, y = curve(single, f"piece {piece}")
        assert_allclose(x, data["state_nominal_pressure"].values[down] / 1e6)
        assert_array_equal(np.nan_to_num(y), k[piece, down])
    for steps, line, name in ((up, 0, "loading"), (down, 1, "unloading")):
        assert_allclose(
            np.nan_to_num(curve(every, name)[1]), np.median(k[:, steps], axis=0), rtol=1e-14
        )
        assert_allclose(closed.lines[line].get_ydata(), 100 * np.mean(k[:, steps] == 0, axis=0))
    assert closed.lines[0].get_ydata().max() > 0


def test_typical_pieces_are_in_the_order_of_their_closing():
    k = (
        np.array([[3, 0, 0], [0, 0, 0], [3, 2, 2], [3, 1, 0], [3, 1, 2], [np.nan, 1, 1], [0, 5, 1]])
        * 1e-18
    )
    assert_array_equal(figures.typical(k, np.array([0, 1]), np.array([1, 2]), 5), [0, 3, 6, 4, 2])


def test_permeability(ran):
    results = ran[1]
    data = results.dataset
    k, gap, pressure = (
        data[f"state_{n}"].values.reshape(data.sizes["state"], -1).T
        for n in ("k1", "mean_gap", "pressure")
    )
    left, right = figures.permeability(results).axes
    for name, steps in zip(
        ("loading", "unloading"), figures.up_and_down(results, "state_"), strict=True
    ):
        shown = k[:, steps] > 0
        for axes, x in ((left, gap * 1e6), (right, pressure / 1e6)):
            assert_array_equal(curve(axes, name), [x[:, steps][shown], k[:, steps][shown]])
        assert_array_equal(
            np.nan_to_num(curve(right, f"{name}, median")[1]), np.median(k[:, steps], axis=0)
        )
    h, plates = curve(left, r"$\bar h^3/12$")
    assert_allclose(plates, (h * 1e-6) ** 3 / 12)
    assert left.get_xscale() == left.get_yscale() == "log"


@pytest.fixture(scope="module")
def seals(case_file):
    return figures.drawn_seals(fs.load_case(case_file), lengths=(1, 3))


def test_leakage(seals):
    assert [round(seal.seal.length * 1e6) for seal in seals] == [120, 360]
    assert_array_equal(seals[0].pieces.k, seals[1].pieces.k)
    steps = seals[0].steps
    assert len({s.unloaded_from for s in steps} - {None}) == 4
    left, right = figures.leakage(seals).axes
    for seal, name in zip(seals, ("0.12 mm", "0.36 mm"), strict=True):
        expected = {
            s.pressure / 1e6: q
            for s, q in zip(steps, seal.quantile(0.5), strict=True)
            if s.unloaded_from == 8e8
        }
        x, y = curve(left, name)
        assert x[0] == 800
        assert len(expected) >= 8
        assert_array_equal(np.nan_to_num(y)[1:], np.nan_to_num([expected[p] for p in x[1:]]))
    for peak in (200, 400, 600, 800):
        x, y = curve(right, f"from {peak} MPa")
        assert x[0] == peak
        assert (np.diff(x) < 0).all()
        assert len(x) >= 8
        expected = {
            s.pressure / 1e6: q
            for s, q in zip(steps, seals[1].quantile(0.5), strict=True)
            if s.unloaded_from == peak * 1e6
        }
        assert_array_equal(np.nan_to_num(y)[1:], np.nan_to_num([expected[p] for p in x[1:]]))
    assert_array_equal(curve(right, "loading")[0], [50, 200, 400, 600, 800])


def test_constrictions(ran):
    results = ran[1]
    data = results.dataset
    left, right = figures.constrictions(results).axes[:2]
    lines, q = iter(left.lines), data["leakage_two_scale"].values
    falling = np.sort(data["piece_drop_fraction"].values.reshape(len(q), -1), axis=1)[:, ::-1]
    for count in (1, 3, 10):
        for steps in (UP, [4, 5, 6, 7, 8]):
            assert_allclose(
                next(lines).get_data(), [(q / q[0])[steps], falling[steps, :count].sum(axis=1)]
            )
    least = int(np.argmin(np.where(q > 0, q, np.inf)))
    assert_allclose(right.images[0].get_array(), 100 * data["piece_drop_fraction"].values[least].T)


def test_results_that_do_not_do(ran):
    results = ran[1]
    without = replace(
        results, dataset=results.dataset.drop_vars(["piece_k1", "piece_drop_fraction", "state_k1"])
    )
    for figure in (figures.two_scales, figures.cycles, figures.permeability, figures.constrictions):
        with pytest.raises(InputError, match="results: given those of the study median"):
            figure(without)
    loading = replace(
        results, dataset=results.dataset.isel(state=figures.up_and_down(results, "state_")[0])
    )
    with pytest.raises(InputError, match="a run with unloading"):
        figures.cycles(loading)
    sealed = results.dataset.assign(leakage_two_scale=0 * results.dataset["leakage_two_scale"])
    with pytest.raises(InputError, match="never leaks"):
        figures.constrictions(replace(results, dataset=sealed))


def test_every_figure_is_written(ran, case_file, seals, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(figures, "drawn_seals", lambda case: seals)
    monkeypatch.setitem(figures.PRINT, "savefig.dpi", 50)
    save = Figure.savefig  # each picture is drawn once; as a .pdf it takes as long again
    monkeypatch.setattr(
        Figure, "savefig", lambda f, p: save(f, p) if p.suffix == ".png" else p.touch()
    )
    folder = str(ran[1].folder)
    monkeypatch.setattr(sys, "argv", ["figures.py", folder, str(tmp_path / "out"), str(case_file)])
    figures.main()
    names = [
        f"figure_{n}.{s}"
        for n in (
            "0_face",
            "1_two_scales",
            "2_cycles",
            "3_permeability",
            "4_leakage",
            "5_constrictions",
        )
        for s in ("pdf", "png")
    ]
    assert sorted(path.name for path in (tmp_path / "out").glob("figure*")) == names
    assert len(capsys.readouterr().out.splitlines()) == 6
    other = tmp_path / "other.toml"
    other.write_text(TEXT.replace("seed = 3", "seed = 4"), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["figures.py", folder, str(tmp_path / "out"), str(other)])
    with pytest.raises(InputError, match="the case of the results"):
        figures.main()
