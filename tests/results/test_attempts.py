"""Sentences on the attempts of a run to reach an accuracy."""

import pytest

from femseal.results.attempts import attempt_sentences


@pytest.mark.parametrize("can_halve", [True, False])
def test_the_reason_of_the_last_attempt_is_not_repeated(can_halve):
    attempts = {
        "wanted": 0.1,
        "reached": False,
        "half_width": 0.2,
        "limit": "pixels",
        "load": "300 MPa",
    }
    attempts |= {"why": "no memory", "half_error": "no memory", "can_halve_error": can_halve}
    assert ("To halve the error: no memory." in attempt_sentences(attempts)) == can_halve
    # older records have only the text
    del attempts["can_halve_error"]
    if not can_halve:
        attempts["half_error"] = "not possible: no memory"
    told = any(text.startswith("To halve the error") for text in attempt_sentences(attempts))
    assert told == can_halve
