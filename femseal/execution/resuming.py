"""Runs in a folder that are resumed, or are parts of one: these share a store.

A part computes its own items of every stage, and reads those of the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..base import Mapper, Stage
from ..store.digest import Unnamed
from ..store.store import Store
from ..store.unfinished import refuse_unfinished, resumable
from .lock import alone_in, await_parts
from .parts import Part, own_items, parts_of
from .run import Progress


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
        if resume:
            yield resumable(folder, identity)
        else:
            refuse_unfinished(folder)
            yield False


def over_store(
    mapper: Mapper, store: Store, folder: Path, part: Part | None, progress: Progress
) -> Mapper:
    """A mapper that reads results of a store and keeps others there; of a part, see `over_part`."""
    if part is None:
        return store.over(mapper)
    return over_part(mapper, store, folder, part, progress)


def over_part(mapper: Mapper, store: Store, folder: Path, part: Part, progress: Progress) -> Mapper:
    """A mapper that computes and keeps the part's own items, then awaits those of the others.

    folder : where the parts hold their locks. progress : called as progress(stage, done, total) for the own items.

    Raises PartsMissing: from the mapper; the own items are kept, and others are not there, of parts that are not
    under way.
    """
    kept = store.over(mapper)

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
