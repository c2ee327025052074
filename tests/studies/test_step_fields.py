"""Fields of a face by step, made when they are used."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from femseal.studies.face_study import StepFields

rng = np.random.default_rng(0)
DENSE = np.where(rng.random((4, 24, 16)) < 0.2, rng.random((4, 24, 16)), 0).astype(np.float32)
DENSE[1, :8, 8:] = np.nan  # undefined


PRESSURE = StepFields(DENSE.shape, DENSE.__getitem__)


@pytest.mark.parametrize(
    "key",
    [
        0,
        -1,
        (2, slice(3, 9), 5),
        (0, slice(None), 1),
        (Ellipsis, slice(1), [1, 0]),
        slice(1, None),
        (slice(2), 3),
        np.array([True, False, False, True]),
        (Ellipsis, 3),
        DENSE > 0.5,
        Ellipsis,
        (Ellipsis, slice(8, 16), np.arange(12, 20) % 16),
    ],
    ids=str,
)
def test_pressure_is_indexed_like_an_array(key):
    assert_array_equal(PRESSURE[key], DENSE[key])


def test_pressure_is_used_like_an_array():
    assert (PRESSURE.shape, PRESSURE.dtype, PRESSURE.ndim, len(PRESSURE)) == (
        (4, 24, 16),
        np.float32,
        3,
        4,
    )
    assert_array_equal(list(PRESSURE), list(DENSE))
    for mean in (np.mean(PRESSURE, axis=(1, 2)), PRESSURE.mean(axis=(1, 2))):
        assert_array_equal(mean, DENSE.mean(axis=(1, 2)))
    assert_array_equal(2 * PRESSURE == 0, 2 * DENSE == 0)
    assert np.asarray(PRESSURE, float).dtype == float
    assert_array_equal(pickle.loads(pickle.dumps(PRESSURE)), DENSE)
    with pytest.raises(IndexError):
        PRESSURE[4]
    with pytest.raises(TypeError):
        PRESSURE[0] = 1
