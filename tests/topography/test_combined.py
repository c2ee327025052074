"""Two faces laid on one another: their positions, the part that both cover, and their sum."""

from itertools import combinations
from math import inf, nan, pi

import numpy as np
import pytest
from measured_maps import most_memory, open_map, rough_map
from numpy.testing import assert_allclose, assert_array_equal

from femseal.base import InputError
from femseal.topography import (
    Topography,
    combine,
)


def bump(u1, u2):
    """A smooth function without symmetry."""
    long = np.cos(2 * pi * u1 / 30e-6 + 0.4) + 0.5 * np.sin(2 * pi * u2 / 40e-6)
    return 1e-7 * (long + np.cos((u1 + 2 * u2) / 8e-6))


def from_the_middle(shape, spacing):
    return np.meshgrid(
        *((np.arange(n) - (n - 1) / 2) * d for n, d in zip(shape, spacing, strict=True)),
        indexing="ij",
    )


def moved_back(patches, angle, shift):
    """Places on a second face that was turned, then shifted."""
    d1, d2 = (p - s for p, s in zip(patches, shift, strict=True))
    return np.cos(angle) * d1 + np.sin(angle) * d2, np.cos(angle) * d2 - np.sin(angle) * d1


@pytest.mark.parametrize("mirror", [None, "x1", "x2"])
@pytest.mark.parametrize("degrees", [0, 90, 180, 30, -12.5])
@pytest.mark.parametrize("spacing", [(1e-6, 1e-6), (0.8e-6, 1.3e-6)])
def test_the_second_face_is_mirrored_then_turned_then_shifted(mirror, degrees, spacing):
    first = open_map(np.zeros((40, 50)), (1.1e-6, 0.9e-6))
    second = open_map(bump(*from_the_middle((100, 80), spacing)), spacing)
    shift, angle = (7e-6, -4e-6), np.deg2rad(degrees)
    both, overlap = combine(first, second, mirror=mirror, rotate=angle, shift=shift)
    u1, u2 = moved_back(from_the_middle(first.shape, first.spacing), angle, shift)
    expected = bump(-u1 if mirror == "x1" else u1, -u2 if mirror == "x2" else u2)
    assert both.shape == overlap.shape == first.shape
    assert (overlap.resampled, overlap.fraction) == (True, 1.0)
    assert_allclose(both.heights[3:-3, 3:-3], expected[3:-3, 3:-3], atol=3e-9)
    assert_allclose(both.heights, expected, atol=5e-8)


@pytest.mark.parametrize("degrees", [0, 10, 33, 45, 60, 80])
def test_the_largest_rectangle_that_both_faces_cover_is_kept(degrees):
    first = open_map(np.zeros((14, 17)))
    second, angle, shift = open_map(np.zeros((12, 9))), np.deg2rad(degrees), (0.4e-6, 0.7e-6)
    u1, u2 = moved_back(from_the_middle((14, 17), first.spacing), angle, shift)
    inside = (np.abs(u1) <= 6e-6 + 1e-12) & (np.abs(u2) <= 4.5e-6 + 1e-12)
    areas = [
        (q - p) * (t - r)
        for p, q in combinations(range(15), 2)
        for r, t in combinations(range(18), 2)
        if inside[p:q, r:t].all()
    ]
    both, overlap = combine(first, second, rotate=angle, shift=shift)
    assert both.heights.size == max(areas)
    assert_allclose(overlap.fraction, max(areas) / (14 * 17))


def test_faces_of_many_rows_are_laid_on_one_another_with_little_memory():
    n = 2000
    first, second = (open_map(np.zeros((n, 6))) for _ in range(2))
    # an array of all pairs of rows would take 8n² bytes
    assert most_memory(lambda: combine(first, second, shift=(0.0, 1e-6))) < n**2


def test_coinciding_faces_are_added_point_by_point():
    a, b = rough_map(), rough_map(rng=5)
    both, overlap = combine(a, b)
    assert_array_equal(both.heights, a.heights + b.heights)
    assert (both.periodic, overlap.fraction, overlap.resampled) == ((True, True), 1.0, False)
    turned_over, _ = combine(a, a.flip(1), mirror="x2")
    assert_array_equal(turned_over.heights, 2 * a.heights)
    # the same face on a finer grid of the same size
    fine, overlap = combine(a, rough_map((320, 240), rng=5))
    assert_allclose(fine.heights, both.heights, atol=1e-12)
    assert (fine.periodic, overlap.resampled) == ((True, True), True)
    # a shift by whole pixels
    part, overlap = combine(a, b, shift=(10e-6, -25e-6))
    assert_allclose(part.heights, a.heights[10:, :-25] + b.heights[:-10, 25:], atol=1e-12)
    assert (overlap.shape, part.periodic) == ((150, 95), (False, False))


def test_waves_too_short_for_the_first_grid_are_not_folded():
    x = (np.arange(400) + 0.5) * 0.25e-6
    fine = Topography(np.cos(2 * pi * x / 1.25e-6)[:, None] * np.ones(400), (0.25e-6, 0.25e-6))
    both, _ = combine(Topography(np.zeros((80, 80)), (1e-6, 1e-6)), fine)
    assert np.abs(both.heights).max() < 1e-3


FACE = rough_map()


HOLED = Topography(np.where(np.arange(120) == 7, nan, FACE.heights), FACE.spacing)


@pytest.mark.parametrize(
    ("pair", "given", "said"),
    [
        ((FACE, FACE), {"shift": (200e-6, 0)}, "shift: given 200 µm × 0 m, .* still overlaps"),
        ((FACE, FACE), {"mirror": "x3"}, "mirror: given 'x3'"),
        ((FACE, FACE), {"rotate": inf}, "rotate: given inf"),
        ((FACE, HOLED), {}, r"undefined points, .* use fill_undefined\(\) first"),
        ((HOLED, FACE), {}, r"undefined points, .* use fill_undefined\(\) first"),
        ((HOLED, FACE), {"shift": (5e-6, 0)}, r"undefined points, .* use fill_undefined\(\)"),
        ((FACE, HOLED), {"shift": (5e-6, 0)}, "second face: given undefined points"),
    ],
)
def test_faces_that_do_not_overlap_or_have_undefined_points_are_refused(pair, given, said):
    with pytest.raises(InputError, match=said):
        combine(*pair, **given)
