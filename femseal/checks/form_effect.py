"""Compute how the form of a measured patch changes its leakage.

Contact and flow are solved for three versions of the patch on a coarse grid: without its tilt, without its curvature,
and without its longest waves. The grid has 128 points along the longer side of the patch. On the coarse grid, the patch
has smaller slopes, so that it may be sealed at a pressure at which the original patch leaks. In this case, contact and
flow are solved at a lower pressure, reduced in proportion to the slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log, nan, sqrt

import numpy as np

from ..base import Array, NotConverged, Pair, to_text
from ..contact import Bodies, HalfSpace, solve_contact
from ..contact.law import ContactLaw
from ..flow import cell_permeability
from ..topography import Surface
from ..topography.form_fit import fit_form
from .quick_estimate import first_to_last

#: Number of points along the longer side of a single patch. If a surface has several patches, each patch has fewer
#: points, so that the computing time does not increase. Eight surfaces were compared with their full resolution at
#: three loads. All 11 ratios above 1.5 were detected, with one false alarm in 11 other cases. The median error of
#: ln(ratio) is 0.04, and the 90th percentile 0.3.
_POINTS = 128
#: Smallest number of points along the shorter side.
_FEWEST_POINTS = 8
#: Ratio of leakages above which the effect of the curvature or of the long waves is reported to the user.
_NOTABLE_RATIO = 1.5
#: Largest ratio of leakages. If one of the two leakages is 0, the ratio counts as this number.
_SEALED_RATIO = 1e4
#: Relative tolerances of contact and flow.
_CONTACT_RTOL, _FLOW_RTOL = 1e-3, 1e-2


@dataclass(frozen=True, eq=False)
class FormEffect:
    """Permeability of a measured patch: with all waves, without curvature, and without the longest waves.

    Attributes
    ----------
    pressures : array, (loads,)
        Nominal pressures [Pa].
    permeability : array, (3, loads)
        Permeability [m³] of three versions of the patch, one in each row: without its tilt, without its curvature, and
        without waves longer than `longest`. NaN where a solver failed.
    height : float
        Height of the curvature: distance from its lowest to its highest point [m].
    radii : tuple of two float
        Radii of curvature along x1 and x2 [m]. If there are several patches, `height` and `radii` describe the
        curvature of the shortest patch.
    longest : float
        Waves longer than this wavelength [m] are removed from the third version of the patch.
    loads : str
        Text that states the lowest and the highest pressure.
    """

    pressures: Array
    permeability: Array
    height: float
    radii: Pair
    longest: float
    loads: str

    @property
    def changes(self) -> Array:
        """Effect of the curvature (row 0) and effect of the long waves (row 1) on the leakage at each load, (2, loads).

        The effect of the curvature is ln(Q/Q_c), where Q is the leakage of the patch, and Q_c the leakage of the patch
        without its curvature. The effect of the long waves is ln(Q/Q_w), where Q_w is the leakage of the patch without
        its long waves. An effect is NaN if both leakages in its ratio are 0.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            # 0 or inf if one of the two surfaces is sealed, NaN if both are sealed
            ratio = self.permeability[0] / self.permeability[1:]
        return np.log(np.clip(ratio, 1 / _SEALED_RATIO, _SEALED_RATIO))

    @property
    def advice(self) -> str:
        """Advice for the user if curvature or long waves change the leakage by a factor above 1.5, otherwise ""."""
        is_notable = np.abs(self.changes) > log(_NOTABLE_RATIO)
        if is_notable[0].any():
            return (
                "Does the curvature belong to the seal, because the seal is small or bent as a whole? Then "
                "surface.detrend = 1 keeps the curvature. If it comes from the instrument, or if the load presses it "
                "flat, 2 removes it"
            )
        if is_notable.any():
            return (
                "The leakage depends on waves as long as the patch, of which it contains few: measure a larger area or "
                "several patches"
            )
        return ""

    def distance(self, pressures: Array, long_waves: bool = False) -> Array | None:
        """Interpolate the effect of the curvature or of the long waves on the leakage at other nominal pressures.

        The effect is |ln(ratio of leakages)|, see `changes`. Between the computed pressures, the effect is interpolated
        linearly in ln(pressure). Below the lowest and above the highest computed pressure, the effect is taken as
        constant.

        Parameters
        ----------
        pressures : array, (steps,)
            Nominal pressures [Pa].
        long_waves : bool
            If False, return the effect of the curvature. If True, return the larger of the effects of the curvature and
            of the long waves.

        Returns
        -------
        array, (steps,), or None
            Effect at each nominal pressure; None if the effect is unknown at all computed pressures.
        """
        changes = np.abs(self.changes if long_waves else self.changes[:1])  # (effect, load)
        change = np.where(np.isfinite(changes), changes, -1.0).max(axis=0)  # −1 if unknown
        is_known = change >= 0
        if not is_known.any():
            return None
        log_pressures = np.log(np.maximum(pressures, 1e-300))
        return np.interp(log_pressures, np.log(self.pressures[is_known]), change[is_known])

    @property
    def warnings(self) -> list[str]:
        """Warning for the user if the curvature or the long waves change the leakage notably; empty otherwise."""
        return [str(self)] if self.advice else []

    def __str__(self) -> str:
        """Describe the effects of curvature and long waves in a sentence, followed by advice if an effect is large."""
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
            f"much with its waves longer than {to_text(self.longest, 'm', 3)} as without (first number: lowest load)"
        )
        return f"{text}. {self.advice}" if self.advice else text


