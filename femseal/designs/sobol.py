"""Global sensitivity of the leakage: Sobol indices over ranges of a few keys of a case, by a surrogate of few scenes.

The first-order index of a key is the part of the variance of ln(leakage) that it explains alone, the total index that
with all its interactions (Saltelli et al., Comput. Phys. Commun. 181, 2010). Keys are uniform over their ranges, in the
logarithm where a range is above 0.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc, sobol_indices, uniform

from ..base import (
    Array,
    FemsealError,
    InputError,
    Stage,
    TextTable,
    comma_separated,
    numerical_versions,
    shown,
    validate,
    write_text,
)
from ..base.leak_rates import leak_unit
from ..case.case import Case, read_case
from ..execution.mappers import ordered_map
from ..execution.run import Progress, Run, no_progress
from ..loads import LoadStep
from ..preparation.preparation import prepare
from ..runs import job
from ..runs.forecast import refuse_too_large
from ..studies.compiling import compile_ahead
from ..sweeps.scenes import SCENES, Scenes, Surrogate, alone, leakage_of
from ..sweeps.variations import short_names, value_text, variations

FILE, TABLE = "sobol.json", "sobol.csv"
#: Points of the surrogate for each index, a power of two.
_POINTS = 2**11
#: Fewest scenes, and most keys.
_FEWEST, _MOST_KEYS = 10, 8
_AMOUNT = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


@dataclass(frozen=True)
class KeyRange:
    """A key of a case and its range, in its unit."""

    key: str
    low: float
    high: float
    unit: str

    @classmethod
    def of(cls, key: str, ends: Sequence[Any]) -> KeyRange:
        """A range of two values as in the case file, with the same unit; InputError otherwise."""
        expected = "two values of one unit that rise, such as '2 GPa', '4 GPa'"
        matches = [_AMOUNT.fullmatch(value_text(end)) for end in ends]
        if len(matches) != 2 or not matches[0] or not matches[1] or matches[0][2] != matches[1][2]:
            raise InputError(f"sobol: {key}", shown(ends), expected)
        low, high = float(matches[0][1]), float(matches[1][1])
        if not low < high:
            raise InputError(f"sobol: {key}", shown(ends), expected)
        return cls(key, low, high, matches[0][2])

    def at(self, place: float) -> Any:
        """The value at a place from 0 to 1, as the case file has it."""
        value = self.low + place * (self.high - self.low)
        if self.low > 0:
            value = self.low * (self.high / self.low) ** place
        return f"{value:.9g} {self.unit}" if self.unit else float(f"{value:.9g}")


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Sobol indices of ln(leakage) at load steps.

    keys : ranges. steps : of the case. first, total : indices (steps, keys), NaN where a scene is sealed or nothing
    varies. error : of ln(leakage) by the surrogate, its median over the ranges (steps,). spread : standard deviation of
    ln(leakage) over the ranges (steps,). scenes : how many were solved.
    """

    keys: tuple[KeyRange, ...]
    steps: tuple[LoadStep, ...]
    first: Array
    total: Array
    error: Array
    spread: Array
    scenes: int

    def table(self) -> TextTable:
        """A line for each load step, to be given to `rich.print`."""
        columns = [("load", [step.name for step in self.steps]), ("spread of ln L", [_text(x) for x in self.spread])]
        for n, name in enumerate(short_names([one.key for one in self.keys])):
            columns.append((f"{name} total", [_text(x) for x in self.total[:, n]]))
            columns.append((f"{name} alone", [_text(x) for x in self.first[:, n]]))
        columns.append(("error of ln L", [_text(x) for x in self.error]))
        return TextTable.of_columns(f"Sobol indices of ln(leakage), {self.scenes} solved scenes", columns, wrap=14)

    def write(self, folder: Path) -> list[Path]:
        """Write `sobol.csv` and `sobol.json` into a folder that exists."""
        rows = [
            {"step": step.name, "nominal_pressure_Pa": step.pressure, "spread": self.spread[s], "error": self.error[s]}
            | {f"total {one.key}": self.total[s, n] for n, one in enumerate(self.keys)}
            | {f"first {one.key}": self.first[s, n] for n, one in enumerate(self.keys)}
            for s, step in enumerate(self.steps)
        ]
        ranges = {one.key: [value_text(one.at(0.0)), value_text(one.at(1.0))] for one in self.keys}
        plain = [{key: None if value != value else value for key, value in row.items()} for row in rows]
        text = json.dumps({"ranges": ranges, "scenes": self.scenes, "indices": plain}, indent=1, ensure_ascii=False)
        return [write_text(folder / TABLE, comma_separated(rows)), write_text(folder / FILE, text)]


