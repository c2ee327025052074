"""Tables of a case file except those of faces, solids, load, fluid and seal: contact, flow, windows, draws, output."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from ..base.errors import InputError
from ..base.leak_rates import KNOWN, LEAK_UNITS, LeakUnit, leak_classes, leak_unit
from ..base.quantities import to_text
from ..budget.error_parts import MODEL_PARTS
from ..flow.discretisation import DISCRETISATIONS, SOLVERS, check_discretisation
from ..results.paraview import FORMATS, LIMIT
from ..studies.choices import CONTACTS, DRAWS, FLOWS, FLUID_PRESSURES, PRESSURES
from .faults import fault, faults_of, refusal
from .fluid import AnyFluid
from .values import (
    Both,
    Count,
    FileSize,
    Length,
    Lengths,
    Ratio,
    Table,
    Temperature,
    one_of,
)

Boundary = Literal["periodic", "mirror", "free"]


class ContactTable(Table):
    """How contact is solved, and whether the fluid presses the faces apart, see `studies.Scene`."""

    boundary: Annotated[tuple[Boundary, Boundary], Both()] = ("free", "periodic")
    rtol: Annotated[float, Field(gt=0, lt=0.1)] = 1e-5
    fluid_pressure: Annotated[str, *one_of(FLUID_PRESSURES)] = "acts"


class FlowTable(Table):
    """How flow is discretised and solved, in windows, in whole faces and over the seal."""

    solver: Annotated[str, *one_of(SOLVERS)] = "auto"
    discretisation: Annotated[str, *one_of(DISCRETISATIONS)] = "edge"

    @model_validator(mode="after")
    def _together(self) -> FlowTable:
        with faults_of("flow"):
            check_discretisation(self.discretisation, self.solver)
        return self


class CellsTable(Table):
    """Windows of the two-scale and stochastic methods: their number, or about their size; their contact and flow.

    Without number and size their sides are eight of the shortest waves.

    flow, contact : see `studies.two_scale`.
    """

    count: tuple[Count, Count] | None = None
    size: Length | None = None
    flow: Annotated[str, *one_of(FLOWS)] | None = None
    contact: Annotated[str, *one_of(CONTACTS)] | None = None

    @model_validator(mode="after")
    def _one_of(self) -> CellsTable:
        if self.count is not None and self.size is not None:
            raise PydanticCustomError("cells", "one of `count` and `size`")
        return self


class StochasticTable(Table):
    """How a seal is drawn, see `studies.Sampling`."""

    length: Lengths | None = None
    breadth: Length | None = None
    realisations: Annotated[int, Field(strict=True, ge=2)] = 50
    library_cells: Count = 128
    sampler: Annotated[str, *one_of(DRAWS)] | None = None
    pressure: Annotated[str, *one_of(PRESSURES)] = "place"
    library: Path | None = None
    width: Annotated[float, Field(gt=0)] | None = None
    bounds: bool = False
    quantiles: tuple[Ratio, Ratio] = (0.05, 0.95)

    @property
    def lengths(self) -> tuple[float, ...]:
        """All lengths of seal that are given."""
        given = self.length
        return () if given is None else given if isinstance(given, tuple) else (given,)

    @model_validator(mode="after")
    def _ordered(self) -> StochasticTable:
        if not self.quantiles[0] < self.quantiles[1]:
            raise PydanticCustomError("quantiles", "two rising `quantiles`")
        return self


#: Keys of [output] that say which files are written, and change no number.
FILE_KEYS = ("pictures", "report", "fields", "paraview", "fields_limit")
#: What the schema says of units.
_LEAK_UNIT_TEXT = f"a unit of leakage: {', '.join(LEAK_UNITS)}"


def _leak_unit_name(value: Any) -> str:
    try:
        return leak_unit(value).name
    except InputError as error:
        raise refusal(error.expected) from None


def _class_name(value: Any) -> str:
    try:
        leak_classes([value])
    except InputError as error:
        raise refusal(error.expected) from None
    return str(value)


class OutputTable(Table):
    """Optional contents of the results folder, see `report.write_folder`, and how leakage is given.

    pictures, report, fields : whether they are written; a run without pictures has no report either, unless it is
    asked for.
    leakage_unit : of tables, pictures and report. throughput_temperature : of the pressure × volume of gases.
    classes : leakage classes checked at every step, see `base.leak_classes`. nominal_diameter : which some need.
    test_fluid : of a leak test, whose leakage stands beside; classes are checked with it.
    budget : the error of every leakage, source by source, see `budget.error_budget`. model_parts : those of its sources
    that are errors of the model and its input.
    """

    pictures: bool = True
    report: bool = True
    fields: bool = True
    paraview: Annotated[str, *one_of(FORMATS)] = "vtu"
    fields_limit: FileSize = LIMIT
    leakage_unit: Annotated[
        str | None,
        BeforeValidator(_leak_unit_name),
        WithJsonSchema({"type": "string", "description": _LEAK_UNIT_TEXT}),
    ] = None

    throughput_temperature: Temperature | None = None
    classes: tuple[
        Annotated[str, BeforeValidator(_class_name), WithJsonSchema({"type": "string", "description": KNOWN})], ...
    ] = ()
    nominal_diameter: Length | None = None
    test_fluid: AnyFluid | None = None
    budget: bool = True
    model_parts: tuple[Literal[MODEL_PARTS], ...] = MODEL_PARTS  # type: ignore[valid-type]

    @model_validator(mode="before")
    @classmethod
    def _no_report(cls, data: Any) -> Any:
        return {"report": False, **data} if isinstance(data, dict) and data.get("pictures") is False else data

    @model_validator(mode="after")
    def _together(self) -> OutputTable:
        if self.report and not self.pictures:
            raise fault("output.report", "true with pictures = false", "false: the page is made of pictures")
        return self

    @property
    def files(self) -> dict[str, Any]:
        """Which files are written, as arguments of `report.write_folder`."""
        return self.model_dump(include=set(FILE_KEYS))

    @property
    def description(self) -> str:
        """How leakage is given, as text; "" where nothing is asked for."""
        parts = [] if self.leakage_unit is None else [f"in {self.leakage_unit}"]
        if classes := ", ".join(c.name for c in leak_classes(self.classes)):
            parts.append(f"classes {classes}{'' if self.test_fluid is None else ' judged by the test fluid'}")
        if self.test_fluid is not None:
            ends = (to_text(p, "Pa") for p in (self.test_fluid.inlet_pressure, self.test_fluid.outlet_pressure))
            parts.append(f"test fluid {self.test_fluid.kind} from {' to '.join(ends)}")
        return "; ".join(parts)

    @property
    def unit(self) -> LeakUnit | None:
        """The unit, or None for a readable one per length of seal."""
        return None if self.leakage_unit is None else LEAK_UNITS[self.leakage_unit]
