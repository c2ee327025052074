"""The loops of the conjugate gradients against plain versions of the same operations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import correlate

from femseal.contact import HalfSpace
from femseal.contact.gradient_steps import apply_stencil
from femseal.contact.workspace import workspace


@pytest.mark.parametrize("boundary", [("periodic",) * 2, ("mirror", "free"), ("free", "periodic")])
@pytest.mark.parametrize("shape", [(12, 17), (3, 40), (1, 9), (6, 2)])
@pytest.mark.parametrize("fraction", [0.1, 0.7, 1.0])
def test_stencil_at_listed_points_is_that_of_the_whole_grid(boundary, shape, fraction):
    """Points that follow each other in a row are processed together, those at the border one by one."""
    preconditioner = workspace(HalfSpace(shape, (1e-6, 2e-6), 1e11, boundary)).preconditioner
    rng = np.random.default_rng(1)
    values = rng.normal(size=shape).astype(np.float32)
    index = np.flatnonzero(rng.random(shape) < fraction).astype(np.int32)
    out = np.empty(index.size)
    scale = 1 + rng.random(index.size)
    total = apply_stencil(index, values.ravel(), scale, out, preconditioner)
    assert total == pytest.approx(out.sum(), abs=1e-12 * np.abs(out).sum())
    # one axis after the other, because the axes may end in different ways
    padded = np.pad(values.astype(float), 1, mode="constant")
    for axis, kind in enumerate(boundary):
        rows = np.moveaxis(padded, axis, 0)
        if kind == "periodic":
            rows[0], rows[-1] = rows[-2], rows[1]
        elif kind == "mirror":
            rows[0], rows[-1] = rows[1], rows[-2]
    expected = correlate(padded, preconditioner.weights, mode="constant")[1:-1, 1:-1]
    assert_allclose(out / scale, expected.ravel()[index], rtol=0, atol=1e-6 * abs(expected).max())
