"""The design answer as gasket data sheets have it: tables for people, files for programs."""

from __future__ import annotations

import json
import os
from math import isfinite
from pathlib import Path
from typing import Any

from ..base.errors import InputError
from ..base.files import made_folder, replacing, write_text
from ..base.quantities import to_text
from ..base.text import TextTable, comma_separated
from ..loads import relaxed
from ..plots.drawing import png
from ..report import write_report
from ..report.case_text import fluid_text
from ..report.design_section import DESIGN_FILE, DESIGN_PICTURE
from ..results.netcdf import FILE_NAME
from ..results.tables import format_leakage
from .design_data import DesignData
from .design_picture import design_figure
from .requirements import NeededPressure
from .sensitivities import Slope

TABLE_FILE = "design.csv"


def sheet_tables(answer: DesignData) -> list[TextTable]:
    """A line for each class, with Qmin and with QSmin by the pressure in assembly; and what changes them most."""
    unit, scale = answer.leak_scale
    needs, peaks = answer.requirements, answer.seals.steps.unload_from
    columns = [
        ("class L", [need.name for need in needs]),
        (f"limit [{unit.name}]", [format_leakage(need.limit, scale) for need in needs]),
        ("Qmin(L)", [need.assembly.text() for need in needs]),
    ]
    lost = answer.relaxation
    if lost:
        texts = [need.relaxed.text() if need.relaxed else "" for need in needs]
        columns.append((f"Qmin(L), {100 * lost:.3g} % relaxation", texts))
    for q in peaks:
        left = relaxed(q, lost) if lost else None
        head = f"QSmin(L), Q_A = {to_text(q, 'Pa')}"
        columns.append((head, [_service_text(need.service[q], left) for need in needs]))
    tables = [TextTable.of_columns("Pressure in assembly and in service", columns, names=len(columns))]
    if answer.sensitivities:
        values = [one.leakage.value for one in answer.sensitivities]
        # the largest change of the leakage first, unknown ones last
        order = sorted(range(len(values)), key=lambda n: -abs(values[n]) if isfinite(values[n]) else 1.0)
        found = [answer.sensitivities[n] for n in order]
        place = f"at {to_text(answer.at[1], 'Pa', 3)} on loading" + (
            f", Qmin of {answer.at[0]}" if answer.at[0] else ""
        )
        columns = [
            ("quantity x", [one.quantity for one in found]),
            ("d ln L / d ln x", [one.leakage.text() for one in found]),
            ("d ln Qmin / d ln x", [one.pressure.text() for one in found]),
            ("how", [one.how for one in found]),
        ]
        title = f"What changes leakage L and Qmin most, {place}"
        tables.append(TextTable.of_columns(title, columns, names=len(columns)))
    return tables


def _service_text(needed: NeededPressure, left: float | None) -> str:
    """QSmin, and whether the pressure that relaxation leaves [Pa] is enough."""
    if needed.relation == ">":
        return "not met at Q_A"
    enough = "" if left is None else f"; {to_text(left, 'Pa')} is {'enough' if needed.value <= left else 'too low'}"
    return needed.text() + enough


