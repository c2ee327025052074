"""Describe a fluid whose pressure acts on the surfaces.

The fluid pressure p_f is measured relative to the pressure of the surroundings, which acts on the outside of the
bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array, Shape, to_text
from ..face.cell_flow import FlowSettings
from ..flow.pressure_drop import pressure_between
from ..fluids import Fluid

#: The fluid pressure is ignored if its mean is below this fraction of the nominal pressure, because such a pressure
#: changes the leakage by less than 0.5 %.
LEAST_FRACTION = 1e-4
#: Number of points at which a pressure profile is averaged.
_POINTS = 201


@dataclass(frozen=True)
class FluidPressure:
    """Describe a fluid whose pressure acts on the surfaces.

    Attributes
    ----------
    fluid : Fluid
        Fluid with its viscosity and density.
    inlet, outlet : float
        Fluid pressures at inlet and outlet [Pa].
    carrier : "total" or "contact"
        Whether the nominal pressure is carried by contact and fluid together, or by the contact alone.
    settings : FlowSettings
        Settings of the flow solver.
    surroundings : float or None
        Pressure around the seal [Pa], see `Scene`.
    trapped : bool
        Whether liquid in closed pockets keeps its volume.
    """

    fluid: Fluid
    inlet: float
    outlet: float
    carrier: str
    settings: FlowSettings
    surroundings: float | None = None
    trapped: bool = False

    @property
    def _ambient(self) -> float:
        """Pressure of the surroundings [Pa]; an absolute pressure if the fluid is a gas."""
        if self.surroundings is None:
            return float(getattr(self.fluid, "outlet_pressure", 0.0))
        return self.surroundings

    def above_surroundings(self, fraction: Any) -> Array:
        """Convert a pressure potential, scaled to 1 at the inlet and 0 at the outlet, to a fluid pressure [Pa].

        The fluid pressure is relative to the pressure of the surroundings.
        """
        pressure = pressure_between(self.fluid, self.inlet, self.outlet, fraction)
        return np.asarray(pressure) - self._ambient

    @property
    def mean_if_separated(self) -> float:
        """Mean fluid pressure between separated surfaces [Pa], relative to the surroundings.

        The gap between separated surfaces is assumed to be uniform, so that the pressure potential is linear.
        """
        return float(self.above_surroundings((np.arange(_POINTS) + 0.5) / _POINTS).mean())

    @property
    def absolute_mean(self) -> float:
        """Mean absolute fluid pressure for a pressure potential that falls linearly from inlet to outlet [Pa]."""
        return self.mean_if_separated + self._ambient

    def relief(self, pressure: Any) -> Array:
        """Compute by how much the fluid pressure reduces the contact pressure of a cell [Pa].

        The contact of a cell is solved for dry surfaces under the effective pressure p̄ − p_f (Terzaghi's effective
        stress). If the seal is wide compared with the long waves of the surface, the coupled solution of contact and
        flow approaches the effective-pressure solution.

        Parameters
        ----------
        pressure : float or array
            Fluid pressure in the cell [Pa].
        """
        carried_beside_contact = 0.0 if self.carrier == "total" else self.mean_if_separated
        return np.asarray(pressure, dtype=float) - self._ambient - carried_beside_contact

    def separates(self, pressure: float) -> bool:
        """Return whether the fluid between separated surfaces would carry the whole nominal pressure [Pa]."""
        return self.carrier == "total" and self.mean_if_separated >= pressure

    @property
    def largest(self) -> float:
        """Larger absolute value of the fluid pressures at inlet and outlet [Pa]."""
        return max(abs(self.inlet), abs(self.outlet))

    @staticmethod
    def separation_text(carried: float) -> str:
        """Return a text that explains why the surfaces separate: the fluid carries the mean pressure `carried` [Pa]."""
        limit = to_text(carried, "Pa", 3)
        return f"open: the surfaces separate below {limit}, all of which the fluid carries"

    def linear_drop(self, shape: Shape) -> Array:
        """Compute the fluid pressure (n1, n2) [Pa] for a pressure potential that falls linearly along x1.

        The fluid pressure is relative to the pressure of the surroundings.
        """
        n1, n2 = shape
        fraction = 1 - (np.arange(n1) + 0.5) / n1
        return np.repeat(self.above_surroundings(fraction)[:, None], n2, axis=1)
