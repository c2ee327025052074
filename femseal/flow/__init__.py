"""Gap in, permeability out; permeability in, leakage out: one network of links serves the cell and the seal."""

from .cell import Permeability, cell_permeabilities, cell_permeability, link_conductances, permeability_tensor
from .constriction import Constriction, critical_constriction
from .network import NetworkFlow, solve_network

__all__ = [
    "Constriction",
    "NetworkFlow",
    "Permeability",
    "cell_permeabilities",
    "cell_permeability",
    "critical_constriction",
    "link_conductances",
    "permeability_tensor",
    "solve_network",
]
