"""Leakage of a whole face at every step, of each measured place by itself, and of all places but it.

Places tell how much is known from so many of them. The flow of a step whose state is that of an earlier one bit for bit
is not solved again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper, Shown, Stage
from ..base.fields import PLACE, STEP, Field, declared
from ..base.shared_array import give_back, shared_empty
from ..face.piece_flow import Failed, FlowSettings, SolverCounts, attempt
from ..loads import LoadProgramme
from ..seal import RectangularSeal
from ..topography import Places
from ..topography.places import divided
from .face_flow import FaceFlow, resolved_flow
from .load_curves import least_counted
from .scene import Scene


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


@dataclass(frozen=True, eq=False)
class FaceLeakage:
    """Leakage through a whole face at every step, NaN where the flow failed.

    leakage : per length of seal (steps,) [m²/s]. fluid_pressure : (steps, n1, n2) [Pa], NaN in contact and in pockets.
    step_solvers : systems of every step by solver.
    """

    leakage: Array
    fluid_pressure: NDArray[np.float32]
    failures: tuple[str, ...]
    step_solvers: tuple[SolverCounts, ...]

    def solvers(self, first: NDArray[np.int64]) -> SolverCounts:
        """Number of systems by solver, those of equal steps once, see `first_equal`."""
        return SolverCounts.total(self.step_solvers[s] for s in np.flatnonzero(first == np.arange(first.size)))


def face_leakage(scene: Scene, flows: Iterable[FaceFlow | Failed]) -> FaceLeakage:
    """Leakage and fluid pressure of a scene from the flow through its whole face at every step."""
    seal, count = RectangularSeal(scene.surface.size, (1, 1)), len(scene.steps)
    leakage, pressure = np.full(count, np.nan), shared_empty((count, *scene.surface.shape), np.float32)
    failures, solvers = [], [SolverCounts()] * count
    for s, (step, flow) in enumerate(zip(scene.steps, flows, strict=True)):
        potential = None if isinstance(flow, Failed) else flow.potential
        pressure[s] = np.nan if potential is None else scene.pressure_at(potential)
        give_back(pressure)
        if isinstance(flow, Failed):
            failures.append(f"{step.name}: {flow.reason}")
            continue
        through = scene.leakage(seal, flow.permeability)
        leakage[s], solvers[s] = through.per_length, flow.solvers + SolverCounts.of(through)
    return FaceLeakage(leakage, pressure, tuple(failures), tuple(solvers))


#: Places from which on their scatter tells how far the leakage of more of them may lie.
FEWEST = 3


@dataclass(frozen=True, repr=False)
class PlaceLeakage(Shown):
    """Leakage by places (places, steps), NaN where the flow failed.

    alone : of each by itself, continued periodically. without : of all places but one, side by side; None of two.
    """

    alone: Array = declared("leakage_of_places", "m^2/s", "leakage per unit seal length, of each place alone", PLACE)
    without: Array | None = declared(
        "leakage_without_place", "m^2/s", "leakage per unit seal length, of all places but one", PLACE, default=None
    )

    computed_fields: ClassVar[dict[str, Field]] = {
        "scatter": Field(
            "place_scatter",
            "1",
            "standard deviation of the leakage of single places over its mean",
            STEP,
            "places ± [%]",
        )
    }

    @property
    def relative(self) -> Array:
        """Leakage of each place over that of their mean (places,), mean over the loads that count; 0 if none leaks."""
        mean = self.alone.mean(axis=0)
        counts = mean > least_counted(mean)
        return np.asarray((self.alone[:, counts] / mean[counts]).sum(axis=1) / max(1, counts.sum()))

    @property
    def scatter(self) -> Array:
        """Standard deviation of the leakage of single places over its mean (steps,); NaN where none leaks."""
        mean = self.alone.mean(axis=0)
        return np.divide(self.alone.std(axis=0, ddof=1), mean, out=np.full(mean.shape, np.nan), where=mean > 0)


def kept_places(count: int) -> tuple[tuple[int, ...], ...]:
    """Numbers of the places, from 1, of which a leakage is wanted: each alone, and from three on all but each.

    >>> kept_places(3)
    ((1,), (2,), (3,), (2, 3), (1, 3), (1, 2))
    """
    every = range(1, count + 1)
    without = [tuple(m for m in every if m != n) for n in every] if count >= FEWEST else []
    return (*((n,) for n in every), *without)


def place_leakage(scene: Scene, gap: NDArray[np.floating], mapper: Mapper = map) -> PlaceLeakage | None:
    """Leakage by places from the gap of all of them at every step (steps, n1, n2) [m]; None of a single place."""
    surface = scene.surface
    if not isinstance(surface, Places):
        return None
    count = len(surface.widths)
    solve = partial(permeabilities_of_places, widths=surface.widths, spacing=surface.spacing, settings=scene.flow)
    found = map_different(mapper, Stage("flow of places", solve), gap, first_equal(gap, scene.steps))
    # leakage per length of a unit permeability
    unit = scene.leakage(RectangularSeal(surface.size, (1, 1)), 1.0).per_length
    leakage = unit * np.array(list(found)).T
    return PlaceLeakage(leakage[:count], leakage[count:] if count >= FEWEST else None)


def permeabilities_of_places(
    gap: NDArray[np.floating], widths: tuple[int, ...], spacing: tuple[float, float], settings: FlowSettings
) -> Array:
    """Permeability of each place, and from three on of all but each (2 places,) [m³]; NaN where the flow failed."""
    pieces = divided(gap, widths)
    found = []
    for of in kept_places(len(pieces)):
        flow = attempt(resolved_flow, np.concatenate([pieces[n - 1] for n in of], axis=1), spacing, settings)
        found.append(np.nan if isinstance(flow, Failed) else flow.permeability)
    return np.array(found)
