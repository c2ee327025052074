"""Elastic-perfectly plastic contact of a half-space: from heights and load to pressure and gap."""

from .cycle import LoadCycle, LoadState, load_cycle, load_states, solve_deformed_contact
from .half_space import HalfSpace
from .solver import Contact, solve_contact

__all__ = [
    "Contact",
    "HalfSpace",
    "LoadCycle",
    "LoadState",
    "load_cycle",
    "load_states",
    "solve_contact",
    "solve_deformed_contact",
]
