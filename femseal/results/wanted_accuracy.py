"""The accuracy that a case asked for, and the attempts at it: for the terminal and the report."""

from __future__ import annotations

import json
from math import inf, log1p
from typing import TYPE_CHECKING, Any

from ..base.text import duration, share_text

if TYPE_CHECKING:
    from rich.table import Table

    from .results import Results

HEADS = (
    "attempt",
    "method",
    "points",
    "residual",
    "windows",
    "library",
    "seals",
    "time",
    "error",
    "limited by",
)


def told(results: Results) -> dict[str, Any] | None:
    """What the run says of its attempts; None of a case that asks for no accuracy."""
    text = results.dataset.attrs.get("accuracy")
    return None if text is None else json.loads(text)


def sentences(found: dict[str, Any]) -> list[str]:
    """Whether the accuracy is reached, what limits it, and what half the error takes."""
    wanted, error = _share(log1p(found["wanted"])), _share(found["half_width"])
    if found["reached"]:
        first = f"The accuracy of {wanted} is reached: the leakage is known within {error}"
    else:
        first = f"The accuracy of {wanted} is not reached: the leakage is known within {error}"
    lines = [f"{first} at all loads that leak more than 1/1000 of the first, by its error budget."]
    if found["half_width"] != 0:
        lines.append(f"The {found['limit']} limit{_s(found['limit'])} it, most at {found['load']}.")
    if found["why"]:
        lines.append(f"No further attempt: {found['why']}.")
    if found["half_width"] != 0 and not (found["why"] and found["half_error"].startswith("cannot")):
        lines.append(f"Half the error: {found['half_error']}.")
    return lines


def lines(found: dict[str, Any]) -> list[tuple[str, ...]]:
    """A line for each attempt, under `HEADS` without those that are the same empty ones in all."""
    return [
        (
            str(number),
            attempt["settings"]["method"],
            " × ".join(map(str, attempt["points"])),
            f"{attempt['settings']['rtol']:.0e}",
            _windows(attempt["settings"]),
            _count(attempt["windows"]),
            _count(attempt["settings"]["realisations"]),
            duration(attempt["with_coarse"]),
            _share(attempt["half_width"]),
            attempt["limit"],
        )
        for number, attempt in enumerate(found["attempts"], start=1)
    ]


def columns(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Heads and lines of the table of attempts, without columns in which nothing stands."""
    rows = lines(found)
    kept = [n for n in range(len(HEADS)) if any(row[n] != "–" for row in rows)]
    return [HEADS[n] for n in kept], [[row[n] for n in kept] for row in rows]


def section(found: dict[str, Any]) -> dict[str, Any]:
    """Sentences, heads and lines of the report."""
    heads, rows = columns(found)
    return {"sentences": sentences(found), "heads": heads, "lines": rows}


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


def rich_table(found: dict[str, Any]) -> Table:
    """The table of attempts for a terminal, with the sentences below."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    heads, rows = columns(found)
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.caption, table.caption_justify = " ".join(sentences(found)), "left"
    for head in heads:
        table.add_column(head)
    for row in rows:
        table.add_row(*row)
    return table


def _windows(settings: dict[str, Any]) -> str:
    if settings["method"] == "deterministic" or settings["cells"] is None:
        return "–"
    cells = " × ".join(map(str, settings["cells"]))
    return f"{cells}, {settings['flow']}" if settings["method"] == "two-scale" else cells


def _count(number: int | None) -> str:
    return "–" if number is None else str(number)


def _share(half_width: float | None) -> str:
    return share_text(inf if half_width is None else half_width)


def _s(name: str) -> str:
    """The ending of a verb after a name: "pixels" and "realisations" are several."""
    return "" if name.endswith("s") else "s"
