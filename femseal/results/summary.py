"""Results in a few lines, and the attempts at a wanted accuracy."""

from __future__ import annotations

from html import escape
from math import inf, log1p
from typing import Any

import numpy as np

from ..base import TextTable, counted, duration, format_deviation, to_text
from .paraview import stored_steps
from .results import Results
from .tables import format_leakage, leakage_table

#: Text where a column has nothing to say.
_NONE = "–"


def attempt_sentences(found: dict[str, Any]) -> list[str]:
    """Whether the accuracy is met, what limits it, and what half the error takes."""
    wanted, error = format_deviation(log1p(found["wanted"])), _half_width(found)
    met = "" if found["reached"] else "not "
    lines = [
        f"The accuracy of {wanted} is {met}reached: the leakage is known within {error} at all loads that leak more "
        "than 1/1000 of the first, by the numbers alone of its error budget."
    ]
    if model := found.get("model_parts"):
        both = format_deviation(inf if found["with_model"] is None else found["with_model"])
        lines.append(
            f"With the model and its input ({', '.join(model)}) it is known within {both}."
        )
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
    """A line for each attempt; the sentences are its notes."""
    attempts = found["attempts"]
    settings = [attempt["settings"] for attempt in attempts]
    columns: dict[str, list[str]] = {
        "attempt": [str(number) for number in range(1, len(attempts) + 1)],
        "method": [each["method"] for each in settings],
        "points": [" × ".join(map(str, attempt["points"])) for attempt in attempts],
        "residual": [f"{each['rtol']:.0e}" for each in settings],
        "seals": [_count(each["realisations"]) for each in settings],
        "time": [duration(attempt["with_coarse"]) for attempt in attempts],
        "error": [_half_width(attempt) for attempt in attempts],
        "limited by": [attempt["limit"] for attempt in attempts],
    }
    notes = (" ".join(attempt_sentences(found)),)
    return TextTable.of_columns("", list(columns.items()), names=len(columns), notes=notes)


def as_chosen(case: dict[str, Any], found: dict[str, Any] | None) -> dict[str, Any]:
    """A case whose keys have the values of the last attempt; it is the same without attempts.

    Keys that the case gives have them already, others hold defaults that were not taken.
    """
    if found is None:
        return case
    chosen = found["settings"]
    drawn = case.get("stochastic")
    if drawn is not None and chosen["realisations"] is not None:
        drawn = drawn | {"realisations": chosen["realisations"]}
    changed = {"method": chosen["method"], "contact": case["contact"] | {"rtol": chosen["rtol"]}}
    return case | changed | ({} if drawn is None else {"stochastic": drawn})


def _count(number: int | None) -> str:
    return _NONE if number is None else str(number)


def _half_width(found: dict[str, Any]) -> str:
    width = found["half_width"]
    return format_deviation(inf if width is None else width)


def summary_text(run: Results) -> str:
    """Method and main results, a line each."""
    title = run.case.get("title", "")
    head = "femseal.Results" + (f" {title!r}" if title else "")
    lines = contents(run) | ({"folder": str(run.folder)} if run.folder else {})
    return "\n".join([f"<{head}>", *(f"{name:<10} {value}" for name, value in lines.items())])


def summary_html(run: Results) -> str:
    """The lines, and the table of the leakage."""
    title = escape(run.case.get("title", "") or "femseal results")
    lines = TextTable("", (), tuple(contents(run).items()))._repr_html_()
    return f"<div><b>{title}</b>\n{lines}\n{leakage_table(run)._repr_html_()}</div>"


def contents(run: Results) -> dict[str, str]:
    """Name and text of the lines on the contents."""
    steps, peak = run.steps, run.peak
    unit, factor = run.leak_scale
    leakage = float(run.leakage[peak])
    text = format_leakage(leakage, factor) + (
        f" {unit.name}" if np.isfinite(leakage) and leakage != 0 else ""
    )
    found = {"leakage": f"at {to_text(steps[peak].pressure, 'Pa')}: {text} ({run.method})"}
    up = sum(step.unloaded_from is None for step in steps)
    peaks = sorted({step.unloaded_from for step in steps if step.unloaded_from is not None})
    down = (
        f", {len(steps) - up} unloading from {', '.join(to_text(p, 'Pa') for p in peaks)}"
        if peaks
        else ""
    )
    found["load"] = f"{counted(len(steps), 'step')}: {up} loading{down}"
    if stored := stored_steps(run):
        found["fields"] = f"over all pixels at {len(stored)} of {counted(len(steps), 'step')}"
    for name, texts in (("warnings", run.warnings), ("failures", run.failures)):
        if texts:
            found[name] = f"{len(texts)}, the first: {texts[0]}"
    if missing := run.left_out:
        found["left out"] = "; ".join(missing)
    return found
