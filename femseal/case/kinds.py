"""Tables of a case file for what is registered by its kind: fluids, shapes of the seal, forms of seal and seat.

Neither fluids nor shapes are named here: whatever is registered in `fluids.FLUIDS`, `seal.layouts.LAYOUTS`,
`seal.form.FORMS` or `topography.seat.SEATS` has a table, with a key for each parameter. A name fills in the keys of a
fluid; gauge pressures become absolute and kinematic viscosities dynamic before the tables are checked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from pydantic import BeforeValidator, Field, WithJsonSchema

from ..base import InputError, shortened, shown, to_text
from ..base.leak_rates import STANDARD_PRESSURE
from ..base.quantities import absolute_pressure
from ..fluids import FLUIDS, Fluid
from ..named_fluids import TABLE_TEMPERATURE, RealGas, named_fluid
from ..seal.form import FORMS
from ..seal.layouts import LAYOUTS, NAMES, Layout, MeshLayout, RectangularLayout, lay_of
from ..topography.seat import SEATS
from .faults import fault, faults_of, refusal
from .values import (
    Amount,
    Length,
    LengthUnit,
    MadeTable,
    Pressure,
    Quantity,
    Shift,
    Table,
    Usual,
    key,
    listed,
    quantity_schema,
    table_of_any,
    value_of,
)

if TYPE_CHECKING:
    from ..studies.scene import FluidState

#: Ratio of a given property to that of the named fluid from which on a warning says so.
_ODD_RATIO = 2.0


class FluidTable(Table):
    """A fluid, with a key for each of its parameters, and its pressures at both ends."""

    if TYPE_CHECKING:
        kind: str
        inlet_pressure: float
        outlet_pressure: float
        ambient_pressure: float | None
        name: str | None

    @property
    def fluid(self) -> Fluid:
        """The fluid."""
        made = FLUIDS[self.kind]
        return made(**self.model_dump(include={f.name for f in fields(made)}))

    @property
    def state(self) -> FluidState:
        """The fluid with its pressures."""
        from ..studies.scene import FluidState

        return FluidState(self.fluid, self.inlet_pressure, self.outlet_pressure)


def _state(fluid: Any) -> dict[str, Any]:
    """Keys of every fluid besides its parameters."""
    inlet = key(
        'of a gas absolute; gauge as `"99 bar(g)"`',
        start="10 MPa",
        needed="unless the inlets of a mesh have pressures",
    )
    outlet = key("as the inlet pressure", fluid.outlet_pressure, start="0.1 MPa")
    ambient = key(
        "of gauge pressures, and of the outlet unless it is given with them",
        None,
        example="1 atm",
        since="0.2",
    )
    named = key(
        "fills in the keys of its kind; more names after `pip install 'femseal[fluids]'`",
        None,
        example="water",
        max_length=60,
    )
    known = any(f.name == "name" for f in fields(fluid))
    return {
        "inlet_pressure": (Annotated[Pressure, Usual(100.0, 2e9, "Pa")], inlet),
        "outlet_pressure": (Pressure, outlet),
        "ambient_pressure": (Annotated[Pressure, Usual(100.0, 2e8, "Pa")] | None, ambient),
        "name": Annotated[str, Field(max_length=60)] if known else (str | None, named),
    }


def with_absolute_pressures(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a case with gauge pressures of the fluids, such as "10 bar(g)", as absolute ones in Pa.

    They are above `ambient_pressure` of [fluid], of a test fluid above its own if it has one. Beside them, or with an
    ambient pressure, an outlet without a pressure is at the ambient one.
    """
    seal, gauge = data.get("seal", {}), False
    ambient = value_of(data.get("fluid", {}), "ambient_pressure", "Pa")
    if isinstance(inlets := seal.get("inlet"), dict):
        own = {name: _absolute(p, ambient, f"seal.inlet.{name}") for name, p in inlets.items()}
        data, gauge = data | {"seal": {**seal, "inlet": own}}, own != inlets

    def with_absolute_ends(table: dict[str, Any], place: str) -> dict[str, Any]:
        around = value_of(table, "ambient_pressure", "Pa", ambient)
        keys = [key for key in ("inlet_pressure", "outlet_pressure") if key in table]
        given: dict[str, Any] = {key: table[key] for key in keys}
        ends = {key: _absolute(value, around, f"{place}.{key}") for key, value in given.items()}
        if around is None and not gauge and ends == given:
            return table
        surroundings = Amount(STANDARD_PRESSURE if around is None else around, "Pa")
        return {"ambient_pressure": surroundings, "outlet_pressure": surroundings, **table, **ends}

    return _with_fluids(data, with_absolute_ends)


