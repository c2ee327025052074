"""The table of a solid in a case file, with a key for each of its parameters or with a name that fills them in."""

from __future__ import annotations

import re
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from ..base.errors import InputError, shortened
from ..contact import ContactLaw, HardnessTable, LinearHardening, NixGao, PerfectlyPlastic
from ..contact.hardness_curves import SMALLEST_DEPTH
from ..materials import HARDNESS_FACTOR, Solid, named_solid
from .faults import fault, faults_of
from .fluid import overriding
from .values import Hardening, Height, Length, Modulus, Place, Poisson, Table, quantity_schema

#: Units of the parameters of a solid that has a name.
_UNITS = {"young": "Pa", "poisson": "", "yield_stress": "Pa", "hardness": "Pa"}
#: A column of a file of hardness over depth.
_COLUMN = re.compile(r"^\s*(depth|hardness)\s*[\[(]\s*(.+?)\s*[\])]\s*$")
_FILE_COLUMNS = "two columns with commas, the first line 'depth [um], hardness [GPa]' or with other units"
_ROW = {"type": "array", "items": quantity_schema("a depth >= 0, then a hardness > 0"), "minItems": 2, "maxItems": 2}


class SolidTable(Table):
    """A solid, see `materials.Solid`, and the law by which it yields."""

    young: Modulus
    poisson: Poisson = 0.3
    yield_stress: Modulus | None = None
    hardness: Modulus | None = None
    hardening: Hardening | None = None
    hardness_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.1
    nix_gao_depth: Height | None = None
    smallest_depth: Length | None = None
    hardness_table: Annotated[
        tuple[tuple[Place, Modulus], ...] | None,
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
    return [[f"{depth!r} {units['depth']}", f"{hardness!r} {units['hardness']}"] for depth, hardness in numbers]
