"""Lock the output folder of a run, and resume runs that were stopped.

A stopped run leaves two things in its output folder: the store with its results, and a manifest of everything on which
the results depend. The run can be resumed from the store and the manifest. A run in progress holds a lock on a file in
its output folder. The operating system releases the lock when the process ends, for whatever reason. Some network file
systems do not support locks. On a file system without locks, an additional file marks the folder as locked. The
additional file contains the name of the process.
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
    flatten,
    read_plain,
    shortened,
    write_text,
)
from ..base.files import remove_foreign
from ..store.store import SUFFIX

#: Subfolder of the output folder that contains the store of its run.
FOLDER = ".checkpoint"
#: File in the folder of the store, with everything on which the results depend.
MANIFEST = "manifest.json"
#: Key of an identity with user-defined classes, whose runs cannot be resumed.
USER_CODE = "code of registered classes"
#: Largest size of a manifest [byte].
_LARGEST_MANIFEST = 1e8
#: Largest number of changed keys that a message lists.
_MOST_CHANGES = 20
#: File in the output folder that a run locks. The text in the file says which process holds the lock.
LOCK = ".lock"
#: Suffix of the name of the file that replaces the lock on file systems without locks.
MARK = "-mark"
#: Time for which the run tries to acquire the lock, in case another run is just removing the locked file, and interval
#: between two attempts [s].
_PATIENCE, _POLL = 0.2, 0.02
#: Errors of file systems without locks.
_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Lock an existing folder, so that no other run can write to it during the `with` block.

    Raises
    ------
    InputError
        Another run is under way in the folder, or the folder cannot be written.
    """
    from filelock import Timeout

    path = folder / LOCK
    try:
        lock = _acquire_lock(path)
    except Timeout:
        given = f"'{folder}', where {_holder(path)} is under way"
        expected = "another folder, or the same folder after the end of the other run"
        raise InputError("output", given, expected) from None
    except OSError as error:
        expected = f"a folder that can be written ({error.strerror})"
        raise InputError("output", f"'{folder}'", expected) from None
    try:
        with suppress(OSError):  # on a full disk the text is lost, but the lock still holds
            since = strftime("%H:%M on %d %B")
            path.write_text(f"process {os.getpid()} on {platform.node()}, since {since}")
        yield
    finally:
        with suppress(OSError):
            path.unlink()
        lock.release()


def _acquire_lock(path: Path) -> Any:
    """Acquire a lock on a file and return the lock.

    On a file system without locks, an additional file with the suffix `MARK` is created instead.

    Raises filelock.Timeout if another run holds the lock.
    """
    from filelock import FileLock, SoftFileLock

    options: dict[str, Any] = {"timeout": _PATIENCE, "poll_interval": _POLL, "thread_local": False}
    remove_foreign(path)
    lock = FileLock(path, **options)
    try:
        lock.acquire()
        return lock
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    mark_path = path.with_name(path.name + MARK)
    remove_foreign(mark_path)
    mark = SoftFileLock(mark_path, **options)
    mark.acquire()
    return mark


def _holder(path: Path) -> str:
    """Describe the run that holds a lock, using the text of the locked file."""
    try:
        process = read_plain(path, 1000).decode()
    except (OSError, ValueError):
        return "another run"
    return f"another run ({shortened(process)})"


@contextmanager
def writing_in(folder: Path, identity: dict[str, Any], resume: bool) -> Iterator[bool]:
    """Lock an existing folder for a run, and yield whether the run is resumed.

    Parameters
    ----------
    folder : Path
        Output folder of the run.
    identity : dict
        Everything on which the results depend, as nested plain data.
    resume : bool
        Whether to resume a run that was stopped in this folder.

    Raises
    ------
    InputError
        Another run is under way in the folder. An InputError is also raised if the folder contains an unfinished run,
        unless `resume` is True and the identity of the unfinished run is the same.
    """
    with alone_in(folder):
        if not resume:
            refuse_unfinished(folder)
        yield resume and resumable(folder, identity)


def resumable(output: Path, identity: dict[str, Any]) -> bool:
    """Return whether the output folder contains an unfinished run with the same identity.

    Parameters
    ----------
    output : Path
        The output folder.
    identity : dict
        Everything on which the results depend, as nested plain data.

    Raises
    ------
    InputError
        The manifest cannot be read, its identity differs from `identity`, or the run uses classes of the user. The
        message lists the keys whose values differ.
    """
    path = store_folder(output) / MANIFEST
    try:
        stored_identity = json.loads(read_plain(path, _LARGEST_MANIFEST).decode())
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError) as error:
        given = f"'{path}', which cannot be read ({error})"
        expected = f"an intact file; remove '{path.parent}' to start anew"
        raise InputError("resume", given, expected) from None
    if USER_CODE in identity:
        given = "a run with a class of your own, whose code may have changed"
        expected = f"a new start, for which you remove '{path.parent}'"
        raise InputError("resume", given, expected)
    old = flatten(stored_identity)
    # JSON turns tuples into lists, as in the manifest
    new = flatten(json.loads(json.dumps(identity)))
    changed = [key for key in old | new if old.get(key) != new.get(key)]
    if not changed:
        return True
    lines = [f"a run of the same case, files and versions; remove '{path.parent}' to start anew"]
    for key in changed[:_MOST_CHANGES]:
        old_value = shortened(old.get(key, "not given"))
        new_value = shortened(new.get(key, "not given"))
        lines.append(f"{shortened(key)}: was {old_value}, is {new_value}")
    omitted = len(changed) - _MOST_CHANGES
    if omitted > 0:
        lines.append(counted(omitted, "more key"))
    raise InputError("resume", "an unfinished run of another case", "\n".join(lines))


def refuse_unfinished(output: Path, name: str = FOLDER) -> None:
    """Raise InputError if the output folder contains results of an unfinished run.

    name : name of the subfolder with the store of the run.
    """
    has_results = any(store_folder(output, name).glob(f"*{SUFFIX}"))
    if has_results:
        given = f"'{output}', which holds an unfinished run"
        expected = f"--resume to go on, or another folder; to start anew, remove '{output / name}'"
        raise InputError("output", given, expected)


def remove_run(output: Path) -> None:
    """Remove the store of an unfinished run from the output folder, if there is one.

    Raises
    ------
    FemsealError
        The store could not be removed.
    """
    folder = store_folder(output)
    try:
        # the manifest is removed first: without a manifest, the run is never resumed, even if other files cannot be
        # removed
        (folder / MANIFEST).unlink(missing_ok=True)
        if folder.exists():
            shutil.rmtree(folder)
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be removed ({error.strerror})") from error


def store_folder(output: Path, name: str = FOLDER) -> Path:
    """Return the path of the folder of the store, whether or not the folder exists.

    Raises
    ------
    InputError
        The path is a file or a symbolic link. Links are not accepted, because a link could lead to any other folder.
    """
    folder = output / name
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError("output", f"'{folder}', which is a link or a file", "a folder, or none")
    return folder


def begin_run(output: Path, identity: dict[str, Any]) -> None:
    """Write the manifest of a run, which contains everything on which the results of the run depend.

    Raises
    ------
    FemsealError
        The folder cannot be written.
    """
    folder = store_folder(output)
    text = json.dumps(identity, indent=1, ensure_ascii=False)
    try:
        folder.mkdir(exist_ok=True)
        write_text(folder / MANIFEST, text)
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be written ({error.strerror})") from error
