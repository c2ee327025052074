"""What is to be doubted of a face under its loads: implausible numbers, flow that the model does not hold, and form.

The first answer is contact fraction and leakage from the spectrum of a face alone, by Persson's theory: nothing is
solved. It stands beside a run, and beside a case, to forecast it.

Of the form in a measured patch it is the leakage with it, without its curvature, and without its longest waves. Contact
and flow are solved on 128 points a side, where both are resolved. Under the loads of the face its coarser version may
be sealed, as it has less slope: then under loads that are less by as much.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, log, nan, pi, sqrt
from typing import Any

import numpy as np

from ..analytic import CLOSING_AREA, critical_junction
from ..base import Array, NotConverged, Pair, counted, to_text
from ..contact import HalfSpace, solve_contact
from ..contact.law import ContactLaw
from ..flow import cell_permeability
from ..fluids import Fluid, IdealGas, leak_basis
from ..materials import LINE_CONTACT_YIELD, YOUNG_LIMITS
from ..named_fluids import ideal_gas_error, is_nearly_ideal
from ..topography import Surface, Topography
from ..topography.defects import fit_form
from .scene import Scene

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
#: Fraction of the hardness from which on the nominal pressure flattens most of the face, where hardness is no constant.
_FLATTENING_FRACTION = 0.5
#: Largest rms slope for which a face is near to a half-space.
_STEEP = 1.0
#: Pressure [Pa] above which every gas is noticeably not ideal, and one up to which gases do not condense at 20 °C.
_IDEAL_UP_TO, _NO_GAS_CONDENSES_UP_TO = 20e5, 2e5
#: Relative error of the leakage of an ideal gas at lower pressures that is not worth a warning.
_IDEAL_WITHIN = 0.05
#: Groups of waves into which a spectrum is put together, and the part of the mean square slope that is rounding.
_GROUPS, _ROUNDING = 64, 1e-12
#: Measured on 100 scenes of `tests/benchmarks/first_answer.py`: up to a contact fraction half of the answers are off by
#: up to the first factor, 95 % by up to the second; above it single constrictions decide, and no factor holds.
LIGHT, OFF_BY = 0.3, (2.2, 10.0)
#: Times the second factor by which a run may be off before it is not plausible.
_BEYOND = 10.0
#: Part of the variance of the heights in a smooth profile along one axis from which on that profile decides where the
#: surface touches. Self-affine surfaces without roll-off have up to 0.64, of 120; from 0.7 on, a crown makes the quick
#: estimate wrong by factors of 10 to 1000, at 0.6 by 3 to 12. The degree of the polynomial that is the profile.
_FORM_DECIDES, _FORM_DEGREE = 0.7, 4
#: Flux of a choked nozzle over √(p ρ) at its inlet, √κ (2/(κ + 1))^((κ + 1)/2(κ − 1)) for κ = 1.4; 0.67 for κ = 1.3 and
#: 0.73 for 5/3.
_CHOKED = 0.685


@dataclass(frozen=True, eq=False)
class FormEffect:
    """Leakage of a patch without its tilt, by what else counts as its form.

    pressures : nominal ones at which it was solved (loads,) [Pa]. loads : the lowest and the highest as text.
    permeability : of the patch, without its curvature, and without waves longer than `longest` [m] (3, loads) [m³].
    height : of the curvature, highest to lowest point [m]. radii : of curvature along x1 and x2 [m]; both of the
    shortest of several patches.
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
    patch: Surface,
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
    pixel = max(patch.shortest_patch.size) / _POINTS * sqrt(len(patch.patches))
    n1, n2 = (max(_FEWEST, round(side / pixel)) for side in patch.size)
    few = patch.resample((min(n1, patch.shape[0]), min(n2, patch.shape[1])))
    place = few.shortest_patch
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
    face: Surface, modulus: float, law: ContactLaw, pressure: float, boundary: tuple[str, str]
) -> float:
    """Permeability of the places of a face side by side [m³]; NaN where it is not found."""
    found = []
    for place in face.patches:
        half_space = HalfSpace(place.shape, place.spacing, modulus, boundary)
        try:
            contact = solve_contact(
                place.gap(), half_space, pressure=pressure, hardness=law, rtol=_CONTACT_RTOL
            )
            flow = cell_permeability(contact.gap, place.spacing, sides="periodic", rtol=_FLOW_RTOL)
        except NotConverged:
            return nan
        found.append(flow.value)
    return float(np.average(found, weights=[place.shape[1] for place in face.patches]))


