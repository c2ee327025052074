"""Load steps whose state is that of an earlier step bit for bit, whose flow is not solved again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.stage import Mapper, Stage
from ..library import LinkTable
from ..loads import LoadProgramme


def first_equal(values: Sequence[Any] | NDArray[Any], steps: LoadProgramme) -> NDArray[np.int64]:
    """Number of the first step with the same array, or tuple of arrays, at the same pressure (steps,); else its own."""
    at: dict[float, list[int]] = {}
    found = np.arange(len(steps))
    for s, step in enumerate(steps):
        earlier = at.setdefault(step.pressure, [])
        found[s] = next((t for t in earlier if _same(values[t], values[s])), s)
        if found[s] == s:
            earlier.append(s)
    return found


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple):
        return all(_same(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b, equal_nan=True)


def first_equal_draws(kinds: Sequence[Sequence[LinkTable]], steps: LoadProgramme, sampler: str) -> NDArray[np.int64]:
    """`first_equal` of the permeabilities that links draw from tables, with samplers that draw whole histories."""
    if sampler not in ("history", "block"):
        return np.arange(len(steps))
    return first_equal([tuple(t.k[s] for tables in kinds for t in tables) for s in range(len(steps))], steps)


def repeated(first: NDArray[np.int64]) -> int:
    """Number of steps that are an earlier one again."""
    return int(np.count_nonzero(first != np.arange(first.size)))


def map_different(mapper: Mapper, stage: Stage, values: NDArray[Any], first: NDArray[np.int64]) -> Iterator[Any]:
    """Results of a stage for the array of every step, computed once for steps that `first_equal` found equal."""
    different = np.flatnonzero(first == np.arange(first.size))
    again = {*first.tolist()} if different.size < first.size else set()
    computed = iter(mapper(stage, [values[s] for s in different] if again else values))
    known: dict[int, Any] = {}
    for s, t in enumerate(first.tolist()):
        if s != t:
            yield known[t]
            continue
        result = next(computed)
        if s in again:
            known[s] = result
        yield result
    next(computed, None)  # a mapper may have something to do at its end
