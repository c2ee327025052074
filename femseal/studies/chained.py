"""Seals drawn as chains of runs of columns of a face, see `scales.column_runs`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..base.stage import Mapper, Stage
from ..scales import Failed, SolverCounts, attempt
from ..scales.window_fields import WindowFields
from ..seal import RectangularSeal
from .element_face import flow_through_runs
from .scene import Array, Scene

#: Columns of a run as a share of those of the face: realisations differ by the runs that they draw, and the fewer runs
#: a face has the less they can differ.
RUN_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class ChainedSeals:
    """Realisations of a seal as a chain of runs: leakage per length (realisations, steps) [m²/s], NaN at failed steps.

    leakage : between both bounds, where the mean over the runs of the face is the leakage of the face itself.
    closed, held : with closed cuts between runs, and with all cuts held at one profile of the fluid pressure.
    resampled : as many more realisations, each from runs that are drawn with repetition from those of the face.
    columns : columns of windows of the seal.
    """

    leakage: Array
    closed: Array
    held: Array
    resampled: Array
    columns: int
    failures: tuple[str, ...]
    solvers: SolverCounts


def chained_seals(
    scene: Scene, fields: WindowFields, columns: int, realisations: int, seed: int, *, mapper: Mapper = map
) -> ChainedSeals:
    """Draw seals of about so many columns of windows as chains of runs of the face, and add their leakages up.

    Random numbers depend on (seed, realisation, run) only: run n of a longer seal is what run n of a shorter one is.
    """
    partition = fields.partition
    m2 = partition.cells[1]
    length = max(1, min(round(RUN_SHARE * m2), columns))
    runs = max(1, round(columns / length))
    solve = partial(attempt, flow_through_runs, partition=partition, length=length, drop=scene.flow.drop)
    stage = Stage("runs of columns", solve)
    found = list(mapper(stage, fields.gap))
    failures, solvers = [], SolverCounts()
    starts = max((f.value.size for f in found if not isinstance(f, Failed)), default=1)
    value, closed, held = np.full((3, starts, len(found)), np.nan)
    for s, (step, flow) in enumerate(zip(scene.steps, found, strict=True)):
        if isinstance(flow, Failed):
            failures.append(f"runs, {step.name}: {flow.reason}")
        else:
            value[:, s], closed[:, s], held[:, s] = flow.value, flow.closed, flow.held
            solvers += flow.solvers
    size = partition.shape[0] * partition.spacing[0], length * partition.window_size[1]
    # leakage per length of a run of conductance 1 m³, and so of a seal whose runs have the mean conductance 1 m³
    unit = scene.leakage(RectangularSeal(size, (1, 1)), size[0] / size[1]).per_length
    drawn, again = np.zeros((2, realisations, starts))
    independent = max(1, m2 // length)
    for n in range(realisations):
        place = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(n,)))).random(runs)
        drawn[n] = np.bincount((place * starts).astype(np.int64), minlength=starts)
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(n, 2)))
        library = rng.integers(starts, size=independent)
        again[n] = np.bincount(library[rng.integers(independent, size=runs)], minlength=starts)
    per_length = unit / runs
    return ChainedSeals(
        leakage=per_length * drawn @ value,
        closed=per_length * drawn @ closed,
        held=per_length * drawn @ held,
        resampled=per_length * again @ value,
        columns=runs * length,
        failures=tuple(failures),
        solvers=solvers,
    )
