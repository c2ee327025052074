"""One run in a folder at a time, or several parts of one.

A run holds a lock on a file in its folder. The system gives the lock back when the process ends, however it ends. File
systems without locks, among them some of networks, have a file in its place that names the process.
"""

from __future__ import annotations

import errno
import json
import logging
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import localtime, sleep, strftime
from typing import Any

import psutil

from ..base.errors import InputError, shortened
from ..base.files import read_plain, remove_foreign
from .parts import Part, missing_parts

log = logging.getLogger("femseal.execution.lock")
#: Name of the file in the folder, which says who holds the lock, and of that of a part; what is added where there are
#: no locks.
LOCK, PART_LOCK, MARK = ".lock", ".part-lock-{}-of-{}", "-mark"
#: Time between two looks for the items of parts that are under way [s].
POLL_SECONDS = 2.0
#: Errors of a file system that has no locks.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}
#: How long a lock is tried whose file another run removes meanwhile, and how often [s].
_PATIENCE, _POLL = 0.2, 0.02


@contextmanager
def alone_in(folder: Path, part: Part | None = None) -> Iterator[None]:
    """Context in which no other run writes into a folder, which exists; with a part, none but other parts.

    Raises InputError: another run is under way there, or the folder cannot be written.
    """
    name = LOCK if part is None else PART_LOCK.format(*part)
    with _locked(folder, name):
        # a run and a part that begin together see each other's lock: both are refused rather than none
        others = folder.glob(PART_LOCK.format("*", "*[0-9]")) if part is None else folder.glob(LOCK)
        for other in others:
            with _locked(folder, other.name):
                pass
        yield


def is_under_way(folder: Path, part: Part) -> bool:
    """Whether another process computes a part in a folder."""
    name = PART_LOCK.format(*part)
    try:
        if (folder / name).exists():
            with _locked(folder, name):
                pass
    except InputError:
        return True
    return False


def await_parts(folder: Path, part: Part, stage: str, missing: Callable[[], list[int]]) -> None:
    """Wait until no items of a stage are missing in a folder, as long as all parts that compute them are under way.

    missing : gives the numbers of the parts whose items are not there, of as many as `part` is of.

    Raises PartsMissing: one of them is not under way, or it is this part.
    """
    said, waits = False, True
    while left := missing():
        if (
            not waits
        ):  # asked before the last look: a part that has ended since then has kept its items
            raise missing_parts(part, stage, left)
        waits = all(n != part[0] and is_under_way(folder, (n, part[1])) for n in left)
        if waits:
            if not said:
                log.info("%s", missing_parts(part, stage, left))
            said = True
            sleep(POLL_SECONDS)


@contextmanager
def _locked(folder: Path, name: str) -> Iterator[None]:
    """Context with a lock of this process; InputError as `alone_in`."""
    from filelock import Timeout

    path = folder / name
    try:
        held = _acquired(path)
    except Timeout:
        given = f"'{folder}', where {_holder(path)} is under way"
        raise InputError(
            "output", given, "another folder, or this one when that run has ended"
        ) from None
    except OSError as error:
        raise InputError(
            "output", f"'{folder}'", f"a folder that can be written ({error.strerror})"
        ) from None
    try:
        with suppress(OSError):  # on a full disk the lock holds all the same
            process = psutil.Process()
            started = {
                "process": process.pid,
                "host": platform.node(),
                "started": process.create_time(),
            }
            path.write_text(json.dumps(started))
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        held.release()


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
        found = json.loads(read_plain(path, 1000))
        process, host, started = int(found["process"]), str(found["host"]), float(found["started"])
    except (OSError, ValueError, KeyError, TypeError):
        return "another run"
    since = strftime("%H:%M on %d %B", localtime(started))
    return f"another run (process {process} on {shortened(host, 60)}, started at {since})"
