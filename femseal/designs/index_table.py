"""Present the sealing index ∫ pⁿ dl in the data sheet of a design: as a table, as a sentence, and in `design.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any

from ..base import TextTable
from ..base.quantities import range_text
from ..results.load_steps import branch_text
from ..results.power_law import FIT_TOLERANCE
from ..results.sealing_index import IndexLimit, SealingIndex, index_text


def index_table(indices: Sequence[SealingIndex]) -> TextTable:
    """Make the table of the exponents n and of the sealing indices at which each leakage class is met."""
    columns = [
        ("load", [branch_text(index.unloaded_from) for index in indices]),
        ("contact pressure", [_range_text(index) for index in indices]),
        ("n", [_exponent_text(index) for index in indices]),
    ]
    for number, limit in enumerate(indices[0].limits):
        columns.append((limit.name, [_limit_text(index.limits[number]) for index in indices]))
    title = "Sealing index ∫pⁿ dl that a class needs, in MPaⁿ·mm, with the 95 % interval"
    return TextTable.of_columns(title, columns, names=len(columns))


def index_sentence(reason: str = "") -> str:
    """Explain what the sealing index is and how to read its table, or why the data sheet contains no sealing index.

    reason : reason why the run does not determine a sealing index; "" if the data sheet contains the table.
    """
    if reason:
        return f"The sealing index ∫pⁿ dl does not follow from this run, because {reason}."
    return (
        "The sealing index is the integral of pⁿ over the width of the seal, in the direction of the leakage. Take the "
        "row whose contact pressures contain the highest one of the seal. In each row, the permeability of the finish "
        f"is a power of the pressure within {100 * FIT_TOLERANCE:g} %."
    )


def index_rows(indices: Sequence[SealingIndex]) -> list[dict[str, Any]]:
    """List exponents and required sealing indices as rows of a table, in SI units."""
    rows: list[dict[str, Any]] = []
    for index in indices:
        law = index.law
        common = {
            "assembly_pressure_Pa": index.unloaded_from,
            "relation": "=",
            "load": _range_text(index),
        }
        how = f"power law within {100 * law.deviation:.2g} % at {law.count} loads"
        exponent = {
            "figure": "exponent n of the sealing index",
            "value": index.exponent,
            "computed": index.exponent,
            **_ends(*index.exponent_interval),
            "how": how,
        }
        rows.append(common | exponent)
        for limit in index.limits:
            # None if the index is too large for a number
            computed = limit.value if isfinite(limit.value) else None
            needed = {
                "figure": "sealing index [Pa^n m]",
                "class": limit.name,
                "value": limit.upper if isfinite(limit.upper) else computed,
                "computed": computed,
                **_ends(limit.lower, limit.upper),
                "how": f"n = {limit.exponent:.6g}",
            }
            rows.append(common | needed)
    return rows


def _ends(low: float, high: float) -> dict[str, float]:
    """Return the ends of an interval by column name; leave out an end that is unknown."""
    return {name: end for name, end in (("low", low), ("high", high)) if isfinite(end)}


def _range_text(index: SealingIndex) -> str:
    """Format the range of pressures of a power law, such as "150 – 300 MPa"."""
    law = index.law
    return range_text(law.lowest_pressure, law.highest_pressure, "Pa", 3)


def _exponent_text(index: SealingIndex) -> str:
    """Format an exponent with its interval, such as "2.9 (2.5 – 3.1)"."""
    low, high = index.exponent_interval
    text = f"{index.exponent:.2g}"
    if low != low:  # NaN: there is no interval
        return text
    ends = [f"{end:.2g}" if isfinite(end) else "?" for end in (low, high)]
    return f"{text} ({ends[0]} – {ends[1]})"


def _limit_text(limit: IndexLimit) -> str:
    """Format a required sealing index with its interval, such as "1.2e7 (5.1e6 – 4.3e7)"."""
    text = index_text(limit.in_megapascals(limit.value))
    if limit.upper != limit.upper:  # NaN: there is no interval
        return text
    lower, upper = (index_text(limit.in_megapascals(end)) for end in (limit.lower, limit.upper))
    return f"{text} ({lower} – {upper})"
