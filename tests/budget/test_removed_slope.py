"""Bands of leakages of faces that lost their short waves: what is sealed without them may be open with them."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

import femseal as fs
from femseal.budget.leakage_changes import expected_sensitivity
from femseal.budget.missing_waves import LOAD_POWER, under_less_load
from femseal.designs.requirements import Seals
from femseal.loads import LoadProgramme
from femseal.preparation import prepare
from femseal.results import leakage_table

#: A generated face with half of its slope in waves that its grid does not carry, under loads that seal it without them.
SEALED = """
method = "deterministic"
seed = 3
[face]
kind = "self-affine"
points = [128, 128]
size = ["100 um", "100 um"]
hurst = 0.5
rms_slope = 0.05
roll_off = "30 um"
[surface]
points = [32, 32]
[material]
young = "210 GPa"
[load]
loading = [LOADS]
[fluid]
name = "helium"
inlet_pressure = "1 MPa"
[output]
classes = ["TA Luft"]
"""


def solved(tmp_path, loads, text=SEALED, output=None):
    path = tmp_path / "case.toml"
    path.write_text(text.replace("LOADS", ", ".join(f'"{load} MPa"' for load in loads)))
    return fs.run(path, output, workers=1)


def test_a_sealed_face_that_lost_waves_has_no_known_upper_end(tmp_path):
    whole = solved(tmp_path, [3000], SEALED.replace("[surface]\npoints = [32, 32]\n", ""))
    assert whole.leakage.values[0] > 0
    results = solved(tmp_path, [3000], output=tmp_path / "out")
    assert results.leakage.values[0] == 0
    for found in (results, fs.open_results(tmp_path / "out")):
        assert found.budget.upper[0] == np.inf
        assert np.isnan(found.dataset["class_met"].values).all()
        assert np.isnan(found.dataset["class_fraction"].values).all()
    table = leakage_table(results)
    cells = dict(zip(table.heads, table.lines[0], strict=True))
    assert (cells["95 % interval"], cells["class"]) == ("open or sealed", "open")


def test_a_design_counts_an_open_class_as_not_met(tmp_path):
    answer = fs.design(solved(tmp_path, [1500, 3000]), classes=["TA Luft"])
    assert answer.results.leakage.values[1] == 0
    assert answer.requirements[0].assembly.text(answer.load_text) == "at no load up to 3 GPa"
    assert answer.sealing.text(answer.load_text) == "at no load up to 3 GPa"
    (verdict,) = answer.verdicts
    assert not verdict.met_as_computed
    assert "computed as sealed may leak any amount" in verdict.answer
    assert any("counted as leaking" in note for note in answer.notes)


def test_what_is_sealed_by_far_stays_sealed(tmp_path):
    results = solved(tmp_path, [3000, 12000])
    assert results.budget.upper[1] == 0
    assert results.classes[1] != "open"


def test_one_grid_does_not_tell_that_a_face_is_sealed():
    face = fs.self_affine((32, 32), (3e-5, 3e-5), hurst=0.8, rms_slope=0.1, rng=1)
    scene = fs.Scene(
        face, 2e11, np.inf, fs.Liquid(1e-3), 1e6, 0.0, (6e9, 2e10), boundary=("periodic",) * 2
    )
    study = fs.deterministic(scene)
    certain = study.contact_fraction >= 0.6
    sealed = study.leakage == 0
    assert (sealed & certain).any()
    assert (sealed & ~certain).any()
    upper = fs.error_budget(scene, study).upper
    assert_array_equal(upper[sealed & certain], 0)
    assert_array_equal(upper[sealed & ~certain], np.inf)


def test_a_power_of_the_load_is_shifted_exactly():
    steps = LoadProgramme.of([1e6, 3e6, 1e7, 5e7])
    q = steps.pressures**-3.0
    found = under_less_load(steps, q, np.zeros(4), 0.6)
    assert_allclose(found, q * 0.6 ** (-3.0 * LOAD_POWER), rtol=1e-12)
    assert_array_equal(under_less_load(steps, q, np.zeros(4), 1.0), q)


def test_sealed_loads_leak_what_lower_ones_do_unless_the_load_is_far_beyond():
    steps = LoadProgramme.of([1e6, 2e6, 4e6, 8e6, 5e7])
    found = under_less_load(steps, np.array([1e-9, 1e-11, 0.0, 0.0, 0.0]), np.zeros(5), 0.5)
    assert 1e-11 < found[2] < 1e-9
    assert_allclose(found[3:], [1e-11, 0], rtol=1e-12)
    # without an open load only contact tells
    steps = LoadProgramme.of([1e6, 2e6])
    for contact, last in ((0.95, np.inf), (0.999, 0)):
        found = under_less_load(steps, np.zeros(2), np.array([0.3, contact]), 0.4)
        assert_array_equal(found, [np.inf, last])


def test_an_unloaded_seal_leaks_no_less_and_no_more_than_on_loading():
    steps = LoadProgramme.of([1e6, 1e7, 1e8], [1e8], [1e7, 1e6])
    q = np.array([1e-8, 1e-10, 1e-14, 1e-13, 1e-12])
    found = under_less_load(steps, q, np.zeros(5), 0.7)
    assert (found > q).all()
    assert (np.diff(found[:3]) < 0).all()
    assert (np.diff(found[2:]) > 0).all()
    assert (found[3:] <= found[[1, 0]]).all()


def test_a_design_does_not_count_on_what_may_be_open(tmp_path):
    results = solved(tmp_path, [1000, 3000])
    assert results.leakage.values[1] == 0
    seals = Seals.from_results(results)
    assert seals.leakage[0, 1] == np.inf
    limit = 0.5 * results.leakage.values[0]
    assert (
        seals.needed_pressures(limit)[0] == np.inf
    )  # by the leakage alone it would be some pressure between both
    assert (
        Seals.from_leakage(results.steps, results.leakage.values).needed_pressures(limit)[0]
        < np.inf
    )


def test_a_load_by_itself_may_leak_as_much_more_as_its_contact_lets_expect():
    """Under less load: by twice the slope that is expected, whatever fraction of the slope is kept."""
    steps, in_contact = LoadProgramme.of([1e7]), np.array([0.1])
    for kept in (0.9, 0.6):
        found = under_less_load(steps, np.array([1e-9]), in_contact, kept)
        slope = 2 * expected_sensitivity(in_contact)
        assert_allclose(found, 1e-9 * kept ** (-slope * LOAD_POWER))


#: A file on its own pixels, and the same face on four times the points a side.
FILE = """
method = "deterministic"
[face]
path = "face.npy"
spacing = ["1 um", "1 um"]
[surface]
points = [64, 64]
[material]
young = "210 GPa"
hardness = "2.3 GPa"
[load]
loading = ["10 MPa", "40 MPa", "120 MPa"]
[contact]
fluid_pressure = "ignored"
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
[output]
model_parts = []
"""


def width_and_error(tmp_path, cut_off, seed):
    """Half-width of the row "filter" of a turned file, and what its waves below 8 pixels do to ln(leakage)."""
    made = fs.turned(
        (80, 80), (80e-6,) * 2, pitch=9e-6, depth=0.8e-6, roughness=0.15e-6,
        depth_error=0.1, hurst=0.7, roughness_roll_off=10e-6, cut_off=2e-6, rng=seed,
    )  # fmt: skip
    heights = made.low_pass(cut_off).heights[:64, :64]
    np.save(tmp_path / "face.npy", heights)
    (tmp_path / "case.toml").write_text(FILE)
    results = fs.run(tmp_path / "case.toml", workers=1)
    scene = prepare(fs.load_case(tmp_path / "case.toml")).scene
    whole = fs.Topography(heights, (1e-6, 1e-6), (False, False)).detrend(1)
    with_waves, without = (
        fs.deterministic(replace(scene, surface=one.resample((256, 256)))).leakage
        for one in (whole, scene.surface)
    )
    counts = results.leakage.values > 1e-3 * results.leakage.values[0]
    error = np.log(with_waves / without)
    return results.budget.widths()["filter"][counts], error[counts]


def test_a_file_without_short_waves_has_a_narrow_row_and_one_with_them_a_wide_one(tmp_path):
    """Both hold what the waves do: a turned face, whose octave of 8 to 16 µm decides."""
    narrow, little = width_and_error(tmp_path, 8e-6, 3)
    assert narrow.size
    assert (np.abs(little) <= narrow).all()
    assert narrow.max() < np.log(4)
    wide, much = width_and_error(tmp_path, 2e-6, 3)
    assert (np.abs(much) <= wide).all()
    assert wide[0] > 2 * narrow[0]
