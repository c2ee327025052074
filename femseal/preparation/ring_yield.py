"""Warn if the load makes the whole softer solid yield, which contact models of rough faces do not include."""

from __future__ import annotations

from collections.abc import Iterator

from ..base import to_text
from ..case.case import Case
from ..case.solid_table import SolidTable
from ..materials import RING_YIELD


def ring_yield_warnings(case: Case, highest_pressure: float) -> Iterator[str]:
    """Warn if the nominal pressure would make an entire ring of the weaker solid yield between flat faces.

    For a coated solid, the yield stress of the body below the coating is used, because the coating is too thin to be
    squeezed out. Cases with a seat are not checked here, because another check applies to line contacts.

    Parameters
    ----------
    case : Case
        The case.
    highest_pressure : float
        Highest nominal pressure of the load cycle [Pa].
    """
    if case.seat.kind != "flat":
        return
    solids = {"material": case.material, "counter_material": case.counter_material}
    yield_stresses = {
        key: table.body_yield_stress for key, table in solids.items() if table is not None
    }
    weaker = min(yield_stresses, key=yield_stresses.__getitem__)
    yield_stress = yield_stresses[weaker]
    limit = RING_YIELD * yield_stress
    if highest_pressure <= limit:
        return
    limit_text = to_text(limit, "Pa", 3)
    if case.load.unit != "Pa":
        load = case.load.highest * limit / highest_pressure
        limit_text = f"{to_text(load, case.load.unit, 3)} ({limit_text})"
    table = solids[weaker]
    assert table is not None
    part = f"[{weaker}]" if table.name is None else f"[{weaker}], {table.name},"
    yield (
        f"The softer part may yield as a whole: a ring of {part} between flat faces is squeezed thinner and wider "
        f"from about {limit_text} on, {RING_YIELD:.3g} times {_yield_stress_text(table)}, and the case loads it up to "
        f"{to_text(highest_pressure, 'Pa', 3)}. Results above that load hold only for a ring in a groove, a ring that "
        "is already hardened, or a thick flange. Otherwise lower the load, widen the contact, or take a harder metal"
    )


def _yield_stress_text(table: SolidTable) -> str:
    """Return the yield stress of a solid as text, and say where the value comes from if the case does not give it."""
    text = f"its yield stress of {to_text(table.body_yield_stress, 'Pa', 3)}"
    if table.yield_stress is not None:
        return text
    if table.name is not None:
        return f"{text} as delivered"
    return f"{text}, which is estimated as its hardness divided by 2.8 and is lower for an annealed metal"
