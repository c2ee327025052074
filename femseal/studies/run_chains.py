"""Seals drawn as chains of runs of columns of a face, see `library.column_runs`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper, Stage, counted, to_text
from ..flow.pressure_drop import PressureDrop
from ..library import RunFlows
from ..library.sampling import drawn_elsewhere
from ..seal import RectangularSeal
from ..windows import Failed, Partition, SolverCounts, WindowFields, attempt
from .face_flow import columns_of_face
from .face_leakage import first_equal, map_different
from .scene import Scene

#: Columns of the face over those of a run. The first is taken by which cuts matter less than the finite library: the
#: shorter the runs, the better it is known how realisations scatter.
COLUMNS_OVER_RUN = (8, 4, 2)
#: Half the distance of the bounds of ln(leakage) from which on a run warns: bounds a factor of ten apart say little.
WIDE = 1.15
#: Fraction of the first step's flow from which on a step counts for that.
_COUNTS = 1e-3
#: Fraction of the length of a seal from which on a run warns that whole runs make it longer or shorter.
_ROUNDED = 0.05


@dataclass(frozen=True, eq=False)
class StateRuns:
    """Runs of a face at one state.

    flows : of the runs, for each length in columns. k : permeability of every window (m1, m2) [m³].
    potential, flux : in every window of the uncut face the viscous potential between 1 at the inlet and 0 at the
        outlet (m1, m2), NaN where contact or pockets fill it, and the flow per width for a unit drop (m1, m2, 2) [m²].
    """

    flows: tuple[RunFlows, ...]
    k: Array
    potential: Array
    flux: Array
    solvers: SolverCounts

    @classmethod
    def of(
        cls, gap: NDArray[np.floating], partition: Partition, lengths: tuple[int, ...], drop: PressureDrop
    ) -> StateRuns:
        """Solve the runs of a gap (n1, n2) [m]."""
        columns, own = columns_of_face(gap, partition, drop)
        # rounding may give the potential an extreme inside
        factor, potential = own.mean_factor, own.viscous_fraction(np.clip(columns.window_potential(), 0.0, 1.0))
        flows = tuple(
            replace(f, neumann=factor * f.neumann, dirichlet=factor * f.dirichlet, whole=factor * f.whole)
            for f in (columns.flows(length) for length in lengths)
        )
        solvers = SolverCounts.total([SolverCounts.of(columns.face), *(f.solvers for f in flows)])
        return cls(flows, factor * columns.window_permeability(), potential, factor * columns.window_flux(), solvers)


@dataclass(frozen=True, eq=False)
class ChainedSeals:
    """Realisations of a seal as a chain of runs: leakage per length (realisations, steps) [m²/s], NaN at failed steps.

    leakage : between both bounds, where the mean over the runs of the face is the leakage of the face itself.
    neumann, dirichlet : if nothing flows through the cuts between runs, and with one profile of the fluid pressure
        along all of them.
    resampled : as many more realisations, each from runs that are drawn with repetition from those of the face.
    columns : columns of windows of the seal. length : those of a run.
    of_face : leakage per length of the face itself, uncut (steps,) [m²/s].
    starts : first columns of the runs on the face. ends : numbers of the places in which each run begins and ends
    (2, runs); none is followed by one that begins in the place where it ends, unless there is one place only.
    seed : of the random numbers.
    warnings : reasons to doubt the result.
    """

    leakage: Array
    neumann: Array
    dirichlet: Array
    resampled: Array
    of_face: Array
    columns: int
    length: int
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    seed: int
    warnings: tuple[str, ...]

    def windows(self, realisation: int, face_columns: int) -> NDArray[np.int64]:
        """Columns of a face, of so many, whose windows the columns of a realisation are (columns,)."""
        first = self.starts[_drawn_runs(self.seed, realisation, self.columns // self.length, self.ends)]
        return np.asarray((first[:, None] + np.arange(self.length)).ravel() % face_columns)


def runs_of_face(
    fields: WindowFields, columns: int, drop: PressureDrop, *, mapper: Mapper = map
) -> list[StateRuns | Failed]:
    """Solve the runs of a face at every step, of every length that a seal of so many columns may be made of."""
    m2 = fields.partition.cells[1]
    lengths = tuple(sorted({max(1, min(m2 // pieces, columns)) for pieces in COLUMNS_OVER_RUN}))
    solve = partial(attempt, StateRuns.of, partition=fields.partition, lengths=lengths, drop=drop)
    stage = Stage("runs of columns", solve)
    return list(map_different(mapper, stage, fields.gap, first_equal(fields.gap, fields.steps)))


def chained_seals(
    scene: Scene, partition: Partition, found: Sequence[StateRuns | Failed], columns: int, realisations: int, seed: int
) -> ChainedSeals:
    """Draw seals of about so many columns of windows as chains of runs of the face, and add their leakages up.

    Random numbers depend on (seed, realisation, run) only: run n of a longer seal is what run n of a shorter one is.
    """
    flows, warnings = _long_enough(scene, found, columns)
    solved = [flow for flow in flows if flow is not None]
    length, independent = (solved[0].length, solved[0].independent) if solved else (1, 1)
    runs = max(1, round(columns / length))
    if abs(runs * length / columns - 1) > _ROUNDED:
        sides = tuple(to_text(n * partition.window_size[1], "m", 3) for n in (runs * length, columns))
        text = f"whole runs of {counted(length, 'column')} of windows make seals {' long, not '.join(sides)}"
        warnings = (*warnings, f"sampler 'runs': {text}: the leakage of the whole seal is of that length")
    starts = solved[0].starts if solved else np.zeros(1, np.int64)
    of_column = places_of_columns(scene, partition)
    ends = of_column[np.stack([starts, starts + length - 1]) % of_column.size]
    value, neumann, dirichlet = np.full((3, starts.size, len(flows)), np.nan)
    whole = np.full(len(flows), np.nan)
    for s, flow in enumerate(flows):
        if flow is not None:
            value[:, s], neumann[:, s], dirichlet[:, s] = flow.value, flow.neumann, flow.dirichlet
            whole[s] = flow.whole
    size = partition.shape[0] * partition.spacing[0], length * partition.window_size[1]
    # leakage per length of a run of conductance 1 m³, and so of a seal whose runs have the mean conductance 1 m³
    unit = scene.leakage(RectangularSeal(size, (1, 1)), size[0] / size[1]).per_length
    drawn, again = np.zeros((2, realisations, starts.size))
    # a face scatters less about its own mean than seals about theirs: one run less makes up for that
    fewer = max(1, independent - 1)
    for n in range(realisations):
        drawn[n] = np.bincount(_drawn_runs(seed, n, runs, ends), minlength=starts.size)
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(n, 2)))
        library = rng.integers(starts.size, size=fewer)
        again[n] = np.bincount(library[rng.integers(fewer, size=runs)], minlength=starts.size)

    def leakage(counts: Array, of_run: Array) -> Array:
        # the sums of a product of matrices may depend on how many rows these have
        return unit / runs * (counts[:, :, None] * of_run).sum(1)

    return ChainedSeals(
        leakage=leakage(drawn, value),
        neumann=leakage(drawn, neumann),
        dirichlet=leakage(drawn, dirichlet),
        resampled=leakage(again, value),
        of_face=unit * whole,
        columns=runs * length,
        length=length,
        starts=starts,
        ends=ends,
        seed=seed,
        warnings=warnings,
    )


def places_of_columns(scene: Scene, partition: Partition) -> NDArray[np.int64]:
    """Number of the measured place in which every column of windows lies (columns,)."""
    widths = [place.shape[1] // partition.window[1] for place in scene.surface.each]
    return np.repeat(np.arange(len(widths)), widths)


def _drawn_runs(seed: int, realisation: int, runs: int, ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of the runs that a realisation is a chain of (runs,), see `ChainedSeals.ends`."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(realisation,)))).random(runs)
    return drawn_elsewhere(random, *ends)


def _long_enough(
    scene: Scene, found: Sequence[StateRuns | Failed], columns: int
) -> tuple[list[RunFlows | None], tuple[str, ...]]:
    """Runs of the least length at which cuts matter less than the finite face, else of the largest; None if failed."""
    solved = {
        step.name: state.flows for step, state in zip(scene.steps, found, strict=True) if isinstance(state, StateRuns)
    }
    if not solved:
        return [None] * len(found), ()
    first = next(iter(solved.values()))
    counting = {name: flows for name, flows in solved.items() if flows[0].whole > _COUNTS * first[0].whole}
    # no longer than the seal
    lengths = range(max(1, sum(flow.length <= columns for flow in first)))
    long_enough = (n for n in lengths if all(f[n].cut_error <= f[n].scatter for f in counting.values()))
    chosen = next(long_enough, lengths[-1])
    wide = {
        name: f[chosen].cut_error for name, f in counting.items() if f[chosen].cut_error > max(f[chosen].scatter, WIDE)
    }
    warnings: tuple[str, ...] = ()
    if wide:
        worst = max(wide, key=wide.__getitem__)
        text = (
            f"sampler 'runs': Neumann and Dirichlet cuts between runs of {counted(first[chosen].length, 'column')} "
            f"bound the leakage within a factor of {np.exp(2 * wide[worst]):.2g} at {worst}: "
            "its channels need a longer face"
        )
        warnings = (text,)
    return [state.flows[chosen] if isinstance(state, StateRuns) else None for state in found], warnings
