"""Faults that pydantic finds in a case, one line for each: the key, what was given, what is expected."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from importlib.resources import files
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from ..base.errors import MISSING, InputError, shortened, shown

_UNKNOWN, _NOTHING, _MEANT = "an unknown key", "nothing", "; perhaps meant: "
#: Longest key of a user in a message, in characters.
_LONGEST_KEY = 40
#: Longest message about keys together; of a longer one the end is left out, such as that of a list of what is expected.
_LONGEST_FAULT = 400
#: Fields of a case that are no keys of its file.
INTERNAL = ("folder", "fluid_warnings", "solid_warnings")
#: What took the place of keys that are gone.
_REPLACED = {"stochastic.profile": 'map = { kind = "profile", fractions = [...] } in the table load, in its place'}
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
    meant = {_sibling(one.what, one.expected.rpartition(_MEANT)[2]) for one in found if one.given == _UNKNOWN}
    return [one for one in found if one.given != _NOTHING or one.what not in meant]


def _fault(case: type[BaseModel], error: dict[str, Any]) -> InputError:
    """The fault that pydantic found, with its key as in the file."""
    place, tables = _place(case, error["loc"])
    key = ".".join(place) or "case"
    kind, given = error["type"], error["input"]
    if kind == "extra_forbidden" and key in _REPLACED:
        return InputError(key, shown(given), _REPLACED[key])
    if kind == "extra_forbidden":
        known = [name for name in tables[0].model_fields if name not in INTERNAL]
        keys = ", ".join(known)
        near = get_close_matches(place[-1], known, 1)
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


def _sibling(key: str, name: str) -> str:
    """Another key of the same table."""
    return ".".join([*key.split(".")[:-1], name])


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


def _tables(annotation: Any) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for inner in get_args(annotation) for table in _tables(inner)]


def _kind(table: Any) -> str | None:
    """Kind of a table that has one."""
    field = table.model_fields.get("kind")
    return None if field is None else get_args(field.annotation)[0]
