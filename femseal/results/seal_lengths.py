"""Leakage of drawn seals of several lengths, from one library: a table for people and one for spreadsheets."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import InputError
from ..base.quantities import to_text
from ..base.text import comma_separated
from .tables import amount, told_range

if TYPE_CHECKING:
    from rich.table import Table

    from .results import Results

#: Variables over lengths and steps, by the end of the band that they are.
KINDS = ("median", "lower", "upper", "lower_together", "upper_together")
#: Most load steps that are told and drawn.
_MOST_STEPS = 4


def kinds(results: Results) -> list[str]:
    """Those that there are."""
    return [kind for kind in KINDS if f"leakage_of_lengths_{kind}" in results.dataset]


def has_lengths(results: Results) -> bool:
    """Whether seals of several lengths were drawn."""
    return "leakage_of_lengths_median" in results.dataset


def require_lengths(results: Results) -> None:
    """Raise InputError for results of one length."""
    if not has_lengths(results):
        raise InputError("lengths", "results of one length of seal", "those of a run with a list of lengths")


def told_steps(results: Results) -> list[int]:
    """Loading steps at which the median of some length leaks, spread evenly, and the last step of the programme."""
    data = results.dataset
    leaks = (np.nan_to_num(data["leakage_of_lengths_median"].values) != 0).any(axis=0)
    loading = np.isnan(data["unloaded_from"].values)
    chosen = np.flatnonzero(loading & leaks)
    if not chosen.size:
        chosen = np.flatnonzero(loading)
    chosen = chosen[np.unique(np.linspace(0, chosen.size - 1, _MOST_STEPS - 1).round().astype(int))]
    return list(dict.fromkeys([*map(int, chosen), data.sizes["step"] - 1]))


def factors(results: Results) -> np.ndarray:
    """Leakage per length that is 1 in the unit of the results, for every length of seal (seal_length,) [m²/s]."""
    lengths = results.dataset["seal_length"].values
    return np.array([replace(results.leak_basis, length=float(x)).factor(results.leak_unit) for x in lengths])


def texts(results: Results) -> tuple[list[str], list[list[str]]]:
    """Headings and cells: the length, and median and band at a few load steps."""
    require_lengths(results)
    data = results.dataset
    median, low, high = (data[f"leakage_of_lengths_{kind}"].values for kind in KINDS[:3])
    steps = told_steps(results)
    lines = [
        [to_text(float(length), "m")]
        + [f"{amount(median[n, s], factor)} ({told_range(low[n, s], high[n, s], factor)})" for s in steps]
        for n, (length, factor) in enumerate(zip(data["seal_length"].values, factors(results), strict=True))
    ]
    return ["seal length", *(str(data["name"].values[s]) for s in steps)], lines


def csv_text(results: Results) -> str:
    """One line for each length and load step in SI, as comma-separated values."""
    data, there = results.dataset, kinds(results)
    rows: list[dict[str, Any]] = [
        {
            "seal_length_m": float(length),
            "step": s,
            "branch": str(data["branch"].values[s]),
            "nominal_pressure_Pa": float(data["nominal_pressure"].values[s]),
            "unloaded_from_Pa": float(data["unloaded_from"].values[s]),
        }
        | {f"leakage_{kind}_m2_per_s": float(data[f"leakage_of_lengths_{kind}"].values[n, s]) for kind in there}
        for n, length in enumerate(data["seal_length"].values)
        for s in range(data.sizes["step"])
    ]
    return comma_separated(rows)


def rich_table(results: Results) -> Table:
    """The table for a terminal, for `rich.print`."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    heads, lines = texts(results)
    title = f"median and band by length of seal, in {results.leak_unit.name}"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for head in heads:
        table.add_column(head.removeprefix("loading "), justify="right", overflow="fold")
    for line in lines:
        table.add_row(*line)
    return table
