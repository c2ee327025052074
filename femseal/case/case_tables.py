"""Tables of a case file except those of faces, load, fluid and seal: solid, contact, flow, pieces, draws, output."""

from __future__ import annotations

import re
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from ..base import InputError, counted, shortened
from ..base.leak_rates import BUBBLE, DROP, KNOWN, LEAK_UNITS, LeakUnit, leak_classes, leak_unit
from ..budget.error_parts import MODEL_PARTS
from ..contact import ContactLaw, HardnessTable, LinearHardening, NixGao, PerfectlyPlastic
from ..contact.hardness_curves import SMALLEST_DEPTH
from ..flow.solution import SOLVERS
from ..seal.seal_files import columns_of, read_columns
from ..solids_and_loads import HARDNESS_FACTOR, Solid, named_solid
from ..studies.choices import FIELDS_LIMIT, FLUID_EFFECTS, FORMATS
from .faults import fault, faults_of, refusal
from .kinds import AnyFluid, overriding
from .values import (
    Amount,
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
    key,
    quantity_schema,
)

Boundary = Literal["periodic", "mirror", "free"]


class ContactTable(Table):
    """How contact is solved, and whether the fluid presses the faces apart, see `studies.Scene`."""

    boundary: Annotated[tuple[Boundary, Boundary], Both()] = key(
        "of the whole face along x1 and x2; one word: of both", ("free", "periodic")
    )
    rtol: float = key("complementarity residual", 1e-5, gt=0, lt=0.1)
    fluid_pressure: Literal[FLUID_EFFECTS] = key(  # type: ignore[valid-type]
        "it presses the faces apart, is trapped in closed pockets too, or is ignored",
        "acts",
        since="0.2",
    )


class FlowTable(Table):
    """How flow is solved, in pieces, in whole faces and over the seal."""

    solver: Literal[SOLVERS] = key(  # type: ignore[valid-type]
        "of the pressure in cells and over the seal", "auto"
    )


class CellsTable(Table):
    """Pieces of a measured place for all methods but the deterministic."""

    count: tuple[Count, Count] | None = key(
        "pieces along x1 and x2; unless given as drawn seals need, for two scales eight shortest "
        "waves a side, for blocks a quarter of a block, 256 points or less",
        None,
        example=[4, 8],
    )
    size: Annotated[Length, Usual(1e-7, 0.1, "m")] | None = key(
        "approximate side of a piece", None, example="60 um", instead="count"
    )

    @model_validator(mode="after")
    def _one_of(self) -> CellsTable:
        if self.count is not None and self.size is not None:
            raise refusal("one of `count` and `size`")
        return self


class StochasticTable(Table):
    """How a seal is drawn, see `studies.Sampling`."""

    length: Length | None = key(
        "of a strip, along x2; of the face unless given", None, start="10 mm"
    )
    breadth: Annotated[Length, Usual(1e-6, 1.0, "m")] | None = key(
        "of a strip, along x1; of the face unless given", None, example="2 mm"
    )
    realisations: Annotated[int, Field(strict=True, ge=2)] | None = key(
        "number of seals; as the band of error needs unless given", None, example=50
    )
    quantiles: tuple[Ratio, Ratio] = key("ends of the band between seals", (0.05, 0.95))

    @model_validator(mode="after")
    def _ordered(self) -> StochasticTable:
        if not self.quantiles[0] < self.quantiles[1]:
            raise refusal("two rising `quantiles`")
        return self


#: Keys of [output] that say which files are written, and change no number.
FILE_KEYS = ("pictures", "report", "fields", "paraview", "fields_limit")
_LEAK_UNITS = f"a unit of leakage: {', '.join(LEAK_UNITS)}"


def _text(expected: str) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "expected": expected})


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
        "of tables, pictures and report; a readable one unless given",
        None,
        example="mL/min",
    )
    throughput_temperature: Temperature | None = key(
        "of gases in Pa·m³/s or mbar·L/s; their own unless given", None
    )
    classes: tuple[Annotated[str, BeforeValidator(_class_name), _text(KNOWN)], ...] = key(
        "classes that are judged at every step", (), example=["L0.01", "TA Luft"]
    )
    nominal_diameter: Annotated[Length, Usual(1e-3, 10.0, "m")] | None = key(
        "of valve, seat or stem, for classes",
        None,
        example="50 mm",
    )
    rated_capacity: VolumeRate | None = key(
        "flow of the open valve, for FCI 70-2 IV",
        None,
    )
    drop_volume: Volume = key(
        'of `"drops/min"`; classes have their own',
        DROP,
        example="0.05 mL",
    )
    bubble_volume: Volume = key(
        'of `"bubbles/min"`; classes have their own',
        BUBBLE,
        example="0.15 mL",
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


#: Units of the parameters of a solid that has a name.
_UNITS = {"young": "Pa", "poisson": "", "yield_stress": "Pa", "hardness": "Pa"}
#: A column of a file of hardness over depth.
_COLUMN = re.compile(r"(depth|hardness)\s*[\[(]\s*(.+?)\s*[\])]$")
_FILE_COLUMNS = (
    "two columns with commas, the first line 'depth [um], hardness [GPa]' or with other units"
)
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
    """A solid, see `solids_and_loads.Solid`, and the law by which it yields."""

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
        "rise of the hardness with the yielded depth",
        None,
        example="2 GPa/um",
        since="0.2",
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
        WithJsonSchema({"anyOf": [{"type": "string", "expected": _FILE_COLUMNS}, _ROWS]}),
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


def with_named_solids(data: dict[str, Any], odd: list[str]) -> dict[str, Any]:
    """The data of a case with the properties of solids that are given by their name, and tables of hardness from files.

    odd : gets sentences on given keys that differ much from what the name stands for.
    """
    folder = Path(data.get("folder", "."))
    places = [place for place in ("material", "counter_material") if place in data]
    return data | {place: _filled(data[place], place, folder, odd) for place in places}


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
    odd += overriding(
        given, known | {"hardness": HARDNESS_FACTOR * solid.yield_stress}, _UNITS, place
    )
    if "hardness" in given or "hardness_table" in given:
        del known["yield_stress"]
    return {name: Amount(value, _UNITS[name]) for name, value in known.items()} | given


def read_hardness_table(path: Path, key: str) -> list[list[str]]:
    """Rows of depth and hardness, as text with units, from a file with a line of heads; `key` names it in faults."""
    name = f"'{shortened(path.name)}'"
    if not isfile(path):
        raise fault(key, name, "a file that exists, or rows such as ['0.1 um', '2 GPa']")
    try:
        heads = {match[1]: match for match in map(_COLUMN.match, columns_of(path)) if match}
        columns = heads["depth"], heads["hardness"]
        numbers = read_columns(path, tuple(column[0] for column in columns))
    except (InputError, KeyError):
        raise fault(key, name, _FILE_COLUMNS) from None
    if len(numbers) < 2:
        given = f"{name} with {counted(len(numbers), 'row')} of numbers"
        raise fault(key, given, f"{_FILE_COLUMNS}, and two rows or more")
    return [
        [f"{value!r} {column[2]}" for value, column in zip(row, columns, strict=True)]
        for row in numbers.tolist()
    ]
