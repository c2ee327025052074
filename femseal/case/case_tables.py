"""Tables of a case file for the solids, for what is registered by its kind, and for the output.

Neither fluids nor shapes are named here: whatever is registered in `fluids.FLUIDS`, `seal.layouts.LAYOUTS`,
`seal.form.FORMS` or `topography.seat.SEATS` has a table, with a key for each parameter.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from ..base import InputError
from ..base.leak_rates import BUBBLE, DROP, KNOWN, leak_classes
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit
from ..budget.error_parts import MODEL_PARTS
from ..contact import ContactLaw, HardnessTable, LinearHardening, NixGao, PerfectlyPlastic
from ..contact.hardness_curves import SMALLEST_DEPTH
from ..fluids import FLUIDS, Fluid
from ..materials import Solid
from ..seal.form import FORMS
from ..seal.layouts import LAYOUTS, NAMES, Layout, MeshLayout, RectangularLayout, lay_of
from ..studies.choices import FIELDS_LIMIT, FORMATS
from ..topography.seat import SEATS
from .faults import fault, refusal, refusals
from .filling import HARDNESS_COLUMNS, listed
from .values import (
    FileSize,
    Hardening,
    Height,
    Length,
    LengthUnit,
    MadeTable,
    Modulus,
    Place,
    Poisson,
    Pressure,
    Quantity,
    Shift,
    Strength,
    Table,
    Temperature,
    Usual,
    Volume,
    VolumeRate,
    key,
    quantity_schema,
    table_of_any,
)

if TYPE_CHECKING:
    from ..studies.scene import FluidState

_PAIR = {
    "items": quantity_schema("a depth >= 0, then a hardness > 0"),
    "minItems": 2,
    "maxItems": 2,
}
_ROWS = {"type": "array", "items": {"type": "array"} | _PAIR}


def _two_rows(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) < 2:
        raise refusal("two rows or more, such as ['0.1 um', '2 GPa']")
    return value


class SolidTable(Table):
    """A solid, see `materials.Solid`, and the law by which it yields."""

    young: Modulus = key("Young's modulus", start="210 GPa", needed="without a `name`")
    poisson: Poisson = key("Poisson's ratio", 0.3, start=0.3)
    yield_stress: Strength | None = key(
        "hardness is 2.8 times that; without any strength the solid is elastic",
        None,
        example="1 GPa",
        instead="hardness",
    )
    hardness: Strength | None = key("largest contact pressure", None, start="2.8 GPa")
    hardening: Hardening | None = key(
        "rise of the hardness with the yielded depth", None, example="2 GPa/um", since="0.2"
    )
    hardness_tolerance: float = key(
        "relative error of the hardness, for the budget", 0.1, ge=0, lt=1, since="0.2"
    )
    nix_gao_depth: Annotated[Height, Usual(1e-8, 1e-4, "m")] | None = key(
        "depth h* of Nix and Gao: hardness × sqrt(1 + h*/depth)",
        None,
        example="1 um",
        since="0.2",
        instead="hardening",
    )
    smallest_depth: Annotated[Length, Usual(1e-9, 1e-5, "m")] | None = key(
        "depth up to which that is constant",
        None,
        example="0.1 um",
        since="0.2",
        instead="hardening",
    )
    hardness_table: Annotated[
        tuple[tuple[Annotated[Place, Usual(1e-10, 1e-3, "m")], Strength], ...] | None,
        BeforeValidator(_two_rows),
        WithJsonSchema({"anyOf": [{"type": "string", "expected": HARDNESS_COLUMNS}, _ROWS]}),
    ] = key(
        "hardness over the yielded depth, in rows or a file",
        None,
        example=[["0.1 um", "2.4 GPa"], ["0.5 um", "2.1 GPa"], ["2 um", "2 GPa"]],
        since="0.2",
        instead="hardness",
    )
    name: str | None = key(
        "fills in `young`, `poisson` and `yield_stress`",
        None,
        example="copper, soft",
        since="0.2",
        max_length=60,
    )

    @model_validator(mode="after")
    def _one_law(self) -> SolidTable:
        """Raise a fault if several keys give the strength, or a curve has none."""
        given, curves = (
            [key for key in keys if getattr(self, key) is not None]
            for keys in (
                ("yield_stress", "hardness", "hardness_table"),
                ("hardening", "nix_gao_depth"),
            )
        )
        for keys in (given, curves):
            if len(keys) > 1:
                raise refusal(f"{' or '.join(keys)}, not both")
        if curves and given not in (["yield_stress"], ["hardness"]):
            raise refusal(f"{curves[0]} with a yield_stress or a hardness")
        if self.smallest_depth is not None and self.nix_gao_depth is None:
            raise refusal("smallest_depth with a nix_gao_depth")
        try:
            _ = self.law
        except InputError as error:
            key = "hardness_table" if self.hardness_table is not None else error.what
            raise refusal(f"{key}: {error.expected}") from None
        return self

    @property
    def solid(self) -> Solid:
        """The solid; of a table of hardness, with that where it first yields."""
        table = self.hardness_table
        return Solid(
            self.young, self.poisson, self.yield_stress, table[0][1] if table else self.hardness
        )

    @property
    def law(self) -> ContactLaw:
        """The contact law of its keys: perfectly plastic, hardening, or a curve of the depth."""
        if self.hardness_table is not None:
            return HardnessTable(*np.array(self.hardness_table, dtype=float).T)
        hardness = self.solid.hardness
        assert hardness is not None  # a Solid has one, inf where none is given
        if self.nix_gao_depth is not None:
            return NixGao(hardness, self.nix_gao_depth, self.smallest_depth or SMALLEST_DEPTH)
        return (
            PerfectlyPlastic(hardness)
            if self.hardening is None
            else LinearHardening(hardness, self.hardening)
        )


class FluidTable(MadeTable):
    """A fluid, with a key for each of its parameters, and its pressures at both ends."""

    makers = FLUIDS
    if TYPE_CHECKING:
        inlet_pressure: float
        outlet_pressure: float
        ambient_pressure: float | None
        name: str | None

    @property
    def fluid(self) -> Fluid:
        """The fluid."""
        made: Fluid = self.make()
        return made

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
    known = "name" in fluid.__dataclass_fields__
    return {
        "inlet_pressure": (Annotated[Pressure, Usual(100.0, 2e9, "Pa")], inlet),
        "outlet_pressure": (Pressure, outlet),
        "ambient_pressure": (Annotated[Pressure, Usual(100.0, 2e8, "Pa")] | None, ambient),
        "name": Annotated[str, Field(max_length=60)] if known else (str | None, named),
    }


class FormTable(MadeTable):
    """A form of the whole seal, with a key for each of its parameters."""

    makers = FORMS
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
    place = "seal"
    form: Annotated[tuple[AnyForm, ...], BeforeValidator(listed), Field(max_length=4)] | None = key(
        "form of the whole seal; several add up", None, since="0.2"
    )
    flatness: Annotated[Length, Usual(1e-8, 1e-2, "m")] | None = key(
        "highest to lowest point of a whole seal of unknown form", None, example="5 um", since="0.2"
    )

    def make(self, folder: Path = Path(), **more: Any) -> Layout:
        """The shape; paths are relative to a folder."""
        return super().make(folder, lay=lay_of(self.lay, folder), **more)


def _lay(value: Any) -> Any:
    with refusals():
        lay = lay_of(value)
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
    place = "seat"
    tolerance: float = key(
        "relative error of the depth of the form, for the budget", 0.0, ge=0, lt=1
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


#: Keys of [output] that say which files are written, and change no number.
FILE_KEYS = ("pictures", "report", "fields", "paraview", "fields_limit")
_LEAK_UNITS = f"a unit of leakage: {', '.join(LEAK_UNITS)}"


def _text(expected: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "expected": expected})


def _leak_unit_name(value: Any) -> str:
    with refusals():
        return leak_unit(value).name


def _class_name(value: Any) -> str:
    with refusals():
        leak_classes([value])
    return str(value)


class OutputTable(Table):
    """Optional contents of the results folder, and how leakage is given."""

    pictures: bool = key("false leaves out the report too; `--resume` adds them", True)
    report: bool = key("`report.html`; `femseal report DIR` makes it later", True)
    fields: bool = key("gap, contact and fluid pressure of all pixels", True)
    paraview: Literal[FORMATS] = key(  # type: ignore[valid-type]
        "files for any ParaView, or none", "vtu"
    )
    fields_limit: FileSize = key(
        "size above which steps are left out", FIELDS_LIMIT, example="1 GB"
    )
    leakage_unit: Annotated[str, BeforeValidator(_leak_unit_name), _text(_LEAK_UNITS)] | None = key(
        "of tables, pictures and report; a readable one unless given", None, example="mL/min"
    )
    throughput_temperature: Temperature | None = key(
        "of gases in Pa·m³/s or mbar·L/s; their own unless given", None
    )
    classes: tuple[Annotated[str, BeforeValidator(_class_name), _text(KNOWN)], ...] = key(
        "classes that are judged at every step", (), example=["L0.01", "TA Luft"]
    )
    nominal_diameter: Annotated[Length, Usual(1e-3, 10.0, "m")] | None = key(
        "of valve, seat or stem, for classes", None, example="50 mm"
    )
    rated_capacity: VolumeRate | None = key("flow of the open valve, for FCI 70-2 IV", None)
    drop_volume: Volume = key('of `"drops/min"`; classes have their own', DROP, example="0.05 mL")
    bubble_volume: Volume = key(
        'of `"bubbles/min"`; classes have their own', BUBBLE, example="0.15 mL"
    )
    test_fluid: AnyFluid | None = key(
        "fluid of a leak test of the same seals, by which classes are judged",
        None,
        example={"name": "helium", "inlet_pressure": "40 bar"},
    )
    budget: bool = key("the band of error of every leakage", True)
    model_parts: tuple[Literal[MODEL_PARTS], ...] = key(  # type: ignore[valid-type]
        "sources of the budget that are of model and input", MODEL_PARTS, since="0.2"
    )

    @model_validator(mode="before")
    @classmethod
    def _no_report(cls, data: Any) -> Any:
        return (
            {"report": False, **data}
            if isinstance(data, dict) and data.get("pictures") is False
            else data
        )

    @model_validator(mode="after")
    def _together(self) -> OutputTable:
        if self.report and not self.pictures:
            raise fault(
                "output.report", "true with pictures = false", "false: the page is made of pictures"
            )
        return self

    @property
    def valve(self) -> dict[str, float]:
        """What units and classes need to know of the valve and its test, see `base.leak_rates.LeakBasis`."""
        known = {
            "drop": self.drop_volume,
            "bubble": self.bubble_volume,
            "capacity": self.rated_capacity,
        }
        return {name: value for name, value in known.items() if value is not None}

    @property
    def files(self) -> dict[str, Any]:
        """Which files are written, as arguments of `report.write_folder`."""
        return self.model_dump(include=set(FILE_KEYS))

    @property
    def unit(self) -> LeakUnit | None:
        """The unit, or None for a readable one per length of seal."""
        return None if self.leakage_unit is None else LEAK_UNITS[self.leakage_unit]
