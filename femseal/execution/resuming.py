"""One run in a folder at a time, or several parts of one, which share a store; runs that are resumed.

A run that was ended has its store in the output folder, with what its results depend on, so that it can be resumed.
A run holds a lock on a file in its folder. The system gives the lock back when the process ends, however it ends. File
systems without locks, among them some of networks, have a file in its place that names the process.
Part 3 of 16 computes the third sixteenth of the items of every stage, consecutive ones, and reads those of the others.
A stage of fewer items than parts leaves some without work.
"""

import errno
import json
import logging
import os
import platform
import re
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import sleep, strftime
from typing import Any

from ..base import (
    FemsealError,
    InputError,
    Mapper,
    PartsMissing,
    Stage,
    counted,
    read_plain,
    shortened,
    shown,
    write_text,
)
from ..base.files import remove_foreign
from ..store.store import SUFFIX, Store, Unnamed
from .run import Progress

#: Subfolder of the output folder with the store of its run, and what that depends on.
FOLDER = ".checkpoint"
MANIFEST = "manifest.json"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e8
#: Changed keys that a message names.
_MOST_CHANGES = 20
#: Number of a part, from 1, and how many there are.
Part = tuple[int, int]
#: Most parts.
MOST_PARTS = 100_000
#: Name of the file in the folder, which says who holds the lock, and of that of a part; what is added where there are
#: no locks.
LOCK, PART_LOCK, MARK = ".lock", ".part-lock-{}-of-{}", "-mark"
#: Time between two looks for the items of parts that are under way [s].
POLL_SECONDS = 2.0
#: How long a lock is tried whose file another run removes meanwhile, and how often [s].
_PATIENCE, _POLL = 0.2, 0.02


def parsed_part(text: str | None) -> Part | None:
    """The part that a text such as "3/16" names; None without one.

    Raises InputError: the text is none of that kind.

    >>> parsed_part("3/16")
    (3, 16)
    """
    if text is None:
        return None
    if not (found := re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip(), re.ASCII)):
        raise InputError("part", shown(text), "a number and how many parts there are, such as 3/16")
    return checked_part((int(found[1]), int(found[2])))


def checked_part(part: Part) -> Part:
    """A part with a number from 1 to how many there are; else InputError."""
    whole = isinstance(part, (tuple, list)) and [type(number) for number in part] == [int, int]
    if not whole or not 1 <= part[0] <= part[1] <= MOST_PARTS:
        expected = f"a number and how many parts there are, such as (3, 16): from 1 on, at most {MOST_PARTS} parts"
        raise InputError("part", shown(part), expected)
    return part[0], part[1]


def own_items(part: Part, count: int) -> tuple[int, int]:
    """First of the items that are a part's own, and the one after its last.

    >>> [own_items((n, 3), 7) for n in (1, 2, 3)]
    [(0, 3), (3, 5), (5, 7)]
    """
    number, parts = part
    return -(-(number - 1) * count // parts), -(-number * count // parts)


def parts_of(items: Iterable[int], part: Part, count: int) -> list[int]:
    """Numbers of the parts whose own some items are, of as many as a part is of.

    >>> parts_of([0, 2, 3], (1, 3), 7)
    [1, 2]
    """
    return sorted({n * part[1] // count + 1 for n in items})


def missing_parts(part: Part, stage: str, missing: list[int]) -> PartsMissing:
    """What to say of a stage of which a part has done its own items, and others have not."""
    named = f"part{'s' * (len(missing) > 1)} {shortened(', '.join(map(str, missing)))} of {part[1]}"
    return PartsMissing(
        f"part {part[0]}/{part[1]}: '{stage}' needs {named}; run this part again after them"
    )


log = logging.getLogger("femseal.execution.resuming")
#: Errors of a file system that has no locks.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}


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
        # asked before the last look: a part that has ended since then has kept its items
        if not waits:
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
        said = read_plain(path, 1000).decode()
    except (OSError, ValueError):
        return "another run"
    return f"another run ({shortened(said)})"


@contextmanager
def writing_in(
    folder: Path, identity: dict[str, Any], resume: bool, part: Part | None
) -> Iterator[bool]:
    """Context in which a run, or its parts, write into a folder that exists; gives whether it goes on.

    identity : what the results depend on, as nested plain data.

    Raises InputError: the folder has an unfinished run without `resume`, one of another identity with it, or one that
    is under way.
    """
    with alone_in(folder, part):
        if not resume:
            refuse_unfinished(folder)
        yield resume and resumable(folder, identity)


def over_store(
    mapper: Mapper, store: Store, folder: Path, part: Part | None, progress: Progress
) -> Mapper:
    """A mapper that reads results of a store and keeps others there; of a part, it awaits those of other parts.

    A part computes its own items before. folder : where the parts hold their locks. progress : called as
    progress(stage, done, total) for the own items.

    Raises PartsMissing: from the mapper; the own items are kept, and others are not there, of parts that are not
    under way.
    """
    kept = store.over(mapper)
    if part is None:
        return kept

    def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
        try:
            key_of = store.keys(stage)
        except Unnamed:  # nothing by which others could find it
            yield from mapper(stage, *iterables)
            return
        items = list(zip(*iterables, strict=False))
        keys = [key_of(item) for item in items]
        columns = [[item[n] for item in items] for n in range(len(iterables))]
        start, stop = own_items(part, len(items))
        name = f"part {part[0]}/{part[1]}: {stage.name}"
        own = kept(stage, *(column[start:stop] for column in columns))
        for done, _ in enumerate(own, start=1):
            progress(name, done, stop - start)

        def missing() -> list[int]:
            store.look()
            left = (n for n, key in enumerate(keys) if key and key not in store)
            return parts_of(left, part, len(items))

        await_parts(folder, part, stage.name, missing)
        yield from kept(stage, *columns)

    return mapping


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
