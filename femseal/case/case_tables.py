"""Former place of `SolidTable`, which is in `solid_table`."""

from .solid_table import SolidTable as SolidTable
