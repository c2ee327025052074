"""Sources of windows that are solved along a ladder of pressures, and the pressures that the links of a seal have."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..base import BLOCK, Array, Indices, Stage
from ..contact import HalfSpace
from ..library import (
    Ladder,
    LadderLibrary,
    LibrarySummary,
    LinkTable,
    WindowSource,
    WindowStates,
    build_ladder_library,
    on_ladder,
)
from ..seal.pressure_map import AnyMap
from ..windows import Failed, GlobalState, Partition
from .scene import Scene
from .seat_rows import SeatMap, SeatRows, distinct_paths, library_peaks, pressure_fractions, seat_rows
from .window_supply import TablePressures, WindowRequest, WindowSupply

#: Loading steps of a library over the pressure at which everything is in contact, about: the hardness, or half of E* ×
#: rms slope where that is less.
LOADING_FRACTIONS = (0, 0.001, 0.004, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.29, 0.37, 0.46, 0.56, 0.67, 0.8, 0.95)
#: Stops of library windows on the way down in fractions of the peak.
STOPS = (0.8, 0.6, 0.4, 0.25, 0.12, 0.04, 0.0)
#: Rigid separations of library windows in rms heights; beyond them k is within 3 % of the asymptote, which takes over.
SEPARATIONS = (-1.0, 0.0, 1.0, 2.0, 3.0, 5.0, 8.0)
#: Fluid pressures at which the permeability of windows is known that the fluid presses apart. Measured against 129:
#: leakage within 1.1e-3 with p_in up to .3 of the lowest load, within 9e-3 where they are equal.
FLUID_PRESSURES = 9
#: Curves of a window that take less time than sending it to another process: 65 µs each, and 200 µs by joblib.
FEW_PATHS = 3
#: The global contact that gives the pressures of library windows carries waves longer than a window.
CUT_OFF_WINDOWS = 1.0


def windows_under_global_contact(wanted: WindowRequest) -> WindowSupply:
    """Solve windows up to the highest window pressure; each link has the pressure of its place in the global contact.

    The global contact of the face repeats along the seal.
    """
    scene, partition = wanted.scene, wanted.partition
    scene.check_one_place("pressure", "global", "place")
    (m1, m2), n2 = partition.cells, wanted.seal_windows.draws[0][1]
    cut_off = CUT_OFF_WINDOWS * min(partition.window_size)
    means = partial(_link_means, partition=partition)
    states = scene.global_states(partition, cut_off, take=means, fluid=scene.acting_fluid, mapper=wanted.mapper)
    p, p_across, gap, gap_across = (np.array(values) for values in zip(*states, strict=True))
    peaks_of_library = library_peaks([pressure.reshape(len(pressure), -1) for pressure in (p, p_across)], scene.steps)
    library = _library(wanted, float(p.max()), apart=True, peaks=peaks_of_library)
    # the standoff of the body separates it from the face, on unloading that of all windows that bore it at the peak
    peaks = scene.steps.peak_indices
    weight = p[peaks]
    load = weight.sum(axis=(1, 2))
    own = library.loaded("standoff", p) - library.flattening(p, weight)
    standoff = np.divide((weight * own).sum(axis=(1, 2)), load, out=own[:, 0, 0].copy(), where=load > 0)
    links = []
    for axis, (touching, between) in enumerate(((p, gap), (p_across, gap_across))):
        distance = between + standoff[:, None, None]
        # a window that hardly touches does not lift off the body: its asperities carry what they do at that distance
        peak = library.pressure_at(touching[peaks], touching[peaks], distance[peaks])
        pressure = library.pressure_at(touching, peak, distance)
        # the plastic deformation of a peak widens their gap
        gaps = distance + library.loaded("plastic_deformation", pressure[peaks])
        path = np.arange(m1 - axis)[:, None] * m2 + np.arange(n2) % m2
        flat = (len(pressure), (m1 - axis) * m2)
        links.append(_LinkPaths(pressure.reshape(flat), gaps.reshape(flat), path))
    at = TablePressures(tuple(scene.flow.drop.pressures))
    return _supply(library, links, wanted, at, np.zeros(len(at.pressures)))


def _link_means(state: GlobalState, partition: Partition) -> tuple[Array, Array, Array, Array]:
    """Pressure of the windows of the links along x1 and along x2, then the mean gap of both."""
    gap, across = (partition.means(state.raw_gap, axis) for axis in (0, 1))
    return state.pressure, state.pressure_across, gap, across


def windows_under_uniform_pressure(wanted: WindowRequest) -> WindowSupply:
    """Solve windows with the full heights; each has the nominal pressure, or its fraction in the map."""
    scene, seal_windows = wanted.scene, wanted.seal_windows
    nominal = scene.steps.pressures[:, None]
    pressure_map: AnyMap | SeatMap | SeatRows = wanted.sampling.pressure_map
    if isinstance(pressure_map, SeatMap):
        solve = Stage("contact of the seat", partial(seat_rows, scene, breadth=seal_windows.seal.size[0]))
        (pressure_map,) = wanted.mapper(solve, [pressure_map.seat])
    fractions = [pressure_fractions(scene, seal_windows, pressure_map, axis) for axis in (0, 1)]
    links = []
    for axis in (0, 1):
        paths, number = distinct_paths(fractions[axis])
        pressure = nominal * paths
        links.append(_LinkPaths(pressure, np.full(pressure.shape, -np.inf), number.reshape(seal_windows.draws[axis])))
    at, fluid = _table_pressures(scene), scene.acting_fluid
    relief, middle = np.zeros(len(at.pressures)), 0.0
    if fluid is not None:  # with several inlets the mean stands for every place
        relief = fluid.relief(at.pressures if relief.size > 1 else [fluid.mean])
        middle = float(fluid.relief(fluid.mean))
    highest = float(max(link.pressure.max(initial=0) for link in links) - relief.min())
    # windows are solved at the pressures that those in the middle of the seal bear
    even = all(np.all(s == 1) for s in fractions)
    exact = tuple(max(p - middle, 0.0) for p in scene.steps.loading) if even else ()
    peaks = scene.steps.unload_from
    if not even or relief.any():
        ends = (float(relief.min()), float(relief.max()))
        peaks = library_peaks([np.maximum(link.pressure - by, 0.0) for link in links for by in ends], scene.steps)
    library = _library(wanted, highest, exact=exact, peaks=peaks)
    seat = pressure_map if isinstance(pressure_map, SeatRows) else None
    return replace(_supply(library, links, wanted, at, relief), seat=seat)


def _table_pressures(scene: Scene) -> TablePressures:
    """Fluid pressures at which permeabilities are taken from the curves of the library."""
    drop, fluid = scene.flow.drop, scene.acting_fluid
    if fluid is None or drop.law.depends_on_pressure or getattr(scene.layout, "inlet_pressures", {}):
        return TablePressures(tuple(drop.pressures))
    # ln k is nearly straight in the cube root of the pressure that the fluid leaves to the windows
    full = max(min((p for p in scene.steps.pressures if p > 0), default=0.0), fluid.inlet, fluid.outlet)
    first, last = (float(np.cbrt(full - p)) for p in (fluid.outlet, fluid.inlet))
    between = full - np.linspace(first, last, FLUID_PRESSURES)[1:-1] ** 3
    return TablePressures((fluid.outlet, *between.tolist(), fluid.inlet), piecewise=True)


@dataclass(frozen=True, eq=False)
class _LinkPaths:
    """Pressures and gaps of the links along one axis.

    pressure, gap : mean pressure [Pa] and distance of the mean planes [m] along every path (steps, paths).
    path : number of the path that each link follows (rows, columns).
    """

    pressure: Array
    gap: Array
    path: Indices


def _supply(
    library: LadderLibrary, links: list[_LinkPaths], wanted: WindowRequest, at: TablePressures, relief: Array
) -> WindowSupply:
    """Tables of the permeabilities at each fluid pressure, and with bounds of their lower and their upper bounds.

    relief : what each of the fluid pressures takes off the pressure of a window [Pa], with the history that this gives
    it. The windows from which the links along both axes take theirs are those of the axes of the seal's windows.
    """
    steps, own = wanted.scene.steps, library.ladder.drop.pressures.size
    kinds = range(library.ladder.kinds // own)
    # those that differ in the pressure of a window alone are taken together: its curves are made once
    paths = {
        (kind, axis, n): (link.pressure - relief[n::own, None, None], link.gap, steps, turned, kind * own + n)
        for kind in kinds
        for axis, (link, turned) in enumerate(zip(links, wanted.seal_windows.axes, strict=True))
        for n in range(min(own, relief.size))
    }
    outcomes = library.outcomes
    k = {key: np.empty((*pressure.shape, len(outcomes))) for key, (pressure, *_) in paths.items()}
    along = partial(_along, library=replace(library, outcomes=()), paths=list(paths.values()))
    stage = Stage("curves of windows", along, here=len(paths) <= FEW_PATHS)
    blocks, size = [], 0
    for found, block in wanted.mapper(stage, [outcomes[n : n + BLOCK] for n in range(0, len(outcomes), BLOCK)]):
        blocks.append(block)
        for every, values in zip(k.values(), found, strict=True):
            every[..., size : size + values.shape[-1]] = values
        size += values.shape[-1]
    library = library.with_summary(blocks)
    if size < len(outcomes):
        k = {key: np.ascontiguousarray(every[..., :size]) for key, every in k.items()}

    place = library.place

    def table(kind: int, axis: int, n: int) -> LinkTable:
        link = links[axis]
        pressure = link.pressure[:, :, None]
        return LinkTable(k[kind, axis, n % own][n // own], link.path, steps, pressure=pressure, place=place)

    tables = tuple((table(kind, 0, n), table(kind, 1, n)) for kind in kinds for n in range(relief.size))
    return WindowSupply(library, tables, at=at, unsolved=wanted.scene.parted_steps)


def _along(
    outcomes: Iterable[WindowStates | Failed], *, library: LadderLibrary, paths: list[Any]
) -> tuple[list[Array], LibrarySummary]:
    """Permeabilities of some windows of a library along several paths, see `LadderLibrary.along`, and their summary."""
    some = replace(library, outcomes=list(outcomes))
    return [some.along(*each) for each in paths], some.summary


def _library(
    wanted: WindowRequest,
    highest: float,
    *,
    apart: bool = False,
    exact: tuple[float, ...] = (),
    peaks: tuple[float, ...],
) -> LadderLibrary:
    """Solve windows of the face along the standard ladder, up to the pressure `highest`.

    `apart` adds separations without pressure, `exact` loading pressures, `peaks` those from which windows are unloaded;
    elastic ones are not: they unload as they were loaded.
    """
    scene, partition, sampling = wanted.scene, wanted.partition, wanted.sampling
    law = scene.uniform_law
    full = min(law.mean_hardness, law.capacity, 0.5 * scene.modulus * scene.surface.rms_slope)
    half_space = HalfSpace(partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"))
    faces = tuple(-place.heights for place in scene.surface.each)
    source = WindowSource(faces, half_space, law, sampling.seed, scene.rtol, scene.flow)
    fractions = LOADING_FRACTIONS if highest <= LOADING_FRACTIONS[-1] * full else (*LOADING_FRACTIONS, highest / full)
    ladder = Ladder(
        loading=tuple(fraction * full for fraction in fractions),
        separations=tuple(source.rms_height * s for s in SEPARATIONS) if apart else (),
        bounds=sampling.bounds,
        drop=scene.flow.drop,
    )
    down = peaks if not law.is_elastic else ()
    ladder = replace(on_ladder(ladder, (*exact, *peaks), highest), peaks=down, stops=STOPS if down else ())
    return build_ladder_library(source, ladder, sampling.library_cells, folder=sampling.library, mapper=wanted.mapper)
