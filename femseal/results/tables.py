"""Leakage step by step as a table: for the terminal, for a notebook, for a spreadsheet."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.leak_units import LEAK_UNITS, TOLD
from ..base.quantities import to_text
from ..base.text import comma_separated
from .branches import branch_text
from .error_bands import BUDGETED
from .interpolated import solved_steps
from .variables import name_with_unit

if TYPE_CHECKING:
    import xarray
    from rich.table import Table

    from ..base.leak_units import LeakUnit
    from .results import Results

#: Mark of a leakage that is interpolated between loads.
INTERPOLATED = "≈"
#: Length of a heading in the terminal beyond which it is broken between words.
_HEADING = 10
#: Ratio of the ends of a narrow band.
_NARROW = 1.2
#: Width of the first column in the terminal.
_BRANCH = 12


def rows(results: Results) -> list[dict[str, Any]]:
    """One dictionary for each step in SI, with the leakage in further units at the end; keys carry the units."""
    data = results.dataset
    columns = {name_with_unit(results.leakage, "leakage"): results.leakage.values}
    columns |= {name_with_unit(v): v.values for v in data.data_vars.values() if v.dims == ("step",)}
    further = [unit for unit in results.leak_basis.units() if unit.si != 1]
    columns |= {f"leakage_{ascii_unit(unit.name)}": results.leakage_in(unit.name).values for unit in further}
    if "class_share" in data:
        for name, share in zip(data["leak_class"].values, data["class_share"].values, strict=True):
            columns[f"share_in_{ascii_unit(str(name))}"] = share
    table = []
    for s in range(data.sizes["step"]):
        row: dict[str, Any] = {
            "step": s,
            "branch": branch_text(float(data["unloaded_from"][s])),
            "nominal_pressure_Pa": float(data["nominal_pressure"][s]),
        }
        row |= {key: float(values[s]) for key, values in columns.items()}
        table.append(row)
    return table


def ascii_unit(unit: str) -> str:
    """A unit in letters: "mL/(m·min)" is "mL_per_m_min"."""
    for sign, letters in (
        ("/", "_per_"),
        ("·", "_"),
        ("(", ""),
        (")", ""),
        ("³", "3"),
        ("²", "2"),
        ("µ", "u"),
        (" ", "_"),
    ):
        unit = unit.replace(sign, letters)
    return unit


def csv_text(results: Results) -> str:
    """The rows as comma-separated values, with one line of column names."""
    return comma_separated(rows(results))


def texts(results: Results) -> tuple[str, list[str], list[list[str]]]:
    """Title, headings and cells of the table for people: one unit of leakage in all columns but one, 0 is "sealed".

    Branch, pressure, leakage with its bands, that of the whole seal, and every variable over the steps that has a
    heading.
    """
    data, best, basis = results.dataset, results.leakage, results.leak_basis
    unit, factor = leak_scale(results)
    columns: list[tuple[str, Iterable[str]]] = [
        ("branch", (branch_text(float(peak)) for peak in data["unloaded_from"].values)),
        ("pressure", (to_text(float(p), "Pa") for p in data["nominal_pressure"].values)),
        (best.attrs.get("heading", results.method), _marked(_cells(best, factor), data)),
    ]
    budget = f"leakage_{BUDGETED[results.method]}_budget"
    if "leakage_lower" in data:
        share = "–".join(f"{100 * data[name].attrs['quantile']:g}" for name in ("leakage_lower", "leakage_upper"))
        bands = [(f"{share} %", "")]
        # the band of error has that of the library
        if "leakage_lower_together" in data and f"{budget}_lower" not in data:
            bands.append(("with error of library", "_together"))
        for heading, end in bands:
            ends = zip(data[f"leakage_lower{end}"].values, data[f"leakage_upper{end}"].values, strict=True)
            columns.append((heading, [told_range(low, high, factor) for low, high in ends]))
    if f"{budget}_lower" in data:
        band = zip(data[f"{budget}_lower"].values, data[f"{budget}_upper"].values, strict=True)
        columns.append(("95 % band of error", [error_band(low, high, factor) for low, high in band]))
    if unit.per_length:
        whole = basis.readable(best.values)
        columns.append((f"whole seal [{whole.name}]", [amount(q, basis.factor(whole)) for q in best.values]))
    for name, variable in data.data_vars.items():
        # no column for sealed realisations if there are none
        if "heading" in variable.attrs and name != best.name and (name != "sealed_fraction" or variable.any()):
            columns.append((variable.attrs["heading"], _cells(variable, factor)))
    if "test_leakage" in data:
        test = test_unit(results)
        scale = results.judged_basis.factor(test)
        columns.append((f"test fluid [{test.name}]", [amount(q, scale) for q in data["test_leakage"].values]))
    if "leak_class" in data.coords:
        columns.append(("class", results.classes))
    title = f"{leakage_of(results)} in {unit.name} (= {factor:.3g} m²/s{'' if unit.per_length else ' per length'})"
    return title, [c[0] for c in columns], [list(cells) for cells in zip(*(c[1] for c in columns), strict=True)]


def leak_scale(results: Results) -> tuple[LeakUnit, float]:
    """The unit in which the leakage is told, and the leakage per length that is 1 in it [m²/s]."""
    return results.leak_unit, results.leak_basis.factor(results.leak_unit)


def test_unit(results: Results) -> LeakUnit:
    """The unit in which the leakage of the test fluid is told: that of the leakage where it is for both fluids."""
    own, basis = results.leak_unit, results.judged_basis
    if basis.has(own) and results.dataset.attrs.get("leakage_unit"):
        return own
    return LEAK_UNITS["mbar·L/(m·s)" if basis.is_gas else "mL/(m·min)"]


def leakage_of(results: Results) -> str:
    """What the leakage in its unit is of, in words."""
    if results.leak_unit.per_length:
        return "leakage per length of seal"
    return f"leakage of the whole seal, {to_text(results.leak_basis.length, 'm')},"


def totals(results: Results) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of a table of the leakage in several units: branch, pressure, and a column for each unit."""
    data, basis = results.dataset, results.leak_basis
    names = [*TOLD, results.leak_unit.name] if results.leak_unit.name not in TOLD else list(TOLD)
    units = basis.units(names)
    lines = [
        [
            branch_text(float(peak)),
            to_text(float(p), "Pa"),
            *(amount(float(q), basis.factor(unit)) for unit in units),
        ]
        for p, peak, q in zip(
            data["nominal_pressure"].values, data["unloaded_from"].values, results.leakage.values, strict=True
        )
    ]
    return ["branch", "pressure", *(unit.name for unit in units)], lines


