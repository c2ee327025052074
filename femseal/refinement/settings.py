"""What a run computes with where its case asks for an accuracy: the first choice, and what is refined after it."""

from dataclasses import asdict, dataclass, replace
from math import ceil, prod
from typing import Any

import numpy as np

from ..base import to_text
from ..case.case import Case
from ..preparation.prepared import Pair, Prepared, refused_if_too_large, without_short_waves
from ..studies.costs import contact_tolerance
from ..windows import Partition

#: Longest time of a run whose case asks for an accuracy and gives no time [s].
TIME_LIMIT = 3600.0
#: Doublings of the points of a face by which the first attempt and the finest are coarser or finer. The shortest wave
#: has 8 pixels on the points of a face: 4 in the first attempt, and 2 on the coarser grid that shows its error.
#: Measured: with 2 pixels the budget may be half of the error.
FIRST_GRID, MOST_GRID = -1, 4
#: Windows have at least this many pixels a side on the coarser grid that shows the error of an attempt.
_WINDOW_PIXELS = 8
#: Least residual of contact.
LEAST_RTOL = 1e-8
#: Seals that are drawn at first and at most. Windows of a library at first, of a face that has as few without overlap
#: and of others, and at most.
FIRST_SEALS, MOST_SEALS = 20, 20480
FIRST_WINDOWS, MOST_WINDOWS = (16, 32), 8192
#: Factor of the number of seals, and of library windows, that halves their error.
HALVING = 4


@dataclass(frozen=True)
class Settings:
    """What a run computes with where its case leaves it open.

    method : of the answer. grid : doublings of the points of the face a side, negative: halvings. rtol : residual of
    contact. cells : number of pieces, None without. library_cells, realisations : of drawn seals, None without.
    """

    method: str
    grid: int
    rtol: float
    cells: Pair | None
    library_cells: int | None
    realisations: int | None


def given_settings(case: Case) -> dict[str, str]:
    """Settings that the case gives, by the key that gives them."""
    found: dict[str, str] = {}
    if case.surface.points is not None:
        found["grid"] = "surface.points"
    if "rtol" in case.contact.model_fields_set:
        found["rtol"] = "contact.rtol"
    cells = case.cells
    if cells is not None and (cells.count is not None or cells.size is not None):
        found["cells"] = "cells.count" if cells.size is None else "cells.size"
    if (drawn := case.stochastic) is not None:
        for key in ("library_cells", "realisations"):
            if key in drawn.model_fields_set:
                found[key] = f"stochastic.{key}"
            elif drawn.width is not None:
                found[key] = "stochastic.width"
    return found


def first_settings(case: Case, made: Prepared) -> Settings:
    """The settings of the first attempt: coarse pixels, and few seals.

    made : the case as prepared, on the points of its face.
    """
    assert case.accuracy is not None
    given, sampling = given_settings(case), made.sampling
    settings = Settings(
        method=made.answer.name,
        grid=0,
        rtol=case.contact.rtol if "rtol" in given else contact_tolerance(case.accuracy),
        cells=made.cells,
        library_cells=None if sampling is None else sampling.library_cells,
        realisations=None if sampling is None else sampling.realisations,
    )
    if sampling is not None and "realisations" not in given:
        settings = replace(settings, realisations=FIRST_SEALS)
    if sampling is not None and sampling.pressure != "place" and "library_cells" not in given:
        settings = replace(settings, library_cells=int(np.clip(prod(made.cells or ()), *FIRST_WINDOWS)))
    coarse = replace(settings, grid=FIRST_GRID)
    # the coarser grid that shows the error needs windows too
    fits = has_windows(made, replace(coarse, grid=FIRST_GRID - 1))
    return coarse if fits and "grid" not in given else settings


def time_limit(case: Case) -> float:
    """Longest time of all attempts together [s]."""
    return TIME_LIMIT if case.time_limit is None else case.time_limit


def grid_points(shape: Pair, grid: int, cells: Pair | None) -> Pair:
    """Points of a face that is `grid` doublings finer, in whole pixels of its windows.

    >>> grid_points((64, 96), -1, None), grid_points((60, 96), -1, (4, 8)), grid_points((64, 96), 1, (4, 8))
    ((32, 48), (32, 48), (128, 192))
    """
    n1, n2 = (ceil(n * 2.0**grid / m) * m for n, m in zip(shape, cells or (1, 1), strict=True))
    return n1, n2


