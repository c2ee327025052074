"""Faces made from a few numbers: self-affine (lapped, ground, blasted) and turned in a lathe.

Symbols: q angular wavenumber [rad/m], C spectral density, H Hurst exponent, k = (k1, k2) numbers of a wave on
the periods L1, L2, so q = 2π(k1/L1, k2/L2).
Sources: Persson et al., J. Phys.: Condens. Matter 17 (2005) R1 (self-affine spectrum with roll-off); the
turned profile is the envelope of the passes of a round tool nose, height of the cusps pitch²/8r.
"""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import InputError, Lengths, Pair, Shape, to_text, validate
from .topography import SLACK, Topography

#: Pixels of the coarser spacing per shortest wave, unless given: enough to resolve contact and flow.
PIXELS_PER_WAVE = 8
#: Number of waves whose phases are drawn at a time.
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
    """Periodic isotropic self-affine face with exactly the target spectrum: only the phases are random.

    C(q) ∝ 1 for q < 2π/roll_off, ∝ q^(−2−2H) from there up to, but not at, q = 2π/cut_off, no waves beyond.
    Phases are drawn from the longest wave to the shortest: the same seed gives the same surface on any grid
    that resolves cut_off, and a shorter cut_off, up to the scale, only adds shorter waves.

    Parameters
    ----------
    shape, size : number of points and side lengths [m] along x1 and x2.
    hurst : H in (0, 1].
    rms_slope, rms_height : one of both, [-] or [m], met to rounding (see `Topography`).
    roll_off : wavelength [m] where the plateau of long waves ends; the larger side (no plateau) unless given.
    cut_off : shortest wave [m], at least 2 pixels; 8 pixels of the coarser spacing unless given.
    rng : a numpy Generator, or a seed as taken by np.random.default_rng.

    Raises
    ------
    InputError : a value out of its range, none or both of rms_slope and rms_height.

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
        target = validate.number("rms_height", rms_height, unit="m", inclusive=True)
    else:
        target = validate.number("rms_slope", rms_slope, inclusive=True)
    cut_off = _cut_off(cut_off, spacing, size)
    roll_off = max(size) if roll_off is None else validate.number("roll_off", roll_off, unit="m")
    if roll_off <= cut_off:
        expected = f"a wavelength > cut_off = {to_text(cut_off, 'm')}"
        raise InputError("roll_off", to_text(roll_off, "m"), expected)

    k1, k2 = wave_numbers(size, cut_off)
    q = 2 * np.pi * np.hypot(k1 / size[0], k2 / size[1])
    amplitude = np.maximum(q, 2 * np.pi / roll_off) ** -(1 + hurst)
    # Each wave of the half plane stands for a conjugate pair.
    weight = 1.0 if rms_slope is None else q**2
    amplitude *= target / np.sqrt(2 * np.sum(weight * amplitude**2))
    return Topography(random_waves(shape, (k1, k2), amplitude, _generator(rng)), spacing)


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
    """Face turned in a lathe: grooves along x2, one per pitch along x1, sharp ridges between.

    Groove k is an arc of the tool nose, (x1 − x1_k)²/2r above its bottom; the face is the lowest of all
    passes, heights counted from the nominal bottom. Waviness along x1 and self-affine roughness are added,
    and the sum is low-passed at cut_off because a grid cannot carry the sharp ridges: the given depth,
    waviness and roughness are those before the low-pass.

    Parameters
    ----------
    shape, size : number of points and side lengths [m] along x1 (across the grooves) and x2 (along them).
    pitch : feed per turn [m], longer than cut_off, at most size[0].
    depth : depth of cut [m]. Without nose_radius it is the height of the ridges above the bottoms, and
        r = pitch²/(8 depth).
    nose_radius : r [m]. The face is then cut at height `depth`: flat lands stay between grooves where
        pitch²/8r > depth, otherwise ridges of height pitch²/8r.
    feed_error : rms error of the position of a groove in pitches, in [0, 0.5].
    depth_error : rms error of the depth of a groove in depths, in [0, 1]. Of the mean square of both errors
        half is constant along a groove, half is a sinusoidal wander of period size[1] and random phase.
    waviness : rms height [m] of a wave along x1, of wavelength waviness_length [m] (size[0]/2 unless given).
    roughness : rms height [m] of `self_affine` roughness with `hurst` and `roughness_roll_off` [m].
    cut_off : shortest wave [m]; 8 pixels of the coarser spacing unless given.
    rng : a numpy Generator, or a seed as taken by np.random.default_rng.

    Returns
    -------
    Topography, periodic along x2; along x1 where pitch and waviness_length both fit a whole number of times.

    Raises
    ------
    InputError : a value out of its range.

    Examples
    --------
    >>> face = turned((128, 64), (240e-6, 120e-6), pitch=60e-6, depth=2e-6, rng=1)
    >>> face.shape, face.periodic
    ((128, 64), (True, True))
    """
    shape, size = validate.grid("shape", shape), validate.lengths("size", size)
    spacing = (size[0] / shape[0], size[1] / shape[1])
    pitch = validate.number("pitch", pitch, unit="m")
    depth = validate.number("depth", depth, unit="m")
    cut_off = _cut_off(cut_off, spacing, size)
    if not cut_off < pitch <= size[0] * (1 + SLACK):
        allowed = f"more than cut_off = {to_text(cut_off, 'm')} and at most size[0] = {to_text(size[0], 'm')}"
        raise InputError("pitch", to_text(pitch, "m"), allowed)
    radius = pitch**2 / (8 * depth)
    if nose_radius is not None:
        radius = validate.number("nose_radius", nose_radius, unit="m")
    for name, error, limit in (("feed_error", feed_error, 0.5), ("depth_error", depth_error, 1.0)):
        if validate.number(name, error, inclusive=True) > limit:
            raise InputError(name, error, f"a number in [0, {limit:g}]")
    waviness = validate.number("waviness", waviness, unit="m", inclusive=True)
    wave = size[0] / 2 if waviness_length is None else waviness_length
    wave = validate.number("waviness_length", wave, unit="m")
    roughness = validate.number("roughness", roughness, unit="m", inclusive=True)

    rng = _generator(rng)
    wraps = _whole(size[0] / pitch)
    x1 = ((np.arange(shape[0]) + 0.5) * spacing[0])[:, None]
    turn = 2 * np.pi * (np.arange(shape[1]) + 0.5) / shape[1]
    # An open face needs one more pass than fit, for the groove that its end cuts.
    passes = round(size[0] / pitch) if wraps else int(size[0] / pitch) + 1
    z = _grooves(x1, turn, passes, pitch, radius, (feed_error * pitch, depth_error * depth), rng)
    if nose_radius is not None:
        z = np.minimum(z, depth)
    z = z + np.sqrt(2) * waviness * np.cos(2 * np.pi * (x1 / wave + rng.random()))
    periodic = (wraps and (waviness == 0 or _whole(size[0] / wave)), True)
    face = Topography(z, spacing, periodic).low_pass(cut_off)
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


def _grooves(
    x1: NDArray,
    turn: NDArray,
    passes: int,
    pitch: float,
    radius: float,
    rms_errors: Pair,
    rng: np.random.Generator,
) -> NDArray:
    """Lowest of the passes (n1, n2) [m] at x1 (n1, 1) [m] and turn (n2,) [rad], with rms errors (2,) [m].

    The errors of position and depth are (passes, n2): a constant and a wander along the groove.
    """
    constant, wander = rng.standard_normal((2, 2, passes, 1))
    along = np.cos(turn + 2 * np.pi * rng.random((2, passes, 1)))
    shift, drop = np.reshape(rms_errors, (2, 1, 1)) * (np.sqrt(0.5) * constant + wander * along)
    # A pass further away than this cannot be the lowest: the nearest is within pitch/2 + shift.
    off = np.abs(shift).max()
    far = np.sqrt((pitch / 2 + off) ** 2 + 2 * radius * np.ptp(drop))
    reach = int(np.ceil((far + off) / pitch))
    nearest = np.floor(x1[:, 0] / pitch).astype(int)
    z = np.full((x1.size, turn.size), np.inf)
    for k in range(-reach, reach + 1):
        number = nearest + k
        # Beyond the ends of an open face its errors are used again: passes must exist there, no matter which.
        groove = number % passes
        off_bottom = x1 - (number[:, None] + 0.5) * pitch - shift[groove]
        np.minimum(z, off_bottom**2 / (2 * radius) - drop[groove], out=z)
    return z


def random_waves(
    shape: Shape, numbers: tuple[NDArray, NDArray], amplitude: NDArray, rng: np.random.Generator
) -> NDArray:
    """Heights (n1, n2) [m] of waves of random phases, of `wave_numbers` and as many amplitudes [m]."""
    k1, k2 = numbers
    spectrum = np.zeros((shape[0], shape[1] // 2 + 1), dtype=complex)
    for first in range(0, amplitude.size, _WAVES_AT_ONCE):
        some = slice(first, first + _WAVES_AT_ONCE)
        row, column = k1[some], k2[some]
        phase = 2 * np.pi * rng.random(row.size)
        # Samples are at pixel centres, half a pixel from the origin of the phases: they stay put when the grid
        # changes.
        phase += np.pi * (row / shape[0] + column / shape[1])
        waves = amplitude[some] * np.exp(1j * phase)
        spectrum[row, column] = waves
        rim = column == 0
        spectrum[-row[rim], 0] = waves[rim].conj()
    return scipy.fft.irfft2(spectrum, s=shape, norm="forward", overwrite_x=True)


def wave_numbers(size: Pair, cut_off: float) -> tuple[NDArray, NDArray]:
    """Wave numbers k1, k2 of half the plane with q < 2π/cut_off, longest wave first.

    The order, and therefore the phase each wave gets, depends on the ratio of the sides alone: not on the
    grid.
    """
    most = [int(length / cut_off) for length in size]
    # short numbers, as a face has half as many waves as points
    first, second = np.arange(-most[0], most[0] + 1), np.arange(most[1] + 1)
    k1, k2 = np.meshgrid(first.astype(np.int32), second.astype(np.int32), indexing="ij")
    square = np.square(k1, dtype=float) + (k2 * (size[0] / size[1])) ** 2
    half = (k2 > 0) | (k1 > 0)
    # At the limit itself a wave could be the sampled Nyquist wave, whose phase the grid would decide.
    kept = half & (square < (size[0] / cut_off) ** 2 * (1 - SLACK))
    k1, k2, square = k1[kept], k2[kept], square[kept]
    order = np.lexsort((k2, k1, square))
    return k1[order], k2[order]


def _cut_off(cut_off: float | None, spacing: Pair, size: Pair) -> float:
    """The shortest wave [m] as given, or of 8 pixels; raises InputError if the grid or the face has none such."""
    pixel, longest = max(spacing), max(size)
    given = PIXELS_PER_WAVE * pixel if cut_off is None else cut_off
    given = validate.number("cut_off", given, unit="m")
    expected = (
        f">= 2 pixels = {to_text(2 * pixel, 'm')} and < the larger side = {to_text(longest, 'm')}"
    )
    if not 2 * pixel * (1 - SLACK) <= given < longest * (1 - SLACK):
        raise InputError("cut_off", to_text(given, "m"), f"a wavelength {expected}")
    return given


def _whole(ratio: float) -> bool:
    return ratio > 0.5 and abs(ratio - round(ratio)) <= 1e-9 * ratio


def _generator(rng: Any) -> np.random.Generator:
    try:
        if rng is None:
            raise TypeError
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        expected = "a numpy Generator or a seed, so that the face can be made again"
        raise InputError("rng", repr(rng), expected) from None
