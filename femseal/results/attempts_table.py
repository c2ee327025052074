"""The attempts at the accuracy that a case asks for: for the terminal and the report."""

from __future__ import annotations

from math import inf, log1p
from typing import Any

from ..base.text import TextTable, duration, format_deviation

#: Text where a column has nothing to say.
_NONE = "–"


def attempt_sentences(found: dict[str, Any]) -> list[str]:
    """Whether the accuracy is met, what limits it, and what half the error takes."""
    wanted, error = format_deviation(log1p(found["wanted"])), _half_width(found)
    met = "" if found["reached"] else "not "
    lines = [
        f"The accuracy of {wanted} is {met}reached: the leakage is known within {error} at all loads that leak more "
        "than 1/1000 of the first, by its error budget."
    ]
    if found["half_width"] != 0:
        # "pixels" and "realisations" are several
        verb = "limit" if found["limit"].endswith("s") else "limits"
        lines.append(f"The {found['limit']} {verb} it, most at {found['load']}.")
    if found["why"]:
        lines.append(f"No further attempt: {found['why']}.")
    if found["half_width"] != 0 and not (found["why"] and found["half_error"].startswith("cannot")):
        lines.append(f"Half the error: {found['half_error']}.")
    return lines


def attempts_table(found: dict[str, Any]) -> TextTable:
    """A line for each attempt, without columns in which nothing stands; the sentences are its notes."""
    attempts = found["attempts"]
    settings = [attempt["settings"] for attempt in attempts]
    columns: dict[str, list[str]] = {
        "attempt": [str(number) for number in range(1, len(attempts) + 1)],
        "method": [each["method"] for each in settings],
        "points": [" × ".join(map(str, attempt["points"])) for attempt in attempts],
        "residual": [f"{each['rtol']:.0e}" for each in settings],
        "windows": [_windows(each) for each in settings],
        "library": [_count(attempt["windows"]) for attempt in attempts],
        "seals": [_count(each["realisations"]) for each in settings],
        "time": [duration(attempt["with_coarse"]) for attempt in attempts],
        "error": [_half_width(attempt) for attempt in attempts],
        "limited by": [attempt["limit"] for attempt in attempts],
    }
    shown = [(head, texts) for head, texts in columns.items() if any(text != _NONE for text in texts)]
    return TextTable.of_columns("", shown, names=len(shown), notes=(" ".join(attempt_sentences(found)),))


def as_chosen(case: dict[str, Any], found: dict[str, Any] | None) -> dict[str, Any]:
    """A case whose keys have the values of the last attempt; it is the same without attempts.

    Keys that the case gives have them already, others hold defaults that were not taken.
    """
    if found is None:
        return case
    chosen = found["settings"]
    drawn = case.get("stochastic")
    if drawn is not None and chosen["realisations"] is not None and drawn.get("width") is None:
        drawn = drawn | {key: chosen[key] for key in ("realisations", "library_cells")}
    changed = {"method": chosen["method"], "contact": case["contact"] | {"rtol": chosen["rtol"]}}
    return case | changed | ({} if drawn is None else {"stochastic": drawn})


def _windows(settings: dict[str, Any]) -> str:
    if settings["method"] == "deterministic" or settings["cells"] is None:
        return _NONE
    cells = " × ".join(map(str, settings["cells"]))
    return f"{cells}, {settings['flow']}" if settings["method"] == "two-scale" else cells


def _count(number: int | None) -> str:
    return _NONE if number is None else str(number)


def _half_width(found: dict[str, Any]) -> str:
    width = found["half_width"]
    return format_deviation(inf if width is None else width)
