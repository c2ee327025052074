"""Condition a measured map for contact and flow: filled, flat, and smooth at the scale of a pixel.

Source: section 4.1 of the model, after Pérez-Ràfols et al., Tribol. Lett. (2018): remove the tilt, truncate
in Fourier space so that the shortest wave is resolved by at least 8 pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import atan

import numpy as np

from ..base import validate
from ..base.errors import InputError
from ..base.quantities import to_text
from .generate import PIXELS_PER_WAVE
from .labelled import Labelled
from .repairs import repair
from .spectral import SLACK
from .spike_effect import spike_effect
from .spikes import SPIKES
from .topography import Topography


@dataclass(frozen=True)
class Conditioning(Labelled):
    """What was done to a measured map; "before" means filled and flat, but not yet low-passed."""

    undefined_share: float = field(metadata={"unit": "", "label": "undefined points, filled", "percent": True})
    spikes: int = field(metadata={"unit": "", "label": "points in spikes, filled"})
    spikes_along_lay: float | None = field(
        metadata={"unit": "", "label": "spikes that follow the lay", "percent": True}
    )
    spikes_extreme: float | None = field(metadata={"unit": "", "label": "extremes hanging on spikes", "percent": True})
    removed_tilt: tuple[float, float] = field(metadata={"unit": "rad", "label": "tilt removed along x1, x2"})
    removed_curvature: tuple[float, float, float] = field(
        metadata={"unit": "1/m", "label": "curvature removed: 11, 12, 22"}
    )
    shortest_wavelength: float = field(metadata={"unit": "m", "label": "shortest wavelength kept"})
    rms_height_before: float = field(metadata={"unit": "m", "label": "Sq before the low-pass"})
    rms_height: float = field(metadata={"unit": "m", "label": "Sq"})
    rms_slope_before: float = field(metadata={"unit": "", "label": "rms slope before the low-pass"})
    rms_slope: float = field(metadata={"unit": "", "label": "rms slope"})
    shape_before: tuple[int, int] = field(metadata={"unit": "", "label": "points measured"})
    shape: tuple[int, int] = field(metadata={"unit": "", "label": "points"})
    spacing_before: tuple[float, float] = field(metadata={"unit": "m", "label": "pixel measured"})
    spacing: tuple[float, float] = field(metadata={"unit": "m", "label": "pixel"})


def condition(
    topography: Topography,
    *,
    spikes: float = SPIKES,
    detrend: int = 1,
    shortest_wavelength: float | None = None,
    max_undefined: float = 0.05,
    shape: tuple[int, int] | None = None,
) -> tuple[Topography, Conditioning]:
    """Take off the form of the defined points, fill spikes and undefined ones, low-pass, resample if asked.

    Parameters
    ----------
    topography : the map as measured.
    spikes : threshold of isolated points that are taken for undefined ones, see `find_spikes`; infinite leaves them.
    detrend : order of the form removed: 0 mean, 1 tilt, 2 tilt and curvature.
    shortest_wavelength : waves kept are no shorter [m]; 8 pixels of the coarser spacing of the measured
        and the final grid, unless given. A shorter one needs `shape` with a grid that gives it 8 pixels.
    max_undefined : largest share of undefined points (0 to 1) that may be filled, spikes included.
    shape : final number of points; as measured unless given.

    Returns
    -------
    The usable map and the report of what was done.

    Raises
    ------
    InputError : too many undefined points; a shortest wavelength of less than 8 pixels, or longer than the
        map.
    """
    final = topography.shape if shape is None else validate.grid("shape", shape)
    spacing = [length / n for length, n in zip(topography.size, final, strict=True)]
    resolved = PIXELS_PER_WAVE * max(spacing)
    if shortest_wavelength is None:
        shortest_wavelength = max(resolved, PIXELS_PER_WAVE * max(topography.spacing))
    shortest = validate.number("shortest_wavelength", shortest_wavelength, unit="m")
    if shortest < resolved * (1 - SLACK):
        finer = tuple(int(np.ceil(PIXELS_PER_WAVE * length / shortest - SLACK)) for length in topography.size)
        allowed = f"at least {PIXELS_PER_WAVE} pixels = {to_text(resolved, 'm')}, or shape={finer} for a finer grid"
        raise InputError.of("shortest_wavelength", to_text(shortest, "m"), allowed)
    if shortest >= max(topography.size):
        allowed = f"less than the larger side, {to_text(max(topography.size), 'm')}"
        raise InputError.of("shortest_wavelength", to_text(shortest, "m"), allowed)

    flat, repaired = repair(topography, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
    form = repaired.form
    smooth = flat.low_pass(shortest).resample(final)
    tilt1, tilt2 = form.slopes
    effect = spike_effect(flat, repaired.removed, shortest)
    return smooth, Conditioning(
        undefined_share=repaired.undefined_share,
        spikes=repaired.spikes,
        spikes_along_lay=effect.along_lay,
        spikes_extreme=effect.extreme,
        removed_tilt=(atan(tilt1), atan(tilt2)),
        removed_curvature=form.curvatures,
        shortest_wavelength=shortest,
        rms_height_before=flat.rms_height,
        rms_height=smooth.rms_height,
        rms_slope_before=flat.rms_slope,
        rms_slope=smooth.rms_slope,
        shape_before=topography.shape,
        shape=smooth.shape,
        spacing_before=topography.spacing,
        spacing=smooth.spacing,
    )
