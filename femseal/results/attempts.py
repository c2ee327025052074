"""Describe the attempts of a run to reach the accuracy that its case requests."""

from __future__ import annotations

from math import inf, log1p
from typing import Any

from ..base import TextTable, duration, format_deviation


def attempt_sentences(attempts: dict[str, Any]) -> list[str]:
    """Say whether the requested accuracy is reached, what limits the accuracy, and what halving the error would cost.

    Parameters
    ----------
    attempts : record of the attempts, as in `Results.attempts`.
    """
    wanted = format_deviation(log1p(attempts["wanted"]))
    reached = "reached" if attempts["reached"] else "not reached"
    sentences = [
        f"The accuracy of {wanted} is {reached}: the leakage is known within {half_width_text(attempts)} at all loads "
        "with more than 1/1000 of the leakage at the first load, if only the numerical error sources are counted."
    ]
    model_parts = attempts.get("model_parts")
    if model_parts:
        half_width = attempts["with_model"]
        error = format_deviation(inf if half_width is None else half_width)
        sources = ", ".join(model_parts)
        sentences.append(f"With the model and its input ({sources}) it is known within {error}.")
    has_error = attempts["half_width"] != 0
    if has_error:
        sentences.append(f"It is limited by the {attempts['limit']}, most at {attempts['load']}.")
    if attempts["why"]:
        sentences.append(f"No further attempt: {attempts['why']}.")
    # the reason why there was no further attempt already says why the error cannot be halved
    can_halve = attempts.get("can_halve_error")
    if can_halve is None:  # in a record of an earlier version, only the text says so
        can_halve = not attempts["half_error"].startswith("not possible")
    is_reason_stated = attempts["why"] and not can_halve
    if has_error and not is_reason_stated:
        sentences.append(f"To halve the error: {attempts['half_error']}.")
    return sentences


def attempts_table(attempts: dict[str, Any]) -> TextTable:
    """Return a table with a line for each attempt to reach the requested accuracy, and a note on the outcome.

    Parameters
    ----------
    attempts : record of the attempts, as in `Results.attempts`.
    """
    records = attempts["attempts"]
    settings = [attempt["settings"] for attempt in records]
    columns: list[tuple[str, list[str]]] = [
        ("attempt", [str(number) for number in range(1, len(records) + 1)]),
        ("method", [setting["method"] for setting in settings]),
        ("points", [" × ".join(map(str, attempt["points"])) for attempt in records]),
        ("residual", [f"{setting['rtol']:.0e}" for setting in settings]),
        ("seals", [str(setting["realisations"] or "–") for setting in settings]),
        ("time", [duration(attempt["seconds"]) for attempt in records]),
        ("error", [half_width_text(attempt) for attempt in records]),
        ("limited by", [attempt["limit"] for attempt in records]),
    ]
    notes = (" ".join(attempt_sentences(attempts)),)
    return TextTable.of_columns("", columns, names=len(columns), notes=notes)


def as_chosen(case: dict[str, Any], attempts: dict[str, Any] | None) -> dict[str, Any]:
    """Return a copy of a case with the settings of the last attempt to reach the requested accuracy.

    Parameters
    ----------
    case : case in SI units, as in `Results.case`.
    attempts : record of the attempts, as in `Results.attempts`; None if the case requests no accuracy.
    """
    if attempts is None:
        return case
    chosen = attempts["settings"]
    changes = {"method": chosen["method"], "contact": case["contact"] | {"rtol": chosen["rtol"]}}
    realisations = chosen["realisations"]
    if case.get("stochastic") is not None and realisations is not None:
        changes["stochastic"] = case["stochastic"] | {"realisations": realisations}
    return case | changes


def half_width_text(attempt: dict[str, Any]) -> str:
    """Format the half-width of the 95 % interval of ln(leakage) after an attempt, as infinity if unknown."""
    width = attempt["half_width"]
    return format_deviation(inf if width is None else width)
