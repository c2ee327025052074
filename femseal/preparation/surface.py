"""Prepare the surface of a case: generate or read its faces, repair and add them, filter and resample the sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from typing import Any

import numpy as np

from ..base import InputError, Shape, to_text
from ..case.case import Case, CellsTable
from ..case.faces import FileFace
from ..face.cells import Cut, usual_cells
from ..studies.blocks import CELLS, usual_blocks
from ..topography import (
    MOST_POINTS,
    Conditioning,
    Continuation,
    Instrument,
    Overlap,
    Patches,
    Repair,
    Surface,
    Topography,
    check_wave,
    combine,
    continuation_of,
    default_wave,
    repair,
    resolved_wave,
    resolving_shape,
    smooth,
    spectrum,
)
from .keys import FACE_KEYS, SURFACE_KEYS, errors_with_keys
from .memory import check_memory_of_points

#: A measured surface keeps its pixels if the waves of at least 8 pixels have at least this fraction of the rms slope of
#: all measured waves.
KEPT_SLOPE = 0.99
#: Smallest and default length of a side of a cell, in shortest waves.
_LEAST_WAVES, _USUAL_WAVES = 2, 8
#: Relative error of lengths that are computed in different ways.
_ROUNDING = 1e-9

#: A map without undefined points and form, and a report on its repair.
RepairedMap = tuple[Topography, Repair]


@dataclass(frozen=True, eq=False)
class ConditionedSurface:
    """Surface with which a case is solved.

    Attributes
    ----------
    surface : Topography or Patches
        Surface that is filtered and resampled to the grid of the case.
    conditioning : Conditioning
        Report on its repair and filtering.
    overlap : Overlap or None
        Overlap of two faces; None for a single face.
    continuation : Continuation or None
        Continuation of its spectrum beyond the measured waves; None if it is not continued.
    cells : (int, int) or None
        Numbers of cells along x1 and x2. None if the methods need no cells, or choose them themselves.
    """

    surface: Surface
    conditioning: Conditioning
    overlap: Overlap | None
    continuation: Continuation | None
    cells: Shape | None


def condition_surface(case: Case) -> ConditionedSurface:
    """Generate or read the faces of a case, and condition their sum.

    Raises
    ------
    InputError
        A face cannot be read or used, or the cells do not suit the surface.
    """
    faces = _repair_faces(case)
    level, instrument = faces.surface, faces.instrument
    points = _choose_points(case, level, instrument)
    continuation = None
    with errors_with_keys(SURFACE_KEYS):
        shortest_wave = case.surface.shortest_wave
        if case.surface.continue_spectrum is not None:
            continuation = continuation_of(
                level,
                case.surface.continue_spectrum,
                longest=shortest_wave or instrument.resolution,
                rng=case.seed,
            )
            shortest_wave = continuation.longest
        elif not shortest_wave:
            shortest_wave = default_wave(level, points, instrument)
        check_memory_of_points("surface.points", points, len(level.patches))
        patch = level.shortest_patch
        cells = _choose_cells(case, patch, points, shortest_wave)
        points_of_patch = (points[0], round(points[1] * patch.shape[1] / level.shape[1]))
        check_wave(shortest_wave, patch.size, points_of_patch)
        surface, conditioning = smooth(
            level,
            faces.first_repair.form,
            faces.maps,
            shortest_wave=shortest_wave,
            shape=points,
            instrument=instrument,
        )
    conditioning = replace(conditioning, reading=faces.notes)
    if cells is not None:
        Cut.of(surface.shortest_patch, cells)  # raises if cells have too few points
        cells = over_all_patches(level, cells)
    if continuation is not None:
        surface = continuation.add_to(surface)
        conditioning = replace(
            conditioning,
            shortest_wave=continuation.cut_off,
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            unseen_slope=0.0,
        )
    if cells is not None:
        _check_cells(surface, cells, conditioning.shortest_wave)
    return ConditionedSurface(surface, conditioning, faces.overlap, continuation, cells)


def _check_cells(surface: Surface, cells: Shape, shortest_wave: float) -> None:
    """Raise InputError if cells are shorter than two shortest waves [m]."""
    least = _LEAST_WAVES * shortest_wave
    sides = [length / count for length, count in zip(surface.size, cells, strict=True)]
    if min(sides) < least * (1 - _ROUNDING):
        given = f"cells of {' × '.join(to_text(side, 'm', 3) for side in sides)}"
        expected = f"cells of at least two shortest waves, {to_text(least, 'm', 3)}"
        raise InputError("cells", given, expected)


@dataclass(frozen=True, eq=False)
class _RepairedFaces:
    """Faces of a case after repair, and their sum.

    Attributes
    ----------
    surface : Topography or Patches
        Sum of the faces without its form, with all patches.
    first_repair : Repair
        Report on the repair of the first patch of the sum.
    maps : list of RepairedMap
        All measured or generated maps, each repaired separately.
    overlap : Overlap or None
        Overlap of the first patches of two faces; None for a single face.
    instrument : Instrument
        Instrument with the limits of the worst instrument of all maps.
    notes : tuple of str
        Sentences on how the files were understood.
    """

    surface: Surface
    first_repair: Repair
    maps: list[RepairedMap]
    overlap: Overlap | None
    instrument: Instrument
    notes: tuple[str, ...]


def _repair_faces(case: Case) -> _RepairedFaces:
    """Generate or read the maps of each face, repair them, and add the maps of two faces.

    Patch n of one face is in contact with patch n of the other. If a face has fewer patches, its patches are used
    again from the first one.
    """
    # Each face has its own stream of random numbers, which is independent of those of the studies.
    seeds = np.random.SeedSequence(case.seed).spawn(len(case.face))
    faces: list[list[RepairedMap]] = []  # maps by face
    instruments: list[Instrument] = []
    notes: list[str] = []
    for number, table in enumerate(case.face):
        is_measured = isinstance(table, FileFace)
        key = f"face.{number}" if len(case.face) > 1 else "face"
        if not isinstance(table, FileFace):
            check_memory_of_points(f"{key}.points", table.points)
        with errors_with_keys(FACE_KEYS, key):
            rng = np.random.default_rng(seeds[number])
            maps = [map_table.make(case.folder, rng) for map_table in table.maps(case.folder)]
        spikes = case.surface.spikes if is_measured else inf
        with errors_with_keys(SURFACE_KEYS | {"heights": key}):
            treatment = _treatment(case, spikes, is_measured)
            faces.append([repair(face_map.topography, **treatment) for face_map in maps])
        instruments += [face_map.instrument for face_map in maps]
        notes += [note for face_map in maps for note in face_map.notes]
    all_maps = list(chain(*faces))
    instrument = _joint_instrument(instruments, [level for level, _ in all_maps])
    if len(faces) == 1:
        return _repaired_faces(faces[0], all_maps, None, instrument, notes)
    count = max(len(maps) for maps in faces)
    pairs = [[maps[n % len(maps)] for maps in faces] for n in range(count)]
    patches, first_overlap = _add_pairs(case, pairs)
    return _repaired_faces(patches, list(chain(*pairs)), first_overlap, instrument, notes)


def _add_pairs(
    case: Case, pairs: Sequence[Sequence[RepairedMap]]
) -> tuple[list[RepairedMap], Overlap]:
    """Add the maps of each pair, one of each face, and repair the sums; also return the overlap of the first pair."""
    second_face = case.face[1]
    placement = second_face.placement if isinstance(second_face, FileFace) else {}
    sums = []
    overlaps = []
    for (first_map, _), (second_map, _) in pairs:
        total, overlap = combine(first_map, second_map, **placement)
        sums.append(total)
        overlaps.append(overlap)
    with errors_with_keys(SURFACE_KEYS | {"heights": "face"}):
        is_measured = any(isinstance(table, FileFace) for table in case.face)
        treatment = _treatment(case, inf, is_measured)
        patches = [repair(total, **treatment) for total in sums]
    return patches, overlaps[0]


def _repaired_faces(
    patches: list[RepairedMap],
    maps: list[RepairedMap],
    overlap: Overlap | None,
    instrument: Instrument,
    notes: list[str],
) -> _RepairedFaces:
    """Put repaired patches side by side, and collect the results of the repair."""
    surface: Surface = patches[0][0]
    if len(patches) > 1:
        surface = Patches([level for level, _ in patches])
    return _RepairedFaces(surface, patches[0][1], maps, overlap, instrument, tuple(notes))


def _treatment(case: Case, spikes: float, is_measured: bool) -> dict[str, Any]:
    """Return the arguments of `topography.repair`.

    Only the mean of a generated surface is subtracted, because it has no tilt, and detrending would change its waves.
    """
    detrend = case.surface.detrend
    if detrend is None and not is_measured:
        detrend = 0
    return {"spikes": spikes, "detrend": detrend, "max_undefined": case.surface.max_undefined}


def _joint_instrument(
    instruments: Sequence[Instrument], level_maps: Sequence[Topography]
) -> Instrument:
    """Return an instrument with the limits of the worst instrument of several maps."""
    resolved_waves = [
        instrument.shortest_wave(level)
        for instrument, level in zip(instruments, level_maps, strict=True)
    ]
    generated_wave = min(instrument.generated_wave or 0.0 for instrument in instruments)
    return Instrument(resolution=max(resolved_waves) or None, generated_wave=generated_wave or None)


def _choose_points(case: Case, level: Surface, instrument: Instrument) -> Shape:
    """Choose the numbers of grid points of all patches side by side.

    A case gives the numbers for one patch. If it does not, a generated face keeps its points, and a measured face gets
    as many points as are needed to resolve its shortest measured wave.
    """
    cut_off, points = case.surface.continue_spectrum, case.surface.points
    if points is not None:
        size = level.shortest_patch.size
        if cut_off is not None and cut_off < resolved_wave(size, points) * (1 - _ROUNDING):
            expected = f"8 pixels to continue_spectrum, {list(resolving_shape(size, cut_off))}"
            raise InputError("surface.points", list(points), expected)
        return over_all_patches(level, points)
    if cut_off is not None:
        return resolving_shape(level.size, cut_off)
    if not any(isinstance(table, FileFace) for table in case.face):
        return level.shape
    return default_points(level, case.surface.shortest_wave, instrument)


def over_all_patches(surface: Surface, counts: Shape) -> Shape:
    """Scale numbers of points or cells of the shortest patch to all patches side by side."""
    return counts[0], round(counts[1] * surface.shape[1] / surface.shortest_patch.shape[1])


def default_points(level: Surface, shortest_wave: float | None, instrument: Instrument) -> Shape:
    """Choose the numbers of grid points for a measured surface.

    The surface keeps its pixels if waves of at least 8 pixels contain nearly all of its slope. Otherwise it gets as
    many points as resolve its shortest wave, see `topography.resolving_shape`.

    Parameters
    ----------
    level : Topography or Patches
        Surface without undefined points.
    shortest_wave : float or None
        Wavelength of the filter [m], which determines the grid if it is given.
    instrument : Instrument
        Instrument with which the surface was measured.
    """
    wave_of_pixels = resolved_wave(level.size, level.shape)
    wave = shortest_wave
    if wave is None:
        measured = max(spectrum(level).shortest_wave, instrument.shortest_wave(level))
        slope_on_pixels = level.rms_slope_of_long_waves(wave_of_pixels)
        slope = level.rms_slope_of_long_waves(measured)
        wave = wave_of_pixels if slope_on_pixels >= KEPT_SLOPE * slope else measured
    if wave >= wave_of_pixels and level.heights.size <= MOST_POINTS:
        return level.shape
    points = resolving_shape(level.size, min(wave, wave_of_pixels), most=MOST_POINTS)
    if shortest_wave is not None and resolved_wave(level.size, points) > wave:
        return resolving_shape(level.size, wave)
    return points


def _choose_cells(
    case: Case, patch: Topography, points: Shape, shortest_wave: float
) -> Shape | None:
    """Choose the numbers of cells along both axes of a patch; return None if no method needs cells.

    If the case does not give them, they follow from the blocks, from the stochastic seals, or from a cell size of at
    least eight shortest waves.
    """
    table, stochastic = case.cells or CellsTable(), case.stochastic
    if case.methods == {"deterministic"}:
        return None
    if table.size is not None:
        shorter = min(patch.size)
        if table.size > shorter * (1 + _ROUNDING):
            expected = f"at most the shorter side of the face, {to_text(shorter, 'm')}"
            raise InputError("cells.size", to_text(table.size, "m"), expected)
        m1, m2 = (max(1, round(length / table.size)) for length in patch.size)
        return m1, m2
    if table.count is not None:
        return table.count
    if "blocks" in case.methods:
        blocks = usual_blocks(points)
        return CELLS * blocks[0], CELLS * blocks[1]
    if "two-scale" not in case.methods:
        return None
    if stochastic is not None and "stochastic" in case.methods:
        is_in_order = case.layout.has_length and stochastic.breadth is None
        return usual_cells(patch, in_order=is_in_order)
    side = _USUAL_WAVES * shortest_wave
    m1, m2 = (max(1, int(length / side + _ROUNDING)) for length in patch.size)
    return m1, m2
