"""Effect of the form of a measured patch: its size, its row in the budget, and how often it is computed."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from larger_faces import SIDE, D, N, patch_of_larger_face
from numpy.testing import assert_allclose

import femseal as fs
import femseal.checks.form_effect
import femseal.checks.quick_estimate
from femseal.budget import patch_form_part
from femseal.calibration.calibrating import with_values
from femseal.checks import FormEffect, solve_form_effect
from femseal.contact import PerfectlyPlastic
from femseal.loads import LoadProgramme
from femseal.preparation import prepare
from femseal.runs.run_description import describe

E, H = 115e9, 0.15 * 115e9 * 0.05


def crowned(height, seed=1):
    """A patch with a parabola along x1 that is so much lower at both ends."""
    x1 = (np.arange(N) + 0.5) * D - SIDE / 2
    face = patch_of_larger_face(seed)
    return face.with_heights(face.heights - height * (2 * x1[:, None] / SIDE) ** 2).detrend(1)


@pytest.mark.parametrize("seed", range(3))
def test_a_parabola_has_its_height_and_its_radius(seed):
    height = 2e-6
    effect = solve_form_effect(crowned(height, seed), E, PerfectlyPlastic(H), [0.06 * H])
    assert_allclose(effect.height, height, rtol=0.15)
    assert_allclose(effect.radii[0], SIDE**2 / (8 * height), rtol=0.15)
    assert effect.radii[1] > 5 * effect.radii[0]
    assert f"{1e6 * effect.height:.3g} µm high" in str(effect)


def solved(face, pressures):
    """ln k of the face on all of its points."""
    body = fs.HalfSpace(face.shape, face.spacing, E, ("free", "periodic"))
    gap0, found = face.gap(), []
    for p in pressures:
        gap = fs.solve_contact(gap0, body, pressure=p, hardness=H, rtol=1e-5).gap
        found.append(fs.cell_permeability(gap, face.spacing, sides="periodic").value)
    return np.log(found)


@pytest.mark.parametrize("height", [0.0, 1e-6, 2e-6])
def test_few_points_show_the_effect_of_the_form_on_all_points(height):
    face, loads = crowned(height), [0.02 * H, 0.06 * H, 0.15 * H]
    effect = solve_form_effect(face, E, PerfectlyPlastic(H), loads)
    whole = solved(face, loads)
    true = [whole - solved(short, loads) for short in (face.detrend(2), face.high_pass(SIDE / 2))]
    assert_allclose(effect.changes, true, rtol=0.1, atol=0.15)
    assert (np.abs(true[0]).max() > np.log(1.5)) == (height > 0)
    assert bool(effect.warnings) == (height > 0)


def test_permeabilities_of_patches_add_up_side_by_side():
    patches, loads, law = (crowned(1e-6), patch_of_larger_face(2)), [0.06 * H], PerfectlyPlastic(H)
    joint = solve_form_effect(fs.Patches(patches), E, law, loads)
    first, second = (solve_form_effect(patch, E, law, loads).permeability for patch in patches)
    assert abs(np.log(first[0] / first[1])) > 0.5
    total = first + second
    assert_allclose(joint.changes, np.log(total[0] / total[1:]), atol=0.15)


def test_a_load_that_seals_the_coarse_surface_is_reduced():
    """Waves of a few pixels, which 128 points do not carry, keep this face open."""
    side = 512 * D
    waves = {"rms_height": 3e-9, "roll_off": 64 * D, "cut_off": 40 * D, "rng": 2}
    long = fs.self_affine((512, 512), (side, side), hurst=0.8, **waves)
    short = np.random.default_rng(1).standard_normal((512, 512)) * 2e-9
    face = fs.Topography(short + long.heights, (D, D), (False, False)).detrend(1)
    few = face.resample((128, 128))
    load = 0.12 * E * face.rms_slope
    body = fs.HalfSpace(few.shape, few.spacing, E, ("free", "periodic"))
    sealed = fs.solve_contact(few.gap(), body, pressure=load)
    assert fs.cell_permeability(sealed.gap, few.spacing, sides="periodic").value == 0
    effect = solve_form_effect(face, E, PerfectlyPlastic(np.inf), [load])
    assert (effect.permeability[:2] > 0).all()


EFFECT = FormEffect(
    np.array([1e6, 1e8]),
    np.array([[8.0, 1.0], [2.0, 0.5], [8.0, 1.0]]),
    height=1e-6,
    radii=(1.0, 2.0),
    longest=1e-4,
    loads="",
)


def test_the_error_part_is_linear_in_the_logarithm_of_the_load():
    steps = LoadProgramme.of((1e5, 1e6, 1e7, 1e8), (1e8,), (1e7, 1e6))
    leakage = np.array([8.0, 4.0, 2.0, 1.0, 1.5, 2.0])
    part = patch_form_part(EFFECT, steps, leakage)
    distance = np.log([4, 4, np.sqrt(8), 2, np.sqrt(8), 4])
    assert_allclose(np.log(part.upper / leakage), distance)
    assert_allclose(np.log(leakage / part.lower), distance)


def test_the_error_part_of_an_unloading_is_at_least_that_of_its_peak():
    steps = LoadProgramme.of((1e6, 1e8), (1e8,), (1e6,))
    rising = replace(EFFECT, permeability=EFFECT.permeability[:, ::-1])
    part = patch_form_part(rising, steps, np.ones(3))
    assert_allclose(part.upper, [2, 4, 4])


def test_loads_without_leakage_are_left_out_of_the_error_part():
    sealed = replace(EFFECT, permeability=EFFECT.permeability * [1.0, 0.0])
    assert_allclose(sealed.distance(np.array([1e6, 1e8])), np.log([4, 4]))
    shut = replace(EFFECT, permeability=np.zeros((3, 2)))
    assert shut.distance(np.array([1e6])) is None
    assert patch_form_part(shut, LoadProgramme.of((1e6,)), np.ones(1)) is None
    assert shut.warnings == []


CASE = """
method = "deterministic"

