"""Faults in a case, one line for each: the key with its line in the file, what was given, what is expected.

They are those that pydantic finds, and errors of arguments, which name keys of the case in place of the arguments.
"""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from importlib.resources import files
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from ..base import InputError, InputErrors, shortened, shown
from ..base.errors import MISSING

_UNKNOWN, _NOTHING, _MEANT = "an unknown key", "nothing", "; perhaps meant: "
#: Longest key of a user in a message, in characters.
_LONGEST_KEY = 40
#: Longest message about keys together; of a longer one the end is left out, such as that of a list of what is expected.
_LONGEST_FAULT = 400
#: Fields of a case that are no keys of its file.
INTERNAL = ("folder", "fluid_warnings", "solid_warnings")
#: Keys that are gone, and what does now what they did.
_IN_WHOLE_FACE = "none: removed; pieces lie in the contact of the whole face, each at its own pressure"
_BY_BAND = "none: removed; seals are drawn until the band of error has no more from their number"
_PIECES = "none: removed; seals are drawn from all pieces of the face, see [cells]"
REMOVED = {
    "load.interpolate": "none: removed; every load is solved, so give fewer loads where the leakage changes little",
    "cells.flow": "none: removed; the flow of a face is always at full resolution",
    "cells.contact": "none: removed; the contact is always that of the whole face",
    "flow.discretisation": "none: removed; the flow of a grid always takes the gap at the midpoints of edges",
    "stochastic.pressure": _IN_WHOLE_FACE,
    "stochastic.sampler": "none: removed; each tile of the seal draws a piece, in its row where that is known",
    "stochastic.library": "none: removed; the states of a face are kept with the run",
    "stochastic.library_cells": _PIECES,
    "stochastic.width": _BY_BAND,
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
}
#: A table, a key, and a value without quotes in a line of a case file.
_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
_KEY = re.compile(r"\s*([\w.-]+)\s*=")
_UNQUOTED = re.compile(r"\s*([\w.-]+)\s*=\s*([-+]?[\d.][^\"'#\[\]{}]*?)\s*(?:#.*)?$")
#: Arguments of `topography` by their key in a case.
SURFACE_KEYS = {
    "shortest_wave": "surface.shortest_wave",
    "max_share": "surface.max_undefined",
    "continue_spectrum": "surface.continue_spectrum",
    "shape": "surface.points",
    "spikes": "surface.spikes",
    "order": "surface.detrend",
}
FACE_KEYS = {"shape": "points", "height_unit": "height_unit"}
#: Tables of the arguments of seals and their tiles.
SEAL_TABLES = dict.fromkeys(
    ("path", "unit", "inlet", "outlet", "lay", "centre", "inner_radius", "outer_radius", "field"), "seal"
) | dict.fromkeys(("length", "breadth"), "stochastic")
#: Tables of the arguments of a scene and of how it is solved.
SCENE_TABLES = {
    "fluid_pressure": "contact",
    "inlet_pressure": "fluid",
    "places": "face",
}
#: Tables of the arguments of maps of the pressure.
MAP_TABLES = {"map": "load"} | dict.fromkeys(
    ("fractions", "positions", "angles", "path", "name", "length_unit", "pressure_unit", "points", "pressure", "field"),
    "load.map",
)


def fault(what: str, given: object, expected: str) -> PydanticCustomError:
    """Fault of a case that involves several keys, for validators to raise."""
    context = {"what": what, "given": shortened(given), "expected": expected}
    return PydanticCustomError("input", "{what}: given {given}, expected {expected}", context)


def refusal(expected: str) -> PydanticCustomError:
    """Fault of the value of one key, for validators to raise."""
    return PydanticCustomError("refusal", "{expected}", {"expected": expected})


@contextmanager
def faults_of(table: str = "") -> Iterator[None]:
    """Errors of what is called inside as faults of a table, of which they name the key; "" if they name it in full."""
    try:
        yield
    except InputError as error:
        raise fault(f"{table}.{error.what}".lstrip("."), error.given, error.expected) from None


def case_faults(case: type[BaseModel], error: ValidationError) -> list[InputError]:
    """The faults in a case that was given to the model."""
    # pydantic also reports a list with faulty items as too short
    faults = [dict(e) for e in error.errors() if e["type"] != "too_short" or not e["input"]]
    found = {str(one): one for one in (_fault(case, each) for each in faults)}.values()
    # a key that is written wrong is not missing too
    unknown = (one for one in found if one.given == _UNKNOWN)
    meant = {".".join([*one.what.split(".")[:-1], one.expected.rpartition(_MEANT)[2]]) for one in unknown}
    return [one for one in found if one.given != _NOTHING or one.what not in meant]


