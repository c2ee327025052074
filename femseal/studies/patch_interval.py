"""Compute the 95 % interval of a leakage that was computed from one measured patch, or block by block.

The interval is calibrated on whole surfaces. `interval_calibration.csv` contains, for every load step of random scenes,
the leakage of the whole surface (the truth) and the leakage that was computed from a patch of it. There are four kinds
of computation. The cells of the patch stay in order ("in order") or are put together at random ("at random"), also in
seals whose form was measured at points ("with form"). The fourth kind is a surface solved block by block ("by blocks").

Each load step gets a score: the error of ln(leakage), divided by the difficulty of its contact state. The difficulty is
computed from this contact state alone, without the truth and without the other loads. The distance from a new leakage
to an end of its interval is a quantile of the scores of its kind, multiplied by the difficulty of its contact state.
The lower and the upper end have separate quantiles, because errors in both directions differ in size.

The steps of one scene have similar errors, so only whole scenes can be regarded as independent. Each of the n scenes
has the weight 1/(n + 1), which is shared by its steps. The remaining weight stands for a new scene and lies beyond all
scores. If an interval may miss 5 % of the truths, each of its ends then misses at most 2.5 % of the steps of new scenes
of the same population, whatever the distribution of the errors.

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
    """Dependence of the expected error on the contact state, for one kind of computation.

    The distance from ln(leakage) to an end of the interval is proportional to

        (0.3 + N^−½)^½ · [1 + l/(A + 0.003)] · exp(gA) · (1 + dF),

    where N is the number of carriers, A the contact fraction and F the detours of the contact state, see `PatchState`.
    The factors have the following reasons:

    - The fewer blocks carry the flow (N), the less one patch says about others.
    - In a very light contact, only a few asperities carry the load, so that one patch says less than at a higher load
      (coefficient l).
    - The error grows with the contact fraction (coefficient g).
    - Some channels cross from cell to cell (coefficient d). If the cells stay in order, these channels continue from
      one copy of the patch to the next, so that the real seal may leak less. If the cells are put together at random,
      the channels are interrupted, so that the real seal may leak more.

    Parameters
    ----------
    light : float
        Coefficient l of light contacts.
    below, above : float
        Coefficient g of the contact fraction, for the lower and for the upper end.
    detours_below, detours_above : float
        Coefficient d of the detours, for the lower and for the upper end.
    largest_ratio : float
        Largest ratio of the upper end to the leakage of an open seal. The upper end may however always be up to twice
        the computed leakage.
    fraction : float
        Fraction of the truths that the calibrated intervals of this kind contain.
    """

    light: float
    below: float
    above: float
    detours_below: float
    detours_above: float
    largest_ratio: float
    fraction: float

    def distances(self, state: PatchState) -> tuple[Array, Array]:
        """Return the distances from ln(leakage) to the lower and to the upper end (steps,).

        Each is to be multiplied by the calibrated factor of `IntervalWidths`.
        """
        carriers = np.where(np.isnan(state.carriers), _SEALED_CARRIERS, state.carriers)
        detours = np.where(np.isnan(state.detours), _SEALED_DETOURS, state.detours)
        contact = state.contact_fraction
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
    """Calibrated widths of the intervals of one kind of computation.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    scenes : int
        Number of scenes of the calibration set that were used.
    below, above : float
        Factors by which the distances of `Difficulty.distances` are multiplied, for the lower and the upper end.
    """

    kind: str
    scenes: int
    below: float
    above: float

    @classmethod
    def calibrate(
        cls, kind: str, rows: Sequence[Mapping[str, str]], *, two_patches: bool = False
    ) -> IntervalWidths:
        """Calibrate the widths of a kind from rows of the calibration set, each of which is a step of a scene.

        Parameters
        ----------
        kind : str
            One of `KINDS`.
        rows : sequence of mapping
            Rows of this kind.
        two_patches : bool
            True to use the rows that were computed from two patches together, False for those of single patches.
        """
        rows = [row for row in rows if (row["patch"] == _BOTH_PATCHES) == two_patches]
        scene = np.array([row["scene"] for row in rows])
        leakage = np.array([float(row["leakage"]) for row in rows])
        truth = np.array([float(row["truth"]) for row in rows])
        difficulty = DIFFICULTY[kind]
        unit_below, unit_above = difficulty.distances(state_of_rows(rows))
        error_below, error_above = distances_to_truth(leakage, truth)
        is_open = leakage > 0
        level = (
            1 + difficulty.fraction
        ) / 2  # each end may miss half of what the interval may miss
        below = weighted_quantile((error_below / unit_below)[is_open], scene[is_open], level)
        above = weighted_quantile((error_above / unit_above)[is_open], scene[is_open], level)
        return cls(kind, np.unique(scene).size, max(0.0, below), max(0.0, above))

    def ends(self, leakage: Array, state: PatchState) -> tuple[Array, Array]:
        """Return the lower and the upper end of the interval (steps,) [m²/s].

        Both are ends of the interval of |leakage|, because the leakage may be negative. The interval of a sealed state
        reaches from 0 to the fraction `sealed_end` of the leakage of an open seal.
        """
        unit_below, unit_above = DIFFICULTY[self.kind].distances(state)
        q, open_leakage = np.abs(leakage), np.abs(state.open_leakage)
        lower = q * np.exp(-self.below * unit_below)
        lower = np.where(lower < LEAST_TRUTH * open_leakage, 0.0, lower)
        upper = np.maximum(q, LEAST_KNOWN * open_leakage) * np.exp(self.above * unit_above)
        highest = np.maximum(DIFFICULTY[self.kind].largest_ratio * open_leakage, 2 * q)
        upper = np.where(q == 0, sealed_end() * open_leakage, np.minimum(upper, highest))
        return lower, np.where(np.isnan(q), np.nan, upper)


def distances_to_truth(leakage: Array, truth: Array) -> tuple[Array, Array]:
    """Return how far each end of an interval must be from ln(leakage) for the interval to contain the truth.

    Parameters
    ----------
    leakage, truth : array (rows,)
        Computed and true leakage, divided by the leakage of an open seal.

    Returns
    -------
    below, above : array (rows,)
        Smallest distances from ln(leakage) to the lower and to the upper end. At most one of
        them is positive, because the truth lies either above or below the leakage.
    """
    with np.errstate(divide="ignore"):
        # A lower end below `LEAST_TRUTH` becomes 0, so that it need not be any further away to contain a smaller truth.
        nearest = np.where(truth >= LEAST_TRUTH, truth, np.minimum(leakage, LEAST_TRUTH))
        below = np.log(leakage / np.where(nearest > 0, nearest, 1.0))
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
    """Return a quantile of scores in which all scenes have equal weight, including a new one beyond all scores.

    Parameters
    ----------
    score : array (rows,)
        Scores of the steps.
    scene : array (rows,)
        Name of the scene of each step.
    fraction : float
        Level of the quantile. If it lies in the weight of the new scene, the largest score is returned.
    """
    _, scene_number = np.unique(scene, return_inverse=True)
    steps_of_scene = np.bincount(scene_number)
    weight = 1.0 / (steps_of_scene[scene_number] * (steps_of_scene.size + 1))
    order = np.argsort(score, kind="stable")
    reached = int(np.searchsorted(np.cumsum(weight[order]), fraction - 1e-12))
    return float(score[order[min(reached, order.size - 1)]])


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
    """Return the upper end of the interval of a sealed state, as a fraction of the leakage of an open seal.

    It is calibrated from the sealed states of all kinds of computation.
    """
    rows = [row for kind in KINDS for row in calibration_rows(kind)]
    rows = [row for row in rows if float(row["leakage"]) == 0 and row["patch"] != _BOTH_PATCHES]
    truth = np.array([float(row["truth"]) for row in rows])
    return weighted_quantile(truth, np.array([row["scene"] for row in rows]), COVERAGE)


@cache
def interval_widths(kind: str, patches: int = 1) -> IntervalWidths:
    """Return the widths of the intervals of a kind of computation from a number of measured patches.

    The widths for more than two patches are those for two. If the calibration set has no rows of two patches for a
    kind, the widths of single patches are returned for any number of patches.
    """
    rows = calibration_rows(kind)
    has_two = any(row["patch"] == _BOTH_PATCHES for row in rows)
    return IntervalWidths.calibrate(kind, rows, two_patches=patches > 1 and has_two)
