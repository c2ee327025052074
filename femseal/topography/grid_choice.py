"""Choose the grid and the shortest wave of a conditioned map, so that the shortest wave has at least 8 pixels."""

from __future__ import annotations

from math import ceil, inf, prod, sqrt

import scipy

from ..base import InputError, Pair, Shape, to_text, validate
from .instrument_limits import Instrument
from .patches import Surface
from .power_spectrum import spectrum
from .waves import SLACK

#: Default number of pixels per shortest wave, which is enough to resolve contact and flow. If the pixels are not
#: square, the larger spacing counts.
PIXELS_PER_WAVE = 8
#: A measured surface keeps its pixels if the waves that are at least 8 pixels long have at least this fraction of the
#: rms slope of all measured waves.
KEPT_SLOPE = 0.99
#: Largest number of points of a grid that femseal chooses. The number is the same on all machines, so that results do
#: not depend on the machine. A deterministic solution on such a grid takes a few GB of memory, and 10 to 40 s on one
#: core for each load step.
MOST_GRID_POINTS = 2**22


def default_wave(flat: Surface, shape: Shape, instrument: Instrument) -> float:
    """Return the default value of `shortest_wave` [m] in `condition`, for a grid with a given number of points.

    The wavelength is the longest of three: 8 pixels of the grid, the shortest wave that the instrument resolves, and
    the shortest wave above the noise. The shortest wave above the noise is capped at 8 measured pixels, because a
    longer cut-off is only justified if the limits of the instrument are known.
    """
    eight_pixels_of_grid = resolved_wave(flat.size, shape)
    eight_pixels_of_map = resolved_wave(flat.size, flat.shape)
    above_noise = min(instrument.spectrum(flat).shortest_wave, eight_pixels_of_map)
    resolved_by_instrument = instrument.shortest_wave(flat)
    return max(eight_pixels_of_grid, above_noise, resolved_by_instrument)


def resolved_wave(size: Pair, shape: Shape) -> float:
    """Return the shortest wavelength [m] that has 8 pixels on a grid."""
    return PIXELS_PER_WAVE * max(length / n for length, n in zip(size, shape, strict=True))


def resolving_shape(size: Pair, wave: float, *, most: float = inf) -> Shape:
    """Choose the number of points so that a wave has 8 pixels or slightly more, and Fourier transforms are fast.

    Parameters
    ----------
    size : tuple of two float
        Sides of the surface [m].
    wave : float
        Shortest wavelength [m] that the grid must resolve.
    most : float
        Approximate upper limit on the number of points. If 8 pixels per wave would require more points than that, a
        wave has fewer than 8 pixels.

    Examples
    --------
    >>> resolving_shape((1e-3, 2e-3), 8e-6), resolving_shape((1e-3, 2e-3), 8e-6, most=500_000)
    ((1000, 2000), (500, 1000))
    """
    pixel = max(wave / PIXELS_PER_WAVE, sqrt(prod(size) / most))
    n1, n2 = (
        scipy.fft.next_fast_len(ceil(length / pixel * (1 - SLACK)), real=True) for length in size
    )
    return n1, n2


def default_points(level: Surface, shortest_wave: float | None, instrument: Instrument) -> Shape:
    """Choose the numbers of grid points for a measured surface.

    A wave is resolved if it is at least 8 pixels long. If waves resolved by the measured pixels account for nearly all
    of the rms slope, the grid keeps the measured pixels. Otherwise, the grid is finer and resolves the shortest
    measured wave, see `resolving_shape`. A grid with more than `MOST_GRID_POINTS` points is only chosen if
    `shortest_wave` requires it.

    Parameters
    ----------
    level : Topography or Patches
        Surface without undefined points.
    shortest_wave : float or None
        Shortest wave that the user wants to retain [m], which the grid must resolve. None if the user has not chosen a
        wave.
    instrument : Instrument
        Instrument with which the surface was measured.
    """
    # shortest wave that the measured pixels resolve
    wave_of_pixels = resolved_wave(level.size, level.shape)
    # wave that the grid must resolve
    wave = shortest_wave
    if wave is None:
        # shortest wave above noise and within the limits of the instrument
        measured = max(spectrum(level).shortest_wave, instrument.shortest_wave(level))
        slope_on_pixels = level.rms_slope_of_long_waves(wave_of_pixels)
        slope = level.rms_slope_of_long_waves(measured)
        wave = wave_of_pixels if slope_on_pixels >= KEPT_SLOPE * slope else measured
    if wave >= wave_of_pixels and level.heights.size <= MOST_GRID_POINTS:
        return level.shape
    # a finer grid or, if the map has too many pixels, a coarser grid
    points = resolving_shape(level.size, min(wave, wave_of_pixels), most=MOST_GRID_POINTS)
    if shortest_wave is not None and resolved_wave(level.size, points) > wave:
        # the limit of the number of points does not apply to a wave that the user has chosen
        return resolving_shape(level.size, wave)
    return points


def check_wave(wave: float, size: Pair, shape: Shape) -> float:
    """Check that a wave has at least 8 pixels on a grid and is shorter than the surface, and return it.

    wave : wavelength [m].
    size : sides of the surface [m].
    shape : number of points of the grid.
    """
    shortest = validate.number("shortest_wave", wave, unit="m")
    resolved = resolved_wave(size, shape)
    if shortest < resolved * (1 - SLACK):
        finer = resolving_shape(size, shortest)
        expected = (
            f"at least {PIXELS_PER_WAVE} pixels = {to_text(resolved, 'm')}, or {{shape}} for a "
            "finer grid"
        )
        raise InputError("shortest_wave", to_text(shortest, "m"), expected, {"shape": finer})
    if shortest >= max(size):
        expected = f"less than the larger side, {to_text(max(size), 'm')}"
        raise InputError("shortest_wave", to_text(shortest, "m"), expected)
    return shortest
