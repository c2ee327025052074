"""Calibrate how far a seal with cells of one measured patch, or a surface by blocks, may be from the truth.

`drawn_seals.csv` holds the leakage of seals with cells of one patch and the leakage of the whole surface, at every step
of random scenes. The cells stay in order ("in order") or are put together at random ("at random"), also in seals whose
form is known at points ("with form"). Surfaces that were solved by blocks ("by blocks") are a kind of their own.

The score of a step is the error of ln(leakage) over the difficulty of its contact state. The difficulty is known
without the truth and without any other load. The quantile of the scores of a kind, times the difficulty of a new state,
is the distance from the leakage to an end of the interval. Errors to both sides differ in size, so that each end has a
quantile of its own.

The steps of one scene have similar errors, so that scenes are what is exchangeable. Every scene has the weight 1/(n +
1), which its steps share; the remaining weight is beyond all scores. Each end then misses the truth of a step of a new
scene of the same population in at most half of the cases that the interval may miss, whatever the distribution of the
errors.

Sources: Vovk, Gammerman & Shafer, Algorithmic Learning in a Random World, 2005 (a quantile for each kind);
Papadopoulos, Gammerman & Vovk, Neural conformal prediction, 2008 (scores over difficulty); Romano, Patterson & Candès,
Conformalized quantile regression, NeurIPS 2019 (separate ends); Lee, Barber & Willett, J. R. Stat. Soc. B, 2025
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

#: The calibration set. `drawn_seals.py` and `patch_and_form.py` of `tests/benchmarks` make it.
CALIBRATION = Path(__file__).with_name("drawn_seals.csv")
#: Kinds of seals with cells of one patch, and blocks.
KINDS = ("in order", "at random", "with form", "by blocks")
#: Columns of the calibration set. Leakage and truth are over the leakage of an open seal, see `PatchState`; load and
#: peak are over the highest load; decades are those of the truth below that of the first load, and only sort tables.
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
#: Fraction of the truths that the intervals are stated to contain.
COVERAGE = 0.95
#: A truth below this fraction of the leakage of an open seal counts as sealed: an interval whose lower end would be
#: below has the lower end 0.
LEAST_TRUTH = 1e-4
#: An open state with less than this fraction of the leakage of an open seal only shows that single constrictions are
#: left. Its upper end is that of a state with this leakage. Of 1e-3, 1e-2 and 3e-2, this value contains the most truths
#: of kinds of surfaces that were left out of the calibration.
LEAST_KNOWN = 1e-3
#: Carriers and detours of a sealed state. A flow that an error would open has one constriction.
_SEALED_CARRIERS, _SEALED_DETOURS = 1.0, 0.0


def error_of_few_carriers(carriers: Array) -> Array:
    """Return the factor (0.3 + N^−½)^½ of the difficulty for N blocks that effectively carry the flow."""
    return np.asarray(np.sqrt(0.3 + 1 / np.sqrt(carriers)))


@dataclass(frozen=True)
class Difficulty:
    """How the expected size of the error depends on the contact state, for one kind of seal.

    The distance of ln(leakage) to an end of the interval is proportional to

        (0.3 + N^−½)^½ · [1 + l/(A + 0.003)] · exp(gA) · (1 + dF),

    where N is the number of carriers, A the contact fraction and F the detours of the state, see `PatchState`. The
    fewer blocks carry the flow, the less a patch tells about others (N). A very light contact, of which few asperities
    carry the load, tells less than one at a higher load (l). Error grows with contact (g). Channels that cross from
    cell to cell (d) go on from patch to patch where cells stay in order, so that such a seal may leak less than
    computed; where cells are put together at random they are lost, so that it may leak more.

    Parameters
    ----------
    light : float
        Coefficient l of light contacts.
    below, above : float
        Growth g with the contact fraction, for the lower and for the upper end.
    detours_below, detours_above : float
        Factor d of the detours, for the lower and for the upper end.
    most : float
        Largest upper end over the leakage of an open seal, unless twice the leakage is more.
    fraction : float
        Fraction of the truths that the calibrated intervals of this kind contain.
    """

    light: float
    below: float
    above: float
    detours_below: float
    detours_above: float
    most: float
    fraction: float

    def distances(self, state: PatchState) -> tuple[Array, Array]:
        """Return the distances of ln(leakage) to the lower and the upper end (steps,), up to a factor each."""
        carriers = np.where(np.isnan(state.carriers), _SEALED_CARRIERS, state.carriers)
        detours = np.where(np.isnan(state.detours), _SEALED_DETOURS, state.detours)
        contact = state.contact_fraction
        common = error_of_few_carriers(carriers) * (1 + self.light / (contact + 0.003))
        below = common * np.exp(self.below * contact) * (1 + self.detours_below * detours)
        above = common * np.exp(self.above * contact) * (1 + self.detours_above * detours)
        return below, above


#: Without honing grooves, no surface of the calibration set leaks more than 10 times as much as its mean gap would;
#: honed surfaces leak up to 145 times as much. Whole surfaces close before a patch of them does, beginning at the edges
#: of their bodies. Coefficients were chosen from a grid: of those that contain about .9 of the truths of each kind of
#: surfaces left out of the calibration, they give nearly the narrowest intervals down to two decades of leakage, see
#: docs/evidence/drawn_seals.md. With cells in order, intervals that contain .95 of all truths contained .87 of those of
#: honed surfaces when these were left out, so that a fraction of .96 is calibrated.
_IN_ORDER = Difficulty(
    light=0.005,
    below=0.0,
    above=2.0,
    detours_below=2.0,
    detours_above=0.0,
    most=60.0,
    fraction=0.96,
)
_AT_RANDOM = Difficulty(
    light=0.0,
    below=2.0,
    above=0.0,
    detours_below=0.0,
    detours_above=2.0,
    most=30.0,
    fraction=0.95,
)
#: Surfaces by blocks have no detours, since all cells keep their places.
_BY_BLOCKS = Difficulty(
    light=0.0,
    below=4.0,
    above=2.0,
    detours_below=0.0,
    detours_above=0.0,
    most=60.0,
    fraction=0.95,
)
#: Difficulty of each kind.
DIFFICULTY = {
    "in order": _IN_ORDER,
    "at random": _AT_RANDOM,
    "with form": _AT_RANDOM,
    "by blocks": _BY_BLOCKS,
}


@dataclass(frozen=True)
class IntervalWidths:
    """Widths of the intervals of a kind, from its scenes of the calibration set.

    Parameters
    ----------
    kind : one of `KINDS`.
    scenes : their number.
    below, above : distance of ln(leakage) to each end over that of `Difficulty.distances`.
    """

    kind: str
    scenes: int
    below: float
    above: float

    @classmethod
    def of(
        cls, kind: str, rows: Sequence[Mapping[str, str]], *, of_two: bool = False
    ) -> IntervalWidths:
        """Calibrate a kind by its rows, each a step of a scene.

        of_two : whether to use the rows of two patches together, instead of those of single patches.
        """
        rows = [row for row in rows if (row["patch"] == "both") == of_two]
        scene = np.array([row["scene"] for row in rows])
        leakage, truth = (np.array([float(row[n]) for row in rows]) for n in ("leakage", "truth"))
        unit_below, unit_above = DIFFICULTY[kind].distances(state_of_rows(rows))
        is_open = leakage > 0
        too_much, too_little = errors(leakage, truth)
        end = (1 + DIFFICULTY[kind].fraction) / 2
        below = weighted_quantile((too_much / unit_below)[is_open], scene[is_open], end)
        above = weighted_quantile((too_little / unit_above)[is_open], scene[is_open], end)
        return cls(kind, np.unique(scene).size, max(0.0, below), max(0.0, above))

    def ends(self, leakage: Array, state: PatchState) -> tuple[Array, Array]:
        """Return the lower and the upper end of the interval (steps,) [m²/s].

        They are of the size of the leakage, which may be negative. The interval of a sealed state is from 0 to
        `sealed_end`.
        """
        unit_below, unit_above = DIFFICULTY[self.kind].distances(state)
        q, open_leakage = np.abs(leakage), np.abs(state.open_leakage)
        lower = q * np.exp(-self.below * unit_below)
        lower = np.where(lower < LEAST_TRUTH * open_leakage, 0.0, lower)
        upper = np.maximum(q, LEAST_KNOWN * open_leakage) * np.exp(self.above * unit_above)
        highest = np.maximum(DIFFICULTY[self.kind].most * open_leakage, 2 * q)
        upper = np.where(q == 0, sealed_end() * open_leakage, np.minimum(upper, highest))
        return lower, np.where(np.isnan(q), np.nan, upper)


def errors(leakage: Array, truth: Array) -> tuple[Array, Array]:
    """Return the distances of ln(leakage) by which the lower and the upper end must be away to contain the truth.

    A truth below `LEAST_TRUTH` counts as `LEAST_TRUTH`, if the leakage is above it.

    leakage, truth : over the leakage of an open seal, arrays (rows,).
    """
    with np.errstate(divide="ignore"):
        nearest = np.where(truth >= LEAST_TRUTH, truth, np.minimum(leakage, LEAST_TRUTH))
        too_much = np.log(leakage / np.where(nearest > 0, nearest, 1.0))
        too_little = np.log(truth / np.maximum(leakage, LEAST_KNOWN))
    return too_much, too_little


def state_of_rows(rows: Sequence[Mapping[str, str]]) -> PatchState:
    """Return the states of rows of the calibration set, whose leakage of an open seal is 1."""
    names = "carriers", "contact", "detours"
    carriers, contact, detours = (np.array([float(row[name]) for row in rows]) for name in names)
    return PatchState(carriers, contact, detours, np.ones(len(rows)))


def weighted_quantile(score: Array, scene: Array, fraction: float) -> float:
    """Return a quantile of scores whose scenes have equal weights, with one scene more beyond all scores.

    Where the quantile lies beyond all scores, it is the largest score.
    """
    _, number = np.unique(scene, return_inverse=True)
    steps = np.bincount(number)
    weight = 1.0 / (steps[number] * (steps.size + 1))
    order = np.argsort(score, kind="stable")
    reached = int(np.searchsorted(np.cumsum(weight[order]), fraction - 1e-12))
    return float(score[order[min(reached, order.size - 1)]])


def calibration_rows(kind: str) -> list[dict[str, str]]:
    """Return the rows of a kind from the calibration set."""
    return [row for row in _calibration_set() if row["kind"] == kind]


@cache
def _calibration_set() -> tuple[dict[str, str], ...]:
    """Read the calibration set, once for all kinds."""
    with CALIBRATION.open(encoding="utf-8", newline="") as file:
        return tuple(csv.DictReader(file))


@cache
def sealed_end() -> float:
    """Return the upper end of a sealed state over the leakage of an open seal, from the sealed states of all kinds."""
    rows = [row for kind in KINDS for row in calibration_rows(kind)]
    rows = [row for row in rows if float(row["leakage"]) == 0 and row["patch"] != "both"]
    truth = np.array([float(row["truth"]) for row in rows])
    return weighted_quantile(truth, np.array([row["scene"] for row in rows]), COVERAGE)


@cache
def interval_widths(kind: str, patches: int = 1) -> IntervalWidths:
    """Return the widths of the intervals of a kind, one of `KINDS`, for so many measured patches.

    Those of more than two patches are those of two. Where the calibration set has only single patches of a kind, their
    widths serve for any number of patches.
    """
    rows = calibration_rows(kind)
    of_two = patches > 1 and any(row["patch"] == "both" for row in rows)
    return IntervalWidths.of(kind, rows, of_two=of_two)