def sheet_sentences(answer: DesignData) -> list[str]:
    """What the tables are of, the sealing load, the turned face, and what to keep in mind."""
    data, count = answer.results.dataset, answer.seals.count
    prefix = "test_" if "test_leakage" in data else ""
    ends = " to ".join(to_text(float(data.attrs[f"{prefix}{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet"))
    case = answer.results.case
    table = case.get("output", {}).get("test_fluid") if prefix else case.get("fluid")
    fluid = f"{fluid_text(table or {}, str(data.attrs[f'{prefix}fluid']))}, from {ends}"
    width, length = (to_text(float(side), "m") for side in data.attrs["seal_size_m"])
    found = [f"A seal {width} wide and {length} long; {fluid}."]
    if count > 1:
        found.append(
            f"Qmin and QSmin are nominal pressures that keep {answer.probability:.4g} of {count} seals in the class; "
            "in brackets the interval in which they lie with 90 %, by seals drawn again and the error of the library."
        )
    found.append("The load that seals without leakage: " + answer.sealing.text() + _band(answer.sealing, count) + ".")
    if answer.turned is not None:
        low, high = answer.turned.leakage.low, answer.turned.leakage.high
        band = f" ({low:.3g} to {high:.3g})" if isfinite(low) else ""
        text = f"With the face turned by 90° it leaks {answer.turned.leakage.value:.3g}{band} times as much"
        text += f" at {to_text(answer.at[1], 'Pa', 3)}"
        if answer.turned.need:
            text += f", and {answer.at[0]} takes {answer.turned.need}"
        found.append(f"{text} ({answer.turned.how}).")
    return found + [f"{note[0].upper()}{note[1:]}." for note in answer.notes]


def _band(needed: NeededPressure, count: int) -> str:
    band = needed.band_text()
    return f"; 5 and 95 % of the seals need {band}" if count > 1 and band != needed.text() else ""


def rows(answer: DesignData) -> list[dict[str, Any]]:
    """All figures, one dictionary each: pressures in Pa, slopes and factors without unit."""
    found: list[dict[str, Any]] = []

    def add(figure: str, name: str, assembly: float | None, needed: NeededPressure) -> None:
        found.append({
            "figure": figure, "class": name, "assembly_pressure_Pa": assembly, "relation": needed.relation,
            "value": needed.bound(needed.value), "low": _end(needed.low), "high": _end(needed.high),
            "seals_low": _end(needed.seals_low), "seals_high": _end(needed.seals_high), "how": "",
        })  # fmt: skip

    def add_slope(figure: str, name: str, slope: Slope, how: str) -> None:
        low, high = (end if isfinite(end) else None for end in (slope.low, slope.high))
        found.append({
            "figure": figure, "class": name, "assembly_pressure_Pa": answer.at[1], "relation": "=",
            "value": slope.value if isfinite(slope.value) else None, "low": low, "high": high,
            "seals_low": None, "seals_high": None, "how": how,
        })  # fmt: skip

    for need in answer.requirements:
        add("Qmin [Pa]", need.name, None, need.assembly)
        if need.relaxed is not None:
            add("Qmin with relaxation [Pa]", need.name, None, need.relaxed)
        for peak, needed in need.service.items():
            add("QSmin [Pa]", need.name, peak, needed)
    add("sealing load [Pa]", "", None, answer.sealing)
    for one in answer.sensitivities:
        add_slope(f"d ln L / d ln {one.quantity}", answer.at[0], one.leakage, one.how)
        add_slope(f"d ln Qmin / d ln {one.quantity}", answer.at[0], one.pressure, one.how)
    if answer.turned is not None:
        add_slope("leakage of the face turned by 90°, factor", answer.at[0], answer.turned.leakage, answer.turned.how)
    return found


def _end(value: float) -> float | None:
    """An end of an interval within the loads; None where it lies beyond them or is unknown."""
    return value if isfinite(value) and value > 0 else None


def write_sheet(answer: DesignData, folder: str | os.PathLike[str]) -> list[Path]:
    """Write `design.csv`, `design.json` and `design.png`; the report of results in the folder shows them."""
    target = made_folder(folder)
    table, (unit, scale) = rows(answer), answer.leak_scale
    sheet, *slopes = sheet_tables(answer)
    content = {
        "case": answer.results.case,
        "probability": answer.probability,
        "seals": answer.seals.count,
        "limits": {need.name: need.limit / scale for need in answer.requirements},
        "limits_unit": unit.name,
        "figures": table,
        "sentences": sheet_sentences(answer),
        "sheet": {"heads": sheet.heads, "lines": sheet.lines},
        "slopes": {"title": slopes[0].title, "heads": slopes[0].heads, "lines": slopes[0].lines} if slopes else None,
    }
    try:
        with replacing(target / DESIGN_PICTURE) as temporary:
            temporary.write_bytes(png(design_figure(answer)))
        write_text(target / TABLE_FILE, comma_separated(table))
        write_text(target / DESIGN_FILE, json.dumps(content, indent=1, ensure_ascii=False))
    except OSError as error:
        raise InputError("output", f"'{target}'", f"a folder that can be written ({error.strerror})") from None
    written = [target / name for name in (TABLE_FILE, DESIGN_FILE, DESIGN_PICTURE)]
    if (target / FILE_NAME).is_file():
        written.append(write_report(target))
    return written
