"""A case: everything a run needs, as a TOML file whose quantities carry their units.

The file is checked as a whole before anything is computed; every fault is reported at once, with its key, what was
given and what is allowed. `Case.prepare` turns it into the objects the studies take.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import ceil, inf
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from ..base.errors import InputError
from ..base.quantities import to_si, to_text
from ..fluids import Fluid, IdealGas, Liquid
from ..materials import Solid, contact_modulus, softer_hardness
from ..results.fields import LIMIT
from ..results.vtk import FORMATS
from ..scales import SAMPLERS, Partition
from ..studies import FLOWS, PRESSURES, Sampling, Scene, check_sampling
from ..studies.costs import choose_method
from ..topography import (
    SPIKES,
    Conditioning,
    Overlap,
    Topography,
    combine,
    condition,
    read_topography,
    repair,
    self_affine,
    turned,
)

Method = Literal["auto", "deterministic", "two-scale", "stochastic"]
Boundary = Literal["periodic", "mirror", "free"]


@dataclass(frozen=True)
class _Quantity:
    """Text with a unit, or a plain number where `unit` is "", as a float in SI."""

    unit: str
    test: Callable[[float], bool]
    allowed: str

    def _read(self, value: Any) -> float:
        try:
            number = to_si(value, self.unit)
        except InputError as error:
            context = {"allowed": str(error).split("allowed is ")[-1]}
            raise PydanticCustomError("quantity", "{allowed}", context) from None
        if not self.test(number):
            raise PydanticCustomError("quantity", "{allowed}", {"allowed": self.allowed})
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return core_schema.no_info_before_validator_function(self._read, handler(source))

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        described = {"description": self.allowed}
        if self.unit:
            return {"type": "string", "pattern": r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?[^,]*[^\s\d.,]"} | described
        return {"type": ["number", "string"]} | described


def _of(unit: str, test: Callable[[float], bool], allowed: str) -> _Quantity:
    return _Quantity(unit, test, allowed)


def _one_of(value: Any, names: tuple[str, ...]) -> str:
    if value not in names:
        raise PydanticCustomError("name", "{allowed}", {"allowed": f"one of {', '.join(names)}"})
    return str(value)


def _names(names: Iterable[str]) -> tuple[BeforeValidator, WithJsonSchema]:
    known = tuple(names)
    return BeforeValidator(partial(_one_of, names=known)), WithJsonSchema({"type": "string", "enum": list(known)})


def _threshold(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
        raise PydanticCustomError("threshold", "{allowed}", {"allowed": "a number > 0; inf leaves all points"})
    return float(value)


def _positive(x: float) -> bool:
    return x > 0


def _not_negative(x: float) -> bool:
    return x >= 0


Length = Annotated[float, _of("m", _positive, "a length > 0, such as '1.5 mm'")]
Height = Annotated[float, _of("m", _not_negative, "a height >= 0, such as '0.2 um'")]
Pressure = Annotated[float, _of("Pa", _not_negative, "a pressure >= 0, such as '300 MPa'")]
Modulus = Annotated[float, _of("Pa", _positive, "a stress > 0, such as '210 GPa'")]
Viscosity = Annotated[float, _of("Pa*s", _positive, "a viscosity > 0, such as '1 mPa*s'")]
Density = Annotated[float, _of("kg/m^3", _positive, "a density > 0, such as '870 kg/m^3'")]
MolarMass = Annotated[float, _of("kg/mol", _positive, "a molar mass > 0, such as '29 g/mol'")]
Temperature = Annotated[float, _of("K", _positive, "a temperature above absolute zero, such as '20 °C'")]
PressureViscosity = Annotated[float, _of("1/Pa", _not_negative, "a coefficient >= 0, such as '20 1/GPa'")]
FileSize = Annotated[float, _of("byte", _not_negative, "a size >= 0, such as '500 MB'")]
Ratio = Annotated[float, _of("", lambda x: 0 <= x <= 1, "a number from 0 to 1")]
Hurst = Annotated[float, _of("", lambda x: 0 < x <= 1, "a Hurst exponent above 0, at most 1")]
Slope = Annotated[float, _of("", _positive, "a slope > 0")]
Poisson = Annotated[float, _of("", lambda x: -1 < x <= 0.5, "a Poisson's ratio above -1, at most 0.5")]
Angle = Annotated[float, _of("rad", lambda x: True, "an angle, such as '90 deg'")]
Shift = Annotated[float, _of("m", lambda x: True, "a length, such as '-20 um'")]
Threshold = Annotated[float, BeforeValidator(_threshold), WithJsonSchema({"type": "number", "exclusiveMinimum": 0})]
Count = Annotated[int, Field(strict=True, ge=1)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SelfAffineFace(_Table):
    """A self-affine face, see `topography.self_affine`."""

    kind: Literal["self-affine"]
    points: tuple[Count, Count]
    size: tuple[Length, Length]
    hurst: Hurst = 0.8
    rms_slope: Slope | None = None
    rms_height: Length | None = None
    roll_off: Length | None = None
    cut_off: Length | None = None

    def make(self, folder: Path, rng: np.random.Generator) -> Topography:
        """The face."""
        given = self.model_dump(exclude={"kind", "points", "size"})
        return self_affine(self.points, self.size, rng=rng, **given)


class TurnedFace(_Table):
    """A turned face, see `topography.turned`."""

    kind: Literal["turned"]
    points: tuple[Count, Count]
    size: tuple[Length, Length]
    pitch: Length
    depth: Length
    nose_radius: Length | None = None
    feed_error: Ratio = 0.0
    depth_error: Ratio = 0.0
    waviness: Height = 0.0
    waviness_length: Length | None = None
    roughness: Height = 0.0
    hurst: Hurst = 0.8
    roughness_roll_off: Length | None = None
    cut_off: Length | None = None

    def make(self, folder: Path, rng: np.random.Generator) -> Topography:
        """The face."""
        given = self.model_dump(exclude={"kind", "points", "size"})
        return turned(self.points, self.size, rng=rng, **given)


class FileFace(_Table):
    """A measured face, see `topography.read_topography`; the path is relative to the case file.

    `mirror`, `rotate` and `shift` lay the second of two faces on the first, see `topography.combine`.
    """

    kind: Literal["file"]
    path: Path
    size: tuple[Length, Length] | None = None
    spacing: tuple[Length, Length] | None = None
    height_unit: str | None = None
    delimiter: str | None = None
    array: str | None = None
    channel: Annotated[int, Field(strict=True, ge=0)] = 0
    transpose: bool = False
    periodic: tuple[bool, bool] = (False, False)
    mirror: Literal["x1", "x2"] | None = None
    rotate: Angle | None = None
    shift: tuple[Shift, Shift] | None = None

    @property
    def placement(self) -> dict[str, Any]:
        """How the face lies on the first one, as `topography.combine` takes it."""
        return self.model_dump(include=_PLACEMENT, exclude_none=True)

    def make(self, folder: Path, rng: np.random.Generator) -> Topography:
        """The face."""
        given = self.model_dump(exclude={"kind", "path", *_PLACEMENT})
        return read_topography(folder / self.path, **given)


_PLACEMENT = {"mirror", "rotate", "shift"}
Face = Annotated[SelfAffineFace | TurnedFace | FileFace, Field(discriminator="kind")]


class SurfaceTable(_Table):
    """What is done to measured faces (spikes, see `topography.repair`) and to their sum (`topography.condition`)."""

    spikes: Threshold = SPIKES
    detrend: Literal[0, 1, 2] = 1
    shortest_wave: Length | None = None
    max_undefined: Ratio = 0.05
    points: tuple[Count, Count] | None = None


class SolidTable(_Table):
    """A solid, see `materials.Solid`."""

    young: Modulus
    poisson: Poisson = 0.3
    yield_stress: Modulus | None = None
    hardness: Modulus | None = None

    @model_validator(mode="after")
    def _one_strength(self) -> SolidTable:
        if self.yield_stress is not None and self.hardness is not None:
            raise PydanticCustomError("strength", "yield_stress or hardness, not both")
        return self

    @property
    def solid(self) -> Solid:
        """The solid."""
        return Solid(**self.model_dump())


class LoadTable(_Table):
    """Nominal pressures of the cycle, see `loads.LoadProgramme`."""

    loading: Annotated[tuple[Pressure, ...], Field(min_length=1)]
    unload_from: tuple[Pressure, ...] = ()
    unloading: tuple[Pressure, ...] = ()

    @model_validator(mode="after")
    def _programme(self) -> LoadTable:
        if any(b <= a for a, b in zip(self.loading[:-1], self.loading[1:], strict=True)):
            raise PydanticCustomError("load", "rising pressures in `loading`")
        if bool(self.unload_from) != bool(self.unloading):
            raise PydanticCustomError("load", "`unload_from` and `unloading` both, or neither")
        for peak in self.unload_from:
            if not any(p < peak for p in self.unloading):
                low = to_text(peak, "Pa")
                raise PydanticCustomError("load", "a pressure in `unloading` below the peak {low}", {"low": low})
        return self


class ContactTable(_Table):
    """How contact is solved."""

    boundary: tuple[Boundary, Boundary] = ("free", "periodic")
    rtol: Annotated[float, Field(gt=0, lt=0.1)] = 1e-5


class LiquidTable(_Table):
    """A liquid, see `fluids.Liquid`."""

    kind: Literal["liquid"]
    viscosity: Viscosity
    density: Density = 1000.0
    pressure_viscosity: PressureViscosity = 0.0
    inlet_pressure: Pressure
    outlet_pressure: Pressure = 0.0

    @property
    def fluid(self) -> Fluid:
        """The fluid."""
        return Liquid(self.viscosity, self.density, self.pressure_viscosity)


class GasTable(_Table):
    """An ideal gas, see `fluids.IdealGas`; pressures are absolute."""

    kind: Literal["ideal-gas"]
    viscosity: Viscosity
    molar_mass: MolarMass
    temperature: Temperature
    inlet_pressure: Pressure
    outlet_pressure: Pressure = 101_325.0

    @property
    def fluid(self) -> Fluid:
        """The fluid."""
        return IdealGas(self.viscosity, self.molar_mass, self.temperature)


class CellsTable(_Table):
    """Windows of the two-scale and stochastic methods: their number, or about their size; and the two-scale flow.

    flow : see `studies.two_scale`.
    """

    count: tuple[Count, Count] | None = None
    size: Length | None = None
    flow: Annotated[str, *_names(FLOWS)] = "links"

    @model_validator(mode="after")
    def _one_of(self) -> CellsTable:
        if (self.count is None) == (self.size is None):
            raise PydanticCustomError("cells", "one of `count` and `size`")
        return self


class StochasticTable(_Table):
    """How a seal is drawn, see `studies.Sampling`."""

    length: Length
    breadth: Length | None = None
    realisations: Annotated[int, Field(strict=True, ge=2)] = 50
    library_cells: Count = 128
    sampler: Annotated[str, *_names(SAMPLERS)] | None = None
    pressure: Annotated[str, *_names(PRESSURES)] = "place"
    profile: tuple[Annotated[float, Field(ge=0)], ...] = ()
    library: Path | None = None
    width: Annotated[float, Field(gt=0)] | None = None
    bounds: bool = False
    quantiles: tuple[Ratio, Ratio] = (0.05, 0.95)

    @model_validator(mode="after")
    def _ordered(self) -> StochasticTable:
        if not self.quantiles[0] < self.quantiles[1]:
            raise PydanticCustomError("quantiles", "two rising `quantiles`")
        return self


class OutputTable(_Table):
    """What the results folder holds besides, see `output.write_folder`."""

    paraview: Annotated[str, *_names(FORMATS)] = "vtu"
    fields_limit: FileSize = LIMIT


class Case(_Table):
    """A validated case, all values in SI."""

    title: str = ""
    method: Method = "stochastic"
    compare: tuple[Literal["deterministic", "two-scale", "stochastic"], ...] = ()
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    face: tuple[Face, ...] = Field(min_length=1, max_length=2)
    surface: SurfaceTable = SurfaceTable()
    material: SolidTable
    counter_material: SolidTable | None = None
    load: LoadTable
    contact: ContactTable = ContactTable()
    fluid: Annotated[LiquidTable | GasTable, Field(discriminator="kind")]
    cells: CellsTable | None = None
    stochastic: StochasticTable | None = None
    output: OutputTable = OutputTable()
    folder: Path = Field(default=Path(), exclude=True)

    @model_validator(mode="before")
    @classmethod
    def _one_face(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("face"), dict):
            return {**data, "face": [data["face"]]}
        return data

    @model_validator(mode="after")
    def _complete(self) -> Case:
        if self.cells is None and not self.methods <= {"deterministic", "auto"}:
            raise PydanticCustomError("cells", "a table `cells` with the method {m}", {"m": self.method})
        if self.stochastic is None and "stochastic" in self.methods:
            raise PydanticCustomError("stochastic", "a table `stochastic` with the method stochastic")
        highest = max((*self.load.loading, *self.load.unload_from))
        if highest >= self.hardness:
            given = {"p": to_text(highest, "Pa"), "h": to_text(self.hardness, "Pa")}
            raise PydanticCustomError("load", "load: given {p}, allowed are pressures below the hardness, {h}", given)
        for face in self.face:
            if isinstance(face, FileFace) and not (self.folder / face.path).is_file():
                path = {"path": str(face.path)}
                raise PydanticCustomError("file", "face.path: given '{path}', allowed is a file that exists", path)
        if isinstance(first := self.face[0], FileFace) and first.placement:
            keys = {"keys": ", ".join(sorted(first.placement))}
            raise PydanticCustomError("placement", "face.0: given {keys}, allowed is that in the second face", keys)
        return self

    @property
    def methods(self) -> set[str]:
        """The method and those to compare it with, as given."""
        return {self.method, *self.compare}

    @property
    def two_scale_flow(self) -> str:
        """Flow of the two-scale method."""
        return "links" if self.cells is None else self.cells.flow

    @property
    def solids(self) -> tuple[Solid, Solid | None]:
        """The two bodies; None is rigid."""
        counter = self.counter_material
        return self.material.solid, None if counter is None else counter.solid

    @property
    def hardness(self) -> float:
        """Hardness of the softer solid [Pa]; inf where none is given."""
        return softer_hardness(*self.solids)

    @property
    def modulus(self) -> float:
        """Contact modulus [Pa]."""
        return contact_modulus(*self.solids)

    def echo(self) -> dict[str, Any]:
        """The case in SI, as plain data."""
        return self.model_dump(mode="json", exclude_none=True)

    def prepare(self) -> Prepared:
        """Make or read the faces, condition their sum, divide it into cells.

        Raises
        ------
        InputError : a face that cannot be read or used, or cells that do not suit it.
        """
        surface, repaired, overlap = self._combined_faces()
        cells = self._cell_count(surface)
        shape = self.surface.points or surface.shape
        if cells is not None:
            shape = (_multiple(shape[0], cells[0]), _multiple(shape[1], cells[1]))
        surface, report = condition(
            surface,
            spikes=inf,
            detrend=self.surface.detrend,
            shortest_wavelength=self.surface.shortest_wave,
            max_undefined=self.surface.max_undefined,
            shape=shape,
        )
        sampling = None
        if cells is not None:
            window = Partition(surface.shape, surface.spacing, cells).window_size
            if min(window) < 2 * report.shortest_wavelength * (1 - 1e-9):
                sizes = " × ".join(to_text(w, "m", 3) for w in window)
                least = to_text(2 * report.shortest_wavelength, "m", 3)
                raise InputError.of("cells", f"windows of {sizes}", f"windows of at least two shortest waves, {least}")
            if self.stochastic is not None and "stochastic" in self.methods:
                table = self.stochastic
                if table.length < window[1] * (1 - 1e-9):
                    cell, given = to_text(window[1], "m", 3), to_text(table.length, "m", 3)
                    raise InputError.of("stochastic.length", given, f"at least one cell, {cell}")
                sampling = Sampling(
                    length=table.length,
                    breadth=table.breadth,
                    realisations=table.realisations,
                    library_cells=table.library_cells,
                    seed=self.seed,
                    sampler=table.sampler,
                    pressure=table.pressure,
                    profile=table.profile,
                    library=None if table.library is None else self.folder / table.library,
                    width=table.width,
                    bounds=table.bounds,
                )
                check_sampling(sampling, cells)
        scene = Scene(
            surface=surface,
            modulus=self.modulus,
            hardness=self.hardness,
            fluid=self.fluid.fluid,
            inlet_pressure=self.fluid.inlet_pressure,
            outlet_pressure=self.fluid.outlet_pressure,
            loading=self.load.loading,
            unload_from=self.load.unload_from,
            unloading=self.load.unloading,
            boundary=self.contact.boundary,
            rtol=self.contact.rtol,
        )
        method: str = self.method
        choice = ""
        if method == "auto":
            assert cells is not None
            method, choice = choose_method(len(scene.steps), surface.shape, cells)
        methods = frozenset({method, *self.compare})
        return Prepared(scene, cells, sampling, replace(report, **repaired), overlap, method, methods, choice)

    def _combined_faces(self) -> tuple[Topography, dict[str, Any], Overlap | None]:
        """Sum of the faces without spikes and undefined points, what was repaired in them, and where they overlap."""
        # a stream of its own for every face, whatever the method draws later
        seeds = np.random.SeedSequence(self.seed).spawn(len(self.face))
        faces, undefined, spikes = [], 0.0, 0
        for table, seed in zip(self.face, seeds, strict=True):
            measured = table.make(self.folder, np.random.default_rng(seed))
            threshold = self.surface.spikes if isinstance(table, FileFace) else inf
            face, repaired = repair(measured, spikes=threshold, max_undefined=self.surface.max_undefined)
            faces.append(face)
            undefined, spikes = undefined + repaired.undefined_share / len(self.face), spikes + repaired.spikes
        found = {"undefined_share": undefined, "spikes": spikes}
        if len(faces) == 1:
            return faces[0], found, None
        second = self.face[1]
        surface, overlap = combine(*faces, **(second.placement if isinstance(second, FileFace) else {}))
        return surface, found, overlap

    def _cell_count(self, surface: Topography) -> tuple[int, int] | None:
        if self.methods == {"deterministic"} or (self.cells is None and self.method != "auto"):
            return None
        if self.cells is not None and self.cells.count is not None:
            return self.cells.count
        # eight shortest waves: shorter windows cut more paths off than two scales save
        waves = self.surface.shortest_wave or 8 * max(surface.spacing)
        size = 8 * waves if self.cells is None or self.cells.size is None else self.cells.size
        m1, m2 = (max(1, round(length / size)) for length in surface.size)
        return m1, m2


def _multiple(n: int, of: int) -> int:
    return ceil(n / of) * of


@dataclass(frozen=True)
class Prepared:
    """What the studies take: the scene, its division, how to draw seals; and how the surface came about.

    method, methods : what is to be solved, "auto" decided; choice : why, if it was.
    """

    scene: Scene
    cells: tuple[int, int] | None
    sampling: Sampling | None
    conditioning: Conditioning
    overlap: Overlap | None
    method: str
    methods: frozenset[str]
    choice: str

    @property
    def surface_report(self) -> dict[str, Any]:
        """What was done to the surface, as plain data."""
        return asdict(self.conditioning) | ({} if self.overlap is None else {"overlap": asdict(self.overlap)})


def load_case(path: str | PathLike[str]) -> Case:
    """Read and validate a case file.

    Parameters
    ----------
    path : a TOML file; paths in it are relative to its folder.

    Raises
    ------
    InputError : the file is missing or is not TOML, or any of its values cannot be used; one line for each fault.
    """
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError.of("case", f"'{path}'", f"a file that can be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise InputError.of("case", f"'{path}', which is not text", "a TOML file in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError.of("case", f"'{path}', which is not TOML ({error})", "a TOML file") from None
    return parse_case(data, path.parent)


def parse_case(data: dict[str, Any], folder: Path = Path()) -> Case:
    """Validate a case given as a dictionary; paths in it are relative to `folder`.

    Raises
    ------
    InputError : one line for each fault.
    """
    if "folder" in data:
        raise InputError.of("folder", "a value", "no such key")
    try:
        return Case.model_validate({**data, "folder": folder})
    except ValidationError as error:
        # a list is also too short where its items have faults of their own
        faults = [dict(e) for e in error.errors() if e["type"] != "too_short" or not e["input"]]
        lines = [_fault(e) for e in faults]
        if isinstance(data.get("face"), dict):  # one table, which has no number in the file
            lines = [line.replace("face.0", "face", 1) if line.startswith("face.0") else line for line in lines]
        raise InputError("\n".join(dict.fromkeys(lines))) from None


def _fault(error: dict[str, Any]) -> str:
    """One line for a fault found by pydantic: key, what was given, what is allowed."""
    kinds = {"self-affine", "turned", "file", "liquid", "ideal-gas"}
    place = [str(part) for part in error["loc"] if part not in kinds]
    key = ".".join(place) or "case"
    kind, given = error["type"], error["input"]
    if kind == "extra_forbidden":
        keys = _known_keys(error["loc"])
        return f"{key}: unknown key, allowed are {', '.join(keys)}"
    if kind == "missing":
        return f"{key}: missing"
    if kind == "too_short":
        return f"{key}: given {given!r}, allowed is a list of at least one"
    if kind.startswith("int_"):
        return f"{key}: given {given!r}, allowed is a whole number"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        given = given.get("kind") if isinstance(given, dict) else given
        tags = error.get("ctx", {}).get("expected_tags", "'self-affine', 'turned', 'file', or 'liquid', 'ideal-gas'")
        return f"{key}.kind: given {given!r}, allowed is one of {tags}"
    message = str(error["msg"])
    if ": given " in message:  # a fault between keys names its own
        return message
    if isinstance(given, (dict, BaseModel)):
        return f"{key}: allowed is {message}"
    text = message.removeprefix("Input should be ").removeprefix("Value error, ")
    return f"{key}: given {given!r}, allowed is {text}"


def _known_keys(loc: tuple[Any, ...]) -> list[str]:
    """Keys of the table in which an unknown key was found."""
    model: Any = Case
    for part in loc[:-1]:
        if isinstance(part, int):
            continue
        options = _models(model.model_fields[part].annotation) if part in model.model_fields else _tagged(part)
        model = options[0] if options else model
    return [name for name in model.model_fields if name != "folder"]


def _models(annotation: Any) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for inner in get_args(annotation) for m in _models(inner)]


def _tagged(tag: str) -> list[Any]:
    tables = (SelfAffineFace, TurnedFace, FileFace, LiquidTable, GasTable)
    return [t for t in tables if tag in get_args(t.model_fields["kind"].annotation)]
