"""Prepare the surface of a case: generate or read its faces, repair and add them, filter and resample the sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from typing import Any, NamedTuple

import numpy as np

from ..base import InputError, Shape, to_text
from ..case.case import Case, CellsTable
from ..case.faces import Face, FileFace
from ..face.cut import Cut
from ..topography import (
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
    default_points,
    default_wave,
    repair,
    resolved_wave,
    resolving_shape,
    smooth,
)
from .keys import FACE_KEYS, SURFACE_KEYS, errors_with_keys
from .memory import check_memory_of_points

#: Smallest length of a side of a cell, as a multiple of the shortest wavelength.
_LEAST_WAVES = 2
#: Relative difference up to which lengths count as equal, because they are computed in different ways.
_ROUNDING = 1e-9

#: A map without undefined points and without form deviation, and a report on the repair of the map.
RepairedMap = tuple[Topography, Repair]


@dataclass(frozen=True, eq=False)
class ConditionedSurface:
    """Surface with which a case is solved, and reports on its preparation.

    Attributes
    ----------
    surface : Topography or Patches
        The surface after filtering and resampling to the grid of the case.
    conditioning : Conditioning
        Report on the repair and filtering of the surface.
    overlap : Overlap or None
        Overlap of two faces; None for a single face.
    continuation : Continuation or None
        Continuation of the spectrum of the surface to shorter wavelengths than measured; None if the spectrum is not
        continued.
    cells : (int, int) or None
        Numbers of cells of the surface along x1 and x2; None if no study needs cells, or if they are chosen later.
    """

    surface: Surface
    conditioning: Conditioning
    overlap: Overlap | None
    continuation: Continuation | None
    cells: Shape | None


def condition_surface(case: Case) -> ConditionedSurface:
    """Generate or read the faces of a case, repair and add their maps, and filter and resample the sum.

    Raises
    ------
    InputError
        A face cannot be read or used, or the surface cannot be divided into these cells.
    """
    faces = _repair_faces(case)
    repaired, instrument = faces.surface, faces.instrument  # without form deviation
    points = _choose_points(case, repaired, instrument)
    with errors_with_keys(SURFACE_KEYS):
        continuation = _continuation(case, repaired, instrument)
        if continuation is not None:
            # the filter removes the measured waves that the continuation replaces
            shortest_wave = continuation.longest
        else:
            shortest_wave = case.surface.shortest_wave or default_wave(repaired, points, instrument)
        check_memory_of_points("surface.points", points, len(repaired.patches))
        patch = repaired.shortest_patch
        cells_of_patch = _choose_cells(case, patch, points, shortest_wave)
        # all patches lie side by side along x2; the shortest patch has this part of their points
        points_of_patch = (points[0], round(points[1] * patch.shape[1] / repaired.shape[1]))
        check_wave(shortest_wave, patch.size, points_of_patch)
        surface, conditioning = smooth(
            repaired,
            faces.first_repair.form,
            faces.maps,
            shortest_wave=shortest_wave,
            shape=points,
            instrument=instrument,
        )
    conditioning = replace(conditioning, reading=faces.notes)
    cells = None
    if cells_of_patch is not None:
        # raises InputError if the cells have too few points
        Cut.of(surface.shortest_patch, cells_of_patch)
        cells = over_all_patches(repaired, cells_of_patch)
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


def _continuation(case: Case, level: Surface, instrument: Instrument) -> Continuation | None:
    """Return the continuation of the spectrum to shorter wavelengths; None unless the case requires one."""
    cut_off = case.surface.continue_spectrum
    if cut_off is None:
        return None
    longest = case.surface.shortest_wave or instrument.resolution
    return continuation_of(level, cut_off, longest=longest, rng=case.seed)


def _check_cells(surface: Surface, cells: Shape, shortest_wave: float) -> None:
    """Raise InputError if a side of the cells is shorter than twice the shortest wavelength [m]."""
    least = _LEAST_WAVES * shortest_wave
    sides = [length / count for length, count in zip(surface.size, cells, strict=True)]
    if min(sides) < least * (1 - _ROUNDING):
        given = f"cells of {' × '.join(to_text(side, 'm', 3) for side in sides)}"
        expected = f"cells of at least two shortest waves, {to_text(least, 'm', 3)}"
        raise InputError("cells", given, expected)


@dataclass(frozen=True, eq=False)
class _RepairedFaces:
    """Repaired maps of all faces, and the sum of the maps.

    Attributes
    ----------
    surface : Topography or Patches
        Sum of the heights of the faces, with all patches. The form deviation has been subtracted.
    first_repair : Repair
        Report on the repair of the sum, for the first patch.
    maps : list of RepairedMap
        All measured or generated maps, each repaired separately.
    overlap : Overlap or None
        Overlap of the first patches of two faces; None for a single face.
    instrument : Instrument
        Instrument that resolves only the waves that the instruments of all maps resolve.
    notes : tuple of str
        Sentences on how the files were interpreted.
    """

    surface: Surface
    first_repair: Repair
    maps: list[RepairedMap]
    overlap: Overlap | None
    instrument: Instrument
    notes: tuple[str, ...]


class _RepairedFace(NamedTuple):
    """Repaired maps of a face.

    maps : one repaired map for each patch.
    instruments : instrument of each map.
    notes : sentences on how the files of the maps were interpreted.
    """

    maps: list[RepairedMap]
    instruments: list[Instrument]
    notes: list[str]


def _repair_faces(case: Case) -> _RepairedFaces:
    """Generate or read the maps of each face, and repair the maps. For two faces, add the maps of both faces."""
    # Each face has its own stream of random numbers, which is independent of the random numbers of the studies.
    seeds = np.random.SeedSequence(case.seed).spawn(len(case.face))
    faces = []
    for number, table in enumerate(case.face):
        key = f"face.{number}" if len(case.face) > 1 else "face"
        faces.append(_repair_face(case, table, key, np.random.default_rng(seeds[number])))
    all_maps = [repaired_map for face in faces for repaired_map in face.maps]
    notes = [note for face in faces for note in face.notes]
    instruments = [instrument for face in faces for instrument in face.instruments]
    instrument = _joint_instrument(instruments, [topography for topography, _ in all_maps])
    if len(faces) == 1:
        return _repaired_faces(faces[0].maps, all_maps, None, instrument, notes)
    pairs = _pair_patches(faces[0].maps, faces[1].maps)
    patches, first_overlap = _add_pairs(case, pairs)
    return _repaired_faces(patches, list(chain(*pairs)), first_overlap, instrument, notes)


def _repair_face(case: Case, table: Face, key: str, rng: np.random.Generator) -> _RepairedFace:
    """Generate or read the maps of one face, and repair the maps.

    table : description of the face in the case.
    key : key of this table in the case, such as "face" or "face.1".
    rng : source of the random numbers of a generated face.
    """
    is_measured = isinstance(table, FileFace)
    if not isinstance(table, FileFace):
        check_memory_of_points(f"{key}.points", table.points)
    with errors_with_keys(FACE_KEYS, key):
        maps = [map_table.make(case.folder, rng) for map_table in table.maps(case.folder)]
    # no spikes are removed from generated maps
    spikes = case.surface.spikes if is_measured else inf
    # if `repair` rejects its argument "heights", the error is about the table of this face
    with errors_with_keys(SURFACE_KEYS | {"heights": key}):
        treatment = _treatment(case, spikes, is_measured)
        repaired = [repair(face_map.topography, **treatment) for face_map in maps]
    return _RepairedFace(
        maps=repaired,
        instruments=[face_map.instrument for face_map in maps],
        notes=[note for face_map in maps for note in face_map.notes],
    )


def _pair_patches(
    first_face: list[RepairedMap], second_face: list[RepairedMap]
) -> list[tuple[RepairedMap, RepairedMap]]:
    """Return the pairs of patches that are in contact: patch n of one face with patch n of the other face.

    If one face has fewer patches than the other, its patches are reused, starting with the first.
    """
    count = max(len(first_face), len(second_face))
    return [
        (first_face[n % len(first_face)], second_face[n % len(second_face)]) for n in range(count)
    ]


def _add_pairs(
    case: Case, pairs: Sequence[tuple[RepairedMap, RepairedMap]]
) -> tuple[list[RepairedMap], Overlap]:
    """For each pair of patches in contact, add the two maps and repair the result.

    pairs : for each pair of patches, a map of the first face and a map of the second face.

    Returns the summed and repaired maps, and the overlap of the two maps of the first pair.
    """
    second_face = case.face[1]
    placement = second_face.placement if isinstance(second_face, FileFace) else {}
    sums = []
    overlaps = []
    for first, second in pairs:
        first_map, _ = first
        second_map, _ = second
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
    """Collect the repaired maps and their reports. Several patches are joined side by side to a single surface."""
    first_level, first_repair = patches[0]
    surface: Surface = first_level
    if len(patches) > 1:
        surface = Patches([level for level, _ in patches])
    return _RepairedFaces(
        surface=surface,
        first_repair=first_repair,
        maps=maps,
        overlap=overlap,
        instrument=instrument,
        notes=tuple(notes),
    )


def _treatment(case: Case, spikes: float, is_measured: bool) -> dict[str, Any]:
    """Return the keyword arguments for `topography.repair`.

    The default value of `detrend` differs between measured and generated maps. Only the mean is subtracted from a
    generated map, because a generated map has no tilt, and detrending would change its waves.

    spikes : threshold for the detection of spikes.
    is_measured : whether the map was measured.
    """
    detrend = case.surface.detrend
    if detrend is None and not is_measured:
        detrend = 0
    return {"spikes": spikes, "detrend": detrend, "max_undefined": case.surface.max_undefined}


def _joint_instrument(
    instruments: Sequence[Instrument], level_maps: Sequence[Topography]
) -> Instrument:
    """Return an instrument that resolves only the waves that all the given instruments resolve."""
    # largest of the shortest wavelengths that the instruments resolve; 0 if no instrument has a limit
    resolution = max(
        instrument.shortest_wave(level)
        for instrument, level in zip(instruments, level_maps, strict=True)
    )
    # the sum of the maps counts as a generated surface only if all maps were generated
    generated_waves = [i.generated_wave for i in instruments if i.generated_wave]
    all_are_generated = len(generated_waves) == len(instruments)
    return Instrument(
        resolution=resolution or None,
        generated_wave=min(generated_waves) if all_are_generated else None,
    )


def _choose_points(case: Case, level: Surface, instrument: Instrument) -> Shape:
    """Choose the numbers of grid points along x1 and x2, for all patches side by side along x2.

    The numbers of points are chosen as follows:

    - If the case contains the key `surface.points`, it gives the numbers of points of a single patch.
    - If the spectrum is continued, the shortest wavelength of the continuation determines the grid.
    - A generated surface has the same points as the generated map.
    - The grid of a measured surface is chosen so that the grid resolves the shortest wavelength.
    """
    points = case.surface.points
    cut_off = case.surface.continue_spectrum
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
    """Convert numbers of points or cells of the shortest patch to the numbers for all patches side by side."""
    return counts[0], round(counts[1] * surface.shape[1] / surface.shortest_patch.shape[1])


def _choose_cells(
    case: Case, patch: Topography, points: Shape, shortest_wave: float
) -> Shape | None:
    """Choose the numbers of cells along both axes of a patch; return None if no method needs cells.

    The case can contain the size of the cells or the numbers of cells. If the case contains neither the size nor the
    numbers, the study that gives the leakage of the run chooses them, see `Study.usual_cells`. If a study needs equal
    cells, this study chooses them instead, because equal cells suit the other studies as well.
    """
    table = case.cells or CellsTable()
    studies = [study for study in case.studies if study.needs_cells]
    if not studies:
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
    if all(study.chooses_cells for study in studies):
        return None  # the cells are chosen later, together with the tiles of the seal
    with_equal_cells = [study for study in studies if study.needs_equal_cells]
    choosing_study = (with_equal_cells or studies)[-1]
    has_own_breadth = case.stochastic is not None and case.stochastic.breadth is not None
    in_order = case.layout.has_length and not has_own_breadth
    return choosing_study.usual_cells(patch, points, shortest_wave, in_order)
