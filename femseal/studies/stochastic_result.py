"""Hold the result of the stochastic study: the leakage of all realisations, and the fields of the median seal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ..base import Array, Shown
from ..base.fields import (
    CORNER,
    PART,
    PART_FORM,
    PART_VECTOR,
    REALISATION,
    ROW,
    STEP,
    Field,
    declared,
)
from ..checks import QuickEstimate
from ..face.cell_flow import SolveCounts
from ..loads import FLOOR, LoadProgramme
from ..seal.mesh_seal import ElementSeal
from ..seal.tiles import SealTiles
from .cell_states import FaceCells, PatchLeakage
from .patch_state import PatchState


@dataclass(frozen=True, repr=False)
class MedianSeal(Shown):
    """Hold the fields of the realisation whose leakage is nearest to the median, over the elements of the seal.

    Parameters
    ----------
    realisation : int
        Number of the realisation.
    outlines : array (elements, corners, 2), m
        Corners of the elements in the plane of the seal.
    permeability : array (steps, elements), m³
        Permeability of each element, NaN at steps that failed.
    fluid_pressure : array (steps, elements), Pa
        Fluid pressure, NaN at steps that failed and in pockets.
    flux : array (steps, elements, 2), m²/s
        Volume rate per width at the reference density of the fluid, as a vector in the plane of the seal.
    pressure : array (steps, elements), Pa
        Mean contact pressure of the tile to which each element belongs.
    form : array (elements,), m, optional
        Height of the form of the seal. None for a seal without form; then `separation` and `nominal` are None as well.
    separation : array (steps, elements), m, optional
        Distance between the mean planes of the two faces.
    nominal : array (steps, elements), Pa, optional
        Nominal pressure of the tiles under the form of the seal.
    """

    realisation: int
    outlines: Array = declared(
        "drawn_corners",
        "m",
        "corners of the elements of the seal, in its plane",
        CORNER,
        repr=False,
    )
    permeability: Array = declared(
        "drawn_permeability", "m^3", "permeability, median realisation", PART
    )
    fluid_pressure: Array = declared(
        "drawn_fluid_pressure", "Pa", "fluid pressure, median realisation", PART
    )
    flux: Array = declared("drawn_flux", "m^2/s", "flow per width, median realisation", PART_VECTOR)
    pressure: Array | None = declared(
        "drawn_contact_pressure",
        "Pa",
        "contact pressure of tiles, median realisation",
        PART,
        default=None,
    )
    form: Array | None = declared("drawn_form", "m", "form of the seal", PART_FORM, default=None)
    separation: Array | None = declared(
        "drawn_separation", "m", "distance of the mean planes of the faces", PART, default=None
    )
    nominal: Array | None = declared(
        "drawn_nominal_pressure",
        "Pa",
        "nominal pressure of tiles under the form of the seal",
        PART,
        default=None,
    )


def find_median_realisation(leakage: Array) -> int | None:
    """Return the number of the realisation whose leakage is nearest to the median; None if there is none.

    The distance to the median is the mean of |ln(leakage/median)| over the load steps. Steps at which all realisations
    failed, or at which the median is negligible, are ignored. There is no such realisation if none leaks, or if every
    realisation failed at a step at which others were solved.

    leakage : leakage of each realisation, array (realisations, steps).
    """
    solved_steps = np.isfinite(leakage).any(axis=0)
    magnitude = np.abs(leakage[:, solved_steps])  # (realisation, step)
    is_complete = np.isfinite(magnitude).all(axis=1)
    if not magnitude.size or not is_complete.any():
        return None
    median = np.median(magnitude[is_complete], axis=0)
    leaks = median > FLOOR * median.max()
    if not leaks.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(magnitude[:, leaks] / median[leaks])).mean(axis=1)
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))


@dataclass(frozen=True, repr=False)
class StochasticResult(Shown):
    """Hold the realisations of a seal, whose tiles take random cells of a surface.

    Parameters
    ----------
    leakage : array (realisations, steps), m²/s
        Leakage of each realisation per unit seal length, NaN where the flow solver failed.
    kind : str
        Kind of computation, which determines the calibration of the 95 % interval, see `patch_interval`.
    patch_state : PatchState, optional
        Contact states of the patch, which determine the width of the interval. None if the result was not made by
        `stochastic`.
    contact_fraction : array (steps,)
        Fraction of the tiles in contact.
    mean_gap : array (steps,), m, optional
        Mean gap of the tiles. None if the result was not made by `stochastic`.
    tiles : SealTiles
        Tiles of the seal.
    cells : FaceCells
        Cells of the surface, at the loads of the scene or at tabulated pressures.
    row_pressure : array (steps, rows), Pa, optional
        Mean contact pressure of each row. None unless the cells stay in order or the seal has a form; then
        `band_breadth` and `largest_row_pressure` are None as well.
    band_breadth : array (steps,), m, optional
        Breadth of the band in contact.
    largest_row_pressure : array (steps,), Pa, optional
        Largest mean contact pressure of a row.
    patches : PatchLeakage, optional
        Leakage of seals that are made of a single measured patch; None if there is only one patch.
    median_seal : MedianSeal, optional
        Fields of the realisation nearest to the median; None for very large seals, and if nothing leaks.
    failures : tuple of str
        Reasons for values that are NaN or left out.
    warnings : tuple of str
        Results that are not plausible, one sentence each.
    quick_estimate : QuickEstimate, optional
        Leakage estimated from the spectrum of the surface. None for a surface for which this estimate is not valid.
    solvers : SolveCounts
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
    solvers: SolveCounts = field(default_factory=SolveCounts)
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
    def seal(self) -> ElementSeal:
        """Elements of the seal, with the size of the whole seal even if only a part of its length was solved."""
        return replace(self.tiles.seal, size=self.tiles.size)

    def quantile(self, q: float) -> Array:
        """Return the quantile q of the realisations that did not fail (steps,) [m²/s]; NaN where all failed.

        Between two neighbouring realisations, ln|leakage| is interpolated. The result is 0 if one of these two is
        sealed, or if the signs of their leakages differ.
        """
        return at_every_step(self.leakage, partial(_quantile, q=q))

    @property
    def mean(self) -> Array:
        """Mean leakage of the realisations that did not fail (steps,) [m²/s]; NaN where all failed."""
        return at_every_step(self.leakage, np.mean)

    @property
    def sealed_fraction(self) -> Array:
        """Fraction of sealed realisations among those that did not fail (steps,); NaN where all failed."""
        return at_every_step(self.leakage, lambda leakage: np.mean(leakage == 0))

    @property
    def realisation_spread(self) -> Array:
        """Standard deviation of ln(leakage) between realisations (steps,); NaN where fewer than two leak."""
        return at_every_step(self.leakage, _log_deviation)

    def has_too_few_for(self, *quantiles: float) -> bool:
        """Return whether there are too few realisations to estimate the quantiles.

        On average, at least one realisation must lie beyond each quantile: 20 realisations for 0.05 or 0.95.
        """
        tails = [min(q, 1 - q) for q in quantiles if 0 < q < 1]
        needed = max((1 / tail for tail in tails), default=1)
        return len(self.leakage) < needed - 1e-9


def at_every_step(leakage: Array, statistic: Callable[[Array], Any]) -> Array:
    """Evaluate a statistic over the realisations at every load step (steps,).

    At each step, realisations that failed there are left out. The result is NaN at steps at which all failed.

    leakage : leakage of each realisation, array (realisations, steps).
    statistic : function of the leakages at one step, such as `np.median`.
    """
    solved_at_steps = [at_step[np.isfinite(at_step)] for at_step in leakage.T]
    return np.array([statistic(solved) if solved.size else np.nan for solved in solved_at_steps])


def _quantile(values: Array, q: float) -> float:
    """Return the quantile q of values; the logarithms of the two neighbouring values are interpolated."""
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
    """Return the standard deviation of ln|value| over the values other than 0; NaN if there are fewer than two."""
    magnitudes = np.abs(values[values != 0])
    if magnitudes.size < 2:
        return np.nan
    return float(np.std(np.log(magnitudes), ddof=1))
