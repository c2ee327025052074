"""Complete the tables of a case before they are validated.

- The name of a fluid or solid is replaced by its properties.
- Gauge pressures are converted to absolute pressures, and kinematic viscosities to dynamic viscosities.
- Former names of keys are replaced by the present names.
- Tables that are missing, but needed by the chosen methods, are added.

Invalid values are left unchanged, because the validation reports them later.
"""

import re
from collections.abc import Iterator
from dataclasses import fields
from os.path import isfile
from pathlib import Path
from typing import Any

from ..base import InputError, counted, shortened, shown, to_text
from ..base.leak_rates import STANDARD_PRESSURE
from ..base.quantities import absolute_pressure
from ..base.text_columns import columns_of, read_columns
from ..fluids import FLUIDS
from ..gases import RealGas
from ..materials import named_solid
from ..named_fluids import TABLE_TEMPERATURE, named_fluid
from ..studies.study_list import DEFAULT_OF_SURFACE, DEFAULT_STUDY, STUDIES
from .faults import errors_in_table
from .hot_hardness import hot_hardness_warnings
from .quantity_types import TEMPERATURE, Amount, unvalidated_value

#: Table of a case before validation: texts and numbers by key.
RawTable = dict[str, Any]

#: Tables that this module completes, or from which it needs keys.
_TABLES = (
    "surface",
    "material",
    "counter_material",
    "fluid",
    "seal",
    "seat",
    "stochastic",
    "output",
)
#: Former keys of [face] and their present names. Former keys are accepted until the next version.
_RENAMED_FACE_KEYS = {"places": "patches"}
#: Largest factor by which a property may differ from the property of the named fluid or solid without a warning.
_ODD_RATIO = 2.0
#: Units of the properties of a named solid.
_SOLID_UNITS = {"young": "Pa", "poisson": "", "yield_stress": "Pa", "hardness": "Pa"}
#: Warning about a case with an accuracy, but without a method and without a whole seal.
_ACCURACY_OF_FACE = (
    "The leakage is that of the surface alone, not that of whole seals: the case asks for an accuracy, but gives "
    f'neither a method nor the length of the seal, so that the method is "{DEFAULT_OF_SURFACE.name}". For whole seals, '
    f'set method = "{DEFAULT_STUDY.name}" and a length in [{DEFAULT_STUDY.table}]; to keep the surface alone, set '
    f'method = "{DEFAULT_OF_SURFACE.name}"'
)
#: Heading of a column in a file with the hardness at several depths: name and unit.
_COLUMN = re.compile(r"(depth|hardness)\s*[\[(]\s*(.+?)\s*[\])]$")
HARDNESS_COLUMNS = (
    "two columns with commas, the first line 'depth [um], hardness [GPa]' or with other units"
)


def complete(data: RawTable) -> RawTable:
    """Complete the tables of a case: make the changes that are listed in the docstring of the module.

    The entry `named_warnings` of the returned data is a tuple of warnings. A warning is added for each renamed key, for
    a method that follows from the accuracy, and for a metal at a high temperature. A warning is also added for each
    property that differs by more than a factor of `_ODD_RATIO` from the property of the named fluid or solid.
    """
    # If the user has given another value where a table is expected, the value is replaced by an empty table here. At
    # the end the value is put back, so that the validation reports the wrong value.
    no_tables = {name: data[name] for name in _TABLES if not isinstance(data.get(name, {}), dict)}
    data = data | {name: {} for name in no_tables}
    warnings: list[str] = []
    data = _with_tables_for_methods(data, warnings)
    data = _with_present_face_keys(data, warnings)
    warnings += hot_hardness_warnings(data)
    data = _with_complete_fluids(data, warnings)
    for table_key in ("material", "counter_material"):
        if table_key in data:
            folder = Path(data.get("folder", "."))
            data[table_key] = _complete_solid(data[table_key], table_key, folder, warnings)
    if "face" in data:
        data["face"] = as_tables(data["face"])
    data["named_warnings"] = tuple(warnings)
    return _with_detrending(data) | no_tables


