"""Example scripts and the tutorial: each runs, and one physical number of it is right."""

import json
import runpy
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import qmc

import femseal as fs
from femseal import analytic
from femseal.results import assemble, save

pytestmark = pytest.mark.usefixtures("drawn_pictures")

EXAMPLES = Path(__file__).parents[2] / "examples"
#: make_measured_face.py is run by the tests of the examples' files.
WRITES = {
    "measured_face": "measured_contact.png",
    "read_results": "report.html",
    "design_answer": "design.png",
}
SCRIPTS = {path.stem for path in EXAMPLES.glob("*.py")} - {"make_measured_face"}


def names(stem):
    return runpy.run_path(str(EXAMPLES / f"{stem}.py"))


@pytest.fixture(scope="module")
def drawn():
    return names("real_size_seal")


@pytest.fixture(scope="module")
def drawn_seal(drawn):
    return drawn["drawn_seal"](realisations=3)


def test_every_script_has_a_test():
    here = {
        "elastic_check",
        "one_cell",
        "scratch",
        "lens_ring",
        "measured_face",
        "real_size_seal",
        "read_results",
        "design_answer",
        "sobol",
        "coating_thickness",
    }
    elsewhere = {"figures", "paper_2018", "real_sizes", "two_scale_view", "paraview_two_scale"}
    assert here | elsewhere == SCRIPTS


def test_elastic_check_is_right_to_pixels():
    solved, exact = names("elastic_check")["contact_shares"](np.array([0.1, 0.5, 0.9]))
    assert_allclose(
        solved, exact, atol=2 / 128
    )  # two edges of contact, each off by a pixel at most
    assert_allclose(exact[1], 0.5)


def test_lens_rings_touch_on_bands_broader_than_smooth_ones_and_leak_by_their_form():
    example = names("lens_ring")
    rings, forces = example["lens_rings"](), example["FORCES"]
    for radius, ring in rings.items():
        smooth = [example["hertz_band"](radius, force) for force in forces]
        assert (ring.band_breadth > 0.9 * np.minimum(smooth, 1.024e-3)).all()
    assert rings[0.01].leakage[2] < 0.5 * rings[0.2].leakage[2]


def test_one_cell_closes_and_opens_again_less():
    states, k = names("one_cell")["cycle"]()
    assert k[5] == 0  # closed at the top
    up, down = k[:5][::-1], k[6:]
    assert (down <= up).all()
    assert 0 < down[-1] < 0.1 * up[-1]
    # at light load contact is p / H where all of it is plastic, and somewhat more as part is elastic
    ratio = states[0].pressure / 2.8e9
    assert ratio < states[0].contact.area_fraction < 1.2 * ratio
    assert (k <= analytic.parallel_plates([s.contact.mean_gap for s in states])).all()


def test_a_scratch_closes_if_it_is_shallow_and_is_a_channel_if_it_is_deep():
    script = names("scratch")
    seat, pressure, length = script["lapped_seat"](), 8e8, script["SEAT"][0]
    assert script["conductance"](seat, pressure) == 0
    closed = pressure * 200e-6 / (1.85 * script["MODULUS"])
    wide = script["scratched"](seat, 200e-6, 0.5 * closed)
    assert script["conductance"](wide, pressure) == 0
    # ∫ h³ dx/12 of a cosine is 5/16 of that of its depth; elastic deformation closes a part of it
    depth, width = 4e-6, 25e-6
    channel = 5 / 16 * depth**3 * width / (12 * length)
    deep = script["conductance"](script["scratched"](seat, width, depth), 2e8)
    without = script["conductance"](seat, 2e8)
    assert 0.8 * channel < deep - without < channel
    needed = [
        script["leaking_depth"](row, seat_leakage)
        for seat_leakage, found in [script["leakages"](pressure)]
        for row in found
    ]
    assert (np.diff(needed) > 0).all()  # a wider one may be deeper


def test_a_smooth_scratch_closes_at_the_depth_of_its_closed_form():
    """Without roughness, contact covers the whole face from 1.85 E* d/w on; far periods add (w/L)²."""
    script = names("scratch")
    flat = fs.Topography(np.zeros((4, 2048)), (1e-6, 1e-6), (True, True))
    face = script["scratched"](flat, 128e-6, 0.5e-6)
    body = fs.HalfSpace(face.shape, face.spacing, script["MODULUS"])
    closing = 1.85 * script["MODULUS"] * 0.5e-6 / 128e-6
    for ratio, is_closed in ((0.97, False), (1.03, True)):
        contact = fs.solve_contact(face.gap(), body, pressure=ratio * closing, rtol=1e-8)
        assert (contact.area_fraction == 1) == is_closed


def test_measured_face_leaks_what_parallel_plates_bound():
    script = names("measured_face")
    surface = script["prepared"]()
    contact, leakage = script["leakage"](surface, 2e8)
    assert_allclose(contact.mean_pressure, 2e8, rtol=1e-4)
    assert 2e8 / 3.36e9 < contact.area_fraction < 1.2 * 2e8 / 3.36e9
    plates = analytic.parallel_plates(contact.mean_gap) * 10e6 / 0.02 / surface.size[0]
    assert 0 < leakage.per_length < plates


