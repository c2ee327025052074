"""Options of a drawn seal, and the check that they go together."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..base import InputError, counted, to_text, validate
from ..seal.laid_windows import SealWindows, Windows
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, MapsAtLoads, Profile, Uniform, is_uniform
from ..windows import Partition
from .choices import DRAWS, PRESSURES
from .face_contact import chosen_contact
from .scene import Scene
from .seat_rows import SeatMap


@dataclass(frozen=True)
class Sampling:
    """Options of a drawn seal.

    length : length of a straight seal along x2 [m], rounded to whole cells; None where the layout has its own size.
    other_lengths : of further seals that are drawn from the same library [m].
    breadth : size from inlet to outlet of a straight seal [m], rounded to whole cells; that of the face unless given;
        "uniform" only.
    realisations : number of seals that are drawn.
    library_cells : number of windows in the library.
    seed : of all random numbers.
    sampler : "history", "derivative", "copula" or "block", see `library.sampling`, or "runs", see `chosen_sampler`.
        "runs", with the pressure "place" and the discretisation "edge", makes straight seals of runs of an eighth to a
        half of the face's columns, whose flow is solved by finite elements, see `library.column_runs`; `length` is
        rounded to whole runs.
    pressure : the source of the windows and of their pressures.
        "place": all windows of the face at their places. A link draws from the windows of its row. If `library_cells`
        asks for more than the face has, they are cut again, moved by fractions of their width, except for "runs"; this
        adds no area, and the error of the library stays that of the windows of the face. For faces whose form varies
        over a window.
        "global": windows with all their waves, solved along a ladder of pressures. The global contact of the face,
        repeated along the seal, gives the pressure of each link (Pérez-Ràfols et al., 2018).
        "uniform": windows with the full heights. Every link has the nominal pressure, or that of `pressure_map`.
    pressure_map : contact pressure over the seal in fractions of the nominal one, see `seal.pressure_map`; one that is
        not uniform goes with "uniform" only. A `SeatMap` is a form of the seat that is broader than the face.
    library : folder in which libraries of windows are kept and found again; "global" and "uniform" only.
    width : wanted standard error of ln(median leakage) at the steps that leak more than 1e-3 of the first. Realisations
        and windows are added until it is reached, up to eight times as many. With None none are added.
    bounds : also compute bounds of the flow of every window, and so of the leakage, for a gap constant on each pixel.
        The library then takes about three times as long. "global" and "uniform" with the sampler "history" only.
    resampled : also draw as many seals from libraries that are drawn with repetition from the library, which shows the
        error of the library; `width` needs it.
    median_fields : also keep the fields of the seal whose leakage is nearest to the median.
    """

    length: float | None
    realisations: int
    library_cells: int
    seed: int
    sampler: str | None = None
    pressure: str = "place"
    pressure_map: AnyMap | SeatMap = field(default_factory=Uniform)
    library: Path | None = None
    width: float | None = None
    breadth: float | None = None
    bounds: bool = False
    other_lengths: tuple[float, ...] = ()
    resampled: bool = True
    median_fields: bool = True

    @property
    def sampler_of_links(self) -> str:
        """The given sampler, or the one of links that suits `pressure`."""
        return self.sampler or ("block" if self.pressure == "place" else "history")


def chosen_sampler(sampling: Sampling, scene: Scene, contact: str | None = None) -> str:
    """The sampler given, or the one that suits the pressure.

    It is "history" where windows have no neighbours. With the pressure "place" it is "runs", or "block" where the seal
    is not straight, flow is not solved between pixels ("edge"), or the contact is solved by windows: one that fails
    would take its runs with it.
    """
    whole = chosen_contact(contact, scene.contact_shape) == "whole"
    runs = whole and scene.discretisation == "edge" and scene.layout.kind == "rectangular"
    if sampling.sampler is None and sampling.pressure == "place" and runs:
        return "runs"
    return sampling.sampler_of_links


def lay_out_windows(layout: Layout, partition: Partition, sampling: Sampling) -> tuple[SealWindows, ...]:
    """Windows of a face laid out over the seal that is drawn, and over those of the other lengths.

    Raises InputError: as the layout does; options of the sampling that do not go with it; lengths that are the same in
    whole cells.
    """
    every = tuple(
        _laid_out(layout, partition, replace(sampling, length=length))
        for length in (sampling.length, *sampling.other_lengths)
    )
    lengths = [to_text(seal_windows.seal.size[1], "m") for seal_windows in every]
    if len({*lengths}) < len(lengths):
        raise InputError("length", ", ".join(lengths) + " in whole cells", "lengths that differ")
    return every


def _laid_out(layout: Layout, partition: Partition, sampling: Sampling) -> SealWindows:
    """Windows laid out over the seal of one length, checked against the options of the sampling."""
    windows = Windows(partition.window_size, partition.cells[0], sampling.length, sampling.breadth)
    seal_windows = layout.lay_out(windows)
    if seal_windows.together and sampling.pressure != "uniform":
        raise InputError("pressure", f"'{sampling.pressure}' with {layout}", "'uniform'")
    if seal_windows.together and sampling.sampler_of_links != "history":
        raise InputError("sampler", sampling.sampler_of_links, f"history with {layout}, whose elements take windows")
    if seal_windows.together and sampling.bounds:
        raise InputError("bounds", "true", f"false with {layout}")
    if sampling.sampler_of_links == "runs" and layout.kind != "rectangular":
        raise InputError("sampler", "runs", f"another one with {layout}")
    if sampling.pressure != "uniform" and seal_windows.rows != partition.cells[0]:
        face = f"a face with {counted(partition.cells[0], 'row')} of windows"
        given = f"'{sampling.pressure}' of {face} for {layout}, which has {seal_windows.rows or 'none'}"
        raise InputError("pressure", given, "'uniform', or as many rows from inlet to outlet on both")
    return seal_windows


def count_face_windows(sampling: Sampling, partition: Partition) -> int:
    """Number of windows that the pressure "place" takes from a face: all of its windows, once for every shift."""
    of_face = partition.cells[0] * partition.cells[1]
    if sampling.sampler == "runs":
        return of_face
    return of_face * int(np.clip(-(-sampling.library_cells // of_face), 1, partition.window[1]))


def check_sampling(sampling: Sampling) -> None:
    """Raise InputError for an unknown option, or for two that do not go together."""
    if sampling.sampler_of_links not in DRAWS:
        raise InputError("sampler", sampling.sampler, f"one of {', '.join(DRAWS)}")
    if sampling.pressure not in PRESSURES:
        raise InputError("pressure", sampling.pressure, f"one of {', '.join(PRESSURES)}")
    if (links := sampling.sampler_of_links) in ("block", "runs") and sampling.pressure != "place":
        raise InputError("sampler", links, "another one, or the pressure 'place', whose windows are neighbours")
    if sampling.breadth is not None and (sampling.pressure != "uniform" or not sampling.breadth > 0):
        raise InputError("breadth", sampling.breadth, "a length > 0 with the pressure 'uniform', none with others")
    if sampling.pressure != "uniform" and not is_uniform(sampling.pressure_map):
        allowed = "a uniform one, or another with the pressure 'uniform', whose windows follow any pressure"
        raise InputError("map", f"an uneven one with the pressure '{sampling.pressure}'", allowed)
    if sampling.other_lengths and not isinstance(sampling.pressure_map, Uniform | Profile | SeatMap):
        raise InputError("map", "one that may vary along seals of several lengths", "a profile, or one length")
    if isinstance(sampling.pressure_map, MapsAtLoads | SeatMap) and sampling.sampler_of_links != "history":
        allowed = "history with several maps, under which windows may be unloaded while the seal is loaded"
        raise InputError("sampler", sampling.sampler_of_links, allowed)
    if sampling.library is not None and sampling.pressure == "place":
        raise InputError("library", f"'{sampling.library}'", "none with the pressure 'place', which has no ladder")
    if sampling.width is not None:
        validate.number("width", sampling.width, unit="1")
    if sampling.bounds and (sampling.pressure == "place" or sampling.sampler_of_links != "history"):
        given = f"true with the pressure '{sampling.pressure}' and the sampler '{sampling.sampler_of_links}'"
        raise InputError("bounds", given, "true with 'global' or 'uniform' and 'history'")
