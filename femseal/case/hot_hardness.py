"""Warn if the fluid is hot, but a solid has the hardness of a named metal at room temperature."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from math import inf
from typing import Any

from ..base import InputError, to_text
from ..materials import HARDNESS_FACTOR, named_solid
from .quantity_types import unvalidated_value

#: Temperature of the fluid above which the hardness at room temperature is doubtful [K], a choice of this package.
_HOT = 273.15 + 100
#: A stated hardness counts as that of the named metal if their relative difference is at most this large. Cases that
#: are made from drawings state the hardness with three digits.
_ROUNDING = 0.01
#: Keys, other than `hardness`, with which a case states the strength of a solid instead of using that of the metal.
_STRENGTHS = ("yield_stress", "hardness_table")


def hot_hardness_warnings(data: dict[str, Any]) -> Iterator[str]:
    """Warn about solids with the hardness of a named metal at room temperature, although the fluid is hot.

    data : tables of a case before they are completed and validated. Invalid values are ignored.
    """
    temperature = unvalidated_value(data.get("fluid", {}), "temperature", "K", 0.0)
    if temperature <= _HOT:
        return
    solids = {}
    for table_key in ("material", "counter_material"):
        solid = data.get(table_key, {})
        if isinstance(solid, dict):
            solids[table_key] = solid
    softest = min(map(_stated_hardness, solids.values()), default=inf)
    for table_key, solid in solids.items():
        if _stated_hardness(solid) > softest:
            continue  # only the softer body yields
        yield from _warn(solid, table_key, temperature)
        coating = solid.get("coating")
        if isinstance(coating, dict):
            yield from _warn(coating, f"{table_key}.coating", temperature)


def _named_hardness(solid: dict[str, Any]) -> float:
    """Return the hardness of the named metal of a solid [Pa]; inf if the name is missing or unknown."""
    if "name" in solid:
        with suppress(InputError):  # the completion of the case reports the unknown name
            return named_solid(solid["name"]).hardness or inf
    return inf


def _stated_hardness(solid: dict[str, Any]) -> float:
    """Return the hardness of a solid or of its softer coating [Pa], from its keys or its name; inf if it is unknown."""
    hardness = _named_hardness(solid)
    if "yield_stress" in solid:
        hardness = HARDNESS_FACTOR * unvalidated_value(solid, "yield_stress", "Pa", inf)
    hardness = unvalidated_value(solid, "hardness", "Pa", hardness)
    coating = solid.get("coating")
    if isinstance(coating, dict):
        hardness = min(hardness, _stated_hardness(coating))
    return hardness


def _warn(solid: dict[str, Any], table_key: str, temperature: float) -> Iterator[str]:
    """Warn if a solid has the hardness of its named metal at room temperature.

    Parameters
    ----------
    solid : table of the solid or coating.
    table_key : key of the table in the case.
    temperature : temperature of the fluid [K].
    """
    named_hardness = _named_hardness(solid)
    if named_hardness == inf or any(key in solid for key in _STRENGTHS):
        return
    hardness = unvalidated_value(solid, "hardness", "Pa", named_hardness)
    if abs(hardness / named_hardness - 1) > _ROUNDING:
        return
    celsius = f"{temperature - 273.15:.4g} °C"
    yield (
        f"The hardness of {solid['name']} is that at 20 °C, but the fluid is at {celsius}: a hot metal is "
        "softer, so that it seals at a lower load, but is squeezed out earlier and creeps. "
        f"Set {table_key}.hardness to the hardness at this temperature instead of {to_text(hardness, 'Pa', 3)}"
    )
