"""Shapes of seals, and the leakage of the whole seal from the permeability of its parts."""

from .leakage import Leakage, seal_leakage
from .shapes import AnnularSeal, MeshSeal, RectangularSeal

__all__ = ["AnnularSeal", "Leakage", "MeshSeal", "RectangularSeal", "seal_leakage"]
