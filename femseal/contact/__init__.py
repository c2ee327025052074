"""Elastic-plastic contact of a half-space: from heights and load to pressure and gap."""

from .cycle import LoadCycle, LoadState, load_cycle, load_states
from .half_space import HalfSpace
from .law import ContactLaw, LinearHardening, PerfectlyPlastic, contact_law
from .solver import Contact, solve_contact

__all__ = [
    "Contact",
    "ContactLaw",
    "HalfSpace",
    "LinearHardening",
    "LoadCycle",
    "LoadState",
    "PerfectlyPlastic",
    "contact_law",
    "load_cycle",
    "load_states",
    "solve_contact",
]
