"""Fixed points of mappings whose solution is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base.fixed_point import fixed_point


def test_fixed_points():
    """x = cos x, whose rate is x + 1; x = 2/x, which lies as far above as below by turns; one that never settles."""
    found = fixed_point(np.cos, lambda y: (float(y[0]) + 1, y, "kept"), np.array([0.5]), rtol=1e-6)
    assert found.solution == "kept"
    assert_allclose(found.coefficient, 0.7390851332151607, rtol=1e-5)
    assert 10 < found.solutions < 40
    assert found.error <= 1e-6
    start = np.array([1.2, np.nan])
    found = fixed_point(lambda x: 2 / x, lambda y: (float(y[0]), y, None), start, rtol=1e-6)
    assert_allclose(found.coefficient, [np.sqrt(2), np.nan], rtol=1e-5)
    flows = iter(range(1, 1000))
    with pytest.raises(
        fs.NotConverged, match=r"40 solutions it still changes by .*Try a smaller difference"
    ):
        fixed_point(lambda x: x, lambda y: (1.0 + next(flows) % 2, y, None), 0.5, rtol=1e-6)