def result_warnings(
    scene: Scene,
    leakage: Array,
    mean_gap: Array,
    *,
    unit_leakage: float | None = None,
    is_pressed_evenly: bool = True,
) -> tuple[str, ...]:
    """Check a scene and its solution, and return a sentence for everything that is not plausible.

    Parameters
    ----------
    scene : what was solved.
    leakage : array (steps,) of the leakage per length of seal [m²/s], NaN where it is unknown.
    mean_gap : array (steps,) of the mean gap that the fluid passes [m], NaN where it is unknown.
    unit_leakage : leakage per length of the seal if its permeability were 1 m³ everywhere [1/(m s)]; that of the
        surface itself unless given.
    is_pressed_evenly : whether the nominal pressures act everywhere on the seal. Otherwise the spectrum of the
        surface does not tell what the leakage may be.
    """
    texts = [*scene_warnings(scene)]
    estimate = of_scene(scene, unit_leakage) if is_pressed_evenly else None
    if estimate is not None:
        texts += estimate.doubts(leakage, [step.name for step in scene.steps])
    texts += flow_warnings(scene, leakage, mean_gap)
    return tuple(texts)


def line_contact_warnings(scene: Scene, row_pressure: Array) -> tuple[str, ...]:
    """Warn where the form of a seal presses so hard that the body below a line contact yields.

    row_pressure : array (steps, rows) of the mean contact pressure of rows [Pa].
    """
    highest = float(row_pressure.max())
    limit = LINE_CONTACT_YIELD * scene.law.mean_hardness
    if highest <= limit:
        return ()
    return (
        "The band in contact is broader, and its pressure lower, than computed: the form presses with up to "
        f"{to_text(highest, 'Pa', 3)}, and the body below a line contact yields from {to_text(limit, 'Pa', 3)} on "
        "(1.79 times its yield stress), which the model does not follow",
    )


def scene_warnings(scene: Scene) -> tuple[str, ...]:
    """One sentence for each implausible number of a scene."""
    return tuple(_implausible(scene))


def _implausible(scene: Scene) -> Iterator[str]:
    """A modulus not of metals, loads that the fluid carries or near the hardness, a gas into a vacuum, steep slopes."""
    low, high = 0.5 * YOUNG_LIMITS[0], 1.2 * YOUNG_LIMITS[1]
    if not low <= scene.modulus <= high:
        usual = f"{to_text(low, 'Pa')} to {to_text(high, 'Pa')}"
        yield f"the contact modulus {to_text(scene.modulus, 'Pa')} is not that of metals ({usual}): is its unit right?"
    steps, fluid = scene.steps, scene.acting_fluid
    parted = [steps[s] for s, _ in scene.parted_steps if steps[s].pressure > 0]
    if fluid is not None and parted:
        more = f" and {counted(len(parted) - 1, 'more step')}" if len(parted) > 1 else ""
        yield (
            f"of {to_text(parted[0].pressure, 'Pa')}, the load at {parted[0].name}"
            f"{more}, the fluid carries all: the faces part "
            f"below about {to_text(fluid.carried, 'Pa', 3)}, and the seal is open unless its contact holds the fluid "
            "back"
        )
    if leak_basis(scene.fluid, 1.0).is_gas and scene.outlet_pressure == 0:
        yield (
            "fluid.outlet_pressure 0 Pa of a gas is absolute, a vacuum: into the surroundings it is 101.3 kPa, and "
            "gauge pressures are written as '10 bar(g)' in a case"
        )
    yield from gas_warnings("fluid", scene.fluid, scene.inlet_pressure, scene.outlet_pressure)
    highest = max(step.pressure for step in steps)
    hardness = scene.law.mean_hardness
    if isfinite(hardness) and highest > _FLATTENING_FRACTION * hardness:
        yield (
            f"the nominal pressure of {to_text(highest, 'Pa')} is {highest / hardness:.0%} of the hardness "
            f"{to_text(hardness, 'Pa')}: most of the face is plastic then, for which the model is not made"
        )
    slope = scene.surface.rms_slope
    if slope > _STEEP:
        yield (
            f"the rms slope of the face is {slope:.2g}, and a half-space is for slopes well below 1: check the units "
            "of heights and pixel, or take a longer surface.shortest_wave"
        )


