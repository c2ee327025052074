"""Read, generate, describe and condition the heights of seal faces.

The functions of this package are used in the following order:

read_topography (measured) or self_affine, turned (generated) -> Topography
describe_surface -> SurfaceReport
repair (spikes and undefined points) -> combine (two faces) -> condition (form, waves, grid) -> Topography, Conditioning
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .combined import Overlap, combine
    from .conditioning import Conditioning, condition, smooth
    from .continuation import Continuation, continuation_of, continue_spectrum
    from .defects import SPIKES, TooManyUndefined
    from .describe import SurfaceReport, describe_surface
    from .generate import self_affine, turned
    from .grid_choice import (
        MOST_GRID_POINTS,
        check_wave,
        default_points,
        default_wave,
        resolved_wave,
        resolving_shape,
    )
    from .instrument_limits import Instrument
    from .longest_waves import Representative, representative
    from .patches import Patches, Places, Surface
    from .power_spectrum import spectrum
    from .raw import NO_VALUE
    from .read import Look, read_for_a_look, read_measured, read_topography
    from .repairs import Repair, repair, spikes_extreme
    from .seat import BallOnCone, CrownedSeat, FlatSeat, ProfileSeat, RoundedSeat, Seat, TiltedSeat
    from .topography import Topography
else:
    __getattr__, __dir__ = lazy(__name__)
