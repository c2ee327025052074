"""Find the lines of keys in the text of a case file, and suggest corrections of invalid lines."""

import re
from collections import Counter
from collections.abc import Iterator

from ..base import InputError, InputErrors, shortened

#: Patterns of a line that begins a table, of a line with a key, and of a line whose value lacks quotes.
_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
_KEY = re.compile(r"\s*([\w.-]+)\s*=")
_UNQUOTED = re.compile(r"\s*([\w.-]+)\s*=\s*([-+]?[\d.][^\"'#\[\]{}]*?)\s*(?:#.*)?$")


def with_line_numbers(error: InputError, text: str) -> InputErrors:
    """Add line numbers to the errors of a case.

    An error gets the number of the line with its key or, if the key is missing in the file, of the line with its table.
    """
    line_of_key = dict(_lines_of_keys(text))
    errors = error.faults if isinstance(error, InputErrors) else (error,)
    return InputErrors([_with_line_number(fault, line_of_key) for fault in errors])


def _with_line_number(error: InputError, line_of_key: dict[str, int]) -> InputError:
    """Add a line number to an error: the line of the key or, if the key is not in the file, of the innermost table."""
    key = error.what
    while key not in line_of_key:
        key, dot, _name = key.rpartition(".")
        if not dot:
            return error
    return InputError(error.what, error.given, f"{error.expected} (line {line_of_key[key]})")


def _lines_of_keys(text: str) -> Iterator[tuple[str, int]]:
    """Yield the dotted names of all keys and tables of a TOML file with their line numbers.

    Tables in double brackets are numbered: the first table [[face]] is "face.0", the next one is "face.1". Keys inside
    an inline table (in braces) are not included; an error in such a key gets the line number of the inline table.
    """
    table = ""
    counts = Counter[str]()
    for number, line in enumerate(text.splitlines(), 1):
        header = _HEADER.match(line)
        key = _KEY.match(line)
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
    """Suggest a correction of the line in which tomllib found an error; return "" if no correction is likely.

    Common mistakes are missing quotes around a number with its unit, a decimal comma, and a number such as ".5".

    Parameters
    ----------
    text : text of the file.
    message : message of tomllib, which contains the number of the line.
    """
    position = re.search(r"at line (\d+)", message)
    is_repeated_key = "overwrite" in message
    if position is None or is_repeated_key:
        return ""
    line = _UNQUOTED.match(text.splitlines()[int(position[1]) - 1])
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
