"""Reading a case file, and the faults found in it: one line for each, the key with its line, given and expected."""

import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from difflib import get_close_matches
from os import PathLike
from os.path import abspath
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..base import InputError, InputErrors, shortened, shown
from ..base.errors import MISSING
from .case import Case
from .faults import INTERNAL
from .template import as_toml, example, keys_of, kind_of, table_to_paste, tables_in
from .values import Table

#: No case is larger [byte].
_LARGEST_FILE = 1_000_000
#: Longest key of a user in a message, in characters.
_LONGEST_KEY = 40
#: Keys that are gone, and what does now what they did.
REMOVED = {
    "load.interpolate": "none: removed; every load is solved, so give fewer loads where the leakage changes little",
    "cells.flow": "none: removed; the flow of a face is always at full resolution",
    "cells.contact": "none: removed; the contact is always that of the whole face",
    "flow.discretisation": "none: removed; the flow of a grid always takes the gap at the midpoints of edges",
    "stochastic.pressure": "none: removed; pieces lie in the contact of the whole face, each at its own pressure",
    "stochastic.sampler": "none: removed; each tile of the seal draws a piece, in its row where that is known",
    "stochastic.library": "none: removed; the states of a face are kept with the run",
    "stochastic.library_cells": "none: removed; seals are drawn from all pieces of the face, see [cells]",
    "stochastic.width": "none: removed; seals are drawn until the band of error has no more from their number",
    "stochastic.bounds": "none: removed; the band of error stands beside the leakage, see output.budget",
    "surface.filter_sensitivity": 'none: removed; the row "filter" of the budget says what the filter may change',
    "stochastic.profile": 'map = { kind = "profile", fractions = [...] } in the table load, in its place',
}
#: What pydantic expects of a value of another type, as a user of TOML says it.
_IN_TOML = {
    "tuple_type": "a list in square brackets",
    "list_type": "a list in square brackets",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
    "string_type": "text in quotes",
    "path_type": "text in quotes",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "too_short": "a list of at least one",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
}
#: A table, a key, and a value without quotes in a line of a case file.
_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
_KEY = re.compile(r"\s*([\w.-]+)\s*=")
_UNQUOTED = re.compile(r"\s*([\w.-]+)\s*=\s*([-+]?[\d.][^\"'#\[\]{}]*?)\s*(?:#.*)?$")


def case_faults(error: ValidationError) -> list[InputError]:
    """The faults in a case that was given to the model."""
    # pydantic also reports a list with faulty items as too short
    faults = [dict(e) for e in error.errors() if e["type"] != "too_short" or not e["input"]]
    return list({str(one): one for one in (_fault(each) for each in faults)}.values())


def _fault(error: dict[str, Any]) -> InputError:
    """The fault that pydantic found, with its key as in the file."""
    place, tables = _place(error["loc"])
    key, kind, given = ".".join(place) or "case", error["type"], error["input"]
    if kind == "input":  # a fault between keys names them
        return InputError(*(error["ctx"][name] for name in ("what", "given", "expected")))
    if kind == "missing":
        return _missing(place, tables[0])
    if kind == "extra_forbidden":
        if key in REMOVED:
            return InputError(key, shown(given), REMOVED[key])
        return InputError(key, "an unknown key", _known(place, tables[0]))
    if kind.startswith("union_tag"):
        given = given.get("kind") if isinstance(given, dict) else given
        expected = f"one of {', '.join(repr(kind_of(table)) for table in tables)}"
        return InputError(f"{key}.kind", shown(given), expected)
    text = str(error["msg"]).removeprefix("Input should be ").removeprefix("Value error, ")
    shown_given = "" if kind not in _IN_TOML and isinstance(given, (dict, Table)) else shown(given)
    return InputError(key, shown_given, _IN_TOML.get(kind, text))


def _missing(place: list[str], table: type[Table]) -> InputError:
    """The fault of a key or a table that is not there, with one to paste."""
    key = ".".join(place)
    if len(place) == 1 and (text := table_to_paste(Case, key)):
        return InputError(key, MISSING, f"a table such as\n{text}")
    field = table.model_fields.get(place[-1])
    value = "" if field is None else example(field)
    such = f", such as {place[-1]} = {as_toml(value)}" if value != "" else ""
    return InputError(key, "nothing", f"a value for this key{such}")


def _known(place: list[str], table: type[Table]) -> str:
    """The keys of a table, and what an unknown one may have meant."""
    key, known = place[-1], list(keys_of(table))
    keys = ", ".join(known)
    fields = keys_of(Case)
    others = tables_in(fields[place[0]]) if place[0] in fields else []
    others = [one for one in others if table in others and key in one.model_fields]
    if others:
        kinds = " or ".join(repr(kind_of(one)) for one in others)
        return f"{keys}; {key} is a key of kind {kinds}"
    near = [
        f"{key} in [{name}]"
        for name, field in fields.items()
        if any(key in one.model_fields for one in tables_in(field))
    ]
    near += get_close_matches(key, known, 1)
    return f"{keys}; perhaps meant: {near[0]}" if near else keys


