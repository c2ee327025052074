"""Choose the numerical settings of the attempts to reach an accuracy: grid, contact tolerance and realisations."""

from dataclasses import dataclass, replace
from math import ceil, log1p
from typing import Any, NamedTuple

from ..base import Shape, as_text, to_text, validate
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..face.cut import FEWEST_POINTS
from ..preparation.memory import refuse_impossible_sizes
from ..studies import StudyCost

#: Grid of the first attempt and finest grid, each given by the exponent g: the number of points along each side is 2^g
#: times the number in the case. On the grid of the case, the shortest wave has 8 pixels. On the grid of the first
#: attempt, it has 4 pixels. The error of the first attempt is estimated with a coarser grid, on which the shortest wave
#: has 2 pixels. With even fewer pixels, the estimated error was too small by up to a factor of 2.
FIRST_GRID, MOST_GRID = -1, 4
#: Smallest tolerance of the contact solution.
LEAST_RTOL = 1e-8
#: Advice for error sources that no setting can reduce.
_ADVICE = {
    "filter": "short waves were removed; a shorter surface.shortest_wave with more surface.points keeps them, if they "
    "were measured",
    "patch": "one measured patch does not show more; measure a larger area or more patches",
}
#: Number of realisations in the first attempt, and largest number of realisations. Multiplying the number of
#: realisations by `HALVING` halves the error of their median.
FIRST_REALISATIONS, MOST_REALISATIONS, HALVING = 20, 20480, 4
#: Largest error of ln(leakage), divided by the tolerance of the contact, for tolerances from 1e-3 to 1e-7. The value is
#: three times the largest error on six elastic and plastic surfaces, at loads from the open state to a hundredth of the
#: open leakage, see docs/evidence/only_what_is_needed.md.
TOLERANCE_ERROR = 1.9
#: Fraction of the allowed error of the leakage that the tolerance of the contact solution may cause.
TOLERANCE_FRACTION = 0.1


@dataclass(frozen=True)
class Settings:
    """Numerical settings of an attempt.

    Parameters
    ----------
    method : name of the study that gives the leakage.
    grid : exponent g: the number of points along each side of the surface is 2^g times the number in the case.
    rtol : largest relative residual of the contact solution.
    realisations : number of realisations; None if the study has no realisations.
    """

    method: str
    grid: int
    rtol: float
    realisations: int | None


def contact_tolerance(accuracy: float) -> float:
    """Return the largest contact-solver tolerance at which the leakage is still accurate enough.

    The returned tolerance causes at most a tenth of the allowed relative error of the leakage.

    Parameters
    ----------
    accuracy : float
        Allowed relative error of the leakage, such as 0.1 for 10 %.

    Raises
    ------
    InputError
        The accuracy is not a positive number.

    Examples
    --------
    >>> contact_tolerance(0.1), contact_tolerance(0.01), contact_tolerance(1e-9)
    (0.001, 0.0001, 1e-07)
    """
    largest_error = TOLERANCE_FRACTION * log1p(validate.number("accuracy", accuracy))
    for exponent in range(-3, -7, -1):
        tolerance = 10.0**exponent
        if TOLERANCE_ERROR * tolerance <= largest_error:
            return tolerance
    return 1e-7


def given_settings(case: Case) -> dict[str, str]:
    """Return the names of the settings that the case fixes, with their keys in the case.

    All attempts use the fixed settings as the case states them.
    """
    keys: dict[str, str] = {}
    if case.surface.points is not None:
        keys["grid"] = "surface.points"
    if "rtol" in case.contact.model_fields_set:
        keys["rtol"] = "contact.rtol"
    if case.stochastic is not None and case.stochastic.realisations is not None:
        keys["realisations"] = "stochastic.realisations"
    return keys


