"""Shapes of seals, the leakage of a whole seal from the permeability of its parts, and its pressure drop."""

from ..flow.permeability_table import PermeabilityTable, table_pressures
from .drop_shares import NARROWEST, drop_shares, largest_shares
from .leakage import Leakage, seal_leakage
from .shapes import AnnularSeal, MeshSeal, RectangularSeal

__all__ = [
    "NARROWEST",
    "AnnularSeal",
    "Leakage",
    "MeshSeal",
    "PermeabilityTable",
    "RectangularSeal",
    "drop_shares",
    "largest_shares",
    "seal_leakage",
    "table_pressures",
]