def has_windows(made: Prepared, settings: Settings) -> bool:
    """Whether the windows have enough pixels on a grid, and the face a few of them."""
    points = grid_points(made.scene.surface.shape, settings.grid, settings.cells)
    return min(n // m for n, m in zip(points, settings.cells or (1, 1), strict=True)) >= _WINDOW_PIXELS


def apply_settings(case: Case, made: Prepared, settings: Settings) -> Prepared:
    """The case with these settings: the same face on other points, and the rest as chosen.

    made : the case as prepared, on the points of its face.
    """
    surface = made.scene.surface
    points = grid_points(surface.shape, settings.grid, settings.cells)
    face = surface if points == surface.shape else surface.resample(points)
    if settings.cells is not None:
        Partition(points, face.spacing, settings.cells)  # refuses windows of too few pixels
    sampling = made.sampling
    if sampling is not None and settings.library_cells is not None and settings.realisations is not None:
        sampling = replace(sampling, library_cells=settings.library_cells, realisations=settings.realisations)
    return replace(
        made,
        scene=replace(made.scene, surface=face, rtol=settings.rtol),
        cells=settings.cells,
        sampling=sampling,
        conditioning=replace(made.conditioning, shape=face.shape, spacing=face.spacing),
    )


def first_version(case: Case, made: Prepared) -> Prepared:
    """What a run of a prepared case solves first: the case itself, or the first attempt at its accuracy.

    Raises InputError: a face too small for `surface.filter_sensitivity` on the points of the first attempt.
    """
    if case.accuracy is None:
        return made
    with refused_if_too_large():
        first = apply_settings(case, made, first_settings(case, made))
        if case.surface.filter_sensitivity:
            without_short_waves(first)
        return first


def last_version(case: Case, made: Prepared, attempts: dict[str, Any] | None) -> Prepared:
    """A prepared case with the settings of the last attempt of its results; the case itself without attempts."""
    if attempts is None or case.accuracy is None:
        return made
    found: dict[str, Any] = attempts["settings"]
    cells = None if found["cells"] is None else (found["cells"][0], found["cells"][1])
    return apply_settings(case, made, Settings(**found | {"cells": cells}))


def chosen(case: Case, made: Prepared) -> dict[str, Any]:
    """What a run of a prepared case computes first, see `Prepared.chosen`, and the settings of an accuracy."""
    if case.accuracy is None:
        return made.chosen
    settings = first_settings(case, made)
    plain = {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(settings).items()}
    return first_version(case, made).chosen | {f"settings.{name}": value for name, value in plain.items()}


def expected_cost(prepared: Prepared) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the answer of a prepared case, solved alone."""
    return replace(prepared, methods=frozenset({prepared.answer.name})).cost(prepared.answer)


@dataclass(frozen=True)
class Refinement:
    """Settings with which a source of error is about half as large; None where there are none.

    text : what is changed, or why nothing can be.
    """

    settings: Settings | None
    text: str


def refined(case: Case, made: Prepared, settings: Settings, part: str, memory: float) -> Refinement:
    """Refine one source of error.

    made : the case as prepared, on the points of its face. settings : of the last attempt.
    part : name of a part of its budget. memory : that an attempt may take [byte].
    """
    given = given_settings(case)
    # with the setting of each, which a case may give
    key, refine = {
        "solver": ("rtol", _contact_residual),
        "pixels": ("grid", _pixels),
        "filter": ("", _filter),
        "sampler": ("", _sampler),
        "library": ("", _library),
        "realisations": ("realisations", _realisations),
    }.get(part, ("", lambda *_: Refinement(None, "nothing refines it")))
    found = _is_given(given[key]) if key in given else refine(made, settings, given)
    if found.settings is None:
        return found
    needed = expected_cost(apply_settings(case, made, found.settings))[1]
    if needed > memory:
        needs, expected = (to_text(size, "B", 3) for size in (needed, memory))
        text = f"{found.text} would take about {needs} of memory, expected {expected}"
        return Refinement(None, text)
    return found


def _contact_residual(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    finer = settings.rtol / 10
    if finer < LEAST_RTOL * (1 - 1e-9):
        return Refinement(None, f"contact.rtol is {settings.rtol:.0e}, as small as it gets")
    return Refinement(replace(settings, rtol=finer), f"contact.rtol {finer:.0e}")


def _pixels(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    finer = replace(settings, grid=settings.grid + 1)
    points = " × ".join(map(str, grid_points(made.scene.surface.shape, finer.grid, finer.cells)))
    if finer.grid > MOST_GRID:
        return Refinement(None, f"pixels are {2**MOST_GRID} times finer than those of the face")
    return Refinement(finer, f"{points} points")


def _filter(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    wave = to_text(made.conditioning.shortest_wavelength, "m", 3)
    text = f"waves below {wave} were removed: a shorter surface.shortest_wave with more surface.points keeps them"
    return Refinement(None, f"{text}, as far as they were measured")


def _sampler(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    name = "" if made.sampling is None or made.sampling.sampler is None else f" {made.sampling.sampler}"
    return Refinement(None, f"the sampler{name} cuts the face into pieces: a longer face has longer ones")


def _library(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    """Settings with more windows in the library, or why there are none."""
    assert made.sampling is not None
    assert settings.library_cells is not None
    assert settings.cells is not None
    apart = prod(settings.cells)
    if made.sampling.pressure == "place" or settings.library_cells >= apart:
        return Refinement(None, f"the library has all windows of the face, {apart}: a larger one has more")
    if "library_cells" in given:
        return _is_given(given["library_cells"])
    more = min(HALVING * settings.library_cells, apart, MOST_WINDOWS)
    if more == settings.library_cells:
        return Refinement(None, f"the library has {more} windows, the most that are taken")
    return Refinement(replace(settings, library_cells=more), f"{more} library windows")


def _realisations(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    assert settings.realisations is not None
    more = HALVING * settings.realisations
    if more > MOST_SEALS:
        return Refinement(None, f"{settings.realisations} seals are drawn, the most that are")
    return Refinement(replace(settings, realisations=more), f"{more} seals")


def _is_given(*keys: str) -> Refinement:
    """Keys of the case that hinder a refinement."""
    return Refinement(None, f"{' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} given in the case")
