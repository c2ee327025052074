"""Several measured patches of one face: contact of each by itself, flow through all of them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom
from small_cases import STRIP, steel_scene

import femseal as fs
from femseal.budget import patches_to_halve
from femseal.budget.error_parts import ErrorPart
from femseal.budget.patch_errors import patches_part
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.preparation.grooves import groove_pitch

PIXEL = 1e-6
HARDNESS = 2.3e9


def patches(count=4, n=48):
    size = (n * PIXEL, 8 * n * PIXEL)
    given = {"hurst": 0.8, "rms_slope": 0.2, "roll_off": 24e-6, "cut_off": 8e-6, "rng": 3}
    long = fs.self_affine((n, 8 * n), size, **given)
    return [
        fs.Topography(long.heights[:, j * n : (j + 1) * n], (PIXEL, PIXEL)) for j in range(count)
    ]


def scene(surface, **given):
    loads = {
        "loading": (0.02 * HARDNESS, 0.1 * HARDNESS),
        "unload_from": (0.1 * HARDNESS,),
        "unloading": (2e7,),
    }
    return steel_scene(
        surface, **({"hardness": HARDNESS, "fluid_pressure": "acts"} | loads | given)
    )


@pytest.mark.parametrize("fluid_pressure", ["ignored", "acts"])
def test_contact_is_solved_in_each_patch_separately(fluid_pressure):
    """Gap and pressure are those of each patch alone; the leakage is that of the flow through all of them."""
    measured = patches(3)
    every = fs.deterministic(scene(measured, fluid_pressure=fluid_pressure))
    for n, place in enumerate(measured):
        alone = fs.deterministic(scene(place, fluid_pressure=fluid_pressure))
        columns = np.s_[:, :, n * 48 : (n + 1) * 48]
        assert_allclose(every.gap[columns], alone.gap, atol=1e-6 * alone.gap.max())
        pressure = np.asarray(every.contact_pressure)[columns]
        assert_allclose(pressure, np.asarray(alone.contact_pressure), rtol=1e-5)
    flow = fs.cell_permeability(every.gap[0].astype(float), (PIXEL, PIXEL), sides="periodic").value
    # per length of seal, of the breadth of the face
    assert_allclose(every.leakage[0], flow * 1e6 / 1e-3 / (48 * PIXEL), rtol=2e-3)


def test_equal_patches_leak_as_much_as_each_of_them():
    """Mirror images of one patch that are mirror images of themselves leak as it does, joined in any order."""
    z = patches(1)[0].heights
    one = fs.Topography(np.concatenate([z, z[:, ::-1]], axis=1), (PIXEL, PIXEL))
    other = fs.Topography(one.heights + 1e-12, one.spacing)
    alone, both = (fs.deterministic(scene(s)).leakage for s in (one, [one, other]))
    assert_allclose(both, alone, rtol=1e-3)


def test_patches_of_different_size_and_pixels_are_made_alike():
    """Cut to the least breadth, resampled to the coarsest pixel; waves are those of each patch."""
    a, b, c = patches(3)
    fine = b.resample((96, 96))
    narrow = c.crop((40, 30), (2, 3))
    measured = fs.Patches([a, fine, narrow])
    assert measured.spacing == (PIXEL, PIXEL)
    assert measured.shape[0] == 40
    assert measured.widths == (48, 48, 30) or all(w % 3 == 0 for w in measured.widths)
    assert_allclose(fs.Patches([a, b]).rms_slope ** 2, np.mean([a.rms_slope**2, b.rms_slope**2]))
    assert_allclose(fs.Patches([a, fine]).heights[:, 48:], b.heights, atol=1e-3 * b.rms_height)
    smooth = fs.Patches([a, b]).low_pass(16e-6)
    assert_allclose(smooth.heights[:, :48], a.low_pass(16e-6).heights, atol=1e-15)
    assert fs.Patches([a, b]).resample((24, 48)).widths == (24, 24)


def numbered():
    """Two unlike patches with a step at their seam."""
    a, b = patches(2)
    return a.with_heights(a.heights + 3e-6), b.crop((48, 40))


OPERATIONS = {
    "flip 0": lambda p: p.flip(0),
    "flip 1": lambda p: p.flip(1),
    "detrend": lambda p: p.detrend(2),
    "low_pass": lambda p: p.low_pass(16e-6),
    "high_pass": lambda p: p.high_pass(24e-6),
    "with_form": lambda p: p.with_form(np.linspace(0, 1e-6, 48)),
    "without_spikes": lambda p: p.without_spikes(3.0),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_on_patches_is_that_on_each_of_them(name):
    """Heights step by 3 µm at the seam, which no operation looks across."""
    change = OPERATIONS[name]
    both = fs.Patches(numbered())
    found = change(both)
    for patch, before in zip(found.patches, both.patches, strict=True):
        assert_allclose(patch.heights, change(before).heights, atol=1e-16, equal_nan=True)
    side_by_side = np.concatenate([p.heights for p in found.patches], axis=1)
    assert_allclose(found.heights, side_by_side, equal_nan=True)
    assert found.widths == both.widths
    assert found.shape == found.heights.shape


def test_properties_of_patches_do_not_see_their_seam():
    both = fs.Patches(numbered())
    weights = both.widths
    for name in ("rms_height", "rms_slope"):
        mean = np.average([getattr(p, name) ** 2 for p in both.patches], weights=weights)
        assert_allclose(getattr(both, name), np.sqrt(mean))
    whole = fs.Topography(both.heights, both.spacing)
    assert whole.rms_height > 3 * both.rms_height
    assert whole.rms_slope > 1.5 * both.rms_slope
    assert "2" in both.facts()["patches"]
    assert both.heights is both.heights
    with pytest.raises(ValueError, match="read-only"):
        both.heights[0, 0] = 0.0


def test_operations_that_are_wrong_for_patches_do_not_exist():
    both = fs.Patches(numbered())
    for name in ("crop", "crop_to", "psd", "radial_psd", "gap", "__add__"):
        assert not hasattr(both, name)
    a, b = both.patches
    for use in (
        lambda: fs.describe_surface(both),
        lambda: fs.combine(both, a),
        lambda: fs.combine(b, both),
    ):
        with pytest.raises(fs.InputError, match="2 patches, expected a single map"):
            use()


def test_each_patch_is_conditioned_separately():
    """Tilt, spikes and waves are those of each patch: the slope is that of the patches, not of a step between them."""
    tilted = [
        p.with_heights(p.heights + slope * np.arange(48)[:, None] * PIXEL)
        for p, slope in zip(patches(2), (0.02, -0.05), strict=True)
    ]
    both, report = fs.condition(fs.Patches(tilted), shortest_wave=10e-6)
    for found, patch in zip(both.patches, tilted, strict=True):
        alone, _ = fs.condition(patch, shortest_wave=10e-6)
        assert_allclose(found.heights, alone.heights, atol=1e-15)
    slopes = [fs.condition(patch, shortest_wave=10e-6)[0].rms_slope for patch in tilted]
    assert_allclose(report.rms_slope, np.sqrt(np.mean(np.square(slopes))))
    with pytest.raises(fs.InputError, match="less than the larger side"):
        fs.condition(fs.Patches(tilted), shortest_wave=60e-6)


def test_the_undefined_fraction_of_patches_of_different_length_is_that_of_all_points():
    long, short = patches(2)
    long = fs.Topography(np.hstack([long.heights] * 3), long.spacing)
    heights = short.heights.copy()
    heights[10, 5:17] = np.nan
    surface = fs.Patches([long, fs.Topography(heights, short.spacing)])
    _, done = fs.condition(surface, spikes=np.inf)
    assert_allclose(done.undefined_fraction, 12 / (4 * heights.size))
    assert_allclose(done.undefined_fraction, surface.undefined_fraction)


def test_the_former_name_of_patches_warns_of_the_new_one():
    with pytest.warns(DeprecationWarning, match="Patches"):
        old = fs.Places(patches(2))
    assert isinstance(old, fs.Patches)
    assert type(old.low_pass(16e-6)) is fs.Patches


def test_grooves_of_patches_are_found_in_each():
    """Grooves of two patches that lie half a pitch apart would cancel in their mean."""
    x1 = (np.arange(64) + 0.5) * PIXEL
    rough = fs.self_affine((64, 128), (64e-6, 128e-6), hurst=0.8, rms_height=5e-8, rng=1)
    maps = [
        fs.Topography(z + 1e-6 * np.cos(2 * np.pi * (x1 / 8e-6 + phase))[:, None], rough.spacing)
        for z, phase in zip(np.split(rough.heights, 2, axis=1), (0, 0.5), strict=True)
    ]
    assert_allclose(groove_pitch(fs.Patches(maps)), 8e-6, rtol=0.02)
    flat = fs.Topography(rough.heights[:, :64] * 20, rough.spacing)
    assert groove_pitch(fs.Patches([maps[0], flat])) is None


def test_the_former_key_of_a_case_warns_of_the_new_one(tmp_path, files):
    names = files["face"]["patches"]
    former = parse_case(files | {"face": {"kind": "file", "places": names}}, tmp_path)
    assert [str(patch.path) for patch in former.face[0].patches] == names
    assert any("face.patches" in text for text in former.named_warnings)
    assert not parse_case(files, tmp_path).named_warnings


def test_maps_of_different_surfaces_are_refused_as_patches():
    a, b = patches(2)
    for given, reason in (
        ([a], "at least two"),
        ([], "at least two"),
        ([a, a.heights], "list of Topography"),
        ([a, b, a], "same map twice, as number 1 and number 3"),
        ([a, b, b.with_heights(1e3 * b.heights)], "heights in the same unit"),
        ([a, fs.Topography(b.heights, (8 * PIXEL, 8 * PIXEL))], "same waves"),
    ):
        for use in (fs.Patches, scene):
            with pytest.raises(fs.InputError, match=reason):
                use(given)


def test_leakage_of_each_patch_alone_and_of_all_others_is_known():
    """Each alone is the place by itself; all but one are the others side by side."""
    measured = patches(3)
    found = fs.deterministic(scene(measured)).patches
    alone = [fs.deterministic(scene(place)).leakage for place in measured]
    assert_allclose(found.alone, alone, rtol=2e-3)
    others = fs.deterministic(scene([measured[0], measured[2]]))
    assert_allclose(found.without[1], others.leakage, rtol=2e-3)
    assert_allclose(
        found.scatter, np.std(alone, axis=0, ddof=1) / np.mean(alone, axis=0), rtol=0.01
    )
    assert others.patches.without is None
    assert not replace(found, selections=0 * found.selections).relative.any()
    unknown = replace(found, selections=np.insert(found.selections, 0, np.nan, axis=1))
    assert_allclose(unknown.relative, found.relative)  # the fluid carries all of the first load
    assert fs.deterministic(scene(measured[0])).patches is None


def test_the_jackknife_of_a_mean_is_its_interval():
    """Of independent places whose leakages add up: Student's, of their variance pooled with the usual one."""
    rng, count = np.random.default_rng(5), 4
    usual = 1.96 * 0.25 / np.sqrt(count)  # distance to an end by the state, for the mean of so many
    for scatter, least in ((0.05, 0.99), (0.25, 0.95)):
        one = 1 + scatter * rng.standard_normal((count, 1000))
        mean, others = one.mean(axis=0), (one.sum(axis=0) - one) / 3
        # every column is a first load: a leakage of its own, with no decades below another
        parts = [
            patches_part(q, others[:, [n]], ErrorPart.from_distances("patch", q, usual, usual, ""))
            for n, q in enumerate(mean[:, None])
        ]
        upper, lower = (np.ravel([getattr(p, end) for p in parts]) for end in ("upper", "lower"))
        if scatter < 0.1:  # elsewhere ln of the mean of the others is no sum
            own = (one.std(axis=0, ddof=1) / mean) ** 2
            pooled = np.sqrt((2 * 0.25**2 + 3 * own) / 5 / count)
            assert_allclose(np.log(upper / mean), 2.571 * pooled, rtol=0.02)
        assert np.sum((lower <= 1) & (upper >= 1)) >= binom.ppf(0.01, 1000, least)
    q = np.array([1.0, 0.0])
    others = np.array([[1.0, 0.0], [0.0, 0.0], [1.5, 2.0]])
    shut = patches_part(q, others, ErrorPart.from_distances("patch", q, usual, usual, ""))
    assert shut.lower[0] == 0 < shut.upper[0] < np.inf
    assert shut.upper[1] > 2
    assert patches_to_halve(3) < patches_to_halve(4) < patches_to_halve(8)


