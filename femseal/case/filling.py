"""What a case leaves out, worked out from what it gives before it is checked: raw tables in, raw tables out.

A name fills in the keys of a fluid or a solid; gauge pressures become absolute and kinematic viscosities dynamic;
tables that the methods need are there.
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
from ..fluids import FLUIDS
from ..materials import HARDNESS_FACTOR, named_solid
from ..named_fluids import TABLE_TEMPERATURE, RealGas, named_fluid
from ..seal.layouts import MeshLayout
from ..seal.seal_files import columns_of, read_columns
from .faults import fault, faults_of
from .values import Amount, in_si, value_of

#: Tables in which what is left out is filled in.
_TABLES = [
    "surface",
    "material",
    "counter_material",
    "fluid",
    "seal",
    "seat",
    "stochastic",
    "output",
]
#: Ratio of a given property to that of the named fluid or solid from which on a warning says so.
_ODD_RATIO = 2.0
#: Units of the parameters of a solid that has a name.
_UNITS = {"young": "Pa", "poisson": "", "yield_stress": "Pa", "hardness": "Pa"}
#: A column of a file of hardness over depth.
_COLUMN = re.compile(r"(depth|hardness)\s*[\[(]\s*(.+?)\s*[\])]$")
HARDNESS_COLUMNS = (
    "two columns with commas, the first line 'depth [um], hardness [GPa]' or with other units"
)


def filled(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a case with all that it leaves out; `named_warnings` on given keys far from those of a name."""
    # what is no table has a fault of its own
    odd = {name: data[name] for name in _TABLES if not isinstance(data.get(name, {}), dict)}
    warnings: list[str] = []
    data = _with_what_is_open(data | {name: {} for name in odd})
    data = _with_new_names(data, warnings)
    data = _with_fluids(data, warnings)
    for place in ("material", "counter_material"):
        if place in data:
            folder = Path(data.get("folder", "."))
            data[place] = _filled_solid(data[place], place, folder, warnings)
    data["named_warnings"] = tuple(warnings)
    if "face" in data:
        data["face"] = listed(data["face"])
    return _with_detrending(data) | odd


def _with_new_names(data: dict[str, Any], warnings: list[str]) -> dict[str, Any]:
    """Take the key `places` of a face for `patches`, its name from now on, and say so in a warning."""
    faces = data.get("face")
    tables = [faces] if isinstance(faces, dict) else faces
    if not isinstance(tables, (list, tuple)):
        return data
    renamed = []
    for table in tables:
        if isinstance(table, dict) and "places" in table and "patches" not in table:
            rest = {key: value for key, value in table.items() if key != "places"}
            renamed.append(rest | {"patches": table["places"]})
        else:
            renamed.append(table)
    if all(new is old for new, old in zip(renamed, tables, strict=True)):
        return data
    warnings.append(
        "face.places is face.patches now: the former name is read until the next version"
    )
    return data | {"face": renamed}


def listed(value: Any) -> Any:
    """A list of tables from one or several, each of the kind "file" where it has a path or patches and no kind."""
    tables = [value] if isinstance(value, dict) else value
    if not isinstance(tables, (list, tuple)):
        return value
    files = [isinstance(table, dict) and {"path", "patches"} & {*table} for table in tables]
    return [
        {"kind": "file", **table} if is_file else table
        for table, is_file in zip(tables, files, strict=True)
    ]


