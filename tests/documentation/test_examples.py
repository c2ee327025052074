"""What is shipped to be run: examples, their scripts, the README's code; measured faces as instruments wrote them."""

import re
import runpy
import shutil
import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import femseal as fs
from femseal.case import parse_case
from femseal.loads import LoadStep
from femseal.preparation import prepare

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
LOAD = {
    "loading": ["100 MPa", "200 MPa", "400 MPa", "500 MPa"],
    "unload_from": ["500 MPa"],
    "unloading": ["400 MPa", "200 MPa", "100 MPa"],
}
#: Smaller faces of the same pixel and cells, short seals.
REDUCED = {
    "turned_seal": {
        "face": {"points": [128, 256], "size": ["120 um", "240 um"]},
        "cells": {"count": [4, 8]},
        "stochastic": {"length": "480 um"},
    },
    "self_affine_seal": {
        "face": {"points": [96, 192], "size": ["90 um", "180 um"]},
        "cells": {"count": [3, 6]},
        "stochastic": {"length": "360 um"},
    },
    "measured_seal": {"stochastic": {"length": "1.2 mm"}},
}


def _case(name):
    data = tomllib.loads((EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))
    for table, changes in REDUCED[name].items():
        data[table] = data.get(table, {}) | changes
    data["load"] = LOAD
    data["stochastic"]["realisations"] = 8
    return parse_case(data, EXAMPLES)


#: The measured face of an example has its own number of points, and its run takes longest.
RUN = [
    pytest.param(name, marks=pytest.mark.slow) if name == "measured_seal" else name
    for name in sorted(REDUCED)
]


@pytest.fixture(scope="module", params=RUN)
def results(request):
    return fs.run(_case(request.param), workers=1)


def _leakages(results):
    """Of all methods, without the ends of bands that are about the errors of a patch or of pixels only."""
    return [
        v.values
        for n, v in results.dataset.data_vars.items()
        if n.startswith("leakage_")
        and not n.endswith("together")
        and "budget" not in n
        and v.dims == ("step",)
    ]


def test_every_example_is_run_here():
    elsewhere = {"annular_seal", "gasket_seal"}  # in runs/test_ring_and_gasket_cases.py
    elsewhere |= {"wanted_accuracy", "leak_test"}  # in refinement/ and calibration/
    elsewhere |= {"silver_ring"}  # in test_example_scripts.py
    assert {path.stem for path in EXAMPLES.glob("*.toml")} == {*REDUCED, *elsewhere}


class TestExamples:
    def test_leakage_falls_with_load_and_comes_back_less(self, results):
        told = [w for w in results.warnings if "realisations" not in w]
        assert told == results.failures == []
        leakages = _leakages(results)
        assert len(leakages) >= 4  # median, both ends of the band, mean or another method
        for leakage in leakages:
            assert np.isfinite(leakage).all()
            up, down = leakage[:4], leakage[4:]
            assert (np.diff(up) < 0).all()
            assert (np.diff([up[3], *down]) > 0).all()  # opens again as it is released, and
            assert (down < up[2::-1]).all()  # leaks less than on loading at the same pressure
            # it hardly rises at the beginning, and undoes less than half of what this changed on the way up
            assert down[0] < 1.5 * up[3]
            assert down[0] / up[3] < np.sqrt(up[2] / up[3])

    def test_methods_agree_on_the_open_seal(self, results):
        """At the lowest load, where no constriction decides, all methods see the same mean gap."""
        methods = {"leakage_median", "leakage_two_scale", "leakage_deterministic"}
        first = [results.dataset[n].values[0] for n in methods & {*results.dataset.data_vars}]
        assert len(first) >= 2
        assert max(first) < 1.5 * min(first)

    def test_contact_grows_with_load(self, results):
        data = results.dataset
        share = data["contact_fraction"].values
        assert (np.diff(share[:4]) > 0).all()
        assert (np.diff(share[3:]) < 0).all()
        # what is in contact carries the load with at most the hardness
        load = data["nominal_pressure"].values - data["fluid_carried_pressure"].values
        assert (share * data.attrs["hardness_Pa"] >= load * 0.99).all()


@pytest.mark.slow
class TestClaims:
    """What the comments of the case files say about the runs at full size."""

    def test_turned_seal(self):
        results = fs.run(EXAMPLES / "turned_seal.toml")
        k1 = results.stochastic.cells.k1
        spread = k1.max(axis=(1, 2)) / k1.min(axis=(1, 2))
        assert_allclose(spread[[_at(results, 25e6), _at(results, 500e6)]], [2.9, 12], rtol=0.1)
        surface = prepare(fs.load_case(EXAMPLES / "turned_seal.toml")).scene.surface
        assert_allclose(2.8e9 / (210e9 / (2 * (1 - 0.3**2)) * surface.rms_slope), 0.11, atol=0.005)
        leakage = results.leakage.values
        assert leakage[_at(results, 250e6, 500e6)] < 2 * leakage[_at(results, 500e6)]
        assert results.warnings == []
        readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
        peak = leakage[_at(results, 500e6)]
        (stated,) = re.findall(r"each metre of this seal, [^,]+, leaks (\S+) µL/s", readme)
        assert_allclose(peak * 1e9, float(stated), rtol=0.02)
        (half,) = re.findall(
            r"at the remaining 250 MPa is only (\S+) times the leakage at 500 MPa", readme
        )
        assert_allclose(leakage[_at(results, 250e6, 500e6)] / peak, float(half), rtol=0.05)
        (loading,) = re.findall(
            r"On loading, the leakage at 250 MPa was (\S+) times the leakage at 500 MPa", readme
        )
        assert_allclose(leakage[_at(results, 250e6)] / peak, float(loading), rtol=0.05)

    def test_measured_seal(self):
        results = fs.run(EXAMPLES / "measured_seal.toml")
        leakage = results.leakage.values
        peak = leakage[_at(results, 900e6)]
        assert_allclose(
            leakage[[_at(results, 600e6, 900e6), _at(results, 600e6)]] / peak, [1.8, 8], rtol=0.1
        )


