"""Translate the errors that pydantic finds in a case into messages that name the keys of the case file.

pydantic describes the location of an error by a tuple such as ("face", 0, "turned", "pitch"). The parts of a location
are names of fields, positions in lists, and kinds of tables. The corresponding key in the file is "face.pitch", or
"face.0.pitch" if the case has two faces.
"""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from ..base import InputError, shortened, shown
from ..base.errors import MISSING
from .case import Case
from .faults import EXPECTED_TYPES, expected_value
from .table_types import Table
from .template import as_toml, example, keys_of, kind_of, table_to_paste, tables_in

#: Keys that were removed since the last release, and what to use instead.
REMOVED: dict[str, str] = {}
#: Largest length of a key of the user, and of an explanation [characters].
_LONGEST_KEY, _LONGEST_EXPLANATION = 40, 300


def explain(error: ValidationError, data: dict[str, Any]) -> list[InputError]:
    """Return an InputError for each error that pydantic has found; errors with the same message are listed once.

    Parameters
    ----------
    error : error raised by `Case.model_validate`, which lists all errors of the case.
    data : tables that were validated.
    """
    by_message: dict[str, InputError] = {}
    for details in error.errors():
        # if an item of a list is invalid, pydantic also reports that the list is too short
        if details["type"] == "too_short" and details["input"]:
            continue
        explained = _explain(dict(details), data)
        by_message.setdefault(str(explained), explained)
    return list(by_message.values())


def _explain(error: dict[str, Any], data: dict[str, Any]) -> InputError:
    """Return the InputError for one error of pydantic, see `explain`.

    error : description of the error, with the entries "loc", "type", "input" and "ctx" of pydantic.
    """
    path, tables = _locate(error["loc"])
    kind = error["type"]  # name of the type of error in pydantic
    given = error["input"]
    cause = error.get("ctx", {}).get("error")  # InputError that a validator of femseal has raised
    if isinstance(cause, InputError) and cause.what:
        path += cause.what.split(".")
    path = _as_in_file(path, data)
    key = ".".join(path) or "case"
    if isinstance(cause, InputError):
        return _explain_input_error(key, given, cause)
    if kind == "missing":
        return _explain_missing(path, tables[0])
    if kind == "extra_forbidden":  # a key that the table does not have
        if key in REMOVED:
            return InputError(key, shown(given), f"none: removed; {REMOVED[key]}")
        return InputError(key, "an unknown key", _known_keys(path, tables[0]))
    if kind.startswith("union_tag"):  # a missing or unknown value of the key `kind`
        chosen = given.get("kind") if isinstance(given, dict) else given
        kinds = ", ".join(repr(kind_of(table)) for table in tables)
        return InputError(f"{key}.kind", shown(chosen), f"one of {kinds}")
    # the message does not repeat a whole table
    is_table = isinstance(given, (dict, Table)) and kind not in EXPECTED_TYPES
    return InputError(key, "" if is_table else shown(given), expected_value(error))


def _explain_input_error(key: str, value: Any, cause: InputError) -> InputError:
    """Return the error of a validator of femseal, with the key in the file.

    Parameters
    ----------
    key : key in the file.
    value : value that was validated.
    cause : error that the validator has raised.
    """
    if cause.what:
        # such an error may have been raised by any function of the package, and may have a long explanation
        return InputError(key, cause.given, shortened(cause.expected, _LONGEST_EXPLANATION))
    given = cause.given
    is_given_empty = isinstance(given, str) and not given
    if is_given_empty and not isinstance(value, (dict, Table)):
        # the message shows the value, unless it is a whole table
        given = shown(value)
    return InputError(key, given, cause.expected)


def _explain_missing(path: list[str], table: type[Table]) -> InputError:
    """Return the error for a missing key or table, with an example that the user can paste into the case."""
    key = ".".join(path)
    name = path[-1]
    text = table_to_paste(Case, key) if len(path) == 1 else ""
    if text:
        return InputError(key, MISSING, f"a table such as\n{text}")
    expected = "a value for this key"
    if name in table.model_fields:
        value = example(table.model_fields[name])
        if value != "":
            expected += f", such as {name} = {as_toml(value)}"
    return InputError(key, "nothing", expected)


def _known_keys(path: list[str], table: type[Table]) -> str:
    """List the keys of a table, and suggest which key the user may have meant.

    The suggestion is a key of another kind of the same table, a key of another table, or a key with a similar name.
    """
    name = path[-1]
    known = list(keys_of(table))
    names = ", ".join(known)
    top_level = keys_of(Case)
    tables_of_all_kinds = tables_in(top_level[path[0]]) if path[0] in top_level else []
    if table in tables_of_all_kinds:
        kinds = [
            repr(kind_of(other)) for other in tables_of_all_kinds if name in other.model_fields
        ]
        if kinds:
            return f"{names}; {name} is a key of kind {' or '.join(kinds)}"
    for table_name, field in top_level.items():
        if any(name in other.model_fields for other in tables_in(field)):
            return f"{names}; perhaps meant: {name} in [{table_name}]"
    similar = get_close_matches(name, known, 1)
    return f"{names}; perhaps meant: {similar[0]}" if similar else names


def _locate(location: tuple[Any, ...]) -> tuple[list[str], list[type[Table]]]:
    """Find the key and the table of an error from its location.

    Parameters
    ----------
    location : location of the error in pydantic: names of fields, positions in lists, and kinds of tables.

    Returns
    -------
    path : parts of the dotted key. Kinds of tables are left out, because a kind is not a part of the key.
    tables : list with the class of the table that contains the key. If the value of the key is a table itself, the list
        contains the classes of all kinds of the inner table.
    """
    path: list[str] = []
    tables: list[type[Table]] = [Case]
    for part in location:
        tables_of_kind = [table for table in tables if kind_of(table) == part]
        if tables_of_kind:
            # this part of the location is not a key but the kind of the table
            tables = tables_of_kind
            continue
        path.append(shortened(part, _LONGEST_KEY))
        fields = tables[0].model_fields
        if isinstance(part, str) and part in fields:
            tables = tables_in(fields[part]) or tables
    return path, tables


def _as_in_file(path: list[str], data: Any) -> list[str]:
    """Remove the position 0 from a dotted key if the case file contains a single table instead of a list of tables.

    A case file can contain a single table [face], or several tables [[face]]. pydantic always treats the value of the
    key `face` as a list of tables, and includes the position in the list in the location of an error.

    path : parts of the dotted key, with positions.
    data : tables of the case file.
    """
    result = []
    value = data
    for part in path:
        if isinstance(value, dict) and part.isdecimal() and part not in value:
            continue  # the value is a table and not a list
        result.append(part)
        if isinstance(value, dict):
            value = value.get(part)
        elif isinstance(value, (list, tuple)) and part.isdecimal() and int(part) < len(value):
            value = value[int(part)]
        else:
            value = None
    return result
