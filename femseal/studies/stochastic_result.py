"""Result of the stochastic study: leakage of the drawn seals, and the one nearest to the median, with its fields."""

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
from ..face.piece_flow import SolveCounts
from ..loads import FLOOR, LoadProgramme
from ..seal.mesh_seal import ElementSeal
from ..seal.tiles import SealTiles
from .patch_state import PatchState
from .piece_states import FacePieces, PlaceLeakage


@dataclass(frozen=True, repr=False)
class MedianSeal(Shown):
    """Fields of the realisation whose leakage is nearest to the median, over the parts of the seal.

    realisation : its number.
    outlines : corners of the parts (parts, corners, 2) [m]. permeability, fluid_pressure : (steps, parts), NaN at steps
        that failed, and the fluid pressure also in pockets.
    flux : volume rate per width at the fluid's reference density, in the plane of the seal (steps, parts, 2).
    pressure : mean contact pressure of the tile of every part (steps, parts).
    form : height of a seal that has a form (parts,). separation : distance of its mean planes, nominal : pressure that
    it gives to the tiles (steps, parts); None of others.
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


def nearest_to_median(leakage: Array) -> int | None:
    """Realisation whose ln(leakage) (realisations, steps) is nearest to the median of all; None where none leaks.

    Steps at which all failed do not count.
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
    """Realisations of a seal drawn from the pieces of a face. A realisation is a curve over the steps.

    leakage : of each realisation (realisations, steps).
    kind : of seals by what one patch does not know of them, see `drawn_error`.
    patch_state : contact states of the patch, from which the width of the interval follows; None of results made by
    hand.
    contact_fraction : of the face at every step (steps,).
    tiles : of the seal. pieces : of the face, at the loads of the scene or along a ladder.
    row_pressure, band_breadth, largest_row_pressure : of a seal as broad as the face, or of a seat; None of others.
    places : leakage by measured places; None of one.
    median_seal : fields of the realisation nearest to the median; None of very large seals, and without leakage.
    failures : reasons of values that are NaN or left out. warnings : reasons to doubt the result.
    solvers : number of systems by solver, of pieces and of drawn seals.
    """

    steps: LoadProgramme
    tiles: SealTiles = field(repr=False)
    pieces: FacePieces = field(repr=False)
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
    places: PlaceLeakage | None = field(default=None, repr=False)
    median_seal: MedianSeal | None = field(default=None, repr=False)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolveCounts = field(default_factory=SolveCounts)
    kind: str = field(default="anywhere", repr=False)
    patch_state: PatchState | None = field(default=None, repr=False)

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
        """The drawn seal, with the size of the whole where a part of it stands for it."""
        return replace(self.tiles.seal, size=self.tiles.size)

    def quantile(self, q: float) -> Array:
        """Quantile over the realisations that did not fail, at every step [m²/s]; NaN where all failed.

        Between two values it is interpolated in log space; beside a 0, or two signs, it is 0.
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

    def too_few(self, *quantiles: float) -> bool:
        """Whether there are fewer realisations than the quantiles need: one in each tail."""
        tails = [min(q, 1 - q) for q in quantiles if 0 < q < 1]
        return len(self.leakage) < max((1 / tail for tail in tails), default=1) - 1e-9


def at_every_step(leakage: Array, statistic: Callable[[Array], Any]) -> Array:
    """Statistic (steps,) of the realisations that did not fail, NaN where all failed; leakage (realisations, steps)."""
    finite = [column[np.isfinite(column)] for column in leakage.T]
    return np.array([statistic(column) if column.size else np.nan for column in finite])


def _quantile(values: Array, q: float) -> float:
    low, high = (float(np.quantile(values, q, method=end)) for end in ("lower", "higher"))
    weight = (values.size - 1) * q % 1
    if low == high or low * high <= 0:
        return low if low == high else 0.0
    return float(np.sign(low)) * abs(low) ** (1 - weight) * abs(high) ** weight


def _log_deviation(values: Array) -> float:
    size = np.abs(values[values != 0])
    return float(np.std(np.log(size), ddof=1)) if size.size > 1 else np.nan