def first_settings(case: Case, original: StudyInput) -> Settings:
    """Choose the settings of the first attempt: coarse pixels, and few realisations.

    original : input of the studies, with the surface on the grid of the case.
    """
    assert case.accuracy is not None
    given = given_settings(case)
    sampling = original.sampling
    realisations = None if sampling is None else sampling.realisations
    if sampling is not None and "realisations" not in given:
        realisations = FIRST_REALISATIONS
    rtol = case.contact.rtol if "rtol" in given else contact_tolerance(case.accuracy)
    settings = Settings(original.answer.name, 0, rtol, realisations)
    if "grid" in given:
        return settings
    # The error is estimated by comparison with a grid that has half the points along each side. The cells of this grid
    # must have enough points as well.
    points = grid_points(original, FIRST_GRID - 1)
    cells = original.cells or (1, 1)
    has_enough_points = all(n // m >= FEWEST_POINTS for n, m in zip(points, cells, strict=True))
    return replace(settings, grid=FIRST_GRID) if has_enough_points else settings


def grid_points(original: StudyInput, grid: int) -> Shape:
    """Return the numbers of points along both sides of the surface on a finer or coarser grid.

    The number of points in the case is multiplied by 2^`grid`, and rounded up to a multiple of the corresponding number
    in `original.points_divide_by`. The surface can then be divided into equal blocks.
    """
    n1, n2 = (
        ceil(n * 2.0**grid / divisor) * divisor
        for n, divisor in zip(original.scene.surface.shape, original.points_divide_by, strict=True)
    )
    return n1, n2


def apply_settings(original: StudyInput, settings: Settings) -> StudyInput:
    """Return the input with other settings, and with its surface resampled to the grid of the new settings.

    original : input of the studies, with the surface on the grid of the case.
    """
    surface = original.scene.surface
    points = grid_points(original, settings.grid)
    face = surface if points == surface.shape else surface.resample(points)
    sampling = original.sampling
    if sampling is not None:
        sampling = replace(sampling, realisations=settings.realisations)
    return replace(
        original,
        scene=replace(original.scene, surface=face, rtol=settings.rtol),
        sampling=sampling,
        conditioning=replace(original.conditioning, shape=face.shape, spacing=face.spacing),
    )


def first_version(case: Case, original: StudyInput) -> StudyInput:
    """Prepare a case with the settings of the first attempt to reach its accuracy."""
    with refuse_impossible_sizes():
        return apply_settings(original, first_settings(case, original))


def last_version(case: Case, original: StudyInput, attempts: dict[str, Any] | None) -> StudyInput:
    """Prepare a case with the settings of the last attempt, or with unchanged settings if there were no attempts.

    attempts : record of the attempts, as in `Results.attempts`; None if there were no attempts.
    """
    if attempts is None or case.accuracy is None:
        return original
    return apply_settings(original, Settings(**attempts["settings"]))


def expected_cost(study_input: StudyInput) -> StudyCost:
    """Estimate the time on one core [s] and the memory [byte] of the study that gives the leakage.

    The other studies of the case are not counted.
    """
    return study_input.only_answer.cost(study_input.answer)


@dataclass(frozen=True)
class SettingsChange:
    """Finer settings for a further attempt, or the reason why there are none.

    Parameters
    ----------
    settings : finer settings; None if no settings are chosen.
    change : description of the change; "" if no settings are chosen.
    reason : reason why no settings are chosen; "" if there are settings.
    """

    settings: Settings | None = None
    change: str = ""
    reason: str = ""


def finer_settings(
    case: Case, original: StudyInput, settings: Settings, part: str, memory: float
) -> SettingsChange:
    """Choose settings that approximately halve the error from one error source.

    Parameters
    ----------
    case : the case.
    original : input of the studies, with the surface on the grid of the case.
    settings : settings of the last attempt.
    part : name of the error source.
    memory : memory that an attempt may use [byte].

    Returns
    -------
    The finer settings, or the reason why the error cannot be reduced.
    """
    rtol = settings.rtol / 10
    grid = settings.grid + 1
    realisations = HALVING * (settings.realisations or 0)
    points = as_text(grid_points(original, grid))
    refinements = {
        "solver": _Refinement(
            setting="rtol",
            value=rtol,
            text=f"contact.rtol {rtol:.0e}",
            is_allowed=rtol >= LEAST_RTOL * (1 - 1e-9),
        ),
        "pixels": _Refinement(
            setting="grid", value=grid, text=f"{points} points", is_allowed=grid <= MOST_GRID
        ),
        "realisations": _Refinement(
            setting="realisations",
            value=realisations,
            text=f"{realisations} seals",
            is_allowed=realisations <= MOST_REALISATIONS,
        ),
    }
    if part not in refinements:
        return SettingsChange(reason=_ADVICE.get(part, "no setting reduces this error"))
    refinement = refinements[part]
    text = refinement.text
    case_key = given_settings(case).get(refinement.setting)
    if case_key is not None:
        return SettingsChange(reason=f"{case_key} is given in the case")
    if not refinement.is_allowed:
        return SettingsChange(reason=f"{text} is finer than any attempt")
    finer = replace(settings, **{refinement.setting: refinement.value})
    _, needed = expected_cost(apply_settings(original, finer))
    if needed <= memory:
        return SettingsChange(finer, change=text)
    needed_text = to_text(needed, "B", 3)
    memory_text = to_text(memory, "B", 3)
    reason = f"{text} would take about {needed_text} of memory, expected {memory_text}"
    return SettingsChange(reason=reason)


class _Refinement(NamedTuple):
    """Describe a new value of one setting that approximately halves the error from one source.

    setting : name of the setting in `Settings`.
    value : new value of the setting.
    text : the new value as text.
    is_allowed : whether the new value is within the limit of the setting, for example `MOST_GRID`.
    """

    setting: str
    value: Any
    text: str
    is_allowed: bool
