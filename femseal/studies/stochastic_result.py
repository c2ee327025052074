"""Hold the result of the stochastic study: the leakage of all realisations, and the fields of the median one."""

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
    """Fields of the realisation whose leakage is nearest to the median, over the elements of the seal.

    Parameters
    ----------
    realisation : its number.
    outlines : corners of the elements, array (elements, corners, 2), m.
    permeability, fluid_pressure : arrays (steps, elements), m³ and Pa, NaN at steps that failed; the fluid pressure is
        also NaN in pockets.
    flux : volume rate per width at the reference density of the fluid, in the plane of the seal, array (steps,
        elements, 2), m²/s.
    pressure : mean contact pressure of the tile of every element, array (steps, elements), Pa.
    form : height of a seal that has a form, array (elements,), m; None of others.
    separation : distance of the mean planes of such a seal, array (steps, elements), m.
    nominal : pressure that the form gives to the tiles, array (steps, elements), Pa.
    """

    realisation: int
    outlines: Array = declared(
        "drawn_corners",
        "m",
        "corners of the parts of the drawn seal, in its plane",
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
    """Return the realisation whose ln(leakage) is nearest to the median of all; None where none leaks.

    Steps at which all realisations failed do not count.

    leakage : array (realisations, steps).
    """
    size = np.abs(leakage[:, np.isfinite(leakage).any(axis=0)])
    whole = np.isfinite(size).all(axis=1)
    if not size.size or not whole.any():
        return None
    median = np.median(size[whole], axis=0)
    chosen = median > FLOOR * median.max()
    if not chosen.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(size[:, chosen] / median[chosen])).mean(axis=1)
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))


@dataclass(frozen=True, repr=False)
class StochasticResult(Shown):
    """Realisations of a seal whose tiles take the cells of a surface. A realisation is a curve over the load steps.

    Parameters
    ----------
    leakage : of each realisation, array (realisations, steps), m²/s.
    kind : of the realisations, by what one patch does not show of them, see `patch_interval`.
    patch_state : contact states of the patch, from which the width of the interval follows; None of results made by
        hand.
    contact_fraction : of the surface, array (steps,).
    mean_gap : of the cells at the pressures of the tiles, array (steps,), m; None of results made by hand.
    tiles : of the seal.
    cells : cells of the surface, at the loads of the scene or at tabulated pressures.
    row_pressure, band_breadth, largest_row_pressure : of a seal as broad as the surface, or of a seat; None of others.
    patches : leakage by measured patches; None of one patch.
    median_seal : fields of the realisation nearest to the median; None of very large seals, and without leakage.
    failures : reasons of values that are NaN or left out.
    warnings : what is not plausible, one sentence each.
    quick_estimate : by the spectrum of the surface; None where that does not tell.
    solvers : number of systems by solver, of cells and seals.
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
            "scatter of redraws of the measured patch: deviation of ln(leakage)",
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
        """The solved seal, with the size of the whole seal where a part stands for it."""
        return replace(self.tiles.seal, size=self.tiles.size)

    def quantile(self, q: float) -> Array:
        """Return the quantile q of the realisations that did not fail (steps,) [m²/s]; NaN where all failed.

        Between two values it is interpolated in log space; beside a 0, or between two signs, it is 0.
        """
        return at_every_step(self.leakage, partial(_quantile, q=q))

    @property
    def mean(self) -> Array:
        """Mean over the realisations that did not fail, at every step [m²/s]; NaN where all failed."""
        return at_every_step(self.leakage, np.mean)

    @property
    def sealed_fraction(self) -> Array:
        """Fraction without leakage of the realisations that did not fail, at every step; NaN where all failed."""
        return at_every_step(self.leakage, lambda leakage: np.mean(leakage == 0))

    @property
    def realisation_spread(self) -> Array:
        """Standard deviation of ln(leakage) between realisations, at every step; NaN where fewer than 2 leak."""
        return at_every_step(self.leakage, _log_deviation)

    def has_too_few_for(self, *quantiles: float) -> bool:
        """Return whether there are fewer realisations than the quantiles need, which is one in each tail."""
        tails = [min(q, 1 - q) for q in quantiles if 0 < q < 1]
        return len(self.leakage) < max((1 / tail for tail in tails), default=1) - 1e-9


def at_every_step(leakage: Array, statistic: Callable[[Array], Any]) -> Array:
    """Apply a statistic to the realisations that did not fail (steps,); NaN where all failed.

    leakage : array (realisations, steps).
    """
    finite = [column[np.isfinite(column)] for column in leakage.T]
    return np.array([statistic(column) if column.size else np.nan for column in finite])


def _quantile(values: Array, q: float) -> float:
    """Return the quantile q of values, interpolated in log space."""
    low, high = (float(np.quantile(values, q, method=end)) for end in ("lower", "higher"))
    weight = (values.size - 1) * q % 1
    if low == high or low * high <= 0:
        return low if low == high else 0.0
    return float(np.sign(low)) * abs(low) ** (1 - weight) * abs(high) ** weight


def _log_deviation(values: Array) -> float:
    """Return the standard deviation of ln|values|, without zeros; NaN of fewer than two."""
    size = np.abs(values[values != 0])
    return float(np.std(np.log(size), ddof=1)) if size.size > 1 else np.nan
