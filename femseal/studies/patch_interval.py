"""Compute the 95 % interval of a leakage that was computed from one measured patch, or block by block.

The interval is calibrated on whole surfaces. `interval_calibration.csv` contains, for every load step of random scenes,
the leakage of the whole surface (the truth) and the leakage that was computed from a patch of it. There are four kinds
of computation. A seal is made of the cells of the patch, which either stay in order ("in order") or are put together at
random ("at random"). The third kind is a seal whose form was measured at points ("with form"). The fourth kind is a
surface that is solved block by block ("by blocks").

Each load step gets a score: the error of ln(leakage), divided by the difficulty of its contact state. The difficulty is
computed from this contact state alone, without the truth and without the other loads. The distance from a new leakage
to an end of its interval is a quantile of the scores of its kind, multiplied by the difficulty of its contact state.
The lower and the upper end have separate quantiles, because errors in both directions differ in size.

The steps of one scene have similar errors, so only whole scenes can be regarded as independent. Each of the n scenes
has the weight 1/(n + 1), which is shared by its steps. The remaining weight 1/(n + 1) represents a new scene, whose
scores may be higher than all known scores. Now consider intervals that may miss 5 % of the true leakages. In new scenes
of the same population, each of the two ends is then wrong at no more than 2.5 % of the load steps. This holds for any
distribution of the errors.

Sources: Vovk, Gammerman & Shafer, Algorithmic Learning in a Random World, 2005 (a quantile for each kind);
Papadopoulos, Gammerman & Vovk, Neural conformal prediction, 2008 (scores divided by a difficulty); Romano, Patterson &
Candès, Conformalized quantile regression, NeurIPS 2019 (separate ends); Lee, Barber & Willett, J. R. Stat. Soc. B, 2025
(several steps of a scene).
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..base import Array
from .patch_state import PatchState

#: Calibration set, which is written by `stochastic_seals.py` and `patch_and_form.py` of `tests/benchmarks`.
CALIBRATION = Path(__file__).with_name("interval_calibration.csv")
#: Kinds of computation: from the cells of one patch, or by blocks.
KINDS = ("in order", "at random", "with form", "by blocks")
#: Columns of the calibration set. "leakage" and "truth" are divided by the leakage of an open seal, see `PatchState`.
#: "load" and "peak" are divided by the highest load. "decades" is the number of decades by which the truth has fallen
#: below that at the first load; it is only used to group tables.
COLUMNS = (
    "kind",
    "surface",
    "scene",
    "patch",
    "step",
    "load",
    "peak",
    "leakage",
    "truth",
    "decades",
    "carriers",
    "contact",
    "detours",
)
#: Fraction of the truths that the intervals should contain.
COVERAGE = 0.95
#: A truth below this fraction of the leakage of an open seal counts as sealed. An interval whose lower end would be
#: smaller begins at 0.
LEAST_TRUTH = 1e-4
#: If the leakage is below this fraction of the leakage of an open seal, it comes from a few constrictions, and its size
#: says little. The upper end of the interval is then computed for this fraction. Of 1e-3, 1e-2 and 3e-2, this value
#: gave the largest fraction of truths in the intervals for kinds of surfaces that were left out of the calibration.
LEAST_KNOWN = 1e-3
#: Carriers and detours of a sealed state, as of a flow through a single constriction.
_SEALED_CARRIERS, _SEALED_DETOURS = 1.0, 0.0
#: Value of the column "patch" in rows that were computed from two patches together.
_BOTH_PATCHES = "both"


def error_of_few_carriers(carriers: Array) -> Array:
    """Return the factor (0.3 + N^−½)^½ of the difficulty, where N is the number of blocks that carry the flow."""
    return np.asarray(np.sqrt(0.3 + 1 / np.sqrt(carriers)))


@dataclass(frozen=True)
class Difficulty:
    """Describe how the expected error depends on the contact state, for one kind of computation.

    The distance from ln(leakage) to an end of the interval is proportional to

        (0.3 + N^−½)^½ · [1 + l/(A + 0.003)] · exp(gA) · (1 + dF),

    where N is the number of carriers, A the contact fraction and F the detours of the contact state, see `PatchState`.
    The factors have the following reasons:

    - If the flow passes through few blocks (small N), a single patch is less representative of the whole surface.
    - In a very light contact (small A), only a few asperities carry the load, so that a single patch is less
      representative than at a higher load (coefficient l).
    - The error grows with the contact fraction A (coefficient g).
    - The detours F measure the flow through channels that lead from one cell to the next (coefficient d). If the cells
      stay in order, these channels continue from one copy of the patch to the next, so that the real seal may leak
      less. If the cells are put together at random, the channels are interrupted, so that the real seal may leak more.

    Parameters
    ----------
    light : float
        Coefficient l of light contacts.
    below, above : float
        Coefficient g of the contact fraction: `below` for the lower end of the interval, `above` for the upper end.
    detours_below, detours_above : float
        Coefficient d of the detours: the first for the lower end of the interval, the second for the upper end.
    largest_ratio : float
        Limit of the upper end, as a multiple of the leakage of an open seal. If twice the computed leakage is larger
        than this limit, the limit is twice the computed leakage.
    fraction : float
        Fraction of the true leakages that the intervals must contain when they are calibrated.
    """

    light: float
    below: float
    above: float
    detours_below: float
    detours_above: float
    largest_ratio: float
    fraction: float

    def distances(self, state: PatchState) -> tuple[Array, Array]:
        """Return the distances from ln(leakage) to the lower and to the upper end (steps,), up to a constant factor.

        The factors are calibrated, see `IntervalWidths`.
        """
        carriers = np.where(np.isnan(state.carriers), _SEALED_CARRIERS, state.carriers)
        detours = np.where(np.isnan(state.detours), _SEALED_DETOURS, state.detours)
        contact = state.contact_fraction
        # the factors that both ends share, see the formula of the class
        common = error_of_few_carriers(carriers) * (1 + self.light / (contact + 0.003))
        below = common * np.exp(self.below * contact) * (1 + self.detours_below * detours)
        above = common * np.exp(self.above * contact) * (1 + self.detours_above * detours)
        return below, above


#: The coefficients were chosen from a grid of values. One kind of surface after the other was left out of the
#: calibration, and the intervals had to contain about 0.9 of its truths. Of the coefficients that do so, these give
#: nearly the narrowest intervals down to two decades of leakage, see docs/evidence/stochastic_seals.md.
#: `largest_ratio`: no surface of the calibration set without honing grooves leaks more than 10 times as much as a
#: uniform gap of the same mean; honed surfaces leak up to 145 times as much.
#: A whole surface closes at a lower load than a patch of it, beginning at the edges of the bodies.
#: `fraction` with cells in order: when honed surfaces were left out, intervals calibrated for 0.95 contained only 0.87
#: of their truths, so that 0.96 is used.
_IN_ORDER = Difficulty(
    light=0.005,
    below=0.0,
    above=2.0,
    detours_below=2.0,
    detours_above=0.0,
    largest_ratio=60.0,
    fraction=0.96,
)
_AT_RANDOM = Difficulty(
    light=0.0,
    below=2.0,
    above=0.0,
    detours_below=0.0,
    detours_above=2.0,
    largest_ratio=30.0,
    fraction=0.95,
)
#: A surface that is solved by blocks loses no detours, because all of its cells stay in order.
_BY_BLOCKS = Difficulty(
    light=0.0,
    below=4.0,
    above=2.0,
    detours_below=0.0,
    detours_above=0.0,
    largest_ratio=60.0,
    fraction=0.95,
)
#: Difficulty of each kind of computation.
DIFFICULTY = {
    "in order": _IN_ORDER,
    "at random": _AT_RANDOM,
    "with form": _AT_RANDOM,
    "by blocks": _BY_BLOCKS,
}


@dataclass(frozen=True)
class IntervalWidths:
    """Hold the calibrated widths of the intervals of one kind of computation.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    scenes : int
        Number of scenes in the calibration set.
    below, above : float
        Factors for the lower and for the upper end, by which the results of `Difficulty.distances` are multiplied.
    """

    kind: str
    scenes: int
    below: float
    above: float

    @classmethod
    def calibrate(
        cls, kind: str, rows: Sequence[Mapping[str, str]], *, two_patches: bool = False
    ) -> IntervalWidths:
        """Calibrate the widths of the intervals of one kind of computation.

        Parameters
        ----------
        kind : str
            One of `KINDS`.
        rows : sequence of mapping
            Rows of the calibration set that belong to this kind. Each row is a load step of a scene.
        two_patches : bool
            True to use only rows that were computed from two patches together, False to use only rows of single
            patches.
        """
        rows = [row for row in rows if (row["patch"] == _BOTH_PATCHES) == two_patches]
        scene = np.array([row["scene"] for row in rows])
        leakage = np.array([float(row["leakage"]) for row in rows])
        truth = np.array([float(row["truth"]) for row in rows])
        difficulty = DIFFICULTY[kind]
        unit_below, unit_above = difficulty.distances(state_of_rows(rows))
        error_below, error_above = distances_to_truth(leakage, truth)
        is_open = leakage > 0
        # the interval may miss the fraction 1 − f of the true leakages, and each of its two ends half of that
        level = (1 + difficulty.fraction) / 2
        below = weighted_quantile((error_below / unit_below)[is_open], scene[is_open], level)
        above = weighted_quantile((error_above / unit_above)[is_open], scene[is_open], level)
        return cls(kind, np.unique(scene).size, max(0.0, below), max(0.0, above))

    def ends(self, leakage: Array, state: PatchState) -> tuple[Array, Array]:
        """Return the lower and the upper end of the interval of the absolute leakage (steps,) [m²/s].

        The interval of a sealed state reaches from 0 to `sealed_end` times the leakage of an open seal.
        """
        unit_below, unit_above = DIFFICULTY[self.kind].distances(state)
        q, open_leakage = np.abs(leakage), np.abs(state.open_leakage)
        lower = q * np.exp(-self.below * unit_below)
        # a lower end that is negligible compared with an open seal means that the seal may be sealed
        lower = np.where(lower < LEAST_TRUTH * open_leakage, 0.0, lower)
        # the size of a very small leakage says little, so that the upper end is computed from at least `LEAST_KNOWN`
        upper = np.maximum(q, LEAST_KNOWN * open_leakage) * np.exp(self.above * unit_above)
        limit = np.maximum(DIFFICULTY[self.kind].largest_ratio * open_leakage, 2 * q)
        upper = np.where(q == 0, sealed_end() * open_leakage, np.minimum(upper, limit))
        return lower, np.where(np.isnan(q), np.nan, upper)


def distances_to_truth(leakage: Array, truth: Array) -> tuple[Array, Array]:
    """Return the smallest distances of both ends from ln(leakage) for which an interval contains the true leakage.

    Parameters
    ----------
    leakage, truth : array (rows,)
        Computed and true leakage, divided by the leakage of an open seal.

    Returns
    -------
    below, above : array (rows,)
        Smallest distance from ln(leakage) for the lower end and for the upper end. At most one of the two is positive,
        because the true leakage lies either above or below the computed leakage.
    """
    with np.errstate(divide="ignore"):
        # The lower end must not be above the true leakage. `IntervalWidths.ends` replaces a lower end below
        # `LEAST_TRUTH` by 0, so that an end of `LEAST_TRUTH` is low enough for any smaller true leakage.
        highest_end = np.where(truth >= LEAST_TRUTH, truth, np.minimum(leakage, LEAST_TRUTH))
        below = np.log(leakage / np.where(highest_end > 0, highest_end, 1.0))
        # the upper end is computed from at least `LEAST_KNOWN`, as in `IntervalWidths.ends`
        above = np.log(truth / np.maximum(leakage, LEAST_KNOWN))
    return below, above


def state_of_rows(rows: Sequence[Mapping[str, str]]) -> PatchState:
    """Read the contact states of rows of the calibration set.

    The leakage of an open seal is 1, because the other leakages of the rows are divided by it.
    """
    names = "carriers", "contact", "detours"
    carriers, contact, detours = (np.array([float(row[name]) for row in rows]) for name in names)
    return PatchState(carriers, contact, detours, np.ones(len(rows)))


def weighted_quantile(score: Array, scene: Array, fraction: float) -> float:
    """Return a quantile of scores, in which every scene has the same weight.

    Each of the n scenes has the weight 1/(n + 1), which is shared equally by its steps. The remaining weight 1/(n + 1)
    represents a new scene, whose scores are assumed to be higher than all others.

    Parameters
    ----------
    score : array (rows,)
        Score of each load step.
    scene : array (rows,)
        Name of the scene to which each load step belongs.
    fraction : float
        Fraction of the total weight up to the quantile, such as 0.95. Above n/(n + 1) the quantile belongs to the new
        scene and is unknown; the largest known score is then returned.
    """
    _, scene_number = np.unique(scene, return_inverse=True)
    steps_of_scene = np.bincount(scene_number)
    weight = 1.0 / (steps_of_scene[scene_number] * (steps_of_scene.size + 1))
    order = np.argsort(score, kind="stable")
    cumulative_weight = np.cumsum(weight[order])
    # position of the first score at which the fraction is reached; 1e-12 allows for rounding errors
    position = int(np.searchsorted(cumulative_weight, fraction - 1e-12))
    return float(score[order[min(position, order.size - 1)]])


def calibration_rows(kind: str) -> list[dict[str, str]]:
    """Return the rows of the calibration set that belong to a kind of computation."""
    return [row for row in _calibration_set() if row["kind"] == kind]


@cache
def _calibration_set() -> tuple[dict[str, str], ...]:
    """Read the calibration set, only once for all kinds."""
    with CALIBRATION.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


@cache
def sealed_end() -> float:
    """Return the upper end of the interval for a sealed state, divided by the leakage of an open seal.

    This ratio is calibrated from the sealed states of all kinds of computation together.
    """
    rows = [row for kind in KINDS for row in calibration_rows(kind)]
    rows = [row for row in rows if float(row["leakage"]) == 0 and row["patch"] != _BOTH_PATCHES]
    truth = np.array([float(row["truth"]) for row in rows])
    return weighted_quantile(truth, np.array([row["scene"] for row in rows]), COVERAGE)


@cache
def interval_widths(kind: str, patches: int = 1) -> IntervalWidths:
    """Return the calibrated interval widths for a kind of computation, and for a number of measured patches.

    For two and more patches, the widths are calibrated from rows of the calibration set that were computed from two
    patches together. If there are no such rows for this kind, the widths for a single patch are used.
    """
    rows = calibration_rows(kind)
    has_two = any(row["patch"] == _BOTH_PATCHES for row in rows)
    return IntervalWidths.calibrate(kind, rows, two_patches=patches > 1 and has_two)
