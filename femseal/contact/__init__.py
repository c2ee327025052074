"""Heights and load in, pressure and gap out: elastic-perfectly plastic contact of a half-space."""

from .cycle import (
    LoadCycle,
    LoadState,
    LoadStep,
    load_cycle,
    load_programme,
    load_states,
    peak_indices,
    solve_with_memory,
)
from .half_space import HalfSpace
from .solver import Contact, solve_contact

__all__ = [
    "Contact",
    "HalfSpace",
    "LoadCycle",
    "LoadState",
    "LoadStep",
    "load_cycle",
    "load_programme",
    "load_states",
    "peak_indices",
    "solve_contact",
    "solve_with_memory",
]
