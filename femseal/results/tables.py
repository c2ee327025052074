"""Leakage step by step as a table: for the terminal, for a notebook, for a spreadsheet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.quantities import leakage_unit, to_text
from .branches import branch_text

if TYPE_CHECKING:
    import xarray
    from rich.table import Table

    from .results import Results

#: Column of the CSV file, variable of the dataset; a column whose variable is missing is left out.
_COLUMNS = (
    ("leakage_m2_per_s", None),
    ("leakage_lower_m2_per_s", "leakage_lower"),
    ("leakage_upper_m2_per_s", "leakage_upper"),
    ("leakage_lower_together_m2_per_s", "leakage_lower_together"),
    ("leakage_upper_together_m2_per_s", "leakage_upper_together"),
    ("leakage_mean_m2_per_s", "leakage_mean"),
    ("sealed_share", "sealed_share"),
    ("leakage_two_scale_m2_per_s", "leakage_two_scale"),
    ("leakage_deterministic_m2_per_s", "leakage_deterministic"),
    ("contact_share", "contact_share"),
)


_HEADS = {"two-scale": "two-\nscale", "deterministic": "determi-\nnistic"}


def rows(results: Results) -> list[dict[str, Any]]:
    """One dictionary for each step, everything in SI; keys carry the units."""
    data = results.dataset
    table = []
    for s in range(data.sizes["step"]):
        row: dict[str, Any] = {
            "step": s,
            "branch": branch_text(float(data["unloaded_from"][s])),
            "nominal_pressure_Pa": float(data["nominal_pressure"][s]),
        }
        for key, name in _COLUMNS:
            variable = results.leakage if name is None else data.get(name)
            if variable is not None:
                row[key] = float(variable[s])
        table.append(row)
    return table


def csv_text(results: Results) -> str:
    """The rows as comma-separated values in SI, with one line of column names."""
    table = rows(results)
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    return stream.getvalue()


def texts(results: Results) -> tuple[str, list[str], list[list[str]]]:
    """Title, headers and cells of the table for people: one unit of leakage in all columns, 0 is "sealed"."""
    table = rows(results)
    factor, unit = leakage_unit([row["leakage_m2_per_s"] for row in table])
    data: xarray.Dataset = results.dataset
    columns: list[tuple[str, Iterable[str]]] = [
        ("branch", (r["branch"] for r in table)),
        ("pressure", (to_text(r["nominal_pressure_Pa"], "Pa") for r in table)),
        (_HEADS.get(results.method, results.method), (amount(r["leakage_m2_per_s"], factor) for r in table)),
    ]
    if "leakage_lower" in data:
        low, high = ("leakage_lower_m2_per_s", "leakage_upper_m2_per_s")
        low_together, high_together = ("leakage_lower_together_m2_per_s", "leakage_upper_together_m2_per_s")
        share = "–".join(f"{100 * data[name].attrs['quantile']:g}" for name in ("leakage_lower", "leakage_upper"))
        columns += [
            (f"{share} %", (_range(r[low], r[high], factor) for r in table)),
            ("with error\nof library", (_range(r[low_together], r[high_together], factor) for r in table)),
        ]
        if any(r["sealed_share"] != 0 for r in table):
            columns.append(("sealed\n[%]", (_percent(r["sealed_share"]) for r in table)))
    for name, key in (("two-scale", "leakage_two_scale_m2_per_s"), ("deterministic", "leakage_deterministic_m2_per_s")):
        if key in table[0] and name != results.method:
            columns.append((_HEADS[name], [amount(r[key], factor) for r in table]))
    if "contact_share" in data:
        columns.append(("contact\n[%]", (_percent(r["contact_share"]) for r in table)))
    title = f"leakage per length of seal in {unit} (= {factor:.0e} m²/s)"
    return title, [c[0] for c in columns], [list(cells) for cells in zip(*(c[1] for c in columns), strict=True)]


def plain_head(head: str) -> str:
    """A header in one line."""
    return next((method for method, text in _HEADS.items() if text == head), head.replace("\n", " "))


def rich_table(results: Results) -> Table:
    """The table for a terminal of 80 columns, for `rich.print`; each branch has a line of its own above its steps."""
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape as plain
    from rich.table import Table

    title, headers, cells = texts(results)
    table = Table(title=plain(title), title_justify="left", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("pressure")
    for header in headers[2:]:
        table.add_column(plain(header), justify="right", overflow="fold")
    for n, (branch, pressure, *values) in enumerate(cells):
        if n == 0 or cells[n - 1][0] != branch:
            table.add_row(branch, style="bold")
        table.add_row(f"{pressure:>9}", *values)
    return table


def html_table(results: Results) -> str:
    """The table for a notebook."""
    title, headers, cells = texts(results)
    head = "".join(f"<th>{escape(h).replace(chr(10), '<br>')}</th>" for h in headers)
    body = "\n".join("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in line) + "</tr>" for line in cells)
    caption = f"<caption>{escape(title)}</caption>"
    return f"<table>{caption}\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table>"


def amount(value: float, factor: float) -> str:
    """A leakage in the unit `factor`, in three digits; "sealed" where it is 0, "failed" where it is NaN."""
    if np.isnan(value):
        return "failed"
    if value == 0:
        return "sealed"
    number = value / factor
    return f"{number:.0f}" if 999.5 <= abs(number) < 1e6 else f"{number:.3g}"


def _range(low: float, high: float, factor: float) -> str:
    ends = amount(low, factor), amount(high, factor)
    if ends[0] == ends[1] and not abs(low) > 0:
        return ends[0]
    return (" to " if low < 0 else "–").join(ends)


def _percent(value: float) -> str:
    return "failed" if np.isnan(value) else f"{100 * value:.3g}"