[face]
kind = "file"
path = "patch.npz"
size = ["{side} um", "{side} um"]

[surface]
points = [96, 96]
{surface}

[material]
young = "210 GPa"
hardness = "0.86 GPa"

[load]
loading = ["20 MPa", "40 MPa", "80 MPa", "130 MPa"]

[contact]
fluid_pressure = "ignored"

[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"

[output]
pictures = false
model_parts = ["form of the patch"]
{output}
"""


@pytest.fixture
def case(tmp_path):
    np.savez(tmp_path / "patch.npz", crowned(1e-6).heights)

    def written(surface="", output=""):
        path = tmp_path / "case.toml"
        path.write_text(CASE.format(side=1e6 * SIDE, surface=surface, output=output))
        return fs.load_case(path)

    return written


def test_a_run_has_the_error_part_unless_the_case_says_what_is_form(case):
    results = fs.run(case(), workers=1)
    row = results.budget.widths()["form of the patch"]
    first, second = (fs.run(case(f"detrend = {order}"), workers=1) for order in (1, 2))
    for said in (first, second):
        assert "form of the patch" not in said.budget.widths()
        assert not any("curvature" in warning for warning in said.warnings)
    true = np.abs(np.log(first.leakage.values / second.leakage.values))
    assert_allclose(results.leakage.values, first.leakage.values)
    assert true.max() > np.log(1.5)
    assert_allclose(row, true, atol=0.2)
    assert sum("surface.detrend = 1 keeps the curvature" in text for text in results.warnings) == 1


SEAT = '[seat]\nkind = "tilted"\ntilt = "0.001 deg"\n'
FORM = '[stochastic]\n[seal]\nform = [{kind = "waves", height = "1 um", lobes = 3}]\n'


@pytest.mark.parametrize(
    ("table", "method"), [("", "deterministic"), (SEAT, "deterministic"), (FORM, "stochastic")]
)
def test_a_seat_or_a_form_of_the_seal_says_what_is_form(case, tmp_path, table, method):
    case()
    path = tmp_path / "case.toml"
    text = path.read_text().replace('"deterministic"', f'"{method}"')
    path.write_text(text + table)
    assert (prepare(fs.load_case(path)).solve_form_effect() is None) == bool(table)
    assert prepare(case("detrend = 2")).solve_form_effect() is None


@pytest.fixture
def count_calls(monkeypatch):
    """Count the effects of a form and the quick estimates that are computed."""
    counts = Counter()

    def counted(module, name, kind):
        function = getattr(module, name)

        def call(*args, **keys):
            counts[kind] += 1
            return function(*args, **keys)

        monkeypatch.setattr(module, name, call)

    counted(femseal.checks.form_effect, "fit_form", "form effect")
    counted(femseal.checks.form_effect, "solve_contact", "contact of a form")
    counted(femseal.checks.quick_estimate, "_has_form", "quick estimate")
    return counts


def test_preparing_a_case_solves_nothing(case, count_calls):
    prepare(case())
    assert not count_calls


def test_a_check_computes_form_and_estimate_once(case, count_calls):
    loaded = case()
    describe(loaded, prepare(loaded))
    assert count_calls["form effect"] == 1
    assert count_calls["quick estimate"] == 1


def test_a_run_computes_form_and_estimate_once(case, count_calls):
    fs.run(case(output="budget = false"), workers=1)
    assert count_calls["form effect"] == 1
    assert count_calls["quick estimate"] == 1


def test_a_sweep_computes_the_form_once_for_each_case(case, count_calls, tmp_path):
    case(output="budget = false")
    fs.sweep(tmp_path / "case.toml", {"seed": [1, 2]}, tmp_path / "swept", workers=1)
    assert count_calls["form effect"] == 2


def test_a_scene_of_a_calibration_has_no_effect_of_form(case, count_calls):
    loaded = case(output="budget = false")
    scene = with_values(loaded, 0.9e9, 2e-5)
    assert scene.surface.detrend == loaded.surface.detrend
    fs.run(scene, workers=1)
    assert not count_calls["form effect"]


def test_a_new_case_asks_what_is_form_if_it_matters(femseal, tmp_path):
    import x3pio

    for height, asked in ((1e-6, True), (0.0, False)):
        x3pio.write(tmp_path / "patch.x3p", crowned(height).heights.T, x_scale=D, y_scale=D)
        (tmp_path / "new.toml").unlink(missing_ok=True)
        assert femseal("new", tmp_path / "new.toml", "--from", tmp_path / "patch.x3p")[0] == 0
        text = (tmp_path / "new.toml").read_text(encoding="utf-8")
        assert ("surface.detrend = 1 keeps the curvature" in text) == asked
        words = " ".join(text.replace("#", " ").split())
        # the parabola is the longest wave
        assert ("the longest wave of the surface" in words) == asked
