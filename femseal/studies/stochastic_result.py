"""Result of the stochastic study: leakage of all realisations, and fields of the median realisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ..base import Array, Shown
from ..base.fields import (
    REALISATION,
    ROW,
    STEP,
    Field,
    declared,
)
from ..checks import QuickEstimate
from ..face.cell_flow import SolveCounts
from ..loads import LoadProgramme
from ..scene import Scene
from ..seal.element_seal import ElementSeal
from ..seal.tiles import SealTiles
from .cell_states import FaceCells
from .median_seal import MedianSeal
from .patch_leakage import PatchLeakage
from .patch_state import PatchState, open_leakage_of_state


@dataclass(frozen=True, repr=False)
class StochasticResult(Shown):
    """Leakage of all realisations of a seal, in which each tile takes a random cell of a surface.

    Parameters
    ----------
    leakage : array (realisations, steps), m²/s
        Leakage of each realisation per unit seal length, NaN where the flow solver failed.
    kind : str
        Kind of computation, which determines the calibration of the 95 % interval, see `patch_interval`.
    patch_state : PatchState, optional
        Contact states of the patch, which determine the width of the 95 % interval; None for a result that was not
        computed by `stochastic`.
    contact_fraction : array (steps,)
        Contact area of all tiles divided by their total area.
    mean_gap : array (steps,), m, optional
        Mean gap of all tiles; None for a result that was not computed by `stochastic`.
    tiles : SealTiles
        Tiles of the seal.
    cells : FaceCells
        Cells of the surface, at the loads of the scene or at tabulated pressures.
    row_pressure : array (steps, rows), Pa, optional
        Mean contact pressure of each row along the seal. This field and the next two are only computed for seals with
        cells in order and for strips and rings with a form deviation; otherwise they are None.
    band_breadth : array (steps,), m, optional
        Width of the contact band, from the first to the last row with contact.
    largest_row_pressure : array (steps,), Pa, optional
        Largest mean contact pressure of a row.
    patches : PatchLeakage, optional
        Leakage of seals whose cells come from a single measured patch, for each patch; None if there is only one patch.
    median_seal : MedianSeal, optional
        Fields of the realisation whose leakage is nearest to the median; None for very large seals and for sealed
        seals.
    failures : tuple of str
        One sentence for each failure of a solver. Quantities that could not be computed because a solver failed are
        NaN, or are left out of averages.
    warnings : tuple of str
        One sentence for each result that is not plausible.
    quick_estimate : QuickEstimate, optional
        Leakage estimated from the spectrum of the surface; None if the estimate is not valid for this surface.
    solve_counts : SolveCounts
        Number of linear systems that each solver solved, for cells and seals.
    """

    steps: LoadProgramme
    tiles: SealTiles = field(repr=False)
    cells: FaceCells = field(repr=False)
    contact_fraction: Array = field(repr=False)
    leakage: Array = declared(
        "leakage", "m^2/s", "leakage per unit seal length, realisations", REALISATION
    )
    row_pressure: Array | None = declared(
        "row_pressure", "Pa", "mean contact pressure of rows", ROW, default=None, repr=False
    )
    band_breadth: Array | None = declared(
        "band_breadth", "m", "breadth of the band in contact", STEP, default=None, repr=False
    )
    largest_row_pressure: Array | None = declared(
        "largest_row_pressure",
        "Pa",
        "largest mean contact pressure of a row",
        STEP,
        default=None,
        repr=False,
    )
    patches: PatchLeakage | None = field(default=None, repr=False)
    median_seal: MedianSeal | None = field(default=None, repr=False)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solve_counts: SolveCounts = field(default_factory=SolveCounts)
    kind: str = field(default="at random", repr=False)
    patch_state: PatchState | None = field(default=None, repr=False)
    quick_estimate: QuickEstimate | None = field(default=None, repr=False)
    mean_gap: Array | None = field(default=None, repr=False)

    method: ClassVar[str] = "stochastic"
    computed_fields: ClassVar[dict[str, Field]] = {
        "mean": Field(
            "leakage_mean", "m^2/s", "leakage per unit seal length, mean of the realisations", STEP
        ),
        "realisation_spread": Field(
            "realisation_spread",
            "1",
            "scatter of the realisations: standard deviation of ln(leakage)",
            STEP,
        ),
        "sealed_fraction": Field(
            "sealed_fraction",
            "1",
            "fraction of the realisations without leakage",
            STEP,
            "sealed [%]",
        ),
    }

    @property
    def predicted_leakage(self) -> Array:
        """Median leakage of the realisations (steps,) [m²/s]."""
        return self.quantile(0.5)

    @property
    def realisation_count(self) -> int:
        """Number of realisations."""
        return len(self.leakage)

    @property
    def takes_random_cells(self) -> bool:
        """Whether the tiles of the seal take cells from anywhere on the surface."""
        return not self.tiles.in_order

    @property
    def surface_gap(self) -> Array:
        """Mean gap of all tiles (steps,) [m]; NaN for a result that was not computed by `stochastic`."""
        return np.full(len(self.steps), np.nan) if self.mean_gap is None else self.mean_gap

    def contact_fraction_at(self, steps: LoadProgramme) -> Array:
        """Return the fraction of the tiles in contact (steps,), at any load steps of the result."""
        indices = [self.steps.index(step) for step in steps]
        return self.contact_fraction[indices]

    def open_leakage(self, scene: Scene) -> Array:
        """Return the leakage of a uniform gap that is equal to the mean gap (steps,) [m²/s]."""
        return open_leakage_of_state(self.patch_state, len(self.steps))

    @property
    def seal(self) -> ElementSeal:
        """Elements of the seal, with the size of the whole seal even if only a part of the length was computed."""
        return replace(self.tiles.seal, size=self.tiles.size)

    def quantile(self, q: float) -> Array:
        """Return the quantile q of the leakage of all realisations that did not fail (steps,) [m²/s].

        If the quantile lies between the leakages of two realisations, ln|leakage| is interpolated. If one of the two
        realisations is sealed, or if the signs of the two leakages differ, the quantile is 0. The quantile is NaN at
        load steps at which all realisations failed.
        """
        return at_every_step(self.leakage, partial(_quantile, q=q))

    @property
    def mean(self) -> Array:
        """Mean leakage of the realisations that did not fail (steps,) [m²/s]; NaN if all realisations failed."""
        return at_every_step(self.leakage, np.mean)

    @property
    def sealed_fraction(self) -> Array:
        """Fraction of the solved realisations that are sealed (steps,); NaN if all realisations failed."""
        return at_every_step(self.leakage, lambda leakage: np.mean(leakage == 0))

    @property
    def realisation_spread(self) -> Array:
        """Standard deviation of ln(leakage) of the leaking realisations (steps,); NaN with fewer than two."""
        return at_every_step(self.leakage, _log_deviation)

    def has_too_few_for(self, *quantiles: float) -> bool:
        """Return whether there are too few realisations to estimate the given quantiles of the leakage.

        The number of realisations must be at least 1/q, and at least 1/(1 − q), for each quantile q. For example, the
        quantiles 0.05 and 0.95 require 20 realisations.
        """
        tails = [min(q, 1 - q) for q in quantiles if 0 < q < 1]
        needed = max((1 / tail for tail in tails), default=1)
        return len(self.leakage) < needed - 1e-9


def at_every_step(leakage: Array, statistic: Callable[[Array], Any]) -> Array:
    """Evaluate a statistic over the realisations at every load step (steps,).

    Realisations that failed at a load step do not enter the statistic at this step. The statistic is NaN at load steps
    at which all realisations failed.

    leakage : leakage of each realisation at each load step (realisations, steps).
    statistic : function of the leakages at a single load step, such as `np.median`.
    """
    solved_at_steps = [at_step[np.isfinite(at_step)] for at_step in leakage.T]
    return np.array([statistic(solved) if solved.size else np.nan for solved in solved_at_steps])


def _quantile(values: Array, q: float) -> float:
    """Return the quantile q of `values`, with logarithmic interpolation between neighbouring values."""
    low = float(np.quantile(values, q, method="lower"))
    high = float(np.quantile(values, q, method="higher"))
    if low == high:
        return low
    if low * high <= 0:
        return 0.0
    # the quantile lies at the position (n − 1) q among the sorted values; its fractional part is the weight of `high`
    weight = (values.size - 1) * q % 1
    return float(np.sign(low)) * abs(low) ** (1 - weight) * abs(high) ** weight


def _log_deviation(values: Array) -> float:
    """Return the standard deviation of ln|value| over all nonzero values; NaN for fewer than two nonzero values."""
    magnitudes = np.abs(values[values != 0])
    if magnitudes.size < 2:
        return np.nan
    return float(np.std(np.log(magnitudes), ddof=1))
