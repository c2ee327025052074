"""Find sizes, rms heights and slopes of a map that can only be explained by a wrong unit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..base import InputError, as_text, to_text
from .raw import Reading, bad_file
from .topography import Topography

#: Smallest and largest plausible side of a measured map [m].
_SIZE_LIMITS = (1e-9, 1.0)
#: Largest plausible rms height of a map [m].
_RMS_HEIGHT_LIMIT = 10e-3
#: Largest plausible median of the slope between neighbouring points.
_SLOPE_LIMIT = 10.0
#: About this many rows of a map are examined for plausibility.
_ROWS = 256


def implausible_values(path: Path, topography: Topography, given: Reading) -> Iterator[InputError]:
    """Yield an error for each implausible value: size, rms height or slope.

    Such values are usually due to a wrong unit.

    Units given by the caller are not checked. The slope is checked only if the size and the rms height of the map are
    plausible.
    """
    is_size_given = given.size is not None or given.spacing is not None
    is_unit_given = given.height_unit is not None
    advice = "if it is right, or to correct it, pass"
    is_plausible = True
    shortest, longest = _SIZE_LIMITS
    if not is_size_given and not all(shortest <= side <= longest for side in topography.size):
        expected = f"1 nm to 1 m; {advice} size= (--size)"
        yield bad_file(path, f"a size of {as_text(topography.size, 'm')}", expected)
        is_plausible = False
    deviation = _sampled_deviation(topography)
    if not is_unit_given and deviation > _RMS_HEIGHT_LIMIT:
        expected = f"at most 10 mm; {advice} height_unit= such as 'um' (--height-unit)"
        yield bad_file(path, f"Sq = {to_text(deviation, 'm')}", expected)
        is_plausible = False
    if not is_plausible or (is_size_given and is_unit_given):
        return
    slope = _median_slope(topography)
    if slope > _SLOPE_LIMIT:
        expected = f"at most 10; {advice} size= and height_unit= (--size, --height-unit)"
        yield bad_file(path, f"a median slope of {slope:.3g}", expected)


def _sampled_deviation(topography: Topography) -> float:
    """Return the standard deviation of the heights in a sample of rows [m]."""
    z = topography.heights[:: max(1, topography.shape[0] // _ROWS)]
    defined = z[~np.isnan(z)]
    with np.errstate(over="ignore"):
        return float(defined.std()) if defined.size else 0.0


def _median_slope(topography: Topography) -> float:
    """Return the median slope between neighbouring points in a sample of lines, along x1 or x2, whichever is larger.

    The median is not affected by spikes and undefined points.
    """
    medians = [0.0]
    heights = topography.heights
    # in each of these views, the lines along one axis are the rows
    for z, spacing in zip((heights.T, heights), topography.spacing, strict=True):
        lines = z[:: max(1, len(z) // _ROWS)]
        slopes = np.abs(np.diff(lines, axis=1)) / spacing
        defined = slopes[~np.isnan(slopes)]
        if defined.size:
            medians.append(float(np.median(defined)))
    return max(medians)
