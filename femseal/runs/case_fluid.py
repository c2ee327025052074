"""A fluid given by its name in a case: the keys of its kind are filled in, those that are given stand."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from pydantic_core import PydanticCustomError

from ..base.errors import InputError
from ..base.quantities import to_si
from ..fluids import FLUIDS
from ..named_fluids import TABLE_TEMPERATURE, named_fluid


def with_named_fluid(data: Any) -> Any:
    """The data of a case with the properties of a fluid that is given by its name."""
    table = data.get("fluid") if isinstance(data, dict) else None
    if not isinstance(table, dict) or "name" not in table:
        return data
    try:
        temperature = to_si(table["temperature"], "K") if "temperature" in table else TABLE_TEMPERATURE
        inlet = to_si(table.get("inlet_pressure"), "Pa")
        outlet = to_si(table.get("outlet_pressure", "1 atm"), "Pa")
    except InputError:
        temperature, inlet, outlet = TABLE_TEMPERATURE, 101_325.0, 101_325.0  # that fault is told with its key
    try:
        found = named_fluid(table["name"], temperature, (inlet, outlet))
    except InputError as error:
        raise PydanticCustomError("fluid", "fluid.{fault}", {"fault": str(error)}) from None
    kind = table.get("kind", found.kind)
    if not isinstance(kind, str) or kind not in FLUIDS:
        return data
    units = {f.name: f.metadata["unit"] for f in fields(FLUIDS[kind]) if "unit" in f.metadata}
    filled = {key: f"{value!r} {units[key]}" for key, value in found.parameters.items() if key in units}
    given = {key: value for key, value in table.items() if key != "temperature" or key in units}
    return {**data, "fluid": {"kind": kind, **filled, **given}}
