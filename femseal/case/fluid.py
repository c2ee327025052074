"""The table of a fluid in a case file, with a key for each of its parameters or with a name that fills them in.

Fluids are not named here: whatever is registered in `fluids.FLUIDS` has a table.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from ..base.errors import InputError
from ..base.quantities import to_si, to_text
from ..fluids import FLUIDS, Fluid
from ..named_fluids import TABLE_TEMPERATURE, named_fluid
from ..studies import FluidState
from .faults import fault
from .registered_tables import table_of_any
from .values import Pressure, Table

#: Ratio of a given property to that of the named fluid from which on a warning says so.
_ODD_RATIO = 2.0


class FluidTable(Table):
    """A fluid, with a key for each of its parameters, and its pressures at both ends."""

    if TYPE_CHECKING:
        kind: str
        inlet_pressure: float
        outlet_pressure: float
        name: str | None

    @property
    def fluid(self) -> Fluid:
        """The fluid."""
        return FLUIDS[self.kind](**self.model_dump(exclude={"kind", "inlet_pressure", "outlet_pressure", "name"}))

    @property
    def state(self) -> FluidState:
        """The fluid with its pressures."""
        return FluidState(self.fluid, self.inlet_pressure, self.outlet_pressure)


def _state(fluid: Any) -> dict[str, Any]:
    pressures = {"inlet_pressure": (Pressure, ...), "outlet_pressure": (Pressure, fluid.outlet_pressure)}
    return {**pressures, "name": (Annotated[str | None, Field(max_length=60)], None)}


if TYPE_CHECKING:
    AnyFluid = FluidTable
else:
    AnyFluid = table_of_any(FLUIDS, FluidTable, _state)


def with_named_fluids(data: Any) -> Any:
    """The data of a case with the properties of fluids that are given by their name.

    `fluid_warnings` says which given keys differ much from what the name stands for.
    """
    if not isinstance(data, dict):
        return data
    odd: list[str] = []
    found: dict[str, Any] = {"fluid": _filled(data.get("fluid"), "fluid", odd)} if "fluid" in data else {}
    if isinstance(output := data.get("output"), dict) and "test_fluid" in output:
        found["output"] = {**output, "test_fluid": _filled(output["test_fluid"], "output.test_fluid", odd)}
    return {**data, **found, "fluid_warnings": tuple(odd)}


def _filled(table: Any, place: str, odd: list[str]) -> Any:
    """The table of a fluid; `place` is its key in the case; what is odd in it is added to `odd`."""
    if not isinstance(table, dict) or "name" not in table:
        return table
    try:
        temperature = to_si(table["temperature"], "K") if "temperature" in table else TABLE_TEMPERATURE
        inlet = to_si(table.get("inlet_pressure"), "Pa")
        outlet = to_si(table.get("outlet_pressure", "1 atm"), "Pa")
    except InputError:
        temperature, inlet, outlet = TABLE_TEMPERATURE, 101_325.0, 101_325.0  # that fault is reported with its key
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
    if kind != found.kind:
        odd.append(f"{place}.kind {kind} stands for {table['name']}, which is of kind {found.kind} there: leave it out")
    odd += overriding(given, found.parameters, units, place)
    return {"kind": kind, **filled, **given}


def overriding(given: dict[str, Any], known: dict[str, float], units: dict[str, str], place: str) -> Iterator[str]:
    """A sentence for each key that stands in place of a much larger or smaller value of the named fluid."""
    for key in (key for key in known if key in given and key in units):
        try:
            value = to_si(given[key], units[key])
        except InputError:  # that fault has its own line
            continue
        if value > 0 and not 1 / _ODD_RATIO <= (ratio := value / known[key]) <= _ODD_RATIO:
            unit = units[key].replace("*", "·")
            times = f"{ratio:.2g} times" if ratio > 1 else f"{1 / ratio:.2g} times less than"
            yield (
                f"{place}.{key} {to_text(value, unit)} is {times} that of {given['name']}, "
                f"{to_text(known[key], unit)}: leave out the key, or the name"
            )
