"""Table of the form of the seat in a case file; forms are not named here, but registered in `topography.seat`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from ..topography.seat import SEATS, Seat
from .faults import faults_of
from .registered_tables import table_of_any
from .values import LengthUnit, Table


class SeatTable(Table):
    """The form of the seat, with a key for each of its parameters."""

    if TYPE_CHECKING:
        kind: str
    tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.0

    def seat(self, folder: Path) -> Seat:
        """The form; paths are relative to a folder."""
        given = {name: getattr(self, name) for name in type(self).model_fields if name not in ("kind", "tolerance")}
        return SEATS[self.kind](**{k: folder / v if isinstance(v, Path) else v for k, v in given.items()})

    @model_validator(mode="after")
    def _possible(self) -> SeatTable:
        with faults_of("seat"):
            self.seat(Path())
        return self


if TYPE_CHECKING:
    AnySeat = SeatTable
else:
    AnySeat = table_of_any(
        SEATS, SeatTable, lambda seat: {"unit": (LengthUnit, ...)} if "unit" in {f.name for f in fields(seat)} else {}
    )
