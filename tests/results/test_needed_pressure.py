"""The pressure from which on a leakage is below a limit."""

import numpy as np
from leakage_laws import STEPS, power_law

from femseal.base import to_text
from femseal.results.needed_pressure import LeakageCurve


def pascals(value):
    return to_text(value, "Pa", 3)


def test_a_load_that_failed_is_not_met_and_tells_nothing_of_others():
    """The interval at 900 MPa is no wider than at 400 MPa, whether or not the solution failed at 30 MPa."""
    leakage = power_law([1e12])[0]
    upper = np.where(STEPS.pressures > 5e8, 1.0, 1.3) * leakage
    upper[STEPS.on_loading & (STEPS.pressures > 5e8)] = 1.0
    failed = np.where(STEPS.on_loading & (STEPS.pressures == 3e7), np.nan, leakage)
    limit = leakage[0]
    for known, expected in ((leakage, "from 10.9 MPa on"), (failed, "from 100 MPa on")):
        needed = LeakageCurve.of(STEPS, known, (known, np.where(known > 0, upper, np.nan)))
        assert needed.needed(limit).text(pascals).startswith(expected)
