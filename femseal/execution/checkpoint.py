"""Results of an unfinished run on disk, so that it can be resumed after a kill at any moment.

Every call of the mapper in a study is a stage; the order of the calls depends on the case alone. Results of
consecutive items are kept in shards, each a file that is complete or not there, with a checksum. A resumed run makes
the same calls, takes the items of intact shards from their files and computes the others, see `store`. Shards are no
exchange format; `results.nc` is one.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import re
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from ..base.errors import FemsealError, InputError, NotKept, shortened
from ..base.files import read_plain
from ..base.stage import Mapper, Stage
from .plain_data import unpacked
from .store import SUFFIX, ShardWriter, read_shard, write_whole

log = logging.getLogger("femseal.execution.checkpoint")
#: Subfolder of the output folder.
FOLDER = ".checkpoint"
MANIFEST = "manifest.json"
#: No manifest is larger [byte].
_LARGEST_MANIFEST = 1e8
#: Changed keys that a message names.
_MOST_CHANGES = 20
_NAME = re.compile(r"(\d{3,9})-(\d{9,15})-(\d{9,15})")


def resumable(output: Path, identity: dict[str, Any]) -> bool:
    """Check whether the output folder has a checkpoint of this identity; nothing is written.

    Parameters
    ----------
    output : the output folder.
    identity : everything on which the bits of the results depend, as nested plain data.

    Raises
    ------
    InputError : the checkpoint is unreadable or of another identity; every changed key is named with both values.
    """
    path = _folder(output) / MANIFEST
    try:
        former = json.loads(read_plain(path, _LARGEST_MANIFEST).decode())
    except FileNotFoundError:
        return False
    except (OSError, ValueError, RecursionError) as error:
        given = f"'{path}', which cannot be read ({error})"
        expected = f"an intact checkpoint; remove '{path.parent}' to start anew"
        raise InputError("resume", given, expected) from None
    old, new = _flat(former), _flat(_plain(identity))
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if changed:
        lines = [
            f"{shortened(key)}: was {shortened(old.get(key, 'not given'))}, is {shortened(new.get(key, 'not given'))}"
            for key in changed[:_MOST_CHANGES]
        ]
        lines += [f"{len(changed) - _MOST_CHANGES} more keys"] if len(changed) > _MOST_CHANGES else []
        expected = f"that of the same case, files and versions; remove '{path.parent}' to start anew"
        raise InputError("resume", "a checkpoint of another run", "\n".join([expected, *lines]))
    return True


def refuse_unfinished(output: Path) -> None:
    """Raise InputError if the output folder has an unfinished run, whose results a new run would remove."""
    kept = len(list(_folder(output).glob(f"*{SUFFIX}")))
    if kept:
        given = f"'{output}', which holds {kept} parts of an unfinished run"
        expected = f"--resume to go on; another folder, or none of '{output / FOLDER}', to start anew"
        raise InputError("output", given, expected)


def remove(output: Path) -> None:
    """Remove the checkpoint from the output folder, if there is one.

    Raises
    ------
    FemsealError : the checkpoint could not be removed.
    """
    folder = _folder(output)
    try:
        # without its manifest the checkpoint is never resumed, even if other files remain
        (folder / MANIFEST).unlink(missing_ok=True)
        if folder.exists():
            shutil.rmtree(folder)
    except OSError as error:
        raise FemsealError(f"checkpoint: '{folder}' could not be removed ({error.strerror})") from error


def _folder(output: Path) -> Path:
    """The folder of the checkpoint, which need not exist; one that lies elsewhere is not touched."""
    folder = output / FOLDER
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError("output", f"'{folder}', which is a link or a file", "a folder, or none")
    return folder


class Checkpoint:
    """The checkpoint of one run; a context that writes the items still in memory on leaving.

    Parameters
    ----------
    output : the output folder, which exists.
    identity : what the bits of the results depend on, as nested plain data.
    resume : go on with what is there, found `resumable`; else it is removed.

    Raises
    ------
    FemsealError : the folder cannot be written, also from the mappers made by `over`: what is kept stays.
    """

    def __init__(self, output: Path, identity: dict[str, Any], resume: bool) -> None:
        text = json.dumps(_plain(identity), indent=1, ensure_ascii=False)
        self._key = hashlib.sha256(text.encode()).hexdigest()
        self._folder = _folder(output)
        self._stages = 0
        self._taken = 0
        self._start = 0
        self._writer = ShardWriter((), self._place)
        if not resume:
            remove(output)
        try:
            self._folder.mkdir(exist_ok=True)
            for leftover in self._folder.glob(".unfinished-*"):
                leftover.unlink()
            write_whole(self._folder / MANIFEST, text.encode())
        except OSError as error:
            raise self._failure(error) from error
        if resume:
            log.info("resumed: %d shards in %s", len(list(self._folder.glob(f"*{SUFFIX}"))), self._folder)

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *details: object) -> None:
        try:
            self._kept(self._writer.flush)
        except FemsealError as failure:
            if error is None:
                raise
            log.warning("%s", failure)
        if self._taken and isinstance(error, Exception) and not isinstance(error, FemsealError):
            reason = f"{type(error).__name__}: {shortened(error)}"
            text = f"a run with {self._taken} items from '{self._folder}' stopped ({reason})"
            raise FemsealError(f"resume: {text}; if they were changed, remove that folder to start anew") from error

    def over(self, mapper: Mapper) -> Mapper:
        """The same mapper, but items in shards are read from them, and computed items are written to shards."""

        def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            self._stages += 1
            header = self._key, stage.name
            shards = deque(self._intact(header))
            left = (_left(iterable, list(shards)) for iterable in iterables)
            computed = iter(mapper(stage, *left))
            self._start = 0
            self._writer = ShardWriter(header, self._place)
            while True:
                if shards and shards[0].start == self._start + len(self._writer):
                    self._kept(self._writer.flush)
                    shard = shards.popleft()
                    self._start = shard.stop
                    self._taken += shard.stop - shard.start
                    yield from map(unpacked, read_shard(shard.path, header))
                    continue
                try:
                    item = next(computed)
                except StopIteration:
                    break
                self._kept(self._writer.keep, item)
                yield item
            self._kept(self._writer.flush)

        return mapping

    def _place(self, count: int) -> Path:
        """Path of a shard of so many items, which come after those that are kept."""
        start, self._start = self._start, self._start + count
        return self._folder / f"{self._stages:03d}-{start:09d}-{self._start:09d}{SUFFIX}"

    def _kept(self, write: Callable[..., None], *item: Any) -> None:
        """Call what may write a shard; an error of the disk says what is kept and what to do."""
        try:
            write(*item)
        except OSError as error:
            raise self._failure(error) from error

    def _intact(self, header: tuple[str, str]) -> Iterator[_Shard]:
        """Shards of this stage in order; damaged ones are removed and reported."""
        position = 0
        for path in sorted(self._folder.glob(f"{self._stages:03d}-*{SUFFIX}")):
            shard = _Shard.at(path)
            if shard is not None and shard.start >= position and shard.is_intact(header):
                position = shard.stop
                yield shard
                continue
            log.warning("checkpoint: %s is damaged; its items are computed again (%s)", path, header[1])
            self._kept(path.unlink, True)

    def _failure(self, error: OSError) -> NotKept:
        """What to say of a checkpoint that cannot be written: what is kept, and what to do."""
        if not self._folder.is_dir():
            text = f"checkpoint: '{self._folder}' was removed while the run went on, with the results in it"
            return NotKept(f"{text}; start the run again")
        shards = map(_Shard.at, self._folder.glob(f"*{SUFFIX}"))
        kept = sum(s.stop - s.start for s in shards if s is not None)
        todo = "make room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that"
        return NotKept(
            f"checkpoint: {error}; the results of {kept} items are kept in '{self._folder}': "
            f"{todo}, then a run with --resume goes on from there"
        )


@dataclass(frozen=True)
class _Shard:
    """Items `start` to `stop` of a stage."""

    path: Path
    start: int
    stop: int

    @classmethod
    def at(cls, path: Path) -> _Shard | None:
        """The shard of a file; None if it has the name of none."""
        match = _NAME.fullmatch(path.stem)
        if match is None or not int(match[2]) < int(match[3]):
            return None
        return cls(path, int(match[2]), int(match[3]))

    def is_intact(self, header: tuple[str, str]) -> bool:
        """Whether the file holds the items of a run and a stage, all of which can be read."""
        try:
            return len(read_shard(self.path, header)) == self.stop - self.start
        except (OSError, ValueError):
            return False


def _left(iterable: Iterable[Any], shards: list[_Shard]) -> Iterator[Any]:
    """The items that are in no shard."""
    iterator, position = iter(iterable), 0
    for shard in shards:
        yield from islice(iterator, shard.start - position)
        deque(islice(iterator, shard.stop - shard.start), maxlen=0)
        position = shard.stop
    yield from iterator


def _plain(identity: dict[str, Any]) -> Any:
    """Data as JSON returns it, with lists in place of tuples."""
    return json.loads(json.dumps(identity))


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys; lists of plain values stay whole."""
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(v, dict) for v in value)):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return {k: v for name, part in pairs for k, v in _flat(part, f"{key}.{name}" if key else str(name)).items()}
    return {key: value}