def gas_warnings(key: str, fluid: Any, inlet: float, outlet: float) -> Iterator[str]:
    """Warn of an ideal gas, which the case gives by a key, at pressures at which the real one is not ideal.

    Gases of the table are looked at from 20 bar on, all others from 2 bar on, as many of them condense.
    """
    if not isinstance(fluid, IdealGas):
        return
    is_high = inlet > _IDEAL_UP_TO
    if not is_high and (is_nearly_ideal(fluid) or inlet <= _NO_GAS_CONDENSES_UP_TO):
        return
    error = ideal_gas_error(fluid, inlet, outlet)
    ends = f"from {to_text(inlet, 'Pa')} to {to_text(outlet, 'Pa')}"
    if not isfinite(error.ratio):
        if is_high or error.name:
            yield f"the leakage of the ideal gas in {key} {ends} has an unknown error: {error.reason}"
    elif is_high or abs(error.ratio - 1) > _IDEAL_WITHIN:
        yield (
            f"the ideal gas in {key} leaks {error.ratio:.3g} times as much {ends} as {error.name}, which it seems to "
            f"be, does by CoolProp: kind = 'real-gas' with name = '{error.name}' takes density and viscosity as they "
            "are"
        )


@dataclass(frozen=True, eq=False)
class FirstAnswer:
    """What the spectrum of a face says at some loads, NaN at those that nothing is known of.

    area : contact fraction. gap, mean_gap : of the critical junction, 0 of a sealed face, and on the mean [m].
    leakage : of the seal per length [m²/s]. All (loads,).
    """

    area: Array
    gap: Array
    mean_gap: Array
    leakage: Array

    @property
    def permeability(self) -> Array:
        """Of the face [m³]."""
        return self.gap**3 / 12

    def doubts(self, leakage: Array, names: Sequence[str]) -> list[str]:
        """A warning of the computed leakage [m²/s] that is farthest off, where that is implausible.

        names : of the loads. Nothing is said near closing, where few constrictions decide.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.abs(leakage / self.leakage)
            off = np.where(
                (ratio > 0) & (ratio < inf) & (self.area < LIGHT), np.abs(np.log(ratio)), 0.0
            )
        worst = int(off.argmax())
        if off[worst] <= np.log(_BEYOND * OFF_BY[1]):
            return []
        return [
            f"at {names[worst]} the leakage is {ratio[worst]:.2g} times what the spectrum of the face makes plausible, "
            f"which is right within {OFF_BY[1]:g} times in 95 % of the cases: are the units of heights, pixel, loads "
            "and modulus right?"
        ]

    def __str__(self) -> str:
        found = f"contact {ends_text(100 * self.area)} %, narrowest passage {ends_text(1e6 * self.gap)} µm"
        if np.isfinite(self.leakage).any():
            found += f", leakage {ends_text(self.leakage)} m²/s per length (0: sealed)"
        return (
            f"{found}; leakage by the spectrum alone is right within {OFF_BY[0]:g} times in half of the cases and "
            f"{OFF_BY[1]:g} in 95 % up to {100 * LIGHT:g} % of contact, and unknown beyond"
        )


def first_answer(
    face: Surface, modulus: float, hardness: float, pressures: Sequence[float] | Array
) -> FirstAnswer:
    """Contact fraction and passages of a face without undefined points, see `analytic.critical_junction`.

    modulus, hardness, pressures : E*, H (inf: elastic) and nominal pressures that the contact carries [Pa]. Grooves
    along the seal close at less contact than isotropic roughness and those along the leakage at more: by slopes s
    along x1 and x2 at 2s₂/(s₁ + s₂) times as much. Of several places it is the mean.
    """
    widths = [place.shape[1] for place in face.patches]
    found = np.full((len(widths), len(pressures), 3), nan)
    for own, place in zip(found, face.patches, strict=True):
        waves, powers = _spectrum(place)
        slopes = place.rms_slopes
        closing = CLOSING_AREA * 2 * slopes[1] / sum(slopes) if waves.size else nan
        for n, p in enumerate(pressures):
            if p > 0 and waves.size:
                own[n] = critical_junction(
                    p, modulus, waves, powers, hardness=hardness, closing=closing
                )
    area, _, mean = np.average(found, axis=0, weights=widths).T
    gap = np.cbrt(np.average(found[..., 1] ** 3, axis=0, weights=widths))
    return FirstAnswer(area, gap, mean, np.full(len(pressures), nan))


def of_scene(scene: Scene, unit_leakage: float | None = None) -> FirstAnswer | None:
    """Estimate contact and leakage at the load steps of a scene, all of whose surface is pressed evenly.

    unit_leakage : leakage per length of the seal if its permeability were 1 m³ everywhere [1/(m s)]; that of the
    surface itself unless given.

    Returns None where the spectrum does not tell: of spirals, of surfaces whose form decides where they touch, and
    where contact is unknown at all loads.
    """
    if scene.flow.spiral is not None or any(map(_has_form, scene.surface.patches)):
        return None
    fluid, steps = scene.acting_fluid, scene.steps
    carried = fluid.carried if fluid is not None and fluid.nominal == "total" else 0.0
    pressures = np.where(steps.on_loading, steps.pressures - carried, nan)
    found = first_answer(scene.surface, scene.modulus, scene.law.mean_hardness, pressures)
    if np.isnan(found.area).all():
        return None
    if unit_leakage is None:
        unit_leakage = scene.unit_leakage
    factors = [scene.flow.drop.mean_factor_of(gap) for gap in found.gap]
    return replace(found, leakage=unit_leakage * found.permeability * factors)


def _has_form(patch: Topography) -> bool:
    """Tell whether a smooth profile along one axis has most of the variance of the heights, as of a crowned seat."""
    heights = patch.heights - patch.heights.mean()
    variance = heights.var()
    for axis in (0, 1):
        profile = heights.mean(axis=1 - axis)
        if profile.size <= _FORM_DEGREE:
            continue
        x = np.linspace(-1.0, 1.0, profile.size)
        form = np.polyval(np.polyfit(x, profile, _FORM_DEGREE), x)
        if form.var() > _FORM_DECIDES * variance:
            return True
    return False


def _spectrum(place: Topography) -> tuple[Array, Array]:
    """Wavenumbers [rad/m] and mean square heights [m²] of groups of waves, with the rms slope of the face."""
    q, density = place.radial_psd()
    first = np.unique(np.geomspace(1, q.size, _GROUPS).astype(int)) - 1
    power, slope2 = (np.add.reduceat(density * q**n, first) for n in (1, 3))
    kept = slope2 > _ROUNDING * slope2.sum()
    power, slope2 = power[kept], slope2[kept]
    return np.sqrt(slope2 / power), power * place.rms_slope**2 / slope2.sum()


def choked_flux(fluid: Fluid, pressure: float) -> float:
    """Mass that a nozzle lets through at most, from an inlet pressure [Pa] of a gas [kg/(m² s)]; inf of a liquid.

    √(pρ) times a number of the ratio κ of specific heats alone, which is that of air.
    """
    basis = leak_basis(fluid, 1.0)
    if basis.pressure is None:
        return np.inf
    real = getattr(fluid, "density_at", None)
    density = float(real(pressure)) if real else basis.density * pressure / basis.pressure
    return _CHOKED * float(np.sqrt(pressure * density))


def flow_warnings(scene: Scene, leakage: Array, gaps: Array) -> Iterator[str]:
    """A sentence for the step where a gas passes the choked flux most, and one where inertia counts most.

    leakage : per length at every step (steps,) [m²/s]. gaps : mean gaps (steps,) [m], through whose section it passes.
    NaN where one is unknown. Reynolds number ρuh/η = rate per length over η, times gap over wave, as the wave of the
    rms height and slope, 2πSq/h′.
    """
    fluid = scene.fluid
    surface = scene.surface
    pressure = max(scene.inlet_pressure, scene.outlet_pressure)
    viscosity_at = getattr(fluid, "viscosity_at", None)
    viscosity = float(
        viscosity_at(pressure) if viscosity_at else getattr(fluid, "viscosity", np.nan)
    )
    mass = np.abs(leakage) * fluid.reference_density
    wave = 2 * pi * surface.rms_height / max(surface.rms_slope, 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        choked = np.nan_to_num(mass / (choked_flux(fluid, pressure) * gaps), posinf=0.0)
        reynolds = np.nan_to_num(mass / viscosity * gaps / wave)
    fastest, n = int(choked.argmax()), int(reynolds.argmax())
    names = [step.name for step in scene.steps]
    if choked[fastest] > 1:
        rate, times, gap = mass[fastest], choked[fastest], to_text(gaps[fastest], "m", 2)
        yield (
            f"at {names[fastest]} {rate:.2g} kg/s per metre of the gas leak, {times:.2g} times what a choked nozzle as "
            f"narrow as the mean gap, {gap}, lets through: it leaks no more than {rate / times:.2g} kg/s per metre, as "
            "the model has no speed of sound"
        )
    if reynolds[n] > 1:
        yield (
            f"at {names[n]} the Reynolds number of the mean gap, {mass[n] / viscosity:.2g}, times gap over wave, "
            f"{gaps[n] / wave:.2g}, is {reynolds[n]:.2g}: above 1 inertia slows the flow, and the model has none"
        )
