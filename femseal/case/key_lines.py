"""Lines of a case file, for messages about its keys."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator

from ..base.errors import InputError, InputErrors

_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
_KEY = re.compile(r"\s*([\w.-]+)\s*=")
_UNQUOTED = re.compile(r"\s*([\w.-]+)\s*=\s*([-+]?[\d.][^\"'#\[\]{}]*?)\s*(?:#.*)?$")


def with_lines(error: InputError, text: str) -> InputErrors:
    """The faults of a case, each with the line of the text where its key or its table is, if it is there."""
    lines = dict(_lines(text))
    return InputErrors([_with_line(found, lines) for found in getattr(error, "faults", (error,))])


def meant_in(text: str, message: str) -> str:
    """How the line that a message of the parser names may have been meant: a decimal point, or quotes around a unit."""
    at = re.search(r"at line (\d+)", message)
    if at is None or (line := _UNQUOTED.match(text.splitlines()[int(at[1]) - 1])) is None:
        return ""
    key, value = line.groups()
    plain = re.fullmatch(r"([-+]?\d+),(\d+)", value)
    return f"; perhaps meant: {key} = " + (f"{plain[1]}.{plain[2]}" if plain else f'"{value}"')


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
