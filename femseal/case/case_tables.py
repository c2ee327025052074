"""Tables of a case file except those of faces, load, fluid and seal: solid, contact, flow, pieces, draws, output."""

from __future__ import annotations

import re
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from ..base import InputError, counted, shortened, to_text
from ..base.leak_rates import BUBBLE, DROP, KNOWN, LEAK_UNITS, LeakUnit, leak_classes, leak_unit
from ..budget.error_parts import MODEL_PARTS
from ..contact import ContactLaw, HardnessTable, LinearHardening, NixGao, PerfectlyPlastic
from ..contact.hardness_curves import SMALLEST_DEPTH
from ..flow.solution import SOLVERS
from ..materials import HARDNESS_FACTOR, Solid, named_solid
from ..studies.choices import FIELDS_LIMIT, FLUID_PRESSURES, FORMATS
from .faults import fault, faults_of, refusal
from .fluid import AnyFluid, overriding
from .values import (
    Both,
    Count,
    FileSize,
    Hardening,
    Height,
    Length,
    Modulus,
    Place,
    Poisson,
    Ratio,
    Strength,
    Table,
    Temperature,
    Usual,
    Volume,
    VolumeRate,
    one_of,
    quantity_schema,
)

Boundary = Literal["periodic", "mirror", "free"]


class ContactTable(Table):
    """How contact is solved, and whether the fluid presses the faces apart, see `studies.Scene`."""

    boundary: Annotated[tuple[Boundary, Boundary], Both()] = ("free", "periodic")
    rtol: Annotated[float, Field(gt=0, lt=0.1)] = 1e-5
    fluid_pressure: Annotated[str, *one_of(FLUID_PRESSURES)] = "acts"


class FlowTable(Table):
    """How flow is solved, in pieces, in whole faces and over the seal."""

    solver: Annotated[str, *one_of(SOLVERS)] = "auto"


class CellsTable(Table):
    """Pieces of a measured place for the two-scale and stochastic methods: their number, or about their size.

    Without both, drawn seals have as many as suit them, and sides of two scales are eight of the shortest waves.
    """

    count: tuple[Count, Count] | None = None
    size: Annotated[Length, Usual(1e-7, 0.1, "m")] | None = None

    @model_validator(mode="after")
    def _one_of(self) -> CellsTable:
        if self.count is not None and self.size is not None:
            raise PydanticCustomError("cells", "one of `count` and `size`")
        return self


def _one_length(value: Any) -> Any:
    if isinstance(value, list):
        raise refusal("one length, such as '10 mm'; lists are removed: femseal sweep runs a case with several values")
    return value


