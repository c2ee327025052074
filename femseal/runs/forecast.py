"""Forecast of a run: unknowns, time, memory and disk, before it is started."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import psutil

from ..base import InputError, counted, duration, free_memory, to_text
from ..base.shared_array import storing
from ..budget import places_to_halve
from ..case.case import Case
from ..case.faces import FileFace
from ..preparation.prepared import START_MEMORY, Prepared
from ..refinement.settings import (
    first_settings,
    first_version,
    given_settings,
    grid_points,
    time_limit,
)
from ..report.case_text import contact_text, fluid_text, solids_text
from ..studies import Scene, drop_ratio
from ..studies.blocks import blocks_of
from ..studies.doubts import flow_warnings
from ..studies.face_states import FEWEST
from ..studies.study_registry import LADDER_STATES, Effort, on_ladder, usual_efforts
from ..studies.tile_pressure import describe_map
from ..topography import Places
from .disk import budget_inputs, disk
from .pilot import efforts, pace

#: Shortest waves that a piece should hold along each side.
ADVISED_WAVES = 8
#: Seconds of starting, of loading compiled loops and making a face; what reading and repairing a file adds, and what
#: the compiled loops of pieces and their pictures do.
_START_SECONDS, _READ_SECONDS, _PIECES_SECONDS = 2.0, 1.0, 0.5
#: Seconds of pictures, report and tables, and of a byte of fields.
_PICTURES_SECONDS, _FIELD_BYTE_SECONDS = 2.4, 3e-8
#: Memory of another process [byte].
_WORKER_MEMORY = 0.25e9


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
    scene = prepared.scene
    yield "case", f"{case.title or '(no title)'}: valid"
    yield from _surface_facts(prepared)
    if made.seat:
        yield "seat", made.seat
    yield "load", _load_text(case, scene)
    yield "material", solids_text(case.echo())
    yield "", contact_text(scene.modulus, str(scene.law))
    for table, what in ((case.fluid, ""), (case.output.test_fluid, "test fluid: ")):
        if table is not None:
            inlet, outlet = (
                to_text(p, "Pa") for p in (table.inlet_pressure, table.outlet_pressure)
            )
            fluid = fluid_text(table.model_dump(exclude_none=True), str(table.fluid))
            yield "fluid", f"{what}{fluid}, from {inlet} to {outlet}"
        if table is case.fluid:
            yield "", scene.fluid_effect
    yield "flow", f"solver {scene.solver}"
    yield from _law_facts(scene)
    yield from _accuracy_facts(case, made)
    yield from _study_facts(prepared)
    if str(scene.layout) != "a strip":
        yield "seal", str(scene.layout)
    if again := budget_inputs(case, prepared):
        counts = Counter[tuple[int, int]]()
        for one in again:
            counts[one.scene.surface.shape] += _face_states(one)
        states = (
            f"{count} on {' × '.join(map(str, shape))} points" for shape, count in counts.items()
        )
        yield "error budget", f"states again, {' and '.join(states)}"
    first = "" if case.accuracy is None else "first attempt: "
    quick = prepared.first_answer
    if quick is not None:
        yield "first answer", str(quick)
    yield "expected", first + _expected_text(forecast(case, prepared, again=again))
    if not any((Path(__file__).parents[1] / "flow").rglob("__pycache__/*.nbi")):
        yield "", "the first run after an installation compiles besides, for a minute or two"
    yield "disk", str(disk(case, prepared, again))
    fast = () if quick is None else flow_warnings(scene, quick.leakage, quick.mean_gap)
    for text in (*prepared.warnings, *(f"by the first answer, {text}" for text in fast)):
        yield "warning", text


def _load_text(case: Case, scene: Scene) -> str:
    """The states of the cycle, and its highest load."""
    pressures, steps = scene.steps.pressures, len(scene.steps)
    down = steps - int(np.sum(scene.steps.on_loading))
    text = f"{counted(steps, 'state')}: {steps - down} loading"
    if down:
        peaks = " and ".join(to_text(peak, "Pa", 3) for peak in scene.unload_from)
        text += f", {down} unloading from {peaks}"
    text += f", up to {to_text(float(pressures.max()), 'Pa', 3)}"
    if case.load.unit != "Pa":
        text += f", from {to_text(case.load.highest, case.load.unit)}"
    return text


def _study_facts(prepared: Prepared) -> Iterator[tuple[str, str]]:
    """What every study solves."""
    scene, steps = prepared.scene, len(prepared.scene.steps)
    pixels = int(np.prod(scene.surface.shape))
    of_face = f"{steps} contact and {counted(steps, 'flow solution')} of {pixels} unknowns"
    if "deterministic" in prepared.methods:
        yield "deterministic", of_face
    if prepared.cells is None:
        return
    m1, m2 = prepared.cells
    yield "pieces", _pieces(prepared, prepared.cells)
    if "two-scale" in prepared.methods:
        yield "two-scale", f"{of_face}, {counted(2 * steps * m1 * m2, 'flow solution')} of pieces"
    if "blocks" in prepared.methods:
        b1, b2 = blocks_of(prepared.cells)
        of_block = f"{scene.surface.shape[0] // b1} × {scene.surface.shape[1] // b2} points"
        yield (
            "blocks",
            f"{b1} × {b2} blocks of {of_block}, about {LADDER_STATES:.0f} states of each",
        )
    if (sampling := prepared.sampling) is None or "stochastic" not in prepared.methods:
        return
    _, tiles = prepared.cut_and_tiles
    length = to_text(tiles.size[1], "m", 3)
    number = "seals" if sampling.realisations is None else counted(sampling.realisations, "seal")
    how = "as many as the band of error needs" if sampling.realisations is None else ""
    states, where = counted(steps, "state"), "at its loads"
    if tiles.in_place:
        where = "at its loads; pieces stay in their rows"
    elif on_ladder(scene, sampling):
        states, where = f"about {LADDER_STATES:.0f} states", "on a ladder of nominal pressures"
    yield "stochastic", f"{states} of the face, {where}"
    drawn = (
        f"{length} long" if tiles.part == 1 else f"{100 * tiles.part:.2g} % of a length of {length}"
    )
    yield "", f"{number} of {tiles}, {drawn}{f', {how}' if how else ''}"
    if uneven := describe_map(scene, tiles, sampling.pressure_map):
        yield "pressure map", uneven


def _face_states(prepared: Prepared) -> int:
    """Number of states of the whole face that are solved, about."""
    sampling, steps = prepared.sampling, len(prepared.scene.steps)
    if prepared.methods != {"stochastic"} or sampling is None:
        return steps
    ladder = on_ladder(prepared.scene, sampling) and not prepared.cut_and_tiles[1].in_place
    return round(LADDER_STATES) if ladder else steps


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
            of_steps = (known[prepared.scene.steps.index(step)] for step in coarse.scene.steps)
            fewer = tuple(effort.on_fewer_points for effort in of_steps)
            costs += [coarse.cost(study, fewer) for study in coarse.solved_studies]
        if (test := case.output.test_fluid) is not None:
            state = test.state
            if drop_ratio(state, prepared.scene) is None:
                alone = replace(prepared, methods=frozenset({prepared.answer.name}))
                costs.append(
                    replace(alone, scene=state.in_scene(prepared.scene)).cost(alone.answer, known)
                )
    drawn = case.output.pictures or case.output.report
    own = _START_SECONDS + any(isinstance(face, FileFace) for face in case.face) * _READ_SECONDS
    own += (prepared.methods != {"deterministic"}) * _PIECES_SECONDS
    own += drawn * _PICTURES_SECONDS + disk(case, prepared, again).fields * _FIELD_BYTE_SECONDS
    work = sum(seconds for seconds, _ in costs)
    # what a study holds stays until the results are written; what it works with does not
    memory = START_MEMORY + max(memory for _, memory in costs)
    return Forecast(own, work, memory)


def refuse_too_large(case: Case, made: Prepared) -> None:
    """Raise InputError if a run of a prepared case is expected to take more memory than it allows, or than is free."""
    prepared = first_version(case, made)
    most, which = (
        (free_memory(), "that are free")
        if case.memory is None
        else (case.memory, "of the key memory")
    )
    # usual loads take no less than those of the case may; only where that is too much, its own are tried
    again = budget_inputs(case, prepared)
    if forecast(case, prepared, usual_efforts(len(prepared.scene.steps)), again).memory <= most:
        return
    if (needed := forecast(case, prepared, again=again).memory) <= most:
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
    chosen, given = first_settings(case, made), given_settings(case)
    points = grid_points(made, chosen.grid)
    first = [f"{' × '.join(map(str, points))} points", f"contact.rtol {chosen.rtol:.0e}"]
    first += [] if chosen.realisations is None else [counted(chosen.realisations, "seal")]
    text = f"{100 * case.accuracy:.3g} % of the numbers alone, first with {', '.join(first)}"
    yield (
        "accuracy",
        f"{text}; then what limits is refined, for at most {duration(time_limit(case))}",
    )
    if given:
        keys = ", ".join(dict.fromkeys(given.values()))
        yield "", f"{keys} {'stays' if len(given) == 1 else 'stay'} as given"


def _law_facts(scene: Scene) -> Iterator[tuple[str, str]]:
    """What the law of the fluid does to the flow in a gap of the rms height, where it is not the cubic one."""
    drop = scene.flow.drop
    if drop.law.homogeneous:
        return
    ends = [max(p, drop.least_pressure) for p in (drop.inlet, drop.outlet)]
    at_inlet, at_outlet = drop.law.factor(scene.surface.rms_height, ends)
    if not drop.law.depends_on_pressure:
        yield "slip", f"{at_inlet:.3g} times the viscous flow in a gap of the rms height"
        return
    yield (
        "gas",
        f"slips: {at_inlet:.3g} (inlet) to {at_outlet:.3g} (outlet) times the viscous flow in a gap of the rms height; "
        f"permeability of pieces at {drop.pressures.size} pressures, other flow solved 3 to 5 times",
    )


def _expected_text(expected: Forecast) -> str:
    text = f"about {duration(expected.seconds())} on one core"
    cores = psutil.cpu_count() or 1
    text += f", {duration(expected.seconds(cores))} on the {cores} of this machine"
    more = f"and {_WORKER_MEMORY / 1e9:.2g} GB or more for each further worker"
    return f"{text}; {expected.memory / 1e9:.1f} GB of memory, {more}"


def _surface_facts(prepared: Prepared) -> Iterator[tuple[str, str]]:
    """Points, roughness and filter of the face."""
    scene, report = prepared.scene, prepared.conditioning
    surface = scene.surface
    size, pixel = (
        " × ".join(to_text(x, "m", 4) for x in pair) for pair in (surface.size, surface.spacing)
    )
    yield "surface", f"{surface.shape[0]} × {surface.shape[1]} points, {size}, pixel {pixel}"
    height, slope = to_text(surface.rms_height, "m", 3), surface.rms_slope
    hard = ": a flat face" if not slope else ""
    if slope and np.isfinite(scene.law.mean_hardness):  # of elastic faces it is not
        hard = f", H/(E*·slope) {scene.law.mean_hardness / scene.modulus / slope:.3g}"
    yield "", f"rms height {height}, rms slope {slope:.3g}{hard}"
    if report.undefined_fraction or report.spike_points:
        yield (
            "",
            f"{report.undefined_fraction:.2%} undefined points and {report.spike_points} in spikes filled",
        )
    if isinstance(surface, Places):
        count = len(surface.widths)
        more = f"; about {places_to_halve(count)} more would halve their part of the band of error"
        yield "", f"{count} places{more if count >= FEWEST else ''}"
    if overlap := prepared.overlap:
        size = " × ".join(to_text(length, "m", 3) for length in overlap.size)
        resampled = ", the second resampled" if overlap.resampled else ""
        yield "", f"two faces overlap on {size}, {overlap.fraction:.0%} of the first{resampled}"
    for known in (prepared.holds, prepared.form_effect):
        if known is not None and not known.doubts:
            yield "", str(known)
    for text in (prepared.continuation_text, report.unseen):
        if text:
            yield "", text
    shortest = report.shortest_wave
    kept = f"waves below {to_text(shortest, 'm', 3)} ({shortest / max(surface.spacing):.3g} pixels) removed"
    removed = 1 - surface.rms_slope / report.rms_slope_before if report.rms_slope_before else 0.0
    if removed > 0.005:
        measured = to_text(report.shortest_measured, "m", 3)
        kept += f", with {removed:.0%} of the rms slope, {report.lost_slope:.0%} of that above noise ({measured})"
    yield "filter", kept


def _pieces(prepared: Prepared, count: tuple[int, int]) -> str:
    """Number and size of pieces."""
    sizes = [side / m for side, m in zip(prepared.scene.surface.size, count, strict=True)]
    waves = [length / prepared.conditioning.shortest_wave for length in sizes]
    few = (
        f"; {ADVISED_WAVES} or more are advised, of a larger face"
        if min(waves) < ADVISED_WAVES * 0.99
        else ""
    )
    size = " × ".join(to_text(length, "m", 3) for length in sizes)
    return f"{count[0]} × {count[1]} of about {size}, that is {waves[0]:.3g} × {waves[1]:.3g} shortest waves{few}"
