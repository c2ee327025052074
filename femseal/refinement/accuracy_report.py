"""Results of an accuracy comparison: for the terminal, for a spreadsheet, for other programs, and a picture."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict, dataclass
from math import isfinite, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import TextTable, comma_separated, made_folder, replacing, to_text, versions, write_text
from ..budget import ErrorBudget, WidestBand, widest_band
from ..plots.drawing import STYLES, new_figure
from ..studies.load_curves import FLOOR, LeakageFactor
from .accuracy_plan import Plan, Variant, by

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colour and marker of each method.
_METHODS = {name: (style[0], style[2]) for name, style in zip(
    ("deterministic", "stochastic"), STYLES[::2][:2], strict=True)}  # fmt: skip
#: Smaller errors are drawn at this value, the accuracy of the contact solution.
_LEAST = 1e-5
_GREY = "#666666"


def accuracy_figure(report: Any) -> Figure:
    """Error factor minus 1 over wall time, log scales, one panel for each branch of the load cycle.

    The time of the reference is a dashed line.
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
            _mark(axes, report, solution, branch)
        _mark_budgets(axes, report)
        axes.margins(0.18, 0.1)
    panels[0].set_ylabel("factor of leakage − 1")
    figure.suptitle(report.plan.against.replace(": ", ":\n"), fontsize=9.5)
    figure.legend(handles=_legend(report), loc="outside lower center", ncols=5, frameon=False, fontsize=8.5)
    return figure


def _mark(axes: Axes, report: Any, solution: Any, branch: str) -> None:
    """Draw the error of a solution over its time, and its label."""
    factor = getattr(solution.comparison, branch)
    if not factor.loads:
        return
    variant = solution.variant
    colour, marker = _METHODS[variant.method]
    at = solution.seconds, max(factor.value - 1, _LEAST)
    axes.plot(*at, color=colour, ls="", marker=marker, ms=7)
    text = _name(variant)
    text += f" (+{factor.closed} closed)" if factor.closed else ""
    side: dict[str, Any] = {"xytext": (5, 4)} if variant.pieces is None else {"xytext": (-5, -9), "ha": "right"}
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


def _name(variant: Variant) -> str:
    """Text that distinguishes a solution from others of its method."""
    return by(variant.points)


def _legend(report: Any) -> list[Any]:
    """Handles of the methods that are drawn."""
    from matplotlib.lines import Line2D

    labels = {
        "deterministic": "deterministic: points",
        "stochastic": "stochastic: points",
    }
    drawn = dict.fromkeys(s.variant.method for s in report.solutions[1:])
    handles = [Line2D([], [], ls="", color=_METHODS[m][0], marker=_METHODS[m][1], ms=7, label=labels[m]) for m in drawn]
    handles.append(Line2D([], [], color=_GREY, ls="--", lw=1, label="time of the reference"))
    handles.append(Line2D([], [], color=_GREY, ls="", marker="_", ms=13, mew=2, label="budget"))
    wanted = f"{100 * report.plan.accuracy:.3g} %"
    handles.append(Line2D([], [], color=_GREY, ls=":", lw=1, label=wanted))
    if report.recommended is not None:
        ring = Line2D([], [], color=_GREY, ls="", marker="o", ms=12, mfc="none", label="recommended")
        handles.append(ring)
    return handles


@dataclass(frozen=True)
class Comparison:
    """Distance of a solution from the reference, on loading and on unloading."""

    loading: LeakageFactor
    unloading: LeakageFactor


@dataclass(frozen=True, eq=False)
class Solution:
    """One solution of the scene.

    seconds : wall time. expected_seconds, expected_memory : expected before the run, on one core [s], [byte].
    leakage : per length of seal at every step [m²/s]; the median of drawn seals; NaN: failed.
    closing_load : lowest loading step that is closed [Pa]; inf if none is.
    comparison : with the reference. failures : one line each. budget : its error budget; None: failed.
    """

    variant: Variant
    seconds: float
    expected_seconds: float
    expected_memory: float
    leakage: NDArray[np.float64]
    closing_load: float
    comparison: Comparison
    failures: tuple[str, ...]
    budget: ErrorBudget | None = None

    @property
    def widest_band(self) -> WidestBand | None:
        """The widest band of the budget at loads that leak more than 1e-3 of the first; None: failed."""
        return None if self.budget is None else widest_band(self.budget)

    def is_within(self, accuracy: float) -> bool:
        """Whether measured error and budget are within an accuracy, a fraction, and nothing is closed or failed."""
        found, first = self.widest_band, self.comparison
        if found is None or not found.half_width <= np.log1p(accuracy):
            return False
        branches = [branch for branch in (first.loading, first.unloading) if branch.loads or branch.closed]
        errors = [abs(np.log(branch.value)) for branch in branches if branch.loads]
        clean = not any(branch.closed or branch.failed for branch in (first.loading, first.unloading))
        return clean and bool(errors) and max(errors) <= np.log1p(accuracy)


