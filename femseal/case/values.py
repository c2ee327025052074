"""Values in a case file: quantities with their unit, numbers in a range, known names; and tables of them.

Registered classes, such as fluids, get their tables automatically.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache, reduce
from inspect import signature
from operator import or_
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    WithJsonSchema,
    create_model,
    model_validator,
)
from pydantic_core import core_schema

from ..base import InputError, to_si
from ..base.quantities import with_its_unit
from ..materials import YOUNG_LIMITS
from .faults import faults_of, refusal, refusals

#: Largest value in SI of a quantity, one over it the smallest: products of several stay finite.
_LARGEST = 1e30
#: Largest number of a count: no array is as long.
_MOST = 10**12


class Amount(float):
    """A number in SI with its unit, such as a load, or what was worked out from other keys."""

    unit: str

    def __new__(cls, value: float, unit: str) -> Amount:
        """A number with a unit."""
        amount = super().__new__(cls, value)
        amount.unit = unit
        return amount

    def __getnewargs__(self) -> tuple[Any, ...]:
        return float(self), self.unit

    def __repr__(self) -> str:
        return repr(f"{float(self)!r} {self.unit}".strip())


def in_si(value: Any, unit: str, like: str = "") -> float:
    """The value in SI of a text as `to_si` takes it, or of an amount.

    Raises InputError: neither, or another unit.
    """
    if isinstance(value, Amount) and value.unit == unit:
        return float(value)
    return to_si(value, unit, like=like)


def value_of(table: dict[str, Any], name: str, unit: str, default: Any = None) -> Any:
    """The value in SI of a key of a raw table; the default where it has none, or one whose fault is told elsewhere."""
    try:
        return in_si(table[name], unit)
    except (InputError, KeyError):
        return default


def key(
    meaning: str = "",
    default: Any = ...,
    *,
    start: Any = None,
    example: Any = None,
    since: str = "0.1",
    instead: str = "",
    needed: str = "",
    **limits: Any,
) -> Any:
    """A key of a table, declared once: schema, template, messages and the page of keys tell it from here.

    meaning : in a phrase. default : where none is given; without it the key is required.
    start : value in a new case, as TOML has it. example : value that a new case shows in a comment; the default, or
        that of the kind of the value, unless given.
    since : first version that has it. instead : key of the table in whose place it stands.
    needed : when it is, where the table does not say it. limits : as pydantic's `Field` takes them.
    """
    shown = example if start is None else start
    told = {"start": start, "since": since, "instead": instead, "needed": needed}
    examples = None if shown is None else [shown]
    field: Any = Field  # limits are of any kind
    return field(default, description=meaning, json_schema_extra=told, examples=examples, **limits)


@dataclass(frozen=True)
class Quantity:
    """Text with a unit, or a plain number where `unit` is "", as a float in SI."""

    unit: str
    test: Callable[[float], bool]
    expected: str

    @property
    def example(self) -> str:
        """The value that stands in what is expected, "" without one."""
        return self.expected.partition("'")[2].partition("'")[0]

    def read(self, value: Any) -> float:
        """The value in SI; PydanticCustomError where it cannot be used."""
        with refusals("" if self.unit else self.expected):
            number = in_si(value, self.unit, self.example)
        if not self.test(number):
            raise refusal(self.expected)
        if number and not 1 / _LARGEST <= abs(number) <= _LARGEST:
            expected = (
                f"{self.expected}, from {1 / _LARGEST:g} to {_LARGEST:g} {self.unit}".rstrip()
            )
            raise refusal(expected)
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return core_schema.no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(
        self, core: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        if self.unit:
            return quantity_schema(self.expected)
        return {"type": ["number", "string"], "expected": self.expected}


@dataclass(frozen=True)
class Usual:
    """Annotation of a quantity: the range in SI out of which a value is possible, but may be a slip of its unit.

    The last one counts, so that a key may have another one than its kind. Of a kind with several units, each has one;
    numbers of a key with several that do not say theirs have none.
    """

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Both:
    """Annotation of a pair along x1 and x2, for which a single value is that of both."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return core_schema.no_info_wrap_validator_function(self._read, handler(source))

    def __get_pydantic_json_schema__(
        self, core: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        pair = handler(core)
        return {"anyOf": [pair, pair["prefixItems"][0]]}

    @staticmethod
    def _read(value: Any, handler: Callable[[Any], Any]) -> Any:
        if isinstance(value, (list, tuple, dict)):
            return handler(value)
        try:
            return handler((value, value))
        except ValidationError as error:
            raise refusal(
                f"{error.errors()[0]['msg'].removeprefix('Input should be ')}, or a list of two"
            ) from None


def quantity_schema(described: str) -> dict[str, Any]:
    """JSON schema of a number with a unit, as text."""
    pattern = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?[^,]*[^\s\d.,]"
    return {"type": "string", "pattern": pattern, "expected": described}


def _channel(value: Any) -> int | str:
    if isinstance(value, str) and value:
        return value
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= _MOST:
        raise refusal("the number of a channel, from 0, or its name")
    return value


def _length_unit(value: Any) -> Any:
    with refusals("a unit of length, such as 'mm'"):
        to_si(f"1 {value}", "m")
    return value


def _positive(x: float) -> bool:
    return x > 0


def _not_negative(x: float) -> bool:
    return x >= 0


Length = Annotated[
    float, Quantity("m", _positive, "a length > 0, such as '1.5 mm'"), Usual(1e-9, 1e3, "m")
]
Height = Annotated[
    float, Quantity("m", _not_negative, "a height >= 0, such as '0.2 um'"), Usual(1e-10, 1e-3, "m")
]
Pressure = Annotated[
    float,
    Quantity("Pa", _not_negative, "a pressure >= 0, such as '300 MPa'"),
    Usual(1e-7, 2e9, "Pa"),
]
Temperature = Annotated[
    float,
    Quantity("K", _positive, "a temperature above absolute zero, such as '20 °C'"),
    Usual(2.0, 2000.0, "K"),
]
Hardening = Annotated[
    float,
    Quantity("Pa/m", _not_negative, "a stress per depth >= 0, such as '2 GPa/um'"),
    Usual(1e12, 1e18, "Pa/m"),
]
Modulus = Annotated[
    float, Quantity("Pa", _positive, "a stress > 0, such as '210 GPa'"), Usual(*YOUNG_LIMITS, "Pa")
]
Strength = Annotated[
    float, Quantity("Pa", _positive, "a stress > 0, such as '2 GPa'"), Usual(5e6, 1e11, "Pa")
]
FileSize = Annotated[float, Quantity("byte", _not_negative, "a size >= 0, such as '500 MB'")]
Ratio = Annotated[float, Quantity("", lambda x: 0 <= x <= 1, "a number from 0 to 1")]
Relaxation = Annotated[
    float, Quantity("", lambda x: 0 <= x < 1, "a fraction from 0, below 1, such as '10 %'")
]
Hurst = Annotated[float, Quantity("", lambda x: 0 < x <= 1, "a Hurst exponent above 0, at most 1")]
Slope = Annotated[float, Quantity("", _positive, "a slope > 0"), Usual(1e-4, 3.0, "")]
Poisson = Annotated[
    float,
    Quantity("", lambda x: -1 < x <= 0.5, "a Poisson's ratio above -1, at most 0.5"),
    Usual(0.0, 0.5, ""),
]
Angle = Annotated[
    float, Quantity("rad", lambda x: True, "an angle, such as '90 deg'"), Usual(-6.3, 6.3, "rad")
]
Volume = Annotated[
    float, Quantity("m^3", _positive, "a volume > 0, such as '0.05 mL'"), Usual(1e-9, 1e-5, "m^3")
]
VolumeRate = Annotated[
    float,
    Quantity("m^3/s", _positive, "a volume per time > 0, such as '100 L/min'"),
    Usual(1e-6, 100.0, "m^3/s"),
]
Duration = Annotated[
    float, Quantity("s", _positive, "a time > 0, such as '30 min'"), Usual(1.0, 3e7, "s")
]
Accuracy = Annotated[
    float, Quantity("", lambda x: 0 < x < 1, "a fraction above 0 and below 1, such as '10 %'")
]
Shift = Annotated[
    float, Quantity("m", lambda x: True, "a length, such as '-20 um'"), Usual(-10.0, 10.0, "m")
]
Place = Annotated[
    float, Quantity("m", _not_negative, "a length >= 0, such as '0.1 mm'"), Usual(1e-9, 10.0, "m")
]
LengthUnit = Annotated[str, BeforeValidator(_length_unit)]
#: A channel of a file, by its number or its name.
Channel = Annotated[
    int | str,
    BeforeValidator(_channel),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 0}, {"type": "string"}]}),
]
Threshold = Annotated[float, Field(strict=True, gt=0)]
Count = Annotated[int, Field(strict=True, ge=1, le=_MOST)]
#: A whole number that names and does not count, such as a seed.
Number = Annotated[int, Field(strict=True, ge=0, lt=2**63)]


