"""Define the tables [fluid], [seal], [seal.form] and [seat] of a case.

These tables are derived from registered classes. For every class in `fluids.FLUIDS`, `seal.layouts.LAYOUTS`,
`seal.form.FORMS` and `topography.seat.SEATS` there is a table with a key for each parameter of the class. Only two
groups of keys are declared here: keys without a corresponding parameter, and keys with a more specific type than the
parameter.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema

from ..base import InputError
from ..fluids import FLUIDS, Fluid
from ..seal.form import FORMS
from ..seal.input_checks import check_inlet
from ..seal.layouts import LAY_NAMES, LAYOUTS, Layout, MeshLayout, RectangularLayout, parse_lay
from ..topography.seat import SEATS
from .completed_tables import as_tables
from .faults import as_value_error, invalid_value
from .quantity_types import (
    Length,
    LengthUnit,
    Pressure,
    Shift,
    UsualRange,
)
from .table_types import ParameterTable, key, table_for_each

if TYPE_CHECKING:
    from ..scene import FluidState

# --- [fluid] ----------------------------------------------------------------------------------------------------


class FluidTable(ParameterTable):
    """A fluid, with a key for each of its parameters, and its pressures at inlet and outlet."""

    makers = FLUIDS
    is_checked = False  # it is enough to check each parameter separately
    if TYPE_CHECKING:
        inlet_pressure: float
        outlet_pressure: float
        ambient_pressure: float | None
        name: str | None

    @property
    def fluid(self) -> Fluid:
        """Fluid that the table describes."""
        fluid: Fluid = self.make()
        return fluid

    @property
    def state(self) -> FluidState:
        """Fluid with its pressures at inlet and outlet."""
        from ..scene import FluidState

        return FluidState(self.fluid, self.inlet_pressure, self.outlet_pressure)


def _keys_of_fluid(fluid: Any) -> dict[str, Any]:
    """Return the keys that the table of a fluid has in addition to the parameters of the fluid: name and pressures."""
    inlet = key(
        "pressure at the inlet; for a gas it is absolute, unless it is given as a gauge "
        'pressure such as `"99 bar(g)"`',
        start="1 MPa",
    )
    outlet = key(
        "pressure at the outlet, given in the same way as at the inlet",
        fluid.outlet_pressure,
        start="0.1 MPa",
    )
    ambient = key(
        "ambient pressure, to which gauge pressures refer; if it is given, it is also the "
        "default pressure at the outlet",
        None,
        example="1 atm",
        since="0.2",
    )
    name = key(
        "name of a fluid, from which its properties follow; more names are known after `pip "
        "install 'femseal[fluids]'`",
        None,
        example="water",
        max_length=60,
    )
    # the class of real gases has a parameter `name`, of which only the type is replaced
    is_parameter = "name" in fluid.__dataclass_fields__
    return {
        "inlet_pressure": (Annotated[Pressure, UsualRange(100.0, 2e9, "Pa")], inlet),
        "outlet_pressure": (Pressure, outlet),
        "ambient_pressure": (Annotated[Pressure, UsualRange(100.0, 2e8, "Pa")] | None, ambient),
        "name": Annotated[str, Field(max_length=60)] if is_parameter else (str | None, name),
    }


# --- [seal.form] ------------------------------------------------------------------------------------------------


class FormTable(ParameterTable):
    """A form deviation of the whole seal, with a key for each parameter of the form."""

    makers = FORMS
    tolerance: float = key(
        "relative error of the height of the form, for the error budget",
        0.0,
        example=0.2,
        since="0.2",
        ge=0,
        lt=1,
    )


_KEYS_OF_FORMS: dict[str, Any] = {"unit": LengthUnit | None, "length_unit": LengthUnit}
if TYPE_CHECKING:
    AnyForm = FormTable
else:
    AnyForm = table_for_each(FORMS, FormTable, lambda form: _KEYS_OF_FORMS)


# --- [seal] -----------------------------------------------------------------------------------------------------


class SealTable(ParameterTable):
    """The shape of the seal, with a key for each parameter of the shape, and the form deviation of the seal faces."""

    if TYPE_CHECKING:
        lay: Any
    makers = LAYOUTS
    form: Annotated[tuple[AnyForm, ...], Field(max_length=4), BeforeValidator(as_tables)] | None = (
        key("form of the whole seal; several forms are added", None, since="0.2")
    )
    flatness: Annotated[Length, UsualRange(1e-8, 1e-2, "m")] | None = key(
        "flatness of the whole seal if its form is unknown: height from the lowest to the "
        "highest point",
        None,
        example="5 um",
        since="0.2",
    )

    def make(self, folder: Path = Path(), **others: Any) -> Layout:
        """Create the seal layout.

        folder : folder to which paths in the table are relative.
        """
        layout: Layout = super().make(folder, lay=parse_lay(self.lay, folder), **others)
        return layout


def _read_lay(value: Any) -> Any:
    """Check a lay, and return it in SI units.

    A spiral and an angle are returned as dictionaries with numbers in SI units. If the lay is given in a file, it is
    returned unchanged, because the file is read later.
    """
    with as_value_error():
        lay = parse_lay(value)
    if lay.name == "spiral":
        spiral = {"kind": "spiral", "lead": lay.lead}
        if lay.circumference is not None:
            spiral["circumference"] = lay.circumference
        return spiral
    return value if lay.angle is None else {"angle": lay.angle}


def _read_boundaries(value: Any) -> Any:
    """Check the name of a mesh boundary or a list of names, and return a list as a tuple."""
    try:
        check_inlet(value)  # an earlier version accepted a different pressure for each inlet
    except InputError as error:
        raise InputError("", error.given, error.expected) from None
    if isinstance(value, str) and value:
        return value
    is_list = isinstance(value, (list, tuple)) and len(value) > 0
    if not is_list or not all(isinstance(name, str) and name for name in value):
        raise invalid_value("the name of a boundary, or a list of names")
    return tuple(value)


_LAY_SCHEMA = {"anyOf": [{"type": "string", "enum": list(LAY_NAMES)}, {"type": "object"}]}
_NAMES_SCHEMA = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
Boundaries = Annotated[
    str | tuple[str, ...], BeforeValidator(_read_boundaries), WithJsonSchema(_NAMES_SCHEMA)
]
#: Types of keys that are more specific than the types of the parameters: for all shapes, and for meshes.
_KEYS_OF_SEALS: dict[str, Any] = {
    "lay": Annotated[Any, BeforeValidator(_read_lay), WithJsonSchema(_LAY_SCHEMA)],
    "unit": LengthUnit,
    "centre": tuple[Shift, Shift],
    "length": Annotated[Length, UsualRange(1e-5, 1e3, "m")] | None,
}
_KEYS_OF_MESHES: dict[str, Any] = {"inlet": Boundaries, "outlet": Boundaries}


def _keys_of_seal(layout: Any) -> dict[str, Any]:
    """Return the types of those keys of a layout whose type is more specific than the type of the parameter."""
    return _KEYS_OF_SEALS | (_KEYS_OF_MESHES if layout is MeshLayout else {})


def _strip_by_default(value: Any) -> Any:
    """Add the kind of a strip to a table [seal] that has no kind."""
    return {"kind": RectangularLayout.kind, **value} if isinstance(value, dict) else value


# --- [seat] -----------------------------------------------------------------------------------------------------


class SeatTable(ParameterTable):
    """The shape of the seat, with a key for each parameter of the shape."""

    makers = SEATS
    tolerance: float = key(
        "relative error of the depth of the form, for the error budget", 0.0, ge=0, lt=1
    )


if TYPE_CHECKING:
    AnyFluid = FluidTable
    AnySeal = SealTable
    AnySeat = SeatTable
else:
    AnyFluid = table_for_each(FLUIDS, FluidTable, _keys_of_fluid)
    AnySeal = Annotated[
        table_for_each(LAYOUTS, SealTable, _keys_of_seal), BeforeValidator(_strip_by_default)
    ]
    AnySeat = table_for_each(SEATS, SeatTable, lambda seat: {"unit": LengthUnit})
