"""Fields continued over gaps by Laplace's equation: against a sparse matrix, closed forms, any cut of the ring."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from femseal.flow.harmonic import harmonic_fill


def with_holes(shape, fraction, wave=2.0, seed=0):
    """A field (n1, n2) between 0 and 5e7 that falls along x1, a fraction of it NaN."""
    rough = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), wave, mode="wrap")
    field = np.linspace(1, 0.2, shape[0])[:, None] + 0.1 * rough / max(np.abs(rough).max(), 1e-300)
    return 5e7 * np.where(rough > np.quantile(rough, 1 - fraction), np.nan, field)


def by_matrix(values):
    n1, n2 = values.shape
    number = np.arange(n1 * n2).reshape(n1, n2)
    ends = [(number[:-1], number[1:]), (number, np.roll(number, -1, axis=1))]
    a, b = (np.concatenate([pair[k].ravel() for pair in ends]) for k in (0, 1))
    ones = np.ones(a.size)
    matrix = coo_array(
        (np.r_[ones, ones, -ones, -ones], (np.r_[a, b, a, b], np.r_[a, b, b, a]))
    ).tocsr()
    flat = values.ravel().copy()
    unknown = np.isnan(flat)
    rows = matrix[np.flatnonzero(unknown)]
    flat[unknown] = spsolve(rows[:, unknown].tocsc(), -rows[:, ~unknown] @ flat[~unknown])
    return flat.reshape(values.shape)


@pytest.mark.parametrize("shape", [(1, 8), (8, 1), (2, 3), (33, 40), (128, 16)])
@pytest.mark.parametrize("fraction", [0.2, 0.35, 0.6, 0.95])
def test_against_a_sparse_matrix(shape, fraction):
    values = with_holes(shape, fraction)
    filled = harmonic_fill(values)
    known = np.isfinite(values)
    assert_array_equal(filled[known], values[known])
    assert_allclose(filled, by_matrix(values), rtol=0, atol=1e-4 * 5e7)


@pytest.mark.parametrize("shape", [(1, 40), (40, 1), (33, 40)])
@pytest.mark.parametrize("fraction", [0.1, 0.28])
def test_few_undefined_values_are_exact(shape, fraction):
    values = with_holes(shape, fraction)
    assert 0 < np.isnan(values).mean() <= 0.3
    assert_allclose(harmonic_fill(values), by_matrix(values), rtol=0, atol=1e-12 * 5e7)


def test_nothing_or_everything_known():
    full = with_holes((6, 5), 0.0)
    assert_array_equal(harmonic_fill(full), full)
    none = np.full((3, 3), np.nan)
    assert np.isnan(harmonic_fill(none)).all()
    none[1, 1] = 7.0
    assert_array_equal(harmonic_fill(none), np.full((3, 3), 7.0))
