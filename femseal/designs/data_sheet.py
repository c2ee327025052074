"""The design answer as gasket data sheets have it: tables for people, files for programs."""

from __future__ import annotations

import json
import os
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.errors import InputError
from ..base.files import made_folder, replacing, write_text
from ..base.leak_classes import leak_classes
from ..base.leak_units import LEAK_UNITS, LeakUnit
from ..base.quantities import to_text
from ..base.text import comma_separated
from ..report import write_report
from ..report.case_text import fluid_text
from ..report.design_section import DESIGN_FILE, DESIGN_PICTURE
from ..results.netcdf import FILE_NAME
from ..results.tables import amount

if TYPE_CHECKING:
    from .answer import Design
    from .requirements import NeededPressure
    from .sensitivities import Slope

TABLE_FILE = "design.csv"


def leak_scale(answer: Design) -> tuple[LeakUnit, float]:
    """The unit in which leakage is told, that of the first class, and the leakage per length that is 1 in it [m²/s]."""
    unit = answer.results.leak_unit
    if answer.requirements:
        unit = LEAK_UNITS[leak_classes([answer.requirements[0].name])[0].unit]
    return unit, answer.results.judged_basis.factor(unit)


def sheet(answer: Design) -> tuple[list[str], list[list[str]]]:
    """Headings and cells: a line for each class, with Qmin and with QSmin by the pressure in assembly."""
    unit, scale = leak_scale(answer)
    peaks = answer.seals.steps.unload_from
    heads = ["class L", f"limit [{unit.name}]", "Qmin(L)", *(f"QSmin(L), Q_A = {to_text(q, 'Pa')}" for q in peaks)]
    lines = []
    for need in answer.requirements:
        line = [need.name, amount(need.limit, scale), need.assembly.text()]
        lines.append(line + [_service_text(need.service[q]) for q in peaks])
    return heads, lines


def _service_text(needed: NeededPressure) -> str:
    return "not reached at Q_A" if needed.relation == ">" else needed.text()


