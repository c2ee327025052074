"""Compute the 95 % interval of a leakage that was computed from one measured patch, or block by block.

The intervals are calibrated with simulated surfaces whose true leakage is known. The file `interval_calibration.csv`
contains, for every load step of these surfaces, the leakage of the whole surface (the true leakage) and the leakage
computed from a patch of it. The file distinguishes four kinds of computation:

- "in order": the seal is made of the cells of a patch in their original order.
- "at random": each tile of the seal takes a random cell of a patch.
- "with form": the tiles take random cells, and the form deviation of the seal was measured at points.
- "by blocks": the contact of a large surface is solved block by block.

The score of a load step is the error of ln(leakage) at this step, divided by the error that is expected for its contact
state (class `Difficulty`). The expected error of a contact state does not depend on the true leakage or on other load
steps. For a newly computed leakage, each end of the 95 % interval lies at a distance from ln(leakage) equal to the
expected error times a quantile of the scores of the same kind of computation. The lower and the upper end of the
interval have separate quantiles, because positive and negative errors differ in size.

The load steps of one simulated scene have similar errors. Only whole scenes are regarded as independent of each other.
In the quantile, each of the n scenes of the calibration set has the weight 1/(n + 1), divided equally among its load
steps. The remaining weight 1/(n + 1) belongs to the scene to be predicted, whose scores may exceed all scores of the
calibration set. For new scenes from the same population, the true leakage lies below the 95 % interval at no more than
2.5 % of the load steps, and above it at no more than 2.5 %. The limit of 2.5 % holds for any distribution of the
errors.

Sources of the method:

- Vovk, Gammerman & Shafer, Algorithmic Learning in a Random World, 2005 (separate quantiles for each kind of
  computation)
- Papadopoulos, Gammerman & Vovk, Neural conformal prediction, 2008 (errors divided by expected errors)
- Romano, Patterson & Candès, Conformalized quantile regression, NeurIPS 2019 (separate quantiles for the lower and the
  upper end of an interval)
- Lee, Barber & Willett, J. R. Stat. Soc. B, 2025 (several dependent observations, here the load steps of one scene)
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
#: Kinds of computation, see the docstring of this module.
COMPUTATIONS = ("in order", "at random", "with form", "by blocks")
#: Columns of the calibration set. "leakage" and "truth" are divided by the leakage of an open seal, see `PatchState`.
#: "load" and "peak" are divided by the highest load. "decades" is the number of decades by which the true leakage has
#: fallen since the first load. The column "decades" is only used to group tables.
CALIBRATION_COLUMNS = (
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
#: Fraction of the true leakages that the intervals should contain.
COVERAGE = 0.95
#: A true leakage below this fraction of the leakage of an open seal counts as sealed. An interval whose lower end would
#: be below this fraction begins at 0.
LEAST_TRUTH = 1e-4
#: If the leakage is below this fraction of the leakage of an open seal, it comes from a few constrictions, and its size
#: says little. The upper end of the interval is then computed for this fraction. Of 1e-3, 1e-2 and 3e-2, this value
#: gave the largest fraction of true leakages in the intervals for kinds of surfaces that were left out of the
#: calibration.
LEAST_KNOWN = 1e-3
#: Carriers and detours that are assumed for a sealed state: those of a flow through a single constriction.
_SEALED_CARRIERS, _SEALED_DETOURS = 1.0, 0.0
#: Value of the column "patch" in rows that were computed from two patches together.
_BOTH_PATCHES = "both"


def error_of_few_carriers(carriers: Array) -> Array:
    """Return the expected error of ln(leakage) due to few flow paths, up to a constant factor.

    The expected error is (0.3 + N^−½)^½, where N is the number of blocks of the patch that carry the flow.

    carriers : number N of blocks that carry the flow.
    """
    return np.asarray(np.sqrt(0.3 + 1 / np.sqrt(carriers)))


@dataclass(frozen=True)
class Difficulty:
    """Describe how the expected error of ln(leakage) depends on the contact state, for one kind of computation.

    The distance from ln(leakage) to an end of the 95 % interval is proportional to the expected error

        (0.3 + N^−½)^½ · [1 + l/(A + 0.003)] · exp(gA) · (1 + dF),

    where N is the number of carriers, A the contact fraction and F the detour index of the contact state, see
    `PatchState`. The four factors account for the following effects:

    - If the flow passes through few blocks (small N), a single patch is less representative of the whole surface.
    - In a very light contact (small A), only a few asperities carry the load, so that a single patch is less
      representative than at a higher load. The coefficient l describes the additional error in light contact.
    - The error of ln(leakage) grows with the contact fraction A. The coefficient g describes how fast the error grows.
    - The detour index F measures the flow through channels that lead from one cell to the next. The coefficient d
      describes the additional error due to channels between cells. In a seal with cells in order, the channels of the
      patch continue from one copy of the patch to the next, so that the real seal may leak less than the computed one.
      In a seal with cells at random, the channels are interrupted at the sides of the cells, so that the real seal may
      leak more than the computed one.

    Parameters
    ----------
    light : float
        Coefficient l of the error in light contacts.
    below, above : float
        Coefficient g (growth of the error with the contact fraction): `below` for the lower end of the 95 % interval,
        `above` for the upper end.
    detours_below, detours_above : float
        Coefficient d (error due to channels between cells): `detours_below` for the lower end of the 95 % interval,
        `detours_above` for the upper end.
    largest_ratio : float
        Limit of the upper end of an interval, relative to the leakage of an open seal. The limit is raised to twice the
        computed leakage if this is larger.
    fraction : float
        Fraction of the true leakages in the calibration set that the calibrated intervals must contain.
    """

    light: float
    below: float
    above: float
    detours_below: float
    detours_above: float
    largest_ratio: float
    fraction: float

    def distances(self, state: PatchState) -> tuple[Array, Array]:
        """Return the distances from ln(leakage) to the two ends of the 95 % interval, up to a constant factor.

        The first array (steps,) is for the lower end of the interval, the second for the upper end. The constant factor
        for each end is obtained by calibration, see `IntervalWidths`.
        """
        carriers = np.where(np.isnan(state.carriers), _SEALED_CARRIERS, state.carriers)
        detours = np.where(np.isnan(state.detours), _SEALED_DETOURS, state.detours)
        contact = state.contact_fraction
        # factors that are the same for the lower and the upper end, see the formula in the docstring of the class
        # 0.003 limits the factor as A approaches 0
        light_contact = 1 + self.light / (contact + 0.003)
        common = error_of_few_carriers(carriers) * light_contact
        below = common * np.exp(self.below * contact) * (1 + self.detours_below * detours)
        above = common * np.exp(self.above * contact) * (1 + self.detours_above * detours)
        return below, above


#: The coefficients were chosen from a grid of values. One kind of surface after the other was left out of the
#: calibration, and the intervals had to contain about 0.9 of the true leakages of this kind. Of the coefficients that
#: meet this condition, the chosen ones give nearly the narrowest intervals down to two decades of leakage, see
#: docs/evidence/stochastic_seals.md. `largest_ratio`: no surface of the calibration set without honing grooves leaks
#: more than 10 times as much as a uniform gap of the same mean; honed surfaces leak up to 145 times as much.
#: A whole surface closes at a lower load than a patch of this surface, beginning at the edges of the bodies. `fraction`
#: with cells in order: when honed surfaces were left out, intervals calibrated for 0.95 contained only 0.87 of the true
#: leakages of honed surfaces, so that 0.96 is used.
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
#: A surface that is solved by blocks loses no channels between cells, because all of its cells stay in order.
_BY_BLOCKS = Difficulty(
    light=0.0,
    below=4.0,
    above=2.0,
    detours_below=0.0,
    detours_above=0.0,
    largest_ratio=60.0,
    fraction=0.95,
)
#: Expected error of each kind of computation.
DIFFICULTY = {
    "in order": _IN_ORDER,
    "at random": _AT_RANDOM,
    "with form": _AT_RANDOM,
    "by blocks": _BY_BLOCKS,
}


@dataclass(frozen=True)
class IntervalWidths:
    """Calibrated widths of the 95 % intervals of one kind of computation.

    Parameters
    ----------
    kind : str
        One of `COMPUTATIONS`.
    scenes : int
        Number of simulated scenes of this kind in the calibration set.
    below, above : float
        Quantiles of the scores, for the lower and for the upper end of the intervals. They multiply the distances that
        `Difficulty.distances` returns.
    """

    kind: str
    scenes: int
    below: float
    above: float

    @classmethod
    def calibrate(
        cls, kind: str, rows: Sequence[Mapping[str, str]], *, two_patches: bool = False
    ) -> IntervalWidths:
        """Calibrate the widths of the 95 % intervals of one kind of computation.

        Parameters
        ----------
        kind : str
            One of `COMPUTATIONS`.
        rows : sequence of mapping
            Rows of the calibration set for this kind of computation. Each row of the set describes a load step of a
            scene.
        two_patches : bool
            If True, use only rows computed from two patches together; if False, only rows computed from a single patch.
        """
        rows = [row for row in rows if (row["patch"] == _BOTH_PATCHES) == two_patches]
        scene = np.array([row["scene"] for row in rows])
        leakage = np.array([float(row["leakage"]) for row in rows])
        truth = np.array([float(row["truth"]) for row in rows])
        difficulty = DIFFICULTY[kind]
        expected_below, expected_above = difficulty.distances(state_of_rows(rows))
        error_below, error_above = distances_to_truth(leakage, truth)
        score_below = error_below / expected_below
        score_above = error_above / expected_above
        # The interval may miss the fraction 1 − f of the true leakages: (1 − f)/2 at each of its two ends. The other
        # 1 − (1 − f)/2 = (1 + f)/2 of the scores must be below the quantile.
        fraction = (1 + difficulty.fraction) / 2
        # a sealed state has no ln(leakage); its interval is calibrated by `sealed_end`
        is_open = leakage > 0
        below = weighted_quantile(score_below[is_open], scene[is_open], fraction)
        above = weighted_quantile(score_above[is_open], scene[is_open], fraction)
        return cls(
            kind=kind,
            scenes=np.unique(scene).size,
            below=max(0.0, below),
            above=max(0.0, above),
        )

    def ends(self, leakage: Array, state: PatchState) -> tuple[Array, Array]:
        """Return the lower and the upper end of the interval of the absolute leakage (steps,) [m²/s].

        With the computed leakage Q, the quantiles b and a of the scores, and the expected errors e_b and e_a of
        ln(leakage), the interval extends from Q exp(−b e_b) to Q exp(a e_a). There are four exceptions:

        - A lower end below `LEAST_TRUTH` times the leakage of an open seal is replaced by 0, because the seal may be
          sealed.
        - For the upper end, Q is raised to at least `LEAST_KNOWN` times the leakage of an open seal, because the exact
          value of a very small leakage means little.
        - The upper end is at most `largest_ratio` times the leakage of an open seal, or 2 Q if that is larger.
        - In a sealed contact state, the interval extends from 0 to `sealed_end` times the leakage of an open seal.

        leakage : leakage Q at each load step (steps,) [m²/s], NaN if unknown.
        """
        difficulty = DIFFICULTY[self.kind]
        expected_below, expected_above = difficulty.distances(state)
        q, open_leakage = np.abs(leakage), np.abs(state.open_leakage)
        lower = q * np.exp(-self.below * expected_below)
        lower = np.where(lower < LEAST_TRUTH * open_leakage, 0.0, lower)
        upper = np.maximum(q, LEAST_KNOWN * open_leakage) * np.exp(self.above * expected_above)
        limit = np.maximum(difficulty.largest_ratio * open_leakage, 2 * q)
        upper = np.where(q == 0, sealed_end() * open_leakage, np.minimum(upper, limit))
        return lower, np.where(np.isnan(q), np.nan, upper)


def distances_to_truth(leakage: Array, truth: Array) -> tuple[Array, Array]:
    """Return how far an interval must extend below and above the computed leakage to contain the true leakage.

    Parameters
    ----------
    leakage, truth : array (rows,)
        Computed and true leakage, divided by the leakage of an open seal.

    Returns
    -------
    below, above : array (rows,)
        Distances from ln(leakage) to the lower end (`below`) and to the upper end (`above`) of the narrowest interval
        that contains the true leakage. If the true leakage is above the computed leakage, the distance `below` is
        negative. If the true leakage is below the computed leakage, the distance `above` is negative.
    """
    with np.errstate(divide="ignore"):
        # Largest lower end that contains the true leakage. `IntervalWidths.ends` replaces a lower end below
        # `LEAST_TRUTH` by 0. For a true leakage below `LEAST_TRUTH`, a lower end of `LEAST_TRUTH` is therefore low
        # enough. In a sealed state (leakage 0), the largest lower end is 0; 1 is inserted to avoid a division by 0.
        largest_lower_end = np.where(truth >= LEAST_TRUTH, truth, np.minimum(leakage, LEAST_TRUTH))
        below = np.log(leakage / np.where(largest_lower_end > 0, largest_lower_end, 1.0))
        # the upper end is computed from at least `LEAST_KNOWN`, as in `IntervalWidths.ends`
        above = np.log(truth / np.maximum(leakage, LEAST_KNOWN))
    return below, above


def state_of_rows(rows: Sequence[Mapping[str, str]]) -> PatchState:
    """Read the contact states from rows of the calibration set.

    An open seal has leakage 1 in the returned state, because the calibration set contains leakages relative to an open
    seal.
    """
    names = "carriers", "contact", "detours"
    carriers, contact, detours = (np.array([float(row[name]) for row in rows]) for name in names)
    return PatchState(
        carriers=carriers,
        contact_fraction=contact,
        detours=detours,
        open_leakage=np.ones(len(rows)),
    )


def weighted_quantile(score: Array, scene: Array, fraction: float) -> float:
    """Return a quantile of the scores of load steps, giving every scene the same weight.

    Each of the n scenes has the weight 1/(n + 1), divided equally among the load steps of the scene. The remaining
    weight 1/(n + 1) is given to a new scene, whose scores are assumed to exceed all known scores.

    Parameters
    ----------
    score : array (rows,)
        Error of ln(leakage) at each load step, divided by the expected error.
    scene : array (rows,)
        Name of the simulated scene to which each load step belongs.
    fraction : float
        Level of the weighted quantile, between 0 and 1, such as 0.95. Above n/(n + 1), the quantile would be a score of
        the new scene, which is unknown; the largest known score is returned instead.
    """
    _, scene_number = np.unique(scene, return_inverse=True)  # index of the scene of each load step
    steps_of_scene = np.bincount(scene_number)  # number of load steps of each scene
    # weight of each load step: 1/(n + 1) for its scene, divided by the number of load steps of the scene
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
    """Read the rows of the calibration set, and keep them in memory for later calls."""
    with CALIBRATION.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


@cache
def sealed_end() -> float:
    """Return the upper end of the interval for a sealed state, divided by the leakage of an open seal.

    The ratio is calibrated on sealed states, pooled over all kinds of computation.
    """
    rows = [row for kind in COMPUTATIONS for row in calibration_rows(kind)]
    rows = [row for row in rows if float(row["leakage"]) == 0 and row["patch"] != _BOTH_PATCHES]
    truth = np.array([float(row["truth"]) for row in rows])
    return weighted_quantile(truth, np.array([row["scene"] for row in rows]), COVERAGE)


@cache
def interval_widths(kind: str, patches: int = 1) -> IntervalWidths:
    """Return the calibrated widths of the 95 % intervals for a kind of computation and a number of measured patches.

    For two or more patches, the calibration uses leakages computed from two patches together. If the calibration set
    contains no such leakages for the kind of computation, the widths for a single patch are returned.
    """
    rows = calibration_rows(kind)
    has_two = any(row["patch"] == _BOTH_PATCHES for row in rows)
    return IntervalWidths.calibrate(kind, rows, two_patches=patches > 1 and has_two)
