"""Values of results as short texts."""

import numpy as np
import pytest

from femseal.base.display import value_text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (np.zeros((2, 3)), "m", "(2 × 3: 0 m)"),
        (np.array([np.nan]), "m", "(1: undefined)"),
        (np.array([True, False]), "1", "(2: 50 %)"),
        (3e-9, "m^2/s", "3e-09 m²/s"),
        (np.float64(0.25), "1", "0.25"),
        (7, "1", "7"),
        (("it failed", "and again"), "1", "2, the first: it failed"),
    ],
)
def test_texts_of_values(value, unit, text):
    assert value_text(value, unit) == text