class Table(BaseModel):
    """A table of a case file: its keys are the fields, any other key is a fault."""

    model_config = ConfigDict(extra="forbid", frozen=True)


_signature = cache(signature)


class MadeTable(Table):
    """A table with the parameters of something that is made, by its kind.

    makers : what makes it of them, by its kind. place : of the table, if it is tried whether it can be made.
    """

    if TYPE_CHECKING:
        kind: str
    makers: ClassVar[Mapping[str, Callable[..., Any]]]
    place: ClassVar[str] = ""

    def make(self, folder: Path = Path(), **more: Any) -> Any:
        """What the table describes; paths are relative to a folder."""
        maker = self.makers[self.kind]
        known = _signature(maker).parameters
        parameters = {
            name: folder / value if isinstance(value, Path) else value
            for name, value in self
            if name in known
        }
        return maker(**parameters | more)

    @model_validator(mode="after")
    def _possible(self) -> MadeTable:
        if self.place:
            with faults_of(self.place):
                self.make()
        return self


def files_of(table: Table, place: str = "") -> Iterator[tuple[str, Path]]:
    """Key and path of every file that a table, or one in it, names by a path."""
    for name, value in table:
        key = f"{place}.{name}".lstrip(".")
        for one in _single(value):
            if isinstance(one, Table):
                yield from files_of(one, key)
            elif isinstance(one, Path):
                yield key, one


