"""Changes of the leakage to a second solution, also where it is sealed or unknown."""

import numpy as np
from numpy.testing import assert_allclose

from femseal.budget import CoarserSolution
from femseal.budget.leakage_changes import scale_of_changes
from femseal.loads import LoadProgramme


def test_changes_where_one_or_both_are_sealed():
    q = np.array([8.0, 5.0, 0.0, 0.0, 0.0, 1.0])
    other = np.array([8.0, 0.0, 2.0, 0.0, 0.0, np.nan])
    change = CoarserSolution((8, 8), other).change(q)
    assert change[:5].tolist() == [0.0, -np.inf, np.inf, 0.0, 0.0]
    assert np.isnan(change[5])


def test_an_unknown_change_is_that_of_the_nearest_steps_and_a_shift_of_the_load():
    steps = LoadProgramme.of([1e8, 2e8, 3e8, 4e8])
    change, slope = np.array([0.2, 0.4, np.nan, np.nan]), np.array([1.0, 2.0, 3.0, 4.0])
    nearest, shift = np.sqrt((0.2**2 + 0.4**2) / 2), 0.2
    found = scale_of_changes(steps, change, slope)
    assert_allclose(found, np.hypot(nearest, slope * shift))
