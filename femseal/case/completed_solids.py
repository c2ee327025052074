"""Complete the tables of solids: properties of named solids, and the file of a hardness table."""

import re
from os.path import isfile
from pathlib import Path

from ..base import InputError, counted, shortened
from ..base.text_columns import columns_of, read_columns
from ..materials import named_solid
from .faults import errors_in_table
from .odd_properties import odd_properties
from .quantity_types import Amount, RawTable

#: Units of the properties of a named solid.
_SOLID_UNITS = {"young": "Pa", "poisson": "", "yield_stress": "Pa", "hardness": "Pa"}
#: Heading of a column in a file with the hardness at several depths: name and unit.
_COLUMN = re.compile(r"(depth|hardness)\s*[\[(]\s*(.+?)\s*[\])]$")
HARDNESS_COLUMNS = (
    "two columns with commas, the first line 'depth [um], hardness [GPa]' or with other units"
)


def complete_solid(solid: RawTable, table_key: str, folder: Path, warnings: list[str]) -> RawTable:
    """Return the table of a solid. Add the properties of a named solid, and read the file of a hardness table.

    Parameters
    ----------
    solid : table of the solid.
    table_key : key of the table in the case.
    folder : folder to which the path of a hardness table is relative.
    warnings : list of warnings. A warning is added for each value in the table that differs considerably from the
        property of the named solid.
    """
    table = dict(solid)
    path = table.get("hardness_table")
    coating = table.get("coating")
    if isinstance(coating, dict):
        coating_key = f"{table_key}.coating"
        table["coating"] = complete_solid(coating, coating_key, folder, warnings)
    if isinstance(path, str):
        table["hardness_table"] = _hardness_rows(folder / path, f"{table_key}.hardness_table")
    if "name" not in table:
        return table
    with errors_in_table(table_key):
        named = named_solid(table["name"])
    assert named.yield_stress is not None
    assert named.hardness is not None
    values = {
        "young": named.young,
        "poisson": named.poisson,
        "yield_stress": named.yield_stress,
        "hardness": named.hardness,
    }
    properties = {name: Amount(value, _SOLID_UNITS[name]) for name, value in values.items()}
    warnings += odd_properties(table, properties, table_key)
    # only one property states the strength: the yield stress if the hardness is derived from it, otherwise the hardness
    has_hardness = "hardness" in table or "hardness_table" in table
    has_ratio_only = "hardness_over_yield" in table and not has_hardness
    follows_from_yield = "yield_stress" in table or has_ratio_only
    del properties["hardness" if follows_from_yield else "yield_stress"]
    if "hardness_table" in table:
        properties.pop("hardness", None)
    return properties | table


def _hardness_rows(path: Path, key: str) -> list[list[str]]:
    """Read a file with the hardness at several depths.

    Parameters
    ----------
    path : path of the file.
    key : key of the case that names the file, for error messages.

    Returns
    -------
    Rows with two entries, depth and hardness, each as text with a unit.

    Raises
    ------
    InputError : the file does not exist, has other columns, or has fewer than two rows.
    """
    name = f"'{shortened(path.name)}'"
    if not isfile(path):
        raise InputError(key, name, "a file that exists, or rows such as ['0.1 um', '2 GPa']")
    try:
        matches = [_COLUMN.match(heading) for heading in columns_of(path)]
        by_name = {match[1]: match for match in matches if match}
        # each column is a match of its heading, with the groups [1] name and [2] unit; [0] is the whole heading
        columns = by_name["depth"], by_name["hardness"]
        numbers = read_columns(path, tuple(column[0] for column in columns))
    except (InputError, KeyError):
        raise InputError(key, name, HARDNESS_COLUMNS) from None
    if len(numbers) < 2:
        given = f"{name} with {counted(len(numbers), 'row')} of numbers"
        raise InputError(key, given, f"{HARDNESS_COLUMNS}, and at least two rows")
    depth_unit, hardness_unit = (column[2] for column in columns)
    return [
        [f"{depth!r} {depth_unit}", f"{hardness!r} {hardness_unit}"]
        for depth, hardness in numbers.tolist()
    ]