def solve_form_effect(
    patch: Surface,
    modulus: float | Bodies,
    law: ContactLaw,
    pressures: Sequence[float],
    boundary: tuple[str, str] = ("free", "periodic"),
    *,
    loads: str = "",
) -> FormEffect:
    """Solve contact and flow of a measured patch: with all waves, without curvature, and without the longest waves.

    Parameters
    ----------
    patch : Topography or Patches
        Surface without tilt and without undefined points.
    modulus : float
        Contact modulus E* [Pa].
    law : ContactLaw
        Contact law.
    pressures : sequence of float
        Increasing nominal pressures > 0 [Pa].
    boundary : tuple of two str
        Contact boundary along x1 and x2, see `HalfSpace`.
    loads : str
        Text that states the lowest and the highest pressure. Default: a text made from `pressures`.
    """
    # A single patch gets 128 points along its longer side. The pixels of n patches are √n times as large, so that all
    # patches together have as many points.
    pixel = max(patch.shortest_patch.size) / _POINTS * sqrt(len(patch.patches))
    n1, n2 = (max(_FEWEST_POINTS, round(side / pixel)) for side in patch.size)
    coarse = patch.resample((min(n1, patch.shape[0]), min(n2, patch.shape[1])))
    shortest = coarse.shortest_patch
    longest = min(shortest.size) / 2
    # the three versions of the patch: all waves, without curvature, without long waves
    surfaces = (coarse, coarse.detrend(2), coarse.high_pass(longest))
    permeability = []  # (load, surface)
    for pressure in pressures:
        solved = [_permeability(surface, modulus, law, pressure, boundary) for surface in surfaces]
        if not all(solved):
            # At least one surface is sealed and has the permeability 0. The coarse surface has a smaller rms slope than
            # the patch, so that it is sealed at a lower pressure than the patch. All three surfaces are solved again at
            # a pressure that is reduced in the ratio of the rms slopes.
            reduced = pressure * (coarse.rms_slope / patch.rms_slope)
            solved = [
                _permeability(surface, modulus, law, reduced, boundary) for surface in surfaces
            ]
        permeability.append(solved)
    form = fit_form(shortest.heights, shortest.size, 2)
    # the curvatures are ∂²z/∂x1², ∂²z/∂x1∂x2 and ∂²z/∂x2²
    curvature_1, _, curvature_2 = form.curvatures
    radii = 1 / max(abs(curvature_1), 1e-12), 1 / max(abs(curvature_2), 1e-12)
    if not loads:
        ends = [to_text(pressure, "Pa", 3) for pressure in (pressures[0], pressures[-1])]
        loads = " to ".join(dict.fromkeys(ends))  # one text if both ends are equal
    return FormEffect(
        pressures=np.array(pressures),
        permeability=np.array(permeability).T,
        height=float(np.ptp(form.heights)),
        radii=radii,
        longest=longest,
        loads=loads,
    )


def _permeability(
    surface: Surface,
    modulus: float | Bodies,
    law: ContactLaw,
    pressure: float,
    boundary: tuple[str, str],
) -> float:
    """Compute the mean permeability of the patches of a surface under a pressure [m³]; NaN if a solver fails."""
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
