"""Find the fluid whose leakage decides on leakage classes: the test fluid if there is one."""

from __future__ import annotations

from dataclasses import fields

from ..fluids import FLUIDS
from ..scene import FluidState
from .results import Results


def class_fluid(results: Results) -> FluidState | None:
    """Read the fluid that decides on leakage classes from the case of the results.

    Returns
    -------
    FluidState or None
        If the fluid of the case cannot be read, the fluid of the scene of the results. None if they have no scene.
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
