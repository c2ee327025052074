"""Sources of windows that are solved along a ladder of pressures, and the pressures that the links of a seal have."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..contact import HalfSpace
from ..library import Ladder, LadderLibrary, LinkTable, WindowSource, build_ladder_library, on_ladder
from ..library.sampling import Index
from ..windows import GlobalState, Partition
from .scene import Array, Scene
from .window_pressures import distinct_paths, library_peaks, pressure_fractions
from .window_supply import Tables, WindowRequest, WindowSupply

#: Loading steps of a library over the pressure at which everything is in contact, about: the hardness, or half of E* ×
#: rms slope where that is less.
LOADING_FRACTIONS = (0, 0.001, 0.004, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.29, 0.37, 0.46, 0.56, 0.67, 0.8, 0.95)
#: Stops of library windows on the way down in fractions of the peak.
STOPS = (0.8, 0.6, 0.4, 0.25, 0.12, 0.04, 0.0)
#: Rigid separations of library windows in rms heights; beyond them k is within 3 % of the asymptote, which takes over.
SEPARATIONS = (-1.0, 0.0, 1.0, 2.0, 3.0, 5.0, 8.0)
#: The global contact that gives the pressures of library windows carries waves longer than a window.
CUT_OFF_WINDOWS = 1.0


def windows_under_global_contact(wanted: WindowRequest) -> WindowSupply:
    """Solve windows up to the highest window pressure; each link has the pressure of its place in the global contact.

    The global contact of the face repeats along the seal.
    """
    scene, partition = wanted.scene, wanted.partition
    (m1, m2), n2 = partition.cells, wanted.seal_windows.draws[0][1]
    cut_off = CUT_OFF_WINDOWS * min(partition.window_size)
    means = partial(_link_means, partition=partition)
    states = scene.global_states(partition, cut_off, take=means, mapper=wanted.mapper)
    p, p_across, gap, gap_across = (np.array(values) for values in zip(*states, strict=True))
    peaks_of_library = library_peaks([pressure.reshape(len(pressure), -1) for pressure in (p, p_across)], scene.steps)
    library = _library(wanted, float(p.max()), apart=True, peaks=peaks_of_library)
    # the standoff of the whole body separates windows without pressure from the face
    peaks = scene.steps.peak_indices
    load = p.sum(axis=(1, 2))
    own = library.loaded("standoff", p) - library.flattening(p, p[peaks])
    standoff = np.divide((p * own).sum(axis=(1, 2)), load, out=np.zeros_like(load), where=load > 0)
    links = []
    for axis, (pressure, distance) in enumerate(((p, gap), (p_across, gap_across))):
        # the plastic deformation of a peak widens their gap
        gaps = distance + standoff[:, None, None] + library.loaded("plastic_deformation", pressure[peaks])
        path = np.arange(m1 - axis)[:, None] * m2 + np.arange(n2) % m2
        flat = (len(pressure), (m1 - axis) * m2)
        links.append(_LinkPaths(pressure.reshape(flat), gaps.reshape(flat), path))
    return WindowSupply(library, _tables(library, links, scene, wanted.seal_windows.axes))


def _link_means(state: GlobalState, partition: Partition) -> tuple[Array, Array, Array, Array]:
    """Pressure of the windows of the links along x1 and along x2, then the mean gap of both."""
    gap, across = (partition.means(state.raw_gap, axis) for axis in (0, 1))
    return state.pressure, state.pressure_across, gap, across


def windows_under_uniform_pressure(wanted: WindowRequest) -> WindowSupply:
    """Solve windows with the full heights; each has the nominal pressure, or its fraction in the map."""
    scene, seal_windows = wanted.scene, wanted.seal_windows
    nominal = scene.steps.pressures[:, None]
    fractions = [pressure_fractions(scene, seal_windows, wanted.sampling.pressure_map, axis) for axis in (0, 1)]
    links = []
    for axis in (0, 1):
        paths, number = distinct_paths(fractions[axis])
        pressure = nominal * paths
        links.append(_LinkPaths(pressure, np.full(pressure.shape, -np.inf), number.reshape(seal_windows.draws[axis])))
    highest = float(max(link.pressure.max(initial=0) for link in links))
    if all(np.all(s == 1) for s in fractions):
        library = _library(wanted, highest, exact=scene.steps.loading, peaks=scene.steps.unload_from)
    else:
        library = _library(wanted, highest, peaks=library_peaks([link.pressure for link in links], scene.steps))
    return WindowSupply(library, _tables(library, links, scene, seal_windows.axes))


@dataclass(frozen=True, eq=False)
class _LinkPaths:
    """Pressures and gaps of the links along one axis.

    pressure, gap : mean pressure [Pa] and distance of the mean planes [m] along every path (steps, paths).
    path : number of the path that each link follows (rows, columns).
    """

    pressure: Array
    gap: Array
    path: Index


def _tables(library: LadderLibrary, links: list[_LinkPaths], scene: Scene, axes: tuple[int, int]) -> tuple[Tables, ...]:
    """Tables of the permeabilities, and with bounds also of their lower and their upper bounds; see `Ladder.kinds`.

    axes : of the windows, from which the links along both axes take theirs.
    """

    def table(axis: int, kind: int) -> LinkTable:
        k = library.along(links[axis].pressure, links[axis].gap, scene.steps, axes[axis], kind)
        return LinkTable(k, links[axis].path, scene.steps, pressure=links[axis].pressure[:, :, None])

    return tuple((table(0, kind), table(1, kind)) for kind in range(library.ladder.kinds))


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
    source = WindowSource((-scene.surface.heights,), half_space, law, sampling.seed, scene.rtol, scene.flow)
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
