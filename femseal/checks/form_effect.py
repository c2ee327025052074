"""Effect of the form of a measured patch: its leakage with its curvature, without it, and without its longest waves.

Contact and flow are solved on 128 points along the longer side, where both are resolved. On fewer points the surface
has less slope, and may be sealed where it leaks on all of them: pressures are then lowered as much as its slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, nan, sqrt

import numpy as np

from ..base import Array, NotConverged, Pair, to_text
from ..contact import HalfSpace, solve_contact
from ..contact.law import ContactLaw
from ..flow import cell_permeability
from ..topography import Surface
from ..topography.defects import fit_form
from .quick_estimate import first_to_last

#: Points along the longer side of a patch; fewer of several patches, so that all of them take no longer. Measured on
#: eight surfaces at three loads against all of their pixels: 11 of 11 ratios above 1.5 are found, and 1 of 11 others;
#: the error of ln(ratio) is 0.04 in the median and 0.3 in 9 of 10.
_POINTS = 128
#: Surfaces keep this many points along their shorter side.
_FEWEST_POINTS = 8
#: Ratio of leakages from which on the form matters, and the largest, which stands for that to a sealed surface.
_NOTABLE_RATIO, _SEALED_RATIO = 1.5, 1e4
#: Tolerances of contact and flow.
_CONTACT_RTOL, _FLOW_RTOL = 1e-3, 1e-2


@dataclass(frozen=True, eq=False)
class FormEffect:
    """Leakage of a measured patch without its tilt, by what else counts as its form.

    Attributes
    ----------
    pressures : array (loads,) of the nominal pressures at which it was solved [Pa].
    permeability : array (3, loads) of the permeability of the patch, of the patch without its curvature, and of the
        patch without waves longer than `longest` [m³]; NaN where a solution failed.
    height : of the curvature, from its highest to its lowest point [m].
    radii : of curvature along x1 and x2 [m]; like the height of the shortest of several patches.
    longest : wavelength beyond which waves are left out [m].
    loads : the lowest and the highest pressure as text.
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
        return np.log(np.clip(ratio, 1 / _SEALED_RATIO, _SEALED_RATIO))

    @property
    def advice(self) -> str:
        """What to do where the form changes the leakage by more than half; "" where it does not."""
        is_notable = np.abs(self.changes) > log(_NOTABLE_RATIO)
        if is_notable[0].any():
            return (
                "Is the curvature real, as of a small seal or of one that is bent as a whole? Then surface.detrend = 1 "
                "keeps the curvature; where it comes from the instrument, or the load presses it flat, 2 removes it"
            )
        if is_notable.any():
            return "Waves as long as the patch decide, of which it has few: measure a larger area or several patches"
        return ""

    def distance(self, pressures: Array, long_waves: bool = False) -> Array | None:
        """Interpolate |ln| of the leakage over that without curvature at other pressures [Pa]; None where unknown.

        It is straight in ln(pressure) between those that were solved, and constant beyond.

        long_waves : take that without the longest waves where it is larger.
        """
        changes = np.abs(self.changes if long_waves else self.changes[:1])
        change = np.where(np.isfinite(changes), changes, -1.0).max(axis=0)
        is_known = change >= 0
        if not is_known.any():
            return None
        at = np.log(np.maximum(pressures, 1e-300))
        return np.interp(at, np.log(self.pressures[is_known]), change[is_known])

    @property
    def warnings(self) -> list[str]:
        """A sentence where the form matters."""
        return [str(self)] if self.advice else []

    def __str__(self) -> str:
        if not np.isfinite(self.changes).any():
            return (
                f"The effect of the form is unknown at {self.loads}: on {_POINTS} points along its longer side the "
                "patch is sealed"
            )
        with_curvature, with_long_waves = (
            first_to_last(np.exp(change)) or "an unknown number of" for change in self.changes
        )
        radii = " and ".join(to_text(radius, "m", 3) for radius in self.radii)
        text = (
            f"The measured patch leaks {with_curvature} times as much with its curvature as without, at {self.loads} "
            f"({to_text(self.height, 'm', 3)} high, radii of {radii} along x1 and x2), and {with_long_waves} times as "
            f"much with its waves longer than {to_text(self.longest, 'm', 3)} as without"
        )
        return f"{text}. {self.advice}" if self.advice else text


def solve_form_effect(
    patch: Surface,
    modulus: float,
    law: ContactLaw,
    pressures: Sequence[float],
    boundary: tuple[str, str] = ("free", "periodic"),
    *,
    loads: str = "",
) -> FormEffect:
    """Solve contact and flow of a measured patch as it is, without its curvature, and without its longest waves.

    Parameters
    ----------
    patch : surface without tilt and without undefined points.
    modulus, law, boundary : of the contact, see `solve_contact`.
    pressures : nominal pressures [Pa], > 0 and rising.
    loads : the lowest and the highest pressure as text; in Pa unless given.
    """
    pixel = max(patch.shortest_patch.size) / _POINTS * sqrt(len(patch.patches))
    n1, n2 = (max(_FEWEST_POINTS, round(side / pixel)) for side in patch.size)
    coarse = patch.resample((min(n1, patch.shape[0]), min(n2, patch.shape[1])))
    shortest = coarse.shortest_patch
    longest = min(shortest.size) / 2
    versions = (coarse, coarse.detrend(2), coarse.high_pass(longest))
    kept_slope = coarse.rms_slope / patch.rms_slope
    permeability = []  # (load, version)
    for pressure in pressures:
        solved = [_permeability(surface, modulus, law, pressure, boundary) for surface in versions]
        if not all(solved):
            lower = pressure * kept_slope
            solved = [_permeability(surface, modulus, law, lower, boundary) for surface in versions]
        permeability.append(solved)
    form = fit_form(shortest.heights, shortest.size, 2)
    first_radius, _, second_radius = (1 / max(abs(c), 1e-12) for c in form.curvatures)
    if not loads:
        loads = " to ".join(dict.fromkeys(to_text(pressures[n], "Pa", 3) for n in (0, -1)))
    return FormEffect(
        pressures=np.array(pressures),
        permeability=np.array(permeability).T,
        height=float(np.ptp(form.heights)),
        radii=(first_radius, second_radius),
        longest=longest,
        loads=loads,
    )


def _permeability(
    surface: Surface, modulus: float, law: ContactLaw, pressure: float, boundary: tuple[str, str]
) -> float:
    """Solve the permeability of the patches of a surface side by side [m³]; NaN where a solution fails."""
    permeability = []
    for patch in surface.patches:
        half_space = HalfSpace(patch.shape, patch.spacing, modulus, boundary)
        try:
            contact = solve_contact(
                patch.gap(), half_space, pressure=pressure, hardness=law, rtol=_CONTACT_RTOL
            )
            flow = cell_permeability(contact.gap, patch.spacing, sides="periodic", rtol=_FLOW_RTOL)
        except NotConverged:
            return nan
        permeability.append(flow.value)
    return float(np.average(permeability, weights=[patch.shape[1] for patch in surface.patches]))