class StochasticTable(Table):
    """How a seal is drawn, see `studies.Sampling`."""

    length: Annotated[Length | None, BeforeValidator(_one_length)] = None
    breadth: Annotated[Length, Usual(1e-6, 1.0, "m")] | None = None
    realisations: Annotated[int, Field(strict=True, ge=2)] | None = None
    quantiles: tuple[Ratio, Ratio] = (0.05, 0.95)

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
    classes : leakage classes checked at every step, see `base.leak_rates`. nominal_diameter,
    rated_capacity : of a valve, which some need, the latter as flow of the fluid that decides, of a gas at 101 325 Pa.
    drop_volume, bubble_volume : of leakage in drops and bubbles per minute; classes have those of their standard.
    test_fluid : of a leak test, whose leakage stands beside; classes are checked with it.
    budget : the error of every leakage, source by source, see `budget.error_budget`. model_parts : those of its sources
    that are errors of the model and its input.
    """

    pictures: bool = True
    report: bool = True
    fields: bool = True
    paraview: Annotated[str, *one_of(FORMATS, "; files .vtkhdf are removed: every ParaView opens vtu")] = "vtu"
    fields_limit: FileSize = FIELDS_LIMIT
    leakage_unit: Annotated[
        str | None, BeforeValidator(_leak_unit_name), WithJsonSchema({"type": "string", "description": _LEAK_UNIT_TEXT})
    ] = None

    throughput_temperature: Temperature | None = None
    classes: tuple[
        Annotated[str, BeforeValidator(_class_name), WithJsonSchema({"type": "string", "description": KNOWN})], ...
    ] = ()
    nominal_diameter: Annotated[Length, Usual(1e-3, 10.0, "m")] | None = None
    rated_capacity: VolumeRate | None = None
    drop_volume: Volume = DROP
    bubble_volume: Volume = BUBBLE
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
    def valve(self) -> dict[str, float]:
        """What units and classes need to know of the valve and its test, see `base.leak_rates.LeakBasis`."""
        known = {"drop": self.drop_volume, "bubble": self.bubble_volume, "capacity": self.rated_capacity}
        return {name: value for name, value in known.items() if value is not None}

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


#: Units of the parameters of a solid that has a name.
_UNITS = {"young": "Pa", "poisson": "", "yield_stress": "Pa", "hardness": "Pa"}
#: A column of a file of hardness over depth.
_COLUMN = re.compile(r"^\s*(depth|hardness)\s*[\[(]\s*(.+?)\s*[\])]\s*$")
_FILE_COLUMNS = "two columns with commas, the first line 'depth [um], hardness [GPa]' or with other units"
_ROW = {"type": "array", "items": quantity_schema("a depth >= 0, then a hardness > 0"), "minItems": 2, "maxItems": 2}


def _two_rows(value: Any) -> Any:
    if isinstance(value, (list, tuple)) and len(value) < 2:
        raise refusal("two rows or more, such as ['0.1 um', '2 GPa']")
    return value


class SolidTable(Table):
    """A solid, see `materials.Solid`, and the law by which it yields."""

    young: Modulus
    poisson: Poisson = 0.3
    yield_stress: Strength | None = None
    hardness: Strength | None = None
    hardening: Hardening | None = None
    hardness_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.1
    nix_gao_depth: Annotated[Height, Usual(1e-8, 1e-4, "m")] | None = None
    smallest_depth: Annotated[Length, Usual(1e-9, 1e-5, "m")] | None = None
    hardness_table: Annotated[
        tuple[tuple[Annotated[Place, Usual(1e-10, 1e-3, "m")], Strength], ...] | None,
        BeforeValidator(_two_rows),
        WithJsonSchema({"anyOf": [{"type": "string", "description": _FILE_COLUMNS}, {"type": "array", "items": _ROW}]}),
    ] = None
    name: Annotated[str | None, Field(max_length=60)] = None

    @model_validator(mode="after")
    def _one_law(self) -> SolidTable:
        """Raise a fault if several keys give the strength, or a curve has none."""
        given = [k for k in ("yield_stress", "hardness", "hardness_table") if getattr(self, k) is not None]
        curves = [k for k in ("hardening", "nix_gao_depth") if getattr(self, k) is not None]
        if len(given) > 1:
            raise PydanticCustomError("strength", "{keys}, not both", {"keys": " or ".join(given)})
        if len(curves) > 1:
            raise PydanticCustomError("strength", "hardening or nix_gao_depth, not both")
        if curves and given not in (["yield_stress"], ["hardness"]):
            raise PydanticCustomError("strength", "{key} with a yield_stress or a hardness", {"key": curves[0]})
        if self.smallest_depth is not None and self.nix_gao_depth is None:
            raise PydanticCustomError("strength", "smallest_depth with a nix_gao_depth")
        try:
            _ = self.law
        except InputError as error:
            key = "hardness_table" if self.hardness_table is not None else error.what
            raise PydanticCustomError("strength", "{key}: {text}", {"key": key, "text": error.expected}) from None
        return self

    @property
    def solid(self) -> Solid:
        """The solid; of a table of hardness, with that where it first yields."""
        table = self.hardness_table
        return Solid(self.young, self.poisson, self.yield_stress, table[0][1] if table else self.hardness)

    @property
    def law(self) -> ContactLaw:
        """The contact law of its keys: perfectly plastic, hardening, or a curve of the depth."""
        if self.hardness_table is not None:
            return HardnessTable(*np.array(self.hardness_table, dtype=float).T)
        hardness = self.solid.hardness
        assert hardness is not None  # a Solid has one, inf where none is given
        if self.nix_gao_depth is not None:
            return NixGao(hardness, self.nix_gao_depth, self.smallest_depth or SMALLEST_DEPTH)
        return PerfectlyPlastic(hardness) if self.hardening is None else LinearHardening(hardness, self.hardening)


def with_named_solids(data: Any) -> Any:
    """The data of a case with the properties of solids that are given by their name, and tables of hardness from files.

    `solid_warnings` says which given keys differ much from what the name stands for.
    """
    if not isinstance(data, dict):
        return data
    odd: list[str] = []
    folder = Path(data.get("folder", "."))
    places = [place for place in ("material", "counter_material") if isinstance(data.get(place), dict)]
    found = {place: _filled(data[place], place, folder, odd) for place in places}
    return {**data, **found, "solid_warnings": tuple(odd)}


def _filled(table: dict[str, Any], place: str, folder: Path, odd: list[str]) -> dict[str, Any]:
    """The table of a solid; `place` is its key in the case; what is odd in it is added to `odd`."""
    given = dict(table)
    if isinstance(path := given.get("hardness_table"), str):
        given["hardness_table"] = read_hardness_table(folder / path, f"{place}.hardness_table")
    if "name" not in given:
        return given
    with faults_of(place):
        solid = named_solid(given["name"])
    assert solid.yield_stress is not None
    known = {"young": solid.young, "poisson": solid.poisson, "yield_stress": solid.yield_stress}
    odd += overriding(given, known | {"hardness": HARDNESS_FACTOR * solid.yield_stress}, _UNITS, place)
    if "hardness" in given or "hardness_table" in given:
        del known["yield_stress"]
    return {key: f"{value!r} {_UNITS[key]}".strip() for key, value in known.items()} | given


def read_hardness_table(path: Path, key: str) -> list[list[str]]:
    """Rows of depth and hardness, as text with units, from a file with a line of heads; `key` names it in faults."""
    if not isfile(path):
        raise fault(key, f"'{shortened(path.name)}'", "a file that exists, or rows such as ['0.1 um', '2 GPa']")
    try:
        lines = [line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]
        heads, *rows = ([cell.strip() for cell in re.split("[,;\t]", line)] for line in lines)
        columns = [(match[1], match[2]) for match in map(_COLUMN.match, heads) if match]
        units = dict(columns)
        places = [[name for name, _ in columns].index(name) for name in ("depth", "hardness")]
        numbers = [[float(row[n]) for n in places] for row in rows if len(row) == len(columns) == 2]
    except (OSError, ValueError):
        raise fault(key, f"'{shortened(path.name)}'", _FILE_COLUMNS) from None
    if len(numbers) < len(rows):
        raise fault(key, f"'{shortened(path.name)}'", _FILE_COLUMNS)
    if len(rows) < 2:
        given = f"'{shortened(path.name)}' with {counted(len(rows), 'row')} of numbers"
        raise fault(key, given, f"{_FILE_COLUMNS}, and two rows or more")
    return [[f"{depth!r} {units['depth']}", f"{hardness!r} {units['hardness']}"] for depth, hardness in numbers]
