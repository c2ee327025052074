"""From a case to the input of the studies: faces are made or read, conditioned, and divided into windows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import ceil, inf
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import InputError
from ..base.quantities import to_text
from ..case.argument_names import FACE_KEYS, MAP_TABLES, SEAL_TABLES, SURFACE_KEYS, in_tables_of, in_words_of
from ..case.case_tables import StochasticTable
from ..case.faces import FileFace
from ..seal.layouts import SealWindows
from ..studies import Sampling, Scene, check_sampling, chosen_contact, chosen_flow, chosen_sampler, laid_out
from ..studies.costs import choose_method
from ..studies.window_pressures import check_map, most_paths
from ..topography import (
    MOST_POINTS,
    Conditioning,
    Overlap,
    Repair,
    SpikeEffect,
    TooManyUndefined,
    Topography,
    combine,
    default_wave,
    repair,
    resolved_wave,
    resolving_shape,
    smooth,
    spectrum,
    spike_effect,
)
from ..windows import Partition
from .case_plausibility import oddities
from .check_memory import refused_if_too_large, weigh_draws, weigh_points
from .settings import Settings, first_settings, settled

if TYPE_CHECKING:
    from ..case.case import Case

#: Share of the measured rms slope that the pixels of a measured face must keep to be fine enough.
KEPT_SLOPE = 0.99


@dataclass(frozen=True)
class Prepared:
    """Input of the studies: the scene, its windows, the sampling of seals; and the history of the surface.

    method, methods : to be run, with "auto" resolved; choice : reason of that choice, if there was one. contact, flow :
        of windows, see `studies.two_scale`. warnings : what is odd in the case. filtered : the scene of the second run
        that shows how leakage depends on the low-pass. settings, made : of a case that asks for an accuracy, what was
        chosen, and the case on the points of its face before that.
    """

    scene: Scene
    cells: tuple[int, int] | None
    sampling: Sampling | None
    conditioning: Conditioning
    overlap: Overlap | None
    method: str
    methods: frozenset[str]
    choice: str
    contact: str
    flow: str
    warnings: tuple[str, ...] = ()
    filtered: Scene | None = None
    settings: Settings | None = None
    made: Prepared | None = None

    @property
    def answer(self) -> str:
        """The method whose leakage is the answer: the one farthest from the face itself."""
        return next(method for method in ("stochastic", "two-scale", "deterministic") if method in self.methods)

    @property
    def chosen(self) -> dict[str, Any]:
        """What is computed, and how, whether the case says so or leaves it to the program, as plain data."""
        scene = self.scene
        found: dict[str, Any] = {
            "methods": sorted(self.methods),
            "points": list(scene.surface.shape),
            "shortest wave": self.conditioning.shortest_wavelength,
            "discretisation": scene.discretisation,
            "solver": scene.solver,
        }
        if self.cells is not None and self.methods & {"two-scale", "stochastic"}:
            found |= {"cells": list(self.cells), "contact of windows": self.contact}
        if "two-scale" in self.methods:
            found["flow of windows"] = self.flow
        if self.sampling is not None:
            found["sampler"] = self.sampling.sampler
        if self.settings is not None:
            told = {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self.settings).items()}
            found |= {f"settings.{name}": value for name, value in told.items()}
        return found

    @property
    def surface_report(self) -> dict[str, Any]:
        """The repair and conditioning of the surface, as plain data."""
        return asdict(self.conditioning) | ({} if self.overlap is None else {"overlap": asdict(self.overlap)})


def shares_contact(prepared: Prepared) -> bool:
    """Whether two scales take the contact of the whole face from the deterministic solution of the same run."""
    return prepared.methods >= {"deterministic", "two-scale"} and prepared.contact == "whole"


def coarser(prepared: Prepared) -> Scene:
    """The scene without waves shorter than twice the shortest one, on half the points a side.

    Raises
    ------
    InputError : waves longer than the face would be left, or windows of fewer than 8 pixels.
    """
    scene, wave = prepared.scene, 2 * prepared.conditioning.shortest_wavelength
    surface = scene.surface
    if wave >= max(surface.size):
        allowed = f"true only where the larger side holds more than {to_text(wave, 'm', 3)}, twice the shortest wave"
        raise InputError("surface.filter_sensitivity", True, allowed)
    m1, m2 = prepared.cells or (1, 1)
    shape = _multiple(ceil(surface.shape[0] / 2), m1), _multiple(ceil(surface.shape[1] / 2), m2)
    if prepared.cells is not None:
        Partition(shape, surface.spacing, prepared.cells)
    return replace(scene, surface=surface.low_pass(wave).resample(shape))


def prepare(case: Case) -> Prepared:
    """Make or read the faces, condition their sum, divide it into windows; choose what a wanted accuracy leaves open.

    Raises
    ------
    InputError : a face that cannot be read or used, or windows that do not suit it.
    """
    with refused_if_too_large():
        made = _prepare(case)
        return made if case.accuracy is None else chosen_as(case, made, first_settings(case, made))


def chosen_as(case: Case, made: Prepared, settings: Settings) -> Prepared:
    """A case that asks for an accuracy with these settings; `made` is the case on the points of its face."""
    prepared = settled(case, made, settings)
    return replace(prepared, filtered=coarser(prepared)) if case.surface.filter_sensitivity else prepared


def _prepare(case: Case) -> Prepared:
    for place, table in zip(face_places(case), case.face, strict=True):
        if not isinstance(table, FileFace):
            weigh_points(f"{place}.points", table.points)
    raw, separately, overlap, spikes = _combined_faces(case)
    with in_words_of(SURFACE_KEYS), _in_the_whole_map(case.face[0]):
        flat, repaired = repair(
            raw, spikes=spikes, max_undefined=case.surface.max_undefined, detrend=case.surface.detrend
        )
    shape = _grid(case, flat)
    wave = case.surface.shortest_wave or default_wave(flat, shape)
    cells = _cell_count(case, flat.size, wave)
    weigh_points("surface.points", shape)
    if cells is not None:
        shape = (_multiple(shape[0], cells[0]), _multiple(shape[1], cells[1]))
        weigh_points("cells", shape)
        Partition(shape, flat.spacing, cells)  # refuses windows of too few pixels
    with in_words_of(SURFACE_KEYS):
        surface, report = smooth(flat, repaired, shortest_wavelength=wave, shape=shape)
    report = _of_generated(case, flat, replace(report, **_found(separately, wave)))
    sampling = None
    if cells is not None:
        window = Partition(surface.shape, surface.spacing, cells).window_size
        if min(window) < 2 * report.shortest_wavelength * (1 - 1e-9):
            sizes = " × ".join(to_text(w, "m", 3) for w in window)
            least = to_text(2 * report.shortest_wavelength, "m", 3)
            raise InputError("cells", f"windows of {sizes}", f"windows of at least two shortest waves, {least}")
        if case.stochastic is not None and "stochastic" in case.methods:
            sampling = _sampling(case, case.stochastic, window[1])
            with in_tables_of(SEAL_TABLES):
                check_sampling(sampling)
    every: tuple[SealWindows, ...] = ()
    seal = surface.size
    if sampling is not None and cells is not None:
        with in_tables_of(SEAL_TABLES):
            every = laid_out(case.layout, Partition(surface.shape, surface.spacing, cells), sampling)
        seal = _seal_size(sampling, surface, every[0])
    scene = Scene(
        surface=surface,
        modulus=case.modulus,
        hardness=case.hardness,
        fluid=case.fluid.fluid,
        inlet_pressure=case.fluid.inlet_pressure,
        outlet_pressure=case.fluid.outlet_pressure,
        **_pressures(case, seal, seals=len(every)),
        boundary=case.contact.boundary,
        rtol=case.contact.rtol,
        layout=case.layout,
        solver=case.flow.solver,
        discretisation=case.flow.discretisation,
    )
    doubts: tuple[str, ...] = ()
    if sampling is not None:
        with in_tables_of(MAP_TABLES):
            sampling = replace(sampling, pressure_map=case.load.pressure_map(case.folder, seal[0] * seal[1], seal[1]))
            check_sampling(sampling)
        paths = most_paths(sampling.pressure_map)
        for laid in every:
            weigh_draws(len(scene.steps), laid.draws[0], sampling.realisations, sampling.library_cells, paths)
        with in_tables_of(MAP_TABLES):
            doubts = (*every[0].warnings, *check_map(scene, every[0], sampling.pressure_map))
    method: str = case.method
    choice = ""
    # where the deterministic solution is not affordable, resolved flow is not either
    cheaper = "elements" if scene.discretisation == "edge" else "links"
    if method == "auto":
        assert cells is not None
        method, choice = choose_method(len(scene.steps), surface.shape, cells, cheaper)
    methods = frozenset({method, *case.compare})
    effect = SpikeEffect(report.spikes_along_lay, report.spikes_extreme)
    odd = (*oddities(case, scene, report), *effect.doubts(report.spikes), *doubts)
    contact, flow = (None, None) if case.cells is None else (case.cells.contact, case.cells.flow)
    if flow is None and case.method == "auto" and method == "two-scale":
        flow = cheaper
    contact = chosen_contact(contact, surface.shape)
    flow = chosen_flow(flow, surface.shape, scene.discretisation)
    if sampling is not None:
        sampling = replace(sampling, sampler=chosen_sampler(sampling, scene, contact))
    prepared = Prepared(scene, cells, sampling, report, overlap, method, methods, choice, contact, flow, odd)
    return replace(prepared, filtered=coarser(prepared)) if case.surface.filter_sensitivity else prepared


def face_places(case: Case) -> list[str]:
    """Where the faces are in the file: one table has no number there."""
    return ["face"] if len(case.face) == 1 else [f"face.{n}" for n in range(len(case.face))]


def _sampling(case: Case, table: StochasticTable, window_length: float) -> Sampling:
    if table.lengths and min(table.lengths) < window_length * (1 - 1e-9):
        cell, given = to_text(window_length, "m", 3), to_text(min(table.lengths), "m", 3)
        raise InputError("stochastic.length", given, f"at least one cell, {cell}")
    return Sampling(
        length=table.lengths[0] if table.lengths else None,
        other_lengths=table.lengths[1:],
        breadth=table.breadth,
        realisations=table.realisations,
        resampled=case.output.budget or table.width is not None or case.accuracy is not None,
        library_cells=table.library_cells,
        seed=case.seed,
        sampler=table.sampler,
        pressure=table.pressure,
        library=None if table.library is None else case.folder / table.library,
        width=table.width,
        bounds=table.bounds,
    )


def _seal_size(sampling: Sampling, surface: Topography, laid: SealWindows) -> tuple[float, float]:
    """Breadth and length of the seal that loads act on [m]: as given, not in whole windows."""
    if sampling.length is None:
        breadth, length = laid.seal.size
        return breadth, length
    return surface.size[0] if sampling.breadth is None else sampling.breadth, sampling.length


def _pressures(case: Case, seal: tuple[float, float], *, seals: int) -> dict[str, tuple[float, ...]]:
    """Nominal pressures of the cycle on a seal of such a breadth and length [m], one of several or none that are drawn.

    Raises
    ------
    InputError : a force without one length of the seal, or pressures not below the hardness.
    """
    if case.load.unit == "N" and seals != 1:
        given = f"forces on a seal of {'several lengths' if seals else 'no length'}"
        raise InputError("load.loading", given, "pressures, or forces per length")
    area = seal[0] * seal[1]
    found = case.load.pressures(area, seal[1])
    highest = max((*found["loading"], *found["unload_from"]))
    if highest >= case.hardness:
        load = to_text(case.load.highest, case.load.unit)
        given = f"{load} on {1e6 * area:.4g} mm², {to_text(highest, 'Pa')}"
        raise InputError("load", given, f"pressures below the hardness, {to_text(case.hardness, 'Pa')}")
    return found


def _combined_faces(case: Case) -> tuple[Topography, list[tuple[Topography, Repair]], Overlap | None, float]:
    """One face as it is, or the sum of two repaired ones.

    Also returned: the repairs of the two, their overlap, and the threshold of the spikes that the sum still has.
    """
    # every face has its own random stream, independent of later draws of the method
    seeds = np.random.SeedSequence(case.seed).spawn(len(case.face))
    faces = []
    for place, table, seed in zip(face_places(case), case.face, seeds, strict=True):
        of_file = isinstance(table, FileFace)
        words = {key: f"{place}.{key}" for key in ("crop", "mask", "file_mask")} if of_file else FACE_KEYS
        with in_words_of(words, "" if of_file else place):
            faces.append(table.make(case.folder, np.random.default_rng(seed)))
    thresholds = [case.surface.spikes if isinstance(table, FileFace) else inf for table in case.face]
    if len(faces) == 1:
        return faces[0], [], None, thresholds[0]
    treatment: dict[str, Any] = {"max_undefined": case.surface.max_undefined, "detrend": case.surface.detrend}
    repaired = []
    for place, table, face, most in zip(face_places(case), case.face, faces, thresholds, strict=True):
        with in_words_of(SURFACE_KEYS, place), _in_the_whole_map(table):
            repaired.append(repair(face, spikes=most, **treatment))
    first, second = (face for face, _ in repaired)
    table = case.face[1]
    surface, overlap = combine(first, second, **(table.placement if isinstance(table, FileFace) else {}))
    return surface, repaired, overlap, inf


def _of_generated(case: Case, flat: Topography, report: Conditioning) -> Conditioning:
    """The report of a generated face says what the low-pass removes of the waves that were made."""
    made = [
        table.cut_off or resolved_wave(table.size, table.points)
        for table in case.face
        if not isinstance(table, FileFace)
    ]
    if len(made) < len(case.face) or min(made) <= report.shortest_measured:
        return report
    slope = flat.low_pass(min(made)).rms_slope
    return replace(report, shortest_measured=min(made), rms_slope_measured=slope)


def _found(repaired: list[tuple[Topography, Repair]], wavelength: float) -> dict[str, Any]:
    """What the report says of two faces that were repaired before they were summed; nothing of a single one."""
    if not repaired:
        return {}
    effects = [spike_effect(face, repair.removed, wavelength) for face, repair in repaired]
    return {
        "undefined_share": sum(r.undefined_share for _, r in repaired) / len(repaired),
        "spikes": sum(r.spikes for _, r in repaired),
        "spikes_along_lay": max((e.along_lay for e in effects if e.along_lay is not None), default=None),
        "spikes_extreme": max((e.extreme for e in effects if e.extreme is not None), default=None),
    }


@contextmanager
def _in_the_whole_map(table: Any) -> Iterator[None]:
    """Name the part of a map that has few undefined points by its place in the whole map of the file."""
    try:
        yield
    except TooManyUndefined as error:
        crop = table.crop if isinstance(table, FileFace) else None
        raise error if crop is None else error.from_origin(crop[0], crop[2]) from None


def _grid(case: Case, flat: Topography) -> tuple[int, int]:
    """Points of the grid: those of the case, or of a generated face, or what the shortest measured wave takes.

    A measured face keeps its own pixels where waves of 8 of them have nearly all of its slope.
    """
    if case.surface.points is not None:
        return case.surface.points
    if not any(isinstance(face, FileFace) for face in case.face):
        return flat.shape
    return default_grid(flat, case.surface.shortest_wave)


def default_grid(flat: Topography, shortest_wave: float | None) -> tuple[int, int]:
    """Points on which a measured face is solved unless told otherwise, see `topography.resolving_shape`.

    Parameters
    ----------
    flat : without undefined points.
    shortest_wave : the low-pass, which decides if it is given [m].
    """
    own, few = resolved_wave(flat.size, flat.shape), flat.heights.size <= MOST_POINTS
    if shortest_wave is None:
        measured = spectrum(flat).shortest_wave
        enough = flat.low_pass(own).rms_slope >= KEPT_SLOPE * flat.low_pass(measured).rms_slope
        return (
            flat.shape if enough and few else resolving_shape(flat.size, own if enough else measured, most=MOST_POINTS)
        )
    if shortest_wave >= own and few:
        return flat.shape
    shape = resolving_shape(flat.size, min(shortest_wave, own), most=MOST_POINTS)
    wide = resolved_wave(flat.size, shape) > shortest_wave
    return resolving_shape(flat.size, shortest_wave) if wide else shape


def _cell_count(case: Case, face: tuple[float, float], wave: float) -> tuple[int, int] | None:
    if case.methods == {"deterministic"} or (case.cells is None and case.method != "auto" and case.accuracy is None):
        return None
    if case.cells is not None and case.cells.count is not None:
        return case.cells.count
    if case.cells is not None and case.cells.size is not None:
        size, shorter = case.cells.size, min(face)
        if size > shorter * (1 + 1e-9):
            allowed = f"at most the shorter side of the face, {to_text(shorter, 'm')}"
            raise InputError("cells.size", to_text(size, "m"), allowed)
    else:  # eight shortest waves: shorter windows cut off more paths than two scales save
        size = 8 * wave
    m1, m2 = (max(1, round(length / size)) for length in face)
    return m1, m2


def _multiple(n: int, of: int) -> int:
    return ceil(n / of) * of
