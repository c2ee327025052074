"""Heights of seal faces: read or generated, conditioned, and the map that the solvers take.

read_topography (measured) or self_affine, turned (generated) -> Topography -> describe_surface -> SurfaceReport
repair (spikes, undefined points) -> combine (two faces) -> condition (form, waves, grid) -> Topography, Conditioning
"""

from .combine import Overlap, combine
from .condition import Conditioning, condition
from .describe import SurfaceReport, describe_surface
from .generate import self_affine, turned
from .labelled import as_text
from .read import read_for_a_look, read_topography
from .repairs import Repair, repair
from .spike_effect import SpikeEffect, spike_effect
from .spikes import SPIKES
from .topography import Topography
from .usable import TooManyUndefined

__all__ = [
    "SPIKES",
    "Conditioning",
    "Overlap",
    "Repair",
    "SpikeEffect",
    "SurfaceReport",
    "TooManyUndefined",
    "Topography",
    "as_text",
    "combine",
    "condition",
    "describe_surface",
    "read_for_a_look",
    "read_topography",
    "repair",
    "self_affine",
    "spike_effect",
    "turned",
]
