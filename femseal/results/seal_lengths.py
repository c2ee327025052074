"""Leakage of drawn seals of several lengths, from one library: a table for people and one for spreadsheets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.quantities import to_text
from ..base.text import TextTable, comma_separated
from .run_data import RunData
from .tables import format_leakage, format_range

#: Variables over lengths and steps, by the end of the band that they are.
KINDS = ("median", "lower", "upper", "lower_together", "upper_together")
#: Most load steps that are shown.
_MOST_STEPS = 4


def has_lengths(run: RunData) -> bool:
    """Whether seals of several lengths were drawn."""
    return "leakage_of_lengths_median" in run.dataset


def length_curves(run: RunData) -> dict[str, np.ndarray]:
    """Leakage by length and step (seal_length, step) [m²/s] of every kind that there is.

    Raises InputError: seals of one length only.
    """
    if not has_lengths(run):
        raise InputError("lengths", "results of one length of seal", "those of a run with a list of lengths")
    names = {kind: f"leakage_of_lengths_{kind}" for kind in KINDS}
    return {kind: run.dataset[name].values for kind, name in names.items() if name in run.dataset}


def length_steps(run: RunData) -> list[int]:
    """Loading steps at which the median of some length leaks, spread evenly, and the last step of the programme."""
    data = run.dataset
    leaks = (np.nan_to_num(data["leakage_of_lengths_median"].values) != 0).any(axis=0)
    loading = np.isnan(data["unloaded_from"].values)
    chosen = np.flatnonzero(loading & leaks)
    if not chosen.size:
        chosen = np.flatnonzero(loading)
    chosen = chosen[np.unique(np.linspace(0, chosen.size - 1, _MOST_STEPS - 1).round().astype(int))]
    return list(dict.fromkeys([*map(int, chosen), data.sizes["step"] - 1]))


def length_scales(run: RunData) -> np.ndarray:
    """Leakage per length that is 1 in the unit of the results, for every length of seal (seal_length,) [m²/s]."""
    lengths = run.dataset["seal_length"].values
    return np.array([replace(run.leak_basis, length=float(x)).factor(run.leak_unit) for x in lengths])


def lengths_table(run: RunData) -> TextTable:
    """Median and band by length of seal at a few loads, to be given to `rich.print`.

    Raises InputError: seals of one length only.
    """
    curves, names = length_curves(run), run.dataset["name"].values
    median, low, high = (curves[kind] for kind in KINDS[:3])
    lengths, scales = run.dataset["seal_length"].values, length_scales(run)

    def cell(n: int, s: int) -> str:
        return f"{format_leakage(median[n, s], scales[n])} ({format_range(low[n, s], high[n, s], scales[n])})"

    columns = [("seal length", [to_text(float(length), "m") for length in lengths])]
    for s in length_steps(run):
        columns.append((str(names[s]).removeprefix("loading "), [cell(n, s) for n in range(lengths.size)]))
    return TextTable.of_columns(f"median and band by length of seal, in {run.leak_unit.name}", columns, names=0)


def csv_text(run: RunData) -> str:
    """One line for each length and load step in SI, as comma-separated values."""
    data, curves = run.dataset, length_curves(run)
    rows: list[dict[str, Any]] = [
        {
            "seal_length_m": float(length),
            "step": s,
            "branch": str(data["branch"].values[s]),
            "nominal_pressure_Pa": float(data["nominal_pressure"].values[s]),
            "unloaded_from_Pa": float(data["unloaded_from"].values[s]),
        }
        | {f"leakage_{kind}_m2_per_s": float(values[n, s]) for kind, values in curves.items()}
        for n, length in enumerate(data["seal_length"].values)
        for s in range(data.sizes["step"])
    ]
    return comma_separated(rows)
