"""Keep runs apart, one in a folder at a time, and resume a run that was stopped.

A run that was stopped has its store in the output folder, with what its results depend on, so that it can be resumed.
A run holds a lock on a file in its folder. The system gives the lock back when the process ends, however it ends. File
systems without locks, among them some of networks, have a file in its place that names the process.
"""

import errno
import json
import os
import platform
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import strftime
from typing import Any

from ..base import (
    FemsealError,
    InputError,
    counted,
    read_plain,
    shortened,
    write_text,
)
from ..base.files import remove_foreign
from ..store.store import SUFFIX

#: Subfolder of the output folder with the store of its run, and what that depends on.
FOLDER = ".checkpoint"
MANIFEST = "manifest.json"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e8
#: Changed keys that a message names.
_MOST_CHANGES = 20
#: Name of the file in the folder that says who holds the lock, and what is added to it where there are no locks.
LOCK, MARK = ".lock", "-mark"
#: How long a lock is tried whose file another run removes meanwhile, and how often [s].
_PATIENCE, _POLL = 0.2, 0.02
#: Errors of a file system that has no locks.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Lock a folder, which exists, so that no other run writes into it within the context.

    Raises
    ------
    InputError : another run is under way there, or the folder cannot be written.
    """
    from filelock import Timeout

    path = folder / LOCK
    try:
        lock = _acquired(path)
    except Timeout:
        given = f"'{folder}', where {_holder(path)} is under way"
        expected = "another folder, or this one when that run has ended"
        raise InputError("output", given, expected) from None
    except OSError as error:
        expected = f"a folder that can be written ({error.strerror})"
        raise InputError("output", f"'{folder}'", expected) from None
    try:
        with suppress(OSError):  # on a full disk the lock holds all the same
            since = strftime("%H:%M on %d %B")
            path.write_text(f"process {os.getpid()} on {platform.node()}, since {since}")
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        lock.release()


def _acquired(path: Path) -> Any:
    """A lock, held by this run; filelock.Timeout where another one holds it."""
    from filelock import FileLock, SoftFileLock

    options: dict[str, Any] = {"timeout": _PATIENCE, "poll_interval": _POLL, "thread_local": False}
    for kind, place in ((FileLock, path), (SoftFileLock, path.with_name(path.name + MARK))):
        remove_foreign(place)
        held = kind(place, **options)
        try:
            held.acquire()
            return held
        except OSError as error:
            if kind is SoftFileLock or error.errno not in _NO_LOCKS:
                raise
    raise AssertionError


def _holder(path: Path) -> str:
    """Who holds a lock, by its file, for a message."""
    try:
        said = read_plain(path, 1000).decode()
    except (OSError, ValueError):
        return "another run"
    return f"another run ({shortened(said)})"


@contextmanager
def writing_in(folder: Path, identity: dict[str, Any], resume: bool) -> Iterator[bool]:
    """Lock a folder, which exists, for a run that writes into it; the context gives whether the run is resumed.

    Parameters
    ----------
    folder : output folder of the run.
    identity : everything on which the results depend, as nested plain data.
    resume : whether a run that was stopped there may go on.

    Raises
    ------
    InputError : the folder has an unfinished run without `resume`, one of another identity with it, or one that is
        under way.
    """
    with alone_in(folder):
        if not resume:
            refuse_unfinished(folder)
        yield resume and resumable(folder, identity)


def resumable(output: Path, identity: dict[str, Any]) -> bool:
    """Check whether the output folder has the store of a run of this identity; nothing is written.

    output : the output folder.
    identity : everything on which the bits of the results depend, as nested plain data.

    Raises InputError: its manifest is unreadable or of another identity; every changed key is named with both
    values.
    """
    path = store_folder(output) / MANIFEST
    try:
        former = json.loads(read_plain(path, _LARGEST_MANIFEST).decode())
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError) as error:
        given = f"'{path}', which cannot be read ({error})"
        expected = f"an intact file; remove '{path.parent}' to start anew"
        raise InputError("resume", given, expected) from None
    # data as JSON returns it, with lists in place of tuples
    old, new = _flat(former), _flat(json.loads(json.dumps(identity)))
    changed = [key for key in old | new if old.get(key) != new.get(key)]
    if not changed:
        return True
    lines = [f"that of the same case, files and versions; remove '{path.parent}' to start anew"]
    for key in changed[:_MOST_CHANGES]:
        was, now = (shortened(values.get(key, "not given")) for values in (old, new))
        lines.append(f"{shortened(key)}: was {was}, is {now}")
    if more := changed[_MOST_CHANGES:]:
        lines.append(counted(len(more), "more key"))
    raise InputError("resume", "an unfinished run of another case", "\n".join(lines))


def refuse_unfinished(output: Path, name: str = FOLDER) -> None:
    """Raise InputError if the output folder has results of an unfinished run, in a folder of this name."""
    if any(store_folder(output, name).glob(f"*{SUFFIX}")):
        given = f"'{output}', which holds an unfinished run"
        expected = f"--resume to go on, or another folder; to start anew, remove '{output / name}'"
        raise InputError("output", given, expected)


def remove_run(output: Path) -> None:
    """Remove the store from the output folder, if there is one.

    Raises FemsealError: it could not be removed.
    """
    folder = store_folder(output)
    try:
        # without its manifest a run is never resumed, even if other files remain
        (folder / MANIFEST).unlink(missing_ok=True)
        if folder.exists():
            shutil.rmtree(folder)
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be removed ({error.strerror})") from error


def store_folder(output: Path, name: str = FOLDER) -> Path:
    """The folder of the store, which need not exist; one that lies elsewhere is not touched."""
    folder = output / name
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError("output", f"'{folder}', which is a link or a file", "a folder, or none")
    return folder


def begin_run(output: Path, identity: dict[str, Any]) -> None:
    """Write down what the results of a run in an output folder depend on.

    Raises FemsealError: the folder cannot be written.
    """
    folder = store_folder(output)
    text = json.dumps(identity, indent=1, ensure_ascii=False)
    try:
        folder.mkdir(exist_ok=True)
        write_text(folder / MANIFEST, text)
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be written ({error.strerror})") from error


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys; lists of plain values stay whole."""
    if isinstance(value, list) and any(isinstance(part, dict) for part in value):
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return {key: value}
    parts = (_flat(part, f"{key}.{name}".removeprefix(".")) for name, part in value.items())
    return {name: part for flat in parts for name, part in flat.items()}
