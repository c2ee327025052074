"""Solution of a contact problem: pressure, gap and plastic deformation of each point."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..base import Array, Flags, Shown
from .half_space import HalfSpace


@dataclass(frozen=True, repr=False)
class Contact(Shown):
    """Solution of a contact problem. The metadata of each field of the dataclass contain its unit.

    The contact pressure is p, the hardness H, and the raw gap g. Out of contact p = 0 and g > 0. In elastic contact
    0 < p < H and g = 0. A point with p ≥ H is plastic and has g ≤ 0.
    """

    pressure: Array = field(metadata={"unit": "Pa", "long_name": "contact pressure"})
    gap: Array = field(metadata={"unit": "m", "long_name": "deformed gap"})
    plastic_deformation: Array = field(metadata={"unit": "m", "long_name": "permanent deformation"})
    approach: float = field(metadata={"unit": "m", "long_name": "rigid-body approach"})
    residual: float = field(metadata={"unit": "1", "long_name": "complementarity residual"})
    iterations: int = field(
        metadata={"unit": "1", "long_name": "outer iterations on the given grid"}
    )
    fft_pairs: int = field(metadata={"unit": "1", "long_name": "transform pairs on the given grid"})
    plastic: Flags = field(metadata={"unit": "1", "long_name": "points at the hardness"})
    half_space: HalfSpace = field(repr=False)

    _derived: ClassVar = {
        "area_fraction": "1",
        "plastic_fraction": "1",
        "mean_pressure": "Pa",
        "mean_gap": "m",
    }

    @property
    def area_fraction(self) -> float:
        """Fraction of the points that are in contact, that is, at which p > 0."""
        return float(np.count_nonzero(self.pressure) / self.pressure.size)

    @property
    def area_fraction_corrected(self) -> float:
        """Contact fraction, corrected for the discretisation error at the edges of contact patches.

        A pixel that is only partly in contact is counted in full, so that the contact area is overestimated. Each pixel
        side between contact and gap adds an error of (π − 1 + ln 2)/24 of a pixel area (Yastrebov, Anciaux & Molinari,
        Tribol. Int. 114, 2017, 161).
        """
        in_contact = self.pressure > 0
        n_sides = 0
        for axis, kind in enumerate(self.half_space.boundary):
            neighbours: dict[str, dict[str, Any]] = {
                "periodic": {"append": in_contact.take([0], axis)},
                "mirror": {},
                "free": {"prepend": False, "append": False},
            }
            is_edge = np.diff(in_contact, axis=axis, **neighbours[kind])
            n_sides += int(np.count_nonzero(is_edge))
        per_side = (np.pi - 1 + np.log(2)) / 24
        return max(0.0, self.area_fraction - per_side * n_sides / in_contact.size)

    @property
    def plastic_fraction(self) -> float:
        """Fraction of the points whose contact pressure has reached the hardness."""
        return float(np.count_nonzero(self.plastic) / self.pressure.size)

    @property
    def mean_pressure(self) -> float:
        """Mean pressure p̄ over the nominal area [Pa]."""
        return float(self.pressure.mean())

    @property
    def mean_gap(self) -> float:
        """Mean deformed gap [m]."""
        return float(self.gap.mean())

    @property
    def raw_gap(self) -> Array:
        """Gap [m] due to elastic displacements alone, without plastic deformation; negative at plastic points."""
        return self.gap - self.plastic_deformation
