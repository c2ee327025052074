"""Read and validate a case file."""

from __future__ import annotations

import tomllib
from os import PathLike
from os.path import abspath
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..base import InputError, InputErrors, shortened
from .case import Case
from .explanations import explain
from .faults import INTERNAL
from .lines import likely_meaning, with_line_numbers

#: Largest size of a case file [byte].
_LARGEST_FILE = 1_000_000


def load_case(path: str | PathLike[str]) -> Case:
    """Read and validate a case file.

    Parameters
    ----------
    path : str or path
        A TOML file. Paths in the file are relative to the folder of the file.

    Returns
    -------
    Case
        Validated case, with values in SI units.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, or has invalid keys or values. The message has a line for each error, with
        the key, its line in the file, its value and the expected values.

    Examples
    --------
    >>> case = load_case("seal.toml")  # doctest: +SKIP
    >>> case.method, case.seed  # doctest: +SKIP
    """
    data, folder = read_case(path)
    try:
        return parse_case(data, folder)
    except InputError as error:
        text = Path(path).read_text(encoding="utf-8-sig")
        raise with_line_numbers(error, text) from None


def read_case(path: str | PathLike[str]) -> tuple[dict[str, Any], Path]:
    """Read a case file without validating it.

    Parameters
    ----------
    path : str or path
        A TOML file.

    Returns
    -------
    dict, Path
        Tables of the case before validation, and folder of the file.

    Raises
    ------
    InputError
        The file cannot be read, or is not TOML.
    """
    path = Path(path)
    try:
        # a pipe or a device may have no end
        if path.exists() and not path.is_file():
            raise InputError("case", f"'{path}', which is not a file", "a TOML file")
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
    except OSError as error:
        expected = f"a file that can be read ({error.strerror}: {shortened(abspath(path))})"
        raise InputError("case", f"'{path}'", expected) from None
    if len(content) > _LARGEST_FILE:
        given = f"'{path}' of more than {_LARGEST_FILE:.0e} bytes"
        raise InputError("case", given, "a TOML file of a case")
    try:
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
        return tomllib.loads(text), path.parent
    # tomllib also raises a ValueError for a number of thousands of digits
    except (ValueError, RecursionError) as error:
        hint = likely_meaning(content.decode("utf-8-sig", "replace"), str(error))
        expected = f"a TOML file in UTF-8 ({shortened(error, 120)}){hint}"
        raise InputError("case", f"'{path}', which is not TOML", expected) from None


def parse_case(data: dict[str, Any], folder: Path = Path()) -> Case:
    """Validate the tables of a case.

    Parameters
    ----------
    data : dict
        Tables of the case, as `read_case` returns them.
    folder : Path
        Folder to which paths in the case are relative.

    Returns
    -------
    Case
        Validated case, with values in SI units.

    Raises
    ------
    InputError
        The case has invalid keys or values. The message has a line for each error.
    """
    for name in INTERNAL:
        if name in data:
            raise InputError(name, "a value", "no such key")
    try:
        return Case.model_validate({**data, "folder": folder})
    except RecursionError:
        given, expected = "lists or tables too deep in each other", "the tables of a case"
        raise InputError("case", given, expected) from None
    except ValidationError as error:
        raise InputErrors(explain(error, data)) from None
