"""Choose the fluid pressures at which the cells of a seal are solved, and compute the contact pressure at each."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..base import Array
from ..scene import Scene

#: Number of fluid pressures at which cells are solved if the fluid pressure acts on the surfaces. Compared with 129
#: fluid pressures, the leakage is within 1.1e-3 for inlet pressures up to 0.3 of the lowest load, and within 9e-3 if
#: the inlet pressure is equal to the lowest load.
FLUID_PRESSURES = 9


@dataclass(frozen=True, eq=False)
class TileFluid:
    """Fluid pressures at which the permeabilities of cells are needed.

    Parameters
    ----------
    pressures : tuple of float, Pa
        Fluid pressures.
    piecewise : bool
        How permeabilities are interpolated between the fluid pressures, see `flow.PermeabilityTable`.
    relief : array (pressures,) or (1,), Pa
        Relief: reduction of the contact pressure of a cell by the fluid. The array contains one relief for each fluid
        pressure, or a single relief that is valid at all fluid pressures.
    """

    pressures: tuple[float, ...]
    piecewise: bool = False
    relief: Array = field(default_factory=partial(np.zeros, 1))

    @classmethod
    def of(cls, scene: Scene) -> TileFluid:
        """Choose the fluid pressures at which the cells of a scene are computed.

        The fluid pressures are chosen as follows:

        - If the flow law depends on the fluid pressure, the fluid pressures of the flow law are used.
        - If the fluid pressure acts on the surfaces and falls from inlet to outlet, `FLUID_PRESSURES` values between
          the outlet and the inlet pressure are used.
        - In all other cases, a single fluid pressure is sufficient.
        """
        drop, fluid = scene.flow.drop, scene.acting_fluid
        pressures = tuple(drop.pressures)
        piecewise = False
        if fluid is None:
            return cls(pressures)
        if fluid.inlet != fluid.outlet and not drop.law.depends_on_pressure:
            # ln k is a nearly linear function of the cube root of the contact pressure, which is the nominal pressure
            # minus the fluid pressure. The fluid pressures are chosen so that the cube roots of the contact pressures
            # are evenly spaced at the lowest load.
            lowest_load = min((p for p in scene.steps.pressures if p > 0), default=0.0)
            nominal = max(lowest_load, fluid.inlet, fluid.outlet)
            root_at_outlet = float(np.cbrt(nominal - fluid.outlet))
            root_at_inlet = float(np.cbrt(nominal - fluid.inlet))
            roots = np.linspace(root_at_outlet, root_at_inlet, FLUID_PRESSURES)
            between = nominal - roots[1:-1] ** 3
            pressures = (fluid.outlet, *between.tolist(), fluid.inlet)
            piecewise = True
        relief = fluid.relief(pressures if len(pressures) > 1 else [fluid.absolute_mean])
        return cls(pressures, piecewise, relief)

    def effective_pressures(self, paths: Array) -> Array:
        """Compute the contact pressures of all paths under all reliefs: nominal pressure minus relief, but at least 0.

        Parameters
        ----------
        paths : array (steps, paths), Pa
            Nominal pressures of the pressure paths.

        Returns
        -------
        array (steps, reliefs × paths), Pa
            Contact pressures. The second axis contains first all paths under the first relief, then all paths under the
            second relief, and so on.
        """
        reliefs = self.relief[:, None, None]
        contact_pressures = np.maximum(paths[None] - reliefs, 0.0)  # (relief, step, path)
        return np.concatenate(list(contact_pressures), axis=1)

    def select_matching_reliefs(self, k: Array) -> Array:
        """Select, for each fluid pressure, the permeabilities computed with the relief by that fluid pressure.

        Parameters
        ----------
        k : array (pressures, 2, steps, reliefs × paths, cells), m³
            Permeabilities on the paths that `effective_pressures` returns, for all combinations of fluid pressure and
            relief. The axis of the fluid pressures has length 1 if the flow law does not depend on the fluid pressure.

        Returns
        -------
        array (pressures, 2, steps, paths, cells), m³
            Permeabilities on the nominal pressure paths, each with the relief for the fluid pressure on the first axis.
        """
        if self.relief.size == 1:
            return k
        # (fluid pressure, axis, step, relief, path, cell)
        by_relief = k.reshape(*k.shape[:3], self.relief.size, -1, k.shape[-1])
        # fluid pressure n causes relief n, so that both indices are n, unless the first axis has length 1
        depends_on_pressure = len(k) > 1
        selected = []
        for n_relief in range(self.relief.size):
            n_pressure = n_relief if depends_on_pressure else 0
            selected.append(by_relief[n_pressure, :, :, n_relief])
        return np.array(selected)
