"""Read a leak test from a file, and check it against the case of the tested seal."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..base import Array, Flags, InputError, InputErrors, counted, shortened, shown, to_si, to_text
from ..base.leak_units import LeakUnit, leak_unit
from ..base.text_columns import text_rows
from ..case.case import Case
from ..case.quantity_types import Amount
from ..fluids import leak_basis
from ..loads import LoadProgramme, LoadStep

#: Description of the columns of a leak test, for messages.
COLUMNS_TEXT = (
    "pressure [MPa], leakage [mL/min]; and, if any row was measured during unloading, branch, "
    "unloaded from [MPa]"
)
BRANCHES = ("loading", "unloading")
#: Text in place of a leakage if no leakage was detected, and first character of a limit of detection.
SEALED, BELOW_LIMIT = "sealed", "<"
#: Fewest different loads at which a leakage must have been measured.
_FEWEST_LOADS = 3
#: Relative tolerance of loads compared with the range of the case.
_LOAD_TOLERANCE = 1e-9
_NAME_AND_UNIT = re.compile(r"\s*([^\[(]+?)\s*(?:[\[(]\s*(.*\S)\s*[\])])?\s*")
_DECIMAL_COMMA = re.compile(r"\d+,\d+")
#: Quantity in a column, for each name that the heading of the column can have.
_COLUMN_OF_NAME = {
    "pressure": "load",
    "load": "load",
    "force": "load",
    "branch": "branch",
    "unloaded from": "peak",
    "leakage": "leakage",
}


@dataclass(frozen=True, eq=False)
class LeakTest:
    """Leakages of a seal that were measured in a leak test.

    A row of the test is a measurement. A row is called sealed if no leakage was detected.

    Parameters
    ----------
    steps : tuple of LoadStep
        Load of each row, in the unit of the loads of the case.
    leakage : array (rows,)
        Measured leakage of each row in `unit`, or the limit of detection if no leakage was detected.
    sealed : array of bool (rows,)
        True for each row in which no leakage was detected.
    unit : LeakUnit
        Unit of the leakage.
    """

    steps: tuple[LoadStep, ...]
    leakage: Array
    sealed: Flags
    unit: LeakUnit

    def of_case(self, case: Case) -> Case:
        """Return a copy of a case with the loads of the test in place of its loads, and without output files."""
        loading = {step.pressure for step in self.steps if step.unloaded_from is None}
        unloading = {step.pressure for step in self.steps if step.unloaded_from is not None}
        peaks = {step.unloaded_from for step in self.steps if step.unloaded_from is not None}
        unit = case.load.unit

        def amounts(loads: list[float]) -> tuple[Amount, ...]:
            return tuple(Amount(load, unit) for load in loads)

        # a cycle needs loads on loading; if the test was only measured on unloading, these are its peaks
        changed_load = {
            "loading": amounts(sorted(loading or peaks)),
            "unload_from": amounts(sorted(peaks)),
            "unloading": amounts(sorted(unloading, reverse=True)),
            "relaxation": 0.0,
        }
        changed_output = {
            "budget": False,
            "pictures": False,
            "report": False,
            "fields": False,
            "paraview": "none",
        }
        return case.model_copy(
            update={
                "load": case.load.model_copy(update=changed_load),
                "output": case.output.model_copy(update=changed_output),
                "compare": (),
            }
        )

    def rows_of(self, case: Case) -> list[int]:
        """Return for each row of the test the index of its load step in the case that `of_case` returns."""
        load = self.of_case(case).load
        programme = LoadProgramme.of(load.loading, load.unload_from, load.unloading)
        return [programme.index(step) for step in self.steps]


class _Column(NamedTuple):
    """Index of a column in the file, and the factor that converts its values to the unit of the case."""

    position: int
    factor: float


class _Leakage(NamedTuple):
    """Leakage of a row, or its limit of detection (NaN if not given) if no leakage was detected."""

    value: float
    is_sealed: bool


def read_leak_test(path: Path, case: Case) -> LeakTest:
    """Read the leak test of a seal from a text file with columns.

    The first line that is not a comment (#) contains the names and units of the columns, see `COLUMNS_TEXT`. A
    leakage in the file is a number, "sealed", or a limit of detection such as "< 0.1". If a row only says "sealed", its
    limit of detection is the smallest measured leakage.

    Parameters
    ----------
    path : Path
        File to read.
    case : Case
        Case of the tested seal.

    Returns
    -------
    LeakTest

    Raises
    ------
    InputError
        The file cannot be read, a column or a unit is unknown or missing, or a row is faulty. The message has a line
        for each fault, with the number of the line in the file.
    """
    # number, text and cells of each line; the first one contains the headings
    (_, _, heads), *lines = text_rows(path, "data")
    if not lines:
        given = f"'{path}' without rows"
        raise InputError("data", given, f"a line of column names, {COLUMNS_TEXT}, and rows")
    columns, unit = _read_heads(heads, case)
    steps: list[LoadStep] = []
    leakages: list[_Leakage] = []
    faults = []
    for number, _, cells in lines:
        try:
            if len(cells) != len(heads):
                given = counted(len(cells), "cell")
                raise InputError("row", given, f"{len(heads)}, one for each column name")
            steps.append(_read_step(cells, columns, case))
            leakages.append(_read_leakage(cells[columns["leakage"].position].strip()))
        except InputError as error:
            what = f"data, line {number}: {error.what}"
            faults.append(InputError(what, error.given, error.expected))
    if faults:
        raise InputErrors(faults)
    values = np.array([leakage.value for leakage in leakages])
    is_sealed = np.array([leakage.is_sealed for leakage in leakages])
    leaking_steps = {step for step, sealed in zip(steps, is_sealed, strict=True) if not sealed}
    if len(leaking_steps) < _FEWEST_LOADS:
        given = f"{counted(len(leaking_steps), 'load')} with a leakage"
        raise InputError("data", given, "rows with a leakage at three loads or more")
    values[np.isnan(values)] = values[~is_sealed].min()
    return LeakTest(tuple(steps), values, is_sealed, unit)


def _read_heads(heads: list[str], case: Case) -> tuple[dict[str, _Column], LeakUnit]:
    """Read the headings of the columns.

    Returns the index and the factor of each column, by the quantity in the column, and the unit of the leakage.
    """
    columns: dict[str, _Column] = {}
    unit_of_leakage: LeakUnit | None = None
    for position, head in enumerate(heads):
        match = _NAME_AND_UNIT.fullmatch(head)
        column = _COLUMN_OF_NAME.get(match[1].lower()) if match else None
        if match is None or column is None:
            raise InputError("data: columns", shown(head), COLUMNS_TEXT)
        if column in columns:
            raise InputError("data: columns", f"{shortened(head)} twice", "each column once")
        unit = match[2] or ""
        if column != "branch" and not unit:
            raise InputError("data: columns", f"{shown(head)} without a unit", COLUMNS_TEXT)
        factor = 1.0
        if column == "leakage":
            unit_of_leakage = _leakage_unit(unit, head, case)
        elif column != "branch":
            factor = to_si(f"1 {unit}", case.load.unit, f"data: column {match[1]}")
        columns[column] = _Column(position, factor)
    if "load" not in columns or unit_of_leakage is None:
        raise InputError("data: columns", ", ".join(heads), COLUMNS_TEXT)
    return columns, unit_of_leakage


def _leakage_unit(name: str, head: str, case: Case) -> LeakUnit:
    """Return the leakage unit with the given name; raise InputError if it does not suit the fluid of the leak test.

    head : heading of the column of the leakage, for the error message.
    """
    unit = leak_unit(name)
    fluid = (case.output.test_fluid or case.fluid).fluid
    reason = leak_basis(fluid, 1.0).lacks(unit)
    if reason:
        raise InputError("data: columns", shown(head), reason)
    return unit


def _read_number(text: str, what: str, expected: str) -> float:
    """Read a number >= 0."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if np.isfinite(value) and value >= 0:
        return value
    if _DECIMAL_COMMA.fullmatch(text):
        expected += f"; perhaps meant: {text.replace(',', '.')}"
    raise InputError(what, shown(text), expected)


def _read_step(cells: list[str], columns: dict[str, _Column], case: Case) -> LoadStep:
    """Read the load step of a row from its cells. The loads are in the unit of the loads of the case."""
    unit = case.load.unit

    def read_load(column: str, what: str) -> float:
        """Read a load from a column, and convert it to the unit of the case; `what` names the load in messages."""
        text = cells[columns[column].position].strip()
        number = _read_number(text, what, "a number >= 0") * columns[column].factor
        # equal loads must be equal numbers, so the rounding errors of the conversion of units are removed
        load = float(f"{number:.12g}")
        _check_range(load, what, case)
        return load

    load = read_load("load", "load")
    branch = BRANCHES[0]
    if "branch" in columns:
        branch = cells[columns["branch"].position].strip()
    if branch.lower() not in BRANCHES:
        raise InputError("branch", shown(branch), " or ".join(BRANCHES))
    if branch.lower() == BRANCHES[0]:
        return LoadStep(load)
    if "peak" in columns and cells[columns["peak"].position].strip():
        peak = read_load("peak", "unloaded from")
    elif case.load.peaks:
        peak = float(max(case.load.peaks))
    else:
        expected = f"a column 'unloaded from [M{unit}]', because the case has no unload_from"
        raise InputError("unloaded from", "nothing", expected)
    if load >= peak:
        expected = f"a load below that from which it is unloaded, {to_text(peak, unit)}"
        raise InputError("load", to_text(load, unit), expected)
    return LoadStep(load, peak)


def _check_range(load: float, what: str, case: Case) -> None:
    """Raise InputError if a load is outside the loads of the case."""
    unit = case.load.unit
    lowest = min((*case.load.loading, *case.load.unloading))
    highest = case.load.highest
    if not lowest * (1 - _LOAD_TOLERANCE) <= load <= highest * (1 + _LOAD_TOLERANCE):
        expected = f"a load of the case, from {to_text(lowest, unit)} to {to_text(highest, unit)}"
        raise InputError(what, to_text(load, unit), expected)


def _read_leakage(text: str) -> _Leakage:
    """Read the text of a leakage: a number, "sealed", or a limit of detection. A leakage of 0 is read as sealed."""
    expected = f"a leakage >= 0, '{SEALED}', or a limit such as '{BELOW_LIMIT} 0.1'"
    if text.lower() == SEALED:
        return _Leakage(np.nan, True)
    is_limit = text.startswith(BELOW_LIMIT)
    value = _read_number(text.removeprefix(BELOW_LIMIT).strip(), "leakage", expected)
    if value > 0:
        return _Leakage(value, is_limit)
    if is_limit:
        raise InputError("leakage", shown(text), expected)
    return _Leakage(np.nan, True)
