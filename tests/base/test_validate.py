"""Checks of arguments name the argument and the given value, however odd the value is."""

import numpy as np
import pytest

from femseal.base import InputError, validate

LARGE = 10**400
#: Python refuses to convert an integer of so many digits to text, also in the name of a test.
HUGE = 10**5000


def test_a_value_that_is_no_finite_number_is_refused():
    for value in (LARGE, -LARGE, HUGE, -HUGE, "1", None, True, [1.0, 2.0]):
        with pytest.raises(InputError, match=r"^x: given .*, expected a finite number > 0 \[Pa\]"):
            validate.number("x", value, unit="Pa")


def test_a_length_of_too_many_digits_is_refused():
    for value in (LARGE, HUGE, (1.0, HUGE)):
        with pytest.raises(InputError, match=r"^size: given .*, expected two finite numbers > 0"):
            validate.lengths("size", value)


def test_counts_of_too_many_digits_are_refused():
    with pytest.raises(InputError, match=r"^n: given .*, expected a whole number >= 1"):
        validate.count("n", -HUGE)


@pytest.mark.parametrize("value", [[[LARGE]], [["1 m"]], [[None, [1]]], np.array([[1j]])])
def test_a_field_of_other_values_than_real_numbers_is_refused(value):
    with pytest.raises(InputError, match=r"^gap: given a .*, expected an array \(n1, n2\) of real"):
        validate.field("gap", value, unit="m")
