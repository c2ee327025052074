"""The paper's own method, as the example has it, on a quarter of its face."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.case import parse_case
from femseal.preparation import prepare

example = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "paper_2018.py"))
CELLS = (4, 4)
#: Steps of the example: the highest load, and loading and unloading at the same pressures.
PEAK, LOADED, UNLOADED = 3, [2, 0], [4, 5]


def windows_of(scene):
    states = example["global_contact"](scene, CELLS)
    return [example["windows_of_links"](scene, axis, states, CELLS) for axis in (0, 1)]


def drawn_seals_of(scene, windows, number):
    """Permeability of the links of drawn seals along both axes (seal, step, row, column)."""
    rng = np.random.default_rng(1)
    return [
        np.array([example["drawn_links"](scene, w, rng) for _ in range(number)]) for w in windows
    ]


def leakage(scene, links):
    return example["leakage"](scene, *links)


@pytest.fixture(scope="module")
def strip():
    return example["strip"](points=128)


@pytest.fixture(scope="module")
def windows(strip):
    return windows_of(strip)


@pytest.fixture(scope="module")
def drawn(strip, windows):
    return drawn_seals_of(strip, windows, 200)


@pytest.mark.parametrize("axis", [0, 1])
def test_windows_are_centred_on_their_links(axis):
    """Links along x1 join nodes at the faces of cells; links along x2 lie on these faces, over the seam in x2 too."""
    angle = 2 * np.pi * (np.arange(32) + 0.5) / 32
    rows = example["cut"](np.repeat(np.arange(32.0)[:, None], 32, axis=1), CELLS, axis)
    columns = example["cut"](np.repeat(np.exp(1j * angle)[None, :], 32, axis=0), CELLS, axis)
    middle1 = rows.mean(axis=(2, 3)) + 0.5
    middle2 = np.angle(columns.mean(axis=(2, 3))) % (2 * np.pi) * 32 / (2 * np.pi)
    links1, links2 = (
        (4 + 8 * np.arange(4), 8 * np.arange(1, 4))[axis],
        (4 + 8 * np.arange(4) + 4 * axis) % 32,
    )
    assert_allclose(middle1, np.repeat(links1[:, None], 4, axis=1), atol=1e-9)
    assert_allclose(np.exp(2j * np.pi * (middle2 - links2) / 32), 1, atol=1e-9)


def test_equal_windows_leak_what_the_face_does(strip):
    """Without long waves every window has the nominal pressure, and beside it its mirror image."""
    wave = np.cos(2 * np.pi * (np.arange(128) + 0.5) / 8)
    egg_box = fs.Topography(0.3e-6 * (wave[:, None] + 0.7 * wave), (1e-6, 1e-6))
    scene = replace(strip, surface=egg_box, boundary=("periodic", "periodic"))
    windows = windows_of(scene)
    load = scene.steps.pressures[:, None, None]
    for pressure, _, _ in windows:
        assert_allclose(pressure / load, 1, rtol=1e-4)
    solved = fs.deterministic(scene)
    assert (solved.leakage > 0).all()
    across = np.array([fs.cell_permeability(gap, (1e-6, 1e-6), axis=1).value for gap in solved.gap])
    assert_allclose(windows[1][2] / across[:, None, None], 1, rtol=1e-3)
    drawn = [k[0] for k in drawn_seals_of(scene, windows, 1)]
    for links in ([k for _, _, k in windows], drawn):
        assert_allclose(leakage(scene, links), solved.leakage, rtol=1e-3)


def test_windows_keep_their_plastic_deformation(windows):
    for _, _, k in windows:
        assert (np.diff(k[: PEAK + 1], axis=0) <= 1e-5 * k[:PEAK]).all()
        assert (k[UNLOADED] <= 1.01 * k[LOADED]).all()
        assert (k[UNLOADED].mean(axis=(1, 2)) < 0.75 * k[LOADED].mean(axis=(1, 2))).all()


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_links_leak_what_the_face_does_under_light_load(seed):
    scene = example["strip"](points=128, seed=seed)
    ratio = leakage(scene, [k for _, _, k in windows_of(scene)]) / fs.deterministic(scene).leakage
    assert 0.8 < ratio[0] < 1.25  # measured: 0.84 to 1.05
    assert 0.3 < ratio[1] < 3


@pytest.mark.parametrize("error", [0.0, 0.3])
def test_drawn_links_have_a_history_that_a_window_may_have(strip, windows, error):
    """Also if solvers err, by which a window may leak more under a higher load."""
    noise = np.random.default_rng(2)
    noisy = [w * (1 + error * (2 * noise.random(w.shape) - 1)) for w in windows]
    for k in drawn_seals_of(strip, noisy, 50):
        assert (k >= 0).all()
        assert (np.diff(k[:, : PEAK + 1], axis=1) <= 0).all()  # so that closed links stay closed
        assert (np.diff(k[:, PEAK:], axis=1) >= 0).all()
        assert (k[:, PEAK] == 0).any()


def test_drawn_links_are_distributed_as_windows_are(windows, drawn):
    """Groups hold every window as often as another, so that the steps below the peak have no bias."""
    for (_, _, of_windows), k in zip(windows, drawn, strict=True):
        assert np.isin(k[:, PEAK], of_windows[PEAK]).all()
        closed = (of_windows == 0).mean(axis=(1, 2))
        assert_allclose((k == 0).mean(axis=(0, 2, 3)), closed, atol=0.04)
        assert_allclose(k.mean(axis=(0, 2, 3)), of_windows.mean(axis=(1, 2)), rtol=0.2)


def test_drawn_seals_leak_less_after_the_peak(strip, drawn):
    seals = np.array([leakage(strip, links) for links in zip(*drawn, strict=True)][:16])
    assert (np.diff(seals[:, : PEAK + 1], axis=1) <= 0).all()
    median = np.median(seals, axis=0)
    assert (median[UNLOADED] > 0).all()
    assert (median[UNLOADED] < median[LOADED]).all()


def test_it_is_compared_with_as_many_cells_as_a_case_takes():
    """A case that does not say how many, of a seal as broad as the face, whose cells stay in order."""
    data = {
        "method": "stochastic",
        "face": {"kind": "self-affine", "points": [256, 256], "size": ["256 um", "256 um"]},
        "material": {"young": "210 GPa", "poisson": 0.3, "yield_stress": "1.2 GPa"},
        "load": {"loading": ["50 MPa"]},
        "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "10 MPa"},
        "stochastic": {"length": "256 um"},
    }
    data["face"] |= {"hurst": 0.8, "rms_slope": 0.2, "roll_off": "100 um"}
    assert prepare(parse_case(data)).cells == example["OWN_CELLS"]
