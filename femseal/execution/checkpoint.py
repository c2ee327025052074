"""Results of an unfinished run on disk, so that it can be resumed after a kill at any moment.

Every call of the mapper in a study is a stage; the order of the calls depends on the case alone. Results of
consecutive items are kept in shards, each a file that is complete or not there, with a checksum. A resumed run makes
the same calls, takes the items of intact shards from their files and computes the others, see `store`. Parts of a run
make them too, each computes its own items, and takes those of the others when they are there. Shards are no exchange
format; `results.nc` is one.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import re
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ..base import FemsealError, InputError, Mapper, NotKept, Stage, counted, read_plain, shortened
from .lock import await_parts
from .parts import Part, missing_parts, own_items, parts_of
from .plain_data import unpacked
from .run import Progress, no_progress
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

    output : the output folder.
    identity : everything on which the bits of the results depend, as nested plain data.

    Raises InputError: the checkpoint is unreadable or of another identity; every changed key is named with both
    values.
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
        lines += [counted(len(changed) - _MOST_CHANGES, "more key")] if len(changed) > _MOST_CHANGES else []
        expected = f"that of the same case, files and versions; remove '{path.parent}' to start anew"
        raise InputError("resume", "a checkpoint of another run", "\n".join([expected, *lines]))
    return True


def refuse_unfinished(output: Path) -> None:
    """Raise InputError if the output folder has an unfinished run, whose results a new run would remove."""
    if any(_folder(output).glob(f"*{SUFFIX}")):
        given = f"'{output}', which holds an unfinished run"
        expected = f"--resume to go on, or another folder; to start anew, remove '{output / FOLDER}'"
        raise InputError("output", given, expected)


def remove(output: Path) -> None:
    """Remove the checkpoint from the output folder, if there is one.

    Raises FemsealError: the checkpoint could not be removed.
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

    output : the output folder, which exists.
    identity : what the bits of the results depend on, as nested plain data.
    resume : go on with what is there, found `resumable`; else it is removed.
    part : this process computes its own items only; others may be at work on theirs in the same folder.
    progress : called as progress(stage, done, total) while a part computes its own items.

    Raises PartsMissing: from the mappers made by `over`: a part's own items of a stage are kept, and others are not
    there, of parts that are not under way.
    FemsealError : the folder cannot be written, also from the mappers made by `over`: what is kept stays.
    """

    def __init__(
        self,
        output: Path,
        identity: dict[str, Any],
        resume: bool,
        part: Part | None = None,
        progress: Progress = no_progress,
    ) -> None:
        text = json.dumps(_plain(identity), indent=1, ensure_ascii=False)
        self._key = hashlib.sha256(text.encode()).hexdigest()
        self._folder = _folder(output)
        self._part, self._progress = part, progress
        self._stages = 0
        self._taken = 0
        self._next = 0
        self._writer = ShardWriter((), self._place)
        if not resume and part is None:
            remove(output)
        try:
            self._folder.mkdir(exist_ok=True)
            if part is None:  # other parts may be writing theirs
                for leftover in self._folder.glob(".unfinished-*"):
                    leftover.unlink()
            write_whole(self._folder / MANIFEST, text.encode())
        except OSError as error:
            raise self._failure(error) from error
        if resume:
            log.info("resumed from %s", self._folder)

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
            text = f"a run with {counted(self._taken, 'item')} from '{self._folder}' stopped ({reason})"
            raise FemsealError(f"resume: {text}; if they were changed, remove that folder to start anew") from error

    def over(self, mapper: Mapper) -> Mapper:
        """The same mapper, but items in shards are read from them, and computed items are written to shards."""

        def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            self._stages += 1
            if self._part is None:
                yield from self._through(mapper, stage, iterables)
            else:
                yield from self._shared(mapper, self._part, stage, iterables)

        return mapping

    def _shared(self, mapper: Mapper, part: Part, stage: Stage, iterables: Sequence[Iterable[Any]]) -> Iterator[Any]:
        """The items of a stage that parts compute, once those of this part are kept."""
        if not any(isinstance(iterable, Sized) for iterable in iterables):
            iterables = tuple(zip(*zip(*iterables, strict=False), strict=True))
        count = min((len(iterable) for iterable in iterables if isinstance(iterable, Sized)), default=0)
        start, stop = own_items(part, count)
        own = f"part {part[0]}/{part[1]}: {stage.name}"
        for done, _ in enumerate(self._through(mapper, stage, iterables, start, stop), start=1):
            self._progress(own, done, stop - start)
        shards: list[_Shard] = []

        def missing() -> list[int]:
            there = np.zeros(count, bool)
            shards[:] = self._found(stage, 0, count, check=False)
            for shard in shards:
                there[shard.used.start : shard.used.stop] = True
            return parts_of(np.flatnonzero(~there).tolist(), part, count)

        await_parts(self._folder.parent, part, stage.name, missing)
        for shard in shards:
            try:
                yield from self._items(stage, shard)
            except (OSError, ValueError) as error:
                log.warning("checkpoint: %s cannot be read (%s)", shard.path, error)
                raise missing_parts(part, stage.name, parts_of(shard.used, part, count)) from None

    def _through(
        self, mapper: Mapper, stage: Stage, iterables: Sequence[Iterable[Any]], start: int = 0, stop: int | None = None
    ) -> Iterator[Any]:
        """Results of a range of items: those in shards, and the others computed and kept."""
        shards = deque(self._found(stage, start, stop, check=True))
        ranges = [shard.used for shard in shards]
        left = [_left(islice(items, start, stop), start, ranges) for items in iterables]
        computed = iter(mapper(stage, *left))
        self._next = start
        self._writer = ShardWriter((self._key, stage.name), self._place, merge=True)
        added = False
        while True:
            if shards and shards[0].used.start == self._next:
                self._kept(self._writer.flush)
                shard = shards.popleft()
                self._next = shard.used.stop
                self._taken += len(shard.used)
                if shard.used == shard.items:
                    self._writer.follow(shard.path, len(shard.items))
                yield from self._items(stage, shard)
                continue
            try:
                item = next(computed)
            except StopIteration:
                break
            self._next += 1
            added = True
            self._kept(self._writer.keep, item)
            yield item
        if added:  # else shards stay as they are
            self._kept(self._writer.flush, True)

    def _items(self, stage: Stage, shard: _Shard) -> Iterator[Any]:
        """The items of a shard that are used."""
        first = shard.items.start
        items = read_shard(shard.path, (self._key, stage.name))[shard.used.start - first : shard.used.stop - first]
        yield from map(unpacked, items)

    def _place(self, count: int) -> Path:
        """Path of a shard of so many items, up to the one that was kept last."""
        return self._folder / f"{self._stages:03d}-{self._next - count:09d}-{self._next:09d}{SUFFIX}"

    def _kept(self, write: Callable[..., None], *values: Any) -> None:
        """Call what may write a shard; an error of the disk says what is kept and what to do."""
        try:
            write(*values)
        except OSError as error:
            raise self._failure(error) from error

    def _found(self, stage: Stage, start: int, stop: int | None, check: bool) -> Iterator[_Shard]:
        """Shards with items of a range of the last stage by their names, in order; `check`: and by what is in them."""
        there = [_Shard.at(path) for path in self._folder.glob(f"{self._stages:03d}-*{SUFFIX}")]
        # of those that begin with the same item the longest comes first, which the others were merged into
        for shard in sorted(there, key=lambda s: (s.items.start, -s.items.stop, s.path)):
            last = shard.items.stop if stop is None else min(shard.items.stop, stop)
            used = range(max(shard.items.start, start), last)
            if (used or (check and not shard.items)) and not (check and self._is_damaged(stage, shard)):
                start = used.stop
                yield replace(shard, used=used)

    def _is_damaged(self, stage: Stage, shard: _Shard) -> bool:
        """Whether the items of a shard cannot be read; then it is reported and removed."""
        with suppress(OSError, ValueError):
            if len(read_shard(shard.path, (self._key, stage.name))) == len(shard.items) > 0:
                return False
        log.warning("checkpoint: %s is damaged; its items are computed again (%s)", shard.path, stage.name)
        self._kept(shard.path.unlink, True)
        return True

    def _failure(self, error: OSError) -> NotKept:
        """What to say of a checkpoint that cannot be written: what is kept, and what to do."""
        if not self._folder.is_dir():
            text = f"checkpoint: '{self._folder}' was removed while the run went on, with the results in it"
            return NotKept(f"{text}; start the run again")
        kept = sum(len(_Shard.at(path).items) for path in self._folder.glob(f"*{SUFFIX}"))
        todo = "make room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that"
        return NotKept(
            f"checkpoint: {error}; the results of {counted(kept, 'item')} are kept in '{self._folder}': "
            f"{todo}, then a run with --resume goes on from there"
        )


@dataclass(frozen=True)
class _Shard:
    """A file with a range of the items of a stage, none if it has the name of none, and those that are used."""

    path: Path
    items: range
    used: range = range(0)

    @classmethod
    def at(cls, path: Path) -> _Shard:
        """The shard of a file by its name."""
        match = _NAME.fullmatch(path.stem)
        return cls(path, range(int(match[2]), int(match[3])) if match else range(0))


def _left(iterator: Iterator[Any], position: int, taken: Iterable[range]) -> Iterator[Any]:
    """The items from a position on that are in none of some ranges."""
    for items in taken:
        yield from islice(iterator, items.start - position)
        deque(islice(iterator, len(items)), maxlen=0)
        position = items.stop
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