def _with_fluids(
    data: dict[str, Any], changed: Callable[[dict[str, Any], str], dict[str, Any]]
) -> dict[str, Any]:
    """The data of a case with the tables of its fluid and test fluid changed by a function of table and place."""
    found, output = dict(data), data.get("output", {})
    if "fluid" in data:
        found["fluid"] = changed(data["fluid"], "fluid")
    if isinstance(test := output.get("test_fluid"), dict):
        found["output"] = {**output, "test_fluid": changed(test, "output.test_fluid")}
    return found


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


def with_named_fluids(data: dict[str, Any], odd: list[str]) -> dict[str, Any]:
    """The data of a case with the properties of fluids that are given by their name.

    odd : gets sentences on given keys that differ much from what the name stands for.
    """
    return _with_fluids(data, lambda table, place: _filled(table, place, odd))


def _filled(table: dict[str, Any], place: str, odd: list[str]) -> dict[str, Any]:
    """The table of a fluid; `place` is its key in the case; what is odd in it is added to `odd`."""
    if "name" not in table:
        return _with_dynamic_viscosity(table, place)
    temperature = value_of(table, "temperature", "K", TABLE_TEMPERATURE)
    outlet = value_of(table, "outlet_pressure", "Pa", STANDARD_PRESSURE)
    inlet = value_of(table, "inlet_pressure", "Pa", outlet)
    with faults_of(place):
        if table.get("kind") == RealGas.kind:
            RealGas(table["name"], temperature if temperature > 0 else TABLE_TEMPERATURE)
            return table
        found = named_fluid(table["name"], temperature, (inlet, outlet))
    kind = table.get("kind", found.kind)
    if not isinstance(kind, str) or kind not in FLUIDS:
        return table
    units = {f.name: f.metadata["unit"] for f in fields(FLUIDS[kind]) if "unit" in f.metadata}
    filled = {
        key: Amount(value, units[key]) for key, value in found.parameters.items() if key in units
    }
    given = {key: value for key, value in table.items() if key != "temperature" or key in units}
    given = _with_dynamic_viscosity({"kind": kind, **given}, place, found.parameters.get("density"))
    if kind != found.kind:
        odd.append(
            f"{place}.kind {kind} stands for {table['name']}, which is of kind {found.kind} there: leave it out"
        )
    odd += overriding(given, found.parameters, units, place)
    return {**filled, **given}


def overriding(
    given: dict[str, Any], known: dict[str, float], units: dict[str, str], place: str
) -> Iterator[str]:
    """A sentence for each key that stands in place of a much larger or smaller value of the named fluid."""
    for name in (name for name in known if name in units):
        value = value_of(given, name, units[name], 0.0)
        if value > 0 and not 1 / _ODD_RATIO <= (ratio := value / known[name]) <= _ODD_RATIO:
            unit = units[name].replace("*", "·")
            times = f"{ratio:.2g} times" if ratio > 1 else f"{1 / ratio:.2g} times less than"
            yield (
                f"{place}.{name} {to_text(value, unit)} is {times} that of {given['name']}, "
                f"{to_text(known[name], unit)}: right if it was measured, else leave out the key, or the name"
            )


class FormTable(MadeTable):
    """A form of the whole seal, with a key for each of its parameters."""

    makers = FORMS
    apart = ("tolerance",)
    place = "seal.form"
    tolerance: float = key(
        "relative error of the height, for the budget", 0.0, example=0.2, since="0.2", ge=0, lt=1
    )


_UNITS_OF_FORMS: dict[str, Any] = {"unit": LengthUnit | None, "length_unit": LengthUnit}

if TYPE_CHECKING:
    AnyForm = FormTable
else:
    AnyForm = table_of_any(FORMS, FormTable, lambda form: _UNITS_OF_FORMS)


class SealTable(MadeTable):
    """The shape of the seal, with a key for each of its parameters, and the form of its faces."""

    if TYPE_CHECKING:
        lay: Any
    makers = LAYOUTS
    apart = ("form", "flatness")
    place = "seal"
    form: Annotated[tuple[AnyForm, ...], BeforeValidator(listed), Field(max_length=4)] | None = key(
        "form of the whole seal; several add up",
        None,
        since="0.2",
    )
    flatness: Annotated[Length, Usual(1e-8, 1e-2, "m")] | None = key(
        "highest to lowest point of a whole seal of unknown form",
        None,
        example="5 um",
        since="0.2",
    )

    def make(self, folder: Path, **more: Any) -> Layout:
        """The shape; paths are relative to a folder."""
        return super().make(folder, lay=lay_of(self.lay, folder), **more)

    def files(self) -> list[tuple[str, Path]]:
        """Key and path of every file that shapes the seal."""
        found = [
            (name, value)
            for name in type(self).model_fields
            if isinstance(value := getattr(self, name), Path)
        ]
        found += [("form.path", one.path) for one in self.form or () if hasattr(one, "path")]
        lay = lay_of(self.lay)
        return found + ([("lay", lay.file)] if lay.file is not None else [])


