"""Tables of a case file for the shape of the seal, the lay of the face on it, and the form of the seat.

Shapes and forms are not named here: whatever is registered in `seal.layouts.LAYOUTS` or `topography.seat.SEATS` has a
table, with a key for each parameter.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from pydantic import BeforeValidator, Field, WithJsonSchema

from ..base import InputError, shortened
from ..base.leak_rates import STANDARD_PRESSURE
from ..seal.form import FORMS
from ..seal.lay import NAMES, Lay
from ..seal.layouts import LAYOUTS, Layout, MeshLayout, RectangularLayout
from ..topography.seat import SEATS
from .faults import fault, refusal
from .values import (
    Amount,
    Length,
    LengthUnit,
    MadeTable,
    Pressure,
    Quantity,
    Shift,
    Usual,
    key,
    listed,
    quantity_schema,
    table_of_any,
    value_of,
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
        return super().make(folder, lay=Lay.of(self.lay, folder), **more)

    def files(self) -> list[tuple[str, Path]]:
        """Key and path of every file that shapes the seal."""
        found = [
            (name, value)
            for name in type(self).model_fields
            if isinstance(value := getattr(self, name), Path)
        ]
        found += [("form.path", one.path) for one in self.form or () if hasattr(one, "path")]
        lay = Lay.of(self.lay)
        return found + ([("lay", lay.file)] if lay.file is not None else [])


def _lay(value: Any) -> Any:
    try:
        lay = Lay.of(value)
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


if TYPE_CHECKING:
    AnySeal = SealTable
else:
    AnySeal = Annotated[
        table_of_any(
            LAYOUTS, SealTable, lambda one: _KEYS | (_KEYS_OF_MESHES if one is MeshLayout else {})
        ),
        BeforeValidator(_strip_by_default),
    ]


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
    AnySeat = SeatTable
else:
    AnySeat = table_of_any(SEATS, SeatTable, lambda seat: {"unit": LengthUnit})
