"""Fluids given by their name in a case: the keys of its kind are filled in, those that are given stand."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ..base.errors import InputError
from ..base.quantities import to_si
from ..fluids import FLUIDS
from ..named_fluids import TABLE_TEMPERATURE, named_fluid
from .faults import fault


def with_named_fluids(data: Any) -> Any:
    """The data of a case with the properties of fluids that are given by their name."""
    if not isinstance(data, dict):
        return data
    found = {"fluid": _filled(data.get("fluid"), "fluid")} if "fluid" in data else {}
    if isinstance(output := data.get("output"), dict) and "test_fluid" in output:
        found["output"] = {**output, "test_fluid": _filled(output["test_fluid"], "output.test_fluid")}
    return {**data, **found}


def _filled(table: Any, place: str) -> Any:
    """The table of a fluid; `place` is its key in the case."""
    if not isinstance(table, dict) or "name" not in table:
        return table
    try:
        temperature = to_si(table["temperature"], "K") if "temperature" in table else TABLE_TEMPERATURE
        inlet = to_si(table.get("inlet_pressure"), "Pa")
        outlet = to_si(table.get("outlet_pressure", "1 atm"), "Pa")
    except InputError:
        temperature, inlet, outlet = TABLE_TEMPERATURE, 101_325.0, 101_325.0  # that fault is told with its key
    try:
        found = named_fluid(table["name"], temperature, (inlet, outlet))
    except InputError as error:
        raise fault(f"{place}.{error.what}", error.given, error.expected) from None
    kind = table.get("kind", found.kind)
    if not isinstance(kind, str) or kind not in FLUIDS:
        return table
    units = {f.name: f.metadata["unit"] for f in fields(FLUIDS[kind]) if "unit" in f.metadata}
    filled = {key: f"{value!r} {units[key]}" for key, value in found.parameters.items() if key in units}
    given = {key: value for key, value in table.items() if key != "temperature" or key in units}
    return {"kind": kind, **filled, **given}