def _lay(value: Any) -> Any:
    try:
        lay = lay_of(value)
    except InputError as error:
        raise refusal(error.expected) from None
    if lay.name == "spiral":
        turn = {} if lay.circumference is None else {"circumference": lay.circumference}
        return {"kind": "spiral", "lead": lay.lead} | turn
    return {"angle": lay.angle} if lay.angle is not None else value


def _names(value: Any) -> Any:
    given = [value] if isinstance(value, str) else value
    if (
        not isinstance(given, (list, tuple))
        or not given
        or not all(isinstance(n, str) and n for n in given)
    ):
        raise refusal("the name of a boundary, or a list of names")
    return value if isinstance(value, str) else tuple(value)


def _inlets(value: Any) -> Any:
    return (
        {name: _PRESSURE.read(p) for name, p in value.items()}
        if isinstance(value, dict)
        else _names(value)
    )


def with_inlet_pressure(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a case, in which inlets with pressures of their own give the highest one to the fluid."""
    seal, fluid = data.get("seal", {}), data.get("fluid")
    inlets = seal.get("inlet")
    if fluid is None or seal.get("kind") != MeshLayout.kind or not isinstance(inlets, dict):
        return data
    if "inlet_pressure" in fluid:
        given = f"{shortened(repr(fluid['inlet_pressure']), 60)} beside the pressures of the inlets in seal.inlet"
        raise fault("fluid.inlet_pressure", given, "none there")
    known = [value_of(inlets, name, "Pa", STANDARD_PRESSURE) for name in inlets]
    highest = Amount(max(known, default=STANDARD_PRESSURE), "Pa")
    return {**data, "fluid": {**fluid, "inlet_pressure": highest}}


_LAY_SCHEMA = {"anyOf": [{"type": "string", "enum": list(NAMES)}, {"type": "object"}]}
_NAMES_SCHEMA = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
_Names = Annotated[str | tuple[str, ...], BeforeValidator(_names), WithJsonSchema(_NAMES_SCHEMA)]
_PRESSURE: Quantity = get_args(Pressure)[1]
_PRESSURES_SCHEMA = {
    "type": "object",
    "additionalProperties": quantity_schema("a pressure >= 0, such as '10 MPa'"),
}
_Inlets = Annotated[
    str | tuple[str, ...] | dict[str, float],
    BeforeValidator(_inlets),
    WithJsonSchema({"anyOf": [*_NAMES_SCHEMA["anyOf"], _PRESSURES_SCHEMA]}),
]
#: Keys whose values are not what the fields of the shapes say, or need a unit.
_KEYS: dict[str, Any] = {
    "lay": Annotated[Any, BeforeValidator(_lay), WithJsonSchema(_LAY_SCHEMA)],
    "unit": LengthUnit,
    "centre": tuple[Shift, Shift],
    "length": Annotated[Length, Usual(1e-5, 1e3, "m")] | None,
}
_KEYS_OF_MESHES: dict[str, Any] = {"inlet": _Inlets, "outlet": _Names}


def _strip_by_default(value: Any) -> Any:
    return {"kind": RectangularLayout.kind, **value} if isinstance(value, dict) else value


class SeatTable(MadeTable):
    """The form of the seat, with a key for each of its parameters."""

    makers = SEATS
    apart = ("tolerance",)
    place = "seat"
    tolerance: float = key(
        "relative error of the depth of the form, for the budget",
        0.0,
        ge=0,
        lt=1,
    )


if TYPE_CHECKING:
    AnyFluid = FluidTable
    AnySeal = SealTable
    AnySeat = SeatTable
else:
    AnyFluid = table_of_any(FLUIDS, FluidTable, _state)
    AnySeal = Annotated[
        table_of_any(
            LAYOUTS, SealTable, lambda one: _KEYS | (_KEYS_OF_MESHES if one is MeshLayout else {})
        ),
        BeforeValidator(_strip_by_default),
    ]
    AnySeat = table_of_any(SEATS, SeatTable, lambda seat: {"unit": LengthUnit})
