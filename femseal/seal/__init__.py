"""Shapes of seals, the leakage of the whole seal from the permeability of its parts, and where its pressure drops."""

from .drop_shares import NARROWEST, drop_shares, largest_shares
from .leakage import Leakage, seal_leakage
from .shapes import AnnularSeal, MeshSeal, RectangularSeal

__all__ = [
    "NARROWEST",
    "AnnularSeal",
    "Leakage",
    "MeshSeal",
    "RectangularSeal",
    "drop_shares",
    "largest_shares",
    "seal_leakage",
]