def _place(loc: tuple[Any, ...]) -> tuple[list[str], list[type[Table]]]:
    """Key of a fault as it is in the file, and the table that holds it, or the tables that its value may be."""
    place: list[str] = []
    inside: list[type[Table]] = [Case]
    for part in loc:
        if chosen := [table for table in inside if kind_of(table) == part]:
            inside = chosen  # this part of the key is not in the file
            continue
        place.append(shortened(part, _LONGEST_KEY))
        if isinstance(part, str) and part in inside[0].model_fields:
            inside = tables_in(inside[0].model_fields[part]) or inside
    return place, inside


def with_lines(error: InputError, text: str) -> InputErrors:
    """The faults of a case, each with the line of the text where its key or its table is, if it is there."""
    lines = dict(_lines(text))
    return InputErrors([_with_line(found, lines) for found in getattr(error, "faults", (error,))])


def meant_in(text: str, message: str) -> str:
    """How the line that a message of the parser names may have been meant: a decimal point, or quotes around a unit."""
    at = re.search(r"at line (\d+)", message)
    if at is None:
        return ""
    written = text.splitlines()[int(at[1]) - 1]
    if (
        "overwrite" in message or (line := _UNQUOTED.match(written)) is None
    ):  # a key that is there twice
        return ""
    key, value = line.groups()
    plain = re.fullmatch(r"([-+]?)(\d*)[.,](\d+)", value)
    meant = f"{plain[1]}{plain[2] or 0}.{plain[3]}" if plain else f'"{value}"'
    return shortened(f"; perhaps meant: {key} = {meant}")


def _with_line(found: InputError, lines: dict[str, int]) -> InputError:
    """A fault with its line: that of the key, or of the table around it."""
    parts = found.what.split(".")
    names = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    line = next((lines[name] for name in names if name in lines), None)
    return (
        found
        if line is None
        else InputError(found.what, found.given, f"{found.expected} (line {line})")
    )


def _lines(text: str) -> Iterator[tuple[str, int]]:
    """Dotted keys and tables of a TOML file with their lines; tables of a list by their number, the first also without.

    Keys inside brackets and braces count to the key before the bracket.
    """
    table, counts = "", Counter[str]()
    for number, line in enumerate(text.splitlines(), 1):
        if (header := _HEADER.match(line)) is not None:
            table = header[2]
            if header[1] == "[[":
                table, counts[header[2]] = f"{header[2]}.{counts[header[2]]}", counts[header[2]] + 1
            yield f"{table}", number
        elif (key := _KEY.match(line)) is not None:
            yield f"{table}.{key[1]}".lstrip("."), number


def load_case(path: str | PathLike[str]) -> Case:
    """Read and validate a case file.

    Parameters
    ----------
    path : a TOML file; paths in it are relative to its folder.

    Raises
    ------
    InputError : the file is missing or is not TOML, or any of its values cannot be used; one line for each fault.

    Examples
    --------
    >>> case = load_case("seal.toml")  # doctest: +SKIP
    >>> case.method, case.seed  # doctest: +SKIP
    """
    data, folder = read_case(path)
    try:
        return parse_case(data, folder)
    except InputError as error:
        raise with_lines(error, Path(path).read_text(encoding="utf-8-sig")) from None


def read_case(path: str | PathLike[str]) -> tuple[dict[str, Any], Path]:
    """Tables of a case file, not yet validated, and its folder.

    Raises InputError: the file is missing or is not TOML.
    """
    path = Path(path)
    try:
        # a pipe or a device may have no end
        if path.exists() and not path.is_file():
            raise InputError("case", f"'{path}', which is no file", "a TOML file")
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
    except OSError as error:
        expected = f"a file that can be read ({error.strerror}: {shortened(abspath(path))})"
        raise InputError("case", f"'{path}'", expected) from None
    if len(content) > _LARGEST_FILE:
        given = f"'{path}' of more than {_LARGEST_FILE:.0e} bytes"
        raise InputError("case", given, "a TOML file of a case")
    try:
        return tomllib.loads(content.decode("utf-8-sig").replace("\r\n", "\n")), path.parent
    except (ValueError, RecursionError) as error:  # also of a number with thousands of digits
        meant = meant_in(content.decode("utf-8-sig", "replace"), str(error))
        expected = f"a TOML file in UTF-8 ({shortened(error, 120)}){meant}"
        raise InputError("case", f"'{path}', which is not TOML", expected) from None


def parse_case(data: dict[str, Any], folder: Path = Path()) -> Case:
    """Validate a case given as a dictionary; paths in it are relative to `folder`.

    Raises InputError: one line for each fault.
    """
    for name in INTERNAL:
        if name in data:
            raise InputError(name, "a value", "no such key")
    try:
        return Case.model_validate({**data, "folder": folder})
    except RecursionError:
        raise InputError(
            "case", "lists or tables too deep in each other", "the tables of a case"
        ) from None
    except ValidationError as error:
        raise InputErrors([_named(found, data) for found in case_faults(error)]) from None


def _named(found: InputError, data: dict[str, Any]) -> InputError:
    """A fault by the key of the file, where a single table of several possible ones has no number."""
    what = found.what
    if isinstance(data.get("face"), dict) and what.startswith("face.0"):
        what = what.replace("face.0", "face", 1)
    if isinstance(data.get("load"), dict) and isinstance(data["load"].get("map"), dict):
        what = what.replace("load.map.0", "load.map", 1)
    return InputError(what, found.given, found.expected)
