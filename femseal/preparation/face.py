"""The face of a case: faces made or read, repaired, summed, and conditioned on its grid.

Its grooves run around the seal as rings, or as the spiral that a lathe cuts.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from math import inf, prod
from typing import Any

import numpy as np

from ..base import InputError, Shape, free_memory, to_text
from ..case.case import Case, CellsTable
from ..case.faces import FileFace, TurnedFace
from ..face.pieces import Cut, usual_pieces
from ..seal.lay import Lay
from ..seal.layouts import AnnularLayout, Layout, RectangularLayout
from ..studies import Scene
from ..studies.blocks import PIECES, usual_blocks
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

#: Arguments of `topography` by their key in a case.
FACE_KEYS = {"shape": "points"}
SURFACE_KEYS = {
    "shortest_wave": "surface.shortest_wave",
    "max_share": "surface.max_undefined",
    "continue_spectrum": "surface.continue_spectrum",
    "shape": "surface.points",
    "spikes": "surface.spikes",
    "order": "surface.detrend",
}
#: Fraction of the measured rms slope that the pixels of a measured face must keep to be fine enough.
KEPT_SLOPE = 0.99
#: Memory that a point of a face takes at least while faces are made, low-passed and resampled [byte].
_POINT_BYTES = 64
#: Fraction of the rms slope from which on a case is warned that the low-pass removes it. Measured: with 49 % of it gone
#: a turned face leaks 10 to 700 times less.
_LOST_SLOPE = 0.1
#: Fraction of the rms slope from which on a case is warned that it is of noise.
_NOISE_SLOPE = 0.25
#: Fractions of the variance of the heights that means along x2 keep where grooves run along x2, and of the power of
#: those means near the wave of the grooves where these are equally far apart.
_GROOVED, _EVEN = 0.5, 0.3
#: Waves of grooves that a face has at least.
_LEAST_GROOVES = 3


@contextmanager
def with_keys(keys: dict[str, str], place: str = "") -> Iterator[None]:
    """Raise an InputError with keys instead of names of arguments, after the place of their table if that is given."""
    try:
        yield
    except InputError as error:
        in_case = error.with_keys(keys)
        raise (in_case.inside(place) if place else in_case) from error


def conditioned_face(
    case: Case,
) -> tuple[Surface, Conditioning, Overlap | None, Continuation | None, Shape | None]:
    """Make or read the faces of a case, and condition their sum.

    Returned: the face that is solved, how it was conditioned, the overlap of two faces, how its spectrum was continued,
    and the number of pieces: None where there are none, or as many as suit the drawn seals.

    Raises InputError: a face that cannot be read or used, or pieces that do not suit it.
    """
    patches, parts, overlap, instrument, notes = _repaired_faces(case)
    flat: Surface = patches[0][0]
    repaired = patches[0][1]
    if len(patches) > 1:
        flat = Patches([face for face, _ in patches])
    asked, cut_off = case.surface.shortest_wave, case.surface.continue_spectrum
    shape, continued = _grid(case, flat, instrument), None
    with with_keys(SURFACE_KEYS):
        if cut_off is not None:
            longest = asked or instrument.resolution
            continued = continuation_of(flat, cut_off, longest=longest, rng=case.seed)
        wave = continued.longest if continued else asked or default_wave(flat, shape, instrument)
        check_memory_of_points("surface.points", shape, len(flat.patches))
        place = flat.shortest_patch
        pieces = _pieces(case, place, shape, wave)
        check_wave(wave, place.size, (shape[0], round(shape[1] * place.shape[1] / flat.shape[1])))
        surface, report = smooth(
            flat, repaired.form, parts, shortest_wave=wave, shape=shape, instrument=instrument
        )
    report = replace(report, reading=notes)
    if pieces is not None:
        Cut.of(surface.shortest_patch, pieces)  # refuses pieces of too few points
        pieces = of_all_places(flat, pieces)
    if continued is not None:
        surface = continued.added_to(surface)
        report = replace(
            report,
            shortest_wave=continued.cut_off,
            rms_slope=surface.rms_slope,
            rms_height=surface.rms_height,
            unseen_slope=0.0,
        )
    if pieces is not None:
        least = 2 * report.shortest_wave
        sides = [side / m for side, m in zip(surface.size, pieces, strict=True)]
        if min(sides) < least * (1 - 1e-9):
            given = f"pieces of {' × '.join(to_text(side, 'm', 3) for side in sides)}"
            allowed = f"pieces of at least two shortest waves, {to_text(least, 'm', 3)}"
            raise InputError("cells", given, allowed)
    return surface, report, overlap, continued, pieces


#: Flat maps, with what was repaired in them.
Repaired = list[tuple[Topography, Repair]]


def _repaired_faces(
    case: Case,
) -> tuple[Repaired, Repaired, Overlap | None, Instrument, tuple[str, ...]]:
    """Every place of one face, or of the sum of two: repaired, and the maps that were measured or made for it.

    Also returned: the overlap of two faces, an instrument that sees what all of them see, and notes on the files.
    """
    # every face has its own random stream, independent of later draws of the method
    seeds = np.random.SeedSequence(case.seed).spawn(len(case.face))
    detrend, max_undefined = case.surface.detrend, case.surface.max_undefined
    faces: list[Repaired] = []
    instruments: list[Instrument] = []
    notes: list[str] = []
    for n, table in enumerate(case.face):
        place, spikes = f"face.{n}" if len(case.face) > 1 else "face", case.surface.spikes
        if not isinstance(table, FileFace):
            check_memory_of_points(f"{place}.points", table.points)
            spikes = inf
        with with_keys(FACE_KEYS, place):
            rng = np.random.default_rng(seeds[n])
            maps = [one.make(case.folder, rng) for one in table.maps(case.folder)]
        with with_keys(SURFACE_KEYS | {"heights": place}):
            # a generated face is level, and its waves would be levelled
            order = 0 if detrend is None and not isinstance(table, FileFace) else detrend
            treatment: dict[str, Any] = {
                "spikes": spikes,
                "detrend": order,
                "max_undefined": max_undefined,
            }
            faces.append([repair(face.topography, **treatment) for face in maps])
        instruments += [face.instrument for face in maps]
        notes += [note for face in maps for note in face.notes]
    seen = map(Instrument.shortest_wave, instruments, (flat for flat, _ in chain(*faces)))
    made = min(instrument.made or 0.0 for instrument in instruments)
    instrument = Instrument(resolution=max(seen) or None, made=made or None)
    if len(faces) == 1:
        return faces[0], faces[0], None, instrument, tuple(notes)
    # place n of one face lies on place n of the other; where there are fewer they come again
    pairs = [[face[n % len(face)] for face in faces] for n in range(max(map(len, faces)))]
    placement = case.face[1].placement if isinstance(case.face[1], FileFace) else {}
    sums, overlaps = zip(*(combine(a, b, **placement) for (a, _), (b, _) in pairs), strict=True)
    with with_keys(SURFACE_KEYS | {"heights": "face"}):
        is_measured = any(isinstance(table, FileFace) for table in case.face)
        order = 0 if detrend is None and not is_measured else detrend
        treatment: dict[str, Any] = {
            "spikes": inf,
            "detrend": order,
            "max_undefined": max_undefined,
        }
        flat = [repair(face, **treatment) for face in sums]
    return flat, [*chain(*pairs)], overlaps[0], instrument, tuple(notes)


def _grid(case: Case, flat: Surface, instrument: Instrument) -> Shape:
    """Points of the grid: those of the case, or of a generated face, or what the shortest measured wave takes.

    Those of the case are of one place, the others of all that were measured, side by side. A measured face keeps its
    own pixels where waves of 8 of them have nearly all of its slope.
    """
    cut_off, points = case.surface.continue_spectrum, case.surface.points
    if points is not None:
        size = flat.shortest_patch.size
        if cut_off is not None and cut_off < resolved_wave(size, points) * (1 - 1e-9):
            expected = f"8 pixels to continue_spectrum, {list(resolving_shape(size, cut_off))}"
            raise InputError("surface.points", list(points), expected)
        return of_all_places(flat, points)
    if cut_off is not None:
        return resolving_shape(flat.size, cut_off)
    if not any(isinstance(face, FileFace) for face in case.face):
        return flat.shape
    return default_grid(flat, case.surface.shortest_wave, instrument)


def of_all_places(face: Surface, shape: Shape) -> Shape:
    """Points of all places of a face together where its shortest has so many."""
    return shape[0], round(shape[1] * face.shape[1] / face.shortest_patch.shape[1])


def default_grid(flat: Surface, shortest_wave: float | None, instrument: Instrument) -> Shape:
    """Points on which a measured face is solved unless the case says otherwise, see `topography.resolving_shape`.

    flat : without undefined points.
    shortest_wave : the low-pass, which decides if it is given [m]. instrument : what is known of it.
    """
    own, wave = resolved_wave(flat.size, flat.shape), shortest_wave
    if wave is None:
        measured = max(spectrum(flat).shortest_wave, instrument.shortest_wave(flat))
        enough = flat.low_pass(own).rms_slope >= KEPT_SLOPE * flat.low_pass(measured).rms_slope
        wave = own if enough else measured
    if wave >= own and flat.heights.size <= MOST_POINTS:
        return flat.shape
    shape = resolving_shape(flat.size, min(wave, own), most=MOST_POINTS)
    too_wide = shortest_wave is not None and resolved_wave(flat.size, shape) > wave
    return resolving_shape(flat.size, wave) if too_wide else shape


def _pieces(case: Case, place: Topography, shape: Shape, wave: float) -> Shape | None:
    """Pieces along both axes of a place, None where the methods need none.

    Unless the case says how many: of blocks, of drawn seals, or of eight shortest waves or more a side.
    """
    asked, drawn = case.cells or CellsTable(), case.stochastic
    if case.methods == {"deterministic"}:
        return None
    if asked.size is not None:
        if asked.size > (shorter := min(place.size)) * (1 + 1e-9):
            expected = f"at most the shorter side of the face, {to_text(shorter, 'm')}"
            raise InputError("cells.size", to_text(asked.size, "m"), expected)
        m1, m2 = (max(1, round(length / asked.size)) for length in place.size)
        return m1, m2
    if asked.count is not None:
        return asked.count
    if "blocks" in case.methods:
        blocks = usual_blocks(shape)
        return PIECES * blocks[0], PIECES * blocks[1]
    if "two-scale" not in case.methods:
        return None
    if drawn is not None and "stochastic" in case.methods:
        return usual_pieces(place, in_place=case.layout.has_length and drawn.breadth is None)
    m1, m2 = (max(1, int(length / (8 * wave) + 1e-9)) for length in place.size)
    return m1, m2


def filter_doubts(case: Case, face: Surface, surface: Conditioning) -> Iterator[str]:
    """Warn where the low-pass removes much of the measured slope, and say what keeps it."""
    if case.surface.continue_spectrum is not None:
        return
    measured, kept = (
        to_text(wave, "m", 3) for wave in (surface.shortest_measured, surface.shortest_wave)
    )
    unseen = surface.shortest_wave == surface.shortest_seen  # as `femseal check` says
    if not unseen and surface.lost_slope > _LOST_SLOPE:
        size = face.shortest_patch.size
        remedy = f"set surface.points = {list(resolving_shape(size, surface.shortest_measured))}"
        if case.surface.shortest_wave is not None:
            also = " and surface.points" if case.surface.points else ""
            remedy = f"leave out surface.shortest_wave{also}"
        yield (
            f"the low-pass at {kept} removes {surface.lost_slope:.0%} of the rms slope of the face, whose waves down "
            f"to {measured} stand above noise: leakage may be off by factors; to keep them {remedy}"
        )
    noise = 1 - surface.rms_slope_measured / surface.rms_slope if surface.rms_slope else 0.0
    if noise > _NOISE_SLOPE:
        yield (
            f"{noise:.0%} of the rms slope is of waves from {kept} to {measured}, which are noise or beyond the "
            f"instrument: surface.shortest_wave = '{measured}' removes them"
        )


def is_measured(case: Case, surface: Surface) -> bool:
    """Tell whether a surface that is not flat was measured, at least one of its faces."""
    return bool(surface.rms_slope) and any(isinstance(table, FileFace) for table in case.face)


def form_check_pressures(case: Case, scene: Scene) -> tuple[float, ...]:
    """Choose the nominal pressures at which the effect of the form of a measured patch is to be solved [Pa].

    These are up to four of those on loading. There are none where the case says what is form: by `detrend`, by the
    form of a seat, or by that of the whole seal.
    """
    loads = [pressure for pressure in scene.steps.loading if pressure > 0]
    has_form = case.seat.kind != "flat" or bool(case.seal.form)
    if not loads or has_form or "detrend" in case.surface.model_fields_set:
        return ()
    return tuple(sorted({loads[n * (len(loads) - 1) // 3] for n in range(4)}))


def wound_layout(case: Case) -> Layout:
    """The shape of the seal. The lead of a spiral goes with the circumference, the length of a drawn strip.

    The grooves of one turned face that is generated wind with its pitch, unless the case says how its lay runs.
    """
    layout, circumference, face = case.layout, _circumference(case), case.face[0]
    if not isinstance(layout, RectangularLayout | AnnularLayout):
        return layout
    lay = layout.lay
    if (
        isinstance(face, TurnedFace)
        and face.pitch < face.size[0]
        and len(case.face) == 1
        and circumference is not None
        and "lay" not in case.seal.model_fields_set
    ):
        lay = Lay(name="spiral", lead=face.pitch)
    if lay.name == "spiral" and isinstance(layout, RectangularLayout) and lay.circumference is None:
        lay = replace(lay, circumference=circumference)
    return replace(layout, lay=lay)


def groove_question(case: Case, surface: Surface) -> Iterator[str]:
    """Ask of a measured face with grooves along x2 whether they wind."""
    measured = all(isinstance(face, FileFace) for face in case.face)
    if not measured or "lay" in case.seal.model_fields_set or _circumference(case) is None:
        return
    winds = isinstance(case.layout, RectangularLayout | AnnularLayout)
    if winds and (pitch := groove_pitch(surface)) is not None:
        lead = to_text(pitch, "m", 2)
        yield (
            f"the face has grooves along x2, {lead} apart. Where they wind once around the seal, as turned ones do, "
            "they leak past closed lands: is the face turned? Then set lay = "
            f"{{kind = 'spiral', lead = '{lead}'}} in [seal], or 'x2' where they are rings"
        )


def groove_pitch(surface: Surface) -> float | None:
    """Find the distance of grooves along x2 [m] that are equally far apart; None where the face has none.

    Of several patches it is the mean of their distances, None where one of them has no such grooves.
    """
    if not isinstance(surface, Topography):
        pitches = [groove_pitch(patch) for patch in surface.patches]
        known = [pitch for pitch in pitches if pitch is not None]
        return float(np.mean(known)) if len(known) == len(pitches) else None
    profile = surface.heights.mean(axis=1)
    if not profile.var() > _GROOVED * surface.heights.var():
        return None
    n = np.arange(profile.size)
    power = np.abs(np.fft.rfft(profile - np.polyval(np.polyfit(n, profile, 2), n))) ** 2
    power[:_LEAST_GROOVES] = 0.0
    waves = int(power.argmax())
    around = np.arange(waves - 1, min(waves + 2, power.size))
    near = power[around]
    if not near.sum() > _EVEN * power.sum() > 0:
        return None
    return surface.size[0] * float(near.sum()) / float(near @ around)


def _circumference(case: Case) -> float | None:
    """Length around the seal [m]; None of a face by itself."""
    layout, table = case.layout, case.stochastic
    if isinstance(layout, AnnularLayout):
        return layout.circumference
    return None if table is None else table.length


def check_memory_of_points(key: str, shape: tuple[int, int], patches: int = 1) -> None:
    """Raise InputError if a surface of so many points, those of all its patches, does not fit into the free memory."""
    together = f" of {patches} patches together" if patches > 1 else ""
    check_memory(key, f"{shape[0]} × {shape[1]} points{together}", prod(shape) * _POINT_BYTES)


def check_memory(key: str, given: object, needed: float) -> None:
    """Raise InputError, which names a key and its value, if so many bytes are not free."""
    if needed > (free := free_memory()):
        expected = f"what fits into the {free / 1e9:.3g} GB of free memory; it takes about {needed / 1e9:.3g} GB"
        raise InputError(key, given, expected)
