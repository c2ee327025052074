"""Write the text of a new case, and look up properties of the keys of a case.

A new case shows every key with a value or with an example; values and examples are declared by `table_types.key`. The
functions that look up properties of keys are also used for error messages and for the documentation of the keys.
"""

import json
import textwrap
from collections.abc import Iterator
from functools import cache
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from .faults import INTERNAL
from .quantity_types import Quantity
from .table_types import Table, type_parts

_HEAD = """\
# A femseal case. Quantities are text with their unit; lines that start with # are optional and show the default
# or a possible value. x1 is the direction of the leakage, x2 runs along the seal.
"""
#: Width of the column with keys and values, and width of a line [characters].
_VALUE_WIDTH, _LINE_WIDTH = 35, 120

# --- values as TOML ---------------------------------------------------------------------------------------------


def as_toml(value: Any) -> str:
    """Convert a value to TOML; a table becomes an inline table."""
    if isinstance(value, dict):
        pairs = (_pair(bare_key(name), item) for name, item in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(as_toml, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def bare_key(name: str) -> str:
    """Convert a key to TOML, in quotes if it needs them."""
    is_plain = name.replace("_", "").replace("-", "").isalnum() and name.isascii()
    return name if is_plain else json.dumps(name)


def _pair(name: str, value: Any) -> str:
    """Return the TOML text of a key and its value."""
    return f"{name} = {as_toml(value)}"


# --- keys of tables ---------------------------------------------------------------------------------------------


def keys_of(table: type[Table]) -> dict[str, FieldInfo]:
    """Return the keys of a table by their names, with the key `kind` first."""
    keys = {name: field for name, field in table.model_fields.items() if name not in INTERNAL}
    kind = {"kind": keys.pop("kind")} if "kind" in keys else {}
    return kind | keys


def declared(field: FieldInfo, argument: str) -> Any:
    """Return an argument that `table_types.key` was given when a key was declared; None if it was not given."""
    extra = field.json_schema_extra
    return extra.get(argument) if isinstance(extra, dict) else None


def example(field: FieldInfo) -> Any:
    """Return an example value of a key, as written in TOML; "" if no example is known."""
    if field.examples:
        return field.examples[0]
    quantity = quantity_of(field)
    if quantity is not None and quantity.example:
        return quantity.example
    if field.is_required():
        return next(iter(choices(field)), "")
    return "" if field.default is None else field.default


def choices(field: FieldInfo) -> list[Any]:
    """Return the possible values of a key if its type enumerates them, otherwise an empty list."""
    literals = [part for part in type_parts(field.annotation) if get_origin(part) is Literal]
    values = (value for literal in literals for value in get_args(literal))
    return list(dict.fromkeys(values))


def quantity_of(field: FieldInfo) -> Quantity | None:
    """Return the quantity that describes the values of a key: the unit, the limits and an example of a value.

    The function returns None if the type of the key has no quantity, or several quantities with different units.
    """
    annotations = (*field.metadata, *type_parts(field.annotation))
    quantities = [part for part in annotations if isinstance(part, Quantity)]
    units = {quantity.unit for quantity in quantities}
    return quantities[0] if len(units) == 1 else None


def tables_in(field: FieldInfo) -> list[type[Table]]:
    """Return the classes of tables that a key can have as its value."""
    classes = (part for part in type_parts(field.annotation) if isinstance(part, type))
    return list(dict.fromkeys(cls for cls in classes if issubclass(cls, Table)))


def kind_of(table: type[Table]) -> str | None:
    """Return the value of the key `kind` in tables of a class; None if the class has no key `kind`."""
    field = table.model_fields.get("kind")
    return None if field is None else str(choices(field)[0])


def summary(table: type[Table]) -> str:
    """Return the first phrase of the docstring of a table class, which says what the table describes."""
    text = " ".join((table.__doc__ or "").split())
    text = text[:1].lower() + text[1:]
    for end in (":", ";", ".", ", see"):
        text = text.partition(end)[0]
    return text


def _is_active(field: FieldInfo) -> bool:
    """Return whether a new case contains a key without a comment sign."""
    return field.is_required() or declared(field, "start") is not None


# --- text of a new case -----------------------------------------------------------------------------------------


@cache
def case_template(case: type[Table]) -> str:
    """Return the text of a new case.

    The returned text is a valid case. If the comment signs before a table and before its keys are removed, the text is
    still a valid case.
    """
    keys = keys_of(case)
    rows = [_row(name, field, True) for name, field in keys.items() if not tables_in(field)]
    blocks = [_HEAD, "".join(rows)]
    written: list[type[Table]] = []
    for name, field in keys.items():
        blocks += _table_blocks(name, field, written)
    return "\n".join(blocks)


@cache
def table_to_paste(case: type[Table], name: str) -> str:
    """Return the text of a required table with example values, so that the user can paste it into a case.

    If the key `name` is not a required table, the function returns "".
    """
    field = keys_of(case)[name]
    tables = tables_in(field)
    if not tables or not field.is_required():
        return ""
    pairs = []
    for key, key_field in keys_of(tables[0]).items():
        if _is_active(key_field):
            pairs.append(_pair(key, example(key_field)))
    return "\n".join([f"[{name}]", *pairs])


def _table_blocks(name: str, field: FieldInfo, written: list[type[Table]]) -> Iterator[str]:
    """Yield the text of a table: one block for each kind of the table, followed by the blocks of the tables inside it.

    Parameters
    ----------
    name : dotted key of the table.
    field : declaration of the key `name`.
    written : table classes that have already been written under another key. Their optional keys are not written again.
        The function adds the classes of the table to `written`.
    """
    tables = tables_in(field)  # one class for each kind
    # keys and meanings in the blocks of earlier kinds
    explained: set[tuple[str, str | None]] = set()
    for number, table in enumerate(tables):
        is_repeated = table in written
        is_active = _is_active_block(field, number) and not is_repeated
        heading = (field.description or "") if number == 0 else ""
        rows = [_line(f"[{name}]", heading, is_active)]
        for key, inner in keys_of(table).items():
            if _has_own_block(inner):
                continue
            is_explained = is_repeated or (key, inner.description) in explained
            if inner.is_required() or not is_explained:
                meaning = summary(table) if key == "kind" else inner.description
                rows.append(_row(key, inner, is_active, meaning))
        yield "".join(rows)
        explained |= {(key, inner.description) for key, inner in keys_of(table).items()}
    if tables and tables[0] not in written:
        # the blocks of the tables inside this table; each block is written once for all kinds
        inner_keys: dict[str, FieldInfo] = {}
        for table in tables:
            inner_keys |= keys_of(table)
        for key, inner in inner_keys.items():
            if _has_own_block(inner):
                yield from _table_blocks(f"{name}.{key}", inner, written)
    written += tables


def _is_active_block(field: FieldInfo, number: int) -> bool:
    """Return whether a block of a table is written without comment signs.

    A block is active if it describes the first kind of a required table. If the table has only one kind, its block is
    also active if any of its keys is active.

    Parameters
    ----------
    field : declaration of the key of the table.
    number : index of the kind that the block describes, counted from 0.
    """
    tables = tables_in(field)  # one class for each kind
    is_first_of_required = number == 0 and field.is_required()
    has_active_keys = any(_is_active(key_field) for key_field in keys_of(tables[number]).values())
    return is_first_of_required or (len(tables) == 1 and has_active_keys)


def _has_own_block(field: FieldInfo) -> bool:
    """Return whether a table is written as a separate block, [name], and not as an inline table in a single line."""
    return bool(tables_in(field)) and not field.examples


def _row(name: str, field: FieldInfo, is_active: bool, meaning: str | None = None) -> str:
    """Return the line of a key, with an example value and a comment that explains the key.

    Parameters
    ----------
    name : name of the key.
    field : declaration of the key.
    is_active : whether the table of the key is written without comment signs.
    meaning : explanation of the key; by default, the explanation in the declaration of the key.
    """
    value = example(field)
    comment = (meaning or field.description or "").replace("`", "")
    instead = declared(field, "instead")
    if instead:
        comment = f"in place of {instead}: {comment}"
    if name != "kind":
        others = ", ".join(as_toml(choice) for choice in choices(field) if choice != value)
        if others:
            is_list = isinstance(value, list | tuple)
            comment += f"; of {others}" if is_list else f"; or {others}"
    text = _pair(name, value)
    # keys that are only needed under a condition are indented
    is_conditional = bool(instead or declared(field, "needed"))
    if is_conditional and not _is_active(field):
        text = f"  {text}"
    return _line(text, comment, is_active and _is_active(field))


def _line(text: str, comment: str, is_active: bool) -> str:
    """Return a line with a comment to the right of the text; a long comment continues on further lines."""
    if not is_active:
        text = f"# {text}"
    comments = [f"# {line}\n" for line in textwrap.wrap(comment, _LINE_WIDTH - _VALUE_WIDTH - 2)]
    if comments and len(text) < _VALUE_WIDTH:
        first = f"{text:<{_VALUE_WIDTH}}{comments.pop(0)}"
    else:
        first = f"{text}\n"
    indent = " " * _VALUE_WIDTH
    return first + "".join(indent + line for line in comments)
