"""Compute digests of plain data, of the content of files, and of code."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from .code import CodeDescription, NoDigest
from .plain_data import describe


def digest(value: Any) -> str:
    """Compute a digest of a value; different values have different digests.

    Parameters
    ----------
    value : plain data (see `femseal.store.plain_data`), file paths, user-defined functions, classes and objects, or
    tuples, lists and dictionaries of such values. A path is represented by the content of the file. A user-defined
    function, class or object is represented by a description of its code, see `femseal.store.code`.

    Returns
    -------
    The digest of 16 bytes as hexadecimal text.

    Raises
    ------
    NoDigest : a part of the value cannot be described, for example an object of a class written in C, or the path of an
    unreadable file.

    Examples
    --------
    >>> digest((1, 2.0)) == digest((1, 2.0)), digest(1) == digest(1.0)
    (True, False)
    """
    state = hashlib.blake2b(digest_size=16)
    size = 0
    describe_code = CodeDescription()

    def append(data: bytes) -> int:
        """Add bytes to the digest, and return the position of the first added byte."""
        nonlocal size
        start = size
        state.update(data)
        size += len(data)
        return start

    def substitute(part: Any) -> Any:
        """Describe a part of the value that is not plain data."""
        if isinstance(part, Path):
            return "file", _digest_of_file(part)
        return describe_code(part)

    try:
        description = describe(value, append, substitute)
    except RecursionError:
        raise NoDigest("an object that contains itself") from None
    state.update(json.dumps(description).encode())
    return state.hexdigest()


def _digest_of_file(path: Path) -> bytes:
    """Return the SHA-256 digest of the content of a file; raise NoDigest if the file cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise NoDigest(str(error)) from None
