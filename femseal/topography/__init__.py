"""Heights of seal faces: read or generated, conditioned, and the map that the solvers take.

read_topography (measured) or self_affine, turned (generated) -> Topography -> describe_surface -> SurfaceReport
repair (spikes, undefined points) -> combine (two faces) -> condition (form, waves, grid) -> Topography, Conditioning
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .combine import Overlap, combine
    from .condition import MOST_POINTS, Conditioning, condition, default_wave, resolved_wave, resolving_shape, smooth
    from .continuation import Continuation, continuation_of, continue_spectrum
    from .describe import SurfaceReport, as_text, describe_surface
    from .generate import self_affine, turned
    from .places import Places
    from .power_law import spectrum
    from .read import read_for_a_look, read_topography
    from .repair import Repair, SpikeEffect, repair, spike_effect
    from .seat import BallOnCone, CrownedSeat, FlatSeat, ProfileSeat, RoundedSeat, Seat, TiltedSeat
    from .spikes import SPIKES
    from .topography import Topography
    from .undefined_points import TooManyUndefined

__all__ = [
    "Seat",
    "TiltedSeat",
    "RoundedSeat",
    "ProfileSeat",
    "FlatSeat",
    "CrownedSeat",
    "BallOnCone",
    "MOST_POINTS",
    "SPIKES",
    "Conditioning",
    "Continuation",
    "Overlap",
    "Places",
    "Repair",
    "SpikeEffect",
    "SurfaceReport",
    "TooManyUndefined",
    "Topography",
    "as_text",
    "combine",
    "condition",
    "continuation_of",
    "continue_spectrum",
    "default_wave",
    "describe_surface",
    "read_for_a_look",
    "read_topography",
    "repair",
    "resolved_wave",
    "resolving_shape",
    "self_affine",
    "smooth",
    "spectrum",
    "spike_effect",
    "turned",
]

load_when_used(__name__)
