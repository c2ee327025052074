"""The design answer as gasket data sheets have it: tables for people, files for programs, and a picture."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from math import ceil, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import (
    AnyPath,
    Plotted,
    TextTable,
    comma_separated,
    counted,
    made_folder,
    to_text,
    write_bytes,
    write_text,
    writing,
)
from ..base.leak_rates import leak_classes
from ..base.leak_units import LEAK_UNITS, LeakUnit
from ..loads import relaxed
from ..plots.drawing import (
    GREY,
    LEGEND_LINE,
    LINES,
    Sheet,
    branch_styles,
    decades,
    legend_below,
    png,
    shows,
)
from ..plots.leakage_curves import LeakageCurves, leakage_panel, limit_lines
from ..report import write_report
from ..report.report_tables import DESIGN_FILE, DESIGN_PICTURE
from ..results.dataset import FILE_NAME
from ..results.results import Results, force_scale, loads_as_given
from ..results.tables import kind_of
from ..results.variables import pressures_and_peaks
from ..results.verdict import (
    LoadText,
    NeededPressure,
    Verdict,
    short_loads,
    verdict_table,
    verdicts_in_words,
    verdicts_of,
)
from .requirements import ENDS, Requirement, Seals
from .sensitivities import Sensitivity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Design(Plotted):
    """What a seal needs, see `design`.

    results : of the run. seals : the leakages that decide. probability : fraction of the seals of which the pressure
    is given beside. requirements : Qmin and QSmin of every class. relaxation : fraction of the load in assembly that is
    lost before service. sealing : load from which on nothing leaks. at : class and nominal
    pressure [Pa] of the sensitivities; NaN where there is none. sensitivities : what changes the leakage.
    notes : what to keep in mind, one line each.
    """

    results: Results
    seals: Seals
    probability: float
    requirements: tuple[Requirement, ...]
    relaxation: float
    sealing: NeededPressure
    at: tuple[str, float]
    sensitivities: tuple[Sensitivity, ...]
    notes: tuple[str, ...]

    @property
    def stiffness(self) -> dict[float, float]:
        """Secant stiffness of the faces from pressures in assembly Q_A to a third of them, by Q_A [Pa], in Pa/m.

        E_G of EN 13555 is that times the thickness of the gasket, which faces do not have. The mean gap is straight in
        ln(pressure) between the steps of the unloading. Not known of drawn seals, and where that ends above the third.
        """
        data, found = self.results.dataset, {}
        for peak in self.seals.steps.unload_from if "mean_gap" in data else ():
            steps = self.seals.falling(peak)[::-1]
            steps = steps[self.seals.steps.pressures[steps] > 0]
            pressure = np.log(self.seals.steps.pressures[steps])
            gap = data["mean_gap"].values[steps]
            if pressure[0] <= (third := np.log(peak / 3)) + 1e-9:
                found[peak] = 2 / 3 * peak / (np.interp(third, pressure, gap) - gap[-1])
        return found

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Whether each class is met and from which load on: the verdict of the report."""
        return verdicts_of(self.results, [(need.name, need.limit) for need in self.requirements])

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """The unit of leakage, that of the first class, and the leakage per length that is 1 in it [m²/s]."""
        unit = self.results.leak_unit
        if self.requirements:
            unit = LEAK_UNITS[leak_classes([self.requirements[0].name])[0].unit]
        return unit, self.results.class_basis.factor(unit)

    @property
    def load_text(self) -> LoadText:
        """A pressure as text, with the force that makes it where the loads of the case are forces."""
        return loads_as_given(self.results.dataset, 3)

    def table(self) -> Any:
        """The data sheet for a terminal, to be given to `rich.print`."""
        from rich.console import Group
        from rich.markup import escape

        return Group(*map(escape, sheet_sentences(self)), *sheet_tables(self))

    def write(self, folder: AnyPath) -> list[Path]:
        """Write `design.csv`, `design.json` and `design.png`; the report of results in the folder shows them."""
        target = made_folder(folder)
        table, (unit, scale) = rows(self), self.leak_scale
        content = {
            "case": self.results.case,
            "probability": self.probability,
            "seals": self.seals.count,
            "limits": {need.name: need.limit / scale for need in self.requirements},
            "limits_unit": unit.name,
            "figures": table,
            "sentences": sheet_sentences(self),
            "tables": [
                {"title": table.title, "heads": table.heads, "lines": table.lines}
                for table in sheet_tables(self)
            ],
        }
        with writing("output", target, "a folder"):
            written = [
                write_bytes(target / DESIGN_PICTURE, png(design_figure(self))),
                write_text(target / TABLE_FILE, comma_separated(table)),
                write_text(target / DESIGN_FILE, json.dumps(content, indent=1, ensure_ascii=False)),
            ]
            return [*written, *([write_report(target)] if (target / FILE_NAME).is_file() else [])]

    def __repr__(self) -> str:
        needs = "; ".join(
            f"{need.name}: Qmin {need.assembly.text(self.load_text)}" for need in self.requirements
        )
        return f"<femseal.Design of {counted(self.seals.count, 'seal')}, probability {self.probability:g}: {needs}>"

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in sheet_tables(self))


