"""The script of figures: what is drawn is what the dataset holds."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError

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


def shown(image):
    """Values of an image, −1 where there is none."""
    return np.ma.filled(image.get_array(), -1.0)


@pytest.mark.slow
def test_two_scales(ran):
    whole, results = ran
    data, study = results.dataset, whole.two_scale
    cut = study.cells.cut
    above, below = figures.two_scales(results, step=2).subfigs
    flow, contact = (axes.images[0] for axes in above.axes[:2])
    assert_allclose(shown(flow), np.nan_to_num(data["face_fluid_pressure"][2].T / 1e6, nan=-1))
    assert_allclose(shown(contact), data["cell_pressure"].values[2].T / 1e6)
    panels = np.array(below.axes[:9]).reshape(3, 3)
    for (place, fields), axes in zip(figures.closely(results, 2).items(), panels, strict=True):
        gap, pressure, fluid = (one.images for one in axes)
        number = place[0] * cut.shape[1] + place[1]
        for image, field, scale in (
            (gap[0], study.gap, 1e6),
            (pressure[0], study.contact_pressure, 1e-6),
        ):
            expected = cut.split(np.asarray(field[2]))[number].T * scale
            assert_allclose(np.ma.filled(image.get_array(), 0.0), expected, rtol=1e-5)
        cell = fs.cell_permeability(cut.split(study.gap[2])[number], cut.spacing)
        expected = np.nan_to_num(cell.fluid_pressure.T, nan=-1)
        assert_allclose(shown(fluid[0]), expected, atol=1e-4)
        assert_allclose(fluid[1].get_alpha() ** 2, fields["flow"].T)
        assert (fields["flow"][fields["gap"] == 0] == 0).all()


def test_flow_between_parallel_plates_is_the_same_everywhere():
    fields = figures.pixel_flow(np.full((12, 8), 5e-7), (1e-6, 2e-6))
    assert_allclose(fields["flow"], 1.0, rtol=1e-6)
    assert_allclose(fields["fluid"][:, 0], 1 - (np.arange(12) + 0.5) / 12, rtol=1e-6)


@pytest.fixture(scope="module")
def seals(case_file):
    return figures.drawn_seals(fs.load_case(case_file), lengths=(1, 3))


@pytest.mark.slow
def test_every_figure_is_written(ran, case_file, seals, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(figures, "drawn_seals", lambda case: seals)
    monkeypatch.setitem(figures.PRINT, "savefig.dpi", 50)
    save = Figure.savefig  # each picture is drawn once; as a .pdf it takes as long again
    once = {".png": save, ".pdf": lambda _, path: path.touch()}
    monkeypatch.setattr(Figure, "savefig", lambda f, path: once[path.suffix](f, path))
    arguments = ["figures.py", str(ran[1].folder), str(tmp_path / "out"), str(case_file)]
    monkeypatch.setattr(sys, "argv", arguments)
    figures.main()
    assert len(list((tmp_path / "out").glob("figure_*.p*"))) == 12
    assert len(capsys.readouterr().out.splitlines()) == 6
    case_file.write_text(TEXT.replace("seed = 3", "seed = 4"), encoding="utf-8")
    with pytest.raises(InputError, match="the case that produced these results"):
        figures.main()
