"""What the intervals of measured patches contain of the stored scenes, one kind of surface left out after the other."""

import numpy as np
import pytest

from femseal.studies.patch_interval import (
    COVERAGE,
    DIFFICULTY,
    calibration_rows,
    interval_widths,
    state_of_rows,
)
from interval_tables import HALF_DECADES, of_patches, with_kind_left_out

#: Least share of the loads of one kind of surface that intervals contain which were calibrated on the other kinds.
LEAST_OF_A_KIND = 0.88
DRAWN = ("in order", "at random")


@pytest.mark.parametrize("kind", DRAWN)
def test_intervals_contain_the_truth_of_a_kind_of_surface_that_their_calibration_has_not_seen(kind):
    rows = of_patches(calibration_rows(kind), single=True)
    judged = with_kind_left_out(kind, rows)
    surface = judged.column("surface")
    shares = {name: judged.contained[surface == name].mean() for name in np.unique(surface)}
    assert len(shares) >= 8
    assert min(shares.values()) >= LEAST_OF_A_KIND, shares
    assert judged.contained.mean() >= COVERAGE


@pytest.mark.parametrize("kind", DRAWN)
def test_intervals_of_two_patches_are_narrower_and_contain_as_much(kind):
    rows = calibration_rows(kind)
    both = with_kind_left_out(kind, of_patches(rows, single=False), of_two=True)
    assert both.contained.mean() >= COVERAGE
    by_patch = {"first": interval_widths(kind), "both": interval_widths(kind, 2)}
    by_patch["second"] = by_patch["first"]
    below, above = DIFFICULTY[kind].distances(state_of_rows(rows))
    distances = [
        by_patch[row["patch"]].below * below[n] + by_patch[row["patch"]].above * above[n]
        for n, row in enumerate(rows)
    ]
    named = {}
    for row, distance in zip(rows, distances, strict=True):
        named[row["scene"], row["step"], row["patch"]] = distance
    ratios = []
    for scene, step, patch in named:
        if patch == "both" and (scene, step, "first") in named and (scene, step, "second") in named:
            single = named[scene, step, "first"] + named[scene, step, "second"]
            ratios.append(2 * named[scene, step, "both"] / single)
    assert len(ratios) > 300
    assert np.mean(ratios) < 0.93


@pytest.mark.parametrize("kind", DRAWN)
def test_intervals_contain_about_as_much_in_every_half_decade(kind):
    """Loads of one scene are alike, so that the share of a half decade scatters as that of its scenes."""
    judged = with_kind_left_out(kind, of_patches(calibration_rows(kind), single=True))
    for low, high in HALF_DECADES[:4]:
        chosen = (judged.decades >= low) & (judged.decades < high)
        scenes = len(set(judged.column("scene")[chosen]))
        scatter = np.sqrt(COVERAGE * (1 - COVERAGE) / scenes)
        assert judged.contained[chosen].mean() >= COVERAGE - 2 * scatter
