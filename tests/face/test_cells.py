"""Cells of a face: how it is cut, what each is permeable, and the factor of every state."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal.base import InputError
from femseal.face.cell_flow import FlowSettings, cell_permeabilities
from femseal.face.cells import MOST_FACTOR, CellState, correction_factors
from femseal.face.cut import FEWEST_POINTS, Cut, usual_cells
from femseal.flow import cell_permeability
from femseal.loads import LoadProgramme
from femseal.topography import Patches, Topography, self_affine

D = 1e-6


def face(n1=48, n2=48, rng=1):
    return self_affine((n1, n2), (n1 * D, n2 * D), hurst=0.8, rms_slope=0.2, rng=rng)


def gaps(n1=48, n2=48, rng=1, closed=0.2):
    heights = face(n1, n2, rng).heights
    return np.maximum(heights - np.quantile(heights, closed), 0.0)


def state(gap, cells, pressure=None):
    cut = Cut.of(Topography(gap, (D, D)), cells)
    return CellState.of(
        gap, (gap == 0).astype(float) if pressure is None else pressure, cut, FlowSettings()
    )


@pytest.mark.parametrize(
    ("shape", "cells"),
    [((64, 64), (4, 4)), ((97, 61), (9, 7)), ((16, 33), (1, 4)), ((40, 8), (5, 1))],
)
def test_cells_fill_the_face_once_and_are_alike(shape, cells):
    cut = Cut.of(Topography(np.zeros(shape) + np.eye(*shape), (D, 2 * D)), cells)
    assert cut.shape == cells
    number = np.arange(np.prod(shape)).reshape(shape)
    found = np.concatenate([cell.ravel() for cell in cut.split(number)])
    assert_array_equal(np.sort(found), number.ravel())
    for lines in (cut.rows, cut.columns):
        sizes = [b - a for a, b in pairwise(lines)]
        assert max(sizes) - min(sizes) <= 1
    assert_allclose(np.array(cut.size) * cells, [shape[0] * D, shape[1] * 2 * D])
    weights = np.array([cell.size for cell in cut.split(number)]).reshape(cells)
    assert_allclose(np.average(cut.means(number), weights=weights), number.mean())


def test_patches_are_cut_each_by_itself_and_drawn_by_their_width():
    patches = Patches([face(32, 32), face(32, 64, rng=2)])
    cut = Cut.of(patches, (2, 6))
    assert cut.patch_of_column == (0, 0, 1, 1, 1, 1)
    assert cut.columns == (0, 16, 32, 48, 64, 80, 96)
    # all of a cell, and what it takes from beside, is of its own place
    number = np.broadcast_to(np.repeat([0, 1], [32, 64]), (32, 96))
    for cell, of in zip(cut.split_with_overlaps(number, 0), cut.patch_of_column * 2, strict=True):
        assert (cell.field == of).all()
    assert usual_cells(patches) == (4, 12)
    assert Cut.of(patches, (2, 4)).patch_of_column == (0, 1, 1, 1)  # 1.33 and 2.67
    with pytest.raises(InputError, match="one for each patch"):
        Cut.of(patches, (2, 1))


def test_usual_cells_are_about_square_and_never_too_small():
    for shape in ((64, 64), (64, 256), (256, 64), (97, 61), (16, 16), (9, 200), (7, 64), (200, 9)):
        surface = face(*shape)
        for in_order, most in ((True, 2), (False, 4)):
            cut = Cut.of(surface, usual_cells(surface, in_order))
            assert min(cut.shape) <= most
            if min(shape) >= most * FEWEST_POINTS:
                assert min(cut.shape) == most
                assert 0.7 < cut.size[0] / cut.size[1] < 1.5


@pytest.mark.parametrize("cells", [(7, 4), (4, 7), (0, 1), (2.5, 2), (2, 2, 2), "ab", 4, (-1, 2)])
def test_cells_that_cannot_be_cut_are_faults(cells):
    with pytest.raises(InputError, match="cells"):
        Cut.of(face(), cells)


def test_a_face_of_a_few_rows_is_cut_along_the_other_axis():
    assert Cut.of(face(7, 64), (1, 8)).shape == (1, 8)
    with pytest.raises(InputError, match="8 × 8 points"):
        Cut.of(face(7, 64), (1, 9))


def test_cells_between_parallel_plates_have_the_cubic_law():
    found = state(np.full((48, 48), 2e-6), (3, 2))
    assert_allclose(found.k, (2e-6) ** 3 / 12, rtol=1e-9)
    assert found.k.shape == (1, 2, 3, 2)
    assert_allclose(found.mean_gap, 2e-6)
    assert not found.pressure.any()
    assert_allclose(state(np.full((48, 48), 6e-6), (3, 2)).k / found.k, 27)


def test_channels_are_in_parallel_along_and_in_series_across():
    """Stripes of constant gap along x1: ⟨h³⟩/12 of a cell itself, without its overlap; 12/⟨h⁻³⟩ across."""
    h = 1e-6 * (2 + 0.5 * np.cos(2 * np.pi * np.arange(48) / 48))
    gap = np.tile(h, (48, 1))
    found, cut = state(gap, (2, 3)), Cut.of(Topography(gap, (D, D)), (2, 3))
    along, across = found.k[0]
    for j in range(3):
        own = h[cut.columns[j] : cut.columns[j + 1]]
        assert_allclose(along[:, j], np.mean(own**3) / 12, rtol=1e-9)
        assert_allclose(across[:, j], 1 / np.mean(12 / own**3), rtol=0.02)


@pytest.mark.parametrize("boundary", ["free", "periodic", "mirror"])
def test_a_cell_overlaps_with_its_neighbours_as_the_surface_continues(boundary):
    number = np.arange(32)
    cut = Cut.of(Topography(np.eye(32), (D, D)), (2, 2))
    beyond = {"free": [], "periodic": [30, 31], "mirror": [1, 0]}[boundary]
    expected = np.array([*beyond, *number[:18]])
    for axis in (0, 1):
        field = np.broadcast_to(number[:, None] if axis == 1 else number, (32, 32))
        cell = cut.split_with_overlaps(field, axis, (boundary, boundary))[0]
        across = cell.field[:, 0] if axis == 1 else cell.field[0]
        assert_array_equal(across, expected)
        assert cell.core == (len(beyond), len(beyond) + 16)


@pytest.mark.parametrize("solver", ["elimination", "multigrid"])
def test_only_the_flux_in_a_cell_itself_counts(solver):
    """A channel within the cell, one beside it, and one that leaves the cell over a third of its length."""
    gap = np.zeros((90, 60))
    core = 15, 45
    flows = {}
    for name, column in (("inside", 20), ("beside", 5)):
        channel = gap.copy()
        channel[:, column : column + 4] = 1e-6
        flows[name] = cell_permeabilities(channel, (D, D), 0, FlowSettings(solver), core).k[0]
    assert_allclose(flows["inside"], 4 / 30 * 1e-18 / 12, rtol=1e-6)
    assert flows["beside"] == 0
    bent = gap.copy()
    bent[:32, 20:24] = bent[58:, 20:24] = bent[28:62, 5:9] = 1e-6
    bent[28:32, 5:24] = bent[58:62, 5:24] = 1e-6
    whole = cell_permeability(bent, (D, D), rtol=1e-9).value
    found = cell_permeabilities(bent, (D, D), 0, FlowSettings(solver), core).k[0]
    assert_allclose(found, 2 * whole * 2 / 3, rtol=0.03)


def test_a_mirrored_face_has_mirrored_cells():
    gap = gaps()
    found, k = state(gap, (3, 4)), state(gap[::-1], (3, 4)).k
    assert_allclose(k, found.k[:, :, ::-1], rtol=1e-5, atol=1e-24)
    k = state(gap[:, ::-1], (3, 4)).k
    assert_allclose(k, found.k[:, :, :, ::-1], rtol=1e-5, atol=1e-24)


def test_on_a_turned_face_both_permeabilities_change_place():
    """But at the ends along x1, where a cell has no neighbour."""
    gap = gaps()
    k, turned = state(gap, (3, 3)).k[0], state(gap.T, (3, 3)).k[0]
    assert_allclose(turned[0, 1, 1], k[1, 1, 1], rtol=1e-5)
    assert_allclose(turned[1, 1, 1], k[0, 1, 1], rtol=1e-5)


def test_a_face_shifted_along_the_seal_has_shifted_cells():
    gap = gaps()
    found, shifted = state(gap, (2, 3)), state(np.roll(gap, 16, axis=1), (2, 3))
    assert_allclose(shifted.k, np.roll(found.k, 1, axis=-1), rtol=1e-6)
    assert_allclose(shifted.contact_fraction, np.roll(found.contact_fraction, 1, axis=-1))


def test_closed_cells_are_zero_to_the_last_digit():
    gap = np.full((48, 48), 1e-6)
    gap[20] = 0.0  # a ridge that crosses the second of three rows
    gap[:, 5] = 0.0
    along, across = state(gap, (3, 3)).k[0]
    assert not along[1].any()
    assert (along[[0, 2]] > 0).all()
    assert not across[:, 0].any()
    assert (across[:, 1:] > 0).all()


STEPS = LoadProgramme.of([1.0, 2.0, 3.0, 4.0], unload_from=[2.0, 4.0], unloading=[3.0, 1.0])


def test_the_branches_of_a_programme():
    assert [b.tolist() for b in STEPS.branches] == [[0, 1, 2, 3], [4], [5, 6]]


def test_the_factor_makes_cells_leak_what_the_face_leaks():
    face_q = np.array([8.0, 6.0, 4.0, 2.0, 7.0, 3.0, 5.0])
    own = np.array([7.0, 6.5, 3.0, 1.0, 6.0, 3.5, 4.0])
    assert_allclose(correction_factors(face_q, own, STEPS) * own, face_q)
    assert_allclose(
        correction_factors(-face_q, -own, STEPS) * own, face_q
    )  # leakage from the outlet to the inlet


@pytest.mark.parametrize(
    "blind", [(0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (np.nan, 1.0), (1.0, np.nan)]
)
def test_near_closing_the_factor_is_that_of_the_nearest_state_of_its_branch(blind):
    face_q, own = np.full(7, 2.0), np.ones(7)
    own[[0, 1]] = 1.6, 1.25
    for s in (2, 3, 6):
        face_q[s], own[s] = blind
    assert_allclose(correction_factors(face_q, own, STEPS), [1.25, 1.6, 1.6, 1.6, 2, 2, 2])
    face_q[5], own[5] = blind  # none of this branch is known
    assert_allclose(correction_factors(face_q, own, STEPS)[[5, 6]], 1.0)


def test_the_factor_is_bounded():
    face_q = np.array([1e3, 1.0, 1e-9, 2.0, 1.0, 1.0, 1.0])
    found = correction_factors(face_q, np.ones(7), STEPS)
    assert_allclose(found, [MOST_FACTOR, 1, 1 / MOST_FACTOR, 2, 1, 1, 1])
    assert_allclose(
        correction_factors(face_q, np.ones(7), STEPS, largest=10.0)[[0, 2, 3]], [10, 0.1, 2]
    )


def test_centres_are_the_middles_of_the_cells():
    cut = Cut.of(face(), (4, 3))
    for found, count in zip(cut.centres, (4, 3), strict=True):
        assert_allclose(found, (np.arange(count) + 0.5) * 48 * D / count)
