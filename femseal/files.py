"""Files that are either complete or not there."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError


def made_folder(folder: str | os.PathLike[str]) -> Path:
    """The folder, made with its parents if it is not there.

    Raises
    ------
    InputError : it is a file, or cannot be made.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError.of("output folder", f"{path} ({reason})", "a folder that can be written") from None
    return path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path of the same suffix in the same folder, which takes the place of `path` once complete.

    After an exception the temporary file is removed and an older `path` is as it was.
    """
    handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=".unfinished-", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> Path:
    """Write a text file in UTF-8; returns its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
    return path