def as_tables(value: Any) -> Any:
    """Return a list of tables; a single table is converted to a list with one table.

    A table without a `kind` gets the kind "file" if it names files by `path` or `patches`.
    """
    tables = [value] if isinstance(value, dict) else value
    if not isinstance(tables, (list, tuple)):
        return value
    return [{"kind": "file", **table} if _names_files(table) else table for table in tables]


def _names_files(table: Any) -> bool:
    return isinstance(table, dict) and ("path" in table or "patches" in table)


# --- methods and faces ------------------------------------------------------------------------------------------


def _with_tables_for_methods(data: RawTable, warnings: list[str]) -> RawTable:
    """Add the default method if the case has no method, and each table that a method of the case needs.

    The default method is `DEFAULT_STUDY`. If the case asks for an accuracy but describes only a surface, and not a
    whole seal, the default method is `DEFAULT_OF_SURFACE`, and a warning is added. A case describes only a surface if
    the seal is a strip without a length, that is, if the table of `DEFAULT_STUDY` is missing. The method "auto" of
    earlier versions is replaced by `DEFAULT_OF_SURFACE`.
    """
    is_strip = data.get("seal", {}).get("kind", "rectangular") == "rectangular"
    has_accuracy = data.get("accuracy") is not None
    is_only_face = has_accuracy and is_strip and DEFAULT_STUDY.table not in data
    default_study = DEFAULT_OF_SURFACE if is_only_face else DEFAULT_STUDY
    method = data.get("method", default_study.name)
    if method == "auto":
        method = DEFAULT_OF_SURFACE.name
    if is_only_face and "method" not in data:
        warnings.append(_ACCURACY_OF_FACE)
    compared = data.get("compare", ())
    methods = [method, *(compared if isinstance(compared, list) else ())]
    needed_tables: RawTable = {
        study.table: {} for study in STUDIES.values() if study.table and study.name in methods
    }
    return needed_tables | data | {"method": method}


def _with_present_face_keys(data: RawTable, warnings: list[str]) -> RawTable:
    """Rename former keys of all tables [face] to their present names, and add a warning for each renamed key."""
    faces = data.get("face")
    if isinstance(faces, dict):
        return data | {"face": _with_present_keys(faces, warnings)}
    if isinstance(faces, (list, tuple)):
        return data | {"face": [_with_present_keys(face, warnings) for face in faces]}
    return data


def _with_present_keys(face: Any, warnings: list[str]) -> Any:
    """Rename former keys of a single table [face], and add a warning for each renamed key."""
    if not isinstance(face, dict):
        return face
    table = dict(face)
    for former, present in _RENAMED_FACE_KEYS.items():
        if former in table and present not in table:
            table[present] = table.pop(former)
            warnings.append(
                f"face.{former} is face.{present} now: the former name is read until the next version"
            )
    return table


def least_detrend(kind: object) -> int:
    """Return the lowest value of `surface.detrend` that is allowed for a measured surface on a seat of the given kind.

    The value is 0 if the mean has to be removed from the surface, 1 for the mean and the tilt, and 2 if the curvature
    has to be removed as well. The shape of the seat is added to the measured surface later. The measured surface must
    not contain the shape of the seat, because the shape would be counted twice.
    """
    return {"flat": 0, "tilted": 1}.get(str(kind), 2)


def _with_detrending(data: RawTable) -> RawTable:
    """Add `surface.detrend` for a measured surface on a curved seat, unless the case has this key."""
    faces = data.get("face")
    is_measured = isinstance(faces, list) and any(
        isinstance(face, dict) and face.get("kind") == "file" for face in faces
    )
    seat = data.get("seat", {"kind": "flat"})
    order = least_detrend(seat.get("kind"))
    if not is_measured or order < 2:
        return data  # the default removes the tilt anyway
    return data | {"surface": {"detrend": order} | data.get("surface", {})}


# --- fluids -----------------------------------------------------------------------------------------------------


def _with_complete_fluids(data: RawTable, warnings: list[str]) -> RawTable:
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

    ambient : ambient pressure [Pa], None for the standard pressure. key : key in the case, for messages.
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
    warnings += _odd_properties(values, properties, table_key)
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
            "a density beside a kinematic viscosity, such as '870 kg/m^3'; or a dynamic one, "
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


