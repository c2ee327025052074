"""Pieces under a fluid that acts: at each of its pressures they lie as dry ones do under the load that it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base import Array
from .scene import Scene

#: Fluid pressures at which the permeability of pieces is known that the fluid presses apart. Measured against 129:
#: leakage within 1.1e-3 with p_in up to .3 of the lowest load, within 9e-3 where they are equal.
FLUID_PRESSURES = 9


@dataclass(frozen=True, eq=False)
class TileFluid:
    """Pressures of the fluid at which permeabilities of pieces are wanted.

    pressures : [Pa]. piecewise : see `flow.PermeabilityTable`. relief : what the fluid takes off the pressure of a
    piece at each of them, or one for all [Pa].
    """

    pressures: tuple[float, ...]
    piecewise: bool
    relief: Array

    @classmethod
    def of(cls, scene: Scene) -> TileFluid:
        """The pressures of a scene: those of the law of its fluid, and several where the fluid acts."""
        drop, fluid = scene.flow.drop, scene.acting_fluid
        pressures, piecewise = tuple(drop.pressures), False
        several = drop.law.depends_on_pressure or getattr(scene.layout, "inlet_pressures", {})
        if fluid is None:
            return cls(pressures, piecewise, np.zeros(1))
        if fluid.inlet != fluid.outlet and not several:
            # ln k is nearly straight in the cube root of the pressure that the fluid leaves to the pieces
            full = max(
                min((p for p in scene.steps.pressures if p > 0), default=0.0),
                fluid.inlet,
                fluid.outlet,
            )
            first, last = (float(np.cbrt(full - p)) for p in (fluid.outlet, fluid.inlet))
            between = full - np.linspace(first, last, FLUID_PRESSURES)[1:-1] ** 3
            pressures, piecewise = (fluid.outlet, *between.tolist(), fluid.inlet), True
        # with several inlets the mean stands for every place
        relief = fluid.relief(pressures if len(pressures) > 1 else [fluid.mean])
        return cls(pressures, piecewise, relief)

    def effective(self, paths: Array) -> Array:
        """Pressures that are left along paths (steps, paths), of each fluid pressure after the other [Pa]."""
        left = np.maximum(paths[None] - self.relief[:, None, None], 0.0)
        return np.concatenate(list(left), axis=1)

    def own(self, k: Array) -> Array:
        """Of permeabilities (pressures, …, steps, reliefs × paths, pieces) those at the relief of each fluid pressure.

        Without slip one permeability is that of all fluid pressures.
        """
        if self.relief.size == 1:
            return k
        split = k.reshape(*k.shape[:3], self.relief.size, -1, k.shape[-1])
        own = np.arange(self.relief.size) if len(k) > 1 else np.zeros(self.relief.size, np.int64)
        return np.array([split[n, :, :, m] for m, n in enumerate(own)])
