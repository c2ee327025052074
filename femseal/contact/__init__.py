"""Solve the elastic-plastic contact of a rough half-space: compute contact pressure and gap from heights and load."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .cycle import (
        STATE_FIELDS,
        LoadCycle,
        LoadState,
        contact_at_loads,
        load_cycle,
        load_states,
    )
    from .edge_distance import coating_edge_distance, mean_edge_distance
    from .half_space import HalfSpace
    from .hardness_curves import CoatedLaw, HardnessTable, NixGao, law_of_coating
    from .law import ContactLaw
    from .layered import Bodies, checked_modulus, modulus_of_waves, surface_modulus
    from .linear_laws import LinearHardening, PerfectlyPlastic, contact_law
    from .softer_body import softer_of
    from .solver import Contact, solve_contact
else:
    __getattr__, __dir__ = lazy(__name__)
