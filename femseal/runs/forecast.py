"""What a run of a case computes and takes, before it is started, in lines for `femseal check` and for the report.

Unknowns, memory and disk follow from the sizes of the case. Time follows from the numbers of pixels, load steps and
elements and from the throughput of runs that were measured. It is stated as a range, as the number of iterations that
a surface takes is known afterwards only.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import prod
from operator import itemgetter

import numpy as np
import psutil

from ..base import InputError, Shape, as_text, counted, duration, free_memory, to_text
from ..base.machine import storing
from ..budget import BudgetRequest, versions_of_budget
from ..case.case import Case
from ..case.faces import FileFace
from ..case.solid_table import CoatingTable, SolidTable
from ..checks import FormEffect, QuickEstimate, flow_warnings, mean_modulus
from ..contact.workspace import KEPT_POINTS
from ..flow.solvers.choice import elimination_memory
from ..materials import METALS
from ..preparation.drawing_check import drawing_text
from ..preparation.memory import START_MEMORY
from ..preparation.preparation import Prepared
from ..refinement.refine_to_accuracy import TIME_LIMIT, first_settings, first_version, grid_points
from ..results.load_steps import cycle_text
from ..results.variables import fluid_text
from ..studies import Scene, drop_ratio
from ..studies.blocks import blocks_of
from ..studies.face_study import RESULT_BYTES, STATE_BYTES, states_memory
from ..studies.sampling import FEWEST_SEALS, MOST_SEALS, describe_map
from ..studies.study_registry import TABULATED_STATES, uses_tabulated_pressures, usual_realisations
from ..topography import Patches

#: Seconds of starting, of loading compiled loops and making or reading a face, and of pictures, report and tables.
_START_SECONDS, _PICTURES_SECONDS = 2.5, 2.4
#: Shortest and longest time that a run takes, over the expected one. Measured: docs/evidence/forecast.md.
_SHORTEST, _LONGEST = 0.4, 2.5
#: Part of `START_MEMORY` that pictures take [byte]. It does not add to the memory of contact and flow where their
#: arrays are freed before, as those of large surfaces are. Measured on 2400 × 1800 points: 0.88 GB in all.
_PICTURES_MEMORY = 0.2e9
#: Memory of another process [byte].
_WORKER_MEMORY = 0.25e9
#: Shortest waves that a cell should hold along each side.
ADVISED_WAVES = 8


@dataclass(frozen=True)
class Forecast:
    """Expected time on one core and memory [byte] of a run.

    own : seconds of what one process does, whatever the number of workers: starting, pictures, files. work : seconds
    of contact and flow, which the workers share. memory : with one worker, and most_memory where a flow through the
    whole surface is solved by elimination, because multigrid does not suit its gap.
    most_work : `work` with as many realisations as the run takes at most, where their number follows from their
    scatter and `work` is that of the fewest.
    """

    own: float
    work: float
    memory: float
    most_work: float
    most_memory: float = 0.0

    def seconds(self, workers: int = 1) -> float:
        """Expected time [s]."""
        return self.own + self.work / workers

    def range_seconds(self, workers: int = 1) -> tuple[float, float]:
        """Shortest and longest time [s] that the run is expected to take."""
        most = self.own + self.most_work / workers
        return _SHORTEST * self.seconds(workers), _LONGEST * most

    def time_text(self, workers: int = 1) -> str:
        """State the range of the time.

        >>> Forecast(own=10.0, work=90.0, memory=0.0, most_work=90.0).time_text()
        '40 s to 250 s'
        """
        return " to ".join(map(duration, self.range_seconds(workers)))


def describe(case: Case, made: Prepared) -> list[str]:
    """Lines that say what a run of a prepared case computes: surface, steps, cells, unknowns, time and sizes."""
    return [f"{name:<14} {text}" for name, text in _facts(case, made)]


def _facts(case: Case, made: Prepared) -> Iterator[tuple[str, str]]:
    """Name and text of each line; one that goes on with the name before has none."""
    prepared, attempt = made, ""
    form_effect = made.solve_form_effect()
    yield "case", f"{case.title or '(no title)'}: valid"
    if case.accuracy is not None:
        prepared, attempt = first_version(case, made), "first attempt: "
    estimate = prepared.estimate()
    yield from described(case, prepared, estimate, form_effect)
    if case.accuracy is not None:
        chosen = first_settings(case, made)
        first = f"{as_text(grid_points(made, chosen.grid))} points, contact.rtol {chosen.rtol:.0e}"
        if chosen.realisations is not None:
            first += f", {counted(chosen.realisations, 'seal')}"
        limit = (
            f"then what limits is refined, for at most {duration(case.time_limit or TIME_LIMIT)}"
        )
        text = f"{100 * case.accuracy:.3g} % of the numbers alone, first with {first}"
        yield "accuracy", f"{text}; {limit}"
    if again := budget_inputs(case, prepared):
        counts = Counter[Shape]()
        for one in again:
            counts[one.scene.surface.shape] += _face_states(one)
        states = (f"{count} on {as_text(shape)} points" for shape, count in counts.items())
        yield "error budget", f"states again, {' and '.join(states)}"
    expected, cores = forecast(case, prepared, again=again), psutil.cpu_count() or 1
    alone, shared = expected.time_text(), expected.time_text(cores)
    times = f"{alone} on one core, {shared} on the {cores} of this machine"
    if expected.most_work > expected.work:
        times += f" ({FEWEST_SEALS} to {MOST_SEALS} seals, as many as their scatter asks for)"
    further = f"and {_WORKER_MEMORY / 1e9:.2g} GB or more for each further worker"
    memory = f"{expected.memory / 1e9:.1f} GB of memory"
    if expected.most_memory > 1.1 * expected.memory:
        memory += (
            f" ({expected.most_memory / 1e9:.1f} GB if a flow has to be solved by elimination)"
        )
    yield "expected", f"{attempt}{times}; {memory}, {further}"
    yield "disk", str(disk(case, prepared, again))
    warnings = list(prepared.warnings)
    if form_effect is not None:
        warnings += form_effect.warnings
    if estimate is not None:
        fast = flow_warnings(prepared.scene, estimate.leakage, estimate.mean_gap)
        warnings += [f"by the quick estimate: {text}" for text in fast]
    for text in warnings:
        yield "warning", text


def _face_states(prepared: Prepared) -> int:
    """Number of states of the whole face that are solved, about."""
    sampling = prepared.sampling
    if (
        sampling is None
        or _keeps_states(prepared)
        or not uses_tabulated_pressures(prepared.scene, sampling)
    ):
        return len(prepared.scene.steps)
    return round(TABULATED_STATES)


def forecast(
    case: Case,
    prepared: Prepared,
    again: list[Prepared] | None = None,
) -> Forecast:
    """Expected time and memory of a run.

    again : what the error budget solves besides, where it is known already.
    """
    again = budget_inputs(case, prepared) if again is None else again
    with storing(None, case.memory):
        solved, test = [prepared, *again], case.output.test_fluid
        if test is not None and drop_ratio(test.state, prepared.scene) is None:
            methods, scene = frozenset({prepared.answer.name}), test.state.in_scene(prepared.scene)
            solved.append(replace(prepared, methods=methods, scene=scene))
        few, many = (
            [
                one.cost(study)
                for one in [_with_seals(each, count) for each in solved]
                for study in one.solved_studies
            ]
            for count in (FEWEST_SEALS, MOST_SEALS)
        )
    own = _START_SECONDS + _PICTURES_SECONDS * (case.output.pictures or case.output.report)
    seconds, memory = zip(*few, strict=True)
    most = sum(seconds for seconds, _ in many)
    # what a study holds stays until the results are written; what it works with does not
    pixels = max(one.scene.surface.heights.size for one in solved)
    is_freed = pixels > KEPT_POINTS
    needed = START_MEMORY - _PICTURES_MEMORY * is_freed + max(memory)
    resolves_flow = prepared.methods != {"blocks"}
    most_memory = needed + elimination_memory(pixels) * resolves_flow
    return Forecast(own, sum(seconds), needed, most, most_memory)


def _with_seals(prepared: Prepared, count: int) -> Prepared:
    """The same input with a number of realisations, where it does not say how many."""
    if prepared.sampling is None or prepared.sampling.realisations is not None:
        return prepared
    return prepared.with_realisations(count)


def refuse_too_large(case: Case, made: Prepared) -> None:
    """Raise InputError if a run of a prepared case is expected to take more memory than it allows, or than is free."""
    prepared = made if case.accuracy is None else first_version(case, made)
    most, which = case.memory, "of the key memory"
    if most is None:
        most, which = free_memory(), "that are free"
    needed = forecast(case, prepared).memory
    if needed <= most:
        return
    points = as_text(prepared.scene.surface.shape)
    given = f"a run that takes about {needed / 1e9:.3g} GB, on {points} points"
    advice = "fewer surface.points or load steps, or the method blocks, which solves a block of a face at a time"
    if most <= START_MEMORY:
        advice = f"more than the {START_MEMORY / 1e9:g} GB that any run takes before its work"
    expected = (
        f"at most the {most / 1e9:.3g} GB {which}: {advice}; "
        f"or memory = '{np.ceil(needed / 1e8) / 10:g} GB' in the case, to run all the same"
    )
    raise InputError("memory", given, expected)


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
    # a cell: ten numbers in results.nc, and in the mesh of the seal
    others += 80 * steps * prod(prepared.cells or (0, 0)) * (1 + formats)
    if (sampling := prepared.sampling) is not None:
        cut, tiles = prepared.cut_and_tiles
        seals = sampling.realisations or usual_realisations(cut.shape, tiles)
        others += 8.0 * steps * (seals + 5 * len(tiles.tile) * (1 + formats))
    checkpoint = sum(_checkpoint(one) for one in (prepared, *again))
    with storing(None, case.memory):
        if not states_memory(pixels, steps) and _keeps_states(prepared):
            checkpoint += RESULT_BYTES * pixels * steps  # the states themselves
    return Disk(each * fitting, fitting, steps, others, checkpoint)


def budget_inputs(case: Case, prepared: Prepared) -> list[Prepared]:
    """What the error budget of a run solves besides, at most: opposite changes are left out that matter little."""
    if not case.output.budget:
        return []
    request = BudgetRequest(prepared, case.output.model_parts, case.hardness_tolerance)
    return [version for version in versions_of_budget(request) if isinstance(version, Prepared)]


def _keeps_states(prepared: Prepared) -> bool:
    """Whether a study keeps the states of the whole face: all but seals whose cells are taken along a ladder."""
    return prepared.methods != {"stochastic"} or prepared.cut_and_tiles[1].in_order


def _checkpoint(prepared: Prepared) -> float:
    """Expected size of the store of the studies of an input [byte]."""
    scene, drawn = prepared.scene, "stochastic" in prepared.methods
    steps, pixels, peaks = len(scene.steps), prod(scene.surface.shape), len({*scene.unload_from})
    uses_tabulated_pressures = drawn and not prepared.cut_and_tiles[1].in_order
    found = 8.0 * pixels * max(peaks, 1) if uses_tabulated_pressures else 0.0
    if _keeps_states(prepared):
        found += pixels * (STATE_BYTES * steps + 8.0 * peaks)
    return found


def _size(size: float) -> str:
    return to_text(float(f"{size:.1e}"), "B", 3)


def described(
    case: Case,
    prepared: Prepared,
    estimate: QuickEstimate | None,
    form_effect: FormEffect | None,
) -> Iterator[tuple[str, str]]:
    """Describe a prepared case in lines, each with a name and a text; a line without a name continues the one before.

    estimate, form_effect : of the case, None where they do not apply.
    """
    scene = prepared.scene
    files = (
        ", ".join(str(patch.path) for patch in face.patches or [face])
        if isinstance(face, FileFace)
        else face.kind
        for face in case.face
    )
    yield "face", " against ".join(files)
    yield from _surface_facts(prepared, form_effect)
    if roughness := drawing_text(case, scene.surface):
        yield "roughness", roughness
    if prepared.seat:
        yield "seat", prepared.seat
    yield "load", _load_text(case, scene)
    yield "material", solids_text(case)
    of_waves = " of short waves" if scene.coatings else ""
    modulus = to_text(scene.surface_modulus, "Pa")
    yield "", f"contact modulus{of_waves} {modulus}, {scene.law}"
    for table, what in ((case.fluid, ""), (case.output.test_fluid, "test fluid: ")):
        if table is not None:
            ends = table.inlet_pressure, table.outlet_pressure
            text, name = fluid_text(table.fluid), table.name or ""
            text = text if name in text else f"{name}: {text}"
            yield "fluid", f"{what}{text}, from {' to '.join(to_text(p, 'Pa') for p in ends)}"
        if table is case.fluid:
            yield "", scene.fluid_effect
    yield "flow", f"solver {scene.solver}"
    yield from _law_facts(scene)
    yield from _study_facts(prepared)
    if str(scene.layout) != "a strip":
        yield "seal", str(scene.layout)
    if estimate is not None:
        yield "quick estimate", str(estimate)


def solids_text(case: Case) -> str:
    """The two solids of a case, and which of them yields."""
    face, counter = case.material, case.counter_material
    if counter is None:
        return f"{_solid_text(face)} against a rigid flat"
    text = f"{_solid_text(face)} against {_solid_text(counter)}"
    hardness = {"face": face.law.mean_hardness, "counter-face": counter.law.mean_hardness}
    (softer, low), (_, high) = sorted(hardness.items(), key=itemgetter(1))
    if low == np.inf:
        return text
    other = to_text(high, "Pa") if high < np.inf else "no pressure"
    return f"{text}; the {softer} yields, at {to_text(low, 'Pa')}, and the other at {other}"


def _solid_text(solid: SolidTable) -> str:
    """A solid, with the source of the values that its name stands for."""
    text = f"E = {to_text(solid.young, 'Pa')}, ν = {solid.poisson:g}"
    for value, name in ((solid.hardness, "hardness"), (solid.yield_stress, "yield stress")):
        text += "" if value is None else f", {name} {to_text(value, 'Pa')}"
    text += ", hardness by a table of depths" if solid.hardness_table else ""
    if solid.coating is not None:
        below = _named_text(solid, text)
        thickness = to_text(solid.coating.thickness, "m")
        return f"a coating of {thickness}, {_coating_text(solid.coating)}, on {below}"
    return _named_text(solid, text)


def _coating_text(coating: CoatingTable) -> str:
    """A coating, with the source of the values that its name stands for."""
    text = f"E = {to_text(coating.young, 'Pa')}, ν = {coating.poisson:g}"
    for value, name in ((coating.hardness, "hardness"), (coating.yield_stress, "yield stress")):
        text += "" if value is None else f", {name} {to_text(value, 'Pa')}"
    return _named_text(coating, text)


def _named_text(solid: SolidTable | CoatingTable, text: str) -> str:
    """Put the name of a metal and its source before its values."""
    for name, (_, source) in METALS.items():
        if name.casefold() == (solid.name or "").casefold().strip():
            return f"{name} ({source}; keys of the case come first): {text}"
    return text


def _load_text(case: Case, scene: Scene) -> str:
    """The steps of the cycle, and its highest load."""
    text = f"{cycle_text(scene.steps)}, up to {to_text(scene.steps.pressures.max(), 'Pa', 3)}"
    if case.load.unit != "Pa":
        text += f", from {to_text(case.load.highest, case.load.unit)}"
    return text


def _surface_facts(prepared: Prepared, form_effect: FormEffect | None) -> Iterator[tuple[str, str]]:
    """Points, roughness and filter of the face."""
    scene, report = prepared.scene, prepared.conditioning
    surface = scene.surface
    points = f"{as_text(surface.shape)} points, {as_text(surface.size, 'm')}"
    yield "surface", f"{points}, pixel {as_text(surface.spacing, 'm')}"
    height, slope = to_text(surface.rms_height, "m", 3), surface.rms_slope
    hard = "" if slope else ": a flat face"
    if slope and np.isfinite(scene.law.mean_hardness):  # of elastic faces it is not
        hard = f", H/(E*·slope) {scene.law.mean_hardness / mean_modulus(scene) / slope:.3g}"
    yield "", f"rms height {height}, rms slope {slope:.3g}{hard}"
    if report.undefined_fraction or report.spike_points:
        undefined = f"{report.undefined_fraction:.2%} undefined points"
        yield "", f"{undefined} and {report.spike_points} in spikes filled"
    if isinstance(surface, Patches):
        yield "", f"{len(surface.widths)} patches"
    if overlap := prepared.overlap:
        size = " × ".join(to_text(length, "m", 3) for length in overlap.size)
        resampled = ", the second resampled" if overlap.resampled else ""
        yield "", f"two faces overlap on {size}, {overlap.fraction:.0%} of the first{resampled}"
    waves = prepared.longest_waves
    of_waves = str(waves) if waves is not None and not waves.warnings else ""
    of_form = str(form_effect) if form_effect is not None and not form_effect.warnings else ""
    for text in (of_waves, of_form, str(prepared.continuation or ""), report.unseen):
        if text:
            yield "", text
    shortest = report.shortest_wave
    kept = f"waves below {to_text(shortest, 'm', 3)} ({shortest / max(surface.spacing):.3g} pixels) removed"
    removed = 1 - surface.rms_slope / report.rms_slope_before if report.rms_slope_before else 0.0
    yield "filter", f"{kept}, with {removed:.0%} of the rms slope"


def _law_facts(scene: Scene) -> Iterator[tuple[str, str]]:
    """Say how much more than the viscous flow passes a gap of the rms height, where the law is not the cubic one."""
    drop = scene.flow.drop
    if drop.law.homogeneous:
        return
    height = scene.surface.rms_height
    factor = drop.mean_factor_of(height)
    yield (
        "slip",
        f"{factor:.3g} times the viscous flow in a gap of the rms height, {to_text(height, 'm', 3)}",
    )


def _study_facts(prepared: Prepared) -> Iterator[tuple[str, str]]:
    """What every study solves."""
    scene, steps = prepared.scene, len(prepared.scene.steps)
    pixels = prod(scene.surface.shape)
    of_face = f"{steps} contact and {counted(steps, 'flow solution')} of {pixels} unknowns"
    if "deterministic" in prepared.methods:
        yield "deterministic", of_face
    if prepared.cells is None:
        return
    m1, m2 = prepared.cells
    yield "cells", _cells(prepared, prepared.cells)
    if "two-scale" in prepared.methods:
        yield "two-scale", f"{of_face}, {counted(2 * steps * m1 * m2, 'flow solution')} of cells"
    if "blocks" in prepared.methods:
        b1, b2 = blocks_of(prepared.cells)
        n1, n2 = scene.surface.shape
        blocks = f"{b1} × {b2} blocks of {n1 // b1} × {n2 // b2} points"
        yield "blocks", f"{blocks}, about {TABULATED_STATES:.0f} states of each"
    if (sampling := prepared.sampling) is None or "stochastic" not in prepared.methods:
        return
    _, tiles = prepared.cut_and_tiles
    length = to_text(tiles.size[1], "m", 3)
    number, how = "seals", ", as many as the band of error needs"
    if sampling.realisations is not None:
        number, how = counted(sampling.realisations, "seal"), ""
    states, where = counted(steps, "state"), "at its loads"
    if tiles.in_order:
        where = "at its loads; cells stay in their rows"
    elif uses_tabulated_pressures(scene, sampling):
        states, where = f"about {TABULATED_STATES:.0f} states", "on a ladder of nominal pressures"
    yield "stochastic", f"{states} of the face, {where}"
    drawn = f"{length} long"
    if tiles.part < 1:
        drawn = f"{100 * tiles.part:.2g} % of a length of {length}"
    yield "", f"{number} of {tiles}, {drawn}{how}"
    if uneven := describe_map(scene, tiles, sampling.pressure_map):
        yield "pressure map", uneven


def _cells(prepared: Prepared, count: Shape) -> str:
    """Number and size of cells."""
    sizes = [side / m for side, m in zip(prepared.scene.surface.size, count, strict=True)]
    waves = [length / prepared.conditioning.shortest_wave for length in sizes]
    size = " × ".join(to_text(length, "m", 3) for length in sizes)
    text = f"{count[0]} × {count[1]} of about {size}, that is {waves[0]:.3g} × {waves[1]:.3g} shortest waves"
    if min(waves) < ADVISED_WAVES * 0.99:
        text += f"; {ADVISED_WAVES} or more are advised, of a larger face"
    return text