def in_several_units(results: Results, step: int) -> str:
    """Leakage at a step of the whole seal, in volume, mass and, for a gas, pressure × volume; "" without a number."""
    leakage, basis = float(results.leakage[step]), results.leak_basis
    if not np.isfinite(leakage) or leakage == 0:
        return ""
    units = [unit for unit in basis.units() if not unit.per_length]
    return " = ".join(f"{amount(leakage, basis.factor(unit))} {unit.name}" for unit in units)


def _cells(variable: xarray.DataArray, factor: float) -> list[str]:
    """Values over the steps as texts: leakages in the unit `factor`, shares in percent, others with their unit."""
    unit = variable.attrs["units"]
    if unit == "m^2/s":
        return [amount(value, factor) for value in variable.values]
    if unit == "1":
        return [_percent(value) for value in variable.values]
    return [to_text(float(value), unit, 3) for value in variable.values]


def _marked(cells: list[str], data: xarray.Dataset) -> list[str]:
    """Cells of all steps, with a mark at those that are interpolated."""
    solved = solved_steps(data)
    return [cell if s in solved else f"{INTERPOLATED} {cell}" for s, cell in enumerate(cells)]


def rich_table(results: Results) -> Table:
    """The table for a terminal of 80 columns, for `rich.print`; each branch has a line of its own above its steps."""
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape as plain
    from rich.table import Table

    title, headers, cells = texts(results)
    table = Table(title=plain(title), title_justify="left", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    # names of branches are broken, which leaves the width to the numbers
    table.add_column("pressure", max_width=_BRANCH)
    for header in headers[2:]:
        table.add_column(plain(fill(header, _HEADING, break_long_words=False)), justify="right", overflow="fold")
    for n, (branch, pressure, *values) in enumerate(cells):
        if n == 0 or cells[n - 1][0] != branch:
            table.add_row(branch, style="bold")
        table.add_row(f"{pressure:>9}", *values)
    return table


def html_table(results: Results) -> str:
    """The table for a notebook."""
    title, headers, cells = texts(results)
    head = "".join(f"<th>{escape(h)}</th>" for h in headers)
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


def told_range(low: float, high: float, factor: float) -> str:
    """Both ends of a band in the unit `factor`, as text."""
    ends = amount(low, factor), amount(high, factor)
    if ends[0] == ends[1] and not abs(low) > 0:
        return ends[0]
    return (" to " if low < 0 else "–").join(ends)


def error_band(low: float, high: float, factor: float) -> str:
    """Both ends of a band of error in the unit `factor`, as text; in two digits unless it is narrow."""
    if np.isnan(low) or np.isnan(high):
        return "unknown"
    if np.isinf(high):
        return "open or sealed" if low == 0 else f"{amount(low, factor)} or more"
    if high > _NARROW * low:
        low, high = (float(f"{end / factor:.1e}") for end in (low, high))
        return told_range(low, high, 1.0)
    return told_range(low, high, factor)


def _percent(value: float) -> str:
    return "failed" if np.isnan(value) else f"{100 * value:.3g}"
