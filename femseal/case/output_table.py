"""Define the table [output] of a case: the files that a run writes, the leakage unit and the leakage classes."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, WithJsonSchema, model_validator

from ..base import InputError
from ..base.leak_classes import KNOWN, find_leak_classes
from ..base.leak_rates import BUBBLE, DROP
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit
from ..budget.sources import MODEL_PARTS
from ..results.file_options import FIELDS_LIMIT, PARAVIEW_FORMATS, PICTURE_FORMATS
from .faults import as_value_error
from .quantity_types import FileSize, Length, Temperature, UsualRange, Volume, VolumeRate
from .seal_tables import AnyFluid
from .table_types import Table, key

#: Keys that determine which files are written, without an effect on the results.
FILE_KEYS = ("pictures", "picture_formats", "report", "fields", "paraview", "fields_limit")


def _read_unit(value: Any) -> str:
    """Return the name of a leakage unit; raise an InputError if it is unknown."""
    with as_value_error():
        return leak_unit(value).name


def _read_class(value: Any) -> str:
    """Return the name of a leakage class; raise an InputError if it is unknown."""
    with as_value_error():
        find_leak_classes([value])
    return str(value)


def _text_schema(expected: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "expected": expected})


LeakUnitName = Annotated[
    str,
    BeforeValidator(_read_unit),
    _text_schema(f"a unit of leakage: {', '.join(LEAK_UNITS)}"),
]
LeakClassName = Annotated[str, BeforeValidator(_read_class), _text_schema(KNOWN)]


class OutputTable(Table):
    """Optional contents of the results folder, and the unit and the classes of the leakage."""

    pictures: bool = key(
        "whether pictures are drawn; without them there is no report; `--resume` draws them later",
        True,
    )
    picture_formats: tuple[Literal[PICTURE_FORMATS], ...] = key(  # type: ignore[valid-type]
        "formats of the pictures; svg and pdf are suitable for print",
        ("png",),
        example=["png", "pdf"],
    )
    report: bool = key(
        "whether `report.html` is written; `femseal report DIR` can write it later", True
    )
    fields: bool = key(
        "whether gap, contact pressure and fluid pressure at all pixels are written", True
    )
    paraview: Literal[PARAVIEW_FORMATS] = key(  # type: ignore[valid-type]
        "files for ParaView", "vtu"
    )
    fields_limit: FileSize = key(
        "largest total size of the fields at all pixels; if they are larger, some load steps "
        "are left out",
        FIELDS_LIMIT,
        example="1 GB",
    )
    leakage_unit: LeakUnitName | None = key(
        "unit of leakages in tables, pictures and the report; by default one that suits the values",
        None,
        example="mL/min",
    )
    throughput_temperature: Temperature | None = key(
        "temperature to which leakages of a gas in Pa·m³/s or mbar·L/s refer; by default, "
        "the temperature of the gas",
        None,
    )
    classes: tuple[LeakClassName, ...] = key(
        "leakage classes that are checked at every load", (), example=["L0.01", "TA Luft"]
    )
    nominal_diameter: Annotated[Length, UsualRange(1e-3, 10.0, "m")] | None = key(
        "nominal diameter of the valve, seat or stem, for leakage classes that depend on it",
        None,
        example="50 mm",
    )
    rated_capacity: VolumeRate | None = key(
        "flow through the open valve, for class IV of FCI 70-2", None
    )
    drop_volume: Volume = key(
        'volume of a drop, for leakages in `"drops/min"`; leakage classes use the volume in '
        "their standard",
        DROP,
        example="0.05 mL",
    )
    bubble_volume: Volume = key(
        'volume of a bubble, for leakages in `"bubbles/min"`; leakage classes use the volume '
        "in their standard",
        BUBBLE,
        example="0.15 mL",
    )
    test_fluid: AnyFluid | None = key(
        "fluid of a leak test of the same seal; leakage classes are then checked with this fluid",
        None,
        example={"name": "helium", "inlet_pressure": "40 bar"},
    )
    budget: bool = key(
        "whether the error budget and the 95 % interval of every leakage are computed", True
    )
    model_parts: tuple[Literal[MODEL_PARTS], ...] = key(  # type: ignore[valid-type]
        "sources of the error budget that concern the model and the input", MODEL_PARTS, since="0.2"
    )

    @model_validator(mode="before")
    @classmethod
    def _leave_out_report(cls, data: Any) -> Any:
        """Set `report` to False if `pictures` is False, unless the case has a key `report`."""
        if isinstance(data, dict) and data.get("pictures") is False:
            return {"report": False, **data}
        return data

    @model_validator(mode="after")
    def _check_report(self) -> OutputTable:
        """Raise an InputError if `report` is true and `pictures` is false, because the report contains the pictures."""
        if self.report and not self.pictures:
            expected = "false, because the report consists of pictures"
            raise InputError("report", "true with pictures = false", expected)
        return self

    @property
    def valve(self) -> dict[str, float]:
        """Drop volume, bubble volume and rated capacity, as arguments for `base.leak_rates.LeakBasis`."""
        values = {
            "drop_volume": self.drop_volume,
            "bubble_volume": self.bubble_volume,
            "capacity": self.rated_capacity,
        }
        return {name: value for name, value in values.items() if value is not None}

    @property
    def files(self) -> dict[str, Any]:
        """Values of the keys that determine which files are written, as arguments of `report.write_folder`."""
        return self.model_dump(include=set(FILE_KEYS))

    @property
    def unit(self) -> LeakUnit | None:
        """Leakage unit of the case; None if the case has no leakage unit."""
        return None if self.leakage_unit is None else LEAK_UNITS[self.leakage_unit]


def with_picture_formats(case: Any, formats: tuple[str, ...]) -> Any:
    """Return a copy of a case that writes pictures in the given formats, even if the case itself writes none."""
    output = case.output.model_copy(update={"pictures": True, "picture_formats": formats})
    return case.model_copy(update={"output": output})
