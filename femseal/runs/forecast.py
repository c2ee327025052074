"""Forecast of a run: unknowns, time, memory and disk, before it is started.

The effort of load steps is that of the contact of a small part of the face; numbers of transforms are counted, not
timed, and do not depend on what else the machine does. How fast the machine is, is timed.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import cache
from math import log, prod, sqrt

import numpy as np
import psutil
from scipy import fft

from ..base import FemsealError, InputError, counted, duration, free_memory, to_text
from ..base.machine import storing
from ..budget import model_changes
from ..case.case import Case
from ..contact import Contact, HalfSpace, solve_contact
from ..face.piece_flow import FlowSettings
from ..flow import cell_permeability
from ..preparation.preparation import START_MEMORY, Prepared
from ..refinement.budgets import CONTINUED_SCENES, coarser_grid, without_filtered_waves
from ..refinement.refine_to_accuracy import (
    first_settings,
    first_version,
    grid_points,
    time_limit,
)
from ..studies import Scene, drop_ratio
from ..studies.doubts import flow_warnings
from ..studies.face_study import RESULT_BYTES, STATE_BYTES, states_memory
from ..studies.study_registry import (
    FEW_ITERATIONS,
    LADDER_STATES,
    PILOT_PIXELS,
    Effort,
    on_ladder,
    usual_efforts,
    usual_seals,
)
from .description import described

#: Seconds of starting, of loading compiled loops and making or reading a face, and of pictures, report and tables.
_START_SECONDS, _PICTURES_SECONDS = 2.5, 2.4
#: Memory of another process [byte].
_WORKER_MEMORY = 0.25e9
#: Load steps that are solved at most.
_MOST_STEPS = 5
#: Rounds of contact and flow beyond which a larger face, of which single paths are a smaller part, takes half as many.
_MANY_ROUNDS = 3.0
#: Iterations of multigrid that take as long as elimination on `PILOT_PIXELS`, and their growth with the fraction open.
_ELIMINATED = 50.0, 1.65
#: Least seconds of a pair of transforms of 128² numbers on the machine where the constants of the costs were measured.
#: They stay in the cache: those of larger arrays take the time in which the system gives new memory, as no solver does.
_PACE_SECONDS = 1.16e-4


@dataclass(frozen=True)
class Forecast:
    """Expected time on one core and memory [byte] of a run.

    own : seconds of what one process does, whatever the number of workers: starting, pictures, files. work : seconds
    of contact and flow, which the workers share; both where the costs were measured. memory : with one worker.
    """

    own: float
    work: float
    memory: float

    def seconds(self, workers: int = 1) -> float:
        """Time on this machine [s], whose pace is measured when a time is first asked for."""
        return (self.own + self.work / workers) * pace()


def describe(case: Case, made: Prepared) -> list[str]:
    """Lines that say what a run of a prepared case computes: surface, steps, cells, unknowns, time and sizes."""
    return [f"{name:<14} {text}" for name, text in _facts(case, made)]


def _facts(case: Case, made: Prepared) -> Iterator[tuple[str, str]]:
    """Name and text of each line; one that goes on with the name before has none."""
    prepared = first_version(case, made)
    yield "case", f"{case.title or '(no title)'}: valid"
    yield from described(case, prepared)
    yield from _accuracy_facts(case, made)
    if again := budget_inputs(case, prepared):
        counts = Counter[tuple[int, int]]()
        for one in again:
            counts[one.scene.surface.shape] += _face_states(one)
        states = (
            f"{count} on {' × '.join(map(str, shape))} points" for shape, count in counts.items()
        )
        yield "error budget", f"states again, {' and '.join(states)}"
    first = "" if case.accuracy is None else "first attempt: "
    yield "expected", first + _expected_text(forecast(case, prepared, again=again))
    yield "disk", str(disk(case, prepared, again))
    quick = prepared.first_answer
    fast = () if quick is None else flow_warnings(prepared.scene, quick.leakage, quick.mean_gap)
    for text in (*prepared.warnings, *(f"by the first answer, {text}" for text in fast)):
        yield "warning", text


def _face_states(prepared: Prepared) -> int:
    """Number of states of the whole face that are solved, about."""
    sampling, steps = prepared.sampling, len(prepared.scene.steps)
    if sampling is None or _keeps_states(prepared) or not on_ladder(prepared.scene, sampling):
        return steps
    return round(LADDER_STATES)


def forecast(
    case: Case,
    prepared: Prepared,
    known: tuple[Effort, ...] | None = None,
    again: list[Prepared] | None = None,
) -> Forecast:
    """Expected time and memory of a run.

    known : effort of each load step; found by a few contacts of a small part of the face unless given.
    again : what the error budget solves besides, where it is known already.
    """
    known = efforts(prepared.scene) if known is None else known
    again = budget_inputs(case, prepared) if again is None else again
    with storing(None, case.memory):
        costs = [prepared.cost(study, known) for study in prepared.solved_studies]
        for coarse in again:
            costs += [coarse.cost(study, known) for study in coarse.solved_studies]
        test = case.output.test_fluid
        if test is not None and drop_ratio(test.state, prepared.scene) is None:
            scene = test.state.in_scene(prepared.scene)
            methods = frozenset({prepared.answer.name})
            costs.append(
                replace(prepared, methods=methods, scene=scene).cost(prepared.answer, known)
            )
    own = _START_SECONDS + _PICTURES_SECONDS * (case.output.pictures or case.output.report)
    seconds, memory = zip(*costs, strict=True)
    # what a study holds stays until the results are written; what it works with does not
    return Forecast(own, sum(seconds), START_MEMORY + max(memory))


def refuse_too_large(case: Case, made: Prepared) -> None:
    """Raise InputError if a run of a prepared case is expected to take more memory than it allows, or than is free."""
    prepared = first_version(case, made)
    most, which = case.memory, "of the key memory"
    if most is None:
        most, which = free_memory(), "that are free"
    # the efforts of loads decide on time alone
    needed = forecast(case, prepared, usual_efforts(len(prepared.scene.steps))).memory
    if needed <= most:
        return
    points = " × ".join(map(str, prepared.scene.surface.shape))
    given = f"a run that takes about {needed / 1e9:.3g} GB, on {points} points"
    advice = "fewer surface.points or load steps, or the method blocks, which solves a block of a face at a time"
    if most <= START_MEMORY:
        advice = f"more than the {START_MEMORY / 1e9:g} GB that any run takes before its work"
    expected = (
        f"at most the {most / 1e9:.3g} GB {which}: {advice}; "
        f"or memory = '{np.ceil(needed / 1e8) / 10:g} GB' in the case, to run all the same"
    )
    raise InputError("memory", given, expected)


def _accuracy_facts(case: Case, made: Prepared) -> Iterator[tuple[str, str]]:
    """What the first attempt at a wanted accuracy takes."""
    if case.accuracy is None:
        return
    chosen = first_settings(case, made)
    points = " × ".join(map(str, grid_points(made, chosen.grid)))
    first = [f"{points} points", f"contact.rtol {chosen.rtol:.0e}"]
    first += [] if chosen.realisations is None else [counted(chosen.realisations, "seal")]
    text = f"{100 * case.accuracy:.3g} % of the numbers alone, first with {', '.join(first)}"
    limit = duration(time_limit(case))
    yield "accuracy", f"{text}; then what limits is refined, for at most {limit}"


def _expected_text(expected: Forecast) -> str:
    cores = psutil.cpu_count() or 1
    return (
        f"about {duration(expected.seconds())} on one core, {duration(expected.seconds(cores))} on the {cores} of this "
        f"machine; {expected.memory / 1e9:.1f} GB of memory, and {_WORKER_MEMORY / 1e9:.2g} GB or more for each "
        "further worker"
    )


@dataclass(frozen=True)
class Disk:
    """Expected sizes before compression [byte].

    fields : the fields over all pixels, at `steps` `of` the load steps. others : all other files. checkpoint : size of
    the store during the run, and of states that lie on disk.
    """

    fields: float
    steps: int
    of: int
    others: float
    checkpoint: float

    def __str__(self) -> str:
        """The sizes as a line of a forecast."""
        text = f"about {_size(self.fields + self.others)}"
        if self.fields:
            text += f", of it fields {_size(self.fields)} before compression"
            text += f" ({self.steps} of {self.of} steps, fields_limit)"
        if self.checkpoint:
            text += f"; {_size(self.checkpoint)} more while it runs"
        return text


def disk(case: Case, prepared: Prepared, again: list[Prepared] | None = None) -> Disk:
    """Expected sizes of the files of a run; `again` as in `forecast`."""
    again = budget_inputs(case, prepared) if again is None else again
    scene = prepared.scene
    steps, pixels = len(scene.steps), prod(scene.surface.shape)
    # three fields in single precision; drawn seals and blocks have none
    each = 12.0 * pixels
    there = case.output.fields and not {"deterministic", "two-scale"}.isdisjoint(prepared.methods)
    fitting = there * int(min(case.output.fields_limit // each, steps))
    formats = case.output.paraview != "none"
    # pictures and report; heights for ParaView
    others = 2e6 * (case.output.pictures or case.output.report) + 4.0 * pixels * formats
    # a piece: ten numbers in results.nc, and in the mesh of the seal
    others += 80 * steps * prod(prepared.cells or (0, 0)) * (1 + formats)
    if (sampling := prepared.sampling) is not None:
        cut, tiles = prepared.cut_and_tiles
        seals = sampling.realisations or usual_seals(cut.shape, tiles)
        others += 8.0 * steps * (seals + 5 * len(tiles.tile) * (1 + formats))
    checkpoint = sum(_checkpoint(one) for one in (prepared, *again))
    with storing(None, case.memory):
        if not states_memory(pixels, steps) and _keeps_states(prepared):
            checkpoint += RESULT_BYTES * pixels * steps  # the states themselves
    return Disk(each * fitting, fitting, steps, others, checkpoint)


def budget_inputs(case: Case, prepared: Prepared) -> list[Prepared]:
    """What the error budget of a run solves besides."""
    if not case.output.budget:
        return []
    coarser = coarser_grid(prepared)
    grid, again = coarser or prepared, [coarser] if coarser else []
    if (smooth := without_filtered_waves(prepared)) is not None:
        again.append(smooth)
    parts = case.output.model_parts
    changes = model_changes(grid.scene, parts, case.hardness_tolerance, grid.form)
    again += [grid.changed(change) for change in changes]
    if prepared.continuation is not None and "continuation" in parts:
        again += [grid] * CONTINUED_SCENES
    return again


def _keeps_states(prepared: Prepared) -> bool:
    """Whether a study keeps the states of the whole face: all but seals whose pieces are taken along a ladder."""
    return prepared.methods != {"stochastic"} or prepared.cut_and_tiles[1].in_place


def _checkpoint(prepared: Prepared) -> float:
    """Expected size of the store of the studies of an input [byte]."""
    scene, drawn = prepared.scene, "stochastic" in prepared.methods
    steps, pixels, peaks = len(scene.steps), prod(scene.surface.shape), len({*scene.unload_from})
    on_ladder = drawn and not prepared.cut_and_tiles[1].in_place
    found = 8.0 * pixels * max(peaks, 1) if on_ladder else 0.0
    if _keeps_states(prepared):
        found += pixels * (STATE_BYTES * steps + 8.0 * peaks)
    return found


def _size(size: float) -> str:
    return to_text(float(f"{size:.1e}"), "B", 3)


@cache
def pace() -> float:
    """Time that this machine takes for transforms, as a multiple of the one on which the costs were measured."""
    heights = np.random.default_rng(0).random((128, 128))
    taken = []
    for _ in range(100):
        # of the processor: what others do on the machine is not forecast
        start = time.thread_time()
        fft.irfft2(fft.rfft2(heights), heights.shape)
        taken.append(time.thread_time() - start)
    # a neighbour on the same core slowed the others down, by up to 2.7 times
    return min(taken) / _PACE_SECONDS


def efforts(scene: Scene) -> tuple[Effort, ...]:
    """Effort of every load step, from contact and flow of the middle of the face at some of the pressures.

    The state that an earlier load left is left out: unloading takes about as many transforms as loading. So are what a
    gas slips, grooves that wind and what pockets hold, which the costs count by themselves.
    """
    surface = scene.surface
    scale = min(1.0, sqrt(PILOT_PIXELS / surface.heights.size))
    # lengths whose transforms are fast: without prime factors above 5
    n1, n2 = (fft.prev_fast_len(min(n, max(16, int(n * scale))), real=True) for n in surface.shape)
    start = (surface.shape[0] - n1) // 2, (surface.shape[1] - n2) // 2
    part = surface.crop((n1, n2), start).detrend()
    half_space = HalfSpace(part.shape, part.spacing, scene.modulus, ("mirror", "mirror"))
    gap = part.heights.max() - part.heights
    solve: Callable[..., Contact] = solve_contact
    if (fluid := scene.acting_fluid) is not None:
        solve = replace(fluid, settings=FlowSettings(), trapped=False).contact
    pressures = sorted({step.pressure for step in scene.steps if step.pressure > 0})
    chosen = np.linspace(0, len(pressures) - 1, min(_MOST_STEPS, len(pressures)))
    tried = [pressures[k] for k in chosen.round().astype(int)]
    found: dict[float, Effort] = {}
    for pressure in tried:
        try:
            contact = solve(
                gap, half_space, pressure=pressure, hardness=scene.hardness, rtol=scene.rtol
            )
            flow = cell_permeability(contact.gap, part.spacing, sides="periodic")
        except FemsealError:  # the run will tell
            found[pressure] = Effort()
            continue
        rounds = getattr(contact, "rounds", 1.0)
        rounds = min(rounds, 0.5 * (rounds + _MANY_ROUNDS))
        effort = Effort(contact.fft_pairs, contact.area_fraction, rounds=rounds)
        larger, (most, power) = PILOT_PIXELS / gap.size, _ELIMINATED
        iterations = flow.iterations or most * flow.percolating_fraction**power
        if iterations:
            iterations = FEW_ITERATIONS + max(0.0, iterations - FEW_ITERATIONS) * larger**0.5
        pairs = effort.pairs * larger**effort.growth
        found[pressure] = replace(effort, pairs=pairs, iterations=iterations)
    return tuple(_between(found, step.pressure) for step in scene.steps)


def _between(found: dict[float, Effort], pressure: float) -> Effort:
    """Effort at a pressure, linear in its logarithm between those that were solved."""
    if not found or pressure <= 0:
        return Effort(0.0, 0.0, FEW_ITERATIONS, 1.0)
    values = zip(*map(astuple, found.values()), strict=True)
    return Effort(*(np.interp(log(pressure), np.log([*found]), each) for each in values))
