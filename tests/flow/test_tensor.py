"""Permeability tensors of periodic cells: closed forms, symmetry, exact zeros, and contrasts."""

import numpy as np
import pytest
from gaps_of_cells import cut_by_plane, gap_between_pixels
from numpy.testing import assert_allclose

from femseal.base import NotConverged
from femseal.flow import cell_permeability, permeability_tensor

D = 1e-6


def test_tensor_of_flat_gap_and_stripes():
    flat = permeability_tensor(np.full((5, 7), D), (D, 3 * D))
    assert_allclose(flat, np.eye(2) * D**3 / 12, rtol=1e-12, atol=1e-12 * D**3)
    h = np.repeat([1e-6, 2e-6, 5e-7], 8)
    along = permeability_tensor(np.broadcast_to(h, (6, h.size)), (D, 2 * D))
    middle = gap_between_pixels(np.roll(h, 1), h, np.roll(h, -1), np.roll(h, -2))
    expected = np.diag([np.mean(h**3 / 12), 1 / np.mean(12 / middle**3)])
    assert_allclose(along, expected, rtol=1e-12, atol=1e-12 * D**3)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.35])
def test_tensor_is_symmetric_and_turns_with_the_cell(share):
    h = cut_by_plane((24, 30), share, seed=6) / D
    k = permeability_tensor(h, (1, 2))
    assert np.linalg.eigvalsh(k).min() > 0
    turned = np.array([[k[1, 1], -k[1, 0]], [-k[0, 1], k[0, 0]]])
    for gap, spacing, expected in (
        (h, (1, 2), k.T),
        (np.rot90(h), (2, 1), turned),
        (h.T, (2, 1), k[::-1, ::-1]),
        (np.roll(h, (5, 8), (0, 1)), (1, 2), k),
        (np.tile(h, (2, 3)), (1, 2), k),
        (3 * h, (5, 10), 27 * k),
    ):
        found = permeability_tensor(gap, spacing)
        assert_allclose(found, expected, rtol=0, atol=1e-9 * np.trace(k))


def test_tensor_of_an_even_cell_is_the_mirrored_permeability():
    h = cut_by_plane((14, 12), 0.15, seed=8, cut=5)
    even = np.block([[h, h[:, ::-1]], [h[::-1], h[::-1, ::-1]]])
    k = permeability_tensor(even, (D, 2 * D))
    expected = [cell_permeability(h, (D, 2 * D), axis=a).value for a in (0, 1)]
    assert_allclose(k, np.diag(expected), rtol=1e-9, atol=1e-10 * np.trace(k))


def test_tensor_closed_in_one_direction():
    h = np.zeros((8, 9))
    h[:, 1], h[:, 5:7] = D, 2 * D
    exact = (1 + 2 * 8) * D**3 / 12 / 9
    along, across = (permeability_tensor(gap, (D, D)) for gap in (h, h.T))
    assert_allclose([along[0, 0], across[1, 1]], exact, rtol=1e-12)
    assert not along.ravel()[1:].any()
    assert not across.ravel()[:-1].any()


def test_tensor_of_nothing_that_winds_is_exactly_zero():
    """A path that leaves over one edge and returns over the opposite one winds; a U-turn does not."""
    h = np.zeros((2, 9, 9))
    h[0, 2:7, 2:7] = 1
    h[1, [0, 1, 2, 7, 8], 2] = h[1, 2, 2:5] = h[1, [0, 1, 2, 7, 8], 4] = 1
    assert not any(permeability_tensor(gap, (D, D)).any() for gap in (*h, 0 * h[0]))


@pytest.mark.parametrize("flip", [1, -1])
def test_tensor_of_one_slanted_channel(flip):
    """A staircase winding once around both axes carries flow along the diagonal only: a matrix of rank 1."""
    n = 12
    h = np.eye(n) + np.roll(np.eye(n), 1, axis=1)
    k = permeability_tensor(h[:, ::flip], (1, 1))
    # n + n links in series over the diagonal
    assert_allclose(k, k[0, 0] * np.array([[1, flip], [flip, 1]]), rtol=1e-9)
    assert_allclose(k[0, 0], 1 / (2 * n) / 12, rtol=0.7)


@pytest.mark.parametrize("decades", [2, 3, 4, 5, 6])
def test_a_tensor_is_right_or_refused_at_any_contrast(decades):
    """One column of random gaps: its links in series."""
    refused = 0
    for seed in range(10):
        h = np.zeros((40, 5))
        h[:, 2] = D * 10.0 ** np.random.default_rng([5, seed]).uniform(-decades, 0, 40)
        wrapped = np.pad(h[:, 2], 2, mode="wrap")
        a, b = wrapped[1:-2], wrapped[2:-1]
        middle = gap_between_pixels(wrapped[:-3], a, b, wrapped[3:])[1:]
        exact = 1 / np.mean(12 / middle**3) / 5
        try:
            found = permeability_tensor(h, (D, D))[0, 0]
        except NotConverged:
            refused += 1
        else:
            assert found == pytest.approx(exact, rel=1e-6)
    assert refused == 0 or decades > 2


@pytest.mark.parametrize("seed", [27, 28, 52])
def test_a_tensor_of_gaps_that_differ_by_thousands_is_that_of_two_such_cells(seed):
    """What the first solution loses in wide links is solved for once more."""
    gap = 10.0 ** np.random.default_rng(seed).uniform(-3.5, 0, (1, 8)) * 1e-6
    one, two = (permeability_tensor(np.tile(gap, (1, n)), (1e-6, 0.2e-6)) for n in (1, 2))
    assert_allclose(two.diagonal(), one.diagonal(), rtol=1e-8)
