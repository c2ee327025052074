"""Gap in, permeability out; permeability in, leakage out: one network of links serves the cell and the seal."""

from .cell import Permeability, cell_permeability, link_conductances, permeability_tensor
from .network import NetworkFlow, solve_network

__all__ = [
    "NetworkFlow",
    "Permeability",
    "cell_permeability",
    "link_conductances",
    "permeability_tensor",
    "solve_network",
]