@shows(Design)
def design_figure(answer: Design) -> Figure:
    """Leakage with its interval over the load of the case: limits of classes, Qmin, QSmin."""
    unit, scale = answer.leak_scale
    seals = answer.seals
    curve = seals.curve
    band, band_name = None, "95 % interval"
    if curve.has_interval:
        band = curve.lower, curve.upper
    elif seals.count > 1:
        band = seals.curve_of(ENDS[0]), seals.curve_of(ENDS[1])
        band_name = f"{100 * ENDS[0]:g} – {100 * ENDS[1]:g} % of the seals"
    curves = LeakageCurves(
        *pressures_and_peaks(seals.steps),
        np.where(np.isfinite(curve.leakage), curve.leakage, np.nan),
        "",
        band=band,
        band_name=band_name,
        scale=(scale, f"{kind_of(unit)} [{unit.name}]"),
        force=force_scale(answer.results.dataset),
    )
    below = LEGEND_LINE * ceil((len(seals.steps.unload_from) + 6) / 2)
    sheet = Sheet([4.4 + below])
    axes = sheet.panel(0, replace(LINES, right=1.2, top=0.2, bottom=0.7 + below))
    handles = leakage_panel(axes, curves)
    # a named line for each class whose limit is within three decades of the leakages
    least, most = axes.get_ylim()
    limits = {need.name: need.limit / scale for need in answer.requirements}
    near = [limit for limit in limits.values() if 1e-3 * least < limit < 1e3 * most]
    axes.set_ylim(min([least, *(x / 2 for x in near)]), max([most, *(2 * x for x in near)]))
    decades(axes.yaxis)
    limit_lines(axes, limits)
    legend_below(sheet.figure, handles + _marks(axes, answer, scale, curves.load_scale[1]))
    return sheet.figure


def _marks(axes: Axes, answer: Design, scale: float, load_factor: float) -> list[Any]:
    """Qmin on the loading and QSmin on the unloadings, each with its uncertainty; returns handles of the legend.

    scale : leakage that is 1 on the axis. load_factor : load on the axis at a nominal pressure of 1 Pa.
    """
    from matplotlib.lines import Line2D

    # branches are drawn from the highest peak
    peaks = sorted(answer.seals.steps.unload_from, reverse=True)
    looks = dict(zip([None, *peaks], branch_styles(1 + len(peaks)), strict=True))
    for need in answer.requirements:
        for peak, needed in [(None, need.assembly), *need.service.items()]:
            if not np.isfinite(needed.at) or not need.limit > 0:
                continue
            x, y = load_factor * needed.at, need.limit / scale
            colour = looks[peak]["color"]
            ends = [load_factor * needed.bound(end) for end in (needed.low, needed.value)]
            marker, above = ("v", 7) if peak is None else ("^", -15)
            axes.plot(ends, [y, y], color=colour, lw=3.5, alpha=0.45, zorder=4)
            axes.plot(x, y, color=colour, marker=marker, ms=9, mec="black", zorder=5)
            text, at = answer.load_text(needed.at), (4, above)
            axes.annotate(text, (x, y), at, textcoords="offset points", fontsize=8, zorder=6)
    handles = [
        Line2D([], [], color="white", marker=marker, ms=8, mec="black", label=f"{name} as computed")
        for marker, name in (("v", "Qmin"), ("^", "QSmin"))
    ]
    band = Line2D([], [], color=GREY, lw=3.5, alpha=0.45, label="up to the whole 95 % interval")
    return [*handles, band]


TABLE_FILE = "design.csv"


