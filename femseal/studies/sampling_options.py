"""Options of a drawn seal, and the check that they go together."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base import validate
from ..base.errors import InputError
from ..scales import SAMPLERS, Partition
from .face_contact import chosen_contact
from .scene import Scene

#: Choices of the pressures and the waves of windows, see `Sampling.pressure`.
PRESSURES = ("place", "global", "uniform")
#: Choices of `Sampling.sampler`: those that draw links, and runs of columns.
DRAWS = (*SAMPLERS, "runs")


@dataclass(frozen=True)
class Sampling:
    """Options of a drawn seal.

    length : length of the seal along x2 [m], rounded to whole cells.
    breadth : size from inlet to outlet [m], rounded to whole cells; that of the face unless given; "uniform" only.
    realisations : number of seals that are drawn.
    library_cells : number of windows in the library.
    seed : of all random numbers.
    sampler : "history", "derivative", "copula" or "block", see `scales.sampling`, or "runs", see `chosen_sampler`.
        "runs", with the pressure "place" and the discretisation "edge", makes seals of runs of an eighth to a half of
        the face's columns, whose flow is solved by finite elements, see `scales.column_runs`; `length` is rounded to
        whole runs.
    pressure : the source of the windows and of their pressures.
        "place": all windows of the face at their places. A link draws from the windows of its row. If `library_cells`
        asks for more than the face has, they are cut again, moved by fractions of their width, except for "runs"; this
        adds no area, and the error of the library stays that of the windows of the face. For faces whose
        form varies over a window.
        "global": windows with all their waves, followed along a ladder of pressures. The global contact of the face,
        repeated along the seal, gives the pressure of each link (Pérez-Ràfols et al., 2018).
        "uniform": windows with the full heights. Every link has the nominal pressure, or its share in `profile`.
    profile : contact pressure of each row of windows from inlet to outlet in shares of the nominal one; their mean is
        1; "uniform" only.
    library : folder in which libraries of windows are kept and found again; "global" and "uniform" only.
    width : wanted standard error of ln(median leakage) at the steps that leak more than 1e-3 of the first. Realisations
        and windows are added until it is reached, up to eight times as many. With None none are added.
    bounds : also compute bounds of the flow of every window, and so of the leakage, for a gap constant on each pixel.
        The library then takes about three times as long. "global" and "uniform" with the sampler "history" only.
    """

    length: float
    realisations: int
    library_cells: int
    seed: int
    sampler: str | None = None
    pressure: str = "place"
    profile: tuple[float, ...] = ()
    library: Path | None = None
    width: float | None = None
    breadth: float | None = None
    bounds: bool = False


def chosen_sampler(sampling: Sampling, scene: Scene, contact: str | None = None) -> str:
    """The sampler given, or the one that suits the pressure.

    It is "history" where windows have no neighbours. With the pressure "place" it is "runs", or "block" where flow is
    not solved between pixels ("edge"), or the contact not as a whole: then a window may fail, and runs with it.
    """
    if sampling.sampler is not None or sampling.pressure != "place":
        return sampling.sampler or "history"
    whole = chosen_contact(contact, scene.surface.shape) == "whole"
    return "runs" if whole and scene.discretisation == "edge" else "block"


def seal_cells(partition: Partition, sampling: Sampling) -> tuple[int, int]:
    """Number of windows of a drawn seal along x1 and along x2."""
    d1, d2 = partition.window_size
    n1 = partition.cells[0] if sampling.breadth is None else max(1, round(sampling.breadth / d1))
    return n1, max(1, round(sampling.length / d2))


def placed_windows(sampling: Sampling, partition: Partition) -> int:
    """Number of windows that the pressure "place" takes from a face: all of its windows, once for every shift."""
    of_face = partition.cells[0] * partition.cells[1]
    if sampling.sampler == "runs":
        return of_face
    return of_face * int(np.clip(-(-sampling.library_cells // of_face), 1, partition.window[1]))


def check_sampling(sampling: Sampling, cells: tuple[int, int]) -> None:
    """Raise InputError for an unknown option, or for two that do not go together."""
    if sampling.sampler is not None and sampling.sampler not in DRAWS:
        raise InputError.of("sampler", sampling.sampler, f"one of {', '.join(DRAWS)}")
    if sampling.pressure not in PRESSURES:
        raise InputError.of("pressure", sampling.pressure, f"one of {', '.join(PRESSURES)}")
    if sampling.sampler in ("block", "runs") and sampling.pressure != "place":
        allowed = "another one, or the pressure 'place', whose windows are neighbours"
        raise InputError.of("sampler", sampling.sampler, allowed)
    if sampling.breadth is not None and (sampling.pressure != "uniform" or not sampling.breadth > 0):
        raise InputError.of("breadth", sampling.breadth, "a length > 0 with the pressure 'uniform', none with others")
    if sampling.profile:
        if sampling.pressure != "uniform":
            raise InputError.of("profile", sampling.profile, "none except with the pressure 'uniform'")
        shares = np.asarray(sampling.profile, float)
        rows = cells[0] if sampling.breadth is None else shares.size
        if shares.shape != (rows,) or not np.all(shares >= 0) or abs(shares.mean() - 1) > 1e-6:
            raise InputError.of("profile", sampling.profile, f"{rows} numbers >= 0 with the mean 1")
    if sampling.library is not None and sampling.pressure == "place":
        raise InputError.of("library", f"'{sampling.library}'", "none with the pressure 'place', which has no ladder")
    if sampling.width is not None:
        validate.number("width", sampling.width, unit="1")
    if sampling.bounds and (sampling.pressure == "place" or sampling.sampler not in (None, "history")):
        given = f"true with the pressure '{sampling.pressure}'"
        if sampling.sampler is not None:
            given += f" and the sampler '{sampling.sampler}'"
        raise InputError.of("bounds", given, "true with 'global' or 'uniform' and 'history'")
