"""Define the types of the values in a case file: quantities with a unit, numbers in a range, and names.

Each type is an `Annotated` type of pydantic. A `Quantity` in the annotation converts text with a unit to SI units. With
a `UsualRange`, a value outside the range causes a warning, because its unit may be wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import (
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import core_schema

from ..base import InputError, to_si
from ..materials import YOUNG_LIMITS
from .faults import as_value_error, expected_value, invalid_value

#: Table of a case before validation: texts and numbers by key.
RawTable = dict[str, Any]
#: Largest absolute value of a quantity in SI units. The smallest absolute value, apart from 0, is the inverse of
#: `_LARGEST`. Within these limits, products of several quantities remain finite.
_LARGEST = 1e30
#: Largest count. No array has as many elements.
_LARGEST_COUNT = 10**12


class Amount(float):
    """A number in SI units together with its unit, such as a load or a value derived from other keys."""

    unit: str

    def __new__(cls, value: float, unit: str) -> Amount:
        """Create an amount from a value in SI units and the name of its unit."""
        amount = super().__new__(cls, value)
        amount.unit = unit
        return amount

    def __getnewargs__(self) -> tuple[Any, ...]:
        return float(self), self.unit

    def __repr__(self) -> str:
        return repr(f"{float(self)!r} {self.unit}".strip())


def in_si(value: Any, unit: str, like: str = "") -> float:
    """Return the value of a quantity in SI units.

    Parameters
    ----------
    value : an `Amount`, or text that `to_si` can read.
    unit : expected SI unit.
    like : example of a valid value, for the error message.

    Raises
    ------
    InputError : the value cannot be read, or has another unit.
    """
    if isinstance(value, Amount) and value.unit == unit:
        return float(value)
    return to_si(value, unit, like=like)


def unvalidated_value(table: RawTable, name: str, unit: str, default: Any = None) -> Any:
    """Return the value of a key in SI units, from a table that has not been validated yet.

    If the key is missing or its value is invalid, the default is returned. The validation of the case reports invalid
    values later.
    """
    try:
        return in_si(table[name], unit)
    except (InputError, KeyError):
        return default


@dataclass(frozen=True)
class Quantity:
    """Annotate a float that is given in a case as text with a unit, or as a number if it has no unit.

    Attributes
    ----------
    unit : SI unit, "" for a number without a unit.
    is_allowed : function that returns True for values in SI units within the allowed range.
    allowed : description of the allowed values.
    example : example of a value, as a user writes it; "" for a number that needs none.
    """

    unit: str
    is_allowed: Callable[[float], bool]
    allowed: str
    example: str = ""

    @property
    def expected(self) -> str:
        """Description of the allowed values, with the example."""
        return f"{self.allowed}, such as '{self.example}'" if self.example else self.allowed

    def read(self, value: Any) -> float:
        """Read a value and return it in SI units.

        Raises
        ------
        InputError : the value cannot be read, or is outside the allowed range.
        """
        with as_value_error("" if self.unit else self.expected):
            number = in_si(value, self.unit, self.example)
        if not self.is_allowed(number):
            raise invalid_value(self.expected)
        if number and not 1 / _LARGEST <= abs(number) <= _LARGEST:
            limits = f"from {1 / _LARGEST:g} to {_LARGEST:g} {self.unit}".rstrip()
            raise invalid_value(f"{self.expected}, {limits}")
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
class UsualRange:
    """Annotate a quantity with the usual range of its values in SI units.

    A value outside the usual range is valid, but leads to a warning, because its unit may be wrong. A type that allows
    several units has a usual range for each unit. If an annotation contains several ranges with the same unit, the last
    one applies. A key can thus have a narrower range than its type.
    """

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class OneForBothAxes:
    """Annotate a pair of values for x1 and x2; a case can give a single value instead, which applies to both axes."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return core_schema.no_info_wrap_validator_function(self._read, handler(source))

    def __get_pydantic_json_schema__(
        self, core: Any, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        pair = handler(core)
        return {"anyOf": [pair, pair["items"]]}

    @staticmethod
    def _read(value: Any, validate_pair: Callable[[Any], Any]) -> Any:
        """Validate a pair of values; a single value is converted to a pair of two equal values."""
        if isinstance(value, (list, tuple, dict)):
            return validate_pair(value)
        try:
            return validate_pair((value, value))
        except ValidationError as error:
            expected = expected_value(dict(error.errors()[0]))
            raise invalid_value(f"{expected}, or a list of two") from None


def quantity_schema(expected: str) -> dict[str, Any]:
    """Return the JSON schema for text with a number and a unit."""
    pattern = r"^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?[^,]*[^\s\d.,]"
    return {"type": "string", "pattern": pattern, "expected": expected}


def _read_channel(value: Any) -> int | str:
    """Check the name or the number of a channel of a file, and return it."""
    if isinstance(value, str) and value:
        return value
    is_number = isinstance(value, int) and not isinstance(value, bool)
    if is_number and 0 <= value <= _LARGEST_COUNT:
        return int(value)
    raise invalid_value("the name of a channel, or its number, counted from 0")


def _read_length_unit(value: Any) -> Any:
    """Check that a text is a unit of length, and return it."""
    with as_value_error("a unit of length, such as 'mm'"):
        to_si(f"1 {value}", "m")
    return value


def _any(x: float) -> bool:
    return True


def _positive(x: float) -> bool:
    return x > 0


def _not_negative(x: float) -> bool:
    return x >= 0


# --- lengths ----------------------------------------------------------------------------------------------------

Length = Annotated[
    float,
    Quantity("m", _positive, "a length > 0", "1.5 mm"),
    UsualRange(1e-9, 1e3, "m"),
]
Height = Annotated[
    float,
    Quantity("m", _not_negative, "a height >= 0", "0.2 um"),
    UsualRange(1e-10, 1e-3, "m"),
]
Shift = Annotated[
    float,
    Quantity("m", _any, "a length", "-20 um"),
    UsualRange(-10.0, 10.0, "m"),
]
#: A coordinate.
Position = Annotated[
    float,
    Quantity("m", _not_negative, "a length >= 0", "0.1 mm"),
    UsualRange(1e-9, 10.0, "m"),
]
LengthUnit = Annotated[str, BeforeValidator(_read_length_unit)]

# --- solids and fluids ------------------------------------------------------------------------------------------

Modulus = Annotated[
    float,
    Quantity("Pa", _positive, "a stress > 0", "210 GPa"),
    UsualRange(*YOUNG_LIMITS, "Pa"),
]
Poisson = Annotated[
    float,
    Quantity("", lambda x: -1 < x <= 0.5, "a Poisson's ratio above -1, at most 0.5"),
    UsualRange(0.0, 0.5, ""),
]
Strength = Annotated[
    float,
    Quantity("Pa", _positive, "a stress > 0", "2 GPa"),
    UsualRange(5e6, 1e11, "Pa"),
]
Hardening = Annotated[
    float,
    Quantity("Pa/m", _not_negative, "a stress per depth >= 0", "2 GPa/um"),
    UsualRange(1e12, 1e18, "Pa/m"),
]
Pressure = Annotated[
    float,
    Quantity("Pa", _not_negative, "a pressure >= 0", "300 MPa"),
    UsualRange(1e-7, 2e9, "Pa"),
]
TEMPERATURE = Quantity("K", _positive, "a temperature above absolute zero", "20 °C")
Temperature = Annotated[float, TEMPERATURE, UsualRange(2.0, 2000.0, "K")]

# --- other quantities with a unit -------------------------------------------------------------------------------

Angle = Annotated[
    float,
    Quantity("rad", _any, "an angle", "90 deg"),
    UsualRange(-6.3, 6.3, "rad"),
]
Volume = Annotated[
    float,
    Quantity("m^3", _positive, "a volume > 0", "0.05 mL"),
    UsualRange(1e-9, 1e-5, "m^3"),
]
VolumeRate = Annotated[
    float,
    Quantity("m^3/s", _positive, "a volume per time > 0", "100 L/min"),
    UsualRange(1e-6, 100.0, "m^3/s"),
]
Duration = Annotated[
    float,
    Quantity("s", _positive, "a time > 0", "30 min"),
    UsualRange(1.0, 3e7, "s"),
]
FileSize = Annotated[float, Quantity("byte", _not_negative, "a size >= 0", "500 MB")]

# --- numbers ----------------------------------------------------------------------------------------------------

Fraction = Annotated[float, Quantity("", lambda x: 0 <= x <= 1, "a number from 0 to 1")]
Relaxation = Annotated[
    float, Quantity("", lambda x: 0 <= x < 1, "a fraction from 0, below 1", "10 %")
]
Accuracy = Annotated[
    float, Quantity("", lambda x: 0 < x < 1, "a fraction above 0 and below 1", "10 %")
]
Hurst = Annotated[float, Quantity("", lambda x: 0 < x <= 1, "a Hurst exponent above 0, at most 1")]
Slope = Annotated[float, Quantity("", _positive, "a slope > 0"), UsualRange(1e-4, 3.0, "")]
Threshold = Annotated[float, Field(strict=True, gt=0)]
Count = Annotated[int, Field(strict=True, ge=1, le=_LARGEST_COUNT)]
#: A whole number that identifies something, such as a seed.
Number = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
#: A channel of a file, by its number or its name.
Channel = Annotated[
    int | str,
    BeforeValidator(_read_channel),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 0}, {"type": "string"}]}),
]
