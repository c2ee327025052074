"""Files that are either complete or not there."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import InputError


def made_folder(folder: str | os.PathLike[str]) -> Path:
    """Make a folder with its parents unless it exists; return its path.

    Raises InputError: the path is a file, or the folder cannot be made.
    """
    path = Path(folder)
    with writing("output folder", path, "a folder"):
        path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def opened_plain(path: Path) -> Iterator[BinaryIO]:
    """Context with a file to be read; links, pipes and devices are not opened, or not read.

    Raises OSError: there is no such file, or it is no plain file.
    """
    if path.is_symlink():
        raise OSError(f"'{path}' is a link")
    # a pipe that is opened in the usual way waits for a writer
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with open(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise OSError(f"'{path}' is no file")
        yield file


def read_plain(path: Path, largest: float) -> bytes:
    """Content of a file of at most so many bytes, see `opened_plain`.

    Raises OSError: there is no such file, it is no plain file, or it is larger.
    """
    with opened_plain(path) as file:
        if (size := os.fstat(file.fileno()).st_size) > largest:
            raise OSError(f"'{path}' has {size / 1e9:.3g} GB, more than such a file has")
        return file.read()


def remove_foreign(path: Path) -> None:
    """Remove what stands in the place of a file and leads elsewhere: a link of either kind, a pipe, a device.

    Raises OSError: it could not be removed.
    """
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISDIR(found.st_mode) and (not stat.S_ISREG(found.st_mode) or found.st_nlink > 1):
        path.unlink()


def is_inside(folder: Path, name: Path) -> bool:
    """Whether no link leads out of a folder on the way to a relative name in it, which need not exist."""
    return (
        Path(os.path.realpath(folder / name.parent)) == Path(os.path.realpath(folder)) / name.parent
    )


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Context with a temporary path of the same suffix in the same folder, which replaces `path` on leaving.

    After an exception the temporary file is removed and an older `path` is as it was.

    Raises InputError: `path` is a device, a pipe or a folder, whose place no file may take.
    """
    if path.exists() and not path.is_file():
        raise InputError(
            "file", f"'{path}', which is a device, a pipe or a folder", "a file, or a new one"
        )
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


@contextmanager
def writing(what: str, path: object, kind: str = "a file") -> Iterator[None]:
    """Context in which a file that the system cannot write is an InputError of an argument, which names its path."""
    try:
        yield
    except OSError as error:
        raise InputError(
            what, f"'{path}'", f"{kind} that can be written ({error.strerror})"
        ) from None


def write_text(path: Path, text: str) -> Path:
    """Write a text file in UTF-8; returns its path."""
    return write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes | memoryview) -> Path:
    """Write a file; returns its path."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return path
