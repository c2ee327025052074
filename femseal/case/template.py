"""A new case, in which every key stands with a value or an example, as the tables declare them."""

import json
import textwrap
from collections.abc import Iterator
from functools import cache
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from .faults import INTERNAL
from .values import Quantity, Table, parts

_HEAD = """\
# A femseal case. Quantities are text with their unit; lines that start with # are optional and show the default
# or a possible value. x1 is the direction of the leakage, x2 runs along the seal.
"""
#: Columns of a value, and of a line.
_VALUE, _LINE = 35, 120


@cache
def case_template(case: type[Table]) -> str:
    """Text of a case that is valid as it stands; what is commented out is valid table by table."""
    fields = keys_of(case)
    plain = [_row(name, field, live=True) for name, field in fields.items() if not tables_in(field)]
    blocks = ["".join(plain)]
    seen: list[type[Table]] = []
    for name, field in fields.items():
        blocks += _blocks(name, field, seen)
    return "\n".join([_HEAD, *blocks])


@cache
def table_to_paste(case: type[Table], name: str) -> str:
    """A table of a new case without its comments, "" of one that it does not have."""
    field = keys_of(case)[name]
    if not tables_in(field) or not field.is_required():
        return ""
    keys = {key: one for key, one in keys_of(tables_in(field)[0]).items() if _is_live(one)}
    return "\n".join([f"[{name}]", *map(_pair, keys, map(example, keys.values()))])


def _pair(key: str, value: Any) -> str:
    return f"{key} = {as_toml(value)}"


def as_toml(value: Any) -> str:
    """A value of a TOML file, a table on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(map(_pair, map(bare_key, value), value.values()))}}}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return str(value).lower() if isinstance(value, bool) else str(value)


def bare_key(name: str) -> str:
    """A key of a TOML file, in quotes where it has to be."""
    plain = name.replace("_", "").replace("-", "").isalnum() and name.isascii()
    return name if plain else json.dumps(name)


def keys_of(table: type[Table]) -> dict[str, FieldInfo]:
    """The keys of a table, its kind first."""
    keys = {name: field for name, field in table.model_fields.items() if name not in INTERNAL}
    return {name: keys[name] for name in sorted(keys, key=lambda name: name != "kind")}


def told(field: FieldInfo, name: str) -> Any:
    """What `values.key` was told of a key, None where it was not."""
    extra = field.json_schema_extra
    return extra.get(name) if isinstance(extra, dict) else None


def example(field: FieldInfo) -> Any:
    """A value of a key, as TOML has it; "" where none is known."""
    if field.examples:
        return field.examples[0]
    quantity = quantity_of(field)
    if quantity is not None and quantity.example:
        return quantity.example
    if field.is_required():
        return next(iter(choices(field)), "")
    return "" if field.default is None else field.default


def choices(field: FieldInfo) -> list[Any]:
    """The values that a key may have, where they are few and known."""
    found = (part for part in parts(field.annotation) if get_origin(part) is Literal)
    return list(dict.fromkeys(value for part in found for value in get_args(part)))


def quantity_of(field: FieldInfo) -> Quantity | None:
    """The quantity of a key; None where it has none, or several of different units."""
    every = (*field.metadata, *parts(field.annotation))
    found = [one for one in every if isinstance(one, Quantity)]
    return found[0] if len({one.unit for one in found}) == 1 else None


def tables_in(field: FieldInfo) -> list[type[Table]]:
    """The tables that the value of a key may be."""
    types = (one for one in parts(field.annotation) if isinstance(one, type))
    return list(dict.fromkeys(one for one in types if issubclass(one, Table)))


def kind_of(table: type[Table]) -> str | None:
    """The kind of a table that has one."""
    field = table.model_fields.get("kind")
    return None if field is None else str(choices(field)[0])


def summary(table: type[Table]) -> str:
    """What a table is, in a phrase of its docstring."""
    text = " ".join((table.__doc__ or "").split())
    text = text[:1].lower() + text[1:]
    for end in (":", ";", ".", ", see"):
        text = text.partition(end)[0]
    return text


def _is_live(field: FieldInfo) -> bool:
    return field.is_required() or told(field, "start") is not None


def _blocks(name: str, field: FieldInfo, seen: list[type[Table]]) -> Iterator[str]:
    """A table of a case, one block for each of its kinds, and the tables in it."""
    tables, shown = tables_in(field), set[Any]()
    for number, table in enumerate(tables):
        keys = keys_of(table)
        first, only = number == 0, len(tables) == 1
        starts = (first and field.is_required()) or (only and any(map(_is_live, keys.values())))
        live = starts and table not in seen
        rows = [_line(f"[{name}]", (field.description or "") if first else "", live)]
        for key, one in keys.items():
            is_table = bool(tables_in(one)) and not one.examples
            told_already = table in seen or (key, one.description) in shown
            if not is_table and (one.is_required() or not told_already):
                meaning = summary(table) if key == "kind" else one.description
                rows.append(_row(key, one, live, meaning))
        yield "".join(rows)
        shown |= {(key, one.description) for key, one in keys.items()}
    inner = {key: one for table in tables for key, one in keys_of(table).items()}
    for key, one in inner.items() if tables[:1] and tables[0] not in seen else ():
        if tables_in(one) and not one.examples:
            yield from _blocks(f"{name}.{key}", one, seen)
    seen += tables


def _row(name: str, field: FieldInfo, live: bool, meaning: str | None = None) -> str:
    """The line of a key with its value and what it means."""
    said = (meaning or field.description or "").replace("`", "")
    if instead := told(field, "instead"):
        said = f"in place of {instead}: {said}"
    value, few = example(field), choices(field)
    if others := ", ".join(as_toml(one) for one in few if one != value and name != "kind"):
        said += f"; of {others}" if isinstance(value, list | tuple) else f"; or {others}"
    text = _pair(name, value)
    apart = not _is_live(field) and (instead or told(field, "needed"))
    return _line(f"  {text}" if apart else text, said, live and _is_live(field))


def _line(text: str, said: str, live: bool) -> str:
    text = text if live else f"# {text}"
    notes = [f"# {line}\n" for line in textwrap.wrap(said, _LINE - _VALUE - 2)]
    first = f"{text:<{_VALUE}}{notes.pop(0)}" if len(text) < _VALUE and notes else f"{text}\n"
    return "".join([first, *(" " * _VALUE + note for note in notes)])
