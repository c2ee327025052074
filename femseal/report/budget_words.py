"""The error budget of a run in the report: every source at the loads that matter, and which of them limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base.text import format_deviation
from ..budget import ErrorBudget
from ..studies.curve_distance import FLOOR

if TYPE_CHECKING:
    from ..results.results import Results

Lines = list[tuple[str, ...]]


def important_steps(results: Results) -> list[int]:
    """The first load, the highest, the highest that leaks more than 1e-3 of the first, and the last one."""
    leakage, steps = np.abs(results.leakage.values), results.steps
    peak = max(range(len(steps)), key=lambda s: steps[s].pressure)
    leaking = [s for s in range(len(steps)) if leakage[s] > FLOOR * leakage[0] and steps[s].unloaded_from is None]
    return list(dict.fromkeys((0, *leaking[-1:], peak, len(steps) - 1)))


def budget_heads(results: Results) -> list[str]:
    """Heads of the table of the budget."""
    return ["source", *(results.steps[s].name for s in important_steps(results)), "how it was estimated"]


def budget_lines(results: Results) -> Lines:
    """A line for each source, the widest first, and one for all together; empty without a budget."""
    budget = results.budget
    if budget is None:
        return []
    steps = important_steps(results)
    widths = budget.widths()
    order = sorted(budget.parts, key=lambda part: -_largest(widths[part.name][steps]))
    lines: Lines = [
        (part.name, *(_width_text(float(widths[part.name][s])) for s in steps), part.note) for part in order
    ]
    whole = np.asarray(budget.half_width())
    together = "root of the sum of squares of the distances of ln(leakage)"
    return [*lines, ("together", *(_width_text(float(whole[s])) for s in steps), together)]


def _width_text(width: float) -> str:
    """A half-width of ln(leakage); inf is that of a seal that may leak or be sealed."""
    known = {"nan": "unknown", "inf": "open or sealed", "0": "0"}.get(f"{width:g}")
    return format_deviation(width, "× ") if known is None else known


def budget_sentences(results: Results) -> list[str]:
    """What limits the leakage, and what the other methods of the run say."""
    budget = results.budget
    if budget is None:
        return []
    found = [
        "The band of error of a leakage holds the truth in about 95 of 100 cases: the leakage of such a face on pixels "
        "as fine as one wants, with the waves that were removed, and without errors of method or draws.",
        _limit(budget),
    ]
    return [text for text in found if text]


def _limit(budget: ErrorBudget) -> str:
    name = budget.limiting()
    return f"Over the loads that leak more than 1e-3 of the first the widest source is: {name}." if name else ""


def _largest(widths: np.ndarray) -> float:
    return float(np.max(np.nan_to_num(widths, nan=np.inf), initial=0.0))
