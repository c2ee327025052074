"""What is kept of a face in a state, its leakage, and that of each measured place and of all places but it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Floats, Mapper, Pair, Shown, Singles, Stage
from ..base.fields import PLACE, STEP, Field
from ..contact import LoadState
from ..face.piece_flow import (
    FaceFlow,
    Failed,
    FlowSettings,
    SolveCounts,
    attempt,
    resolved_flow,
)
from ..solids_and_loads import least_counted
from ..topography import Places
from ..topography.combined import divided
from .fluid_coupling import CoupledContact
from .scene import Scene

#: Places from which on their scatter tells how far the leakage of more of them may lie.
FEWEST = 3


@dataclass(frozen=True, eq=False)
class FaceState:
    """The contact of the whole face at one step, and the flow through it.

    gap [m], pressure [Pa] : (n1, n2). plastic : a bit for every pixel at the hardness. potential : of the flow, 1 at
    the inlet and 0 at the outlet, NaN in contact and in pockets (n1, n2).
    rows : mean pressure of rows (n1,) [Pa]. carried : mean pressure that the fluid carries [Pa].
    permeability : of the face [m³], NaN where its flow failed, for the `failed` reason.
    """

    gap: Singles
    pressure: Singles
    plastic: NDArray[np.uint8]
    potential: Singles
    rows: Array
    contact_fraction: float
    plastic_fraction: float
    mean_gap: float
    residual: float
    carried: float
    permeability: float
    solvers: SolveCounts
    failed: str = ""

    @classmethod
    def of(cls, state: LoadState, flow: FlowSettings) -> FaceState:
        """Solve the flow through the gap of a step."""
        contact = state.contact
        found: FaceFlow | Failed
        failed, carried = "", 0.0
        if isinstance(contact, CoupledContact):
            found, carried = contact.flow, contact.carried
        else:
            found = attempt(resolved_flow, contact.gap, contact.half_space.spacing, flow)
        if isinstance(found, Failed):
            failed = found.reason
            found = FaceFlow(np.nan, SolveCounts(), np.full(contact.gap.shape, np.nan))
        return cls(
            gap=contact.gap.astype(np.float32),
            pressure=contact.pressure.astype(np.float32),
            plastic=np.packbits(contact.plastic),
            potential=found.potential.astype(np.float32),
            rows=contact.pressure.mean(axis=1),
            contact_fraction=contact.area_fraction,
            plastic_fraction=contact.plastic_fraction,
            mean_gap=contact.mean_gap,
            residual=contact.residual,
            carried=carried,
            permeability=found.permeability,
            solvers=found.solvers,
            failed=failed,
        )


def fields_of_rows(row_pressure: Array, spacing: float) -> dict[str, Any]:
    """Fields of a result by their name, from the mean pressure of rows (steps, n1) [Pa], a spacing apart [m].

    The breadth of the band is the distance of the first row in contact from the last, both included.
    """
    touching = row_pressure > 0
    n1 = touching.shape[1]
    between = n1 - touching.argmax(axis=1) - touching[:, ::-1].argmax(axis=1)
    return {
        "row_pressure": row_pressure,
        "band_breadth": np.where(touching.any(axis=1), between, 0) * spacing,
        "largest_row_pressure": row_pressure.max(axis=1),
    }


@dataclass(frozen=True, repr=False)
class PlaceLeakage(Shown):
    """Leakage by places, NaN where the flow failed.

    kept : of each place by itself, continued periodically, and from three on of all but each, side by side
        (2 places, steps) [m²/s].
    """

    kept: Array = field(metadata={"unit": "m^2/s"})

    computed_fields: ClassVar[dict[str, Field]] = {
        "alone": Field(
            "leakage_of_places", "m^2/s", "leakage per unit seal length, of each place alone", PLACE
        ),
        "without": Field(
            "leakage_without_place",
            "m^2/s",
            "leakage per unit seal length, of all places but one",
            PLACE,
        ),
        "scatter": Field(
            "place_scatter",
            "1",
            "standard deviation of the leakage of single places over its mean",
            STEP,
            "places ± [%]",
        ),
    }

    @property
    def alone(self) -> Array:
        """Leakage of each place by itself (places, steps)."""
        return self.kept if self.without is None else self.kept[: len(self.without)]

    @property
    def without(self) -> Array | None:
        """Leakage of all places but each (places, steps); None of two."""
        places = len(self.kept) // 2
        return self.kept[places:] if places >= FEWEST else None

    @property
    def relative(self) -> Array:
        """Leakage of each place over that of their mean (places,), mean over the loads that count; 0 if none leaks."""
        mean = self.alone.mean(axis=0)
        counts = mean > least_counted(mean)
        return (self.alone[:, counts] / mean[counts]).sum(axis=1) / max(1, counts.sum())

    @property
    def scatter(self) -> Array:
        """Standard deviation of the leakage of single places over its mean (steps,); NaN where none leaks."""
        mean = self.alone.mean(axis=0)
        return np.divide(
            self.alone.std(axis=0, ddof=1), mean, out=np.full(mean.shape, np.nan), where=mean > 0
        )


def kept_places(count: int) -> tuple[tuple[int, ...], ...]:
    """Numbers of the places, from 1, of which a leakage is wanted: each alone, and from three on all but each.

    >>> kept_places(3)
    ((1,), (2,), (3,), (2, 3), (1, 3), (1, 2))
    """
    every = range(1, count + 1)
    without = [tuple(m for m in every if m != n) for n in every] if count >= FEWEST else []
    return (*((n,) for n in every), *without)


def place_leakage(scene: Scene, gap: Floats, mapper: Mapper = map) -> PlaceLeakage | None:
    """Leakage by places from the gap of all of them at every step (steps, n1, n2) [m]; None of a single place."""
    surface = scene.surface
    if not isinstance(surface, Places):
        return None
    solve = partial(
        permeabilities_of_places,
        widths=surface.widths,
        spacing=surface.spacing,
        settings=scene.flow,
    )
    found = mapper(Stage("flow of places", solve), gap)
    return PlaceLeakage(scene.unit_leakage * np.array(list(found)).T)


def permeabilities_of_places(
    gap: Floats,
    widths: tuple[int, ...],
    spacing: Pair,
    settings: FlowSettings,
) -> Array:
    """Permeability of each place, and from three on of all but each (2 places,) [m³]; NaN where the flow failed."""
    pieces = divided(gap, widths)
    found = []
    for of in kept_places(len(pieces)):
        gap = np.concatenate([pieces[n - 1] for n in of], axis=1)
        found.append(attempt(resolved_flow, gap, spacing, settings).permeability)
    return np.array(found)
