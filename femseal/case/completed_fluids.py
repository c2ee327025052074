"""Complete the tables of fluids: properties of named fluids, absolute pressures and dynamic viscosities."""

from dataclasses import fields
from typing import Any

from ..base import InputError, shown
from ..base.leak_rates import STANDARD_PRESSURE
from ..base.quantities import absolute_pressure
from ..fluids import FLUIDS
from ..gases import RealGas
from ..named_fluids import TABLE_TEMPERATURE, named_fluid
from .faults import errors_in_table
from .odd_properties import odd_properties
from .quantity_types import TEMPERATURE, Amount, RawTable, unvalidated_value


def complete_fluids(data: RawTable, warnings: list[str]) -> RawTable:
    """Convert the pressures of the fluid and the test fluid to absolute pressures, and add properties of named fluids.

    Gauge pressures are relative to the `ambient_pressure` in [fluid]. If the table of the test fluid has a key
    `ambient_pressure`, its value is used for the test fluid. If the table of a fluid contains gauge pressures or an
    ambient pressure, its outlet pressure is the ambient pressure by default.
    """
    data = dict(data)
    fluid = data.get("fluid")
    output = data.get("output", {})
    ambient = unvalidated_value(fluid or {}, "ambient_pressure", "Pa")
    if fluid is not None:
        fluid = _with_absolute_pressures(fluid, "fluid", ambient)
        data["fluid"] = _complete_fluid(fluid, "fluid", warnings)
    test_fluid = output.get("test_fluid")
    if isinstance(test_fluid, dict):
        table_key = "output.test_fluid"
        test_fluid = _with_absolute_pressures(test_fluid, table_key, ambient)
        data["output"] = {**output, "test_fluid": _complete_fluid(test_fluid, table_key, warnings)}
    return data


def _with_absolute_pressures(fluid: RawTable, table_key: str, ambient: float | None) -> RawTable:
    """Return the table of a fluid with absolute pressures.

    Parameters
    ----------
    fluid : table of the fluid.
    table_key : key of the table in the case.
    ambient : ambient pressure [Pa] of the case, used if the table of the fluid has none; None if it is not given.
    """
    ambient = unvalidated_value(fluid, "ambient_pressure", "Pa", ambient)
    keys = [key for key in ("inlet_pressure", "outlet_pressure") if key in fluid]
    pressures: RawTable = {key: fluid[key] for key in keys}
    absolute = {
        key: _absolute(value, ambient, f"{table_key}.{key}") for key, value in pressures.items()
    }
    has_gauge_pressures = absolute != pressures
    if ambient is None and not has_gauge_pressures:
        return fluid
    surroundings = Amount(STANDARD_PRESSURE if ambient is None else ambient, "Pa")
    defaults = {"ambient_pressure": surroundings, "outlet_pressure": surroundings}
    return {**defaults, **fluid, **absolute}


def _absolute(value: Any, ambient: float | None, key: str) -> Any:
    """Convert a text such as "99 bar(g)" or "100 bar(a)" to an absolute pressure; return other values unchanged.

    ambient : ambient pressure [Pa], None for the standard pressure.
    key : key in the case, for messages.
    """
    reference = STANDARD_PRESSURE if ambient is None else ambient
    pressure = absolute_pressure(value, reference, key)
    return value if pressure is None else Amount(pressure, "Pa")


def _complete_fluid(fluid: RawTable, table_key: str, warnings: list[str]) -> RawTable:
    """Return the table of a fluid with its dynamic viscosity and, for a named fluid, with the missing properties.

    Parameters
    ----------
    fluid : table of the fluid.
    table_key : key of the table in the case.
    warnings : list of warnings. A warning is added for each value in the table that differs considerably from the
        property of the named fluid.
    """
    if "name" not in fluid:
        return _with_dynamic_viscosity(fluid, table_key)
    temperature = _temperature(fluid, table_key)
    outlet = unvalidated_value(fluid, "outlet_pressure", "Pa", STANDARD_PRESSURE)
    inlet = unvalidated_value(fluid, "inlet_pressure", "Pa", outlet)
    with errors_in_table(table_key):
        if fluid.get("kind") == RealGas.kind:
            RealGas(fluid["name"], temperature)  # raises an error for an unknown name
            return fluid
        named = named_fluid(fluid["name"], temperature, (inlet, outlet))
    kind = fluid.get("kind", named.kind)
    if not isinstance(kind, str) or kind not in FLUIDS:
        return fluid
    units = _units_of(kind)
    properties = {
        name: Amount(value, units[name])
        for name, value in named.parameters.items()
        if name in units  # a fluid of another kind does not use all properties
    }
    values = fluid
    if "temperature" not in units:
        # the temperature was only needed to look the properties up: fluids of this kind have no such key
        values = {key: value for key, value in fluid.items() if key != "temperature"}
    density = named.parameters.get("density")
    values = _with_dynamic_viscosity({"kind": kind, **values}, table_key, density)
    if kind != named.kind:
        warnings.append(
            f"{table_key}.kind {kind} is used for {fluid['name']}, which is of kind {named.kind}: leave the "
            "kind out unless that is intended"
        )
    warnings += odd_properties(values, properties, table_key)
    return {**properties, **values}


def _units_of(kind: str) -> dict[str, str]:
    """Return the unit of each parameter of a kind of fluid. Parameters without a unit are left out."""
    parameters = fields(FLUIDS[kind])
    return {field.name: field.metadata["unit"] for field in parameters if "unit" in field.metadata}


def _with_dynamic_viscosity(
    fluid: RawTable, table_key: str, named_density: float | None = None
) -> RawTable:
    """Return the table of a fluid; a kinematic viscosity in the table is replaced by the dynamic viscosity.

    Parameters
    ----------
    fluid : table of the fluid.
    table_key : key of the table in the case.
    named_density : density of the named fluid [kg/m³], used if the table gives none; None if the fluid has no name.

    Raises
    ------
    InputError : the fluid is a gas, or its density is unknown.
    """
    kinematic = unvalidated_value(fluid, "viscosity", "m^2/s")
    if kinematic is None:
        return fluid
    kind = fluid.get("kind", "liquid")
    # all classes of gases, and only these, have a reference pressure
    is_gas = isinstance(kind, str) and hasattr(FLUIDS.get(kind), "reference_pressure")
    density = named_density
    if "density" in fluid:
        density = unvalidated_value(fluid, "density", "kg/m^3", 1.0)
    expected = ""
    if is_gas:
        expected = "a dynamic viscosity of a gas, such as '18 uPa*s'"
    elif density is None:
        expected = (
            "a density in addition to the kinematic viscosity, such as '870 kg/m^3'; or a dynamic viscosity, "
            "such as '1 mPa*s'"
        )
    if density is None or expected:
        raise InputError(f"{table_key}.viscosity", shown(fluid["viscosity"]), expected)
    dynamic = kinematic * density
    if not dynamic > 0:
        return fluid  # the validation reports the invalid value
    return {**fluid, "viscosity": Amount(dynamic, "Pa*s")}


def _temperature(fluid: RawTable, table_key: str) -> float:
    """Return the temperature of a named fluid [K], by default 20 °C.

    The temperature is checked in this function and not in the validation, because the table of a liquid has no key for
    the temperature.
    """
    if "temperature" not in fluid:
        return TABLE_TEMPERATURE
    try:
        return TEMPERATURE.read(fluid["temperature"])
    except InputError as error:
        given = shown(fluid["temperature"])
        raise InputError(f"{table_key}.temperature", given, error.expected) from None
