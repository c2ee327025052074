"""What the fluid pressure does to the contact, estimated: it carries a part of the load, which the contact is without.

A fluid of one pressure p_f between the faces adds it to the contact pressure everywhere, and does not deform a
half-space further: the faces lie as they do dry under a nominal pressure lower by p_f. Here p_f is the mean over the
breadth of the seal, above the surroundings, for a potential that falls evenly from inlet to outlet.
"""

from __future__ import annotations

import numpy as np

from .scene import Array, Scene

#: Fraction of the contact pressure from which on the pressure at the inlet lifts the faces noticeably.
RELIEF_FRACTION = 0.5
#: Ratio of leakage with and without it above which a warning gives the effect.
_NOTICEABLE = 1.2
_POINTS = 201


def carried_pressure(scene: Scene) -> float:
    """Mean pressure of the fluid above that of the surroundings [Pa], >= 0."""
    around = float(getattr(scene.fluid, "outlet_pressure", 0.0))
    return max(float(scene.pressure_at((np.arange(_POINTS) + 0.5) / _POINTS).mean()) - around, 0.0)


def relieved_leakage(scene: Scene, leakage: Array) -> Array:
    """Leakage at every step if the fluid carries its part of the load, interpolated between the steps (steps,).

    ln of the leakage is straight in the nominal pressure between steps of one branch, a peak being the first of its
    unloading. NaN where less load is left than the lowest step of the branch has.
    """
    steps, carried = scene.steps, carried_pressure(scene)
    found = np.full(len(steps), np.nan)
    for s, step in enumerate(steps):
        branch = [n for n, other in enumerate(steps) if other.unloaded_from == step.unloaded_from]
        if step.unloaded_from is not None:
            branch.append(int(steps.peak_indices[s]))
        pressures = np.array([steps[n].pressure for n in branch])
        order = np.argsort(pressures)
        pressures, values = pressures[order], np.asarray(leakage, dtype=float)[np.array(branch)[order]]
        left = step.pressure - carried
        if not (left >= pressures[0] and np.isfinite(values).all()):
            continue
        upper = min(int(np.searchsorted(pressures, left)), pressures.size - 1)
        lower = max(upper - 1, 0)
        if pressures[upper] == left or values[lower] <= 0 or values[upper] <= 0:
            found[s] = values[upper if pressures[upper] == left else lower]
        else:
            weight = (left - pressures[lower]) / (pressures[upper] - pressures[lower])
            found[s] = values[lower] ** (1 - weight) * values[upper] ** weight
    return found


def relief_warning(scene: Scene, leakage: Array) -> str:
    """A sentence on the largest effect of the fluid pressure on leakage; "" where it is small or unknown."""
    given = np.asarray(leakage, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = relieved_leakage(scene, given) / given
    noticeable = np.flatnonzero(np.isfinite(ratio) & (ratio > _NOTICEABLE))
    if not noticeable.size:
        return ""
    worst = noticeable[int(np.argmax(ratio[noticeable]))]
    return (
        f"the fluid lifts the faces, which is left out: with the part of the load that it carries, leakage at "
        f"{scene.steps[worst].name} would be about {ratio[worst]:.2g} times that given"
    )
