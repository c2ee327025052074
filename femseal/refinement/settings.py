"""What a run computes with where its case asks for an accuracy: the first choice, and what is refined after it."""

from dataclasses import asdict, dataclass, replace
from math import ceil
from typing import Any

from ..base import to_text
from ..case.case import Case
from ..face.pieces import FEWEST_POINTS
from ..preparation.prepared import Pair, Prepared, refused_if_too_large
from ..studies.study_registry import contact_tolerance

#: Longest time of a run whose case asks for an accuracy and gives no time [s].
TIME_LIMIT = 3600.0
#: Doublings of the points of a face by which the first attempt and the finest are coarser or finer. The shortest wave
#: has 8 pixels on the points of a face: 4 in the first attempt, and 2 on the coarser grid that shows its error.
#: Measured: with 2 pixels the budget may be half of the error.
FIRST_GRID, MOST_GRID = -1, 4
#: Least residual of contact.
LEAST_RTOL = 1e-8
#: What is to be done about sources of error that no settings make smaller.
_BY_NOTHING = {
    "filter": "short waves were removed: a shorter surface.shortest_wave with more surface.points keeps them, as far "
    "as they were measured",
    "patch": "it is what one measured patch does not know: more measured places make it smaller",
}
#: Seals that are drawn at first and at most, and the factor of their number that halves its error.
FIRST_SEALS, MOST_SEALS, HALVING = 20, 20480, 4


@dataclass(frozen=True)
class Settings:
    """What a run computes with where its case leaves it open.

    method : of the answer. grid : doublings of the points of the face a side, negative: halvings. rtol : residual of
    contact. realisations : number of drawn seals; None without.
    """

    method: str
    grid: int
    rtol: float
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
    if case.stochastic is not None and case.stochastic.realisations is not None:
        found["realisations"] = "stochastic.realisations"
    return found


def first_settings(case: Case, made: Prepared) -> Settings:
    """The settings of the first attempt: coarse pixels, and few seals.

    made : the case as prepared, on the points of its face.
    """
    assert case.accuracy is not None
    given, sampling = given_settings(case), made.sampling
    seals = None if sampling is None else sampling.realisations
    if sampling is not None and "realisations" not in given:
        seals = FIRST_SEALS
    rtol = case.contact.rtol if "rtol" in given else contact_tolerance(case.accuracy)
    settings = Settings(made.answer.name, 0, rtol, seals)
    coarse = replace(settings, grid=FIRST_GRID)
    # the coarser grid that shows the error needs pieces too
    fits = has_pieces(made, replace(coarse, grid=FIRST_GRID - 1))
    return coarse if fits and "grid" not in given else settings


def time_limit(case: Case) -> float:
    """Longest time of all attempts together [s]."""
    return TIME_LIMIT if case.time_limit is None else case.time_limit


def grid_points(made: Prepared, grid: int) -> Pair:
    """Points of the face of a case, `grid` doublings finer; as many more as its pieces ask for."""
    n1, n2 = (
        ceil(n * 2.0**grid / m) * m
        for n, m in zip(made.scene.surface.shape, made.points_divide_by, strict=True)
    )
    return n1, n2


def has_pieces(made: Prepared, settings: Settings) -> bool:
    """Whether the pieces have enough pixels on a grid, and the face a few of them."""
    points = grid_points(made, settings.grid)
    return all(n // m >= FEWEST_POINTS for n, m in zip(points, made.cells or (1, 1), strict=True))


def apply_settings(made: Prepared, settings: Settings) -> Prepared:
    """A case with these settings: the same face on other points, and the rest as chosen.

    made : the case as prepared, on the points of its face.
    """
    surface = made.scene.surface
    points = grid_points(made, settings.grid)
    face = surface if points == surface.shape else surface.resample(points)
    sampling = made.sampling
    if sampling is not None and settings.realisations is not None:
        sampling = replace(sampling, realisations=settings.realisations)
    return replace(
        made,
        scene=replace(made.scene, surface=face, rtol=settings.rtol),
        sampling=sampling,
        conditioning=replace(made.conditioning, shape=face.shape, spacing=face.spacing),
    )


def first_version(case: Case, made: Prepared) -> Prepared:
    """What a run of a prepared case solves first: the case itself, or the first attempt at its accuracy."""
    if case.accuracy is None:
        return made
    with refused_if_too_large():
        return apply_settings(made, first_settings(case, made))


def last_version(case: Case, made: Prepared, attempts: dict[str, Any] | None) -> Prepared:
    """A prepared case with the settings of the last attempt of its results; the case itself without attempts."""
    if attempts is None or case.accuracy is None:
        return made
    return apply_settings(made, Settings(**attempts["settings"]))


def chosen(case: Case, made: Prepared) -> dict[str, Any]:
    """What a run of a prepared case computes first, see `Prepared.chosen`, and the settings of an accuracy."""
    if case.accuracy is None:
        return made.chosen
    settings = first_settings(case, made)
    return first_version(case, made).chosen | {
        f"settings.{name}": v for name, v in asdict(settings).items()
    }


def expected_cost(prepared: Prepared) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the answer of a prepared case, solved alone."""
    return replace(prepared, methods=frozenset({prepared.answer.name})).cost(prepared.answer)


def refined(
    case: Case, made: Prepared, settings: Settings, part: str, memory: float
) -> tuple[Settings | None, str]:
    """Settings with which a source of error is about half as large, and what they change; None, and why not.

    made : the case as prepared, on the points of its face. settings : of the last attempt.
    part : name of a part of its budget. memory : that an attempt may take [byte].
    """
    rtol, grid = settings.rtol / 10, settings.grid + 1
    seals = HALVING * (settings.realisations or 0)
    points = " × ".join(map(str, grid_points(made, grid)))
    # a setting, its finer value and that as a text, whether it is too fine, and why
    steps: dict[str, tuple[str, Any, str, bool, str]] = {
        "solver": (
            "rtol",
            rtol,
            f"contact.rtol {rtol:.0e}",
            rtol < LEAST_RTOL * (1 - 1e-9),
            f"contact.rtol is {settings.rtol:.0e}, as small as it gets",
        ),
        "pixels": (
            "grid",
            grid,
            f"{points} points",
            grid > MOST_GRID,
            f"pixels are {2**MOST_GRID} times finer than those of the face",
        ),
        "realisations": (
            "realisations",
            seals,
            f"{seals} seals",
            seals > MOST_SEALS,
            f"{settings.realisations} seals are drawn, the most that are",
        ),
    }
    if part not in steps:
        return None, _BY_NOTHING.get(part, "nothing refines it")
    key, value, text, too_fine, why = steps[part]
    if (by := given_settings(case).get(key)) is not None:
        return None, f"{by} is given in the case"
    if too_fine:
        return None, why
    finer = replace(settings, **{key: value})
    needed = expected_cost(apply_settings(made, finer))[1]
    if needed > memory:
        needs, expected = (to_text(size, "B", 3) for size in (needed, memory))
        text = f"{text} would take about {needs} of memory, expected {expected}"
        return None, text
    return finer, text
