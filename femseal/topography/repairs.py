"""Repair of a measured map: spikes are marked undefined, the form is removed, undefined points are filled.

The form is fitted to the defined points alone, before anything is filled: filled points would bend it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .form import Form, fit_form
from .spikes import SPIKES
from .topography import Topography
from .usable import TooManyUndefined


@dataclass(frozen=True, eq=False)
class Repair:
    """Defects found in a map: undefined points, spikes, and the form that was removed.

    removed : heights of the spikes above what they were filled with, 0 elsewhere (n1, n2) [m].
    """

    undefined_share: float = field(metadata={"unit": "", "label": "share of undefined points", "percent": True})
    spikes: int = field(metadata={"unit": "", "label": "points in spikes"})
    form: Form = field(metadata={"unit": "", "label": "form of the defined points"})
    removed: NDArray[np.float64] = field(repr=False, metadata={"unit": "m", "label": "spikes above their filling"})


def repair(
    topography: Topography, *, spikes: float = SPIKES, max_undefined: float = 0.05, detrend: int = 1
) -> tuple[Topography, Repair]:
    """Flat map without spikes and without undefined points: both filled by the harmonic surface through their rims.

    Parameters
    ----------
    topography : as measured.
    spikes : threshold of `find_spikes` in robust standard deviations; infinite leaves them.
    max_undefined : largest share of points (0 to 1) that may be filled, spikes included.
    detrend : order of the form taken off, see `Topography.detrend`.

    Raises
    ------
    InputError : more points to fill, or none that is defined; threshold not > 0; another order.
    """
    marked = topography.without_spikes(spikes)
    count = round((marked.undefined_share - topography.undefined_share) * topography.heights.size)
    form = fit_form(marked.heights, marked.size, detrend)
    flat = Topography(marked.heights - form.heights, marked.spacing, marked.periodic)
    try:
        flat = flat.fill_undefined(max_undefined)
    except TooManyUndefined as error:
        if topography.undefined_share > max_undefined:
            raise
        raise error.with_spikes(count) from None
    spiked = np.isnan(marked.heights) & ~np.isnan(topography.heights)
    removed = np.where(spiked, topography.heights - form.heights - flat.heights, 0.0)
    return flat, Repair(topography.undefined_share, count, form, removed)
