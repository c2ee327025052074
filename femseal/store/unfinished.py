"""A run that was ended: its store in the output folder, and what its results depend on, so that it can be resumed."""

import json
import shutil
from pathlib import Path
from typing import Any

from ..base import FemsealError, InputError, counted, read_plain, replacing, shortened
from .store import SUFFIX

#: Subfolder of the output folder.
FOLDER = ".checkpoint"
MANIFEST = "manifest.json"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e8
#: Changed keys that a message names.
_MOST_CHANGES = 20


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
    old, new = _flat(former), _flat(_plain(identity))
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if changed:
        lines = [
            f"{shortened(key)}: was {shortened(old.get(key, 'not given'))}, is {shortened(new.get(key, 'not given'))}"
            for key in changed[:_MOST_CHANGES]
        ]
        if more := changed[_MOST_CHANGES:]:
            lines.append(counted(len(more), "more key"))
        expected = (
            f"that of the same case, files and versions; remove '{path.parent}' to start anew"
        )
        raise InputError(
            "resume", "an unfinished run of another case", "\n".join([expected, *lines])
        )
    return True


def refuse_unfinished(output: Path, name: str = FOLDER) -> None:
    """Raise InputError if the output folder has results of an unfinished run, in a folder of this name."""
    if any(store_folder(output, name).glob(f"*{SUFFIX}")):
        given = f"'{output}', which holds an unfinished run"
        expected = f"--resume to go on, or another folder; to start anew, remove '{output / name}'"
        raise InputError("output", given, expected)


def remove(output: Path) -> None:
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


def begin(output: Path, identity: dict[str, Any]) -> None:
    """Write down what the results of a run in an output folder depend on.

    Raises FemsealError: the folder cannot be written.
    """
    folder = store_folder(output)
    text = json.dumps(_plain(identity), indent=1, ensure_ascii=False)
    try:
        folder.mkdir(exist_ok=True)
        with replacing(folder / MANIFEST) as temporary:
            temporary.write_text(text, encoding="utf-8")
    except OSError as error:
        raise FemsealError(f"store: '{folder}' could not be written ({error.strerror})") from error


def _plain(identity: dict[str, Any]) -> Any:
    """Data as JSON returns it, with lists in place of tuples."""
    return json.loads(json.dumps(identity))


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys; lists of plain values stay whole."""
    if isinstance(value, dict) or (
        isinstance(value, list) and any(isinstance(v, dict) for v in value)
    ):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return {
            k: v
            for name, part in pairs
            for k, v in _flat(part, f"{key}.{name}" if key else str(name)).items()
        }
    return {key: value}
