"""Heights and load in, pressure and gap out: elastic-perfectly plastic contact of a half-space."""

from .cycle import LoadState, load_cycle
from .halfspace import HalfSpace
from .solver import Contact, solve_contact

__all__ = ["Contact", "HalfSpace", "LoadState", "load_cycle", "solve_contact"]
