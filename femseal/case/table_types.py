"""Tables of a case file: pydantic models whose fields are the keys.

`key` declares a key with its meaning, its default and an example; the JSON schema, a new case, the error messages and
the page of all keys are made from these declarations. Registered classes, such as the fluids, get their tables from
`table_for_each`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, fields
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

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator
from pydantic.fields import FieldInfo

from ..base.quantities import with_its_unit
from .quantity_types import Quantity, UsualRange


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
    """Declare a key of a table.

    Parameters
    ----------
    meaning : what the key means, in a phrase.
    default : value of a case without this key; a key without a default is required.
    start : value in a new case, as TOML has it.
    example : value that a new case shows in a comment; the default, or the example of the quantity, unless given.
    since : first version of femseal that has the key.
    instead : another key of the table, in place of which this one can be used.
    needed : when the key is needed, if its table does not say so.
    limits : limits of the value, as `pydantic.Field` takes them.
    """
    shown = example if start is None else start
    field: Any = Field  # which is declared with another type for every limit
    return field(
        default,
        description=meaning,
        examples=None if shown is None else [shown],
        json_schema_extra={"start": start, "since": since, "instead": instead, "needed": needed},
        **limits,
    )


class Table(BaseModel):
    """A table of a case file. Its keys are the fields; any other key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ParameterTable(Table):
    """A table with the parameters of an object, which is created by the function for its `kind`.

    Attributes
    ----------
    makers : functions, or classes, that create the object, by kind.
    is_checked : whether the object is created to check the table.
    """

    if TYPE_CHECKING:
        kind: str
    makers: ClassVar[Mapping[str, Callable[..., Any]]]
    is_checked: ClassVar[bool] = True

    def make(self, folder: Path = Path(), **others: Any) -> Any:
        """Create the object.

        Parameters
        ----------
        folder : to which paths in the table are relative.
        others : parameters in place of those in the table.
        """
        maker = self.makers[self.kind]
        parameters = {
            name: folder / value if isinstance(value, Path) else value
            for name, value in self
            if name in _parameter_names(maker)
        }
        return maker(**parameters | others)

    @model_validator(mode="after")
    def _check_object(self) -> ParameterTable:
        if self.is_checked:
            self.make()
        return self


@cache
def _parameter_names(function: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(signature(function).parameters)


def table_for_each(
    classes: Mapping[str, Any],
    base: type[Table],
    other_keys: Callable[[Any], dict[str, Any]] = lambda cls: {},
) -> Any:
    """Return a union of tables, one for each registered class, of which the key `kind` chooses one.

    Parameters
    ----------
    classes : frozen dataclasses by their kind, whose quantities are declared by `base.validate.parameter`.
    base : base class of the tables.
    other_keys : returns, for a class, types in place of those of its fields, and further keys: pairs of type and `key`.
    """
    tables = [_create_table(kind, cls, base, other_keys(cls)) for kind, cls in classes.items()]
    return Annotated[reduce(or_, tables), Field(discriminator="kind")]


#: Arguments of `key` that a field of a registered class can have in its metadata.
_KEY_ARGUMENTS = ("meaning", "example", "since", "instead", "needed")


def _create_table(
    kind: str, cls: Any, base: type[Table], other_keys: dict[str, Any]
) -> type[Table]:
    """Create the table of a registered dataclass, with a key for each of its fields."""
    types = get_type_hints(cls) | other_keys
    keys: dict[str, Any] = {"kind": (Literal[kind], ...)}
    # keyword-only parameters are the less important ones
    for field in sorted(fields(cls), key=lambda field: bool(field.kw_only)):
        default = ... if field.default is MISSING else field.default
        arguments = {
            name: field.metadata[name] for name in _KEY_ARGUMENTS if name in field.metadata
        }
        value_type = _annotated(types[field.name], field.metadata)
        keys[field.name] = value_type, key(default=default, **arguments)
    keys |= {name: pair for name, pair in other_keys.items() if isinstance(pair, tuple)}
    name = f"{cls.__name__}Table"
    summary = (cls.__doc__ or "").split("\n\n")[0]
    table = create_model(name, __base__=base, __doc__=summary, **keys)
    # pickle, by which processes get a case, looks for the class in this module
    globals().setdefault(name, table)
    return table


def _annotated(value_type: Any, metadata: Mapping[str, Any]) -> Any:
    """Return the type of a field with its unit and its ranges, if `base.validate.parameter` has declared it."""
    if "allowed" not in metadata:
        return value_type
    unit, above = metadata["unit"], metadata["above"]
    includes_end = metadata["inclusive"]

    def is_allowed(x: float) -> bool:
        return bool(x >= above if includes_end else x > above)

    low, high = metadata["usual"]
    quantity = Quantity(unit, is_allowed, metadata["allowed"])
    return Annotated[value_type, quantity, UsualRange(low, high, unit)]


def files_in(table: Table, place: str = "") -> Iterator[tuple[str, Path]]:
    """Yield key and path of every file that a table names by a path, or a table inside it."""
    for name, value in table:
        key = f"{place}.{name}".lstrip(".")
        for item in _flattened(value):
            if isinstance(item, Table):
                yield from files_in(item, key)
            elif isinstance(item, Path):
                yield key, item


def makers_in(table: Table) -> Iterator[Callable[..., Any]]:
    """Yield the registered function or class that creates the object of a table, and of each table inside it."""
    if isinstance(table, ParameterTable):
        yield table.makers[table.kind]
    for _, value in table:
        for item in _flattened(value):
            if isinstance(item, Table):
                yield from makers_in(item)


def unusual_values(table: Table, place: str = "") -> Iterator[str]:
    """Yield a warning for every key of a table, and of tables inside it, whose value is out of its usual range.

    Parameters
    ----------
    table : the table.
    place : its key in the case, "" for the case itself.
    """
    for name, field in type(table).model_fields.items():
        key = f"{place}.{name}".lstrip(".")
        values = list(_flattened(getattr(table, name)))
        tables = [value for value in values if isinstance(value, Table)]
        for number, inner in enumerate(tables):
            yield from unusual_values(inner, f"{key}.{number}" if len(tables) > 1 else key)
        outside = _values_outside(values, field)
        if not outside:
            continue
        value, usual = outside[0]
        given, low, high = (with_its_unit(x, usual.unit) for x in (value, usual.low, usual.high))
        others = f" (and {len(outside) - 1} more)" if len(outside) > 1 else ""
        yield f"{key} {given}{others} is outside the usual range of {low} to {high}: is the unit right?"


def _values_outside(values: list[Any], field: FieldInfo) -> list[tuple[float, UsualRange]]:
    """Return the values of a key that are out of their usual range, each with that range; 0 is always usual."""
    annotations = (*type_parts(field.annotation), *field.metadata)
    ranges = {part.unit: part for part in annotations if isinstance(part, UsualRange)}
    # a value does not say its unit unless the key has several
    only_unit = next(iter(ranges)) if len(ranges) == 1 else None
    outside = []
    for value in values:
        usual = ranges.get(getattr(value, "unit", only_unit))  # type: ignore[arg-type]
        if usual is not None and value and not usual.low <= value <= usual.high:
            outside.append((value, usual))
    return outside


def _flattened(value: Any) -> Iterator[Any]:
    """Yield a value, or the values in nested tuples."""
    if isinstance(value, tuple):
        for item in value:
            yield from _flattened(item)
    else:
        yield value


def type_parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and, recursively, all types and annotations of which it consists."""
    yield annotation
    if get_origin(annotation) is not Literal:
        for inner in get_args(annotation):
            yield from type_parts(inner)
