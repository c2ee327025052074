"""What the form in a measured patch does to its leakage: with it, without its curvature, and without its longest waves.

Contact and flow are solved on 128 points a side, where form and long waves are resolved. Under the loads of the face
its coarser version may be sealed, as it has less slope: then under loads that are less by as much.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, nan, sqrt

import numpy as np

from ..base import Array, NotConverged, Pair, to_text
from ..contact import HalfSpace, solve_contact
from ..contact.law import ContactLaw
from ..flow import cell_permeability
from ..topography import Topography, shortest_place
from ..topography.defects import fit_form

#: Points along the longer side of a place, and fewer of several so that all take no longer. Measured on eight faces at
#: three loads against all of their pixels: 11 of 11 ratios above 1.5 are found, and 1 of 11 others; the error of
#: ln(ratio) is 0.04 in the median and 0.3 in 9 of 10.
_POINTS = 128
#: Ratio of leakages from which on the choice matters, and the largest, which stands for that to one that is sealed.
_NOTABLE, _SEALED = 1.5, 1e4
#: What the choices of the form stand for, and what it means where only the longest waves matter.
_CHOICE = (
    ": surface.detrend = 1 keeps the curvature as part of the face, of a small seal or of one that is bent so as a "
    "whole; 2 takes it off, as the instrument's or as pressed flat by the load"
)
_LONG = ": waves as long as the patch decide, of which it holds few"
#: Contact and flow are solved to these residuals.
_CONTACT_RTOL, _FLOW_RTOL = 1e-3, 1e-2
#: Faces of fewer points along a side have no form.
_FEWEST = 8


@dataclass(frozen=True, eq=False)
class FormEffect:
    """Leakage of a patch without its tilt, by what else counts as its form.

    pressures : nominal ones at which it was solved (loads,) [Pa]. loads : the lowest and the highest as text.
    permeability : of the patch, without its curvature, and without waves longer than `longest` [m] (3, loads) [m³].
    height : of the curvature, highest to lowest point [m]. radii : of curvature along x1 and x2 [m]; both of the
    shortest of several places.
    """

    pressures: Array
    permeability: Array
    height: float
    radii: Pair
    longest: float
    loads: str

    @property
    def changes(self) -> Array:
        """ln of the leakage over that without curvature, and without long waves (2, loads); NaN where all is sealed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.permeability[0] / self.permeability[1:]
        return np.log(np.clip(ratio, 1 / _SEALED, _SEALED))

    @property
    def question(self) -> str:
        """What differences of leakage by more than half ask for, "" where there are none."""
        differ = np.abs(self.changes) > log(_NOTABLE)
        if differ[0].any():
            return _CHOICE
        return _LONG if differ.any() else ""

    def distance(self, pressures: Array, long_waves: bool = False) -> Array | None:
        """|ln| of the leakage over that without curvature, straight in ln(pressure) and kept beyond; None: unknown.

        long_waves : or over that without the longest waves, whichever is more.
        """
        changes = np.abs(self.changes if long_waves else self.changes[:1])
        change = np.where(np.isfinite(changes), changes, -1.0).max(axis=0)
        known = change >= 0
        if not known.any():
            return None
        return np.interp(
            np.log(np.maximum(pressures, 1e-300)), np.log(self.pressures[known]), change[known]
        )

    @property
    def doubts(self) -> list[str]:
        """What the form does, where that matters."""
        return [str(self)] if self.question else []

    def __str__(self) -> str:
        if not np.isfinite(self.changes).any():
            return f"at {self.loads} the effect of the form is unknown: on {_POINTS} points a side the patch is sealed"
        radii = " and ".join(to_text(radius, "m", 3) for radius in self.radii)
        curved, waved = (
            ends_text(np.exp(change)) or "an unknown number of" for change in self.changes
        )
        return (
            f"at {self.loads} the patch leaks {curved} times as much with its curvature as without "
            f"({to_text(self.height, 'm', 3)} high, radii of {radii} along x1 and x2), and {waved} times as much "
            f"with its waves longer than {to_text(self.longest, 'm', 3)}{self.question}"
        )


def ends_text(values: Array) -> str:
    """The first and the last known value, "" without any."""
    known = values[np.isfinite(values)]
    ends = [*known[:1], *known[-1:]]
    return " to ".join(dict.fromkeys(f"{float(f'{value:.2g}'):g}" for value in ends))


def form_effect(
    patch: Topography,
    modulus: float,
    law: ContactLaw,
    pressures: Sequence[float],
    boundary: tuple[str, str] = ("free", "periodic"),
    *,
    loads: str = "",
) -> FormEffect:
    """Solve contact and flow of a patch without tilt or undefined points as it is, and without what may be form.

    modulus, law, pressures, boundary : of the contact, the pressures > 0 and rising, see `solve_contact`.
    loads : the lowest and the highest pressure as text, unless in Pa.
    """
    pixel = max(shortest_place(patch).size) / _POINTS * sqrt(len(patch.each))
    n1, n2 = (max(_FEWEST, round(side / pixel)) for side in patch.size)
    few = patch.resample((min(n1, patch.shape[0]), min(n2, patch.shape[1])))
    place = shortest_place(few)
    longest = min(place.size) / 2
    versions = (few, few.detrend(2), few.high_pass(longest))
    kept = few.rms_slope / patch.rms_slope

    def solved(pressure: float) -> list[float]:
        return [_permeability(face, modulus, law, pressure, boundary) for face in versions]

    found = []
    for pressure in pressures:
        one = solved(pressure)
        found.append(one if all(one) else solved(pressure * kept))
    form = fit_form(place.heights, place.size, 2)
    first, _, second = (1 / max(abs(curvature), 1e-12) for curvature in form.curvatures)
    height = float(np.ptp(form.heights))
    ends = (to_text(pressures[n], "Pa", 3) for n in (0, -1))
    loads = loads or " to ".join(dict.fromkeys(ends))
    return FormEffect(
        np.array(pressures), np.array(found).T, height, (first, second), longest, loads
    )


def _permeability(
    face: Topography, modulus: float, law: ContactLaw, pressure: float, boundary: tuple[str, str]
) -> float:
    """Permeability of the places of a face side by side [m³]; NaN where it is not found."""
    found = []
    for place in face.each:
        half_space = HalfSpace(place.shape, place.spacing, modulus, boundary)
        try:
            contact = solve_contact(
                place.gap(), half_space, pressure=pressure, hardness=law, rtol=_CONTACT_RTOL
            )
            flow = cell_permeability(contact.gap, place.spacing, sides="periodic", rtol=_FLOW_RTOL)
        except NotConverged:
            return nan
        found.append(flow.value)
    return float(np.average(found, weights=[place.shape[1] for place in face.each]))
