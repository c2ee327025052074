"""Declare tables of a case file, which are pydantic models whose fields are the keys.

`key` declares a key with its meaning, its default and an example. The JSON schema, the template of a new case, the
error messages and the documentation of all keys are made from these declarations. `table_for_each` makes tables from
registered classes, such as the fluids.
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
    meaning : phrase that explains the key.
    default : value that is used if a case does not have the key; a key without a default is required.
    start : initial value of the key, as TOML text, in the case file that `femseal new` writes.
    example : value, in TOML, that `femseal new` writes into a comment. By default, the file shows the example of the
        quantity or, if the quantity has no example, the default value.
    since : version of femseal in which the key was introduced.
    instead : name of another key of the same table that this key can replace.
    needed : phrase that says when the key is needed, such as "without a `name`".
    limits : limits of the value, as arguments for `pydantic.Field`.
    """
    shown = example if start is None else start
    field: Any = Field  # type checkers do not accept `limits` for any of its overloads
    return field(
        default,
        description=meaning,
        examples=None if shown is None else [shown],
        json_schema_extra={"start": start, "since": since, "instead": instead, "needed": needed},
        **limits,
    )


class Table(BaseModel):
    """A table of a case file. The fields of the class are the keys of the table; an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class ParameterTable(Table):
    """A table with the parameters of an object. The key `kind` determines the function that creates the object.

    Attributes
    ----------
    makers : dictionary with the function or the class that creates the object for each value of `kind`.
    is_checked : whether the object is created during the validation, so that its constructor checks the values of the
        table.
    """

    if TYPE_CHECKING:
        kind: str
    makers: ClassVar[Mapping[str, Callable[..., Any]]]
    is_checked: ClassVar[bool] = True

    def make(self, folder: Path = Path(), **others: Any) -> Any:
        """Create the object that the table describes.

        Parameters
        ----------
        folder : folder to which paths in the table are relative.
        others : further parameters of the object, which replace values of the table with the same names.
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
        """Create the object of the table, so that an error of its constructor is reported as an error of the case."""
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
    """Make a table class for each registered class, and return the union of these table classes as a type.

    When a case is validated, pydantic chooses the table class by the key `kind`.

    Parameters
    ----------
    classes : frozen dataclasses by their kinds. The fields of the dataclasses are declared by
        `base.validate.parameter`.
    base : base class of the tables.
    other_keys : function that takes a registered class and returns a dictionary of keys. If a key has the same name as
        a field of the class, its value is the type to use instead of the type of the field. Otherwise, its value is a
        pair: the type of the new key, and its declaration by `key`.
    """
    tables = [_create_table(kind, cls, base, other_keys(cls)) for kind, cls in classes.items()]
    return Annotated[reduce(or_, tables), Field(discriminator="kind")]


#: Arguments of `key` that are taken from the metadata of a field of a registered class, if they are there.
_KEY_ARGUMENTS = ("meaning", "example", "since", "instead", "needed")


def _create_table(
    kind: str, cls: Any, base: type[Table], other_keys: dict[str, Any]
) -> type[Table]:
    """Create the table class for a registered dataclass, with a key for each field of the dataclass.

    kind : value of the key `kind`, which chooses this table in a case file.
    cls : the dataclass.
    base : class from which the table is derived.
    other_keys : dictionary that the function `other_keys` of `table_for_each` returns for the dataclass.
    """
    # a pair of a type and a declaration adds a key, and a single type replaces the type of a field
    added_keys = {name: entry for name, entry in other_keys.items() if isinstance(entry, tuple)}
    replaced_types = {name: entry for name, entry in other_keys.items() if name not in added_keys}
    types = get_type_hints(cls) | replaced_types
    keys: dict[str, Any] = {"kind": (Literal[kind], ...)}
    # keyword-only parameters come last, because they are less important
    for field in sorted(fields(cls), key=lambda field: bool(field.kw_only)):
        default = ... if field.default is MISSING else field.default
        arguments = {
            name: field.metadata[name] for name in _KEY_ARGUMENTS if name in field.metadata
        }
        value_type = _annotated(types[field.name], field.metadata)
        keys[field.name] = value_type, key(default=default, **arguments)
    keys |= added_keys
    name = f"{cls.__name__}Table"
    # the docstring "Describe a straight strip." becomes "A straight strip."
    summary = (cls.__doc__ or "").split("\n\n")[0].removeprefix("Describe ")
    summary = summary[:1].upper() + summary[1:]
    table = create_model(name, __base__=base, __doc__=summary, **keys)
    # a case is sent to other processes by pickle, which looks for the class in this module
    globals().setdefault(name, table)
    return table


