"""One run in a folder at a time.

A run holds a lock on a file in its folder. The system gives the lock back when the process ends, however it ends. File
systems without locks, among them some of networks, are told by the name of the process in the file.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

from ..base.errors import InputError, shortened
from ..base.files import read_plain, remove_foreign

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

#: Name of the file in the folder.
LOCK = ".lock"
#: Errors of a file system that has no locks.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}
#: A process that started at most so much later than it was written is the same [s].
_CLOCK = 2.0
#: How often a lock is tried whose file another run removes meanwhile.
_TRIES = 100


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Context in which no other run writes into a folder, which exists.

    Raises
    ------
    InputError : another run is under way there, or the folder cannot be written.
    """
    path = folder / LOCK
    try:
        handle = _locked(path, folder)
    except OSError as error:
        raise InputError("output", f"'{folder}'", f"a folder that can be written ({error.strerror})") from None
    try:
        with suppress(OSError):  # on a full disk the lock holds all the same
            os.ftruncate(handle, 0)
            os.write(handle, json.dumps(_this_process()).encode())
        yield
    finally:
        # another run may have taken the place if the file was removed
        with suppress(OSError):
            if os.path.samestat(path.stat(), os.fstat(handle)):
                path.unlink()
        os.close(handle)


def _locked(path: Path, folder: Path) -> int:
    """Descriptor of the file with the lock on it."""
    for _ in range(_TRIES):
        remove_foreign(path)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            if not _take(handle, path):
                given = f"'{folder}', where {_named(_owner(path))} is under way"
                raise InputError("output", given, "another folder, or this one when that run has ended")
            # the run that held the lock may have removed its file meanwhile
            with suppress(FileNotFoundError):
                if os.path.samestat(path.stat(), os.fstat(handle)):
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    raise InputError("output", f"'{folder}', whose '{LOCK}' comes and goes", "a folder without other runs")


def _take(handle: int, path: Path) -> bool:
    """Lock an open file; False if another run holds the lock."""
    try:
        if fcntl is None:
            raise OSError(errno.ENOSYS, "no locks")
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return not _lives(_owner(path))
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return False
        raise


def _this_process() -> dict[str, Any]:
    process = psutil.Process()
    return {"process": process.pid, "host": platform.node(), "started": process.create_time()}


def _owner(path: Path) -> dict[str, Any]:
    """What the file says of the process that holds the lock; empty where it says nothing."""
    try:
        found = json.loads(read_plain(path, 1000))
        return {name: kind(found[name]) for name, kind in {"process": int, "host": str, "started": float}.items()}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _named(owner: dict[str, Any]) -> str:
    if not owner:
        return "another run"
    since = time.strftime("%H:%M on %d %B", time.localtime(owner["started"]))
    return f"another run (process {owner['process']} on {shortened(owner['host'], 60)}, started at {since})"


def _lives(owner: dict[str, Any]) -> bool:
    """Whether a process may be running: one of another machine may."""
    if not owner or owner["host"] != platform.node():
        return bool(owner)
    try:
        return abs(psutil.Process(owner["process"]).create_time() - owner["started"]) <= _CLOCK
    except (psutil.Error, ValueError, OverflowError):
        return False
