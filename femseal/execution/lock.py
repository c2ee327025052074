"""One run in a folder at a time.

A run holds a lock on a file in its folder. The system gives the lock back when the process ends, however it ends. File
systems without locks, among them some of networks, have a file in its place that names the process.
"""

from __future__ import annotations

import errno
import json
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

from ..base.errors import InputError, shortened
from ..base.files import read_plain, remove_foreign

#: Name of the file in the folder, which says who holds the lock, and of the one where there are no locks.
LOCK, MARK = ".lock", ".lock-mark"
#: Errors of a file system that has no locks.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}
#: How long a lock is tried whose file another run removes meanwhile, and how often [s].
_PATIENCE, _POLL = 0.2, 0.02


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Context in which no other run writes into a folder, which exists.

    Raises
    ------
    InputError : another run is under way there, or the folder cannot be written.
    """
    from filelock import Timeout

    path = folder / LOCK
    try:
        held = _acquired(folder)
    except Timeout:
        given = f"'{folder}', where {_named(_owner(path))} is under way"
        raise InputError("output", given, "another folder, or this one when that run has ended") from None
    except OSError as error:
        raise InputError("output", f"'{folder}'", f"a folder that can be written ({error.strerror})") from None
    try:
        with suppress(OSError):  # on a full disk the lock holds all the same
            process = psutil.Process()
            started = {"process": process.pid, "host": platform.node(), "started": process.create_time()}
            path.write_text(json.dumps(started))
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        held.release()


def _acquired(folder: Path) -> Any:
    """The lock of a folder, held by this run; filelock.Timeout where another one holds it."""
    from filelock import FileLock, SoftFileLock

    options: dict[str, Any] = {"timeout": _PATIENCE, "poll_interval": _POLL, "thread_local": False}
    for kind, name in ((FileLock, LOCK), (SoftFileLock, MARK)):
        remove_foreign(folder / name)
        held = kind(folder / name, **options)
        try:
            held.acquire()
            return held
        except OSError as error:
            if kind is SoftFileLock or error.errno not in _NO_LOCKS:
                raise
    raise AssertionError


def _owner(path: Path) -> dict[str, Any]:
    """What the file says of the process that holds the lock; empty where it says nothing."""
    try:
        found = json.loads(read_plain(path, 1000))
        return {name: kind(found[name]) for name, kind in {"process": int, "host": str, "started": float}.items()}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _named(owner: dict[str, Any]) -> str:
    """Who holds a lock, for a message."""
    if not owner:
        return "another run"
    since = time.strftime("%H:%M on %d %B", time.localtime(owner["started"]))
    return f"another run (process {owner['process']} on {shortened(owner['host'], 60)}, started at {since})"