def _odd_properties(
    table: RawTable, properties: dict[str, Amount], table_key: str
) -> Iterator[str]:
    """Yield a warning for each value in a table that differs considerably from the property of the named substance.

    Parameters
    ----------
    table : table of the fluid or solid.
    properties : properties of the named fluid or solid.
    table_key : key of the table in the case.
    """
    for name, usual in properties.items():
        value = unvalidated_value(table, name, usual.unit, 0.0)
        if value <= 0 or 1 / _ODD_RATIO <= value / usual <= _ODD_RATIO:
            continue
        ratio = value / usual
        times = f"{ratio:.2g} times" if ratio > 1 else f"{1 / ratio:.2g} times less than"
        unit = usual.unit.replace("*", "·")
        yield (
            f"{table_key}.{name} {to_text(value, unit)} is {times} that of {table['name']}, "
            f"{to_text(usual, unit)}: keep it if it was measured, else leave out the key or the name"
        )


# --- solids -----------------------------------------------------------------------------------------------------


def _complete_solid(solid: RawTable, table_key: str, folder: Path, warnings: list[str]) -> RawTable:
    """Return the table of a solid. Add the properties of a named solid, and read the file of a hardness table.

    Parameters
    ----------
    solid : table of the solid.
    table_key : key of the table in the case.
    folder : folder to which the path of a hardness table is relative.
    warnings : list of warnings. A warning is added for each value in the table that differs considerably from the
        property of the named solid.
    """
    table = dict(solid)
    path = table.get("hardness_table")
    coating = table.get("coating")
    if isinstance(coating, dict):
        coating_key = f"{table_key}.coating"
        table["coating"] = _complete_solid(coating, coating_key, folder, warnings)
    if isinstance(path, str):
        table["hardness_table"] = _hardness_rows(folder / path, f"{table_key}.hardness_table")
    if "name" not in table:
        return table
    with errors_in_table(table_key):
        named = named_solid(table["name"])
    assert named.yield_stress is not None
    assert named.hardness is not None
    values = {
        "young": named.young,
        "poisson": named.poisson,
        "yield_stress": named.yield_stress,
        "hardness": named.hardness,
    }
    properties = {name: Amount(value, _SOLID_UNITS[name]) for name, value in values.items()}
    warnings += _odd_properties(table, properties, table_key)
    # only one property states the strength: the yield stress if the hardness shall follow from it, else the hardness
    has_hardness = "hardness" in table or "hardness_table" in table
    has_ratio_only = "hardness_over_yield" in table and not has_hardness
    follows_from_yield = "yield_stress" in table or has_ratio_only
    del properties["hardness" if follows_from_yield else "yield_stress"]
    if "hardness_table" in table:
        properties.pop("hardness", None)
    return properties | table


def _hardness_rows(path: Path, key: str) -> list[list[str]]:
    """Read a file with the hardness at several depths.

    Parameters
    ----------
    path : path of the file.
    key : key of the case that names the file, for error messages.

    Returns
    -------
    Rows with two entries, depth and hardness, each as text with a unit.

    Raises
    ------
    InputError : the file does not exist, has other columns, or has fewer than two rows.
    """
    name = f"'{shortened(path.name)}'"
    if not isfile(path):
        raise InputError(key, name, "a file that exists, or rows such as ['0.1 um', '2 GPa']")
    try:
        matches = [_COLUMN.match(heading) for heading in columns_of(path)]
        by_name = {match[1]: match for match in matches if match}
        # each column is a match of its heading, with the groups [1] name and [2] unit; [0] is the whole heading
        columns = by_name["depth"], by_name["hardness"]
        numbers = read_columns(path, tuple(column[0] for column in columns))
    except (InputError, KeyError):
        raise InputError(key, name, HARDNESS_COLUMNS) from None
    if len(numbers) < 2:
        given = f"{name} with {counted(len(numbers), 'row')} of numbers"
        raise InputError(key, given, f"{HARDNESS_COLUMNS}, and at least two rows")
    depth_unit, hardness_unit = (column[2] for column in columns)
    return [
        [f"{depth!r} {depth_unit}", f"{hardness!r} {hardness_unit}"]
        for depth, hardness in numbers.tolist()
    ]
