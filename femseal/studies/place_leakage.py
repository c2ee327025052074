"""Leakage of each measured place of a face by itself, and of all but it: how much is known from so many places."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array
from ..base.fields import PLACE, STEP, Field, declared
from ..base.stage import Mapper, Stage
from ..base.text import Shown
from ..seal import RectangularSeal
from ..topography import Places
from ..topography.places import divided
from ..windows import Failed, FlowSettings, attempt
from .curve_distance import FLOOR
from .face_flow import resolved_flow
from .repeated_steps import first_equal
from .scene import Scene

#: Places from which on their scatter tells how far the leakage of more of them may lie.
FEWEST = 3
#: Seals that are drawn at most of each of these, where windows keep no places.
PLACE_REALISATIONS = 12


@dataclass(frozen=True, repr=False)
class PlaceLeakage(Shown):
    """Leakage by places (places, steps), NaN where the flow failed.

    alone : of each by itself, continued periodically. without : of all places but one, side by side; None of two.
    """

    alone: Array = declared("leakage_of_places", "m^2/s", "leakage per unit seal length, of each place alone", PLACE)
    without: Array | None = declared(
        "leakage_without_place", "m^2/s", "leakage per unit seal length, of all places but one", PLACE, default=None
    )

    @classmethod
    def of_drawn(cls, leakage: Array, kept: tuple[tuple[int, ...], ...]) -> PlaceLeakage | None:
        """Medians of seals (seals, steps) drawn from some places, as many for each entry of `kept_places`."""
        if not kept:
            return None
        median = np.median(leakage.reshape(len(kept), -1, leakage.shape[-1]), axis=1)
        count = sum(len(of) == 1 for of in kept)
        return cls(median[:count], median[count:] if len(kept) > count else None)

    computed_fields: ClassVar[dict[str, Field]] = {
        "scatter": Field(
            "place_scatter",
            "1",
            "standard deviation of the leakage of single places over its mean",
            STEP,
            "places ± [%]",
        ),
    }

    @property
    def relative(self) -> Array:
        """Leakage of each place over that of their mean (places,), mean over the loads that count."""
        mean = self.alone.mean(axis=0)
        counts = mean > FLOOR * mean[0]
        return np.asarray((self.alone[:, counts] / mean[counts]).mean(axis=1))

    @property
    def scatter(self) -> Array:
        """Standard deviation of the leakage of single places over its mean (steps,); NaN where none leaks."""
        mean = self.alone.mean(axis=0)
        return np.divide(self.alone.std(axis=0, ddof=1), mean, out=np.full(mean.shape, np.nan), where=mean > 0)


def kept_places(count: int) -> tuple[tuple[int, ...], ...]:
    """Numbers of the places, from 1, of which a leakage is wanted: each alone, and from three on all but each.

    >>> kept_places(3)
    ((1,), (2,), (3,), (2, 3), (1, 3), (1, 2))
    """
    every = range(1, count + 1)
    without = [tuple(m for m in every if m != n) for n in every] if count >= FEWEST else []
    return (*((n,) for n in every), *without)


def place_leakage(scene: Scene, gap: NDArray[np.floating], mapper: Mapper = map) -> PlaceLeakage | None:
    """Leakage by places from the gap of all of them at every step (steps, n1, n2) [m]; None of a single place."""
    surface = scene.surface
    if not isinstance(surface, Places):
        return None
    count, first = len(surface.widths), first_equal(gap, scene.steps)
    different, of_step = np.unique(first, return_inverse=True)
    places = divided(gap, surface.widths)
    pieces = [[places[n - 1][s] for n in of] for s in different for of in kept_places(count)]
    solve = partial(_permeability, spacing=surface.spacing, settings=scene.flow)
    found = np.array(list(mapper(Stage("flow of places", solve), pieces))).reshape(different.size, -1)[of_step]
    # leakage per length of a unit permeability
    unit = scene.leakage(RectangularSeal(surface.size, (1, 1)), 1.0).per_length
    leakage = unit * found.T
    return PlaceLeakage(leakage[:count], leakage[count:] if count >= FEWEST else None)


def _permeability(pieces: list[NDArray[np.floating]], spacing: tuple[float, float], settings: FlowSettings) -> float:
    """Permeability of places side by side, by their gaps (n1, n2) [m], in m³; NaN where the flow failed."""
    flow = attempt(resolved_flow, np.concatenate(pieces, axis=1), spacing, settings)
    return np.nan if isinstance(flow, Failed) else flow.permeability
