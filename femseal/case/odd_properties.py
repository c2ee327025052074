"""Warn about properties that differ considerably from those of the named fluid or solid."""

from collections.abc import Iterator

from ..base import to_text
from .quantity_types import Amount, RawTable, unvalidated_value

#: Largest factor by which a property may differ from the property of the named fluid or solid without a warning.
_ODD_RATIO = 2.0


def odd_properties(table: RawTable, properties: dict[str, Amount], table_key: str) -> Iterator[str]:
    """Yield a warning for each value in a table that differs considerably from the property of the named substance.

    Parameters
    ----------
    table : table of the fluid or solid.
    properties : properties of the named fluid or solid.
    table_key : key of the table in the case.
    """
    for name, usual in properties.items():
        value = unvalidated_value(table, name, usual.unit, 0.0)
        if value <= 0 or 1 / _ODD_RATIO <= value / usual <= _ODD_RATIO:
            continue
        ratio = value / usual
        times = f"{ratio:.2g} times" if ratio > 1 else f"{1 / ratio:.2g} times less than"
        unit = usual.unit.replace("*", "·")
        yield (
            f"{table_key}.{name} {to_text(value, unit)} is {times} that of {table['name']}, "
            f"{to_text(usual, unit)}: keep it if it was measured, otherwise omit the key or the name"
        )
