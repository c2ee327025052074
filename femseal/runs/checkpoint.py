"""Results of an unfinished run on disk, so that it can be resumed after a kill at any moment.

Every call of the mapper in a study is a stage; the order of the calls depends on the case alone. Results of
consecutive items are kept in shards, each a file that is complete or not there, with a checksum. A resumed run makes
the same calls, takes the items of intact shards from their files and computes the others.

Shards are pickles: only the versions that wrote them read them back, and only in a folder that you trust. They are no
exchange format; `results.nc` is.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
import pickle
import shutil
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from ..base.errors import FemsealError, InputError
from ..base.files import replacing
from ..base.stage import Mapper, Stage

log = logging.getLogger("femseal.runs.checkpoint")
#: Subfolder of the output folder.
FOLDER = ".checkpoint"
MANIFEST = "manifest.json"
#: A shard is written when it has this number of items or bytes, or when this time has passed since the last one [s].
SHARD_ITEMS = 1000
SHARD_BYTES = 64_000_000
SHARD_SECONDS = 10.0


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
    path = output / FOLDER / MANIFEST
    try:
        former = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:
        given = f"'{path}', which cannot be read ({error})"
        allowed = f"an intact checkpoint; remove '{path.parent}' to start anew"
        raise InputError.of("resume", given, allowed) from None
    old, new = _flat(former), _flat(_plain(identity))
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    if changed:
        lines = [f"{key}: was {old.get(key, 'not given')}, is {new.get(key, 'not given')}" for key in changed]
        allowed = f"that of the same case, files and versions; remove '{path.parent}' to start anew"
        raise InputError("\n".join([f"resume: given a checkpoint of another run, allowed is {allowed}", *lines]))
    return True


def refuse_unfinished(output: Path) -> None:
    """Raise InputError if the output folder has an unfinished run, whose results a new run would remove."""
    kept = len(list((output / FOLDER).glob("*.shard")))
    if kept:
        given = f"'{output}', which holds {kept} parts of an unfinished run"
        allowed = f"--resume to go on; another folder, or none of '{output / FOLDER}', to start anew"
        raise InputError.of("output", given, allowed)


def remove(output: Path) -> None:
    """Remove the checkpoint from the output folder, if there is one.

    Raises
    ------
    FemsealError : the checkpoint could not be removed.
    """
    folder = output / FOLDER
    try:
        # without its manifest the checkpoint is never resumed, even if other files remain
        (folder / MANIFEST).unlink(missing_ok=True)
        if folder.exists():
            shutil.rmtree(folder)
    except OSError as error:
        raise FemsealError(f"checkpoint: '{folder}' could not be removed ({error.strerror})") from error


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
        self._folder = output / FOLDER
        self._stages = 0
        self._stage = ""
        self._pending: list[bytes] = []
        self._start = 0
        self._since = time.monotonic()
        if not resume:
            remove(output)
        try:
            self._folder.mkdir(exist_ok=True)
            for leftover in self._folder.glob(".unfinished-*"):
                leftover.unlink()
            _write(self._folder / MANIFEST, text.encode())
        except OSError as error:
            raise self._failure(error) from error
        if resume:
            log.info("resumed: %d shards in %s", len(list(self._folder.glob("*.shard"))), self._folder)

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, kind: type[BaseException] | None, *details: object) -> None:
        try:
            self._flush()
        except FemsealError as error:
            if kind is None:
                raise
            log.warning("%s", error)

    def over(self, mapper: Mapper) -> Mapper:
        """The same mapper, but items in shards are read from them, and computed items are written to shards."""

        def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            self._stages += 1
            self._stage = stage.name
            shards = deque(self._intact())
            left = (_left(iterable, list(shards)) for iterable in iterables)
            computed = iter(mapper(stage, *left))
            self._start, self._since = 0, time.monotonic()
            while True:
                if shards and shards[0].start == self._start + len(self._pending):
                    self._flush()
                    shard = shards.popleft()
                    self._start = shard.stop
                    yield from shard.items()
                    continue
                try:
                    item = next(computed)
                except StopIteration:
                    break
                self._keep(item)
                yield item
            self._flush()

        return mapping

    def _keep(self, item: Any) -> None:
        self._pending.append(pickle.dumps(item, protocol=5))
        full = len(self._pending) >= SHARD_ITEMS or sum(map(len, self._pending)) >= SHARD_BYTES
        if full or time.monotonic() - self._since >= SHARD_SECONDS:
            self._flush()

    def _flush(self) -> None:
        """Write the pending items as a shard."""
        if not self._pending:
            return
        items, self._pending = self._pending, []
        shard = _Shard.of(self._folder, self._stages, self._start, self._start + len(items))
        try:
            _write(shard.path, _sealed(pickle.dumps((self._key, self._stage, items), protocol=5)))
        except OSError as error:
            raise self._failure(error) from error
        self._start, self._since = shard.stop, time.monotonic()

    def _intact(self) -> Iterator[_Shard]:
        """Shards of this stage in order; damaged ones are removed and reported."""
        for path in sorted(self._folder.glob(f"{self._stages:03d}-*.shard")):
            shard = _Shard.at(path)
            try:
                intact = shard.content()[:2] == (self._key, self._stage)
            except (OSError, ValueError):
                intact = False
            if intact:
                yield shard
            else:
                log.warning("checkpoint: %s is damaged; its items are computed again (%s)", path, self._stage)
                path.unlink(missing_ok=True)

    def _failure(self, error: OSError) -> FemsealError:
        kept = sum(s.stop - s.start for s in map(_Shard.at, self._folder.glob("*.shard")))
        todo = "make room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "mend that"
        return FemsealError(
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
    def of(cls, folder: Path, stage: int, start: int, stop: int) -> _Shard:
        return cls(folder / f"{stage:03d}-{start:09d}-{stop:09d}.shard", start, stop)

    @classmethod
    def at(cls, path: Path) -> _Shard:
        start, stop = (int(n) for n in path.stem.split("-")[1:])
        return cls(path, start, stop)

    def content(self) -> tuple[str, str, list[bytes]]:
        """Key of the run, name of the stage and pickled items; ValueError where the file is damaged."""
        return pickle.loads(_unsealed(self.path.read_bytes()))

    def items(self) -> Iterator[Any]:
        """The items."""
        return map(pickle.loads, self.content()[2])


def _left(iterable: Iterable[Any], shards: list[_Shard]) -> Iterator[Any]:
    """The items that are in no shard."""
    iterator, position = iter(iterable), 0
    for shard in shards:
        yield from islice(iterator, shard.start - position)
        deque(islice(iterator, shard.stop - shard.start), maxlen=0)
        position = shard.stop
    yield from iterator


def _sealed(content: bytes) -> bytes:
    return hashlib.sha256(content).digest() + content


def _unsealed(data: bytes) -> bytes:
    size = hashlib.sha256().digest_size
    if hashlib.sha256(data[size:]).digest() != data[:size]:
        raise ValueError("checksum")
    return data[size:]


def _write(path: Path, data: bytes) -> None:
    """Write a file completely to disk before it gets its name."""
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _plain(identity: dict[str, Any]) -> Any:
    """Data as JSON returns it, with lists in place of tuples."""
    return json.loads(json.dumps(identity))


def _flat(value: Any, key: str = "") -> dict[str, Any]:
    """Nested tables as dotted keys; lists of plain values stay whole."""
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(v, dict) for v in value)):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return {k: v for name, part in pairs for k, v in _flat(part, f"{key}.{name}" if key else str(name)).items()}
    return {key: value}
