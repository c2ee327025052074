"""Lines of a case file: find the lines of keys, and guess what an invalid line was meant to say."""

import re
from collections import Counter
from collections.abc import Iterator

from ..base import InputError, InputErrors, shortened

#: A line that begins a table, a line with a key, and a line whose value has no quotes.
_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
_KEY = re.compile(r"\s*([\w.-]+)\s*=")
_UNQUOTED = re.compile(r"\s*([\w.-]+)\s*=\s*([-+]?[\d.][^\"'#\[\]{}]*?)\s*(?:#.*)?$")


def with_line_numbers(error: InputError, text: str) -> InputErrors:
    """Add to each error of a case the line of its key, or of its table, in the text of the file."""
    lines = dict(_lines_of_keys(text))
    errors = error.faults if isinstance(error, InputErrors) else (error,)
    return InputErrors([_with_line_number(single, lines) for single in errors])


def _with_line_number(error: InputError, lines: dict[str, int]) -> InputError:
    key = error.what
    while key not in lines:
        key, dot, _ = key.rpartition(".")  # the table of the key
        if not dot:
            return error
    return InputError(error.what, error.given, f"{error.expected} (line {lines[key]})")


def _lines_of_keys(text: str) -> Iterator[tuple[str, int]]:
    """Yield dotted keys and tables of a TOML file with their line numbers.

    The first of several tables [[face]] is "face", the next ones are "face.1", "face.2" and so on. Keys inside brackets
    and braces have the line of the key before the bracket.
    """
    table = ""
    counts = Counter[str]()
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header is not None:
            brackets, table = header.groups()
            if brackets == "[[":
                name = table
                table = f"{name}.{counts[name]}"
                counts[name] += 1
            yield table, number
        elif key is not None:
            yield f"{table}.{key[1]}".lstrip("."), number


def likely_meaning(text: str, message: str) -> str:
    """Return a hint about the line in which tomllib found an error, "" without one.

    A value without quotes may lack the quotes around number and unit, or have a decimal comma.
    """
    place = re.search(r"at line (\d+)", message)
    is_repeated_key = "overwrite" in message
    if place is None or is_repeated_key:
        return ""
    line = _UNQUOTED.match(text.splitlines()[int(place[1]) - 1])
    if line is None:
        return ""
    key, value = line.groups()
    number = re.fullmatch(r"([-+]?)(\d*)[.,](\d+)", value)
    if number is None:
        meant = f'"{value}"'
    else:
        sign, whole, decimals = number.groups()
        meant = f"{sign}{whole or 0}.{decimals}"
    return shortened(f"; perhaps meant: {key} = {meant}")