def _text(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"


def sobol(
    path: str | os.PathLike[str],
    ranges: Mapping[str, Sequence[Any]],
    output: str | os.PathLike[str] | None = None,
    *,
    scenes: int = 40,
    workers: int | None = None,
    progress: Progress | None = None,
) -> SobolIndices:
    """Sobol indices of the leakage of a case over ranges of some of its keys.

    path : a case file. ranges : two values for each dotted key, such as {"material.hardness": ["2 GPa", "4 GPa"]}; keys
    of the loads excepted. output : folder for the table; solved scenes that it has are taken.
    scenes : solved at a Sobol sequence over the ranges. workers, progress : see `run`.

    Raises InputError: the case, a key or a range cannot be used; nothing has been computed then.
    FemsealError : too few scenes could be solved.
    """
    keys = tuple(KeyRange.of(key, ends) for key, ends in ranges.items())
    if not 1 <= len(keys) <= _MOST_KEYS or any(one.key.split(".")[0] == "load" for one in keys):
        given = ", ".join(one.key for one in keys) or "none"
        raise InputError("sobol", given, f"1 to {_MOST_KEYS} keys of the case, not those of the load")
    validate.count("scenes", scenes, _FEWEST)
    data, base = read_case(path)
    sequence = qmc.Sobol(len(keys), rng=np.random.default_rng(1))
    points = sequence.random_base2(int(np.ceil(np.log2(scenes))))[:scenes]
    for point in points:
        case = case_at(data, base, keys, point)
        refuse_too_large(case, prepared := prepare(case))
    steps = prepared.scene.steps
    folder = None if output is None else Path(output)
    identity = json.dumps([case.echo(), shown(keys), len(steps), job.face_files(case), numerical_versions()])
    known = folder is not None and (folder / SCENES).exists()
    before = partial(compile_ahead, progress=progress or no_progress)
    with Scenes(folder, FILE, identity, known) as store, ordered_map(workers, before=before) as mapper:
        with Run(mapper, progress or no_progress).timed("Sobol indices") as watched:
            stage = Stage("scenes", partial(_leakage, data, base, keys, len(steps)))
            leakage = store.solve(stage, watched, points)
        found = indices_of(keys, tuple(steps), points, leakage)
        if folder is not None:
            found.write(folder)
    return found


def case_at(data: dict[str, Any], base: Path, keys: Sequence[KeyRange], point: Any) -> Case:
    """The case at a point of the unit cube, with nothing but what its leakage needs."""
    values = {one.key: [one.at(float(place))] for one, place in zip(keys, point, strict=True)}
    return alone(variations(data, base, values)[0].case)


def _leakage(data: dict[str, Any], base: Path, keys: tuple[KeyRange, ...], steps: int, *point: float) -> list[float]:
    return leakage_of(case_at(data, base, keys, point), leak_unit("m²/s"), np.arange(steps))


def indices_of(keys: tuple[KeyRange, ...], steps: tuple[LoadStep, ...], points: Array, leakage: Array) -> SobolIndices:
    """Indices of leakages (n, steps) at points (n, keys) of the unit cube; those with NaN are left out."""
    solved = np.isfinite(leakage).all(axis=1)
    if solved.sum() < _FEWEST:
        raise FemsealError(f"sobol: only {int(solved.sum())} of {len(points)} scenes could be solved")
    points, leakage = points[solved], leakage[solved]
    first, total = (np.full((len(steps), len(keys)), np.nan) for _ in range(2))
    error, spread = (np.full(len(steps), np.nan) for _ in range(2))
    # a scene that is sealed has no logarithm
    open_ = np.flatnonzero((leakage > 0).all(axis=0) & (np.ptp(leakage, axis=0) > 0))
    if open_.size:
        surrogate = Surrogate.through(points, leakage[:, open_], jumps=tuple(range(len(keys))))

        def mean(x: Array) -> Array:
            return np.ascontiguousarray(surrogate.at(x.T)[0].T)

        found = sobol_indices(func=mean, n=_POINTS, dists=[uniform()] * len(keys), rng=1)
        first[open_] = np.reshape(found.first_order, (open_.size, len(keys)))
        total[open_] = np.reshape(found.total_order, (open_.size, len(keys)))
        levels, deviation, _ = surrogate.at(np.random.default_rng(2).random((_POINTS, len(keys))))
        error[open_], spread[open_] = np.median(deviation, axis=0), levels.std(axis=0)
    return SobolIndices(keys, steps, first, total, error, spread, int(solved.sum()))