def _annotated(value_type: Any, metadata: Mapping[str, Any]) -> Any:
    """Add the unit and the ranges to the type of a field, if `base.validate.parameter` has declared the field."""
    if "allowed" not in metadata:
        return value_type
    unit, above = metadata["unit"], metadata["above"]
    includes_end = metadata["inclusive"]

    def is_allowed(x: float) -> bool:
        return bool(x >= above if includes_end else x > above)

    low, high = metadata["usual"]
    quantity = Quantity(unit, is_allowed, metadata["allowed"], metadata["allowed_example"])
    return Annotated[value_type, quantity, UsualRange(low, high, unit)]


def files_in(table: Table, table_key: str = "") -> Iterator[tuple[str, Path]]:
    """Yield the key and the path of every file that is named in a table or in the tables inside it."""
    for name, value in table:
        key = f"{table_key}.{name}".lstrip(".")
        for item in _flattened(value):
            if isinstance(item, Table):
                yield from files_in(item, key)
            elif isinstance(item, Path):
                yield key, item


def makers_in(table: Table) -> Iterator[Callable[..., Any]]:
    """Yield the functions or classes that create the objects of a table and of the tables inside it."""
    if isinstance(table, ParameterTable):
        yield table.makers[table.kind]
    for _name, value in table:
        for item in _flattened(value):
            if isinstance(item, Table):
                yield from makers_in(item)


def unusual_values(table: Table, table_key: str = "") -> Iterator[str]:
    """Yield a warning for every value outside its usual range, in a table and in the tables inside it.

    Parameters
    ----------
    table : table to check.
    table_key : key of the table in the case, "" for the case itself.
    """
    for name, field in type(table).model_fields.items():
        key = f"{table_key}.{name}".lstrip(".")
        values = list(_flattened(getattr(table, name)))
        tables = [value for value in values if isinstance(value, Table)]
        for number, inner in enumerate(tables):
            yield from unusual_values(inner, f"{key}.{number}" if len(tables) > 1 else key)
        outside = _values_outside(values, field)
        if not outside:
            continue
        value, usual = outside[0]  # the warning states the first of these values
        given = with_its_unit(value, usual.unit)
        low = with_its_unit(usual.low, usual.unit)
        high = with_its_unit(usual.high, usual.unit)
        others = f" (and {len(outside) - 1} more)" if len(outside) > 1 else ""
        yield f"{key} {given}{others} is outside the usual range of {low} to {high}: is the unit right?"


def _values_outside(values: list[Any], field: FieldInfo) -> list[tuple[float, UsualRange]]:
    """Return the values of a key that are outside their usual range, each together with the usual range.

    Values of 0 are never returned, so that they do not lead to a warning.
    """
    annotations = (*type_parts(field.annotation), *field.metadata)
    ranges = {part.unit: part for part in annotations if isinstance(part, UsualRange)}
    # If a key allows several units, its values are of the class `Amount`, with an attribute `unit`. The values of a key
    # with a single unit are plain numbers, and the key has a single range.
    only_unit = next(iter(ranges)) if len(ranges) == 1 else None
    outside = []
    for value in values:
        unit = getattr(value, "unit", only_unit)
        usual = ranges.get(unit)  # type: ignore[arg-type]
        if usual is not None and value and not usual.low <= value <= usual.high:
            outside.append((value, usual))
    return outside


def _flattened(value: Any) -> Iterator[Any]:
    """Yield all values inside nested tuples; if the argument is not a tuple, yield the argument itself."""
    if isinstance(value, tuple):
        for item in value:
            yield from _flattened(item)
    else:
        yield value


def type_parts(annotation: Any) -> Iterator[Any]:
    """Yield a type annotation and, recursively, all types and annotations inside it."""
    yield annotation
    if get_origin(annotation) is not Literal:
        for inner in get_args(annotation):
            yield from type_parts(inner)