def sheet_tables(answer: Design) -> list[TextTable]:
    """A line for each class, with Qmin and with QSmin by the pressure in assembly; and what changes them most."""
    needs, peaks = answer.requirements, answer.seals.steps.unload_from
    shown = short_loads(answer.results)
    more: list[tuple[str, list[str]]] = []
    if answer.seals.count > 1:
        texts = [need.of_seals.words(need.of_seals.value, shown) for need in needs]
        more.append(
            (f"Qmin(L) of {100 * answer.probability:.4g} % of the seals, as computed", texts)
        )
    lost = answer.relaxation
    if lost:
        texts = [need.relaxed.text(shown) if need.relaxed else "" for need in needs]
        more.append((f"Qmin(L), {100 * lost:.3g} % relaxation", texts))
    for q in peaks if lost else ():
        left = relaxed(q, lost)
        is_enough = [need.service[q].value <= left for need in needs]
        head = f"{shown(left)}, which relaxation leaves of {shown(q)}"
        more.append((head, ["enough" if one else "too low" for one in is_enough]))
    table = verdict_table(
        answer.results, answer.verdicts, more, names=("Qmin(L)", "QSmin(L), Q_A = {}")
    )
    tables = [replace(table, title="Load in assembly (Qmin) and in service (QSmin)")]
    if answer.sensitivities:
        found = answer.sensitivities
        name, load = answer.at
        place = f"at {answer.load_text(load)} on loading{name and f', Qmin of {name}'}"
        columns = [
            ("quantity x", [one.quantity for one in found]),
            ("d ln L / d ln x", [_slope_text(one.leakage) for one in found]),
            ("d ln Qmin / d ln x", [_slope_text(one.pressure) for one in found]),
            ("how", [one.how for one in found]),
        ]
        title = f"What changes leakage L and Qmin, {place}"
        tables.append(TextTable.of_columns(title, columns, names=len(columns)))
    return tables


def _slope_text(slope: float) -> str:
    return f"{slope:+.2f}" if isfinite(slope) else "–"


def sheet_sentences(answer: Design) -> list[str]:
    """The verdict on each class, what the tables are of, the sealing load, and what to keep in mind."""
    data, count = answer.results.dataset, answer.seals.count
    prefix = "test_" if "test_leakage" in data else ""
    ends = " to ".join(
        to_text(data.attrs[f"{prefix}{end}_pressure_Pa"], "Pa") for end in ("inlet", "outlet")
    )
    fluid = f"{data.attrs[f'{prefix}fluid']}, from {ends}"
    width, length = (to_text(side, "m") for side in data.attrs["seal_size_m"])
    shown = answer.load_text
    found = [" ".join(one) for one in verdicts_in_words(answer.verdicts, shown)]
    found.append(f"A seal {width} wide and {length} long; {fluid}.")
    found.append(
        "Qmin is the load in assembly from which on a class is met, QSmin that down to which it is kept after an "
        "assembly at Q_A."
    )
    if count > 1:
        found.append(
            f"They are those of the median of {count} seals; the interval holds their scatter. What "
            f"{100 * answer.probability:.4g} % of them need as computed stands beside."
        )
    found.append(f"It seals without any leakage {answer.sealing.text(shown)}.")
    for peak, stiffness in answer.stiffness.items():
        found.append(
            f"From Q_A = {shown(peak)} to a third of it the faces part with {stiffness / 1e12:.3g} MPa/µm. Times the "
            "thickness of a gasket that is E_G of EN 13555; faces have none."
        )
    return found + [f"{note[0].upper()}{note[1:]}." for note in answer.notes]


#: Columns of `design.csv`.
_COLUMNS = ("figure", "class", "assembly_pressure_Pa", "relation", "value", "load", "computed", "low", "high",
            "how")  # fmt: skip


def rows(answer: Design) -> list[dict[str, Any]]:
    """All figures, one dictionary each: pressures in Pa, slopes and factors without unit."""
    pressures: list[tuple[str, str, float | None, NeededPressure]] = []
    for need in answer.requirements:
        pressures.append(("Qmin [Pa]", need.name, None, need.assembly))
        if answer.seals.count > 1:
            figure = f"Qmin of {100 * answer.probability:.4g} % of the seals [Pa]"
            pressures.append((figure, need.name, None, need.of_seals))
        if need.relaxed is not None:
            pressures.append(("Qmin with relaxation [Pa]", need.name, None, need.relaxed))
        pressures += [("QSmin [Pa]", need.name, *pair) for pair in need.service.items()]
    pressures.append(("sealing load [Pa]", "", None, answer.sealing))
    found: list[dict[str, Any]] = []

    def add(*values: Any, **more: Any) -> None:
        found.append(dict.fromkeys(_COLUMNS) | dict(zip(_COLUMNS, values, strict=False)) | more)

    for figure, name, peak, needed in pressures:
        value = needed.bound(needed.value)
        # None where an end lies beyond the loads or is unknown
        ends = {"computed": needed.computed, "low": needed.low}
        known = {key: p for key, p in ends.items() if isfinite(p) and p > 0}
        known |= {"high": needed.value} if needed.known else {}
        add(figure, name, peak, needed.relation, value, load=answer.load_text(value), **known)
    for peak, stiffness in answer.stiffness.items():
        how = "secant of the mean gap to Q_A / 3"
        add("E_G over thickness [Pa/m]", None, peak, "=", stiffness, how=how)
    for one in answer.sensitivities:
        for what, slope in (("L", one.leakage), ("Qmin", one.pressure)):
            figure = f"d ln {what} / d ln {one.quantity}"
            add(figure, *answer.at, "=", slope if isfinite(slope) else None, how=one.how)
    return found
