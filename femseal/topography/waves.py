"""Decompose maps of heights into waves, and compute the slopes and the spectral densities of the waves.

Along a periodic axis, a map is decomposed into a Fourier series. Along a mirrored axis (any axis that is not periodic),
the map continues as its mirror image; the decomposition of samples at pixel centres is then the cosine transform
DCT-II. Along a periodic axis of length L with n points, wave k is exp(i q x) with q = 2πk/L and k = −n/2 … n/2. Along a
mirrored axis, wave k is cos(q x) with q = πk/L and k = 0 … n−1. On periodic and on mirrored axes, x = 0 is the edge of
the first pixel.

Symbols: z heights (n1, n2) [m], d spacing [m], q angular wave number [rad/m], Sq rms height about the mean [m],
C spectral density. Source of the spectral densities: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017)
013001.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Array, Pair, Periodic, Shape

#: Relative tolerance of comparisons with a wave number, so that rounding errors do not matter for a wave at the limit.
SLACK = 1e-9


def wave_powers(z: NDArray, periodic: Periodic) -> NDArray:
    """Return the contribution of each wave to the mean square of the heights `z`, (n1, n2) [m²].

    The contributions of all waves add up to the mean square of `z` (Parseval's theorem).
    """
    _, wrapped = _mirrored_and_periodic_axes(periodic)
    half = half_spectrum(z, periodic)
    if not wrapped:
        return half**2 / z.size
    powers = np.empty(z.shape)
    # Along one axis, `half` contains only the waves k >= 0. In the views below, this axis is the last axis.
    halved_axis = wrapped[-1]
    half_view = half.swapaxes(-1, halved_axis)
    powers_view = powers.swapaxes(-1, halved_axis)
    n = z.shape[halved_axis]
    count = n // 2 + 1  # number of waves in `half` along this axis
    np.square(half_view.real, out=powers_view[:, :count])
    for row, waves in zip(powers_view, half_view, strict=True):
        row[:count] += waves.imag**2
    powers_view[:, :count] /= z.size
    # The waves −k are the conjugates of the waves k and contribute equally much. Wave −k has the index n − k, so that
    # the waves −k follow in the order of decreasing k, without k = 0 and, if n is even, without k = n/2.
    conjugates = powers_view[:, 1 : n - count + 1][:, ::-1]
    if len(wrapped) == 2:
        # The conjugate of wave (k1, k2) is (−k1, −k2). Row 0 contains the waves with k1 = 0 and their conjugates. The
        # conjugates of row k1 belong to row n1 − k1, so that the other rows are taken in reverse order.
        powers_view[0, count:] = conjugates[0]
        powers_view[1:, count:] = conjugates[:0:-1]
    else:
        powers_view[:, count:] = conjugates
    return powers


def half_spectrum(z: NDArray, periodic: Periodic) -> NDArray[Any]:
    """Compute the coefficients of the waves of `z` by an orthonormal transform.

    Along the last periodic axis, the result contains only the waves k >= 0, to save memory: the coefficient of wave −k
    is the complex conjugate of the coefficient of wave k. `half_multiplicity` counts how many waves (k, or k and −k)
    each coefficient represents.
    """
    mirrored, wrapped = _mirrored_and_periodic_axes(periodic)
    coefficients = scipy.fft.dctn(z, axes=mirrored, norm="ortho") if mirrored else z
    return scipy.fft.rfftn(coefficients, axes=wrapped, norm="ortho") if wrapped else coefficients


def half_multiplicity(shape: Shape, periodic: Periodic) -> tuple[NDArray, NDArray]:
    """Count how many waves of the full spectrum each coefficient of a `half_spectrum` represents.

    The coefficient in row i and column j represents rows[i] · columns[j] waves, which is 1 or 2. The arrays `rows` and
    `columns` are returned.
    """
    _, wrapped = _mirrored_and_periodic_axes(periodic)
    rows, columns = np.ones(shape[0]), np.ones(shape[1])
    if not wrapped:
        return rows, columns
    # along the axis with only the waves k >= 0, a coefficient represents wave k and its conjugate −k
    halved_axis = wrapped[-1]
    n = shape[halved_axis]
    factors = np.full(n // 2 + 1, 2.0)
    factors[0] = 1.0  # k = 0 is its own conjugate
    if n % 2 == 0:
        factors[-1] = 1.0  # the Nyquist wave is its own conjugate
    if halved_axis == 0:
        return factors, columns
    return rows, factors


def wave_numbers(n: int, d: float, periodic: bool) -> NDArray:
    """Return the wave numbers along an axis, (n,) [rad/m], in the order of the transform; signed if periodic."""
    if periodic:
        return 2 * np.pi * scipy.fft.fftfreq(n, d)
    return np.pi * np.arange(n) / (n * d)


def wavenumber_grids(shape: Shape, spacing: Pair, periodic: Periodic) -> tuple[NDArray, NDArray]:
    """Return the wave numbers along x1 (n1, 1) and along x2 (1, n2) [rad/m]."""
    q1 = wave_numbers(shape[0], spacing[0], periodic[0])
    q2 = wave_numbers(shape[1], spacing[1], periodic[1])
    return q1[:, None], q2[None, :]


def truncate(z: NDArray, spacing: Pair, periodic: Periodic, limit: float) -> NDArray:
    """Remove the waves with |q| > `limit` [rad/m] from the heights `z`, and return the result."""
    mirrored, wrapped = _mirrored_and_periodic_axes(periodic)
    coefficients = half_spectrum(z, periodic)
    q1, q2 = wavenumber_grids((z.shape[0], z.shape[1]), spacing, periodic)
    columns = coefficients.shape[1]
    for row, waves in enumerate(coefficients):  # one row at a time, to save memory
        is_short = q1[row] ** 2 + q2[0, :columns] ** 2 > (limit * (1 + SLACK)) ** 2
        waves[is_short] = 0
    if len(wrapped) == 2:
        # one axis at a time, because an inverse transform along both axes at once would copy the coefficients
        coefficients = scipy.fft.ifft(coefficients, axis=0, norm="ortho", overwrite_x=True)
    if wrapped:
        axis = wrapped[-1]
        coefficients = scipy.fft.irfft(
            coefficients, z.shape[axis], axis=axis, norm="ortho", overwrite_x=True
        )
    if mirrored:
        heights = scipy.fft.idctn(coefficients, axes=mirrored, norm="ortho", overwrite_x=True)
        # The result is usually a view of the overwritten array. The array itself, which owns its memory, is returned
        # instead, so that `Topography` does not have to copy it.
        coefficients = coefficients if heights.base is coefficients else heights
    return coefficients


def resample_axis(z: NDArray, n: int, axis: int, periodic: bool) -> NDArray:
    """Interpolate `z` at the centres of `n` pixels along an axis, without waves that are too short for these pixels.

    The interpolation is exact for band-limited data. If the number of points along the axis changes from m to n, the
    spacing changes from d_m to d_n, and the centre of the first pixel moves from d_m/2 to d_n/2. This shift changes the
    phase of coefficient k by πk(1/n − 1/m).
    """
    m = z.shape[axis]
    if m == n:
        return z
    if not periodic:
        return scipy.fft.idct(scipy.fft.dct(z, axis=axis), n=n, axis=axis) * (n / m)
    k = np.arange(min(m, n) // 2 + 1)
    factor = np.exp(1j * np.pi * k * (1 / n - 1 / m)) * (n / m)
    # The sampled Nyquist wave contains the waves k and −k. On a finer grid its coefficient is divided between them; on
    # a coarser grid it is the sum of both.
    if min(m, n) % 2 == 0:
        factor[-1] *= 0.5 if m < n else 2.0
    coefficients = np.take(scipy.fft.rfft(z, axis=axis), k, axis)
    return scipy.fft.irfft(coefficients * np.expand_dims(factor, 1 - axis), n, axis=axis)


def _mirrored_and_periodic_axes(periodic: Periodic) -> tuple[list[int], list[int]]:
    """Return the indices of the mirrored (not periodic) axes, and the indices of the periodic axes."""
    mirrored = [axis for axis in (0, 1) if not periodic[axis]]
    wrapped = [axis for axis in (0, 1) if periodic[axis]]
    return mirrored, wrapped


def rms_slopes(z: NDArray, spacing: Pair, periodic: Periodic, *, limit: float = inf) -> Pair:
    """Return the rms of ∂z/∂x1 and of ∂z/∂x2 [-] of the waves with |q| <= `limit` [rad/m].

    The rms slope along axis i is √(Σ q_i² |c|²), where q_i is the wave number along axis i, and c is the coefficient of
    the wave (Parseval's theorem).
    """
    shape = z.shape[0], z.shape[1]
    half = half_spectrum(z, periodic)
    q1, q2 = wavenumber_grids(shape, spacing, periodic)
    q2_squared = q2[0, : half.shape[1]] ** 2
    # number of waves of the whole spectrum that each coefficient of the half spectrum stands for
    row_waves, column_waves = half_multiplicity(shape, periodic)
    # sums of the squares of both slopes over all waves, one row of the spectrum at a time, to save memory
    sum1 = sum2 = 0.0
    for row, coefficients in enumerate(half):
        q1_squared = q1[row, 0] ** 2
        powers = row_waves[row] * column_waves * np.abs(coefficients) ** 2
        powers[q1_squared + q2_squared > (limit * (1 + SLACK)) ** 2] = 0
        sum1 += q1_squared * powers.sum()
        sum2 += q2_squared @ powers
    return float(np.sqrt(sum1 / z.size)), float(np.sqrt(sum2 / z.size))


def profile_density(
    z: NDArray, spacing: Pair, periodic: Periodic, axis: int
) -> tuple[Array, Array]:
    """Return the spectral density of the profiles along an axis, averaged over all profiles.

    The heights are measured from their mean. `Topography.psd` describes the result: the wave numbers q [rad/m] and the
    spectral density C [m³], both (waves,).
    """
    powers = wave_powers(z - z.mean(), periodic).sum(axis=1 - axis)
    step = _wave_steps(z, spacing, periodic)[axis]
    if periodic[axis]:
        # The indices n − 1, n − 2, … contain the powers of the waves −1, −2, …, which are added to those of the
        # waves 1, 2, …. If n is even, the Nyquist wave n/2 stays alone.
        n = powers.size
        powers[1 : (n + 1) // 2] += powers[: n // 2 : -1]
        powers = powers[: n // 2 + 1]
    density = powers * (np.pi / step)
    density[0] *= 2  # q = 0 has half the weight
    return step * np.arange(density.size, dtype=np.float64), density


def radial_density(z: NDArray, spacing: Pair, periodic: Periodic) -> tuple[Array, Array]:
    """Return the two-dimensional spectral density, averaged over all directions of the wave vector.

    The heights are measured from their mean. `Topography.radial_psd` describes the result: the mean wave numbers |q|
    [rad/m] and the spectral density C2D [m⁴] of all rings with waves, both (rings,).
    """
    shape = z.shape[0], z.shape[1]
    half = half_spectrum(z - z.mean(), periodic)
    q1, q2 = wavenumber_grids(shape, spacing, periodic)
    # Along a mirrored axis, each wave except k = 0 represents two wave vectors: its own wave vector and the mirror
    # image. Wave (i, j) represents row_copies[i] · column_copies[j] wave vectors.
    row_copies, column_copies = (
        np.where(is_periodic | (np.arange(n) == 0), 1.0, 2.0)
        for n, is_periodic in zip(shape, periodic, strict=True)
    )
    wave_steps = _wave_steps(z, spacing, periodic)
    step = max(wave_steps)
    rings = int(np.hypot(np.abs(q1).max(), np.abs(q2).max()) / step) + 3
    count = np.zeros(rings)
    q_sum = np.zeros(rings)
    power_sum = np.zeros(rings)
    # number of waves of the whole spectrum that each coefficient of the half spectrum stands for
    row_waves, column_waves = half_multiplicity(shape, periodic)
    columns = half.shape[1]
    for row, coefficients in enumerate(half):  # one row at a time, to save memory
        q = np.hypot(q1[row], q2[0, :columns])
        ring = np.rint(q / step).astype(int) + 1
        if row == 0:
            ring[0] = 0  # the mean of the map is in ring 0, which is not returned
        waves = row_waves[row] * column_waves
        wave_vectors = waves * row_copies[row] * column_copies[:columns]
        powers = waves * np.abs(coefficients) ** 2 / z.size
        count += np.bincount(ring, wave_vectors, rings)
        q_sum += np.bincount(ring, q * wave_vectors, rings)
        power_sum += np.bincount(ring, powers, rings)
    filled = np.flatnonzero(count)[1:]  # without ring 0
    mean_q = q_sum[filled] / count[filled]
    mean_power = power_sum[filled] / count[filled]
    # each wave vector represents the area Δq1 Δq2 of the plane of wave vectors: power = C2D Δq1 Δq2/4π²
    area_per_wave = wave_steps[0] * wave_steps[1]
    return mean_q, mean_power * (4 * np.pi**2 / area_per_wave)


def _wave_steps(z: NDArray, spacing: Pair, periodic: Periodic) -> Pair:
    """Return the steps between the wave numbers [rad/m], 2π/L along a periodic axis and π/L along any other axis."""
    first, second = (
        float(np.pi * (1 + is_periodic) / (n * d))
        for n, d, is_periodic in zip(z.shape, spacing, periodic, strict=True)
    )
    return first, second
