"""Define the tables [material] and [counter_material] of a case: the solids, and how they yield."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, WithJsonSchema, model_validator

from ..base import InputError
from ..contact import (
    ContactLaw,
    HardnessTable,
    LinearHardening,
    NixGao,
    PerfectlyPlastic,
    law_of_coating,
)
from ..contact.hardness_curves import SMALLEST_DEPTH
from ..materials import HARDNESS_FACTOR, Coated, Solid, named_solid
from .completed_solids import HARDNESS_COLUMNS
from .faults import invalid_value
from .quantity_types import (
    Hardening,
    Height,
    Length,
    Modulus,
    Poisson,
    Position,
    Strength,
    UsualRange,
    quantity_schema,
)
from .table_types import Table, key


def _check_rows(value: Any) -> Any:
    """Check that a hardness table has at least two rows, and return it."""
    if isinstance(value, (list, tuple)) and len(value) < 2:
        raise invalid_value("at least two rows, such as ['0.1 um', '2 GPa']")
    return value


_ROW = {
    "type": "array",
    "items": quantity_schema("a depth >= 0, then a hardness > 0"),
    "minItems": 2,
    "maxItems": 2,
}
_TABLE_SCHEMA = {
    "anyOf": [
        {"type": "string", "expected": HARDNESS_COLUMNS},
        {"type": "array", "items": _ROW},
    ]
}
Depth = Annotated[Position, UsualRange(1e-10, 1e-3, "m")]
HardnessRows = Annotated[
    tuple[tuple[Depth, Strength], ...] | None,
    BeforeValidator(_check_rows),
    WithJsonSchema(_TABLE_SCHEMA),
]


def _ratio_key() -> Any:
    """Declare the key `hardness_over_yield`, which solids and coatings have in common."""
    return key(
        "ratio of hardness to yield stress",
        HARDNESS_FACTOR,
        example=2.3,
        gt=0,
        needed="with a `yield_stress`",
        since="0.2",
    )


def _check_ratio(table: CoatingTable | SolidTable) -> None:
    """Raise an InputError if the table has a ratio of hardness to yield stress, but no yield stress."""
    if "hardness_over_yield" in table.model_fields_set and table.yield_stress is None:
        raise invalid_value("hardness_over_yield with a yield_stress")


class CoatingTable(Table):
    """A coating, see `materials.Coated`: an elastic layer that is bonded to the solid."""

    thickness: Annotated[Length, UsualRange(1e-7, 1e-3, "m")] = key(
        "thickness of the coating", start="20 um", since="0.2"
    )
    name: str | None = key(
        "name of a metal, from which `young`, `poisson` and `hardness` follow",
        None,
        example="silver, annealed",
        since="0.2",
        max_length=60,
    )
    young: Modulus = key("Young's modulus", needed="without a `name`", since="0.2")
    poisson: Poisson = key("Poisson's ratio", 0.3, since="0.2")
    yield_stress: Strength | None = key(
        "yield stress; the hardness is this stress times `hardness_over_yield`",
        None,
        example="54 MPa",
        since="0.2",
        instead="hardness",
    )
    hardness_over_yield: float = _ratio_key()
    hardness: Strength | None = key(
        "hardness: the largest contact pressure of a point", None, example="150 MPa", since="0.2"
    )

    @model_validator(mode="after")
    def _check_strength(self) -> CoatingTable:
        """Raise an InputError if the table has both a yield stress and a hardness."""
        if self.yield_stress is not None and self.hardness is not None:
            raise invalid_value("yield_stress or hardness, not both")
        _check_ratio(self)
        return self

    @property
    def solid(self) -> Solid:
        """The solid of the coating."""
        ratio = self.hardness_over_yield
        return Solid(self.young, self.poisson, self.yield_stress, self.hardness, ratio)


class SolidTable(Table):
    """A solid with its elastic constants, its hardness and its coating, see `materials.Solid`."""

    young: Modulus = key("Young's modulus", start="210 GPa", needed="without a `name`")
    poisson: Poisson = key("Poisson's ratio", 0.3, start=0.3)
    yield_stress: Strength | None = key(
        "yield stress; the hardness is this stress times `hardness_over_yield`; a solid "
        "without yield stress and hardness is elastic",
        None,
        example="1 GPa",
        instead="hardness",
    )
    hardness: Strength | None = key(
        "hardness: the largest contact pressure of a point", None, start="2.8 GPa"
    )
    hardness_over_yield: float = _ratio_key()
    hardening: Hardening | None = key(
        "increase of the hardness with the plastic deformation",
        None,
        example="2 GPa/um",
        since="0.2",
    )
    hardness_tolerance: float = key(
        "relative error of the hardness, for the error budget", 0.1, ge=0, lt=1, since="0.2"
    )
    nix_gao_depth: Annotated[Height, UsualRange(1e-8, 1e-4, "m")] | None = key(
        "depth h* in the law of Nix and Gao, which multiplies the hardness by sqrt(1 + h*/depth)",
        None,
        example="1 um",
        since="0.2",
        instead="hardening",
    )
    smallest_depth: Annotated[Length, UsualRange(1e-9, 1e-5, "m")] | None = key(
        "depth below which the hardness of the law of Nix and Gao is constant",
        None,
        example="0.1 um",
        since="0.2",
        instead="hardening",
    )
    hardness_table: HardnessRows = key(
        "hardness as a function of the plastic deformation, as rows or in a file",
        None,
        example=[["0.1 um", "2.4 GPa"], ["0.5 um", "2.1 GPa"], ["2 um", "2 GPa"]],
        since="0.2",
        instead="hardness",
    )
    name: str | None = key(
        "name of a metal, from which `young`, `poisson` and `hardness` follow",
        None,
        example="copper, soft",
        since="0.2",
        max_length=60,
    )
    coating: CoatingTable | None = key(
        "coating of the solid, with its `thickness`, and either its `name` or `young`, "
        "`poisson` and `hardness`",
        None,
        example={"name": "silver, annealed", "thickness": "20 um"},
        since="0.2",
    )

    @model_validator(mode="after")
    def _check_law(self) -> SolidTable:
        """Raise an InputError if keys about the hardness contradict each other or are incomplete."""
        strengths = self._given("yield_stress", "hardness", "hardness_table")
        curves = self._given("hardening", "nix_gao_depth")
        for keys in (strengths, curves):
            if len(keys) > 1:
                raise invalid_value(f"{' or '.join(keys)}, not both")
        if curves and strengths not in (["yield_stress"], ["hardness"]):
            raise invalid_value(f"{curves[0]} with a yield_stress or a hardness")
        if self.smallest_depth is not None and self.nix_gao_depth is None:
            raise invalid_value("smallest_depth with a nix_gao_depth")
        _check_ratio(self)
        try:
            _ = self.law
        except InputError as error:
            name = "hardness_table" if self.hardness_table is not None else error.what
            raise invalid_value(f"{name}: {error.expected}") from None
        return self

    def _given(self, *keys: str) -> list[str]:
        """Select the keys in `keys` that have a value in the table."""
        return [key for key in keys if getattr(self, key) is not None]

    @property
    def solid(self) -> Solid:
        """The solid. With a hardness table, its hardness is the value in the first row."""
        rows = self.hardness_table
        hardness = rows[0][1] if rows else self.hardness
        ratio = self.hardness_over_yield
        return Solid(self.young, self.poisson, self.yield_stress, hardness, ratio)

    @property
    def body_yield_stress(self) -> float:
        """Yield stress [Pa] of the solid below its surface, inf if it does not yield.

        The yield stress is taken from the case or, if the case has no yield stress, from the named metal. If only the
        hardness of the solid is known, the hardness divided by 2.8 is returned. This is the yield stress of the
        hardened metal, and thus an upper bound of the yield stress below the surface.
        """
        solid = self.solid
        if solid.yield_stress is None and self.name is not None:
            solid = named_solid(self.name)
        if solid.yield_stress is not None:
            return solid.yield_stress
        return _hardness_of(solid) / HARDNESS_FACTOR

    @property
    def body(self) -> Solid | Coated:
        """The solid with its coating, if it has one."""
        if self.coating is None:
            return self.solid
        return Coated(self.solid, self.coating.solid, self.coating.thickness)

    @property
    def law(self) -> ContactLaw:
        """The contact law of the solid with its coating.

        For plastic deformations up to the thickness of the coating, the hardness of the coating applies. For plastic
        deformations beyond the thickness of the coating, the hardness of the solid applies.
        """
        if self.coating is None:
            return self.law_of_solid
        layer = PerfectlyPlastic(_hardness_of(self.coating.solid))
        return law_of_coating(layer, self.law_of_solid, self.coating.thickness)

    @property
    def law_of_solid(self) -> ContactLaw:
        """The contact law of the solid: perfectly plastic, with linear hardening, or with a hardness curve."""
        if self.hardness_table is not None:
            depths, hardnesses = np.array(self.hardness_table, dtype=float).T
            return HardnessTable(depths, hardnesses)
        hardness = _hardness_of(self.solid)
        if self.nix_gao_depth is not None:
            return NixGao(hardness, self.nix_gao_depth, self.smallest_depth or SMALLEST_DEPTH)
        if self.hardening is not None:
            return LinearHardening(hardness, self.hardening)
        return PerfectlyPlastic(hardness)


def _hardness_of(solid: Solid) -> float:
    """Return the hardness of a solid [Pa], inf if it does not yield."""
    assert solid.hardness is not None
    return solid.hardness