def unusual(table: Table, place: str = "") -> Iterator[str]:
    """A sentence for each key of a table, and of those in it, with a value out of its `Usual` range; 0 is in any."""
    for name, info in type(table).model_fields.items():
        values, key = list(_single(getattr(table, name))), f"{place}.{name}".lstrip(".")
        tables = [one for one in values if isinstance(one, Table)]
        for n, one in enumerate(tables):
            yield from unusual(one, f"{key}.{n}" if len(tables) > 1 else key)
        said = (*parts(info.annotation), *info.metadata)
        usual: dict[Any, Usual] = {one.unit: one for one in said if isinstance(one, Usual)}
        only = next(iter(usual)) if len(usual) == 1 else None
        known = [(one, usual.get(getattr(one, "unit", only))) for one in values]
        odd = [(one, of) for one, of in known if of and one and not of.low <= one <= of.high]
        more = f" (and {len(odd) - 1} more)" if len(odd) > 1 else ""
        for number, of in odd[:1]:
            given, *ends = (with_its_unit(x, of.unit) for x in (number, of.low, of.high))
            yield f"{key} {given}{more} is not in the usual range, {' to '.join(ends)}: is its unit meant?"


def _single(value: Any) -> Iterator[Any]:
    """The values in tuples of them."""
    if isinstance(value, tuple):
        for one in value:
            yield from _single(one)
    else:
        yield value


def parts(annotation: Any) -> Iterator[Any]:
    """What an annotation is made of, itself first."""
    yield annotation
    for inner in () if get_origin(annotation) is Literal else get_args(annotation):
        yield from parts(inner)


def table_of_any(
    registered: dict[str, Any],
    base: type[Table],
    more: Callable[[Any], dict[str, Any]] = lambda made: {},
) -> Any:
    """One of the tables of registered dataclasses, by its key `kind`.

    registered : frozen dataclasses by their kind, whose quantities are declared by `base.validate.parameter`.
    base : base class of their tables.
    more : by a class, annotations in place of those of fields that it has, and further keys, as pydantic's
        `create_model` takes them.
    """
    tables = [_table(kind, made, base, more(made)) for kind, made in registered.items()]
    return Annotated[reduce(or_, tables), Field(discriminator="kind")]


def _table(kind: str, made: Any, base: type[Table], more: dict[str, Any]) -> type[Table]:
    """The table of a registered dataclass."""
    hints = get_type_hints(made) | more
    keys: dict[str, Any] = {"kind": (Literal[kind], ...)}
    # the parameters that count most come first
    for f in sorted(fields(made), key=lambda f: bool(f.kw_only)):
        told = {name: f.metadata[name] for name in _TOLD if name in f.metadata}
        value = hints[f.name]
        if "allowed" in f.metadata:
            low, high = f.metadata["usual"]
            usual = Usual(low, high, f.metadata["unit"])
            value = Annotated[value, _quantity(f.metadata), usual]
        keys[f.name] = value, key(default=... if f.default is MISSING else f.default, **told)
    keys |= {name: value for name, value in more.items() if isinstance(value, tuple)}
    name, summary = f"{made.__name__}Table", (made.__doc__ or "").split("\n\n")[0]
    table = create_model(name, __base__=base, __doc__=summary, **keys)
    globals().setdefault(name, table)  # where pickle looks for it: processes get cases
    return table


#: What a field of a registered class says for its key.
_TOLD = ("meaning", "example", "since", "instead", "needed")


def _quantity(metadata: Any) -> Quantity:
    above, reached = metadata["above"], metadata["inclusive"]
    in_range = (lambda x: x >= above) if reached else (lambda x: x > above)
    return Quantity(metadata["unit"], in_range, metadata["allowed"])
