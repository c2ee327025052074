"""Read and write files safely.

A file is written completely or not at all, and links, pipes and devices are not followed.
"""

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import InputError


def made_folder(folder: str | os.PathLike[str]) -> Path:
    """Make a folder and its parents if they do not exist, and return its path.

    Raises
    ------
    InputError
        The path is a file, or the folder cannot be made.
    """
    path = Path(folder)
    with writing("output folder", path, "a folder"):
        path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def opened_plain(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file for reading; refuse links, pipes and devices.

    Raises
    ------
    OSError
        The file does not exist, or it is not a regular file.
    """
    if path.is_symlink():
        raise OSError(f"'{path}' is a link")
    # without O_NONBLOCK, opening a pipe would wait for a program that writes to it
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    handle = os.open(path, flags)
    with open(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise OSError(f"'{path}' is not a regular file")
        yield file


def read_plain(path: Path, largest: float) -> bytes:
    """Return the content of a regular file of at most `largest` bytes; refuse links, pipes and devices.

    Raises
    ------
    OSError
        The file does not exist, is not a regular file, or is larger.
    """
    with opened_plain(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > largest:
            raise OSError(
                f"'{path}' has {size / 1e9:.3g} GB, but at most {largest / 1e9:.3g} GB are expected"
            )
        return file.read()


def remove_foreign(path: Path) -> None:
    """Remove a link, pipe or device that occupies the path of a file to be written.

    Writing to a link, pipe or device could have effects elsewhere. A regular file that has other hard links is removed
    as well. All other files and folders stay.

    Raises
    ------
    OSError
        The link, pipe or device could not be removed.
    """
    try:
        status = path.lstat()
    except FileNotFoundError:
        return
    if stat.S_ISDIR(status.st_mode):
        return
    has_hard_links = status.st_nlink > 1
    if has_hard_links or not stat.S_ISREG(status.st_mode):
        path.unlink()


def is_inside(folder: Path, name: Path) -> bool:
    """Return whether a relative path stays in a folder and passes no link.

    A link among the parents of the path counts as outside, even if it leads to a place inside the folder. The last part
    of the path may be a link, because a file that is removed or replaced is the link itself. The path need not exist.
    """
    if name.is_absolute() or ".." in name.parts:
        return False
    actual_parent = Path(os.path.realpath(folder / name.parent))
    return actual_parent == Path(os.path.realpath(folder)) / name.parent


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder, which replaces `path` when the context ends.

    The temporary file has the same suffix as `path`. If an exception occurs, the temporary file is removed and an
    existing file at `path` stays unchanged.

    Raises
    ------
    InputError
        The path is a device, a pipe or a folder, which a file must not replace.
    """
    if path.exists() and not path.is_file():
        given = f"'{path}', which is a device, a pipe or a folder"
        raise InputError("file", given, "an existing file, or the name of a new file")
    temporary = path.parent / f".unfinished-{secrets.token_hex(8)}{path.suffix}"
    # unlike a file of the module tempfile, this one has the usual permissions
    temporary.touch(exist_ok=False)
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def writing(what: str, path: object, kind: str = "a file") -> Iterator[None]:
    """Convert an OSError inside a `with` block to an InputError that names the argument and its path.

    Parameters
    ----------
    what : str
        Name of the argument.
    path : path
        The path that is written.
    kind : str
        "a file" or "a folder", for the message.
    """
    try:
        yield
    except OSError as error:
        expected = f"{kind} that can be written ({error.strerror})"
        raise InputError(what, f"'{path}'", expected) from None


def write_text(path: Path, text: str) -> Path:
    """Write a text file in UTF-8 and return its path."""
    return write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes | memoryview) -> Path:
    """Write a binary file and return its path."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return path
