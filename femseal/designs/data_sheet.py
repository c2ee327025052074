"""Present the answer of a design like the data sheet of a gasket: tables, files for other programs, and a picture."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import (
    AnyPath,
    InputError,
    Plotted,
    TextTable,
    comma_separated,
    counted,
    made_folder,
    to_text,
    write_text,
    writing,
)
from ..base.leak_classes import find_leak_classes
from ..base.leak_units import LEAK_UNITS, LeakUnit
from ..loads import relaxed
from ..plots.drawing import shows
from ..plots.style import write_figure
from ..report import write_report
from ..report.report_tables import DESIGN_FILE, DESIGN_PICTURE
from ..results.dataset_file import FILE_NAME
from ..results.load_steps import load_format
from ..results.needed_pressure import LoadText, NeededPressure
from ..results.results import Results
from ..results.sealing_index import SealingIndex, indices_of_limits
from ..results.verdict import Verdict, verdicts_of
from ..results.verdict_paragraphs import verdict_lines
from ..results.verdict_text import required_loads, verdict_table
from .index_table import index_rows, index_sentence, index_table
from .requirements import Requirement, Seals
from .requirements_figure import requirements_figure
from .sensitivities import Sensitivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Name of the file with all figures, in the folder of the answer.
TABLE_FILE = "design.csv"
#: Columns of this file.
_COLUMNS = (
    "figure",
    "class",
    "assembly_pressure_Pa",
    "relation",
    "value",
    "load",
    "computed",
    "low",
    "high",
    "how",
)


@dataclass(frozen=True, eq=False, repr=False)
class Design(Plotted):
    """Pressures at which a seal meets its leakage classes, and sensitivities of its leakage, see `design`.

    Parameters
    ----------
    results : Results
        Results of the run.
    seals : Seals
        Leakages of the realisations, which are compared with leakage classes.
    probability : float
        Fraction of the realisations that must meet the class at the additional Qmin, see `design`.
    requirements : tuple of Requirement
        Qmin and QSmin, one item for each leakage class.
    relaxation : float
        Fraction of the load in assembly that is lost before service.
    sealing : NeededPressure
        Lowest pressure in assembly at which the seal does not leak.
    at : pair (str, float)
        Leakage class, and the nominal pressure [Pa] at which the sensitivities are computed, normally Qmin of this
        class. If another pressure had to be used, the class is "". The pressure is NaN if the sensitivities cannot be
        computed.
    sensitivities : tuple of Sensitivity
        Logarithmic slopes of the leakage with respect to every quantity.
    notes : tuple of str
        Notes for the user, for example on results that were left out.
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
        """Secant stiffness of the interface [Pa/m] for unloading from Q_A to Q_A/3, by pressure in assembly Q_A.

        The stiffness is (Q_A − Q_A/3) / (h(Q_A/3) − h(Q_A)), with the mean gap h during unloading. Because an interface
        has no thickness, the modulus E_G of a gasket in EN 13555 is this stiffness times the gasket thickness.
        Between unloading steps, the mean gap is interpolated linearly over ln(pressure). Stochastic runs have no
        stiffness. A pressure Q_A is left out if the unloading from Q_A ends above Q_A/3.
        """
        data = self.results.dataset
        if "mean_gap" not in data:
            return {}
        stiffness = {}
        for peak in self.seals.steps.unload_from:
            # rising pressures, as `interp` needs
            from_lowest = self.seals.steps_from_highest(peak)[::-1]
            pressures = self.seals.steps.pressures[from_lowest]
            is_loaded = pressures > 0
            gap = data["mean_gap"].values[from_lowest][is_loaded]
            log_pressure = np.log(pressures[is_loaded])
            log_third = np.log(peak / 3)
            if log_pressure[0] > log_third + 1e-9:
                continue
            gap_at_third = np.interp(log_third, log_pressure, gap)
            gap_at_peak = gap[-1]
            stiffness[peak] = (peak - peak / 3) / (gap_at_third - gap_at_peak)
        return stiffness

    @property
    def sealing_indices(self) -> tuple[SealingIndex, ...]:
        """Sealing index at which each leakage class is met, for loading and for each unloading.

        The tuple is empty if the run does not determine a sealing index, for example because the pressure differs over
        the seal. The data sheet then states the reason.
        """
        return self._indices_or_reason[0]

    @cached_property
    def _indices_or_reason(self) -> tuple[tuple[SealingIndex, ...], str]:
        """Sealing indices, and, if there are none, the reason."""
        limits = {need.name: need.limit for need in self.requirements}
        try:
            return indices_of_limits(self.results, limits), ""
        except InputError as error:
            return (), f"the run has {error.given}. It takes {error.expected}"

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdicts of the report, which say whether the seal meets each leakage class, and from which load."""
        return verdicts_of(self.results, [(need.name, need.limit) for need in self.requirements])

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """Leakage unit of the first class, and its size as a leakage per length of seal [m²/s]."""
        unit = self.results.leak_unit
        if self.requirements:
            first_class = find_leak_classes([self.requirements[0].name])[0]
            unit = LEAK_UNITS[first_class.unit]
        return unit, self.results.class_basis.factor(unit)

    @property
    def load_text(self) -> LoadText:
        """Function that formats a nominal pressure [Pa], and adds the force if the loads of the case are forces."""
        return load_format(self.results.dataset, 3).full

    def table(self) -> Any:
        """Make the data sheet for a terminal, for `rich.print`."""
        from rich.console import Group
        from rich.markup import escape

        return Group(*map(escape, sheet_sentences(self)), *sheet_tables(self))

    def write(self, folder: AnyPath) -> list[Path]:
        """Write `design.csv`, `design.json` and `design.png`.

        The picture is also written in all other `picture_formats` of the case. If the folder contains results, their
        report is rewritten to include the answer.

        Parameters
        ----------
        folder : path
            Folder to write into, which is created if it does not exist.

        Returns
        -------
        list of Path
            Paths of all written files.
        """
        target = made_folder(folder)
        figures = rows(self)
        unit, scale = self.leak_scale
        content = {
            "case": self.results.case,
            "probability": self.probability,
            "seals": self.seals.count,
            "limits": {need.name: need.limit / scale for need in self.requirements},
            "limits_unit": unit.name,
            "figures": figures,
            "sentences": sheet_sentences(self),
            "tables": [
                {"title": table.title, "heads": table.heads, "lines": table.lines}
                for table in sheet_tables(self)
            ],
        }
        text = json.dumps(content, indent=1, ensure_ascii=False)
        with writing("output", target, "a folder"):
            written = [
                write_text(target / TABLE_FILE, comma_separated(figures)),
                write_text(target / DESIGN_FILE, text),
            ]
            case_formats = self.results.case.get("output", {}).get("picture_formats", ())
            formats = list(dict.fromkeys(["png", *case_formats]))
            written += write_figure(design_figure(self), target, Path(DESIGN_PICTURE).stem, formats)
            if (target / FILE_NAME).is_file():
                written.append(write_report(target))
            return written

    def __repr__(self) -> str:
        needs = [f"{n.name}: Qmin {n.assembly.text(self.load_text)}" for n in self.requirements]
        seals = counted(self.seals.count, "seal")
        probability = f"probability {self.probability:g}"
        return f"<femseal.Design of {seals}, {probability}: {'; '.join(needs)}>"

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in sheet_tables(self))


@shows(Design)
def design_figure(answer: Design) -> Figure:
    """Draw the leakage and its 95 % interval over the load, with the limits of the classes, Qmin and QSmin."""
    return requirements_figure(
        answer.seals,
        answer.requirements,
        answer.leak_scale,
        load_format(answer.results.dataset),
        answer.load_text,
    )


# --- tables and sentences ---------------------------------------------------------------------------------


def sheet_tables(answer: Design) -> list[TextTable]:
    """Make the tables of the data sheet.

    The first table contains Qmin and QSmin of each class. It is followed by a table of the sensitivities and a table of
    the sealing indices, if the answer contains any.
    """
    columns = _columns_of_realisations(answer) + _columns_of_relaxation(answer)
    names = ("Qmin(L)", "QSmin(L), Q_A = {}")
    needs = verdict_table(answer.results, answer.verdicts, columns, names=names)
    tables = [replace(needs, title="Load in assembly (Qmin) and in service (QSmin)")]
    if answer.sensitivities:
        tables.append(_sensitivity_table(answer))
    indices = answer.sealing_indices
    if indices:
        tables.append(index_table(indices))
    return tables


def _columns_of_realisations(answer: Design) -> list[tuple[str, list[str]]]:
    """Return the heading and the cells of the column with Qmin of each class for a fraction of the realisations.

    The list of columns is empty if the run has a single realisation.
    """
    if answer.seals.count == 1:
        return []
    load_text = load_format(answer.results.dataset, 3).short
    texts = [
        need.for_fraction.words(need.for_fraction.value, load_text) for need in answer.requirements
    ]
    head = f"Qmin(L) of {100 * answer.probability:.4g} % of the seals, as computed"
    return [(head, texts)]


def _columns_of_relaxation(answer: Design) -> list[tuple[str, list[str]]]:
    """Return the headings and the cells of the columns on relaxation; an empty list for a case without relaxation.

    Each column has one cell for each leakage class. The first column contains Qmin with relaxation. For each pressure
    in assembly Q_A, another column says whether the seal still meets the class after relaxation has reduced Q_A.
    """
    relaxation = answer.relaxation
    if not relaxation:
        return []
    load_text = load_format(answer.results.dataset, 3).short
    needs = answer.requirements
    texts = [need.relaxed.text(load_text) if need.relaxed else "" for need in needs]
    columns = [(f"Qmin(L), {100 * relaxation:.3g} % relaxation", texts)]
    for peak in answer.seals.steps.unload_from:
        load_left = relaxed(peak, relaxation)
        texts = ["enough" if need.service[peak].value <= load_left else "too low" for need in needs]
        head = f"{load_text(load_left)}, left of {load_text(peak)} after relaxation"
        columns.append((head, texts))
    return columns


def _sensitivity_table(answer: Design) -> TextTable:
    """Make the table of the sensitivities of leakage and Qmin."""
    class_name, pressure = answer.at
    load = f"{answer.load_text(pressure)} on loading"
    if class_name:
        load += f", Qmin of {class_name}"
    columns = [
        ("quantity x", [s.quantity for s in answer.sensitivities]),
        ("d ln L / d ln x", [_slope_text(s.leakage) for s in answer.sensitivities]),
        ("d ln Qmin / d ln x", [_slope_text(s.pressure) for s in answer.sensitivities]),
        ("how", [s.how for s in answer.sensitivities]),
    ]
    title = f"What changes leakage L and Qmin, at {load}"
    return TextTable.of_columns(title, columns, names=len(columns))


def _slope_text(slope: float) -> str:
    """Format a logarithmic slope with its sign, or return a dash for an unknown slope."""
    return f"{slope:+.2f}" if isfinite(slope) else "–"


def sheet_sentences(answer: Design) -> list[str]:
    """Write the sentences of the data sheet: verdicts on the classes, conditions, sealing load, stiffness and notes."""
    data = answer.results.dataset
    load_text = answer.load_text
    sentences = verdict_lines(answer.results, answer.verdicts)
    prefix = "test_" if "test_leakage" in data else ""  # of the attributes of the compared fluid
    fluid = data.attrs[f"{prefix}fluid"]
    inlet = to_text(data.attrs[f"{prefix}inlet_pressure_Pa"], "Pa")
    outlet = to_text(data.attrs[f"{prefix}outlet_pressure_Pa"], "Pa")
    width, length = (to_text(side, "m") for side in data.attrs["seal_size_m"])
    sentences.append(
        f"The seal is {width} wide and {length} long. The fluid ({fluid}) flows from {inlet} to {outlet}."
    )
    sentences.append(
        "Qmin is the lowest load in assembly at which a class is met. QSmin is the load to which the seal may be "
        "unloaded in service after it was assembled at Q_A."
    )
    count = answer.seals.count
    if count > 1:
        sentences.append(
            f"Both are for the median of {count} realisations; the 95 % interval includes their scatter. A further "
            f"column gives Qmin for {100 * answer.probability:.4g} % of the realisations, from their computed leakage."
        )
    sentences.append(f"The seal is completely tight {required_loads(answer.sealing, load_text)}.")
    for peak, stiffness in answer.stiffness.items():
        sentences.append(
            f"The unloading stiffness from Q_A = {load_text(peak)} to a third of it is {stiffness / 1e12:.3g} MPa/µm. "
            "E_G of EN 13555 is this stiffness times the gasket thickness."
        )
    sentences.append(index_sentence(answer._indices_or_reason[1]))
    sentences += [f"{note[0].upper()}{note[1:]}." for note in answer.notes]
    return sentences


# --- figures for programs ---------------------------------------------------------------------------------


def rows(answer: Design) -> list[dict[str, Any]]:
    """List all numerical results of the answer as table rows, with pressures in Pa."""
    figures = [
        *(row for need in answer.requirements for row in _rows_of_requirement(answer, need)),
        _pressure_row(answer, "sealing load [Pa]", "", None, answer.sealing),
    ]
    for peak, stiffness in answer.stiffness.items():
        figures.append(
            _row(
                figure="E_G over thickness [Pa/m]",
                assembly_pressure_Pa=peak,
                relation="=",
                value=stiffness,
                how="secant of the mean gap to Q_A / 3",
            )
        )
    class_name, pressure = answer.at
    for sensitivity in answer.sensitivities:
        for symbol, slope in (("L", sensitivity.leakage), ("Qmin", sensitivity.pressure)):
            row = _row(
                figure=f"d ln {symbol} / d ln {sensitivity.quantity}",
                assembly_pressure_Pa=pressure,
                relation="=",
                value=slope if isfinite(slope) else None,
                how=sensitivity.how,
            )
            figures.append(row | {"class": class_name})
    figures += [_row() | row for row in index_rows(answer.sealing_indices)]
    return figures


def _rows_of_requirement(answer: Design, need: Requirement) -> list[dict[str, Any]]:
    """List the table rows for one leakage class, with the pressures required to meet it."""
    name = need.name
    figures = [_pressure_row(answer, "Qmin [Pa]", name, None, need.assembly)]
    if answer.seals.count > 1:
        figure = f"Qmin of {100 * answer.probability:.4g} % of the seals [Pa]"
        figures.append(_pressure_row(answer, figure, name, None, need.for_fraction))
    if need.relaxed is not None:
        figure = "Qmin with relaxation [Pa]"
        figures.append(_pressure_row(answer, figure, name, None, need.relaxed))
    for peak, needed in need.service.items():
        figures.append(_pressure_row(answer, "QSmin [Pa]", name, peak, needed))
    return figures


def _pressure_row(
    answer: Design, figure: str, class_name: str, peak: float | None, needed: NeededPressure
) -> dict[str, Any]:
    """Make the table row for a pressure required to meet a leakage class.

    The columns "computed", "low" and "high" contain the pressure that follows from the computed leakage, and the lower
    and upper limits of the 95 % interval of the required pressure. A cell is empty if the pressure is unknown or
    outside the loads of the case.
    """
    value = needed.bound(needed.value)
    row = _row(
        figure=figure,
        assembly_pressure_Pa=peak,
        relation=needed.relation,
        value=value,
        load=answer.load_text(value),
    )
    row["class"] = class_name
    for column, end in (("computed", needed.computed), ("low", needed.low)):
        if isfinite(end) and end > 0:
            row[column] = end
    if needed.known:
        row["high"] = needed.value
    return row


def _row(**cells: Any) -> dict[str, Any]:
    """Make a row of the table from the given cells, and leave the other cells empty."""
    return dict.fromkeys(_COLUMNS) | cells