def slopes(answer: Design) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of what changes leakage and Qmin most: the largest change of the leakage first."""
    heads = ["quantity x", "d ln L / d ln x", "d ln Qmin / d ln x", "how"]

    def size(n: int) -> float:
        value = answer.sensitivities[n].leakage.value
        return -abs(value) if isfinite(value) else 1.0

    order = sorted(range(len(answer.sensitivities)), key=size)
    found = [answer.sensitivities[n] for n in order]
    return heads, [[s.quantity, s.leakage.text(), s.pressure.text(), s.how] for s in found]


def sentences(answer: Design) -> list[str]:
    """What the tables are of, the sealing load, the turned face, and what to keep in mind."""
    data, count = answer.results.dataset, answer.seals.count
    prefix = "test_" if "test_leakage" in data else ""
    ends = " to ".join(to_text(float(data.attrs[f"{prefix}{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet"))
    case = answer.results.case
    table = case.get("output", {}).get("test_fluid") if prefix else case.get("fluid")
    fluid = f"{fluid_text(table or {}, str(data.attrs[f'{prefix}fluid']))}, from {ends}"
    width, length = (to_text(float(side), "m") for side in data.attrs["seal_size_m"])
    told = [f"A seal {width} wide and {length} long; {fluid}."]
    if count > 1:
        told.append(
            f"Qmin and QSmin are nominal pressures that keep {answer.probability:.4g} of {count} seals in the class; "
            "in brackets the interval in which they lie with 90 %, by seals drawn again and the error of the library."
        )
    told.append("The load that seals without leakage: " + answer.sealing.text() + _band(answer.sealing, count) + ".")
    if answer.turned is not None:
        low, high = answer.turned.leakage.low, answer.turned.leakage.high
        band = f" ({low:.3g} to {high:.3g})" if isfinite(low) else ""
        text = f"With the face turned by 90° it leaks {answer.turned.leakage.value:.3g}{band} times as much"
        text += f" at {to_text(answer.at[1], 'Pa', 3)}"
        if answer.turned.need:
            text += f", and {answer.at[0]} takes {answer.turned.need}"
        told.append(f"{text} ({answer.turned.how}).")
    return told + [f"{note[0].upper()}{note[1:]}." for note in answer.notes]


def _band(needed: NeededPressure, count: int) -> str:
    band = needed.band_text()
    return f"; 5 and 95 % of the seals need {band}" if count > 1 and band != needed.text() else ""


def slopes_title(answer: Design) -> str:
    """Where the sensitivities hold."""
    place = f"at {to_text(answer.at[1], 'Pa', 3)} on loading"
    return f"What changes leakage L and Qmin most, {place}" + (f", Qmin of {answer.at[0]}" if answer.at[0] else "")


def rich_tables(answer: Design) -> Any:
    """Data sheet and sensitivities for a terminal."""
    from rich.console import Group
    from rich.markup import escape as plain
    from rich.table import Table

    parts: list[Any] = [plain(text) for text in sentences(answer)]
    shown = [("Pressure in assembly and in service", *sheet(answer))]
    if answer.sensitivities:
        shown.append((slopes_title(answer), *slopes(answer)))
    for title, heads, lines in shown:
        table = Table(title=plain(title), title_justify="left")
        for head in heads:
            table.add_column(plain(head))
        for line in lines:
            table.add_row(*map(plain, line))
        parts.append(table)
    return Group(*parts)


def rows(answer: Design) -> list[dict[str, Any]]:
    """All figures, one dictionary each: pressures in Pa, slopes and factors without unit."""
    found: list[dict[str, Any]] = []

    def add(figure: str, name: str, assembly: float | None, needed: NeededPressure) -> None:
        found.append({
            "figure": figure, "class": name, "assembly_pressure_Pa": assembly, "relation": needed.relation,
            "value": needed.bound(needed.value), "low": _end(needed, needed.low), "high": _end(needed, needed.high),
            "seals_low": _end(needed, needed.seals_low), "seals_high": _end(needed, needed.seals_high), "how": "",
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
        for peak, needed in need.service.items():
            add("QSmin [Pa]", need.name, peak, needed)
    add("sealing load [Pa]", "", None, answer.sealing)
    for one in answer.sensitivities:
        add_slope(f"d ln L / d ln {one.quantity}", answer.at[0], one.leakage, one.how)
        add_slope(f"d ln Qmin / d ln {one.quantity}", answer.at[0], one.pressure, one.how)
    if answer.turned is not None:
        add_slope("leakage of the face turned by 90°, factor", answer.at[0], answer.turned.leakage, answer.turned.how)
    return found


def _end(needed: NeededPressure, value: float) -> float | None:
    """An end of an interval within the loads; None where it lies beyond them or is unknown."""
    return value if isfinite(value) and value > 0 else None


def write(answer: Design, folder: str | os.PathLike[str]) -> list[Path]:
    """Write table, data and picture; the report of results in the folder is written anew, with them."""
    target = made_folder(folder)
    table, unit = rows(answer), leak_scale(answer)[0]
    (heads, lines), (slope_heads, slope_lines) = sheet(answer), slopes(answer)
    content = {
        "case": answer.results.case,
        "probability": answer.probability,
        "seals": answer.seals.count,
        "limits": {need.name: need.limit / leak_scale(answer)[1] for need in answer.requirements},
        "limits_unit": unit.name,
        "figures": table,
        "sentences": sentences(answer),
        "sheet": {"heads": heads, "lines": lines},
        "slopes": {"title": slopes_title(answer), "heads": slope_heads, "lines": slope_lines}
        if answer.sensitivities
        else None,
    }
    try:
        with replacing(target / DESIGN_PICTURE) as temporary:
            from ..plots.drawing import png

            temporary.write_bytes(png(answer.plot()))
        write_text(target / TABLE_FILE, comma_separated(table))
        write_text(target / DESIGN_FILE, json.dumps(content, indent=1, ensure_ascii=False))
    except OSError as error:
        raise InputError("output", f"'{target}'", f"a folder that can be written ({error.strerror})") from None
    written = [target / name for name in (TABLE_FILE, DESIGN_FILE, DESIGN_PICTURE)]
    if (target / FILE_NAME).is_file():
        written.append(write_report(target))
    return written
