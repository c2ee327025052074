"""Define the table [load] of a case: the loads of the load cycle, and maps of the contact pressure over the seal.

To add a kind of map, write a table and add it to `AnyMapTable` and `_MAPS`.
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

from ..base import InputError
from ..base.quantities import OtherKind
from ..loads import LOAD_UNITS, LoadProgramme, nominal_pressure, relaxed
from ..scene.choices import NOMINALS
from ..seal.pressure_files import read_pressure_field
from ..seal.pressure_map import AngleTable, AnyMap, MapsAtLoads, Profile, Uniform
from .faults import invalid_value
from .quantity_types import (
    Amount,
    Angle,
    Count,
    Position,
    Quantity,
    Relaxation,
    UsualRange,
    in_si,
    quantity_schema,
    unvalidated_value,
)
from .table_types import ParameterTable, Table, key

#: Largest number of load steps.
_MOST_STEPS = 10_000
_EXAMPLE = "300 MPa"
_EXPECTED_LOAD = (
    f"a pressure >= 0, such as '{_EXAMPLE}', or a force on the seal, '10 kN', or on its length, "
    "'200 N/mm'"
)


def _read_load(value: Any) -> Amount:
    """Read a load, which is a pressure, a force or a force per length depending on its unit."""
    if isinstance(value, Amount):
        return value
    unit = _unit_of_load(value)
    if unit is None:
        raise _unusable_load(value)
    quantity = Quantity(unit, lambda load: load >= 0, _EXPECTED_LOAD)
    return Amount(quantity.read(value), unit)


def _unit_of_load(value: Any) -> str | None:
    """Return the SI unit of a load that is given as text, None if the text is not a load."""
    for unit in LOAD_UNITS:
        if unvalidated_value({"load": value}, "load", unit) is not None:
            return unit
    return None


def _unusable_load(value: Any) -> InputError:
    """Return the error for a value that cannot be read as a load.

    Usually, the error lists the possible loads. If the value is a pressure with a recognisable mistake, such as a
    decimal comma, the error names the mistake instead.
    """
    try:
        in_si(value, "Pa", _EXAMPLE)
    except OtherKind:
        pass
    except InputError as error:
        return invalid_value(error.expected)
    return invalid_value(_EXPECTED_LOAD)


def _write_load(load: Amount) -> float | str:
    """Convert a load to plain data: a pressure becomes a number [Pa], and a force becomes text with a unit."""
    return float(load) if load.unit == "Pa" else f"{float(load)!r} {load.unit}"


#: Load on the seal: a nominal pressure, a force, or a force per length.
Load = Annotated[
    float,
    PlainValidator(_read_load),
    PlainSerializer(_write_load),
    WithJsonSchema(quantity_schema(_EXPECTED_LOAD)),
    UsualRange(1e3, 2e10, "Pa"),
    UsualRange(1e-3, 1e8, "N"),
    UsualRange(1.0, 1e8, "N/m"),
]
#: Ratio of a local pressure to the mean pressure.
PressureRatio = Annotated[float, Field(ge=0, allow_inf_nan=False)]

_MAPS: dict[str, Callable[..., Any]] = {
    "uniform": Uniform,
    "profile": Profile,
    "angle": AngleTable,
    "field": read_pressure_field,
}


class MapTable(ParameterTable):
    """A map of the contact pressure over the seal, see `seal.pressure_map`."""

    makers = _MAPS
    kind: str
    at: Load | None = key(
        "load to which this map applies, if there are several maps", None, example="200 MPa"
    )


class UniformMap(MapTable):
    """The nominal pressure everywhere."""

    kind: Literal["uniform"]


_FRACTIONS = "local pressures as fractions of the nominal pressure; they are scaled to a mean of 1"


class ProfileMap(MapTable):
    """Pressure from the inlet to the outlet, see `seal.pressure_map.Profile`."""

    kind: Literal["profile"]
    fractions: tuple[PressureRatio, ...] = key(_FRACTIONS, example=[1, 3], since="0.2")
    positions: tuple[Position, ...] = key(
        "positions across the seal (on a ring: radii) at which the fractions are given",
        (),
        example=["10 mm", "12 mm"],
    )


class AngleMap(MapTable):
    """Pressure around the seal, see `seal.pressure_map.AngleTable`."""

    kind: Literal["angle"]
    fractions: tuple[PressureRatio, ...] = key(_FRACTIONS, example=[1.3, 0.8], since="0.2")
    angles: tuple[Angle, ...] = key(
        "angles around the seal at which the fractions are given", (), example=["0 deg", "30 deg"]
    )
    repeat: Count = key(
        "number of times that the fractions are repeated around the seal", 1, instead="angles"
    )


class FieldMap(MapTable):
    """Pressure from a file, see `seal.read_pressure_field`."""

    kind: Literal["field"]
    path: Path = key(
        "mesh file with the pressure at its points or in its cells, or a `.csv` file",
        example="flange.vtu",
    )
    name: str = key("name of the array or the column", "pressure")
    length_unit: str = key("unit of the coordinates", example="mm")
    pressure_unit: str = key("unit of the pressures", example="MPa")
    is_checked = False  # the file is read when the case is prepared


AnyMapTable = Annotated[UniformMap | ProfileMap | AngleMap | FieldMap, Field(discriminator="kind")]


def _as_list(value: Any) -> Any:
    """Convert a single table to a list with one table."""
    return [value] if isinstance(value, dict) else value


class LoadTable(Table):
    """Loads of the load cycle, see `loads.LoadProgramme`: nominal pressures, or forces on the seal."""

    loading: tuple[Load, ...] = key(
        "increasing loads during assembly",
        min_length=1,
        start=[f"{p} MPa" for p in (25, 50, 100, 150, 250, 400, 500)],
    )
    unload_from: tuple[Load, ...] = key(
        "peak loads from which the seal is unloaded", (), start=["250 MPa", "500 MPa"]
    )
    unloading: tuple[Load, ...] = key(
        "decreasing loads on unloading from each peak",
        (),
        start=[f"{p} MPa" for p in (400, 250, 150, 100, 50, 25)],
        needed="with `unload_from`",
    )
    nominal: Literal[NOMINALS] = key(  # type: ignore[valid-type]
        "what carries the loads: contact and fluid together, or the contact alone",
        "total",
        since="0.2",
    )
    relaxation: Relaxation = key(
        "fraction of each peak load (or of each load, if there are no peaks) that is lost "
        "before service",
        0.0,
        example=0.1,
        since="0.2",
    )
    map: Annotated[tuple[AnyMapTable, ...] | None, BeforeValidator(_as_list)] = key(
        "distribution of the contact pressure over the seal, or several distributions, each "
        "for one load",
        None,
    )

    @model_validator(mode="after")
    def _check_units(self) -> LoadTable:
        """Raise an InputError unless all loads have the same unit."""
        loads = [*self.loading, *self.unload_from, *self.unloading, *self._map_loads]
        units = dict.fromkeys(_unit_in(load) for load in loads)
        if len(units) > 1:
            raise invalid_value(f"loads of one kind, not {' and '.join(units)}")
        return self

    @model_validator(mode="after")
    def _check_maps(self) -> LoadTable:
        """Raise an InputError unless there is a single map, or several maps at increasing loads."""
        if self.map is None or len(self.map) == 1:
            return self
        loads = self._map_loads
        is_rising = loads == sorted(set(loads))
        if not self.map or len(loads) < len(self.map) or not is_rising:
            raise invalid_value("one table `map`, or several tables in order of increasing `at`")
        return self

    @model_validator(mode="after")
    def _check_programme(self) -> LoadTable:
        """Raise an InputError if the load cycle has too many steps, or if its loads are in an impossible order."""
        if self.steps > _MOST_STEPS:
            raise InputError("", f"{self.steps} steps", f"at most {_MOST_STEPS} steps")
        LoadProgramme.of(**self.pressures(1.0, 1.0), unit=self.unit)
        return self

    @property
    def unit(self) -> str:
        """Unit of all loads: "Pa", "N" or "N/m"."""
        return _unit_in(self.loading[0])

    @property
    def highest(self) -> float:
        """Highest load, in `unit`."""
        return max((*self.loading, *self.unload_from))

    @property
    def peaks(self) -> tuple[float, ...]:
        """Loads from which the seal is unloaded.

        With a relaxation but no `unload_from`, the seal is unloaded from every load.
        """
        if self.unload_from or not self.relaxation:
            return self.unload_from
        return tuple(load for load in self.loading if load > 0)

    @property
    def steps(self) -> int:
        """Upper bound of the number of load steps."""
        steps_per_peak = 1 + len(self.unloading)  # the peak itself, and the loads on the way down
        if self.relaxation:
            steps_per_peak += len(self.peaks)
        return len(self.loading) + len(self.peaks) * steps_per_peak

    @property
    def _map_loads(self) -> list[float]:
        """Loads to which the pressure maps belong. A map without a load is skipped."""
        return [table.at for table in self.map or () if table.at is not None]

    def pressures(self, area: float, length: float) -> dict[str, tuple[float, ...]]:
        """Return the nominal pressures of the load cycle [Pa], as keyword arguments for `LoadProgramme.of`.

        Parameters
        ----------
        area : nominal contact area of the seal [m²].
        length : length of the seal [m].
        """

        def pressures_of(loads: tuple[float, ...]) -> tuple[float, ...]:
            return tuple(self._pressure(load, area, length) for load in loads)

        loading = pressures_of(self.loading)
        peaks = pressures_of(self.peaks)
        unloading = pressures_of(self.unloading)
        if self.relaxation:
            # the seal is also unloaded to the load that remains of each peak after relaxation
            after_relaxation = {relaxed(peak, self.relaxation) for peak in peaks}
            unloading = tuple(sorted(after_relaxation | set(unloading), reverse=True))
        return {"loading": loading, "unload_from": peaks, "unloading": unloading}

    def pressure_map(self, folder: Path, area: float, length: float) -> AnyMap:
        """Return the map of the contact pressure over the seal.

        Parameters
        ----------
        folder : folder to which paths are relative.
        area : nominal contact area of the seal [m²].
        length : length of the seal [m].
        """
        if not self.map:
            return Uniform()
        maps = tuple(table.make(folder) for table in self.map)
        if not self._map_loads:
            return maps[0]
        pressures = tuple(self._pressure(load, area, length) for load in self._map_loads)
        return MapsAtLoads(pressures, maps)

    def _pressure(self, load: float, area: float, length: float) -> float:
        """Convert a load of the table, in the unit `self.unit`, to a nominal pressure [Pa]."""
        return nominal_pressure(float(load), self.unit, area=area, length=length)


def _unit_in(load: float) -> str:
    """Return the unit of a load; a plain number is a pressure."""
    return str(getattr(load, "unit", "Pa"))
