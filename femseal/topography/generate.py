"""Generate surfaces from a few parameters: self-affine surfaces (lapped, ground, blasted) and turned surfaces.

Symbols: q wave vector with the angular wave number |q| [rad/m], C spectral density, H Hurst exponent. On a surface with
the sides L1 and L2, a wave with k1 periods along x1 and k2 periods along x2 has q = 2π(k1/L1, k2/L2).

The turned profile is the envelope of the passes of a round tool nose with the radius r. The cusps between the passes
have the height pitch²/8r.

Sources: Persson et al., J. Phys.: Condens. Matter 17 (2005) R1 (self-affine spectrum with roll-off).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import InputError, Lengths, Pair, Shape, to_text, validate
from .grid_choice import PIXELS_PER_WAVE
from .topography import Topography
from .waves import SLACK

#: Number of waves that are handled at a time, to save memory.
_WAVES_AT_ONCE = 2**20


def self_affine(
    shape: Shape,
    size: Lengths,
    *,
    hurst: float,
    rms_slope: float | None = None,
    rms_height: float | None = None,
    roll_off: float | None = None,
    cut_off: float | None = None,
    rng: Any,
) -> Topography:
    """Generate a periodic, isotropic self-affine surface with exactly the given spectrum and random phases.

    The spectral density is constant for q < 2π/roll_off, proportional to q^(−2−2H) between 2π/roll_off and 2π/cut_off,
    and 0 for larger q. The random phases are assigned to the waves from the longest to the shortest wave. The same seed
    therefore gives the same surface on every grid that resolves `cut_off`. A shorter `cut_off` adds waves and
    multiplies all heights by a common factor.

    Parameters
    ----------
    shape : tuple of two int
        Number of points along x1 and x2.
    size : float or tuple of two float
        Sides along x1 and x2 [m].
    hurst : float
        Hurst exponent H in (0, 1].
    rms_slope, rms_height : float
        Rms slope [-] or rms height [m] of the surface, exact up to rounding errors. Exactly one of `rms_slope` and
        `rms_height` must be given.
    roll_off : float, optional
        Wavelength above which the spectrum is constant [m]. Default: the larger side.
    cut_off : float, optional
        Shortest wave [m], at least 2 pixels. Default: 8 times the larger pixel spacing.
    rng : numpy.random.Generator or seed
        Source of the phases.

    Returns
    -------
    Topography
        The surface.

    Raises
    ------
    InputError
        A value is outside its range, or both or neither of `rms_slope` and `rms_height` are given.

    Examples
    --------
    >>> face = self_affine((128, 128), (1e-3, 1e-3), hurst=0.8, rms_slope=0.1, rng=1)
    >>> round(face.rms_slope, 12)
    0.1
    """
    shape, size = validate.grid("shape", shape), validate.lengths("size", size)
    spacing = (size[0] / shape[0], size[1] / shape[1])
    if not 0 < validate.number("hurst", hurst) <= 1:
        raise InputError("hurst", hurst, "a number in (0, 1]")
    if (rms_slope is None) == (rms_height is None):
        given = "neither" if rms_slope is None else "both"
        raise InputError("rms_slope, rms_height", given, "exactly one of the two")
    if rms_slope is None:
        rms = validate.number("rms_height", rms_height, unit="m", inclusive=True)
    else:
        rms = validate.number("rms_slope", rms_slope, inclusive=True)
    cut_off = _check_cut_off(cut_off, spacing, size)
    roll_off = max(size) if roll_off is None else validate.number("roll_off", roll_off, unit="m")
    if roll_off <= cut_off:
        expected = f"a wavelength > cut_off = {to_text(cut_off, 'm')}"
        raise InputError("roll_off", to_text(roll_off, "m"), expected)

    k1, k2 = period_counts(size, cut_off)
    q = 2 * np.pi * np.hypot(k1 / size[0], k2 / size[1])
    amplitude = np.maximum(q, 2 * np.pi / roll_off) ** -(1 + hurst)
    weight = 1.0 if rms_slope is None else q**2
    # Each wave of the half plane stands for a conjugate pair, hence the factor 2.
    amplitude *= rms / np.sqrt(2 * np.sum(weight * amplitude**2))
    del q, weight  # frees memory that large surfaces need
    heights = random_waves(shape, (k1, k2), amplitude, _check_generator(rng))
    heights.flags.writeable = False  # a map copies an array only if it is writeable
    return Topography(heights, spacing)


def turned(
    shape: Shape,
    size: Lengths,
    *,
    pitch: float,
    depth: float,
    nose_radius: float | None = None,
    feed_error: float = 0.0,
    depth_error: float = 0.0,
    waviness: float = 0.0,
    waviness_length: float | None = None,
    roughness: float = 0.0,
    hurst: float = 0.8,
    roughness_roll_off: float | None = None,
    cut_off: float | None = None,
    rng: Any,
) -> Topography:
    """Generate a surface turned on a lathe: grooves along x2, one per pitch along x1, with sharp ridges between them.

    In pass k, the tool nose cuts a groove with the profile z = (x1 − x1_k)²/2r. At each point, the height of the
    surface is the smallest height of the profiles of all passes. Heights are measured from the nominal bottom of the
    grooves. Waviness along x1 and self-affine roughness are added. Finally, waves shorter than `cut_off` are removed,
    because a grid cannot represent sharp ridges. The arguments `depth`, `waviness` and `roughness` describe the surface
    before these waves are removed.

    Parameters
    ----------
    shape : tuple of two int
        Number of points along x1 (across the grooves) and along x2 (along the grooves).
    size : float or tuple of two float
        Sides along x1 and x2 [m].
    pitch : float
        Feed per turn [m], longer than `cut_off` and at most `size[0]`.
    depth : float
        Depth of cut [m]. If `nose_radius` is not given, the depth is the height of the ridges above the bottom of the
        grooves, and the radius of the tool nose is r = pitch²/(8 depth).
    nose_radius : float, optional
        Radius r of the tool nose [m]. A tool nose with this radius produces ridges of the height pitch²/8r. If
        pitch²/8r exceeds `depth`, flat lands at the height `depth` remain between the grooves.
    feed_error : float
        Rms error of the position of the grooves, as a fraction of the pitch, from 0 to 0.5.
    depth_error : float
        Rms error of the depth of the grooves, as a fraction of `depth`, from 0 to 1. The errors of position and depth
        each have two parts with equal mean squares: one is constant along a groove, the other varies along it as a sine
        with period `size[1]` and random phase.
    waviness : float
        Rms height [m] of a sinusoidal waviness along x1.
    waviness_length : float, optional
        Wavelength of the waviness [m]. Default: `size[0]`/2.
    roughness : float
        Rms height of `self_affine` roughness [m].
    hurst, roughness_roll_off : float
        Hurst exponent and roll-off wavelength [m] of the roughness.
    cut_off : float, optional
        Shortest wave [m]. Default: 8 times the larger pixel spacing.
    rng : numpy.random.Generator or seed
        Source of the random errors and phases.

    Returns
    -------
    Topography
        The surface, which is periodic along x2. Along x1, the surface is periodic if `size[0]` is a multiple of the
        pitch and, with a waviness, of `waviness_length`.

    Raises
    ------
    InputError
        A value is outside its range.

    Examples
    --------
    >>> face = turned((128, 64), (240e-6, 120e-6), pitch=60e-6, depth=2e-6, rng=1)
    >>> face.shape, face.periodic
    ((128, 64), (True, True))
    """
    shape, size = validate.grid("shape", shape), validate.lengths("size", size)
    spacing = (size[0] / shape[0], size[1] / shape[1])
    cut_off = _check_cut_off(cut_off, spacing, size)
    turning = _checked_turning(
        size,
        cut_off,
        pitch=pitch,
        depth=depth,
        nose_radius=nose_radius,
        feed_error=feed_error,
        depth_error=depth_error,
        waviness=waviness,
        waviness_length=waviness_length,
    )
    roughness = validate.number("roughness", roughness, unit="m", inclusive=True)
    rng = _check_generator(rng)
    face = _turned_without_roughness(shape, size, turning, rng).low_pass(cut_off)
    if roughness:
        face += self_affine(
            shape,
            size,
            hurst=hurst,
            rms_height=roughness,
            roll_off=roughness_roll_off,
            cut_off=cut_off,
            rng=rng,
        )
    return face


class _Turning(NamedTuple):
    """Checked parameters of a turned surface, see `turned`.

    pitch : feed per turn [m].
    nose_radius : radius of the tool nose [m].
    largest_height : height of the flat lands above the bottom of the grooves [m]; infinite if the grooves leave none.
    rms_errors : rms error of the position of a groove, and rms error of its depth [m].
    waviness, waviness_length : rms height and wavelength of the waviness [m].
    """

    pitch: float
    nose_radius: float
    largest_height: float
    rms_errors: Pair
    waviness: float
    waviness_length: float


def _checked_turning(
    size: Pair,
    cut_off: float,
    *,
    pitch: float,
    depth: float,
    nose_radius: float | None,
    feed_error: float,
    depth_error: float,
    waviness: float,
    waviness_length: float | None,
) -> _Turning:
    """Check the parameters of `turned` that describe grooves and waviness; raise InputError if one is not allowed."""
    pitch = validate.number("pitch", pitch, unit="m")
    depth = validate.number("depth", depth, unit="m")
    if not cut_off < pitch <= size[0] * (1 + SLACK):
        limits = (to_text(cut_off, "m"), to_text(size[0], "m"))
        expected = f"more than cut_off = {limits[0]} and at most size[0] = {limits[1]}"
        raise InputError("pitch", to_text(pitch, "m"), expected)
    radius = pitch**2 / (8 * depth)
    if nose_radius is not None:
        radius = validate.number("nose_radius", nose_radius, unit="m")
    for name, error, limit in (("feed_error", feed_error, 0.5), ("depth_error", depth_error, 1.0)):
        if validate.number(name, error, inclusive=True) > limit:
            raise InputError(name, error, f"a number in [0, {limit:g}]")
    waviness = validate.number("waviness", waviness, unit="m", inclusive=True)
    wavelength = size[0] / 2 if waviness_length is None else waviness_length
    return _Turning(
        pitch,
        radius,
        largest_height=np.inf if nose_radius is None else depth,
        rms_errors=(feed_error * pitch, depth_error * depth),
        waviness=waviness,
        waviness_length=validate.number("waviness_length", wavelength, unit="m"),
    )


def _turned_without_roughness(
    shape: Shape, size: Pair, turning: _Turning, rng: np.random.Generator
) -> Topography:
    """Generate the grooves and the waviness of a turned surface, with sharp ridges and without roughness."""
    pitch, waviness, wavelength = turning.pitch, turning.waviness, turning.waviness_length
    spacing = (size[0] / shape[0], size[1] / shape[1])
    pitches_fit = _is_whole(size[0] / pitch)
    # A surface that is not periodic needs one more pass, because only a part of its last groove lies on the surface.
    passes = round(size[0] / pitch) if pitches_fit else int(size[0] / pitch) + 1
    x1 = ((np.arange(shape[0]) + 0.5) * spacing[0])[:, None]  # (n1, 1)
    angle = 2 * np.pi * (np.arange(shape[1]) + 0.5) / shape[1]  # (n2,), of the workpiece
    z = _cut_grooves(x1, angle, passes, pitch, turning.nose_radius, turning.rms_errors, rng)
    if np.isfinite(turning.largest_height):
        z = np.minimum(z, turning.largest_height)
    z = z + np.sqrt(2) * waviness * np.cos(2 * np.pi * (x1 / wavelength + rng.random()))
    waves_fit = waviness == 0 or _is_whole(size[0] / wavelength)
    return Topography(z, spacing, (pitches_fit and waves_fit, True))


def _cut_grooves(
    x1: NDArray,
    angle: NDArray,
    passes: int,
    pitch: float,
    radius: float,
    rms_errors: Pair,
    rng: np.random.Generator,
) -> NDArray:
    """Return the heights (n1, n2) [m] that remain after all passes of the tool.

    x1 : positions across the grooves, (n1, 1) [m].
    angle : positions along the grooves, (n2,), as an angle [rad] that increases from 0 to 2π over the length of the
        map.
    rms_errors : rms error of the position of a groove, and rms error of its depth [m].
    """
    # Each error has a part that is constant along a groove, and a part that is a sine of the angle. Axes of the arrays:
    # (position or depth, pass, n2).
    constant, sine_amplitude = rng.standard_normal((2, 2, passes, 1))
    sine = np.cos(angle + 2 * np.pi * rng.random((2, passes, 1)))
    relative_errors = np.sqrt(0.5) * constant + sine_amplitude * sine
    shift, extra_depth = np.reshape(rms_errors, (2, 1, 1)) * relative_errors  # (pass, n2) each [m]
    # At the distance s from a pass, its groove has the height s²/2r − extra depth. The nearest pass is within
    # pitch/2 + largest shift. A pass further away than `farthest` is higher, even if it has the largest extra depth and
    # the nearest pass the smallest.
    largest_shift = np.abs(shift).max()
    farthest = np.sqrt((pitch / 2 + largest_shift) ** 2 + 2 * radius * np.ptp(extra_depth))
    neighbours = int(np.ceil((farthest + largest_shift) / pitch))
    nearest_pass = np.floor(x1[:, 0] / pitch).astype(int)  # (n1,)
    z = np.full((x1.size, angle.size), np.inf)
    for k in range(-neighbours, neighbours + 1):
        pass_number = nearest_pass + k
        # passes beyond the ends of the surface also cut the surface, and have the random errors of other passes
        groove = pass_number % passes
        distance = x1 - (pass_number[:, None] + 0.5) * pitch - shift[groove]
        np.minimum(z, distance**2 / (2 * radius) - extra_depth[groove], out=z)
    return z


def random_waves(
    shape: Shape, numbers: tuple[NDArray, NDArray], amplitude: NDArray, rng: np.random.Generator
) -> NDArray:
    """Return the sum of waves with given amplitudes and random phases.

    Parameters
    ----------
    shape : tuple of two int
        Number of points along x1 and x2.
    numbers : two arrays of int, (waves,)
        Numbers of periods k1 along x1 and k2 along x2, see `period_counts`.
    amplitude : array, (waves,)
        Amplitude of each wave and of its conjugate [m].
    rng : numpy.random.Generator
        Source of the phases.

    Returns
    -------
    array, (n1, n2)
        Heights [m].
    """
    k1, k2 = numbers
    spectrum = np.zeros((shape[0], shape[1] // 2 + 1), dtype=complex)
    for start in range(0, amplitude.size, _WAVES_AT_ONCE):
        block = slice(start, start + _WAVES_AT_ONCE)
        row, column = k1[block], k2[block]
        phase = 2 * np.pi * rng.random(row.size)
        # Points are at pixel centres, half a pixel from the origin of the phases, so that waves do not move when the
        # grid changes.
        phase += np.pi * (row / shape[0] + column / shape[1])
        waves = amplitude[block] * np.exp(1j * phase)
        spectrum[row, column] = waves
        # The transform of real heights supplies the conjugates of all waves, except of those with k2 = 0.
        is_first_column = column == 0
        spectrum[-row[is_first_column], 0] = waves[is_first_column].conj()
    # one axis at a time, because an inverse transform along both axes at once would copy the spectrum
    spectrum = scipy.fft.ifft(spectrum, axis=0, norm="forward", overwrite_x=True)
    return scipy.fft.irfft(spectrum, shape[1], axis=1, norm="forward", overwrite_x=True)


def period_counts(size: Pair, cut_off: float) -> tuple[NDArray, NDArray]:
    """List all waves longer than `cut_off` in a half plane of wave vectors, from the longest to the shortest.

    The order of the waves decides which random phase a wave gets. The order depends on the ratio of the sides, but not
    on the grid.

    Parameters
    ----------
    size : tuple of two float
        Sides [m].
    cut_off : float
        Shortest wave [m]; waves of exactly this length are excluded.

    Returns
    -------
    k1, k2 : arrays of int, (waves,)
        Numbers of periods of each wave along x1 and x2; k1 may be negative.
    """
    most = [int(length / cut_off) for length in size]
    # 32-bit integers save memory, because a surface may have half as many waves as points
    range1 = np.arange(-most[0], most[0] + 1, dtype=np.int32)
    range2 = np.arange(most[1] + 1, dtype=np.int32)
    k1, k2 = np.meshgrid(range1, range2, indexing="ij")
    # square of the wave number, in units of (2π/L1)²
    square = np.square(k1, dtype=float) + (k2 * (size[0] / size[1])) ** 2
    is_in_half_plane = (k2 > 0) | (k1 > 0)
    # The limit itself is excluded: on some grids it would be the Nyquist wave, whose phase depends on the grid.
    is_long = square < (size[0] / cut_off) ** 2 * (1 - SLACK)
    selected = is_in_half_plane & is_long
    k1, k2, square = k1[selected], k2[selected], square[selected]
    order = np.lexsort((k2, k1, square))
    return k1[order], k2[order]


def _check_cut_off(cut_off: float | None, spacing: Pair, size: Pair) -> float:
    """Check the cut-off of a generated surface, and return it [m]. Default: 8 pixels.

    Raises InputError if the cut-off is shorter than 2 pixels, or not shorter than the larger side of the map.
    """
    pixel, longest = max(spacing), max(size)
    wave = PIXELS_PER_WAVE * pixel if cut_off is None else cut_off
    wave = validate.number("cut_off", wave, unit="m")
    if 2 * pixel * (1 - SLACK) <= wave < longest * (1 - SLACK):
        return wave
    limits = (to_text(2 * pixel, "m"), to_text(longest, "m"))
    expected = f"a wavelength >= 2 pixels = {limits[0]} and < the larger side = {limits[1]}"
    raise InputError("cut_off", to_text(wave, "m"), expected)


def _is_whole(ratio: float) -> bool:
    """Return whether a ratio is a whole number of at least 1, up to rounding."""
    return ratio > 0.5 and abs(ratio - round(ratio)) <= 1e-9 * ratio


def _check_generator(rng: Any) -> np.random.Generator:
    """Return the given generator of random numbers, or make one from a seed."""
    try:
        if rng is None:
            raise TypeError
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        expected = "a numpy Generator or a seed, so that the surface can be reproduced"
        raise InputError("rng", repr(rng), expected) from None
