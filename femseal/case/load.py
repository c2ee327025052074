"""The table [load] of a case: pressures or forces of the cycle, and maps of the pressure over the seal.

To add a kind of map, write a table with `make` and put it into `AnyMapTable`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from ..loads import LOAD_UNITS, LoadProgramme, nominal_pressure, relaxed
from ..seal.pressure_map import AngleTable, AnyMap, MapsAtLoads, Profile, Uniform
from ..seal.seal_files import read_pressure_field
from ..studies.choices import NOMINALS
from .faults import fault, faults_of, refusal
from .values import (
    Amount,
    Angle,
    Count,
    MadeTable,
    Place,
    Quantity,
    Relaxation,
    Table,
    Usual,
    key,
    quantity_schema,
    value_of,
)

#: No cycle is longer [load steps].
_MOST_STEPS = 10_000
_ALLOWED = "a pressure >= 0, such as '300 MPa', or a force on the seal, '10 kN', or on its length, '200 N/mm'"


def _load(value: Any) -> Amount:
    """A pressure, a force or a force per length, whichever the unit says."""
    if isinstance(value, Amount):
        return value
    unit = next(
        (unit for unit in LOAD_UNITS if value_of({"load": value}, "load", unit) is not None), "Pa"
    )
    try:
        return Amount(Quantity(unit, lambda x: x >= 0, _ALLOWED).read(value), unit)
    except PydanticCustomError as error:
        # as of a pressure, such as with a decimal comma, but where the unit is unknown
        known = not str(error).startswith("text with a number and a unit of the kind")
        raise error if known else refusal(_ALLOWED) from None


#: A pressure or force; in the echo of a case a number of pressure or a text of force.
Load = Annotated[
    float,
    PlainValidator(_load),
    PlainSerializer(
        lambda load: float(load) if load.unit == "Pa" else f"{float(load)!r} {load.unit}"
    ),
    WithJsonSchema(quantity_schema(_ALLOWED)),
    Usual(1e3, 2e10, "Pa"),
    Usual(1e-3, 1e8, "N"),
    Usual(1.0, 1e8, "N/m"),
]
Fraction = Annotated[float, Field(ge=0, allow_inf_nan=False)]


_MAPS: dict[str, Callable[..., Any]] = {
    "uniform": Uniform,
    "profile": Profile,
    "angle": AngleTable,
    "field": read_pressure_field,
}


class MapTable(MadeTable):
    """A map of the contact pressure over the seal, see `seal.pressure_map`."""

    makers = _MAPS
    place = "load.map"
    kind: str
    at: Load | None = key("load at which one of several maps holds", None, example="200 MPa")


class UniformMap(MapTable):
    """The nominal pressure everywhere."""

    kind: Literal["uniform"]


#: In equal strips or at given places.
_FRACTIONS = "pressures over their mean"


class ProfileMap(MapTable):
    """Pressure from the inlet to the outlet, see `seal.pressure_map.Profile`."""

    kind: Literal["profile"]
    fractions: tuple[Fraction, ...] = key(_FRACTIONS, example=[1, 3], since="0.2")
    positions: tuple[Place, ...] = key(
        "of the fractions across the seal, on a ring radii", (), example=["10 mm", "12 mm"]
    )


class AngleMap(MapTable):
    """Pressure around the seal, see `seal.pressure_map.AngleTable`."""

    kind: Literal["angle"]
    fractions: tuple[Fraction, ...] = key(_FRACTIONS, example=[1.3, 0.8], since="0.2")
    angles: tuple[Angle, ...] = key(
        "of the fractions around the seal", (), example=["0 deg", "30 deg"]
    )
    repeat: Count = key("times that the fractions repeat", 1, instead="angles")


class FieldMap(MapTable):
    """Pressure from a file, see `seal.seal_files.read_pressure_field`."""

    kind: Literal["field"]
    path: Path = key("mesh with the pressure at points or cells, or `.csv`", example="flange.vtu")
    name: str = key("of the array, or of the column", "pressure")
    length_unit: str = key("of the coordinates", example="mm")
    pressure_unit: str = key("of the pressures", example="MPa")
    place = ""  # the file is read once the case is prepared


AnyMapTable = Annotated[UniformMap | ProfileMap | AngleMap | FieldMap, Field(discriminator="kind")]


class LoadTable(Table):
    """Loads of the cycle, see `loads.LoadProgramme`: nominal pressures, or forces on the seal."""

    loading: tuple[Load, ...] = key(
        "loads in assembly, rising",
        min_length=1,
        start=[f"{p} MPa" for p in (25, 50, 100, 150, 250, 400, 500)],
    )
    unload_from: tuple[Load, ...] = key(
        "peaks from which the seal is unloaded", (), start=["250 MPa", "500 MPa"]
    )
    unloading: tuple[Load, ...] = key(
        "loads on the way down from each peak",
        (),
        start=[f"{p} MPa" for p in (400, 250, 150, 100, 50, 25)],
        needed="with `unload_from`",
    )
    nominal: Literal[NOMINALS] = key(  # type: ignore[valid-type]
        "what carries the loads: contact and fluid, or contact alone", "total", since="0.2"
    )
    relaxation: Relaxation = key(
        "fraction of each peak, or without peaks of each load, that is lost before service",
        0.0,
        example=0.1,
        since="0.2",
    )
    map: Annotated[
        tuple[AnyMapTable, ...] | None,
        BeforeValidator(lambda given: [given] if isinstance(given, dict) else given),
    ] = key("shape of the contact pressure over a drawn seal; several hold at their loads", None)

    @model_validator(mode="after")
    def _one_kind(self) -> LoadTable:
        """Raise a fault if loads are of several kinds, or several maps have no rising loads."""
        loads = [*self.loading, *self.unload_from, *self.unloading]
        at = [one.at for one in self.map or () if one.at is not None]
        units = dict.fromkeys(getattr(load, "unit", "Pa") for load in [*loads, *at])
        if len(units) > 1:
            raise refusal(f"loads of one kind, not {' and '.join(units)}")
        several = self.map is not None and len(self.map) != 1
        if several and (not at or len(at) < len(self.map or ()) or at != sorted({*at})):
            expected = "one table `map`, or several that all have `at`, and whose `at` rise"
            raise refusal(expected)
        return self

    @model_validator(mode="after")
    def _programme(self) -> LoadTable:
        """Raise a fault if the loads are no programme: they rise, and are unloaded from peaks that they reach."""
        if self.steps > _MOST_STEPS:
            raise fault("load", f"{self.steps} steps", f"at most {_MOST_STEPS} steps")
        with faults_of("load"):
            LoadProgramme.of(**self.pressures(1.0, 1.0))
        return self

    @property
    def unit(self) -> str:
        """ "Pa", "N" or "N/m", of all loads."""
        return str(getattr(self.loading[0], "unit", "Pa"))

    @property
    def highest(self) -> float:
        """The highest load, in its unit."""
        return max((*self.loading, *self.unload_from))

    @property
    def peaks(self) -> tuple[float, ...]:
        """Loads from which the seal is unloaded; with relaxation and without `unload_from` all."""
        return self.unload_from or (
            tuple(p for p in self.loading if p > 0) if self.relaxation else ()
        )

    @property
    def steps(self) -> int:
        """Number of load steps, at most."""
        stops = len(self.unloading) + (len(self.peaks) if self.relaxation else 0)
        return len(self.loading) + len(self.peaks) * (1 + stops)

    def pressures(self, area: float, length: float) -> dict[str, tuple[float, ...]]:
        """Nominal pressures [Pa] of a seal of an area [m²] and a length [m]: `loading`, `unload_from`, `unloading`."""
        pressure = self._pressure(area, length)
        loading, peaks, stops = (
            tuple(map(pressure, loads)) for loads in (self.loading, self.peaks, self.unloading)
        )
        if self.relaxation:
            stops = tuple(
                sorted({*stops, *(relaxed(p, self.relaxation) for p in peaks)}, reverse=True)
            )
        return {"loading": loading, "unload_from": peaks, "unloading": stops}

    def pressure_map(self, folder: Path, area: float, length: float) -> AnyMap:
        """The map of the pressure over such a seal; files are relative to the folder."""
        if not self.map:
            return Uniform()
        maps = tuple(one.make(folder) for one in self.map)
        if len(maps) == 1 and self.map[0].at is None:
            return maps[0]
        pressure = self._pressure(area, length)
        return MapsAtLoads(tuple(pressure(one.at) for one in self.map if one.at is not None), maps)

    def _pressure(self, area: float, length: float) -> Callable[[float], float]:
        return lambda load: nominal_pressure(float(load), self.unit, area=area, length=length)
