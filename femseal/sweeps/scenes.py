"""Scenes: a case solved at many values of a few of its keys, each only for its leakage."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array
from ..base.errors import FemsealError, InputError
from ..base.files import made_folder, write_text
from ..base.leak_rates import LeakUnit
from ..base.stage import Mapper, Stage
from ..case.case import Case
from ..execution.lock import alone_in, await_parts
from ..execution.parts import Part, own_items, parts_of
from ..runs import job

#: Solved scenes in a folder: all that a run has, and those of a part.
SCENES, PART_SCENES = "scenes.json", "scenes-{}-of-{}.json"


def alone(case: Case) -> Case:
    """The case without all that its leakage does not need."""
    output = case.output.model_copy(
        update={"budget": False, "pictures": False, "report": False, "fields": False, "paraview": "none"}
    )
    surface = case.surface.model_copy(update={"filter_sensitivity": False})
    return case.model_copy(update={"output": output, "surface": surface, "compare": ()})


def leakage_of(case: Case, unit: LeakUnit, steps: NDArray[Any]) -> list[float]:
    """Leakage of a case that decides on classes, at some load steps in a unit; NaN where it could not be solved."""
    log = logging.getLogger("femseal")
    level = log.level
    log.setLevel(logging.ERROR)  # warnings of the case are not said again for each scene
    try:
        results = job.run(case, workers=1)
    except InputError:
        raise
    except FemsealError:
        return [float("nan")] * len(steps)
    finally:
        log.setLevel(level)
    values = np.abs(results.class_leakage[0][steps]) / results.class_basis.factor(unit)
    return [float(value) for value in values]


class Scenes:
    """Leakages of a case at values of a few of its keys, kept in a folder if there is one.

    A context in which no other run writes into the folder.

    answer : file of the folder that says that all scenes are solved; it is removed at the start.
    identity : all that the leakages depend on, as text. resume : take the scenes that the folder has.
    part : solve a part of the scenes, while others may be at work on theirs; it takes those that the folder has.

    Raises InputError: the folder has scenes of something else, or unfinished ones without `resume`.
    """

    def __init__(self, folder: Path | None, answer: str, identity: str, resume: bool, part: Part | None = None) -> None:
        self._folder, self._answer, self._part = folder, answer, part
        self._identity = hashlib.sha256(identity.encode()).hexdigest()
        self._known: dict[tuple[float, ...], list[float]] = {}
        self._used: list[tuple[float, ...]] = []
        self._lock, self._goes_on = ExitStack(), resume or part is not None
        if self._goes_on and folder is None:
            raise InputError("resume" if part is None else "part", part or True, "an output folder with it")
        if self._goes_on:
            self._read()
        elif folder is not None and self._files() and not (folder / answer).exists():
            given = f"'{folder}', which has scenes of an unfinished run"
            raise InputError("output", given, "another folder, or --resume")

    def _files(self) -> list[Path]:
        """The files with scenes in the folder."""
        folder = self._folder or Path()
        return [*folder.glob(SCENES), *folder.glob(PART_SCENES.format("*", "*"))]

    def _read(self) -> None:
        """Take the scenes that the folder has; InputError where they are of something else, or cannot be read."""
        for path in self._files():
            try:
                former = json.loads(path.read_text(encoding="utf-8"))
                found = {tuple(map(float, values)): list(map(float, leakage)) for values, leakage in former["scenes"]}
            except (OSError, ValueError, KeyError, TypeError):
                given = f"'{path}', which cannot be read"
                raise InputError("resume", given, "an intact file; remove it to start anew") from None
            if former.get("identity") != self._identity:
                expected = "another folder, or the same case, data, ranges and versions"
                raise InputError("resume", f"'{path}' of other data", expected)
            self._known |= found

    def _write(self, name: str) -> None:
        content = {"identity": self._identity, "scenes": list(self._known.items())}
        write_text((self._folder or Path()) / name, json.dumps(content))

    def __enter__(self) -> Scenes:
        if self._folder is not None:
            self._lock.enter_context(alone_in(made_folder(self._folder), self._part))
            if self._goes_on:  # a part may have ended since the first look
                self._read()
            if self._part is None:
                (self._folder / self._answer).unlink(missing_ok=True)
                if self._known:
                    self._write(SCENES)
                for name in (PART_SCENES.format("*", "*"), ".unfinished-*.json"):
                    for path in self._folder.glob(name):
                        path.unlink()
        return self

    def __exit__(self, *details: Any) -> None:
        self._lock.close()

    def solve(self, stage: Stage, mapper: Mapper, points: Array) -> Array:
        """Leakages (n, loads) of a stage of values (n, keys); each is written once it is solved.

        Raises PartsMissing: a part has solved its scenes, others are not there, of parts that are not under way.
        """
        wanted = [tuple(map(float, values)) for values in points]
        own = slice(*own_items(self._part or (1, 1), len(wanted)))
        missing = [point for point in wanted[own] if point not in self._known]
        solved: Iterable[list[float]] = mapper(stage, *zip(*missing, strict=True)) if missing else ()
        for point, leakage in zip(missing, solved, strict=True):
            self._known[point] = leakage
            if self._folder is not None:
                self._write(SCENES if self._part is None else PART_SCENES.format(*self._part))
        if self._part is not None and self._folder is not None:
            await_parts(self._folder, self._part, stage.name, partial(self._missing, self._part, wanted))
        self._used += wanted
        return np.array([self._known[point] for point in wanted])

    def _missing(self, part: Part, wanted: list[tuple[float, ...]]) -> list[int]:
        """Parts whose scenes of those that are wanted are not in the folder."""
        self._read()
        return parts_of((n for n, point in enumerate(wanted) if point not in self._known), part, len(wanted))

    def arrays(self) -> tuple[Array, Array]:
        """Values of the scenes that were asked for (n, keys), and their leakages (n, loads)."""
        return np.array(self._used), np.array([self._known[point] for point in self._used])