def _with_what_is_open(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of a case, with those that its methods need and it leaves out.

    With `accuracy` and no method, the method is "stochastic" if seals are to be drawn: with a table for it, or a shape
    with a length of its own. Else it is "deterministic", which "auto" is too.
    """
    has_length = data.get("seal", {}).get("kind", "rectangular") != "rectangular"
    is_face = data.get("accuracy") is not None and "stochastic" not in data and not has_length
    method = data.get("method", "deterministic" if is_face else "stochastic")
    method = "deterministic" if method == "auto" else method
    compare = data.get("compare", ())
    drawn = method == "stochastic" or (isinstance(compare, list) and "stochastic" in compare)
    return ({"stochastic": {}} if drawn else {}) | data | {"method": method}


def least_detrend(kind: object) -> int:
    """Least order of the form that is taken off a measured face on a seat of a kind, that it does not count twice."""
    return {"flat": 0, "tilted": 1}.get(str(kind), 2)


def _with_detrending(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a case whose measured faces lose the form that its seat gives them, where it does not say what."""
    faces, seat = data.get("face"), data.get("seat", {"kind": "flat"})
    measured = isinstance(faces, list) and any(
        isinstance(face, dict) and face.get("kind") == "file" for face in faces
    )
    least = least_detrend(seat.get("kind"))
    if not measured or least < 2:  # a tilt is taken off unless the case says otherwise
        return data
    return data | {"surface": {"detrend": least} | data.get("surface", {})}


def _with_fluids(data: dict[str, Any], odd: list[str]) -> dict[str, Any]:
    """The data of a case whose fluids have absolute pressures in Pa, and the properties that their name stands for.

    Gauge pressures, such as "10 bar(g)", are above `ambient_pressure` of [fluid], of a test fluid above its own if it
    has one. Beside them, or with an ambient pressure, an outlet without a pressure is at the ambient one. Inlets with
    pressures of their own give the highest one to the fluid.
    """
    data = dict(data)
    fluid, seal, output = data.get("fluid"), data.get("seal", {}), data.get("output", {})
    ambient = value_of(fluid or {}, "ambient_pressure", "Pa")
    if isinstance(inlets := seal.get("inlet"), dict):
        own = {name: _absolute(p, ambient, f"seal.inlet.{name}") for name, p in inlets.items()}
        data["seal"] = {**seal, "inlet": own}
        if fluid is not None and seal.get("kind") == MeshLayout.kind:
            fluid = _with_highest(fluid, own)
        if ambient is None and own != inlets:
            ambient = STANDARD_PRESSURE
    if fluid is not None:
        data["fluid"] = _filled_fluid(_with_absolute_ends(fluid, "fluid", ambient), "fluid", odd)
    if isinstance(test := output.get("test_fluid"), dict):
        place = "output.test_fluid"
        test = _filled_fluid(_with_absolute_ends(test, place, ambient), place, odd)
        data["output"] = {**output, "test_fluid": test}
    return data


def _with_highest(fluid: dict[str, Any], inlets: dict[str, Any]) -> dict[str, Any]:
    """The table of a fluid with the highest pressure of the inlets."""
    if "inlet_pressure" in fluid:
        given = f"{shortened(repr(fluid['inlet_pressure']), 60)} beside the pressures of the inlets in seal.inlet"
        raise fault("fluid.inlet_pressure", given, "none there")
    known = [value_of(inlets, name, "Pa", STANDARD_PRESSURE) for name in inlets]
    return {**fluid, "inlet_pressure": Amount(max(known, default=STANDARD_PRESSURE), "Pa")}


def _with_absolute_ends(table: dict[str, Any], place: str, ambient: float | None) -> dict[str, Any]:
    """The table of a fluid with absolute pressures at its ends, and an outlet at the ambient one where that counts."""
    around = value_of(table, "ambient_pressure", "Pa", ambient)
    keys = [key for key in ("inlet_pressure", "outlet_pressure") if key in table]
    given: dict[str, Any] = {key: table[key] for key in keys}
    ends = {key: _absolute(value, around, f"{place}.{key}") for key, value in given.items()}
    if around is None and ends == given:
        return table
    surroundings = Amount(STANDARD_PRESSURE if around is None else around, "Pa")
    return {"ambient_pressure": surroundings, "outlet_pressure": surroundings, **table, **ends}


def _absolute(value: Any, ambient: float | None, place: str) -> Any:
    """A pressure as it is given, in Pa where it says that it is gauge or absolute."""
    around = STANDARD_PRESSURE if ambient is None else ambient
    with faults_of():
        pressure = absolute_pressure(value, around, place)
    return value if pressure is None else Amount(pressure, "Pa")


def _with_dynamic_viscosity(
    table: dict[str, Any], place: str, density: float | None = None
) -> dict[str, Any]:
    """The table of a fluid, whose viscosity is dynamic where it was kinematic; `density` : unless the table has one."""
    kinematic = value_of(table, "viscosity", "m^2/s")
    if kinematic is None:
        return table
    kind, expected = FLUIDS.get(table.get("kind", "liquid")), ""
    if "density" in table:
        density = value_of(table, "density", "kg/m^3", 1.0)
    if hasattr(kind, "reference_pressure"):
        expected = "a dynamic viscosity of a gas, such as '18 uPa*s'"
    elif density is None:
        expected = "a density beside a kinematic viscosity, such as '870 kg/m^3'; or a dynamic one, such as '1 mPa*s'"
    if expected:
        raise fault(f"{place}.viscosity", shown(table["viscosity"]), expected)
    dynamic = kinematic * (density or 0.0)
    return {**table, "viscosity": Amount(dynamic, "Pa*s")} if dynamic > 0 else table


def _filled_fluid(table: dict[str, Any], place: str, odd: list[str]) -> dict[str, Any]:
    """The table of a fluid; `place` is its key in the case; what is odd in it is added to `odd`."""
    if "name" not in table:
        return _with_dynamic_viscosity(table, place)
    temperature = _temperature(table, place)
    outlet = value_of(table, "outlet_pressure", "Pa", STANDARD_PRESSURE)
    inlet = value_of(table, "inlet_pressure", "Pa", outlet)
    with faults_of(place):
        if table.get("kind") == RealGas.kind:
            RealGas(table["name"], temperature)
            return table
        found = named_fluid(table["name"], temperature, (inlet, outlet))
    kind = table.get("kind", found.kind)
    if not isinstance(kind, str) or kind not in FLUIDS:
        return table
    units = {f.name: f.metadata["unit"] for f in fields(FLUIDS[kind]) if "unit" in f.metadata}
    known = {
        key: Amount(value, units[key]) for key, value in found.parameters.items() if key in units
    }
    given = {key: value for key, value in table.items() if key != "temperature" or key in units}
    given = _with_dynamic_viscosity({"kind": kind, **given}, place, found.parameters.get("density"))
    if kind != found.kind:
        odd.append(
            f"{place}.kind {kind} stands for {table['name']}, which is of kind {found.kind} there: leave it out"
        )
    odd += _overriding(given, known, place)
    return {**known, **given}


def _temperature(table: dict[str, Any], place: str) -> float:
    """Read the temperature [K] of a named fluid, 20 °C unless given; a liquid has no key that would check it later."""
    if "temperature" not in table:
        return TABLE_TEMPERATURE
    expected = "a temperature above absolute zero, such as '20 °C'"
    try:
        temperature = in_si(table["temperature"], "K", "20 °C")
    except InputError as error:
        raise fault(f"{place}.temperature", error.given, error.expected) from None
    if temperature <= 0:
        raise fault(f"{place}.temperature", shown(table["temperature"]), expected)
    return temperature


def _overriding(given: dict[str, Any], known: dict[str, Amount], place: str) -> Iterator[str]:
    """A sentence for each key that stands in place of a much larger or smaller value of what is named."""
    for name, usual in known.items():
        value = value_of(given, name, usual.unit, 0.0)
        if value > 0 and not 1 / _ODD_RATIO <= (ratio := value / usual) <= _ODD_RATIO:
            unit = usual.unit.replace("*", "·")
            times = f"{ratio:.2g} times" if ratio > 1 else f"{1 / ratio:.2g} times less than"
            yield (
                f"{place}.{name} {to_text(value, unit)} is {times} that of {given['name']}, "
                f"{to_text(usual, unit)}: right if it was measured, else leave out the key, or the name"
            )


def _filled_solid(
    table: dict[str, Any], place: str, folder: Path, odd: list[str]
) -> dict[str, Any]:
    """The table of a solid with what its name stands for, and its table of hardness from a file, in a folder.

    place : its key in the case. odd : gets sentences on given keys that differ much from what the name stands for.
    """
    given = dict(table)
    if isinstance(path := given.get("hardness_table"), str):
        given["hardness_table"] = _hardness_rows(folder / path, f"{place}.hardness_table")
    if "name" not in given:
        return given
    with faults_of(place):
        solid = named_solid(given["name"])
    assert solid.yield_stress is not None
    values = {"young": solid.young, "poisson": solid.poisson, "yield_stress": solid.yield_stress}
    values["hardness"] = HARDNESS_FACTOR * solid.yield_stress
    known = {name: Amount(value, _UNITS[name]) for name, value in values.items()}
    odd += _overriding(given, known, place)
    del known["hardness"]
    if "hardness" in given or "hardness_table" in given:
        del known["yield_stress"]
    return known | given


def _hardness_rows(path: Path, key: str) -> list[list[str]]:
    """Rows of depth and hardness, as text with units, from a file with a line of heads; `key` names it in faults."""
    name = f"'{shortened(path.name)}'"
    if not isfile(path):
        raise fault(key, name, "a file that exists, or rows such as ['0.1 um', '2 GPa']")
    try:
        heads = {match[1]: match for match in map(_COLUMN.match, columns_of(path)) if match}
        columns = heads["depth"], heads["hardness"]
        numbers = read_columns(path, tuple(column[0] for column in columns))
    except (InputError, KeyError):
        raise fault(key, name, HARDNESS_COLUMNS) from None
    if len(numbers) < 2:
        given = f"{name} with {counted(len(numbers), 'row')} of numbers"
        raise fault(key, given, f"{HARDNESS_COLUMNS}, and two rows or more")
    return [
        [f"{value!r} {column[2]}" for value, column in zip(row, columns, strict=True)]
        for row in numbers.tolist()
    ]
