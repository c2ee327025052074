"""What to refine where a source of error limits a leakage, and why it cannot be refined."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod

from ..base.quantities import to_text
from ..case.case import Case
from ..preparation.prepared import Prepared
from .settings import (
    HALVING,
    LEAST_RTOL,
    MOST_GRID,
    MOST_SEALS,
    MOST_WINDOWS,
    Settings,
    apply_settings,
    expected_cost,
    given_settings,
    grid_points,
)


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
        "windows": ("", _windows),
        "two scales": ("", _windows),
        "sampler": ("", _sampler),
        "library": ("", _library),
        "realisations": ("realisations", _realisations),
    }.get(part, ("", lambda *_: Refinement(None, "nothing refines it")))
    found = _is_given(given[key]) if key in given else refine(made, settings, given)
    if found.settings is None:
        return found
    needed = expected_cost(apply_settings(case, made, found.settings))[1]
    if needed > memory and found.settings.method == "deterministic" and "method" not in given and settings.cells:
        flow = "elements" if made.scene.discretisation == "edge" else "links"
        cheaper = replace(found.settings, method="two-scale", flow=flow)
        less = expected_cost(apply_settings(case, made, cheaper))[1]
        if less < needed:
            found, needed = Refinement(cheaper, f"{found.text}, two scales with {flow}"), less
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


def _windows(made: Prepared, settings: Settings, given: dict[str, str]) -> Refinement:
    """Whole contact, then flow without links, then larger windows."""
    hinders = []
    if settings.contact == "windows":
        if "contact" not in given:
            return Refinement(replace(settings, contact="whole"), "contact of the whole face")
        hinders.append(given["contact"])
    if settings.method == "two-scale" and settings.flow != "resolved":
        if "flow" not in given:
            better = "elements" if settings.flow == "links" and made.scene.discretisation == "edge" else "resolved"
            return Refinement(replace(settings, flow=better), f"flow {better}")
        hinders.append(given["flow"])
    if "cells" in given:
        return _is_given(*hinders, given["cells"])
    cells = settings.cells or (1, 1)
    m1, m2 = (m // 2 if m % 2 == 0 else m for m in cells)
    if (m1, m2) == cells:
        return Refinement(None, f"{cells[0]} × {cells[1]} windows cannot be halved: a larger face has larger ones")
    return Refinement(replace(settings, cells=(m1, m2)), f"{m1} × {m2} windows")


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
        return Refinement(None, f"all {apart} windows of the face are in the library: a larger face has more")
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
