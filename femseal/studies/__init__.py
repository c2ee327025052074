"""The chains from a rough surface to leakage over a load cycle, readable top to bottom.

`deterministic` resolves everything on the surface's own grid; `two_scale` cuts it into windows between global nodes;
`stochastic` draws the windows of a seal of any length from a library of real ones. All take a `Scene`.
"""

from .deterministic import DeterministicResult, deterministic
from .face_contact import CONTACTS, chosen_contact
from .sampling_options import DRAWS, PRESSURES, Sampling, check_sampling, chosen_sampler, placed_windows, seal_cells
from .scene import Scene
from .stochastic import StochasticResult, stochastic
from .two_scale import FLOWS, TwoScaleResult, chosen_flow, two_scale

__all__ = [
    "CONTACTS",
    "DRAWS",
    "FLOWS",
    "PRESSURES",
    "DeterministicResult",
    "Sampling",
    "Scene",
    "StochasticResult",
    "TwoScaleResult",
    "check_sampling",
    "chosen_contact",
    "chosen_flow",
    "chosen_sampler",
    "deterministic",
    "placed_windows",
    "seal_cells",
    "stochastic",
    "two_scale",
]
