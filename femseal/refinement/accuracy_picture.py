"""Picture of error over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..plots.drawing import STYLES, new_figure
from .accuracy_plan import Variant, by

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Colour and marker of each method.
_METHODS = {name: (style[0], style[2]) for name, style in zip(
    ("deterministic", "two-scale", "stochastic"), STYLES[:3], strict=True)}  # fmt: skip
#: Smaller errors are drawn at this value, the accuracy of the contact solution.
_LEAST = 1e-5
_GREY = "#666666"


def accuracy_figure(report: Any) -> Figure:
    """Error factor minus 1 over wall time, log scales, one panel for each branch of the load cycle.

    Open markers: medians of drawn seals against two scales. The time of the reference is a dashed line.
    """
    branches = ["loading"]
    branches += ["unloading"] if any(s.unloaded_from is not None for s in report.plan.prepared.scene.steps) else []
    figure = new_figure(5.6 * len(branches), 4.6)
    panels = figure.subplots(1, len(branches), sharex=True, sharey=True, squeeze=False)[0]
    for axes, branch in zip(panels, branches, strict=True):
        axes.set(xscale="log", yscale="log", xlabel="time [s]")
        axes.set_title(branch, fontsize=9.5)
        axes.grid(alpha=0.25, lw=0.6)
        axes.axvline(report.solutions[0].seconds, color=_GREY, ls="--", lw=1)
        for solution in report.solutions[1:]:
            for comparison in solution.comparisons:
                _mark(axes, report, solution, comparison, branch)
        _mark_budgets(axes, report)
        axes.margins(0.18, 0.1)
    panels[0].set_ylabel("factor of leakage − 1")
    figure.suptitle(report.plan.against.replace(": ", ":\n"), fontsize=9.5)
    figure.legend(handles=_legend(report), loc="outside lower center", ncols=5, frameon=False, fontsize=8.5)
    return figure


def _mark(axes: Axes, report: Any, solution: Any, comparison: Any, branch: str) -> None:
    """Draw the error of a solution over its time, and its label."""
    factor = getattr(comparison, branch)
    if not factor.loads:
        return
    variant = solution.variant
    colour, marker = _METHODS[variant.method]
    first = comparison is solution.comparisons[0]
    at = solution.seconds, max(factor.value - 1, _LEAST)
    axes.plot(*at, color=colour, ls="", marker=marker, ms=7, mew=1.3, mfc=colour if first else "none")
    text = _name(report, variant) if first else ""
    text += f" (+{factor.closed} closed)" if factor.closed else ""
    # libraries and coarser grids lie among the windows of the case
    apart = variant.library_cells is not None or (variant.cells and variant.points != report.plan.reference.points)
    side: dict[str, Any] = {"xytext": (-5, -9), "ha": "right"} if apart else {"xytext": (5, 4)}
    axes.annotate(text, at, textcoords="offset points", fontsize=7, color=_GREY, **side)


def _mark_budgets(axes: Axes, report: Any) -> None:
    """The budget of every solution as a bar over its time, and a ring about the recommended one."""
    for solution in report.solutions:
        if (found := solution.widest_band) is None or not np.isfinite(found.half_width):
            continue
        colour, _ = _METHODS[solution.variant.method]
        width = max(float(np.expm1(found.half_width)), _LEAST)
        axes.plot(solution.seconds, width, color=colour, ls="", marker="_", ms=13, mew=2)
        if solution is report.recommended:
            axes.plot(solution.seconds, width, color=_GREY, ls="", marker="o", ms=17, mfc="none", mew=1.2)
    axes.axhline(report.plan.accuracy, color=_GREY, ls=":", lw=1)


def _name(report: Any, variant: Variant) -> str:
    """Text that distinguishes a solution from others of its method."""
    if variant.library_cells is not None:
        return str(variant.library_cells)
    if variant.cells is None:
        return by(variant.points)
    own = variant.points == report.plan.reference.points
    return by(variant.cells) + ("" if own else f" on {by(variant.points)}")


def _legend(report: Any) -> list[Any]:
    """Handles of the methods that are drawn."""
    from matplotlib.lines import Line2D

    labels = {
        "deterministic": "deterministic: points",
        "two-scale": "two-scale: cells",
        "stochastic": "stochastic: cells in the library",
    }
    drawn = dict.fromkeys(s.variant.method for s in report.solutions[1:])
    handles = [Line2D([], [], ls="", color=_METHODS[m][0], marker=_METHODS[m][1], ms=7, label=labels[m]) for m in drawn]
    if "stochastic" in drawn and report.plan.companion is not None:
        colour, marker = _METHODS["stochastic"]
        label = f"open: against {report.plan.companion.short}"
        handles.append(Line2D([], [], ls="", color=colour, marker=marker, ms=7, mew=1.3, mfc="none", label=label))
    handles.append(Line2D([], [], color=_GREY, ls="--", lw=1, label="time of the reference"))
    handles.append(Line2D([], [], color=_GREY, ls="", marker="_", ms=13, mew=2, label="budget"))
    wanted = f"{100 * report.plan.accuracy:.3g} %"
    handles.append(Line2D([], [], color=_GREY, ls=":", lw=1, label=wanted))
    if report.recommended is not None:
        ring = Line2D([], [], color=_GREY, ls="", marker="o", ms=12, mfc="none", label="recommended")
        handles.append(ring)
    return handles
