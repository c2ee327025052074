"""Errors of the model and its input, as changes of the leakage with a changed model."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.budget import (
    MODEL_PARTS,
    CoarserSolution,
    ErrorBudget,
    ErrorPart,
    FormTolerance,
    effective_pressure_part,
    model_changes,
    model_part,
    opposite_matters,
    thin_gap_part,
)
from femseal.seal import Frame
from femseal.topography import CrownedSeat

D, E, H = 1e-6, 115e9, 2.3e9

CASE = """
method = "deterministic"
seed = 3
[face]
kind = "self-affine"
points = [128, 128]
size = ["64 um", "64 um"]
hurst = 0.75
rms_slope = 0.2
roll_off = "32 um"
cut_off = "12 um"
[material]
young = "210 GPa"
hardness = "2.3 GPa"
{hardness}
[load]
loading = ["60 MPa", "120 MPa", "240 MPa", "360 MPa", "480 MPa", "600 MPa"]
[contact]
fluid_pressure = "{fluid}"
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "20 MPa"
[output]
pictures = false
{output}
"""


def rough(n, seed):
    waves = {"rms_slope": 0.2, "roll_off": 24 * D, "cut_off": 8 * D, "rng": seed}
    return fs.self_affine((n, n), (n * D, n * D), hurst=0.75, **waves)


@pytest.fixture
def scene():
    return fs.Scene(rough(48, 2), E, H, fs.Liquid(1e-3), 20e6, 0.0, loading=(50e6, 100e6, 200e6))


def test_changes_are_those_that_the_scene_can_have(scene):
    ignored = replace(scene, fluid_pressure="ignored")
    weak = replace(ignored, inlet_pressure=1.0)
    for one, names, expected in (
        (scene, None, ["hardness"]),
        (ignored, None, ["hardness", "fluid pressure"]),
        (weak, ["fluid pressure"], []),
        (replace(scene, hardness=np.inf), None, []),
    ):
        found = model_changes(one) if names is None else model_changes(one, names)
        assert [change.name for change in found] == expected
    assert model_changes(scene, hardness=0.0) == []
    (harder,) = model_changes(scene, hardness=0.2)
    assert_allclose(harder.scene.law.mean_hardness, 1.2 * H)


def test_a_part_is_the_change_of_ln_leakage(scene):
    q = fs.deterministic(scene).leakage
    (harder,) = model_changes(scene)
    moved = fs.deterministic(harder.scene).leakage
    part = model_part(harder, scene.steps, q, CoarserSolution((48, 48), moved, q))
    assert_allclose(np.log(part.upper / q), np.abs(np.log(moved / q)))
    assert_allclose(np.log(q / part.lower), np.abs(np.log(moved / q)))
    acting = replace(scene, fluid_pressure="ignored")
    (change,) = model_changes(acting, ["fluid pressure"])
    dry = fs.deterministic(acting).leakage
    part = model_part(change, scene.steps, dry, CoarserSolution((48, 48), q, dry))
    assert_allclose(part.upper, q)  # the truth is on that side alone
    assert_allclose(part.lower, dry)


def test_both_sides_of_the_hardness_are_those_that_are_solved(scene):
    """Less hardness changes leakage by more than more of it does."""
    q = fs.deterministic(scene).leakage
    (harder,) = model_changes(scene, hardness=0.3)
    assert_allclose(harder.opposite.scene.law.mean_hardness, 0.7 * H)
    more, less = (fs.deterministic(one.scene).leakage for one in (harder, harder.opposite))
    solutions = (CoarserSolution((48, 48), found, q) for found in (more, less))
    part = model_part(harder, scene.steps, q, *solutions)
    assert (less < q).all()
    assert_allclose(part.lower, less)
    assert_allclose(part.upper, more)
    assert (np.log(q / part.lower) > 1.1 * np.log(part.upper / q)).any()


def test_sides_of_a_change_that_seals_opens_or_goes_one_way(scene):
    q = np.array([4.0, 2.0, 0.0])
    (harder,) = model_changes(scene)
    more = CoarserSolution((48, 48), np.array([5.0, 2.2, 1e-3]), q)
    less = CoarserSolution((48, 48), np.array([4.4, 0.0, 0.0]), q)
    part = model_part(harder, scene.steps, q, more, less)
    assert_allclose(part.upper[:2], [5.0, 2.2])
    assert part.upper[2] >= 1e-3
    assert_allclose(part.lower, [4.0 / 1.1, 0.0, 0.0])


def test_the_opposite_is_solved_where_the_mirror_image_matters(scene):
    q = np.array([4.0, 2.0, 1.0])
    for width, expected in ((0.1, False), (0.3, True)):
        others = ErrorBudget(
            "deterministic", q, (ErrorPart.from_distances("patch", q, [1.0] * 3, [1.0] * 3, ""),)
        )
        part = ErrorPart.from_distances("hardness", q, [0.0, 0.0, width], [0.0, 0.0, width], "")
        assert opposite_matters(part, others) == expected


def test_a_gap_that_is_not_thin_leaks_less_where_slopes_are_steep(scene):
    q = np.array([2.0, 1.0, 0.0])
    part = thin_gap_part(scene, q)
    assert_allclose(part.lower, q / (1 + 0.2**2), rtol=1e-9)
    assert_allclose(part.upper, q)
    # 0.14 changes leakage by less than 2 %, which is not worth a row
    flatter = fs.Topography(0.7 * scene.surface.heights, scene.surface.spacing)
    assert thin_gap_part(replace(scene, surface=flatter), q) is None


def test_numbers_alone_stay_beside_the_whole():
    q, names = np.array([1.0]), ("pixels", "hardness", "form")
    parts = tuple(
        replace(ErrorPart.from_distances(name, q, [0.1], [0.1], ""), of_model=name in MODEL_PARTS)
        for name in names
    )
    budget = ErrorBudget("deterministic", q, parts)
    assert_allclose(budget.half_width(0), np.sqrt(0.03))
    assert_allclose(budget.numerical.half_width(0), 0.1)


@pytest.mark.parametrize(
    ("fluid", "hardness", "output", "expected"),
    [
        ("acts", "", "", {"hardness", "plastic law", "thin gap"}),
        ("ignored", "", "", {"hardness", "plastic law", "fluid pressure", "thin gap"}),
        ("ignored", "hardness_tolerance = 0", "", {"plastic law", "fluid pressure", "thin gap"}),
        ("ignored", "", 'model_parts = ["hardness"]', {"hardness"}),
        ("ignored", "", "model_parts = []", set()),
    ],
)
def test_a_case_switches_them_one_by_one(fluid, hardness, output, expected, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(CASE.format(fluid=fluid, hardness=hardness, output=output))
    results = fs.run(path, tmp_path / "out", workers=1)
    names = {part.name for part in results.budget.parts}
    assert names & {*MODEL_PARTS} == expected
    assert ("leakage_deterministic_budget_numerical_upper" in results.dataset) == bool(expected)
    if "fluid pressure" in expected:
        wet = tmp_path / "wet.toml"
        wet.write_text(CASE.format(fluid="acts", hardness="", output="budget = false"))
        change = np.log(fs.run(wet, workers=1).leakage.values / results.leakage.values)
        assert_allclose(results.budget.widths()["fluid pressure"], change, rtol=0.35)


def test_the_hardness_tolerance_is_that_of_the_softer_solid(tmp_path):
    text = CASE.format(fluid="acts", hardness="hardness_tolerance = 0.3", output="")
    soft = '\n[counter_material]\nyoung = "70 GPa"\nhardness = "1 GPa"\nhardness_tolerance = 0.05\n'
    path = tmp_path / "case.toml"
    path.write_text(text + soft)
    assert fs.load_case(path).hardness_tolerance == 0.05


def test_a_form_with_a_tolerance_is_a_part(scene):
    """On the heights, and as rows of a broader seat; a deeper crown is one of a smaller radius."""
    seat, deeper = CrownedSeat(2e-3), CrownedSeat(2e-3 / 1.25)
    formed = replace(scene, surface=seat.add_to(scene.surface), boundary=("free", "periodic"))
    (change,) = model_changes(formed, ["form"], form=FormTolerance(seat=seat, tolerance=0.25))
    heights = deeper.add_to(scene.surface).heights
    assert_allclose(change.scene.surface.heights, heights, atol=1e-18)
    shallower = CrownedSeat(2e-3 / 0.75).add_to(scene.surface).heights
    assert_allclose(change.opposite.scene.surface.heights, shallower, atol=1e-18)
    (change,) = model_changes(scene, ["form"], form=FormTolerance((seat,), (0.25,)))
    assert change.scene is scene
    points, frame = np.stack([np.linspace(0, 2e-4, 5)] * 2, axis=1), Frame.for_strip((2e-4, 1e-3))
    assert_allclose(change.forms[0].heights(points, frame), deeper.heights(points, frame))
    shallower = CrownedSeat(2e-3 / 0.75).heights(points, frame)
    assert_allclose(change.opposite.forms[0].heights(points, frame), shallower)
    assert model_changes(scene, ["form"], form=FormTolerance(seat=seat)) == []


def test_cells_under_their_effective_pressure_have_a_part():
    """It holds the coupled leakage of a face as narrow as four long waves, and is of drawn cells alone."""
    scene = fs.Scene(rough(96, 4), E, H, fs.Liquid(1e-3), 60e6, 0.0, loading=(100e6, 150e6, 200e6))
    scenes = scene, replace(scene, fluid_pressure="ignored")
    sampling = fs.Sampling(length=960 * D, realisations=12, seed=1, breadth=192 * D)
    drawn, dry = (fs.stochastic(one, (4, 4), sampling) for one in scenes)
    whole, ignored = (fs.deterministic(one).leakage for one in scenes)
    part = effective_pressure_part(scene, drawn)
    # what cells would leak with the effect of the whole face
    coupled = dry.quantile(0.5) * whole / ignored
    assert (part.lower < coupled).all()
    assert (coupled < part.upper).all()
    assert (part.lower < drawn.quantile(0.5)).all()
    place = fs.stochastic(scene, (4, 4), replace(sampling, breadth=None))
    for one, study in ((scenes[1], drawn), (scene, place), (scene, fs.deterministic(scene))):
        assert effective_pressure_part(one, study) is None