def test_real_size_seal_is_as_long_as_asked_and_scatters_little(drawn_seal):
    assert_allclose(drawn_seal.seal.size[1], 0.1, rtol=1e-3)
    median = drawn_seal.quantile(0.5)
    up, down = median[:3], median[3:]
    assert (np.diff(up) < 0).all()
    assert (down < up[1::-1]).all()
    # 2222 columns of tiles in parallel: relative scatter of the sum goes with the root of their number
    assert (drawn_seal.realisation_spread < 0.05).all()


def test_read_results_knows_what_the_peak_leaves(drawn, drawn_seal, tmp_path):
    results = assemble(drawn["scene"](), drawn_seal)
    save(results, tmp_path)
    ratios = names("read_results")["loading_over_unloading"](fs.open_results(tmp_path))
    median = drawn_seal.quantile(0.5)
    assert ratios == {150e6: median[1] / median[3], 50e6: median[0] / median[4]}
    assert min(ratios.values()) > 1


def test_design_answer_knows_what_may_be_lost_in_service(drawn, drawn_seal):
    """From the median at the peak and at the last stop: halfway between them in log–log."""
    results = assemble(drawn["scene"](), drawn_seal)
    median = drawn_seal.quantile(0.5)
    limit = float(np.sqrt(median[3] * median[4])) * 1e9  # mg/(m·s) of water
    answer = fs.design(results, classes=[f"{limit!r} mg/(m·s)"], probability=0.5)
    lost = names("design_answer")["margin"](answer)
    assert lost.keys() == {400e6}
    assert_allclose(lost[400e6], 1 - np.sqrt(150e6 * 50e6) / 400e6, rtol=0.02)


@pytest.mark.slow
def test_a_ring_needs_less_force_with_silver_than_without():
    script = names("coating_thickness")
    face = {"points": [96, 144], "size": ["600 um", "900 um"]}
    silver, bare = (script["needed_force"](script["ring"](t, face)) for t in (20.0, None))
    assert silver.lower <= silver.computed <= silver.upper
    # The hardness of the silver is 0.44 times that of the flange, which yields without the silver. The upper ends are
    # compared, because a seal of so few points closes as computed before its lowest load.
    assert 0 < silver.upper < 0.7 * bare.upper < np.inf


@pytest.mark.slow
def test_sobol_indices_of_the_viscosity_are_those_of_its_law(capsys):
    """Leakage goes with one over the viscosity: a variance of ln(leakage) of ln(2)² / 12, whatever the rest does."""
    script = runpy.run_path(str(EXAMPLES / "sobol.py"), run_name="__main__")
    first, total = script["first_order"], script["total_order"]
    assert f"in total {total[2]:.2f}" in capsys.readouterr().out
    low, high = np.log([*script["RANGES"].values()]).T
    values = np.exp(low + (high - low) * qmc.Sobol(3, rng=2).random(64))
    variance = script["log_leakage"](values.T).var()
    assert_allclose(total[2], np.log(2) ** 2 / 12 / variance, rtol=0.03)
    assert total[1] > total[2] > total[0] > 0
    assert_allclose(first, total, atol=0.1)


@pytest.mark.parametrize("stem", ["measured_face", "read_results", "design_answer"])
def test_scripts_that_write_run_as_programs(stem, drawn, drawn_seal, tmp_path, monkeypatch, capsys):
    """Those that open no window are run whole."""
    monkeypatch.chdir(tmp_path)
    save(assemble(drawn["scene"](), drawn_seal), tmp_path)
    monkeypatch.setattr(sys, "argv", [stem, str(tmp_path)])
    runpy.run_path(str(EXAMPLES / f"{stem}.py"), run_name="__main__")
    assert capsys.readouterr().out
    assert (tmp_path / WRITES[stem]).exists()


@pytest.mark.parametrize(
    "stem", ["elastic_check", "one_cell", "scratch", "lens_ring", "real_size_seal"]
)
def test_scripts_that_plot_run_as_programs(stem, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    backend = matplotlib.get_backend()
    matplotlib.use("Agg")
    try:
        runpy.run_path(str(EXAMPLES / f"{stem}.py"), run_name="__main__")
    finally:
        matplotlib.use(backend)
    assert capsys.readouterr().out


class TestTutorial:
    notebook = json.loads((EXAMPLES / "tutorial.ipynb").read_text(encoding="utf-8"))
    code = tuple(c for c in notebook["cells"] if c["cell_type"] == "code")

    def test_outputs_are_stripped(self):
        assert all(c["outputs"] == [] and c["execution_count"] is None for c in self.code)

    def test_cells_run_in_order(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        space = {}
        for cell in self.code:
            exec(compile("".join(cell["source"]), f"tutorial.ipynb {cell['id']}", "exec"), space)
        k = list(space["permeability"].values())
        assert k[0] > k[1] > k[2] < k[3] < k[4] < k[0]
        assert space["k"].value < space["contact"].mean_gap ** 3 / 12
        # the drawn seal and the face it is drawn from agree where no constriction decides
        results = space["results"].dataset
        assert_allclose(results["leakage_median"][0], results["leakage_two_scale"][0], rtol=0.2)
        assert (tmp_path / "report.html").stat().st_size > 100_000
