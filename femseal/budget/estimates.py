"""Estimates of the single sources of error of a leakage, each a part of the budget."""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.special import bdtr, stdtrit

from ..studies import Scene, StochasticResult, TwoScaleResult
from ..studies.scene import Array
from .changes import load_sensitivity
from .conformal import decades
from .error_parts import ErrorPart

#: Fraction of the cases that a band holds, and the number of standard deviations of a normal number for it.
COVERAGE, DEVIATIONS = 0.95, 1.96
#: Change of ln(leakage) by the residual of the contact, over this and the slope of ln(leakage) over ln(load), at least
#: 1. Measured on 24 faces at residuals of 1e-2 to 1e-6: 0.04 holds 95 of 100 changes, and 0.5 all of them.
_RESIDUAL = 0.5
#: Change of ln(leakage) by the residual of the flow, which is solved to 1e-6 of its energy.
_FLOW = 1e-6

#: Standard deviation of ln(leakage) of single places at the first load, and what each decade below it adds; they count
#: as so many degrees of freedom. Chosen on 24 faces of four kinds, places as long as broad with 3 of the longest waves:
#: bands of 3 to 8 places held 97 to 99 of 100 down to 1/100 of the first leakage, without this 92 to 99.
_PLACE_SCATTER, _PLACE_FREEDOM = (0.25, 0.2), 2


def solver_part(scene: Scene, leakage: Array) -> ErrorPart:
    """Residuals of contact and flow: that of the contact acts as a change of the load."""
    slope = load_sensitivity(scene.steps, leakage)
    distance = _RESIDUAL * scene.rtol * np.maximum(slope, 1.0) + _FLOW
    note = f"contact residual {scene.rtol:.0e} as a change of the load, by the slope of ln(leakage) over ln(load)"
    return ErrorPart.of("solver", leakage, distance, distance, note)


def elements_part(study: TwoScaleResult) -> ErrorPart:
    """Flow through elements: its leakage is an upper bound, and its own estimate the largest error."""
    assert study.element_error is not None
    below = -np.log1p(-np.minimum(study.element_error, 0.99))
    note = "flow through elements, an upper bound; largest error estimated from its last iterations"
    return ErrorPart.of("two scales", study.leakage, below, np.zeros(len(below)), note)


def library_part(study: StochasticResult) -> ErrorPart:
    """Finite library: scatter between three or more measured places, else of seals from resampled libraries.

    The latter is the difference of two variances of as many seals; it counts at least as half of its standard error.
    """
    median = study.quantile(0.5)
    if study.without_place is not None:
        return places_part(median, study.without_place)
    own, error = study.realisation_spread**2, study.library_error**2
    noise = np.sqrt(2 / max(len(study.leakage) - 1, 1)) * np.hypot(own, own + error)
    distance = DEVIATIONS * np.sqrt(np.maximum(error, 0.5 * noise))
    note = "1.96 standard deviations of ln(leakage) between libraries drawn with repetition from the library"
    part = ErrorPart.of("library", median, distance, distance, note)
    # too few leak to have a deviation
    few = np.isnan(distance) | (median == 0)
    ends = [study.quantile(q, resampled=True) for q in ((1 - COVERAGE) / 2, (1 + COVERAGE) / 2)]
    lower, upper = (np.where(few, end, own) for end, own in zip(ends, (part.lower, part.upper), strict=True))
    return ErrorPart(part.name, np.minimum(lower, median), np.maximum(upper, median), note)


def places_part(leakage: Array, without: Array) -> ErrorPart:
    """Few measured places: interval of ln(leakage) by the jackknife over places, those left joined.

    The variance is pooled with that of single places usual at such a leakage, `_PLACE_SCATTER`, by their degrees of
    freedom, and the interval is Student's. Where all but one place do not leak the seal may be sealed; then the upper
    end is by the jackknife of the leakage itself.

    Parameters
    ----------
    leakage : (steps,). without : of all places but one (places, steps) [m²/s].

    Source: Efron & Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11.
    """
    count = len(without)
    first, each_decade = _PLACE_SCATTER
    usual = (first + each_decade * np.maximum(decades(leakage), 0.0)) / np.sqrt(count)
    freedom = _PLACE_FREEDOM + count - 1
    student = float(stdtrit(freedom, (1 + COVERAGE) / 2))

    def distance(values: Array) -> Array:
        own = (count - 1) * values.var(axis=0)
        return np.asarray(student * np.sqrt((_PLACE_FREEDOM * usual**2 + (count - 1) * own) / freedom))

    with np.errstate(divide="ignore", invalid="ignore"):
        logs = distance(np.log(without))
        plain = np.log1p(distance(without / without.mean(axis=0)))
    shut = (without == 0).any(axis=0) & np.isfinite(without).all(axis=0)
    below, above = np.where(shut, np.inf, logs), np.where(shut, plain, logs)
    note = (
        f"Student's interval by the jackknife over {count} measured places, in ln(leakage), with the scatter that is "
        f"usual; {places_to_halve(count)} more places would halve it"
    )
    part = ErrorPart.of("library", leakage, below, above, note)
    # without leakage the others tell how much there may be
    upper = np.where(leakage == 0, (1 + student) * np.max(without, axis=0), part.upper)
    return ErrorPart(part.name, part.lower, upper, note)


def places_to_halve(count: int) -> int:
    """How many more measured places are expected to halve the band of three or more.

    >>> places_to_halve(3), places_to_halve(4), places_to_halve(8)
    (5, 8, 19)
    """

    def width(places: int) -> float:
        return float(stdtrit(_PLACE_FREEDOM + places - 1, (1 + COVERAGE) / 2)) / sqrt(places)

    more = 1
    while width(count + more) > 0.5 * width(count):
        more += 1
    return more


def realisations_part(study: StochasticResult) -> ErrorPart:
    """Finite number of realisations: interval of their median, by its ranks."""
    note = f"interval of the median of {len(study.leakage)} realisations by its ranks"
    ends = np.array([median_interval(column) for column in study.leakage.T])
    return ErrorPart("realisations", ends[:, 0], ends[:, 1], note)


def median_interval(values: Array) -> tuple[float, float]:
    """Two values that hold the median of the population in at least 95 of 100 samples.

    They are order statistics, whatever the distribution; fewer than 6 values, of which no two do, are taken as
    lognormal.

    >>> median_interval(np.arange(1.0, 11.0))
    (2.0, 9.0)
    """
    ordered = np.sort(values[np.isfinite(values)])
    n = ordered.size
    if n < 2:
        return float("nan"), float("nan")
    # the largest number of values to leave out on each side
    left = int(np.count_nonzero(bdtr(np.arange(n // 2), n, 0.5) <= (1 - COVERAGE) / 2))
    if left > 0:
        return float(ordered[left - 1]), float(ordered[n - left])
    if ordered[0] <= 0:
        return min(0.0, float(ordered[0])), float(ordered[-1]) if ordered[-1] > 0 else 0.0
    logs = np.log(ordered)
    half = 1.2533 * float(stdtrit(n - 1, (1 + COVERAGE) / 2)) * float(logs.std(ddof=1)) / np.sqrt(n)
    middle = float(np.median(logs))
    return float(np.exp(middle - half)), float(np.exp(middle + half))
