"""A measured map made whole: spikes marked undefined, undefined points filled."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..base.errors import InputError
from .spikes import SPIKES
from .topography import Topography


@dataclass(frozen=True)
class Repair:
    """What was missing in a map, and what was taken for spikes."""

    undefined_share: float = field(metadata={"unit": "", "label": "share of undefined points", "percent": True})
    spikes: int = field(metadata={"unit": "", "label": "points in spikes"})


def repair(topography: Topography, *, spikes: float = SPIKES, max_undefined: float = 0.05) -> tuple[Topography, Repair]:
    """Map without spikes and without undefined points: both filled by the harmonic surface through their rims.

    Parameters
    ----------
    topography : as measured.
    spikes : threshold of `find_spikes` in robust standard deviations; infinite leaves them.
    max_undefined : largest share of points (0 to 1) that may be filled, spikes included.

    Raises
    ------
    InputError : more points to fill; threshold not > 0.
    """
    marked = topography.without_spikes(spikes)
    count = round((marked.undefined_share - topography.undefined_share) * topography.heights.size)
    try:
        filled = marked.fill_undefined(max_undefined)
    except InputError as error:
        if not count or topography.undefined_share > max_undefined:
            raise
        raise InputError(f"{error}; {count} of them are spikes, which spikes=inf leaves alone") from None
    return filled, Repair(topography.undefined_share, count)