@dataclass(frozen=True, eq=False)
class AccuracyReport:
    """Times and errors of the solutions of a scene, the reference first.

    plan : the case, planned and skipped solutions. workers : processes.
    """

    plan: Plan
    solutions: tuple[Solution, ...]
    workers: int

    @property
    def recommended(self) -> Solution | None:
        """The cheapest solution whose measured error and budget are within the accuracy wanted; None if none is.

        It is one of the case's own method if there is such a one. The accuracy is that of the case, else 10 %.
        """
        good = [s for s in self.solutions if s.is_within(self.plan.accuracy)]
        own = [s for s in good if s.variant.method == self.plan.prepared.answer.name]
        return min(own or good, key=lambda s: s.seconds, default=None)

    @property
    def advice(self) -> str:
        """The recommended solution as text, and how it was found."""
        wanted = f"{100 * self.plan.accuracy:.3g} %"
        if (best := self.recommended) is None:
            return f"no solution has both its measured error and its budget within {wanted}"
        return f"recommended: {best.variant.label}, the cheapest with measured error and budget within {wanted}"

    @property
    def warnings(self) -> list[str]:
        """Failures, one line each; empty if there are none."""
        return [f"{s.variant.label}: {text}" for s in self.solutions for text in s.failures]

    def rows(self) -> list[dict[str, Any]]:
        """One dictionary for each solution, in SI; keys carry the units."""
        rows = []
        for solution in self.solutions:
            variant = solution.variant
            row: dict[str, Any] = {
                "method": variant.method,
                "points_1": variant.points[0],
                "points_2": variant.points[1],
                "pieces_1": None if variant.pieces is None else variant.pieces[0],
                "pieces_2": None if variant.pieces is None else variant.pieces[1],
                "seconds": solution.seconds,
            }
            found = solution.widest_band
            row["budget_factor"] = found and or_none(np.exp(found.half_width))
            row["budget_limit"] = found and found.limit
            row["recommended"] = solution is self.recommended
            for branch in ("loading", "unloading"):
                row |= {f"{branch}_{name}": v for name, v in _plain(getattr(solution.comparison, branch)).items()}
            rows.append(row | {"closing_load_Pa": or_none(solution.closing_load)})
        return rows

    def csv_text(self) -> str:
        """The rows as comma-separated values with one line of column names; empty where there is no number."""
        return comma_separated(self.rows())

    def json_text(self) -> str:
        """All data, with the case in SI, versions and machine; null in place of NaN."""
        plan = self.plan
        found = {
            "source": f"femseal {versions()['femseal']}",
            "versions": versions(),
            "platform": f"{platform.system()} {platform.machine()}",
            "cores": os.cpu_count(),
            "workers": self.workers,
            "seed": plan.case.seed,
            "case": plan.case.echo(),
            "surface": plan.prepared.surface_report,
            "reference": plan.reference.label,
            "against": plan.against,
            "accuracy": plan.accuracy,
            "recommended": None if self.recommended is None else self.recommended.variant.label,
            "compared_above_share_of_first_load": FLOOR,
            "steps": [
                {"name": s.name, "nominal_pressure_Pa": s.pressure, "unloaded_from_Pa": s.unloaded_from}
                for s in plan.prepared.scene.steps
            ],
            "solutions": [
                _as_dictionary(solution) | {"recommended": solution is self.recommended} for solution in self.solutions
            ],
            "skipped": [{"solution": what, "reason": reason} for what, reason in plan.skipped],
            "warnings": self.warnings,
        }
        return json.dumps(found, ensure_ascii=False, indent=1, allow_nan=False) + "\n"

    def table(self) -> TextTable:
        """The table for a terminal of 80 columns, for `rich.print`; each method has a line of its own."""
        heads = "method", "points", "pieces", "time [s]", "loading", "unloading", "budget"
        lines = []
        methods = [s.variant.method for s in self.solutions]  # in the order of their first solutions
        for solution in sorted(self.solutions, key=lambda s: methods.index(s.variant.method)):
            own = _own_cells(solution, "→" if solution is self.recommended else " ")
            closes = to_text(solution.closing_load, "Pa", 3) if isfinite(solution.closing_load) else "–"
            factors = (_factor_text(f) for f in (solution.comparison.loading, solution.comparison.unloading))
            lines.append((solution.variant.method, *own, *factors, _budget_text(solution), closes))
        shut = any(s.comparison.loading.closed or s.comparison.unloading.closed for s in self.solutions)
        return TextTable(
            "factors of leakage, exp(rms ln ratio); stochastic: of the median",
            (*heads, "closes at"),
            tuple(lines),
            grouped=True,
            wrap=6,
            notes=(
                self.plan.against,
                *(["+1: and one load at which only one of the two is closed"] if shut else []),
                "budget: widest 95 % band of error at a load that leaks, as a factor",
                f"→ {self.advice}",
            ),
        )

    def plot(self) -> Figure:
        """Error over time, see `accuracy_figure`."""
        return accuracy_figure(self)

    def write(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write `accuracy.json`, `accuracy.csv` and `accuracy.png`; a file is complete, or not there.

        Raises InputError: the folder cannot be made.
        """
        path = made_folder(folder)
        picture = path / "accuracy.png"
        # remove the picture of an earlier comparison, which would stay if drawing failed
        picture.unlink(missing_ok=True)
        written = [
            write_text(path / "accuracy.json", self.json_text()),
            write_text(path / "accuracy.csv", self.csv_text()),
        ]
        figure = self.plot()
        with replacing(picture) as temporary:
            figure.savefig(temporary)
        return [*written, picture]


def _own_cells(solution: Solution, mark: str) -> list[str]:
    variant = solution.variant
    return [
        f"{mark}{by(variant.points)}",
        "" if variant.pieces is None else by(variant.pieces),
        f"{solution.seconds:.2f}" if solution.seconds < 10 else f"{solution.seconds:.3g}",
    ]


def _factor_text(factor: LeakageFactor) -> str:
    more = f" +{factor.closed}" if factor.closed else ""
    if isnan(factor.value):
        return ("failed" if factor.failed else "–") + more
    return _short(factor.value) + more


def _short(factor: float) -> str:
    return f"{factor:.3g}" if factor < 1e4 else f"{factor:.0e}"


def _budget_text(solution: Solution) -> str:
    if (found := solution.widest_band) is None:
        return "failed"
    factor = float(np.exp(found.half_width))
    return _short(factor) if isfinite(factor) else "–"


def _as_dictionary(solution: Solution) -> dict[str, Any]:
    """A solution as plain data, for the file of the report."""
    return {
        **asdict(solution.variant),
        "seconds": solution.seconds,
        "expected_seconds_one_core": solution.expected_seconds,
        "expected_memory_bytes": solution.expected_memory,
        "leakage_m2_per_s": [or_none(float(q)) for q in solution.leakage],
        "closing_load_Pa": or_none(solution.closing_load),
        "budget": None if solution.budget is None else _budget(solution.budget),
        "loading": _plain(solution.comparison.loading),
        "unloading": _plain(solution.comparison.unloading),
        "failures": list(solution.failures),
    }


def _budget(budget: ErrorBudget) -> dict[str, Any]:
    found = widest_band(budget)
    return {
        "factor": or_none(np.exp(found.half_width)),
        "limit": found.limit,
        "parts": {name: or_none(np.exp(width)) for name, width in found.parts.items()},
        "lower_m2_per_s": [or_none(float(q)) for q in budget.lower],
        "upper_m2_per_s": [or_none(float(q)) for q in budget.upper],
    }


def _plain(factor: LeakageFactor) -> dict[str, Any]:
    values = asdict(factor)
    return {"factor": or_none(values.pop("value")), **values}


def or_none(value: float) -> float | None:
    """The number; None where it has no end or is unknown, for files that know neither."""
    return float(value) if isfinite(value) else None