def _at(results, pressure, peak=None):
    return results.steps.index(LoadStep(pressure, peak))


class TestMeasuredFace:
    def test_the_script_makes_the_file(self, tmp_path):
        script = shutil.copy(EXAMPLES / "make_measured_face.py", tmp_path)
        runpy.run_path(script, run_name="__main__")
        made, shipped = (
            fs.read_topography(folder / "measured_face.x3p") for folder in (tmp_path, EXAMPLES)
        )
        assert made.spacing == shipped.spacing == (1e-6, 1e-6)
        assert_array_equal(np.isnan(made.heights), np.isnan(shipped.heights))
        assert_allclose(made.heights, shipped.heights, atol=1.01e-9)  # stored in whole nanometres

    def test_it_is_what_it_is_said_to_be(self):
        prepared = prepare(fs.load_case(EXAMPLES / "measured_seal.toml"))
        report = prepared.conditioning
        assert 0.015 < report.undefined_fraction < 0.025
        assert 0.4e-6 < report.rms_height < 1e-6
        assert_allclose(
            report.removed_curvature[2], 20, rtol=0.3
        )  # and what the roughness adds to it
        assert report.shape == (280, 560)
        # marks along the seal: rougher across them
        across, along = prepared.scene.surface.rms_slopes
        assert across > 1.1 * along
        assert (EXAMPLES / "measured_face.x3p").stat().st_size < 500_000


def test_ring_mesh_is_what_its_script_writes(tmp_path):
    script = shutil.copy(ROOT / "meshes" / "ring.py", tmp_path)
    runpy.run_path(script, run_name="__main__")
    made, shipped = (meshio.read(folder / "ring.msh") for folder in (tmp_path, ROOT / "meshes"))
    assert_allclose(made.points, shipped.points, atol=1e-15)
    assert made.field_data.keys() == shipped.field_data.keys() == {"inlet", "outlet", "seal"}
    for name, blocks in made.cells_dict.items():
        assert_array_equal(blocks, shipped.cells_dict[name])


class TestReadme:
    text = (ROOT / "README.md").read_text(encoding="utf-8")

    @pytest.mark.slow
    def test_python_block_prints_what_the_page_shows(self, capsys):
        (block,) = re.findall(r"```python\n(.*?)```", self.text, re.DOTALL)
        exec(block.split("results = fs.run")[0], {})
        (shown,) = re.findall(r"```text\n(.*?)```", self.text, re.DOTALL)
        number = r"[\d.]+(?:e[+-]?\d+)?"
        printed = capsys.readouterr().out
        assert re.sub(number, "#", printed) == re.sub(number, "#", shown)
        values = [np.array(re.findall(number, text), dtype=float) for text in (printed, shown)]
        assert_allclose(*values, rtol=0.01)

    def test_python_block(self, capsys):
        """It runs on a smaller face; what it prints is a cycle: contact grows, leakage falls, and comes back less."""
        (block,) = re.findall(r"```python\n(.*?)```", self.text, re.DOTALL)
        block, whole_run = block.split("results = fs.run")
        assert "(256, 256), (0.2e-3, 0.2e-3)" in block
        exec(block.replace("(256, 256), (0.2e-3, 0.2e-3)", "(96, 96), (75e-6, 75e-6)"), {})
        lines = capsys.readouterr().out.splitlines()
        contact = [float(re.search(r"contact ([\d.]+)%", line)[1]) for line in lines]
        leakage = [float(re.search(r"([\d.e+-]+) m²/s", line)[1]) for line in lines]
        assert [line.split(" contact")[0] for line in lines] == [
            "loading 100 MPa",
            "loading 300 MPa",
            "loading 900 MPa",
            "unloading 450 MPa from 900 MPa",
            "unloading 100 MPa from 900 MPa",
        ]
        assert contact[0] < contact[1] < contact[2] > contact[3] > contact[4]
        assert leakage[0] > leakage[1] > leakage[2] < leakage[3] < leakage[4] < leakage[0]
        (path,) = re.findall(r'load_case\("(.*?)"\)', whole_run)
        assert fs.load_case(ROOT / path).methods == {"stochastic", "two-scale"}