def _fault(case: type[BaseModel], error: dict[str, Any]) -> InputError:
    """The fault that pydantic found, with its key as in the file."""
    place, tables = _place(case, error["loc"])
    key = ".".join(place) or "case"
    kind, given = error["type"], error["input"]
    if kind == "extra_forbidden" and key in REMOVED:
        return InputError(key, shown(given), REMOVED[key])
    if kind == "extra_forbidden":
        known = [name for name in tables[0].model_fields if name not in INTERNAL]
        keys = ", ".join(known)
        if kinds := _other_kinds(case, place, tables[0]):
            return InputError(key, _UNKNOWN, f"{keys}; {place[-1]} is a key of kind {kinds}")
        near = _elsewhere(case, place[-1]) or get_close_matches(place[-1], known, 1)
        return InputError(key, _UNKNOWN, f"{keys}{_MEANT}{near[0]}" if near else keys)
    if kind == "missing":
        table = "" if len(place) > 1 else table_to_paste(key)
        if table:
            return InputError(key, MISSING, f"a table such as\n{table}")
        return InputError(key, _NOTHING, f"a value for this key{_such_as(key)}")
    if kind == "too_short":
        return InputError(key, shown(given), "a list of at least one")
    if kind.startswith("int_"):
        return InputError(key, shown(given), "a whole number")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        given = given.get("kind") if isinstance(given, dict) else given
        return InputError(f"{key}.kind", shown(given), f"one of {', '.join(map(repr, map(_kind, tables)))}")
    if kind in _IN_TOML:
        return InputError(key, shown(given), _IN_TOML[kind])
    if kind == "input":  # a fault between keys names them
        what, given, expected = (error["ctx"][name] for name in ("what", "given", "expected"))
        longest = _LONGEST_FAULT - len(what) - len(given)
        return InputError(what, given, expected if len(expected) <= longest else f"{expected[: longest - 1]}…")
    text = str(error["msg"]).removeprefix("Input should be ").removeprefix("Value error, ")
    if isinstance(given, (dict, BaseModel)):
        return InputError(key, "", text)
    return InputError(key, shown(given), text)


def table_to_paste(table: str) -> str:
    """A table of the template of cases without its comments, "" of one that it does not have."""
    found = re.search(rf"^\[{re.escape(table)}\].*(?:\n(?!\[).*)*", _template(), re.MULTILINE)
    lines = (re.sub(r"\s*#.*", "", line) for line in found[0].splitlines()) if found else ()
    return "\n".join(filter(None, lines))


def _template() -> str:
    return files(__package__).joinpath("template.toml").read_text(encoding="utf-8")


def _such_as(key: str) -> str:
    """The key with its value in the template of cases, "" of one that it does not have."""
    table, name = key.partition(".")[0], key.rpartition(".")[2]
    blocks = re.findall(rf"^(?:# )?\[{re.escape(table)}\](?:.*\n(?!(?:# )?\[\w))*", _template(), re.MULTILINE)
    found = re.search(rf"\b({re.escape(name)} = (?:\"[^\"]*\"|\[[^\]]*\]|[^\s,}}]+))", "\n".join(blocks))
    return f", such as {found[1]}" if found else ""


def _place(case: type[BaseModel], loc: tuple[Any, ...]) -> tuple[list[str], list[Any]]:
    """Key of a fault as it is in the file, and the table that holds it, or the tables that its value may be."""
    place: list[str] = []
    inside: list[Any] = [case]
    for part in loc:
        if isinstance(part, str) and part in map(_kind, inside):  # this part of the key is not in the file
            inside = [table for table in inside if _kind(table) == part]
            continue
        place.append(shortened(part, _LONGEST_KEY))
        if isinstance(part, str) and part in inside[0].model_fields:
            inside = _tables(inside[0].model_fields[part].annotation) or inside
    return place, inside


def _elsewhere(case: type[BaseModel], key: str) -> list[str]:
    """The key with each table of a case that has it."""
    tables = {name: _tables(field.annotation) for name, field in case.model_fields.items() if name not in INTERNAL}
    return [f"{key} in [{name}]" for name, kinds in tables.items() if any(key in kind.model_fields for kind in kinds)]


def _other_kinds(case: type[BaseModel], place: list[str], table: Any) -> str:
    """The kinds besides that of a table which have the last key of a place, "" where none has."""
    field = case.model_fields.get(place[0])
    kinds = [] if field is None else _tables(field.annotation)
    found = [repr(_kind(kind)) for kind in kinds if table in kinds and place[-1] in kind.model_fields]
    return " or ".join(found)


def _tables(annotation: Any) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for inner in get_args(annotation) for table in _tables(inner)]


def _kind(table: Any) -> str | None:
    """Kind of a table that has one."""
    field = table.model_fields.get("kind")
    return None if field is None else get_args(field.annotation)[0]


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
    if (straight := re.sub("[“”„]", '"', written)) != written:
        return shortened(f"; perhaps meant: {straight.strip()}")
    if "overwrite" in message or (line := _UNQUOTED.match(written)) is None:  # a key that is there twice
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
    return found if line is None else InputError(found.what, found.given, f"{found.expected} (line {line})")


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


@contextmanager
def with_tables(tables: dict[str, str]) -> Iterator[None]:
    """Raise an InputError with the table of a case before the argument with which it begins."""
    try:
        yield
    except InputError as error:
        table = tables.get(re.split(r"\W", error.what, maxsplit=1)[0])
        raise (error if table is None else error.inside(table)) from None


@contextmanager
def with_keys(keys: dict[str, str], place: str = "") -> Iterator[None]:
    """Raise an InputError with keys instead of names of arguments, after the place of their table if that is given."""
    try:
        yield
    except InputError as error:
        # a name before "=" is that of another value which is proposed, numbers in brackets a list of the file
        expected = re.sub(r"\b(\w+)(?==)", lambda name: keys.get(name[1], name[1]), error.expected)
        expected = re.sub(r"=\((.*?)\)", r" = [\1]", expected)
        found = InputError(keys.get(error.what, error.what), error.given, expected)
        raise (found.inside(place) if place else found) from error
