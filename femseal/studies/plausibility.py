"""Warnings of what is implausible in a scene but may be meant, before a run and with every result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isfinite
from typing import Any

from ..base.quantities import to_text
from ..fluids import IdealGas, leak_basis
from ..real_gas import ideal_gas_error
from .scene import Scene

#: Young's moduli of metals, and of hard coatings, lie between these [Pa]; contact moduli between half of the lower one
#: and a fifth more than the higher one.
YOUNG_LIMITS = (5e9, 1.2e12)
#: Fraction of the hardness from which on the nominal pressure flattens most of the face, where hardness is no constant.
_FLATTENING_FRACTION = 0.5
#: Largest rms slope for which a face is near to a half-space.
_STEEP = 1.0
#: Pressure above which a gas is noticeably not ideal [Pa].
_IDEAL_UP_TO = 20e5


def scene_warnings(scene: Scene) -> tuple[str, ...]:
    """One sentence for each implausible number of a scene."""
    return (*_modulus_warnings(scene), *_pressure_warnings(scene), *_surface_warnings(scene))


def moduli_warnings(young: Iterable[tuple[str, float]]) -> Iterator[str]:
    """One sentence for each Young's modulus [Pa], given with its name, that is not that of a metal."""
    low, high = YOUNG_LIMITS
    for name, value in young:
        if not low <= value <= high:
            usual = f"{to_text(low, 'Pa')} to {to_text(high, 'Pa')}"
            yield f"{name} {to_text(value, 'Pa')} is not that of a metal ({usual}): is its unit right?"


def _modulus_warnings(scene: Scene) -> Iterator[str]:
    """A contact modulus that is not that of metals."""
    low, high = 0.5 * YOUNG_LIMITS[0], 1.2 * YOUNG_LIMITS[1]
    if not low <= scene.modulus <= high:
        usual = f"{to_text(low, 'Pa')} to {to_text(high, 'Pa')}"
        yield f"the contact modulus {to_text(scene.modulus, 'Pa')} is not that of metals ({usual}): is its unit right?"


def _pressure_warnings(scene: Scene) -> Iterator[str]:
    """Loads that the fluid carries alone, a gas into a vacuum, loads near the hardness."""
    steps, fluid = scene.steps, scene.acting_fluid
    parted = [step for step in steps if fluid is not None and step.pressure > 0 and fluid.parts(step.pressure)]
    if fluid is not None and parted:
        yield (
            f"of {to_text(parted[0].pressure, 'Pa')}, the load at {parted[0].name}"
            f"{f' and {len(parted) - 1} more steps' if len(parted) > 1 else ''}, the fluid carries all: the faces part "
            f"below about {to_text(fluid.carried, 'Pa', 3)}, and the seal is open"
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


def gas_warnings(key: str, fluid: Any, inlet: float, outlet: float) -> Iterator[str]:
    """An ideal gas, that the case gives by a key, at a pressure at which none is, with the error of its leakage."""
    if not isinstance(fluid, IdealGas) or inlet <= _IDEAL_UP_TO:
        return
    error = "an error that is not known for this gas"
    if (found := ideal_gas_error(fluid, inlet, outlet)) is not None:
        name, value, how = found
        error = f"{1 + value:.3g} times the leakage that {name} has by {how}"
    yield (
        f"{key} is an ideal gas from {to_text(inlet, 'Pa')}, above {to_text(_IDEAL_UP_TO, 'Pa')}, with {error}: "
        "kind = 'real-gas' with its name takes density and viscosity as they are (pip install 'femseal[fluids]')"
    )


def _surface_warnings(scene: Scene) -> Iterator[str]:
    """Slopes that are too steep for a half-space."""
    slope = scene.surface.rms_slope
    if slope > _STEEP:
        yield (
            f"the rms slope of the face is {slope:.2g}, and a half-space is for slopes well below 1: check the units "
            "of heights and pixel, or take a longer surface.shortest_wave"
        )
