"""Coarser versions of a prepared case, which tell how much its pixels and its removed waves matter."""

import logging
from dataclasses import replace
from math import ceil, prod

import numpy as np

from ..base import Array
from ..preparation.prepared import Pair, Prepared
from ..studies import STUDIES, Scene, Study
from ..studies.sampling import FEWEST_SEALS

log = logging.getLogger("femseal")
#: Points a side of the coarser grid over those of the scene.
COARSENING = 0.5
#: A coarser grid of more than this fraction of the points shows nothing.
MOST_POINTS_FRACTION = 0.6
#: Loading steps that tell the error of pixels well. Measured on 160 faces with 3 to 5 of them, for the same coverage:
#: all of them give bands of 4.2 times the error in the median, every other 5.2 times.
LEAST_LOADS = 5
#: One of so many steps is solved on a coarser grid, and one of so many without the shortest waves.
GRID_STRIDE, FILTER_STRIDE = 2, 4
#: Seals that are drawn again from a changed face, at most, and as long as how many faces they are together; each is
#: compared with that of the same pieces.
SEALS_AGAIN, FACES_AGAIN = 5, 40
#: Pixels to the shortest wave from which on a grid of a quarter of the points a side carries the waves too.
THIRD_GRID_PIXELS = 16.0
#: Octaves of removed waves from which on they matter.
LEAST_OCTAVES = 0.05
#: Draws of the phases of continued waves besides that of a run.
OTHER_PHASES = 3
#: Scenes that measure what continued waves may change: with these, with fewer waves, and as measured.
CONTINUED_SCENES = OTHER_PHASES + 2


def coarser_points(points: Pair, least: Pair = (1, 1), divide_by: Pair = (1, 1)) -> Pair | None:
    """Half the points a side, or as few more as pieces ask for; None where that shows nothing."""
    wanted = [
        ceil(max(ceil(COARSENING * n), few) / m) * m
        for n, few, m in zip(points, least, divide_by, strict=True)
    ]
    if wanted[0] * wanted[1] > MOST_POINTS_FRACTION * points[0] * points[1]:
        return None
    return wanted[0], wanted[1]


def wave_pixels(prepared: Prepared) -> float:
    """Pixels of the scene to its shortest wave."""
    return prepared.conditioning.shortest_wave / max(prepared.scene.surface.spacing)


def carries_quarter(prepared: Prepared) -> bool:
    """Whether a quarter of the points a side carries the waves too."""
    return wave_pixels(prepared) >= THIRD_GRID_PIXELS * (1 - 1e-9)


def route(study: Study) -> Study:
    """The study with the contact and flow of another one on a coarser grid: that of the face for two scales."""
    return STUDIES["deterministic"] if study.name == "two-scale" else study


def coarser_grids(prepared: Prepared, leakage: Array | None = None) -> list[Prepared]:
    """Versions on half of the points a side, and on a quarter where that carries the waves, at some of the steps.

    leakage : of the answer, which shows what steps are near closing.
    """
    # where the filter takes its part of the time too, no more steps than every other
    least = 0 if _lacks_waves(prepared) else LEAST_LOADS
    some = at_some_steps(prepared.scene, leakage, GRID_STRIDE, least=least)
    points, found = prepared.scene.surface.shape, []
    for _ in range(1 + carries_quarter(prepared)):
        if (
            fewer := coarser_points(points, prepared.least_points, prepared.points_divide_by)
        ) is None:
            break
        points = fewer
        found.append(_reduced(prepared, replace(some, surface=some.surface.resample(points))))
    return found


def without_filtered_waves(prepared: Prepared, leakage: Array | None = None) -> Prepared | None:
    """The version without waves up to twice the shortest one, at some of the steps; None where none were removed."""
    if not _lacks_waves(prepared):
        return None
    surface, wave = prepared.scene.surface, 2 * prepared.conditioning.shortest_wave
    n1, n2 = (
        ceil(n / (2 * m)) * m for n, m in zip(surface.shape, prepared.points_divide_by, strict=True)
    )
    least1, least2 = prepared.least_points
    if wave >= max(surface.size) or n1 < least1 or n2 < least2:
        log.warning(
            "error budget: the face or its pieces are too small to do without the shortest waves"
        )
        return None
    some = at_some_steps(prepared.scene, leakage, FILTER_STRIDE, least=0)
    return _reduced(prepared, replace(some, surface=surface.low_pass(wave).resample((n1, n2))))


def continued_scenes(grid: Prepared) -> list[Scene]:
    """The scene with other phases of its continued waves, without its shortest octave of waves, and as measured.

    Other phases come first, `OTHER_PHASES` times; no scenes where nothing is continued.
    """
    if (continued := grid.continuation) is None:
        return []
    surface = grid.scene.surface
    measured = continued.added_to(surface, factor=-1.0)
    others = [continued.added_to(measured, number) for number in range(1, OTHER_PHASES + 1)]
    faces = [*others, surface.low_pass(2 * continued.cut_off), measured]
    return [replace(grid.scene, surface=face) for face in faces]


def kept_slope(prepared: Prepared) -> float:
    """Rms slope of the face over that with the waves that it lacks; 1 where none matter."""
    return prepared.conditioning.kept_slope if _lacks_waves(prepared) else 1.0


def _lacks_waves(prepared: Prepared) -> bool:
    """Whether the face lacks waves that matter, removed by the low-pass or not seen by its instrument."""
    return prepared.conditioning.removed_octaves >= LEAST_OCTAVES


def at_some_steps(
    scene: Scene, leakage: Array | None, stride: int = 2, *, least: int = LEAST_LOADS
) -> Scene:
    """The scene at some of its steps: ends, peaks, both sides of closing, and one of `stride` of the rest.

    leakage : of the scene at every step (steps,); None: it leaks at all of them.
    least : number of open loading steps below which the stride would not fall: it is shorter then.
    """
    q = np.ones(len(scene.steps)) if leakage is None else np.abs(np.asarray(leakage, dtype=float))
    loading = scene.steps.loading
    first_shut = next((n for n in range(len(loading)) if q[n] == 0), len(loading))
    if least:
        stride = min(stride, max(1, first_shut // least))
    kept = {0, first_shut - 1, first_shut, *range(0, first_shut, stride)}
    peaks = set(scene.unload_from)
    if not peaks:  # beyond closing there is nothing to compare
        kept.add(min(first_shut, len(loading) - 1))
    chosen = tuple(p for n, p in enumerate(loading) if n in kept or p in peaks)
    stops = scene.steps.unloading  # falling
    ends = {0, len(stops) - 1, *range(0, len(stops), stride)}
    return replace(
        scene, loading=chosen, unloading=tuple(p for n, p in enumerate(stops) if n in ends)
    )


def _reduced(prepared: Prepared, scene: Scene) -> Prepared:
    """The version for a coarser scene: each study by its route, with the same pieces and few of the same seals."""
    sampling = prepared.sampling
    if sampling is not None:
        cut, tiles = prepared.cut_and_tiles
        enough = ceil(FACES_AGAIN * prod(cut.shape) / tiles.count)
        few = min(sampling.realisations or FEWEST_SEALS, SEALS_AGAIN, enough)
        sampling = replace(sampling, realisations=few, median_fields=False)
    methods = frozenset(route(study).name for study in prepared.studies)
    return replace(prepared, scene=scene, sampling=sampling, methods=methods)
