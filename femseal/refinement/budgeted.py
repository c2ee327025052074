"""The error budgets of a run: the coarser solutions that they need, and the budget of every study."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import log2
from typing import Any

import numpy as np

from ..base.errors import FemsealError, InputError, NotKept
from ..budget import (
    LEAST_LOADS,
    CoarserSolution,
    ErrorBudget,
    at_some_steps,
    change_of_windows,
    coarser_points,
    error_budget,
)
from ..preparation.preparation import Prepared, coarser
from ..studies import Scene, StochasticResult
from ..studies.scene import Array

log = logging.getLogger("femseal")
#: One of so many steps is solved on a coarser grid, and one of so many without the shortest waves.
GRID_STRIDE, FILTER_STRIDE = 2, 4
#: Share of the windows of a library that are solved again on the coarser grid, and the least number of them; they are
#: compared window by window.
COARSE_WINDOWS, LEAST_WINDOWS = 0.25, 4
#: Pixels to the shortest wave from which on a grid of a quarter of the points a side carries the waves too.
THIRD_GRID_PIXELS = 16.0
#: Octaves of removed waves from which on they matter.
LEAST_OCTAVES = 0.05
#: Solves a method for an input, with the studies of it that are known by name: solve(method, prepared, known).
Solve = Callable[[str, Prepared, Mapping[str, Any]], Any]


def budgets_of(
    prepared: Prepared,
    studies: Mapping[str, Any],
    solve: Solve,
    *,
    leakage_filtered: Array | None = None,
    known: Mapping[str, ErrorBudget] | None = None,
) -> dict[str, ErrorBudget]:
    """Error budget of every study of a run, by its name in `studies`.

    Parameters
    ----------
    leakage_filtered : of the answer at every step without waves up to twice the shortest one, where that was solved.
    known : budgets that are there already, by the names of their studies.
    """
    budgets = dict(known or {})
    left = {name: study for name, study in studies.items() if name not in budgets}
    if not left:
        return budgets
    answer = prepared.answer.replace("-", "_")
    grids = coarser_grids(prepared, leakage_of(studies[answer]))
    solved = [_solved(grid, solve) for grid in grids]
    smooth = filtered_input(prepared, leakage_of(studies[answer]))
    again = {} if smooth is None or leakage_filtered is not None else _solved(smooth, solve)
    for name, study in left.items():
        coarse = [
            against(study, grid, found.get(route(prepared, name))) for grid, found in zip(grids, solved, strict=True)
        ]
        if not grids:  # windows of too few pixels to be halved: nothing is known
            steps = prepared.scene.steps
            coarse = [CoarserSolution(prepared.scene.surface.shape, steps, np.full(len(steps), np.nan))]
        filtered = None if smooth is None else against(study, smooth, again.get(route(prepared, name)))
        if smooth is not None and leakage_filtered is not None:
            filtered = CoarserSolution(
                smooth.scene.surface.shape, study.steps, leakage_filtered, leakage_of(studies[answer])
            )
        budgets[name] = error_budget(
            prepared.scene,
            study,
            coarse=coarse,
            filtered=filtered,
            octaves=removed_octaves(prepared),
            compared=_links_compared(grids[0], solved[0]) if grids and name == "two_scale" else None,
            wave_pixels=wave_pixels(prepared),
        )
    return budgets


def leakage_of(study: Any) -> Array:
    """Leakage of a study at every step (steps,): of drawn seals their median."""
    return study.quantile(0.5) if isinstance(study, StochasticResult) else study.leakage


def route(prepared: Prepared, name: str) -> str:
    """Method that has the same contact and flow as a study on a coarser grid, by its name in results.

    The deterministic one stands for two scales whose contact and flow are those of the whole face, and for seals drawn
    as runs of it.
    """
    whole = prepared.contact == "whole"
    if name == "two_scale" and whole and prepared.flow != "links":
        return "deterministic"
    runs = prepared.sampling is not None and prepared.sampling.sampler == "runs"
    return "deterministic" if name == "stochastic" and whole and runs else name


def coarser_grids(prepared: Prepared, leakage: Array | None = None) -> list[Prepared]:
    """Inputs on half of the points a side, and on a quarter where that carries the waves, at some of the steps.

    leakage : of the answer, which tells what steps are near closing.
    """
    # where the filter or the comparison of links takes its share of the time too, no more steps than every other
    least = 0 if removed_octaves(prepared) >= LEAST_OCTAVES or _by_links(prepared) else LEAST_LOADS
    some = _some_steps(prepared, leakage, GRID_STRIDE, least)
    points = coarser_points(prepared.scene.surface.shape, _cells(prepared))
    if points is None:
        return []
    every = [points]
    pixel = max(prepared.scene.surface.spacing)
    if prepared.conditioning.shortest_wavelength >= THIRD_GRID_PIXELS * pixel * (1 - 1e-9):
        quarter = coarser_points(points, _cells(prepared))
        every += [] if quarter is None else [quarter]
    return [_reduced(prepared, replace(some, surface=some.surface.resample(shape))) for shape in every]


def filtered_input(prepared: Prepared, leakage: Array | None = None) -> Prepared | None:
    """Input without waves up to twice the shortest one, at some of the steps; None where no waves were removed."""
    if removed_octaves(prepared) < LEAST_OCTAVES:
        return None
    try:
        smooth = coarser(replace(prepared, cells=_cells(prepared)))
    except InputError as error:
        log.warning("error budget: no solution without the shortest waves: %s", error)
        return None
    some = _some_steps(prepared, leakage, FILTER_STRIDE, 0)
    return _reduced(prepared, replace(some, surface=smooth.surface))


def wave_pixels(prepared: Prepared) -> float:
    """Pixels of the scene to its shortest wave."""
    return prepared.conditioning.shortest_wavelength / max(prepared.scene.surface.spacing)


def removed_octaves(prepared: Prepared) -> float:
    """Octaves of waves above noise that the low-pass removed from the face."""
    found = prepared.conditioning
    if not found.lost_slope > 0:
        return 0.0
    return max(0.0, log2(found.shortest_wavelength / found.shortest_measured))


def _cells(prepared: Prepared) -> tuple[int, int] | None:
    """Windows that coarser solutions need too."""
    names = {method.replace("-", "_") for method in prepared.methods}
    return prepared.cells if {route(prepared, name) for name in names} - {"deterministic"} else None


def _some_steps(prepared: Prepared, leakage: Array | None, stride: int, least: int) -> Scene:
    known = np.ones(len(prepared.scene.steps)) if leakage is None else leakage
    return at_some_steps(prepared.scene, known, stride, least=least)


def _reduced(prepared: Prepared, scene: Scene) -> Prepared:
    """The same input for a coarser scene: each method by its route, with few windows and realisations."""
    sampling = prepared.sampling
    if sampling is not None:
        windows = min(sampling.library_cells, max(LEAST_WINDOWS, round(COARSE_WINDOWS * sampling.library_cells)))
        sampling = replace(
            sampling,
            realisations=2,  # the windows are compared
            library_cells=windows,
            width=None,
            resampled=False,
            bounds=False,
            other_lengths=(),
            library=None,
        )
    names = (method.replace("-", "_") for method in prepared.methods)
    methods = frozenset(route(prepared, name).replace("_", "-") for name in names)
    if _by_links(prepared):
        methods |= {"deterministic"}
    return replace(prepared, scene=scene, sampling=sampling, methods=methods, filtered=None)


def _by_links(prepared: Prepared) -> bool:
    """Whether two scales have the contact of the whole face and the flow of links, which cost little to compare."""
    return "two-scale" in prepared.methods and prepared.contact == "whole" and prepared.flow == "links"


def _links_compared(coarse: Prepared, found: Mapping[str, Any]) -> CoarserSolution | None:
    """The whole face on fewer points against links there; None where they are not compared."""
    if not _by_links(coarse) or not {"deterministic", "two_scale"} <= found.keys():
        return None
    whole, links = found["deterministic"], found["two_scale"]
    return CoarserSolution(coarse.scene.surface.shape, coarse.scene.steps, whole.leakage, links.leakage)


def _solved(coarse: Prepared, solve: Solve) -> dict[str, Any]:
    """Studies of a coarser input by name; those that fail are left out."""
    found: dict[str, Any] = {}
    for method in ("deterministic", "two-scale", "stochastic"):
        if method in coarse.methods:
            try:
                found[method.replace("-", "_")] = solve(method, coarse, found)
            except NotKept:
                raise
            except FemsealError as error:
                log.warning("error budget: %s on a coarser grid failed: %s", method, error)
    return found


def against(study: Any, coarse: Prepared, found: Any) -> CoarserSolution:
    """A coarser solution beside the study; unknown leakage where it failed."""
    points = coarse.scene.surface.shape
    steps = coarse.scene.steps
    if found is None:
        return CoarserSolution(points, steps, np.full(len(steps), np.nan))
    if not isinstance(study, StochasticResult):
        return CoarserSolution(points, steps, leakage_of(found))
    places = [study.steps.index(step) for step in steps]
    if not isinstance(found, StochasticResult):
        assert study.leakage_of_face is not None
        return CoarserSolution(points, steps, found.leakage, study.leakage_of_face[places])
    own = study.quantile(0.5)[places]
    change = change_of_windows(study.library.curves, found.library.curves, steps)
    return CoarserSolution(points, steps, own * np.exp(change), own)
