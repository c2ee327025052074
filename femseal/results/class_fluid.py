"""Find the fluid whose leakage is compared with leakage classes."""

from __future__ import annotations

from dataclasses import fields

from ..fluids import FLUIDS
from ..scene import FluidState
from .results import Results


def class_fluid(results: Results) -> FluidState | None:
    """Return the fluid whose leakage is compared with leakage classes: the test fluid, or else the service fluid.

    Returns
    -------
    FluidState or None
        Fluid and pressures according to the case. If the fluid of the case cannot be read, the fluid of the studies in
        memory is returned, or None if there are no studies in memory.
    """
    try:
        table = results.case.get("output", {}).get("test_fluid") or results.case["fluid"]
        fluid_class = FLUIDS[table["kind"]]
        parameters = {f.name: table[f.name] for f in fields(fluid_class) if f.name in table}
        inlet_pressure = float(table["inlet_pressure"])
        outlet_pressure = float(table["outlet_pressure"])
        return FluidState(fluid_class(**parameters), inlet_pressure, outlet_pressure)
    except (KeyError, TypeError, ValueError, AttributeError):
        return None if results.scene is None else FluidState.of(results.scene)
