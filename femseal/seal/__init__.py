"""Shapes of seals, leakage from the permeability of their parts, pressure drop, and maps of the contact pressure."""

from ..flow.permeability_table import PermeabilityTable, table_pressures
from .drop_shares import NARROWEST, drop_shares, largest_shares
from .field_file import read_pressure_field
from .leakage import Leakage, seal_leakage
from .pressure_map import AngleTable, MapsAtLoads, PressureField, Profile, Uniform
from .shapes import AnnularSeal, MeshSeal, RectangularSeal

__all__ = [
    "NARROWEST",
    "AngleTable",
    "AnnularSeal",
    "Leakage",
    "MapsAtLoads",
    "MeshSeal",
    "PermeabilityTable",
    "PressureField",
    "Profile",
    "RectangularSeal",
    "Uniform",
    "drop_shares",
    "largest_shares",
    "read_pressure_field",
    "seal_leakage",
    "table_pressures",
]