def test_realisations_scatter_like_the_surface_of_their_patches():
    """In their rows seals leak what the face leaks; by place they are in the ratio of the face of the places alone."""
    measured = patches(3)
    found = fs.stochastic(scene(measured), (2, 12), fs.Sampling(2e-3, 12, seed=1))
    assert found.cells.cut.patch_of_column == (0,) * 4 + (1,) * 4 + (2,) * 4
    whole, median = fs.deterministic(scene(measured)), found.quantile(0.5)
    assert_allclose(median, whole.leakage, rtol=0.15)
    scale = median / whole.leakage
    assert_allclose(found.patches.alone, scale * whole.patches.alone, rtol=2e-3)
    assert_allclose(found.patches.without, scale * whole.patches.without, rtol=2e-3)
    assert fs.stochastic(scene(measured[0]), (2, 4), fs.Sampling(2e-3, 4, seed=1)).patches is None


def test_broad_seals_take_cells_from_all_patches():
    """Twice as broad as the face they take cells of every place; by place they are in the ratio of the faces."""
    measured = patches(3)
    dry = {"fluid_pressure": "ignored", "boundary": ("periodic", "periodic")}
    sampling = fs.Sampling(2e-3, 12, seed=1, breadth=96 * PIXEL)
    found = fs.stochastic(scene(measured, **dry), (2, 12), sampling)
    drawn = found.tiles.choose_cells((2, 12), np.random.default_rng(0))
    assert_allclose(np.bincount(drawn % 12 // 4) / drawn.size, 1 / 3, atol=0.1)
    whole, median = fs.deterministic(scene(measured, **dry)), found.quantile(0.5)
    assert_allclose(found.patches.alone / median, whole.patches.alone / whole.leakage, rtol=5e-3)
    assert_allclose(
        found.patches.without / median, whole.patches.without / whole.leakage, rtol=5e-3
    )
    assert_allclose(2 * median, whole.leakage, rtol=0.15)


@pytest.fixture
def files(tmp_path):
    """Files of four patches, and the tables of a case of them."""
    for n, place in enumerate(patches()):
        np.savez(tmp_path / f"place{n}.npz", z=place.heights, spacing=place.spacing)
    return STRIP | {
        "face": {"kind": "file", "patches": [f"place{n}.npz" for n in range(4)]},
        "surface": {"shortest_wave": "8 um"},
        "cells": {"count": [2, 2]},
        "stochastic": {"length": "1 mm", "realisations": 8},
    }


def test_a_case_with_several_patches_is_run(tmp_path, files):
    """Paths, a pattern and tables are one thing; cells are those of each patch, each in the cells of the case."""
    prepared = prepare(parse_case(files, tmp_path))
    surface = prepared.scene.surface
    assert surface.widths == (48,) * 4
    assert prepared.cells == (2, 8)
    for measured in (
        "place?.npz",
        ["place[01].npz", {"path": "place2.npz"}, {"path": "place3.npz", "channel": 0}],
    ):
        face = {"kind": "file", "patches": measured}
        again = prepare(parse_case(files | {"face": face}, tmp_path)).scene.surface
        assert_allclose(again.heights, surface.heights)
    keys = {"crop": ["0 um", "48 um", "0 um", "40 um"]}
    own = [{"path": "place0.npz", **keys}, "place1.npz"]
    cut = prepare(parse_case(files | {"face": {"kind": "file", "patches": own}}, tmp_path))
    assert cut.cells == (2, 4)


def test_points_and_cells_of_a_case_are_those_of_one_patch(tmp_path, files):
    """Also in messages; of patches of unlike length, of the shortest."""

    def prepared(points=None, face=files["face"], cells=(2, 2), wave="8 um"):
        surface = {"shortest_wave": wave} | ({"points": points} if points else {})
        tables = {"face": face, "cells": {"count": list(cells)}, "surface": surface}
        return prepare(parse_case(files | tables, tmp_path))

    fine = prepared([72, 72])
    assert fine.scene.surface.widths == (72,) * 4
    assert fine.cells == (2, 8)
    np.savez(tmp_path / "short.npz", z=patches()[3].heights[:, :24], spacing=(PIXEL, PIXEL))
    unlike = {"kind": "file", "patches": ["place0.npz", "short.npz"]}
    assert prepared([96, 48], unlike, (2, 1)).scene.surface.widths == (96, 48)
    for given, reason in (
        ({"points": [72, 24]}, r"surface\.shortest_wave: .*surface\.points = \[48, 48\]"),
        ({"points": [100_000, 100_000]}, r"given 100000 × 400000 points of 4 patches together"),
        ({"wave": "60 um"}, "less than the larger side, 48 µm"),
        ({"cells": (2, 12)}, r"cells: given 2 × 12 of 48 × 48 points"),
    ):
        with pytest.raises(fs.InputError, match=reason):
            prepared(**given)


def test_results_contain_the_leakage_of_each_patch(tmp_path, files):
    """Resumed and run by two processes they are the same; the band is by the scatter between places."""
    case = parse_case(files | {"seed": 3}, tmp_path)
    results = fs.run(case, tmp_path / "out", workers=1)
    data = results.dataset
    assert data["leakage_of_patches"].dims == ("patch", "step")
    assert_allclose(data["patch_scatter"], results.stochastic.patches.scatter)
    parts = {part.name: part for part in results.budget.parts}
    assert "patch" not in parts
    assert "jackknife over 4 measured patches" in parts["patches"].note
    # a place has fewer points than a map has blocks
    most = int(np.argmax(data["leakage_of_patches"].values[:, 0]))
    height = prepare(case).scene.surface.patches[most].heights
    assert_allclose(data["patch_height"], height, rtol=1e-6, atol=1e-12)
    for other in (fs.run(case, tmp_path / "out", resume=True), fs.run(case, workers=2)):
        assert_allclose(other.leakage, results.leakage, rtol=0)
        assert_allclose(other.dataset["leakage_of_patches"], data["leakage_of_patches"], rtol=0)


def test_the_gap_of_the_patch_that_leaks_most_is_stored(tmp_path, files):
    results = fs.run(parse_case(files | {"method": "deterministic"}, tmp_path), workers=1)
    data, gap = results.dataset, results.deterministic.gap
    most = data["patch_height"].attrs["patch"] - 1
    assert data["leakage_of_patches"].values[:, 0].argmax() == most
    assert_allclose(data["patch_gap"], gap[:, :, 48 * most : 48 * (most + 1)], rtol=1e-6)


def test_both_faces_may_have_several_patches(tmp_path, files):
    """Place n of one face lies on place n of the other."""
    first, second = (
        {"kind": "file", "patches": [f"place{n}.npz" for n in of]} for of in ((0, 1, 2), (3, 2))
    )
    case = files | {"face": [first, second], "surface": {"detrend": 0, "shortest_wave": "8 um"}}
    surface = prepare(parse_case(case, tmp_path)).scene.surface
    z = [p.heights - p.heights.mean() for p in patches()]
    sums = np.concatenate([z[0] + z[3], z[1] + z[2], z[2] + z[3]], axis=1)
    assert surface.shape == sums.shape
    assert np.corrcoef(surface.heights.ravel(), sums.ravel())[0, 1] > 0.98


def test_invalid_patches_of_a_case_are_refused(tmp_path, files):
    place = patches()[1]
    np.savez(tmp_path / "copy.npz", z=place.heights, spacing=place.spacing)
    wave = 1e-6 * np.cos(2 * np.pi * np.arange(48) / 48)[:, None] * np.ones(48)
    np.savez(tmp_path / "smooth.npz", z=wave, spacing=place.spacing)
    for face, reason in (
        ({"patches": ["place0.npz"]}, r"face\.patches: given 'place0.npz', which is one file"),
        ({"patches": "none*.npz"}, r"face\.patches: given .*, which is no file"),
        ({"patches": ["place0.npz", "none.npz"]}, r"face\.patches: given 'none.npz'"),
        ({"patches": ["place0.npz", "place0.npz"]}, "the same map twice, as number 1 and number 2"),
        (
            {"patches": ["place0.npz", "place1.npz", "copy.npz"]},
            "same map twice, as number 2 and number 3",
        ),
        ({"patches": ["place0.npz", {"crop": ["0 um", "9 um", "0 um", "9 um"]}]}, "without path"),
        ({"patches": ["place0.npz", "place1.npz"], "path": "place2.npz"}, "besides patches"),
        (
            {"patches": ["place0.npz", {"path": "place1.npz", "height_unit": "mm"}]},
            "same unit|unit",
        ),
        ({"patches": ["place0.npz", "place1.npz", "smooth.npz"]}, "similar waves"),
        ({}, r"face\.path: given nothing"),
        ({"patches": 3}, r"face\.patches"),
    ):
        with pytest.raises(fs.InputError, match=reason):
            prepare(parse_case(files | {"face": {"kind": "file"} | face}, tmp_path))
